//! Measurements and misfits at a tick.

use super::row_misfit::row_misfits;
use super::{InverseRange, Measurement};
use crate::samples::Observation;
use crate::samples::view_shift::MIN_SD_PX;

/// Measurements at a tick, the most precise first.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Tick {
    pub(super) time_s: f64,
    pub(crate) measurements: Vec<Measurement>,
    /// Pairs of registered views, and the misfits of their rows in standard deviations.
    pub(super) rows: Vec<([usize; 2], f64)>,
}

impl Tick {
    pub(crate) fn of(fits: &InverseRange, observed: &Observation) -> Self {
        Self {
            time_s: observed.time_s(),
            measurements: fits.measurements(observed),
            rows: row_misfits(&fits.rows, observed),
        }
    }

    pub(crate) fn best(&self) -> Option<&Measurement> {
        let best = self.measurements.first()?;
        best.distance_m.is_finite().then_some(best)
    }

    /// Further measurements from single views.
    pub(super) fn others(&self) -> impl Iterator<Item = &Measurement> {
        let others = self.measurements.iter().skip(1);
        others.filter(|measurement| measurement.of_one_view)
    }

    /// Root mean square of the row misfits, pixels, normalised to the best precision: less certain rows may be off by more. `None` without
    /// registered views.
    pub(super) fn row_misfit_px(&self) -> Option<f64> {
        let squares: f64 = self.rows.iter().map(|(_, row)| row * row).sum();
        let mean = squares / self.rows.len() as f64;
        (!self.rows.is_empty()).then(|| MIN_SD_PX * mean.sqrt())
    }
}
