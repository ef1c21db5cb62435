//! Offset and drift of a clock, refined with every arrival.
//!
//! A straight line through lags over time, by least squares; each arrival adds one ([`Lag`]). The prior expects the small drift of
//! usual clocks.

use dataset::numbers::least_squares::NormalEquations;
use serde::{Deserialize, Serialize};

use crate::clock::SENDERS_SD_S;

/// Prior standard deviation of a recording's drift, and of a stream, whose clock follows arrival times.
pub(crate) const RECORDING_DRIFT_SD: f64 = 100e-6;
pub(crate) const STREAM_DRIFT_SD: f64 = 2e-6;
/// Standard deviation of the change between two starts, s: images then take different ways.
const RESTART_SD_S: f64 = 0.015;

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Offset {
    /// Added to the view's times, s.
    pub(crate) offset_s: f64,
    pub(crate) sd_s: f64,
    /// Growth of the offset, s per million s.
    pub(crate) drift_ppm: f64,
    pub(crate) drift_sd_ppm: f64,
}

impl Offset {
    /// The expected offset between two clocks that their senders set.
    pub(crate) fn of_senders() -> Self {
        Self {
            offset_s: 0.0,
            sd_s: SENDERS_SD_S,
            drift_ppm: 0.0,
            drift_sd_ppm: STREAM_DRIFT_SD * 1e6,
        }
    }

    /// The first view's offset from the other one.
    pub(crate) fn back(self) -> Self {
        Self {
            offset_s: -self.offset_s,
            drift_ppm: -self.drift_ppm,
            ..self
        }
    }

    /// True if a measurement can have given its numbers.
    pub(crate) fn is_sound(&self) -> bool {
        let sds = [self.sd_s, self.drift_sd_ppm];
        let mut numbers = [self.offset_s, self.drift_ppm].into_iter().chain(sds);
        numbers.all(|number| number.is_finite()) && sds.iter().all(|sd| *sd > 0.0)
    }
}

/// An arrival's lag, and the time for which it is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Lag {
    pub(crate) at_s: f64,
    pub(crate) seconds: f64,
    pub(crate) sd_s: f64,
}

/// Estimated offset and drift.
#[derive(Debug, Clone)]
pub(crate) struct ClockOffset {
    zero_s: Option<f64>,
    /// Offset at that time, and its growth per second.
    line: NormalEquations,
}

impl ClockOffset {
    /// Prior: the stored offset, else only the expected drift.
    pub(crate) fn of(kept: Option<Offset>, drift_sd: f64) -> Self {
        let mut line = NormalEquations::new(2);
        if let Some(kept) = kept {
            let sd_s = kept.sd_s.hypot(RESTART_SD_S);
            line.add(&[1.0, 0.0], kept.offset_s, sd_s.powi(-2));
        }
        let (drift, drift_sd) = match kept {
            Some(kept) => (kept.drift_ppm * 1e-6, kept.drift_sd_ppm * 1e-6),
            None => (0.0, drift_sd),
        };
        line.add(&[0.0, 1.0], drift, drift_sd.powi(-2));
        Self { zero_s: None, line }
    }

    pub(crate) fn since(mut self, time_s: f64) -> Self {
        self.zero_s = Some(time_s);
        self
    }

    /// Adds an arrival's lag.
    pub(crate) fn with(mut self, lag: Lag) -> Self {
        let since_s = lag.at_s - *self.zero_s.get_or_insert(lag.at_s);
        self.line
            .add(&[1.0, since_s], lag.seconds, lag.sd_s.powi(-2));
        self
    }

    /// The offset at a time; `None` if nothing was measured yet.
    pub(crate) fn at(&self, time_s: f64) -> Option<Offset> {
        let since_s = time_s - self.zero_s.unwrap_or(time_s);
        let [at_zero_s, drift] = self.line.solve_for()?;
        let [[own, shared], [_, of_drift]] = self.line.inverse_for()?;
        let variance = own + 2.0 * since_s * shared + since_s * since_s * of_drift;
        Some(Offset {
            offset_s: at_zero_s + drift * since_s,
            sd_s: variance.max(0.0).sqrt(),
            drift_ppm: drift * 1e6,
            drift_sd_ppm: of_drift.sqrt() * 1e6,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lag(at_s: f64, seconds: f64) -> Lag {
        Lag {
            at_s,
            seconds,
            sd_s: 0.007,
        }
    }

    #[test]
    fn several_arrivals_tell_the_drift_too() {
        let clock = ClockOffset::of(None, RECORDING_DRIFT_SD);
        assert!(clock.at(100.0).is_none());
        let first = clock.clone().with(lag(100.0, 0.514)).at(100.0).unwrap();
        assert!((first.offset_s - 0.514).abs() < 1e-9 && first.drift_ppm == 0.0);
        assert!((first.sd_s - 0.007).abs() < 1e-9);
        let later = clock.clone().with(lag(100.0, 0.514)).at(1_100.0).unwrap();
        assert!(later.sd_s > 0.09, "its drift is unknown: {later:?}");
        let four = [0.004, -0.006, 0.003, -0.002].into_iter().zip(0..);
        let four = four.fold(clock, |clock, (error_s, number)| {
            let time_s = 100.0 + 300.0 * f64::from(number);
            clock.with(lag(time_s, 0.5 + 100e-6 * time_s + error_s))
        });
        let found = four.at(1_100.0).unwrap();
        assert!((found.offset_s - 0.61).abs() < 0.01, "{found:?}");
        assert!((found.drift_ppm - 100.0).abs() < 20.0, "{found:?}");
        assert!(found.sd_s < 0.008 && found.drift_sd_ppm < 15.0, "{found:?}");
    }

    #[test]
    fn what_was_kept_is_known_at_the_next_start_but_less_well() {
        let kept = Offset {
            offset_s: 0.5,
            sd_s: 0.004,
            drift_ppm: 80.0,
            drift_sd_ppm: 10.0,
        };
        assert!(kept.is_sound() && !Offset { sd_s: 0.0, ..kept }.is_sound());
        let clock = ClockOffset::of(Some(kept), RECORDING_DRIFT_SD);
        let at_start = clock.at(7.0).unwrap();
        assert!((at_start.offset_s - 0.5).abs() < 1e-9);
        assert!(at_start.sd_s > kept.sd_s && at_start.sd_s < 0.02);
        assert!((at_start.drift_ppm - 80.0).abs() < 1e-6);
        // An arrival counts for more.
        let found = clock.with(lag(60.0, 0.53)).at(60.0).unwrap();
        assert!((0.52..0.53).contains(&found.offset_s), "{found:?}");
    }
}
