//! Uncertainty beyond the filter's covariance.
//!
//! **Misfits**: where rows of the views fit each other badly, distances are less certain
//! ([`crate::estimators::inverse_range::row_misfit`]).
//!
//! **Common errors**, such as a lag error or a turned camera, affect a whole flight. Averaging over ticks does not reduce them, and they
//! cause no contradictions between measurements from the same views. So they do not affect the weights of measurements; they widen the
//! final estimate. A tick that happens to be free from such an error, because a view is missing, does not undo the effect of others on the
//! state.

use dataset::numbers::spread::median;

use super::forward::MEMORY_S;
use crate::estimators::inverse_range::{Tick, scale_m};

/// Maximum tick weight, seconds.
const MAX_OF_TICK_S: f64 = 2.0;
/// Maximum misfit relative to the usual one: larger ones are outliers, which the filter treats.
const MAX_RATIO: f64 = 6.0;

/// Ticks that an estimate may use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Knowing {
    /// The current tick and earlier ones, as in live operation.
    Past,
    /// The whole flight.
    All,
}

/// Recent misfits.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct RecentMisfit {
    last_s: Option<f64>,
    square_s: f64,
    seconds: f64,
}

impl RecentMisfit {
    /// Takes the next tick, in either temporal direction.
    fn take(&mut self, usual_px: f64, tick: &Tick) {
        let since_s = self.last_s.map(|last_s| (tick.time_s - last_s).abs());
        self.last_s = Some(tick.time_s);
        let kept = (-since_s.unwrap_or(0.0) / MEMORY_S).exp();
        self.square_s *= kept;
        self.seconds *= kept;
        if let Some(misfit_px) = tick.row_misfit_px() {
            let seconds = since_s.unwrap_or(MAX_OF_TICK_S).min(MAX_OF_TICK_S);
            let ratio = (misfit_px / usual_px).min(MAX_RATIO);
            self.square_s += seconds * ratio * ratio;
            self.seconds += seconds;
        }
    }

    /// Factor for the standard deviation after a tick.
    pub(super) fn scale_after(&mut self, usual_px: Option<f64>, tick: &Tick) -> f64 {
        let Some(usual_px) = usual_px else { return 1.0 };
        self.take(usual_px, tick);
        scale(self.square_s, self.seconds)
    }
}

/// The variance grows with the misfit. The usual misfit counts as [`MEMORY_S`] seconds.
fn scale(square_s: f64, seconds: f64) -> f64 {
    ((square_s + MEMORY_S) / (seconds + MEMORY_S)).powf(0.25)
}

/// Factor that remains beyond the filter's own: at a level above 0 it has already found larger new errors. The factor is proportional to
/// the square root of the misfit, so the level counts half.
pub(super) fn beyond(scale: f64, level: f64) -> f64 {
    let known = (level / 2.0).exp2();
    scale.min((scale / known).max(1.0))
}

/// Factors for the standard deviations, tick by tick.
pub(super) fn scales(usual_px: Option<f64>, ticks: &[Tick], knowing: Knowing) -> Vec<f64> {
    let mut past = RecentMisfit::default();
    let causal: Vec<(f64, RecentMisfit)> = (ticks.iter())
        .map(|tick| (past.scale_after(usual_px, tick), past))
        .collect();
    let (Knowing::All, Some(usual_px)) = (knowing, usual_px) else {
        return causal.into_iter().map(|(scale, _)| scale).collect();
    };
    let mut future = RecentMisfit::default();
    let mut scales: Vec<f64> = (ticks.iter().zip(&causal).rev())
        .map(|(tick, (_, past))| {
            let sums = (
                past.square_s + future.square_s,
                past.seconds + future.seconds,
            );
            future.take(usual_px, tick);
            scale(sums.0, sums.1)
        })
        .collect();
    scales.reverse();
    scales
}

