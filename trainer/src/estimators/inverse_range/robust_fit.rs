//! Robust least squares of the inverse range on quadratic terms, for cameras at a given distance behind the target.

use std::collections::BTreeSet;

use dataset::numbers::least_squares::{NormalEquations, dot};
use dataset::numbers::spread::{deviation_from_zero, mean_and_deviation};

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
    precision_of(places.sd_px.unwrap_or(0.0))
}

/// Relative precision for a standard deviation in pixels.
pub(super) fn precision_of(sd_px: f64) -> f64 {
    MIN_SD_PX / MIN_SD_PX.hypot(sd_px)
}

pub(super) fn coordinates(places: &Places) -> Vec<f64> {
    places
        .centres_px
        .iter()
        .flat_map(|centre| centre.to_array())
        .collect()
}

/// Number of quadratic terms.
pub(super) fn terms_of(coordinates: usize) -> usize {
    (coordinates + 1) * (coordinates + 2) / 2
}

/// Quadratic terms: 1, the variables, and the products of each with itself and all after it.
pub(super) fn write_terms(variables: &[f64], terms: &mut Vec<f64>) {
    terms.clear();
    terms.push(1.0);
    terms.extend_from_slice(variables);
    for (index, &first) in variables.iter().enumerate() {
        terms.extend(variables[index..].iter().map(|&second| first * second));
    }
}

/// Means and standard deviations of coordinates.
pub(super) struct Scales {
    pub(super) offset_px: Vec<f64>,
    pub(super) scale_px: Vec<f64>,
}

impl Scales {
    /// `rows` follow each other, each with this many coordinates.
    pub(super) fn of(rows: &[f64], coordinates: usize) -> Self {
        let of_column = |column: usize| {
            let values = rows.iter().skip(column).step_by(coordinates);
            let [mean, deviation] = mean_and_deviation(values.copied());
            // A constant coordinate stays unscaled.
            let scale = if deviation > 0.0 { deviation } else { 1.0 };
            (mean, scale)
        };
        let (offset_px, scale_px) = (0..coordinates).map(of_column).unzip();
        Self {
            offset_px,
            scale_px,
        }
    }
}

pub(super) fn normalise(coordinates: &mut [f64], offset_px: &[f64], scale_px: &[f64]) {
    for (value, (offset, scale)) in coordinates.iter_mut().zip(offset_px.iter().zip(scale_px)) {
        *value = (*value - offset) / scale;
    }
}

/// Factor from errors of the inverse range to relative errors of the distance.
pub(super) fn sensitivity_m(distance_m: f64, setback_m: f64) -> f64 {
    (distance_m + setback_m).powi(2) / distance_m.max(NEAREST_M)
}

/// Data for a fit, tick by tick.
pub(super) struct Rows {
    /// Coordinates per tick.
    pub(super) width: usize,
    pub(super) coordinates: Vec<f64>,
    pub(super) distances_m: Vec<f64>,
    /// Relative precision, 1 for the best.
    precisions: Vec<f64>,
    /// Source scenarios.
    scenarios: BTreeSet<usize>,
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

impl Rows {
    pub(super) fn new(views: usize) -> Self {
        Self {
            width: 2 * views,
            coordinates: Vec::new(),
            distances_m: Vec::new(),
            precisions: Vec::new(),
            scenarios: BTreeSet::new(),
        }
    }

    pub(super) fn push(&mut self, places: &Places, distance_m: f64, scenario: usize) {
        self.scenarios.insert(scenario);
        self.coordinates.extend(coordinates(places));
        self.distances_m.push(distance_m);
        self.precisions.push(precision(places));
    }

    pub(super) fn len(&self) -> usize {
        self.distances_m.len()
    }

    /// Ticks per scenario, which share their errors.
    pub(super) fn ticks_per_scenario(&self) -> f64 {
        self.len() as f64 / self.scenarios.len().max(1) as f64
    }

    pub(super) fn thinned(&self, step: usize) -> Self {
        let rows = self.coordinates.chunks_exact(self.width);
        Self {
            width: self.width,
            coordinates: rows.step_by(step).flatten().copied().collect(),
            distances_m: self.distances_m.iter().step_by(step).copied().collect(),
            precisions: self.precisions.iter().step_by(step).copied().collect(),
            scenarios: self.scenarios.clone(),
        }
    }

    /// Coefficients for cameras at this distance behind the target, by iteratively reweighted least squares, until no residual moves by
    /// more than the tolerance, in deviations; `None` if they are undetermined. The deviation settles first and is then kept, because the
    /// problem is convex only for a given one.
    pub(super) fn solve(&self, setback_m: f64, tolerance: f64) -> Option<Solution> {
        let sensitivity_m = |(&distance_m, &precision): (&f64, &f64)| {
            precision * sensitivity_m(distance_m, setback_m)
        };
        let sensitivities_m: Vec<f64> = self
            .distances_m
            .iter()
            .zip(&self.precisions)
            .map(sensitivity_m)
            .collect();
        let ridge = self.ridge(&sensitivities_m);
        let mut solution = self.weighted(setback_m, &sensitivities_m, ridge, |_| 1.0)?;
        let mut is_settled = false;
        for iteration in 1..ITERATIONS {
            let counts = |index: usize| {
                let size = solution.residuals[index].abs();
                (HUBER * solution.deviation / size).min(1.0)
            };
            let next = self.weighted(setback_m, &sensitivities_m, ridge, counts)?;
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

    /// The ridge with equal weights for all ticks.
    fn ridge(&self, sensitivities_m: &[f64]) -> f64 {
        let mut terms = Vec::new();
        let mut sum = 0.0;
        for (row, sensitivity_m) in self
            .coordinates
            .chunks_exact(self.width)
            .zip(sensitivities_m)
        {
            write_terms(row, &mut terms);
            sum += sensitivity_m.powi(2) * dot(&terms, &terms);
        }
        RIDGE * sum / terms_of(self.width) as f64
    }

    fn weighted(
        &self,
        setback_m: f64,
        sensitivities_m: &[f64],
        ridge: f64,
        weight: impl Fn(usize) -> f64,
    ) -> Option<Solution> {
        let mut terms = Vec::new();
        let mut normal = NormalEquations::new(terms_of(self.width));
        let rows = || self.coordinates.chunks_exact(self.width).enumerate();
        let inverse_range_per_m = |index: usize| (self.distances_m[index] + setback_m).recip();
        for (index, row) in rows() {
            write_terms(row, &mut terms);
            let weight = weight(index) * sensitivities_m[index].powi(2);
            normal.add(&terms, inverse_range_per_m(index), weight);
        }
        normal.add_to_diagonal(ridge);
        let coefficients_per_m = normal.solve()?;
        let inverse = normal.inverse()?.concat();
        let mut residuals = Vec::with_capacity(self.len());
        for (index, row) in rows() {
            write_terms(row, &mut terms);
            let error_per_m = dot(&terms, &coefficients_per_m) - inverse_range_per_m(index);
            residuals.push(sensitivities_m[index] * error_per_m);
        }
        let deviation = deviation_from_zero(residuals.iter().copied()).max(MIN_DEVIATION);
        Some(Solution {
            coefficients_per_m,
            residuals,
            deviation,
            inverse,
        })
    }
}
