//! Robust least squares with a few unknowns.

use dataset::numbers::least_squares::robust_fit;

/// Unit of widths, and of coordinates whose slopes the ridge must not affect, px.
pub(crate) const FINE_UNIT_PX: f64 = 100.0;
/// Mean square of the ridge, for terms of about 1: flights on one line do not determine all slopes.
const RIDGE: f64 = 1e-4;
const ITERATIONS: usize = 30;

/// Robust line `value = terms . unknowns` through points with different error scales, and the standard deviation of the scaled residuals.
/// `None` if the numbers are not finite.
pub(crate) fn robust_line<const N: usize>(
    points: &[([f64; N], f64, f64)],
) -> Option<([f64; N], f64)> {
    let prior = |unknown, sum| if unknown > 0 { RIDGE * sum } else { 0.0 };
    let fit = robust_fit(points, prior, f64::MIN_POSITIVE, ITERATIONS)?;
    Some((fit.unknowns.try_into().ok()?, fit.deviation))
}
