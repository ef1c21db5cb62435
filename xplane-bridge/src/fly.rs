//! The request for a live flight: its start, its runway and its vertical profile.
//!
//! These are the types of the capture link's `fly` message. The simulator flies it with its own flight model and autopilot (the
//! stand-in with the model of `mock-xplane`), and answers with the states at its own rate. Wind and turbulence are not part of the
//! request: they are the simulator's current weather.

use dataset::geometry::approach_profile::ApproachProfile;
use dataset::geometry::geodesy::Geodetic;
use dataset::geometry::runway::Runway;
use serde::{Deserialize, Serialize};

/// Start position, heading and speed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FlightStart {
    /// Position of the centre of gravity.
    pub position: Geodetic,
    /// Heading, degrees true.
    pub heading_true_deg: f64,
    /// True airspeed, metres per second. Never zero: an aircraft put into the air at rest would fall.
    pub speed_mps: f64,
}

/// A live flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FlyRequest {
    /// Start position.
    pub start: FlightStart,
    /// Destination runway.
    pub runway: Runway,
    /// Vertical profile of the approach.
    pub profile: ApproachProfile,
    /// Seed of everything random in the flight (gusts, turbulence). X-Plane has no such seed and ignores it.
    pub seed: u64,
    /// Give up if the flight has not landed after this much simulated time, seconds.
    pub time_limit_s: f64,
    /// True if the flight has already started in the air (by X-Plane 12's Web API), so that the aircraft need not be placed.
    #[serde(default)]
    pub already_started: bool,
}
