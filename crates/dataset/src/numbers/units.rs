//! Units as types, for places where two plain numbers could be swapped.
//!
//! Plain numbers that leave Rust (TOML, JSON, Parquet, the wire) have their unit in their name instead: `distance_m`.

use serde::{Deserialize, Serialize};

/// Metres in one international nautical mile (exact by definition).
pub const METERS_PER_NAUTICAL_MILE: f64 = 1852.0;
/// Metres in one international foot (exact by definition).
pub const METERS_PER_FOOT: f64 = 0.3048;
/// Metres per second in one knot.
pub const MPS_PER_KNOT: f64 = METERS_PER_NAUTICAL_MILE / 3600.0;
/// Seconds in one day.
pub const SECONDS_PER_DAY: f64 = 86_400.0;
/// Nanoseconds in one second.
pub(crate) const NANOS_PER_SECOND: i64 = 1_000_000_000;

/// An angle in degrees.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Serialize, Deserialize)]
pub struct Degrees(pub f64);

impl Degrees {
    /// This direction in [0, 360).
    pub fn wrapped_360(self) -> Self {
        Self(self.0.rem_euclid(360.0))
    }

    /// This direction in [-180, 180).
    pub fn wrapped_180(self) -> Self {
        Self((self.0 + 180.0).rem_euclid(360.0) - 180.0)
    }
}

/// Simulator time in whole nanoseconds since a scenario's first tick. Never wall-clock time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct SimTime(pub i64);

impl SimTime {
    /// Seconds, for formulas.
    pub fn seconds(self) -> f64 {
        self.0 as f64 / NANOS_PER_SECOND as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_wrap_to_their_half_open_range() {
        assert_eq!(Degrees(-90.0).wrapped_360(), Degrees(270.0));
        assert_eq!(Degrees(360.0).wrapped_360(), Degrees(0.0));
        assert_eq!(Degrees(180.0).wrapped_180(), Degrees(-180.0));
        assert_eq!(Degrees(539.0).wrapped_180(), Degrees(179.0));
    }
}
