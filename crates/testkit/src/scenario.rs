//! Records of a Changi 02L scenario, as a simulator would have left them.

use dataset::conditions::{Clock, Conditions, Weather};
use dataset::corpus::scenario::{Flight, PINHOLE_SCHEMA_VERSION, ScenarioRecord, Versions};
use dataset::geometry::camera::CameraPose;
use dataset::geometry::pose::{Controls, Pose};
use dataset::numbers::frame_rate::FrameRate;
use dataset::tables::frames::{TickRow, ViewStamp};

use crate::changi_02l;
use crate::rig::VIEWS;

/// Clear sky without wind.
pub fn calm(visibility_m: f64) -> Weather {
    Weather {
        visibility_m,
        clouds: Vec::new(),
        rain_ratio: 0.0,
        wind_speed_mps: 0.0,
        wind_from_true_deg: 0.0,
        turbulence_ratio: 0.0,
    }
}

/// A live flight in clear weather, seen by both views.
pub fn record(id: &str, frame_rate: FrameRate, ticks: u32) -> ScenarioRecord {
    let runway = changi_02l();
    ScenarioRecord {
        schema_version: PINHOLE_SCHEMA_VERSION,
        id: id.into(),
        trajectory: format!("trajectory-of-{id}"),
        seed: Some(7),
        plan_hash: Some("plan".into()),
        config_hash: "config".into(),
        aircraft: "B737-800".into(),
        traffic: Vec::new(),
        frame_rate,
        ticks,
        touchdown: runway.touchdown_target(),
        runway,
        flight_touchdown: None,
        geoid: None,
        conditions: Some(Conditions {
            time_of_day: "12:00".into(),
            clock: Clock {
                day_of_year: 80,
                zulu_time_s: 14_400.0,
            },
            weather_name: "clear".into(),
            weather: calm(40_000.0),
        }),
        effective_weather: None,
        flight: Flight::Live,
        rig: "wide-baseline".into(),
        views: VIEWS.map(str::to_owned).to_vec(),
        blocks: None,
        graphics: None,
        recorded: None,
        versions: Versions {
            dtd: "0".into(),
            simulator: Some("fixture".into()),
            capture_link: Some(1),
            pixels: Some("link".into()),
            encoder: None,
        },
    }
}

/// A tick without views and labels.
pub fn frame(tick: u32, frame_rate: FrameRate, pose: Pose) -> TickRow {
    TickRow {
        tick,
        time_ns: frame_rate.time_of_tick(tick).0,
        pose,
        velocity_ned_mps: [64.0, 27.0, 3.7],
        true_airspeed_mps: 72.0,
        controls: Controls {
            flap_ratio: 0.75,
            gear_ratio: 1.0,
        },
        on_ground: false,
        views: Vec::new(),
        image_times_ns: Vec::new(),
        labels: None,
        dtd_sd_m: None,
    }
}

/// Stamp for a view that was drawn as requested.
pub fn stamp(
    sim_frame: u64,
    frame: &TickRow,
    frame_rate: FrameRate,
    camera: CameraPose,
) -> ViewStamp {
    ViewStamp {
        sim_frame,
        pts: frame_rate.pts_of_tick(frame.tick),
        echoed_pose: frame.pose,
        echoed_camera: camera,
    }
}
