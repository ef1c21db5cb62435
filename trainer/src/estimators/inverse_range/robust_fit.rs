//! Robust least squares of the inverse range on the terms of a quadratic, for cameras at a given distance behind the target.

use std::collections::BTreeSet;

use dataset::numbers::least_squares::NormalEquations;
use dataset::numbers::spread::{deviation_from_zero, mean_and_deviation};

use crate::samples::view_shift::Places;

/// Residuals beyond this many standard deviations count linearly: Huber's choice, which costs 5 % of the precision if there is no outlier.
const HUBER: f64 = 1.345;
/// Part of the mean diagonal element that keeps coefficients small: flights on one line do not determine how places beside it differ.
/// Of the powers of ten it has the least error on the demo's training flights, each left out in turn; 1e-10 to 1e-6 differ by 2 % of it.
/// But of seven fits to one flight each the worst is off by 1.2 % on other flights with 1e-12, and by 0.1 % with this.
const RIDGE: f64 = 1e-7;
/// Error that quadratics leave, as pixels of shift: shifts with a smaller standard deviation count the same.
const FLOOR_SD_PX: f64 = 0.05;
/// Iterations of reweighting at most.
const ITERATIONS: usize = 200;
/// Change of the deviation below which it is kept.
const SETTLED: f64 = 1e-3;
/// Lower limit of the deviation, which keeps the weights of exact positions finite.
const MIN_DEVIATION: f64 = 1e-9;
/// Errors at smaller distances count as at this one, 0.5 NM: percentages explode at touchdown.
pub(super) const NEAREST_M: f64 = 926.0;

/// Precision of places, relative to the best ones.
pub(super) fn precision(places: &Places) -> f64 {
    precision_of(places.sd_px.unwrap_or(0.0))
}

/// Precision with this standard deviation, pixels, relative to the best one.
pub(super) fn precision_of(sd_px: f64) -> f64 {
    FLOOR_SD_PX / FLOOR_SD_PX.hypot(sd_px)
}

/// The coordinates of places, view by view.
pub(super) fn coordinates(places: &Places) -> Vec<f64> {
    places
        .centres_px
        .iter()
        .flat_map(|centre| centre.to_array())
        .collect()
}

/// Number of terms of a quadratic.
pub(super) fn terms_of(coordinates: usize) -> usize {
    (coordinates + 1) * (coordinates + 2) / 2
}

/// The terms of a quadratic: 1, the variables, and the products of each with itself and all after it.
pub(super) fn write_terms(variables: &[f64], terms: &mut Vec<f64>) {
    terms.clear();
    terms.push(1.0);
    terms.extend_from_slice(variables);
    for (index, &first) in variables.iter().enumerate() {
        terms.extend(variables[index..].iter().map(|&second| first * second));
    }
}

pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Means and standard deviations of the coordinates of many places.
pub(super) struct Scales {
    pub(super) offset_px: Vec<f64>,
    pub(super) scale_px: Vec<f64>,
}

impl Scales {
    /// `rows`: one after the other, each with this many coordinates.
    pub(super) fn of(rows: &[f64], coordinates: usize) -> Self {
        let of_column = |column: usize| {
            let values = rows.iter().skip(column).step_by(coordinates);
            let [mean, deviation] = mean_and_deviation(values.copied());
            // A place that never changes stays as it is.
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

/// Factor that converts an error of the inverse range to a relative error of the distance.
pub(super) fn sensitivity_m(distance_m: f64, setback_m: f64) -> f64 {
    (distance_m + setback_m).powi(2) / distance_m.max(NEAREST_M)
}

/// Data of a fit, tick by tick.
pub(super) struct Rows {
    /// Coordinates of a tick.
    pub(super) width: usize,
    pub(super) coordinates: Vec<f64>,
    pub(super) distances_m: Vec<f64>,
    /// Precision of the places, relative to the best ones.
    precisions: Vec<f64>,
    /// Scenarios that they are from, each counted once.
    scenarios: BTreeSet<usize>,
}

/// Coefficients and what they leave.
pub(super) struct Solution {
    pub(super) coefficients_per_m: Vec<f64>,
    /// Relative errors of the distance times the precisions.
    pub(super) residuals: Vec<f64>,
    /// Their robust standard deviation.
    pub(super) deviation: f64,
    /// Inverse of the normal equations' matrix, row by row.
    pub(super) inverse: Vec<f64>,
}

impl Rows {
    /// None yet, of places in this many views.
    pub(super) fn new(views: usize) -> Self {
        Self {
            width: 2 * views,
            coordinates: Vec::new(),
            distances_m: Vec::new(),
            precisions: Vec::new(),
            scenarios: BTreeSet::new(),
        }
    }

    /// Adds a tick of a scenario.
    pub(super) fn push(&mut self, places: &Places, distance_m: f64, scenario: usize) {
        self.scenarios.insert(scenario);
        self.coordinates.extend(coordinates(places));
        self.distances_m.push(distance_m);
        self.precisions.push(precision(places));
    }

    /// Number of ticks.
    pub(super) fn len(&self) -> usize {
        self.distances_m.len()
    }

    /// Ticks of a scenario: they err together, so that so many count as one.
    pub(super) fn ticks_per_scenario(&self) -> f64 {
        self.len() as f64 / self.scenarios.len().max(1) as f64
    }

    /// Every `step`-th row.
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

    /// The coefficients for a distance of the cameras behind the target, by iteratively reweighted least squares, until no residual moves
    /// by more than this part of the deviation; `None` if there are none. The deviation settles first and is then kept, because the
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
                is_settled = change <= SETTLED * last.deviation || iteration > ITERATIONS / 4;
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

    /// The ridge for equal weights of all ticks.
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

    /// The coefficients with these weights of the ticks.
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
