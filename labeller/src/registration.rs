//! Measures the shift (parallax) of the aircraft between two views from the pixels of both. It is far more precise than the difference
//! between two boxes, whose errors are independent, because both views show nearly the same few pixels of aircraft.
//!
//! Input: a box with its surroundings from each view ([`Patch`]), and the expected difference between the views from the calibration
//! ([`ExpectedDifference`]). Output: a [`Shift`] with its standard deviation, or the reason why there is none. The background of each patch
//! is a quadratic fitted around the aircraft. The best whole-pixel shift near the one given by the boxes starts a Gauss-Newton iteration
//! over shift, contrast and brightness (Lucas and Kanade, "An iterative image registration technique", 1981; with brightness: Hager and
//! Belhumeur, "Efficient region tracking", 1998), in which outlier pixels count less (Cauchy's weights). Scale and rotation are not fitted:
//! views from two sides see nose, wings and fin displaced by different amounts, and any freedom to follow them makes the shift worse.
//!
//! Images whose aircraft sizes differ by more than 5 % are matched in resolution first: the finer image is blurred more, and it is
//! resampled, because interpolation degrades it less.

mod expected;
mod fit;
mod patch;

use dataset::tables::registrations::{NoShift, Shift, is_within_limits};
use glam::DVec2;

pub(crate) use expected::ExpectedDifference;
pub(crate) use patch::EDGE_PX;
pub use patch::Patch;

use fit::{Fit, fit};
use patch::{BLUR_PX, Cleaned};

/// Version of the method; registrations of other versions are repeated.
pub(crate) const METHOD: u32 = 3;

/// A view that shows the aircraft smaller than the other by more than this factor has coarser pixels. Views from two sides differ by some
/// percent even with equal cameras, which makes no difference.
const COARSER: f64 = 0.95;
/// Standard deviation of lamps and edges in any image, px, however coarse: lens, sampling and compression. With this value, a zoomed camera
/// has the least error in leave-one-out tests on the approaches of docs/results.md.
const SPOT_PX: f64 = 1.4;
/// An image that shows the aircraft larger by more than this factor is blurred no more: a patch ends 26 px beyond its box.
const MAX_MATCHED: f64 = 3.0;
/// Pixels around the larger box that are compared.
const MARGIN_PX: f64 = 4.0;
/// Search radius around the boxes' centres: a minimum in pixels, plus a part of the aircraft's width.
const SEARCH_PX: f64 = 6.0;
const SEARCH_PART: f64 = 0.1;
/// Least correlation. Of 1,340 pairs of the demo's corpus none that shows the aircraft in both views is below 0.65.
const MIN_CORRELATION: f64 = 0.6;
/// Minimum ratio of the aircraft's extreme pixel to the noise. The extreme of a few hundred noise pixels is about 3.
const MIN_CONTRAST: f64 = 4.0;
/// Range of the ratio of contrasts; beyond it, one of the images does not show the aircraft, or as a negative.
const GAINS: std::ops::RangeInclusive<f64> = 0.1..=10.0;
/// A shift with a larger standard deviation says less than the boxes.
const MAX_SD_PX: f64 = 0.7;
/// Error that remains in ideal images: interpolation and compression.
const FLOOR_SD_PX: f64 = 0.025;
/// The scatter of the residuals underestimates the error by this factor.
const SD_FACTOR: f64 = 1.4;
/// Standard deviation of an airliner's visible depth, m: light and shade change which parts the shift follows.
const DEPTH_SD_M: f64 = 0.5;

/// Measures where the aircraft of the reference patch is in the other.
pub(crate) fn register(
    reference: &Patch,
    view: &Patch,
    expected: &ExpectedDifference,
) -> Result<Shift, NoShift> {
    let view_from_reference = expected.view_from_reference;
    let magnification = view_from_reference.determinant().abs().sqrt();
    let is_coarser = magnification < COARSER;
    let bin = reference.bin().max(view.bin());
    let blur_px = |larger: f64| {
        if larger * COARSER > 1.0 {
            blur_of_finer_px(larger.min(MAX_MATCHED), SPOT_PX / bin as f64)
        } else {
            BLUR_PX
        }
    };
    let reference = Cleaned::of(&reference.binned(bin), blur_px(magnification.recip()))?;
    let view = Cleaned::of(&view.binned(bin), blur_px(magnification))?;
    let fit = if is_coarser {
        let reference_from_view = view_from_reference.inverse();
        fit(&view, &reference, reference_from_view)?.reversed(
            reference.centre_px(),
            view.centre_px(),
            view_from_reference,
        )
    } else {
        fit(&reference, &view, view_from_reference)?
    };
    shift_of(&reference, &fit, expected)
}

/// Blur for images that show everything `larger` times larger, px: relative to the aircraft, spots get the size that they have in the
/// other image after its blur.
fn blur_of_finer_px(larger: f64, spot_px: f64) -> f64 {
    let spot_of_other_px = larger * spot_px.hypot(BLUR_PX);
    (spot_of_other_px.powi(2) - spot_px.powi(2)).sqrt()
}

fn shift_of(
    reference: &Cleaned,
    fit: &Fit,
    expected: &ExpectedDifference,
) -> Result<Shift, NoShift> {
    if fit.correlation < MIN_CORRELATION || !GAINS.contains(&fit.gain) {
        return Err(NoShift::Different);
    }
    let sd = |sd: f64, depth_px_per_m: f64| {
        (SD_FACTOR * sd)
            .hypot(FLOOR_SD_PX * reference.step_px())
            .hypot(DEPTH_SD_M * depth_px_per_m)
    };
    let depth_px_per_m = expected.depth_px_per_m;
    let DVec2 { x: x_px, y: y_px } = reference.centre_px();
    let shift = Shift {
        x_px,
        y_px,
        dx_px: fit.shift_px.x,
        dy_px: fit.shift_px.y,
        sd_x_px: sd(fit.sd_px.x, depth_px_per_m.x),
        sd_y_px: sd(fit.sd_px.y, depth_px_per_m.y),
    };
    // Perspective is no reason to refuse: it grows with the size of the aircraft, and so does the error of the boxes.
    let fitted_px = (SD_FACTOR * fit.sd_px).max_element() / reference.step_px();
    if fitted_px > MAX_SD_PX || !is_within_limits(&shift) {
        return Err(NoShift::Vague);
    }
    Ok(shift)
}

#[cfg(test)]
mod tests;
