//! Offset and drift of a clock, refined with every arrival.
//!
//! A straight line through lags over time, by least squares; each arrival adds its sums ([`LagLine`]). The prior expects the small drift of
//! usual clocks.

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

/// Sums for a line through lags over time: weights, weighted times and squared times, weighted lags and their products with the times.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sums {
    pub(crate) weight: f64,
    pub(crate) time: f64,
    pub(crate) time_squared: f64,
    pub(crate) lag: f64,
    pub(crate) lag_times_time: f64,
}

impl Sums {
    fn plus(self, other: Self) -> Self {
        Self {
            weight: self.weight + other.weight,
            time: self.time + other.time,
            time_squared: self.time_squared + other.time_squared,
            lag: self.lag + other.lag,
            lag_times_time: self.lag_times_time + other.lag_times_time,
        }
    }

    pub(crate) fn scaled(self, part: f64) -> Self {
        Self {
            weight: part * self.weight,
            time: part * self.time,
            time_squared: part * self.time_squared,
            lag: part * self.lag,
            lag_times_time: part * self.lag_times_time,
        }
    }

    /// Adds an error with this standard deviation that all lags share.
    pub(crate) fn with_common_error(self, sd_s: f64) -> Self {
        let lost = (sd_s.powi(-2) + self.weight).recip();
        Self {
            weight: self.weight - lost * self.weight * self.weight,
            time: self.time - lost * self.weight * self.time,
            time_squared: self.time_squared - lost * self.time * self.time,
            lag: self.lag - lost * self.weight * self.lag,
            lag_times_time: self.lag_times_time - lost * self.time * self.lag,
        }
    }

    /// Sums with all times moved by `by_s`.
    fn later(self, by_s: f64) -> Self {
        Self {
            time: self.time + by_s * self.weight,
            time_squared: self.time_squared + by_s * (2.0 * self.time + by_s * self.weight),
            lag_times_time: self.lag_times_time + by_s * self.lag,
            ..self
        }
    }
}

/// An arrival's lag, and its growth.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LagLine {
    pub(crate) zero_s: f64,
    pub(crate) sums: Sums,
}

impl LagLine {
    /// The time for which the lag is best known; `None` if it is not known at all.
    pub(crate) fn best_s(&self) -> Option<f64> {
        let since_s = self.sums.time / self.sums.weight;
        since_s.is_finite().then_some(self.zero_s + since_s)
    }
}

/// Estimated offset and drift.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ClockOffset {
    zero_s: Option<f64>,
    sums: Sums,
}

impl ClockOffset {
    /// Prior: the stored offset, else only the expected drift.
    pub(crate) fn of(kept: Option<Offset>, drift_sd: f64) -> Self {
        let (drift, drift_sd) = match kept {
            Some(kept) => (kept.drift_ppm * 1e-6, kept.drift_sd_ppm * 1e-6),
            None => (0.0, drift_sd),
        };
        let weight = kept.map_or(0.0, |kept| kept.sd_s.hypot(RESTART_SD_S).powi(-2));
        Self {
            zero_s: None,
            sums: Sums {
                weight,
                time: 0.0,
                time_squared: drift_sd.powi(-2),
                lag: kept.map_or(0.0, |kept| kept.offset_s * weight),
                lag_times_time: drift * drift_sd.powi(-2),
            },
        }
    }

    pub(crate) fn since(mut self, time_s: f64) -> Self {
        self.zero_s = Some(time_s);
        self
    }

    /// Adds an arrival's lag.
    pub(crate) fn with(mut self, line: LagLine) -> Self {
        let zero_s = *self.zero_s.get_or_insert(line.zero_s);
        self.sums = self.sums.plus(line.sums.later(line.zero_s - zero_s));
        self
    }

    /// The offset at a time; `None` if nothing was measured yet.
    pub(crate) fn at(&self, time_s: f64) -> Option<Offset> {
        let since_s = time_s - self.zero_s.unwrap_or(time_s);
        let Sums {
            weight,
            time,
            time_squared,
            lag,
            lag_times_time,
        } = self.sums;
        let determinant = weight * time_squared - time * time;
        if determinant <= 0.0 {
            return None;
        }
        let drift = (weight * lag_times_time - time * lag) / determinant;
        let at_zero_s = (time_squared * lag - time * lag_times_time) / determinant;
        let variance =
            (time_squared - 2.0 * since_s * time + since_s * since_s * weight) / determinant;
        Some(Offset {
            offset_s: at_zero_s + drift * since_s,
            sd_s: variance.max(0.0).sqrt(),
            drift_ppm: drift * 1e6,
            drift_sd_ppm: (weight / determinant).sqrt() * 1e6,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An arrival that tells a lag for one time.
    fn lag(time_s: f64, seconds: f64) -> LagLine {
        let weight = 0.007_f64.powi(-2);
        LagLine {
            zero_s: time_s,
            sums: Sums {
                weight,
                time: 0.0,
                time_squared: 0.0,
                lag: weight * seconds,
                lag_times_time: 0.0,
            },
        }
    }

    #[test]
    fn a_common_error_is_added_to_the_offset_and_leaves_the_drift() {
        let sums = Sums {
            weight: 2e4,
            time: 1e6,
            time_squared: 3e8,
            lag: 1e4,
            lag_times_time: 6e5,
        };
        let at = |sums| {
            let line = LagLine { zero_s: 70.0, sums };
            ClockOffset::of(None, RECORDING_DRIFT_SD)
                .with(line)
                .at(200.0)
                .unwrap()
        };
        let (alone, common) = (at(sums), at(sums.with_common_error(0.005)));
        assert!(
            (common.sd_s - alone.sd_s.hypot(0.005)).abs() < 1e-9,
            "{common:?}"
        );
        assert!(
            (common.offset_s - alone.offset_s).abs() < 1e-3,
            "{common:?}"
        );
        assert!((common.drift_sd_ppm - alone.drift_sd_ppm).abs() < 1e-6);
    }

    #[test]
    fn several_arrivals_tell_the_drift_too() {
        let clock = ClockOffset::of(None, RECORDING_DRIFT_SD);
        assert!(clock.at(100.0).is_none());
        let first = clock.with(lag(100.0, 0.514)).at(100.0).unwrap();
        assert!((first.offset_s - 0.514).abs() < 1e-9 && first.drift_ppm == 0.0);
        assert!((first.sd_s - 0.007).abs() < 1e-9);
        let later = clock.with(lag(100.0, 0.514)).at(1_100.0).unwrap();
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
