//! Aircraft appearance in two views: a relation between its boxes, learned from true boxes.
//!
//! Cameras beside one runway see a distant aircraft in nearly the same row ([`RowLine`]) and in nearly the same size, and the parallax
//! between columns is proportional to the size. This gives three residuals, each with a robust standard deviation.

use dataset::numbers::spread::{deviation_from_zero, median};
use dataset::tables::pixel_box::PixelBox;
use glam::DVec2;
use serde::{Deserialize, Serialize};

use super::sighting::{MAX_DEVIATIONS, MIN_SIZE_SD};
use crate::samples::robust_line::{FINE_UNIT_PX, robust_line};
use crate::samples::row_line::RowLine;
use crate::samples::trusted_boxes::centre_and_size;

/// Minimum number of pairs.
pub(super) const MIN_PAIRS: usize = 30;
/// Maximum residual for an aircraft that both views have been following, in standard deviations: a cloud may hide parts.
const MAX_FOLLOWED_DEVIATIONS: f64 = 9.0;
/// Minimum standard deviation of rows, px: flights beside the training's paths differ by more than its boxes.
const MIN_ROW_SD_PX: f64 = 0.7;
/// Additional row uncertainty of large boxes, relative to the height.
const ROW_PART_OF_HEIGHT: f64 = 0.05;

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Relation {
    /// View indices, ascending.
    pub(super) views: [usize; 2],
    row: RowLine,
    /// Standard deviation of rows for small boxes, pixels.
    row_sd_px: f64,
    /// Logarithm of the width ratio (second to first), and its standard deviation.
    size: [f64; 2],
    /// Column in the second view minus column in the first: constant, pixels, and change per pixel in width.
    parallax: [f64; 2],
    /// Standard deviation of the logarithm of the width predicted from the columns; `None` if the columns are independent of the width.
    parallax_sd: Option<f64>,
    /// Minimum and maximum column in each view while both saw the aircraft, pixels.
    pub(super) common_px: [[f64; 2]; 2],
}

/// Geometric mean of the widths.
pub(super) fn width_px(pair: [&PixelBox; 2]) -> f64 {
    (pair[0].width_px * pair[1].width_px).sqrt()
}

fn places_px(pair: [&PixelBox; 2]) -> [DVec2; 2] {
    pair.map(|seen| centre_and_size(seen).0)
}

impl Relation {
    /// Robust fit to pairs of boxes from one aircraft; `None` with too few.
    pub(super) fn fit(views: [usize; 2], pairs: &[[&PixelBox; 2]]) -> Option<Self> {
        if pairs.len() < MIN_PAIRS {
            return None;
        }
        let rows = pairs.iter().map(|&pair| (places_px(pair), row_scale(pair)));
        let (row, row_sd_px) = RowLine::fit(rows)?;

        let ratio = |pair: &[&PixelBox; 2]| (pair[1].width_px / pair[0].width_px).ln();
        let mut ratios: Vec<f64> = pairs.iter().map(ratio).collect();
        let size = median(&mut ratios);
        let size_sd = deviation_from_zero(ratios.iter().map(|ratio| ratio - size));

        let columns: Vec<_> = (pairs.iter())
            .map(|&pair| {
                let width_px = width_px(pair);
                let apart_px = pair[1].cx_px - pair[0].cx_px;
                ([1.0, width_px / FINE_UNIT_PX], apart_px, width_px)
            })
            .collect();
        let ([apart_px, slope], sd) = robust_line(&columns)?;
        let slope = slope / FINE_UNIT_PX;
        let ends = |view: usize| {
            let columns = pairs.iter().map(|pair| pair[view].cx_px);
            columns.fold([f64::INFINITY, f64::NEG_INFINITY], |[least, most], x| {
                [least.min(x), most.max(x)]
            })
        };
        Some(Self {
            views,
            row,
            row_sd_px: row_sd_px.max(MIN_ROW_SD_PX),
            size: [size, size_sd.max(MIN_SIZE_SD)],
            parallax: [apart_px, slope],
            // A slope with one column per pixel in width reflects the aircraft's shape, not a baseline between cameras.
            parallax_sd: (slope.abs() > 1.0).then(|| (sd / slope.abs()).max(MIN_SIZE_SD)),
            common_px: [ends(0), ends(1)],
        })
    }

    /// Residuals of row, size and parallax in standard deviations. The last is not finite if the parallax has the wrong sign.
    pub(super) fn residuals(&self, pair: [&PixelBox; 2]) -> [f64; 3] {
        let [first, second] = pair;
        let row = self.row.off_px(places_px(pair)) / (self.row_sd_px * row_scale(pair));
        let [usual, size_sd] = self.size;
        let size = ((second.width_px / first.width_px).ln() - usual) / size_sd;
        let [apart_px, slope] = self.parallax;
        let parallax = self.parallax_sd.map(|sd| {
            let by_columns_px = (second.cx_px - first.cx_px - apart_px) / slope;
            (by_columns_px / width_px(pair)).max(0.0).ln() / sd
        });
        [row, size, parallax.unwrap_or(0.0)]
    }

    /// Negative log likelihood of the residuals, up to a constant; `None` if the boxes cannot show one new aircraft.
    pub(super) fn misfit(&self, pair: [&PixelBox; 2]) -> Option<f64> {
        let residuals = self.residuals(pair);
        let is_one = residuals.iter().all(|r| r.abs() <= MAX_DEVIATIONS);
        is_one.then(|| residuals.iter().map(|r| r * r).sum::<f64>() / 2.0)
    }

    /// True if two boxes cannot show one aircraft that has been in sight.
    pub(super) fn contradicts(&self, pair: [&PixelBox; 2]) -> bool {
        // NaN fails this test.
        let is_one = |residual: f64| residual.abs() <= MAX_FOLLOWED_DEVIATIONS;
        !self.residuals(pair).into_iter().all(is_one)
    }

    /// The view that should see the same aircraft.
    pub(super) fn also_sees(&self, view: usize, seen: &PixelBox) -> Option<usize> {
        let at = self.views.iter().position(|of| *of == view)?;
        let [least, most] = self.common_px[at];
        (least..=most)
            .contains(&seen.cx_px)
            .then(|| self.views[1 - at])
    }

    /// True for positive standard deviations.
    pub(super) fn is_possible(&self) -> bool {
        let deviations = [self.row_sd_px, self.size[1]].into_iter();
        deviations.chain(self.parallax_sd).all(|sd| sd > 0.0)
    }
}

/// Row uncertainty relative to small boxes.
fn row_scale(pair: [&PixelBox; 2]) -> f64 {
    1.0 + ROW_PART_OF_HEIGHT * pair[0].height_px.max(pair[1].height_px)
}
