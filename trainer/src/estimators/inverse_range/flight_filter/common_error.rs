//! Errors that all ticks of a flight share, such as the error of a lag or of a camera's turn.
//!
//! No average over ticks makes them smaller, and measurements of the same views do not contradict each other because of them. So they do
//! not count in the weights of the measurements, and add to the uncertainty of the answer. A tick that happens to be without such an error,
//! because a view is missing, does not undo what others did to the state.

use super::forward::Tick;
use crate::estimators::inverse_range::scale_m;

/// Time after which a common error counts for a third, seconds.
const MEMORY_S: f64 = 20.0;

/// The largest common error of the last ticks, fading.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct LastCommonError {
    last_s: Option<f64>,
    /// Of the inverse range, 1/m: cameras are off by an angle, whatever the distance is.
    sd_per_m: f64,
}

impl LastCommonError {
    /// Its standard deviation after the next tick, in either direction of time, 1/m.
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

/// Standard deviations of the common errors of a flight by the ticks so far, tick by tick, 1/m.
pub(super) fn by_past(ticks: &[Tick]) -> Vec<f64> {
    let mut past = LastCommonError::default();
    ticks.iter().map(|tick| past.after(tick)).collect()
}

/// The same by all ticks.
pub(super) fn by_all(ticks: &[Tick]) -> Vec<f64> {
    let mut sds = by_past(ticks);
    let mut future = LastCommonError::default();
    for (sd_per_m, tick) in sds.iter_mut().zip(ticks).rev() {
        *sd_per_m = sd_per_m.max(future.after(tick));
    }
    sds
}
