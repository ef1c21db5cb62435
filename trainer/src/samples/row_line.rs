//! Row of an aircraft in a second view.
//!
//! Cameras beside one runway see a distant aircraft in nearly the same row: the epipolar constraint, which is nearly linear for small
//! fields of view. No calibration is used.

use dataset::numbers::least_squares::dot;
use glam::DVec2;
use serde::{Deserialize, Serialize};

use crate::samples::robust_line::{FINE_UNIT_PX, robust_line};

/// Row in the second view minus row in the first, as a linear function of the places.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct RowLine {
    /// Constant, and change per 100 px in column and row in the first view, and in the columns between the views; pixels.
    coefficients_px: [f64; 4],
}

impl RowLine {
    /// Robust fit to places in both views, each with the scale of its error. Also returns the standard deviation of the scaled residuals.
    pub(crate) fn fit(places: impl Iterator<Item = ([DVec2; 2], f64)>) -> Option<(Self, f64)> {
        let points =
            places.map(|(places, scale)| (terms(places), places[1].y - places[0].y, scale));
        let (coefficients_px, sd) = robust_line(&points.collect::<Vec<_>>())?;
        Some((Self { coefficients_px }, sd))
    }

    /// Pixels down from the expected row in the second view.
    pub(crate) fn off_px(&self, places: [DVec2; 2]) -> f64 {
        places[1].y - places[0].y - dot(&terms(places), &self.coefficients_px)
    }
}

fn terms([first, second]: [DVec2; 2]) -> [f64; 4] {
    let [x, y, apart] = [first.x, first.y, second.x - first.x].map(|px| px / FINE_UNIT_PX);
    [1.0, x, y, apart]
}
