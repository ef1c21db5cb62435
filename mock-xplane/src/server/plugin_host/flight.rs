//! A live flight for the plugin: flown whole by the engine when the approach is engaged, then shown frame by frame.

use dataset::pose::FlightState;
use dataset::runway::Runway;
use dataset::units::METERS_PER_FOOT;
use xplane_bridge::fly::{ApproachProfile, FlightStart, FlyRequest};

/// Longest flight, seconds. The plugin has its own limit.
const LIMIT_S: f64 = 1_800.0;

/// A flight on its way.
#[derive(Debug)]
pub(super) struct Playback {
    states: Vec<FlightState>,
    time_s: f64,
    next: usize,
}

impl Playback {
    /// Of the states of a flight.
    pub(super) fn new(states: Vec<FlightState>) -> Self {
        Self {
            states,
            time_s: 0.0,
            next: 0,
        }
    }

    /// The state after so much more time; the last one for ever.
    pub(super) fn advance(&mut self, elapsed_s: f64) -> Option<FlightState> {
        self.time_s += elapsed_s;
        let due = |state: &FlightState| state.time_s < self.time_s;
        let last = self.states.len().saturating_sub(1);
        while self.next < last && self.states.get(self.next).is_some_and(due) {
            self.next += 1;
        }
        self.states.get(self.next).copied()
    }
}

/// What an engaged approach asks of the engine: level at the dialled altitude until the glide path, then down it.
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
