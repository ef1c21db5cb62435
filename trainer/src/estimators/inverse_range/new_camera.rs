//! Adaptation to a new camera: the fits that contain its view are fitted again to a few approaches.

use super::{CrossFitted, Fit, InverseRange};
use crate::samples::Sample;
use crate::samples::sides::flight_parts::FlightParts;

impl InverseRange {
    /// The same fits in the same order for a new camera, with the sets that contain its view fitted to `approaches`, and again without each
    /// part of them; `None` if these are too few for one of the sets.
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
