//! Measurements of the aircraft's position at a tick: the centres of its boxes, and the registered shifts between them.
//!
//! A shift is several times more precise than two boxes, and its error is independent of theirs, so both count, weighted by their standard
//! deviations.

use dataset::numbers::spread::deviation_from_zero;
use glam::DVec2;
use serde::{Deserialize, Serialize};

use crate::samples::Observation;
use crate::samples::trusted_boxes::centre_and_size;

/// Error of shifts that their stated standard deviation leaves out, pixels: perspective, and lights seen from two sides.
const FLOOR_SD_PX: f64 = 0.05;
/// Lower limit of standard deviations, which keeps the weights of exact measurements finite. Pixels, and a ratio.
const MIN_DEVIATION: f64 = 1e-3;

/// A place in a view, or a difference between two views, pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Measured {
    /// The view.
    pub(super) view: usize,
    /// The view whose place is subtracted.
    pub(super) reference: Option<usize>,
    /// Right and down, pixels.
    px: DVec2,
    /// Standard deviations relative to other measurements of the kind.
    spread: DVec2,
}

/// Standard deviations of the two kinds of measurements.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Deviations {
    /// Of the centre of a box, right and down, pixels.
    pub box_px: [f64; 2],
    /// Of a shift, right and down, in parts of what its table states.
    pub shift_ratio: [f64; 2],
}

impl Measured {
    /// Measurements of a tick, in views that are used.
    pub(super) fn in_tick(observed: &Observation, is_used: impl Fn(usize) -> bool) -> Vec<Self> {
        let used = || (0..observed.boxes.len()).filter(|&view| is_used(view));
        let centres = used().filter_map(|view| {
            let (px, _) = centre_and_size(observed.boxes[view].as_ref()?);
            Some(Self {
                view,
                reference: None,
                px,
                spread: DVec2::ONE,
            })
        });
        let shifts = used().filter_map(|view| {
            let shift = observed.shifts[view].filter(|shift| is_used(shift.reference))?;
            let variance = shift.sd_px * shift.sd_px + DVec2::splat(FLOOR_SD_PX.powi(2));
            Some(Self {
                view,
                reference: Some(shift.reference),
                px: shift.shift_px,
                spread: DVec2::new(variance.x.sqrt(), variance.y.sqrt()),
            })
        });
        centres.chain(shifts).collect()
    }

    /// Predicted minus measured position, in units of `spread`; `None` if one of the views could not see the aircraft there.
    pub(super) fn residual(&self, places_px: &[Option<DVec2>]) -> Option<DVec2> {
        let place = places_px[self.view]?;
        let from = match self.reference {
            None => DVec2::ZERO,
            Some(reference) => places_px[reference]?,
        };
        Some((place - from - self.px) / self.spread)
    }

    /// Derivative of the residual, given the derivatives of the positions in the views.
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
    /// The robust deviations of residuals, each with its measurement.
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
