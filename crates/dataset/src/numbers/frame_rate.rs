//! A frame rate as an exact fraction, and a tick's time.

pub mod text;

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::numbers::limits::{FRAME_RATE_HZ, MAX_FRAME_RATE_TERM};
use crate::numbers::units::{NANOS_PER_SECOND, SimTime};

/// Frames per second as a fraction: 30/1, 30000/1001, 1/2. Never a float, so that rounding errors do not accumulate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "Fraction")]
pub struct FrameRate {
    /// Frames in `denominator` seconds.
    pub numerator: u32,
    /// Seconds that `numerator` frames take.
    pub denominator: u32,
}

/// An invalid frame rate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "{numerator}/{denominator} is not a frame rate; expected {} to {} per second, as a whole number or as a fraction of numbers up to \
     {MAX_FRAME_RATE_TERM}", "1/60", FRAME_RATE_HZ.most
)]
pub struct BadFrameRate {
    numerator: u32,
    denominator: u32,
}

/// The fraction as it was given.
#[derive(Deserialize)]
struct Fraction {
    numerator: u32,
    denominator: u32,
}

impl TryFrom<Fraction> for FrameRate {
    type Error = BadFrameRate;

    fn try_from(fraction: Fraction) -> Result<Self, BadFrameRate> {
        Self::new(fraction.numerator, fraction.denominator)
    }
}

impl FrameRate {
    /// The rate `numerator / denominator`, if cameras and videos support it.
    pub fn new(numerator: u32, denominator: u32) -> Result<Self, BadFrameRate> {
        let terms = 1..=MAX_FRAME_RATE_TERM;
        let hz = f64::from(numerator) / f64::from(denominator);
        if terms.contains(&numerator) && terms.contains(&denominator) && FRAME_RATE_HZ.hold(hz) {
            Ok(Self {
                numerator,
                denominator,
            })
        } else {
            Err(BadFrameRate {
                numerator,
                denominator,
            })
        }
    }

    /// The simulator time of tick `tick`: `round(tick * 1e9 * denominator / numerator)`, computed exactly.
    pub fn time_of_tick(self, tick: u32) -> SimTime {
        let numerator = i128::from(self.numerator);
        let nanos = i128::from(tick) * i128::from(NANOS_PER_SECOND) * i128::from(self.denominator);
        SimTime(((2 * nanos + numerator) / (2 * numerator)) as i64)
    }

    /// Seconds between two ticks.
    pub fn period_s(self) -> f64 {
        f64::from(self.denominator) / f64::from(self.numerator)
    }

    /// A tick's presentation timestamp in units of [`FrameRate::time_scale`]ths of seconds.
    pub fn pts_of_tick(self, tick: u32) -> i64 {
        i64::from(tick) * i64::from(self.denominator)
    }

    /// Units per second that make every tick's timestamp an integer.
    pub(crate) fn time_scale(self) -> u32 {
        self.numerator
    }
}

impl fmt::Display for FrameRate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.denominator == 1 {
            write!(f, "{}", self.numerator)
        } else {
            write!(f, "{}/{}", self.numerator, self.denominator)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_of_a_tick_is_rounded_once_and_never_accumulated() {
        let rate = FrameRate::new(30, 1).unwrap();
        assert_eq!(rate.time_of_tick(1), SimTime(33_333_333));
        assert_eq!(rate.time_of_tick(2), SimTime(66_666_667));
        assert_eq!(rate.time_of_tick(7_200), SimTime(240 * NANOS_PER_SECOND));
    }

    #[test]
    fn a_slow_rate_has_whole_timestamps_too() {
        let every_two_seconds = FrameRate::new(1, 2).unwrap();
        assert_eq!(
            every_two_seconds.time_of_tick(3),
            SimTime(6 * NANOS_PER_SECOND)
        );
        assert_eq!(every_two_seconds.pts_of_tick(3), 6);
    }

    #[test]
    fn what_no_camera_has_is_no_frame_rate() {
        for (numerator, denominator) in [
            (0, 1),
            (1, 0),
            (1, u32::MAX),
            (u32::MAX, u32::MAX),
            (241, 1),
            (1, 61),
        ] {
            let text = format!(r#"{{"numerator":{numerator},"denominator":{denominator}}}"#);
            let message = serde_json::from_str::<FrameRate>(&text)
                .unwrap_err()
                .to_string();
            let words =
                format!("{numerator}/{denominator} is not a frame rate; expected 1/60 to 240");
            assert!(message.contains(&words), "{message}");
        }
        for (numerator, denominator) in [(30_000, 1_001), (1, 60), (240, 1), (1, 2)] {
            FrameRate::new(numerator, denominator).unwrap();
        }
    }
}
