//! Cross-fitting: formulas fitted to all flights, and again without each part: errors on unseen flights predict errors on new ones.

use dataset::corpus::splits::Side;

use super::{Fit, InverseRange};
use crate::samples::sides::flight_parts::FlightParts;
use crate::samples::{Sample, Samples};

/// The same fits from different flights.
pub(crate) struct CrossFitted {
    /// Fits to all flights.
    pub(crate) all: InverseRange,
    /// Fits without each part; `None` if the rest is too small.
    pub(crate) others: Vec<Option<InverseRange>>,
    pub(crate) parts: FlightParts,
}

impl CrossFitted {
    /// Fits to these ticks on the training side.
    pub(crate) fn fit(samples: &Samples, training: &[&Sample]) -> Self {
        let mut all = InverseRange::fit(samples.views.len(), training);
        let parts = FlightParts::of(samples, samples.ticks_of_side(Side::Train));
        let others = parts.others(training);
        let others: Vec<_> = others.map(|others| Some(all.refitted(&others))).collect();
        let flights = training.chunk_by(|a, b| a.scenario == b.scenario);
        let held_out = flights.filter_map(|flight| {
            let part = (0..others.len()).find(|part| parts.contains(*part, flight[0]))?;
            Some((others[part].as_ref()?.rows.as_slice(), flight))
        });
        let held_out: Vec<_> = held_out.collect();
        all.rows.iter_mut().for_each(|of| of.learn_lags(&held_out));
        Self { all, others, parts }
    }
}

impl InverseRange {
    /// Cross-fitting for a new camera: the fits that contain its view are repeated with `approaches`, in the same order, and again without
    /// each part; `None` if one of the fits has too few ticks.
    pub(crate) fn for_new_camera(
        &self,
        view: usize,
        parts: FlightParts,
        approaches: &[&Sample],
    ) -> Option<CrossFitted> {
        let all = self.with_view_refitted(view, approaches)?;
        let others = parts.others(approaches);
        let others = others.map(|others| self.with_view_refitted(view, &others));
        Some(CrossFitted {
            all,
            others: others.collect(),
            parts,
        })
    }

    fn with_view_refitted(&self, view: usize, approaches: &[&Sample]) -> Option<Self> {
        let refitted = |fit: &Fit| {
            if fit.set.views.contains(&view) {
                Fit::of(fit.set.clone(), approaches)
            } else {
                Some(fit.clone())
            }
        };
        let fits = self.fits.iter().map(refitted).collect::<Option<_>>()?;
        Some(Self {
            fits,
            rows: self.rows_without(view),
        })
    }
}
