//! Measured image positions: box centres, and registered shifts between them.
//!
//! A shift is several times more precise than two boxes, and its error is independent of theirs, so both count, weighted by their standard
//! deviations.

use dataset::numbers::spread::deviation_from_zero;
use glam::DVec2;
use serde::{Deserialize, Serialize};

use crate::samples::Observation;
use crate::samples::trusted_boxes::centre_and_size;
use crate::samples::view_shift::MIN_SD_PX;

/// Minimum standard deviation, pixels or a ratio, which keeps the weights of exact measurements finite.
const MIN_DEVIATION: f64 = 1e-3;

/// A position in a view, or a difference between two views, pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Measured {
    pub(super) view: usize,
    /// View whose position is subtracted.
    pub(super) reference: Option<usize>,
    /// Right and down, pixels.
    px: DVec2,
    /// Standard deviations relative to other measurements of this kind.
    spread: DVec2,
}

/// Standard deviations of both kinds of measurements.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Deviations {
    /// Box centre, right and down, pixels.
    pub box_px: [f64; 2],
    /// Shift, right and down, relative to its stated standard deviation.
    pub shift_ratio: [f64; 2],
}

impl Measured {
    /// Measurements at a tick in the used views.
    pub(super) fn in_tick(observed: &Observation, is_used: impl Fn(usize) -> bool) -> Vec<Self> {
        let used = || (0..observed.views()).filter(|&view| is_used(view));
        let centres = used().filter_map(|view| {
            let (px, _) = centre_and_size(observed.best(view)?);
            Some(Self {
                view,
                reference: None,
                px,
                spread: DVec2::ONE,
            })
        });
        let shifts = used().filter_map(|view| {
            let shift = observed
                .shift(view)
                .filter(|shift| is_used(shift.reference))?;
            let variance = shift.sd_px * shift.sd_px + DVec2::splat(MIN_SD_PX.powi(2));
            Some(Self {
                view,
                reference: Some(shift.reference),
                px: shift.shift_px,
                spread: DVec2::new(variance.x.sqrt(), variance.y.sqrt()),
            })
        });
        centres.chain(shifts).collect()
    }

    /// Predicted minus measured position, in units of `spread`; `None` if a camera cannot see the point.
    pub(super) fn residual(&self, places_px: &[Option<DVec2>]) -> Option<DVec2> {
        let place = places_px[self.view]?;
        let from = match self.reference {
            None => DVec2::ZERO,
            Some(reference) => places_px[reference]?,
        };
        Some((place - from - self.px) / self.spread)
    }

    /// Derivative of the residual from the derivatives of the positions.
    pub(super) fn slope(&self, in_view: impl Fn(usize) -> DVec2) -> DVec2 {
        let from = self.reference.map_or(DVec2::ZERO, &in_view);
        (in_view(self.view) - from) / self.spread
    }

    /// Standard deviation of the residual, right and down.
    pub(super) fn deviation(&self, deviations: &Deviations) -> [f64; 2] {
        match self.reference {
            None => deviations.box_px,
            Some(_) => deviations.shift_ratio,
        }
    }
}

impl Deviations {
    /// Robust deviations of residuals.
    pub(super) fn of(residuals: &[(Measured, DVec2)]) -> Self {
        let of_kind = |is_shift: bool| {
            [0, 1].map(|axis| {
                let kind = residuals
                    .iter()
                    .filter(|(measured, _)| measured.reference.is_some() == is_shift);
                deviation_from_zero(kind.map(|(_, residual)| residual[axis])).max(MIN_DEVIATION)
            })
        };
        Self {
            box_px: of_kind(false),
            shift_ratio: of_kind(true),
        }
    }
}
