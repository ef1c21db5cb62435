//! Origin of a scenario that was recorded with real cameras: sources, clocks, and how well each quantity is known.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// Source of a quantity.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Origin {
    /// Measured by an instrument, a survey or a detector.
    Measured,
    /// Stated without a measurement.
    Assumed,
    /// Computed from measured quantities.
    Derived,
    /// Read from a simulator.
    Simulated,
}

/// A file that the scenario was made from.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SourceFile {
    /// File name without folders.
    pub file: String,
    /// BLAKE3 hash of the file.
    pub blake3: String,
}

/// Clock of a camera, relative to the clock of the tracks.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CameraClock {
    /// Seconds that were added to the stated times at the start of the scenario.
    pub offset_s: f64,
    /// Standard deviation of the offset, seconds.
    pub offset_sd_s: f64,
    /// Seconds that the camera's clock loses in a million.
    pub drift_ppm: f64,
    /// Standard deviation of the drift.
    pub drift_sd_ppm: f64,
}

/// Delay of the flight's track, relative to the other flights of the recording.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DelayedTrack {
    /// Seconds by which the track shows the aircraft too late; taken off.
    pub delay_s: f64,
    /// Standard deviation of the delay, seconds.
    pub delay_sd_s: f64,
}

/// Origin of a recorded scenario.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Recorded {
    /// UTC of tick 0, seconds since 1970, by the tracks' clock.
    pub start_utc_s: f64,
    /// Origin of each quantity, by its name in this corpus.
    pub origins: BTreeMap<String, Origin>,
    /// The track.
    pub track: SourceFile,
    /// Boxes by camera.
    pub boxes: BTreeMap<String, SourceFile>,
    /// Clocks by camera.
    pub clocks: BTreeMap<String, CameraClock>,
    /// Delay of the track.
    pub delayed_track: DelayedTrack,
    /// Standard deviations of the positions along the course, across it, and of the heights, metres.
    pub position_sd_m: [f64; 3],
    /// Median distance of box centres from the projected track, pixels, by camera; missing where the camera did not see the flight.
    pub residual_px: BTreeMap<String, f64>,
}
