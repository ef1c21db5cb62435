//! The formulas fitted to all flights, and again without each part of them: the errors on flights that a fit has not seen predict its
//! errors on new ones.

use dataset::corpus::splits::Side;

use super::InverseRange;
use crate::samples::sides::flight_parts::FlightParts;
use crate::samples::{Sample, Samples};

/// The same fits of different flights.
pub(crate) struct CrossFitted {
    /// Of all.
    pub(crate) all: InverseRange,
    /// For each part, of the flights outside of it; `None` if these are too few.
    pub(crate) others: Vec<Option<InverseRange>>,
    /// The flights.
    pub(crate) parts: FlightParts,
}

impl CrossFitted {
    /// Fits to these ticks of the training side.
    pub(crate) fn fit(samples: &Samples, training: &[&Sample]) -> Self {
        let all = InverseRange::fit(samples.views.len(), training);
        let parts = FlightParts::of(samples, samples.ticks_of_side(Side::Train));
        let others = parts.others(training);
        Self {
            others: others.map(|others| Some(all.refitted(&others))).collect(),
            all,
            parts,
        }
    }
}