/// Usual misfit, root mean square, pixels; `None` without any flight.
pub(super) fn usual_px<'a>(flights: impl Iterator<Item = &'a [Tick]>) -> Option<f64> {
    let of_flight = |ticks: &[Tick]| {
        let misfits = ticks.iter().filter_map(Tick::row_misfit_px);
        let mut misfits: Vec<f64> = misfits.collect();
        if misfits.is_empty() {
            return None;
        }
        let largest = MAX_RATIO * median(&mut misfits);
        let squares = misfits.iter().map(|px| px.min(largest).powi(2));
        Some(squares.sum::<f64>() / misfits.len() as f64)
    };
    let squares: Vec<f64> = flights.filter_map(of_flight).collect();
    let mean = squares.iter().sum::<f64>() / squares.len() as f64;
    // NaN without any flight.
    (mean > 0.0).then(|| mean.sqrt())
}

/// The largest recent common error, fading.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct LastCommonError {
    last_s: Option<f64>,
    /// Standard deviation of the inverse range, 1/m: cameras are off by an angle, at any distance.
    sd_per_m: f64,
}

impl LastCommonError {
    /// Standard deviation after the next tick, in either temporal direction, 1/m.
    pub(super) fn after(&mut self, tick: &Tick) -> f64 {
        let since_s = self
            .last_s
            .map_or(0.0, |last_s| (tick.time_s - last_s).abs());
        self.last_s = Some(tick.time_s);
        self.sd_per_m *= (-since_s / MEMORY_S).exp();
        if let Some(best) = tick.best() {
            let sd_per_m = best.common_sd_m / scale_m(best.distance_m).powi(2);
            self.sd_per_m = self.sd_per_m.max(sd_per_m);
        }
        self.sd_per_m
    }
}

/// Standard deviations from past ticks, tick by tick, 1/m.
pub(super) fn by_past(ticks: &[Tick]) -> Vec<f64> {
    let mut past = LastCommonError::default();
    ticks.iter().map(|tick| past.after(tick)).collect()
}

/// Standard deviations from all ticks, 1/m.
pub(super) fn by_all(ticks: &[Tick]) -> Vec<f64> {
    let mut sds = by_past(ticks);
    let mut future = LastCommonError::default();
    for (sd_per_m, tick) in sds.iter_mut().zip(ticks).rev() {
        *sd_per_m = sd_per_m.max(future.after(tick));
    }
    sds
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimators::inverse_range::flight_filter::tests::rows_off;

    fn flight(misfit_px: impl Fn(u32) -> Option<f64>) -> Vec<Tick> {
        let tick = |tick: u32| Tick {
            time_s: f64::from(tick),
            measurements: Vec::new(),
            rows: rows_off(misfit_px(tick)),
        };
        (0..200).map(tick).collect()
    }

    #[test]
    fn errors_grow_with_the_misfit_of_the_last_ticks_and_of_the_next_ones_if_these_are_known() {
        let step = flight(|tick| Some(if tick < 100 { 0.05 } else { 0.2 }));
        let usual = Some(0.05);
        let past = scales(usual, &step, Knowing::Past);
        let all = scales(usual, &step, Knowing::All);
        assert!(past[..100].iter().all(|scale| (scale - 1.0).abs() < 1e-9));
        assert!(all[98] > 1.2 && past[105] > 1.2);
        assert!(past[199] > 1.6 && past[199] < 2.0, "{}", past[199]);
        let silent = flight(|tick| (tick < 100).then_some(0.2));
        let forgotten = scales(usual, &silent, Knowing::Past);
        assert!(forgotten[99] > 1.6 && forgotten[199] < 1.05);
        assert_eq!(scales(None, &step, Knowing::All), vec![1.0; 200]);
    }

    #[test]
    fn a_factor_does_not_count_again_what_the_filter_found_by_itself() {
        assert_eq!(beyond(2.0, 0.0), 2.0);
        assert!((beyond(2.0, 1.0) - 2.0_f64.sqrt()).abs() < 1e-9);
        assert_eq!(beyond(2.0, 3.0), 1.0);
        for level in [0.0, 0.5, 3.0] {
            assert_eq!(beyond(0.9, level), 0.9);
        }
    }

    #[test]
    fn the_usual_misfit_is_of_flights_alike_and_not_of_an_outlier() {
        let one = flight(|tick| Some(if tick == 3 { 90.0 } else { 0.1 }));
        let other = flight(|_| Some(0.1));
        let usual_px = usual_px([one.as_slice(), &other].into_iter()).unwrap();
        assert!((usual_px - 0.1).abs() < 0.01, "{usual_px}");
        assert_eq!(super::usual_px([[].as_slice()].into_iter()), None);
    }
}
