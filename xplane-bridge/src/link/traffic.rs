//! Paths of other aircraft, which a client sends before it captures images.

use dataset::geometry::pose::{Controls, Pose};
use serde::{Deserialize, Serialize};

/// States per request. Each takes some 300 bytes, so that they stay well below the longest header.
pub(crate) const STATES_PER_REQUEST: usize = 150;

/// A part of the path of another aircraft. Parts of one aircraft follow each other in time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrafficPart {
    /// Number of the aircraft, from 1; the first aircraft has number 0.
    pub number: u32,
    /// Aircraft type.
    pub aircraft: String,
    /// Places, in order of time. Between two of them the aircraft moves in a straight line.
    pub states: Vec<TrafficState>,
}

/// State of a path at an instant.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrafficState {
    /// Simulator time since the first tick, nanoseconds.
    pub time_ns: i64,
    /// Pose of the aircraft.
    pub pose: Pose,
    /// Flaps and gear.
    pub controls: Controls,
}
