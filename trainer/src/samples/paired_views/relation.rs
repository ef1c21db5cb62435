//! What one aircraft looks like in two views: the relation between its boxes, learned from boxes that contain it.
//!
//! Cameras beside one runway see a far aircraft in nearly the same row (the epipolar constraint, which is nearly linear for small fields of
//! view), in nearly the same size, and by so many columns apart as it is near: the parallax is proportional to the size. Three residuals
//! follow, each with a robust standard deviation. No calibration is used.

use dataset::numbers::spread::{deviation_from_zero, median};
use dataset::tables::pixel_box::PixelBox;
use serde::{Deserialize, Serialize};

use super::aside::{Columns, Pair};
use super::robust_line::{dot, robust_line};

/// Pairs of boxes below which nothing is learned.
pub(super) const MIN_PAIRS: usize = 30;
/// Units of the coordinates and of the widths in the fit, pixels.
const UNIT_PX: f64 = 1_000.0;
const WIDTH_UNIT_PX: f64 = 100.0;
/// Residuals of more standard deviations are none of one aircraft that comes into sight ...
const MAX_TO_BEGIN: f64 = 6.0;
/// ... and of one that both views have been following: a cloud may hide parts of it.
const MAX_TO_GO_ON: f64 = 9.0;
/// Smallest standard deviations: flights beside the paths of the training and aircraft of another size differ by more than its boxes. Of
/// rows, pixels ...
const MIN_ROW_SD_PX: f64 = 0.7;
/// ... and of the logarithms of sizes: aircraft of half and double the training's size, or hidden in
/// part by a cloud in both views, are within six of them ...
const MIN_PARALLAX_SD: f64 = 0.12;
/// ... and so are sizes in two views of which one is 1.8 of the other.
const MIN_SIZE_SD: f64 = 0.1;
/// Rows of large boxes are less certain: by this part of the height.
const ROW_PART_OF_HEIGHT: f64 = 0.05;

/// The relation between two views.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Relation {
    /// Indices of the views, the smaller one first.
    pub(super) views: [usize; 2],
    /// Row in the second view minus row in the first, pixels: constant, and change per pixel of row and column in the first view and of
    /// column in the second.
    row: [f64; 4],
    /// Standard deviation of that difference for small boxes, pixels.
    row_sd_px: f64,
    /// Logarithm of the width in the second view over that in the first, and its standard deviation.
    size: [f64; 2],
    /// Column in the second view minus column in the first: constant, pixels, and change per pixel of width.
    parallax: [f64; 2],
    /// Standard deviation of the logarithm of the width that follows from the columns; `None` if the columns do not depend on it.
    parallax_sd: Option<f64>,
    /// Least and greatest column in each view at which the other one saw the aircraft as well, pixels. `None` in runs of earlier versions.
    #[serde(default)]
    pub(super) common_px: Option<[[f64; 2]; 2]>,
    /// Columns on the paths of the training. `None` of few flights, and in runs of earlier versions.
    #[serde(default)]
    pub(super) columns: Option<Columns>,
}

/// Mean of the widths in two views: the geometric one, as sizes are compared by their logarithms.
pub(super) fn width_px(pair: [&PixelBox; 2]) -> f64 {
    (pair[0].width_px * pair[1].width_px).sqrt()
}

fn row_terms([first, second]: [&PixelBox; 2]) -> [f64; 4] {
    let [y, x, other_x] = [first.cy_px, first.cx_px, second.cx_px].map(|px| px / UNIT_PX);
    [1.0, y, x, other_x]
}

