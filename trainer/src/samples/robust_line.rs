//! Robust least squares with a few unknowns.

use dataset::numbers::least_squares::NormalEquations;
use dataset::numbers::spread::deviation_from_zero;

/// Unit of coordinates in a fit, px.
pub(crate) const UNIT_PX: f64 = 1_000.0;
/// Unit of widths, and of coordinates whose slopes the ridge must not affect, px.
pub(crate) const FINE_UNIT_PX: f64 = 100.0;
/// Mean square of the ridge, for terms of about 1: flights on one line do not determine all slopes.
const RIDGE: f64 = 1e-4;
const ITERATIONS: usize = 30;
/// Residual with half the maximum weight (Cauchy), in standard deviations.
const HALF_WEIGHT: f64 = 2.0;

pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Robust line `value = terms . unknowns` through points with different error scales, and the standard deviation of the scaled residuals.
/// `None` if the numbers are not finite.
pub(crate) fn robust_line<const N: usize>(
    points: &[([f64; N], f64, f64)],
) -> Option<([f64; N], f64)> {
    let mut weights = vec![1.0; points.len()];
    let mut fitted = None;
    for _ in 0..ITERATIONS {
        let mut equations = NormalEquations::new(N);
        let mut sum = 0.0;
        for ((terms, value, scale), weight) in points.iter().zip(&weights) {
            let weight = weight / (scale * scale);
            equations.add(terms, *value, weight);
            sum += weight;
        }
        for unknown in 1..N {
            let mut slope = [0.0; N];
            slope[unknown] = 1.0;
            equations.add(&slope, 0.0, RIDGE * sum);
        }
        let unknowns: [f64; N] = equations.solve_for()?;
        let residuals: Vec<f64> = (points.iter())
            .map(|(terms, value, scale)| (value - dot(terms, &unknowns)) / scale)
            .collect();
        let deviation = deviation_from_zero(residuals.iter().copied());
        let half = HALF_WEIGHT * deviation.max(f64::MIN_POSITIVE);
        for (weight, residual) in weights.iter_mut().zip(&residuals) {
            *weight = (1.0 + (residual / half).powi(2)).recip();
        }
        fitted = Some((unknowns, deviation));
    }
    fitted
}
