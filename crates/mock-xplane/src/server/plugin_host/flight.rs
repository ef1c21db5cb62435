//! A live flight for the plugin: flown completely by the engine when the approach is engaged, then shown frame by frame.

use dataset::geometry::approach_profile::ApproachProfile;
use dataset::geometry::flight::state_at;
use dataset::geometry::pose::FlightState;
use dataset::geometry::runway::Runway;
use dataset::numbers::units::METERS_PER_FOOT;
use xplane_bridge::fly::{FlightStart, FlyRequest};

/// Longest flight, seconds. The plugin has its own limit.
const LIMIT_S: f64 = 1_800.0;

/// A flight in progress.
#[derive(Debug)]
pub(super) struct Playback {
    states: Vec<FlightState>,
    time_s: f64,
}

impl Playback {
    pub(super) fn new(states: Vec<FlightState>) -> Self {
        Self {
            states,
            time_s: 0.0,
        }
    }

    /// The state after this much more time; finally always the last one. Frames and states of the engine have different times: a
    /// frame is interpolated between two states.
    pub(super) fn advance(&mut self, elapsed_s: f64) -> Option<FlightState> {
        self.time_s += elapsed_s;
        state_at(&self.states, self.time_s)
    }
}

/// The engine's request for an engaged approach: level at the dialled altitude until the glide path, then down it.
pub(super) fn request(start: FlightStart, runway: Runway, altitude_dial_ft: f64) -> FlyRequest {
    FlyRequest {
        start,
        runway,
        profile: ApproachProfile::GlidePath {
            level_altitude_msl_m: altitude_dial_ft * METERS_PER_FOOT,
        },
        // X-Plane has no seed.
        seed: 0,
        time_limit_s: LIMIT_S,
        already_started: true,
    }
}

#[cfg(test)]
mod tests {
    use dataset::geometry::geodesy::Geodetic;
    use dataset::geometry::pose::{Controls, Pose};

    use super::*;

    const SPEED_MPS: f64 = 72.0;

    /// Along a meridian, 30 states per second like the engine's.
    fn states() -> Vec<FlightState> {
        let mut position = Geodetic {
            latitude_deg: 1.3,
            longitude_deg: 103.9,
            altitude_msl_m: 200.0,
        };
        let step_s = 1.0 / 30.0;
        (0..90)
            .map(|at| {
                let here = position;
                let ahead = here.ecef_from_ned().x_axis * SPEED_MPS * step_s;
                position = Geodetic::from_ecef(here.to_ecef() + ahead);
                FlightState {
                    time_s: f64::from(at) * step_s,
                    pose: Pose {
                        latitude_deg: here.latitude_deg,
                        longitude_deg: here.longitude_deg,
                        altitude_msl_m: here.altitude_msl_m,
                        heading_true_deg: 0.0,
                        pitch_deg: 0.0,
                        roll_deg: 0.0,
                    },
                    velocity_north_mps: SPEED_MPS,
                    velocity_east_mps: 0.0,
                    velocity_down_mps: 0.0,
                    true_airspeed_mps: SPEED_MPS,
                    controls: Controls::default(),
                    on_ground: false,
                }
            })
            .collect()
    }

    #[test]
    fn frames_twice_as_fast_as_the_states_move_evenly() {
        let mut playback = Playback::new(states());
        let period_s = 1.0 / 60.0;
        let mut last = states()[0];
        for frame in 1..=170 {
            let shown = playback.advance(period_s).unwrap();
            let way_m = shown.position_ecef().distance(last.position_ecef());
            assert!(
                (way_m - SPEED_MPS * period_s).abs() < 1e-3,
                "frame {frame}: {way_m} m"
            );
            last = shown;
        }
    }
}
