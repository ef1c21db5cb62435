//! Units of timestamps. Tables count in units of the frame rate and each file in the container's units, so times are compared rather than
//! numbers.

use std::fmt;

use crate::numbers::frame_rate::FrameRate;

/// A unit of timestamps, as a fraction of 1 s.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TimeBase {
    /// Numerator.
    pub numerator: u32,
    /// Denominator.
    pub denominator: u32,
}

impl TimeBase {
    /// A unit that gives every tick a whole timestamp. Recorded videos and `pts` in tables use it.
    pub fn of_ticks(rate: FrameRate) -> Self {
        Self {
            numerator: 1,
            denominator: rate.time_scale(),
        }
    }

    /// The unit of FFmpeg's fraction, if it is positive.
    pub(super) fn of_fraction(fraction: ffmpeg_next::Rational) -> Option<Self> {
        let [numerator, denominator] =
            [fraction.numerator(), fraction.denominator()].map(|term| u32::try_from(term).ok());
        numerator
            .zip(denominator)
            .filter(|(numerator, denominator)| *numerator > 0 && *denominator > 0)
            .map(|(numerator, denominator)| Self {
                numerator,
                denominator,
            })
    }

    /// Length of the unit, seconds.
    pub fn seconds(self) -> f64 {
        f64::from(self.numerator) / f64::from(self.denominator)
    }

    /// Converts a timestamp to a different unit; `None` if it falls between two units.
    pub fn convert(self, pts: i64, to: Self) -> Option<i64> {
        let product = i128::from(pts) * i128::from(self.numerator) * i128::from(to.denominator);
        let divisor = i128::from(self.denominator) * i128::from(to.numerator);
        (product % divisor == 0)
            .then_some(product / divisor)
            .and_then(|pts| i64::try_from(pts).ok())
    }
}

impl fmt::Display for TimeBase {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{} s", self.numerator, self.denominator)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_timestamp_is_the_same_time_in_every_unit_or_has_no_number_there() {
        let of = |numerator, denominator| TimeBase {
            numerator,
            denominator,
        };
        let ticks = TimeBase::of_ticks(FrameRate::new(30_000, 1_001).unwrap());
        assert_eq!(of(1, 60_000).convert(4_004, ticks), Some(2_002));
        assert_eq!(ticks.convert(2_002, of(1, 60_000)), Some(4_004));
        assert_eq!(of(1, 60_000).convert(4_005, ticks), None);
        assert_eq!(of(1, 30).convert(i64::MAX, of(1, 15_360)), None);
    }
}
