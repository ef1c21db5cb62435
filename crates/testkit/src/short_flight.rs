//! A flight down the glide path at a constant speed, a camera beside the runway that rests, and the weather at noon: what a client writes
//! itself where no sweep is recorded.

use dataset::conditions::{Clock, Conditions, Weather};
use dataset::geometry::camera::CameraPose;
use dataset::geometry::pose::{Controls, FlightState, Pose};
use dataset::geometry::runway::Runway;
use dataset::numbers::frame_rate::FrameRate;

use crate::changi_02l;

pub(crate) const SPEED_MPS: f64 = 72.0;

/// The runway with the magnetic course that an X-Plane needs for its autopilot.
pub fn runway() -> Runway {
    Runway {
        course_magnetic_deg: Some(23.0),
        ..changi_02l()
    }
}

/// Noon in June without clouds, rain or wind.
pub fn noon(visibility_m: f64) -> Conditions {
    Conditions {
        time_of_day: "12:00".into(),
        clock: Clock {
            day_of_year: 172,
            zulu_time_s: 4.0 * 3_600.0,
        },
        weather_name: "clear".into(),
        weather: Weather {
            visibility_m,
            clouds: Vec::new(),
            rain_ratio: 0.0,
            wind_speed_mps: 0.0,
            wind_from_true_deg: 0.0,
            turbulence_ratio: 0.0,
        },
    }
}

/// A camera 1,000 m past the threshold and `side_m` right of the centreline that looks up the approach.
pub fn camera_beside_runway(side_m: f64) -> CameraPose {
    let at = changi_02l().point_on_approach(-1_000.0, side_m);
    CameraPose {
        pose: Pose {
            latitude_deg: at.latitude_deg,
            longitude_deg: at.longitude_deg,
            altitude_msl_m: 16.0,
            heading_true_deg: 203.02,
            pitch_deg: 2.0,
            roll_deg: 0.0,
        },
        hfov_deg: 14.0,
    }
}

/// Down the glide path from a distance, metres, in the landing configuration.
pub fn down_the_glide_path(from_m: f64, ticks: u32, frame_rate: FrameRate) -> Vec<FlightState> {
    let state = |tick| {
        let time_s = frame_rate.time_of_tick(tick).seconds();
        let to_go_m = from_m - SPEED_MPS * time_s;
        let at = changi_02l().point_on_approach(to_go_m, 0.0);
        FlightState {
            time_s,
            pose: Pose {
                latitude_deg: at.latitude_deg,
                longitude_deg: at.longitude_deg,
                altitude_msl_m: 7.0 + to_go_m * 0.0524,
                heading_true_deg: 23.02,
                pitch_deg: 3.0,
                roll_deg: 0.0,
            },
            velocity_north_mps: 66.0,
            velocity_east_mps: 28.0,
            velocity_down_mps: 3.8,
            true_airspeed_mps: SPEED_MPS,
            controls: Controls {
                flap_ratio: 0.5,
                gear_ratio: 1.0,
            },
            on_ground: false,
        }
    };
    (0..ticks).map(state).collect()
}
