//! Robust least squares of the inverse range on quadratic terms, for cameras at a given distance behind the target.

use dataset::numbers::least_squares::{NormalEquations, dot};
use dataset::numbers::spread::{deviation_from_zero, mean_and_deviation};
use serde::{Deserialize, Serialize};

use crate::estimators::HUBER;
use crate::samples::view_shift::{MIN_SD_PX, Places};

/// Ridge relative to the mean diagonal element: flights on one line do not determine how positions beside it differ. Among the powers of
/// ten it has the least error on the demo's training flights, each left out in turn; 1e-10 to 1e-6 differ by 2 % of it. But with seven fits
/// to one flight each, the worst error on other flights is 1.2 % with 1e-12, and 0.1 % with this.
const RIDGE: f64 = 1e-7;
const ITERATIONS: usize = 200;
/// Relative change below which the deviation, and the residuals during a search, count as settled.
pub(super) const ROUGHLY: f64 = 1e-3;
/// Minimum relative error, which keeps the weights of exact positions finite.
pub(crate) const MIN_DEVIATION: f64 = 1e-6;
/// Minimum distance for relative errors, 0.5 NM: percentages explode at touchdown.
pub(super) const NEAREST_M: f64 = 926.0;

/// Relative precision of positions, 1 for the best.
pub(super) fn precision(places: &Places) -> f64 {
    MIN_SD_PX / MIN_SD_PX.hypot(places.sd_px.unwrap_or(0.0))
}

/// Number of quadratic terms.
pub(super) fn terms_of(coordinates: usize) -> usize {
    (coordinates + 1) * (coordinates + 2) / 2
}

/// Means and standard deviations of coordinates, right and down per view, pixels.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Scales {
    pub(super) offset_px: Vec<f64>,
    pub(super) scale_px: Vec<f64>,
}

impl Scales {
    pub(super) fn of<'a>(places: impl Iterator<Item = &'a Places> + Clone, views: usize) -> Self {
        let of_coordinate = |index: usize| {
            let values = places.clone();
            let values = values.map(|of| of.centres_px[index / 2][index % 2]);
            let [mean, deviation] = mean_and_deviation(values);
            // A constant coordinate stays unscaled.
            let scale = if deviation > 0.0 { deviation } else { 1.0 };
            (mean, scale)
        };
        let (offset_px, scale_px) = (0..2 * views).map(of_coordinate).unzip();
        Self {
            offset_px,
            scale_px,
        }
    }

    /// Quadratic terms: 1, the normalised positions, and the products of each with itself and all after it.
    pub(super) fn terms(&self, places: &Places) -> Vec<f64> {
        let coordinates = places.centres_px.iter().flat_map(|of| of.to_array());
        let scales = self.offset_px.iter().zip(&self.scale_px);
        let values = coordinates.zip(scales);
        let values: Vec<f64> = values
            .map(|(value, (offset, scale))| (value - offset) / scale)
            .collect();
        let mut terms = vec![1.0];
        terms.extend(&values);
        for (index, first) in values.iter().enumerate() {
            terms.extend(values[index..].iter().map(|second| first * second));
        }
        terms
    }
}

/// Factor from errors of the inverse range to relative errors of the distance.
pub(super) fn sensitivity_m(distance_m: f64, setback_m: f64) -> f64 {
    (distance_m + setback_m).powi(2) / distance_m.max(NEAREST_M)
}

/// A tick of a fit.
pub(super) struct Row {
    pub(super) terms: Vec<f64>,
    pub(super) distance_m: f64,
    /// Relative precision, 1 for the best.
    pub(super) precision: f64,
}

/// Coefficients with their residuals.
pub(super) struct Solution {
    pub(super) coefficients_per_m: Vec<f64>,
    /// Relative errors of the distance times the precisions.
    pub(super) residuals: Vec<f64>,
    /// Robust standard deviation of the residuals.
    pub(super) deviation: f64,
    /// Inverse of the normal matrix, row by row.
    pub(super) inverse: Vec<f64>,
}

/// Coefficients for cameras at this distance behind the target, by iteratively reweighted least squares, until no residual moves by
/// more than the tolerance, in deviations; `None` if they are undetermined. The deviation settles first and is then kept, because the
/// problem is convex only for a given one.
pub(super) fn solve<'a>(
    rows: impl Iterator<Item = &'a Row>,
    setback_m: f64,
    tolerance: f64,
) -> Option<Solution> {
    let points: Vec<Point> = rows.map(|row| Point::of(row, setback_m)).collect();
    let mut solution = weighted(&points, |_| 1.0)?;
    let mut is_settled = false;
    for iteration in 1..ITERATIONS {
        let counts = |index: usize| {
            let size = solution.residuals[index].abs();
            (HUBER * solution.deviation / size).min(1.0)
        };
        let next = weighted(&points, counts)?;
        let last = std::mem::replace(&mut solution, next);
        if !is_settled {
            let change = (solution.deviation - last.deviation).abs();
            is_settled = change <= ROUGHLY * last.deviation || iteration > ITERATIONS / 4;
            continue;
        }
        solution.deviation = last.deviation;
        let moves = solution.residuals.iter().zip(&last.residuals);
        let largest = moves
            .map(|(new, old)| (new - old).abs())
            .fold(0.0, f64::max);
        if largest <= tolerance * solution.deviation {
            break;
        }
    }
    Some(solution)
}

/// A tick, for cameras at a given distance behind the target.
struct Point<'a> {
    terms: &'a [f64],
    inverse_range_per_m: f64,
    /// Factor from errors of the inverse range to residuals.
    sensitivity_m: f64,
}

impl<'a> Point<'a> {
    fn of(row: &'a Row, setback_m: f64) -> Self {
        Self {
            terms: &row.terms,
            inverse_range_per_m: (row.distance_m + setback_m).recip(),
            sensitivity_m: row.precision * sensitivity_m(row.distance_m, setback_m),
        }
    }
}

/// The ridge is that of equal weights.
fn weighted(points: &[Point], weight: impl Fn(usize) -> f64) -> Option<Solution> {
    let unknowns = points.first()?.terms.len();
    let mut normal = NormalEquations::new(unknowns);
    let mut squares = 0.0;
    for (index, point) in points.iter().enumerate() {
        let equal = point.sensitivity_m.powi(2);
        normal.add(
            point.terms,
            point.inverse_range_per_m,
            weight(index) * equal,
        );
        squares += equal * dot(point.terms, point.terms);
    }
    normal.add_to_diagonal(RIDGE * squares / unknowns as f64);
    let coefficients_per_m = normal.solve()?;
    let residual = |point: &Point| {
        let error_per_m = dot(point.terms, &coefficients_per_m) - point.inverse_range_per_m;
        point.sensitivity_m * error_per_m
    };
    let residuals: Vec<f64> = points.iter().map(residual).collect();
    Some(Solution {
        deviation: deviation_from_zero(residuals.iter().copied()).max(MIN_DEVIATION),
        inverse: normal.inverse()?.concat(),
        coefficients_per_m,
        residuals,
    })
}