impl Relation {
    /// Fits the relation to pairs of boxes of one aircraft, flight by flight, robustly; `None` of too few.
    pub(super) fn fit(views: [usize; 2], flights: &[Vec<Pair>]) -> Option<Self> {
        let pairs: Vec<_> = flights.iter().flatten().map(|pair| pair.boxes).collect();
        if pairs.len() < MIN_PAIRS {
            return None;
        }
        let rows: Vec<_> = (pairs.iter())
            .map(|&pair| {
                let scale = row_scale(pair);
                (row_terms(pair), pair[1].cy_px - pair[0].cy_px, scale)
            })
            .collect();
        let (mut row, row_sd_px) = robust_line(&rows)?;
        row[1..].iter_mut().for_each(|slope| *slope /= UNIT_PX);

        let ratio = |pair: &[&PixelBox; 2]| (pair[1].width_px / pair[0].width_px).ln();
        let mut ratios: Vec<f64> = pairs.iter().map(ratio).collect();
        let size = median(&mut ratios);
        let size_sd = deviation_from_zero(ratios.iter().map(|ratio| ratio - size));

        let columns: Vec<_> = (pairs.iter())
            .map(|&pair| {
                let width_px = width_px(pair);
                let apart_px = pair[1].cx_px - pair[0].cx_px;
                ([1.0, width_px / WIDTH_UNIT_PX], apart_px, width_px)
            })
            .collect();
        let ([apart_px, slope], sd) = robust_line(&columns)?;
        let slope = slope / WIDTH_UNIT_PX;
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
            // A slope of one column per pixel of width comes from the shape of the aircraft, not from the distance of the cameras.
            parallax_sd: (slope.abs() > 1.0).then(|| (sd / slope.abs()).max(MIN_PARALLAX_SD)),
            common_px: Some([ends(0), ends(1)]),
            columns: Columns::fit(flights),
        })
    }

    /// Residuals of row, size and parallax in standard deviations, of the boxes in both views. The last is not finite where the parallax is
    /// of no distance.
    pub(super) fn residuals(&self, pair: [&PixelBox; 2]) -> [f64; 3] {
        let [first, second] = pair;
        let [constant, of_y, of_x, of_other_x] = self.row;
        let terms = [1.0, first.cy_px, first.cx_px, second.cx_px];
        let expected = dot(&[constant, of_y, of_x, of_other_x], &terms);
        let row = (second.cy_px - first.cy_px - expected) / (self.row_sd_px * row_scale(pair));
        let [usual, size_sd] = self.size;
        let size = ((second.width_px / first.width_px).ln() - usual) / size_sd;
        let [apart_px, slope] = self.parallax;
        let parallax = self.parallax_sd.map(|sd| {
            let by_columns_px = (second.cx_px - first.cx_px - apart_px) / slope;
            (by_columns_px / width_px(pair)).max(0.0).ln() / sd
        });
        [row, size, parallax.unwrap_or(0.0)]
    }

    /// Half of the sum of the squared residuals, small for one aircraft; `None` if the boxes are not of one that comes into sight.
    pub(super) fn misfit(&self, pair: [&PixelBox; 2]) -> Option<f64> {
        let residuals = self.residuals(pair);
        let is_one = residuals.iter().all(|r| r.abs() <= MAX_TO_BEGIN);
        is_one.then(|| residuals.iter().map(|r| r * r).sum::<f64>() / 2.0)
    }

    /// True if two boxes cannot be of one aircraft that has been in sight.
    pub(super) fn contradicts(&self, pair: [&PixelBox; 2]) -> bool {
        // Not a number is not within.
        let is_one = |residual: f64| residual.abs() <= MAX_TO_GO_ON;
        !self.residuals(pair).into_iter().all(is_one)
    }

    /// True if each box is where the training's were while the other view saw the aircraft as well.
    pub(super) fn was_common(&self, pair: [&PixelBox; 2]) -> bool {
        let common_px = self.common_px.iter().flatten();
        common_px
            .zip(pair)
            .all(|([least, most], seen)| (*least..=*most).contains(&seen.cx_px))
    }

    /// The view that should see an aircraft as well which another view sees here.
    pub(super) fn also_sees(&self, view: usize, seen: &PixelBox) -> Option<usize> {
        let at = self.views.iter().position(|of| *of == view)?;
        let [least, most] = self.common_px?[at];
        (least..=most)
            .contains(&seen.cx_px)
            .then(|| self.views[1 - at])
    }

    /// All of its numbers.
    pub(super) fn constants(&self) -> impl Iterator<Item = f64> {
        let numbers = [self.row_sd_px].into_iter().chain(self.parallax_sd);
        numbers
            .chain(self.row)
            .chain(self.size)
            .chain(self.parallax)
            .chain(self.common_px.into_iter().flatten().flatten())
            .chain(self.columns.iter().flat_map(Columns::constants))
    }

    /// True if all standard deviations are positive.
    pub(super) fn is_possible(&self) -> bool {
        let deviations = [self.row_sd_px, self.size[1]].into_iter();
        deviations.chain(self.parallax_sd).all(|sd| sd > 0.0)
            && self.columns.as_ref().is_none_or(Columns::is_possible)
    }
}

/// Uncertainty of the rows of two boxes, relative to small ones.
fn row_scale(pair: [&PixelBox; 2]) -> f64 {
    1.0 + ROW_PART_OF_HEIGHT * pair[0].height_px.max(pair[1].height_px)
}
