//! Measurements and misfits at a tick.

use super::row_misfit::row_misfits;
use super::{InverseRange, Measurement};
use crate::samples::Observation;

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
}
