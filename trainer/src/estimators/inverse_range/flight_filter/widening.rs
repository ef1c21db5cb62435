//! Common errors, which widen the estimate beyond the filter's covariance.
//!
//! An error such as an uncertain lag or a turned camera affects a whole flight. Averaging over ticks does not reduce it, and it causes no
//! contradictions between measurements from the same views. So it does not affect the weights of measurements; it widens the final
//! estimate. A tick that happens to be free from it, because a view is missing, does not undo the effect of others on the state.

use crate::estimators::inverse_range::{Tick, scale_m};

/// Time constant of common errors, s.
const MEMORY_S: f64 = 20.0;

/// Ticks that an estimate may use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Knowing {
    /// The current tick and earlier ones, as in live operation.
    Past,
    /// The whole flight.
    All,
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

/// Standard deviations tick by tick, 1/m.
pub(super) fn common_sds_per_m(ticks: &[Tick], knowing: Knowing) -> Vec<f64> {
    let mut past = LastCommonError::default();
    let mut sds: Vec<f64> = ticks.iter().map(|tick| past.after(tick)).collect();
    if knowing == Knowing::All {
        let mut future = LastCommonError::default();
        for (sd_per_m, tick) in sds.iter_mut().zip(ticks).rev() {
            *sd_per_m = sd_per_m.max(future.after(tick));
        }
    }
    sds
}
