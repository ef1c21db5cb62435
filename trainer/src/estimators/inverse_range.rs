//! `inverse_range`: a quadratic of the aircraft's image positions that is learned from labelled flights.
//!
//! For cameras that look up the approach from a distance `s` behind the touchdown target, `1 / (d + s)` is nearly linear in pixels, and
//! quadratic terms absorb the rest: lens, aim, flight paths beside and below the usual one. So `s` is searched, and for each `s` the
//! coefficients are a linear least-squares problem. Residuals are relative errors of the distance, with Huber's loss ("Robust estimation of
//! a location parameter", 1964), so that a few wrong labels or shifts hardly matter; it is convex, so the solution is unique.
//!
//! Each set of views has separate fits, because a formula needs all its views: one from the boxes, and, for two or more views, one from
//! their registered shifts ([`crate::samples::view_shift`]). At a tick the first fit applies whose views all saw the aircraft; training
//! sorts them by precision. Prediction does not read the calibration. Training uses it only to exclude false boxes. Registration used it
//! for scale and rotation between two views.

pub(crate) mod contradiction;
pub(crate) mod flight_filter;

mod cross_fitted;
mod measurement;
mod onnx;
mod robust_fit;
mod row_misfit;
mod tick;

use std::collections::BTreeSet;

use dataset::numbers::least_squares::dot;
use serde::{Deserialize, Serialize};

use crate::estimators::MAX_SETBACK_M;
use crate::estimators::minimum::Search;
use crate::samples::camera_health::late_images::Pair;
use crate::samples::view_shift::Places;
use crate::samples::{FARTHEST_M, Observation, Sample};

pub(crate) use cross_fitted::CrossFitted;
pub(crate) use measurement::{Measurement, scale_m};
pub(crate) use robust_fit::MIN_DEVIATION;
use robust_fit::{ROUGHLY, Row, Scales, Solution, precision, sensitivity_m, solve, terms_of};
use row_misfit::RowRelation;
pub(crate) use tick::Tick;

/// Minimum number of ticks per coefficient.
const TICKS_PER_COEFFICIENT: usize = 3;
/// Maximum number of views in a separate fit, because the number of coefficients grows with the square; larger sets are covered by their
/// pairs.
const MAX_VIEWS: usize = 4;
/// Move of residuals that ends the iteration for the coefficients, in deviations.
const EXACTLY: f64 = 1e-6;
/// Maximum number of ticks in the search for `s`; more do not change it.
const TICKS_OF_SEARCH: usize = 2_000;

/// Fits for all sets of views in the order of use: the most precise one in training first. A refitted run keeps the order of its training,
/// because the flight filter has learned which fit corrects which.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(crate) struct InverseRange {
    fits: Vec<Fit>,
    /// Row relations between views; they do not affect the distance.
    rows: Vec<RowRelation>,
}

/// Input views for a formula.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct ViewSet {
    /// View indices, ascending.
    views: Vec<usize>,
    /// True for registered positions, false for box centres.
    registered: bool,
}

/// Ticks with the aircraft in all views of a set, and the number of their scenarios.
struct Rows {
    rows: Vec<Row>,
    scales: Scales,
    scenarios: usize,
}

/// Formula for one set of views.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Fit {
    /// Input views.
    #[serde(flatten)]
    set: ViewSet,
    /// `s`: distance of the cameras behind the touchdown target, metres.
    setback_m: f64,
    #[serde(flatten)]
    scales: Scales,
    /// Factors for 1, the normalised positions, and their products (first with itself and all after it, second with itself, ...); 1/m.
    coefficients_per_m: Vec<f64>,
    /// Robust standard deviation of the relative error on the training side, corrected for the number of coefficients.
    deviation: f64,
    /// For a single view, covariance of the coefficients, row by row, in squares of the deviation, with each training flight counted as one
    /// tick. Empty for several views, which need no other flights than these.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    covariance_per_m2: Vec<f64>,
}

impl InverseRange {
    /// Fits all sets of views that saw the aircraft together often enough in training, and each view alone.
    pub(crate) fn fit(views: usize, training: &[&Sample]) -> Self {
        Self {
            rows: RowRelation::all(views, training),
            ..Self::fit_sets(sets_of_views(views, training), training)
        }
    }

    /// True without any fit.
    pub(crate) fn is_empty(&self) -> bool {
        self.fits.is_empty()
    }

    /// The first fit whose views all saw the aircraft.
    fn asked(&self, observed: &Observation) -> Option<usize> {
        let applies = |fit: &Fit| fit.set.places(observed).is_some();
        self.fits.iter().position(applies)
    }

    /// True for each fit that contains this view.
    pub(crate) fn contain(&self, view: usize) -> impl Iterator<Item = bool> {
        self.fits
            .iter()
            .map(move |fit| fit.set.views.contains(&view))
    }

    /// Copy without the fits that depend on this view's camera.
    pub(crate) fn without(&self, view: usize) -> Self {
        let others = self
            .fits
            .iter()
            .filter(|fit| !fit.set.views.contains(&view));
        Self {
            fits: others.cloned().collect(),
            rows: self.rows_without(view),
        }
    }

    /// Relations between the other views.
    fn rows_without(&self, view: usize) -> Vec<RowRelation> {
        let others = self.rows.iter().filter(|row| !row.views.contains(&view));
        others.cloned().collect()
    }

    fn fit_sets(sets: BTreeSet<Vec<usize>>, training: &[&Sample]) -> Self {
        let sets = sets.into_iter().flat_map(|views| {
            [false, true].map(|registered| ViewSet {
                views: views.clone(),
                registered,
            })
        });
        let mut fits: Vec<Fit> = sets.filter_map(|set| Fit::of(set, training)).collect();
        fits.sort_by(|a, b| a.deviation.total_cmp(&b.deviation));
        Self {
            fits,
            rows: Vec::new(),
        }
    }

    /// Distance to touchdown, metres; `None` if no fit applies, or if the first that applies has no distance for these positions.
    pub(crate) fn predict(&self, observed: &Observation) -> Option<f64> {
        let fit = self.asked(observed)?;
        Some(self.measurement(fit, observed)?.distance_m)
    }

    /// True if every fit refers to existing views and has as many numbers as they need.
    pub(crate) fn is_of(&self, views: usize) -> bool {
        let is_row_of_views = |row: &RowRelation| row.views.iter().all(|&view| view < views);
        self.rows.iter().all(is_row_of_views)
            && self.fits.iter().all(|fit| {
                let set = &fit.set.views;
                let coordinates = 2 * set.len();
                set.last().is_some_and(|&last| last < views)
                    && set.windows(2).all(|pair| pair[0] < pair[1])
                    && fit.scales.offset_px.len() == coordinates
                    && fit.scales.scale_px.len() == coordinates
                    && fit.coefficients_per_m.len() == terms_of(coordinates)
                    && [0, terms_of(coordinates).pow(2)].contains(&fit.covariance_per_m2.len())
            })
    }

    /// Mean positions, pixels.
    pub(crate) fn offsets_px(&self) -> impl Iterator<Item = f64> {
        self.fits
            .iter()
            .flat_map(|fit| fit.scales.offset_px.iter().copied())
    }

    /// Standard deviations of positions, pixels.
    pub(crate) fn scales_px(&self) -> impl Iterator<Item = f64> {
        self.fits
            .iter()
            .flat_map(|fit| fit.scales.scale_px.iter().copied())
    }

    /// Views whose rows are known.
    pub(crate) fn pairs(&self) -> Vec<Pair<'_>> {
        self.rows.iter().filter_map(RowRelation::pair).collect()
    }
}

/// Each view alone, the sets of views that saw the aircraft together, and the pairs within larger sets.
fn sets_of_views(views: usize, training: &[&Sample]) -> BTreeSet<Vec<usize>> {
    let mut sets: BTreeSet<Vec<usize>> = (0..views).map(|view| vec![view]).collect();
    let seen = |sample: &&Sample| -> Vec<usize> {
        (0..views)
            .filter(|&view| sample.best(view).is_some())
            .collect()
    };
    let together: BTreeSet<Vec<usize>> = training.iter().map(seen).collect();
    for set in together {
        if set.len() <= MAX_VIEWS {
            sets.insert(set);
            continue;
        }
        for (index, &first) in set.iter().enumerate() {
            sets.extend(set[index + 1..].iter().map(|&second| vec![first, second]));
        }
    }
    sets.remove(&Vec::new());
    sets
}

impl ViewSet {
    fn places(&self, observed: &Observation) -> Option<Places> {
        if self.registered {
            Places::registered(observed, &self.views)
        } else {
            Places::of_boxes(observed, &self.views)
        }
    }

    /// Ticks with the aircraft in all views.
    fn rows(&self, training: &[&Sample]) -> Rows {
        let seen = training.iter();
        let seen: Vec<(Places, &Sample)> = seen
            .filter_map(|sample| Some((self.places(sample)?, *sample)))
            .collect();
        let scales = Scales::of(seen.iter().map(|(places, _)| places), self.views.len());
        let row = |(places, sample): &(Places, &Sample)| Row {
            terms: scales.terms(places),
            distance_m: sample.dtd_m,
            precision: precision(places),
        };
        let scenarios: BTreeSet<usize> = seen.iter().map(|(_, sample)| sample.scenario).collect();
        Rows {
            rows: seen.iter().map(row).collect(),
            scales,
            scenarios: scenarios.len(),
        }
    }
}

impl Fit {
    /// `None` with too few ticks.
    fn of(set: ViewSet, training: &[&Sample]) -> Option<Self> {
        let of_set = set.rows(training);
        let rows = &of_set.rows;
        if rows.len() < TICKS_PER_COEFFICIENT * terms_of(2 * set.views.len()) {
            return None;
        }
        let distances_m = || rows.iter().map(|row| row.distance_m);
        let search = Search {
            from: -distances_m().reduce(f64::min)?,
            to: distances_m().fold(MAX_SETBACK_M, f64::max),
            parts: 20,
            rounds: 5,
        };
        let some = || rows.iter().step_by(rows.len().div_ceil(TICKS_OF_SEARCH));
        let setback_m = search.lowest(|setback_m| {
            let size = |solution: Solution| solution.residuals.iter().map(|r| r.abs()).sum();
            solve(some(), setback_m, ROUGHLY).map_or(f64::INFINITY, size)
        });
        Self::at(set, setback_m, of_set)
    }

    /// The fit for cameras at this distance behind the target.
    fn at(set: ViewSet, setback_m: f64, of_set: Rows) -> Option<Self> {
        let Rows {
            rows,
            scales,
            scenarios,
        } = of_set;
        let solution = solve(rows.iter(), setback_m, EXACTLY)?;
        let coefficients_per_m = solution.coefficients_per_m;
        let free = rows.len().saturating_sub(coefficients_per_m.len()).max(1);
        let freedom = (rows.len() as f64 / free as f64).sqrt();
        // Ticks of a flight share their errors.
        let together = rows.len() as f64 / scenarios as f64;
        let covariance = match set.views.len() {
            1 => solution.inverse,
            _ => Vec::new(),
        };
        Some(Self {
            set,
            setback_m,
            scales,
            deviation: solution.deviation * freedom,
            covariance_per_m2: covariance.iter().map(|v| v * together).collect(),
            coefficients_per_m,
        })
    }

    fn distance_m(&self, terms: &[f64]) -> Option<f64> {
        let inverse_range_per_m = dot(terms, &self.coefficients_per_m);
        let distance_m = inverse_range_per_m.recip() - self.setback_m;
        (inverse_range_per_m > 0.0 && (0.0..=FARTHEST_M).contains(&distance_m))
            .then_some(distance_m)
    }

    /// Variance of the relative error due to the coefficients, in squares of the deviation: small near the training flights, large far
    /// away. 0 if unknown.
    fn leverage(&self, terms: &[f64], distance_m: f64) -> f64 {
        let rows = self.covariance_per_m2.chunks_exact(terms.len());
        let moved: Vec<f64> = rows.map(|row| dot(row, terms)).collect();
        sensitivity_m(distance_m, self.setback_m).powi(2) * dot(&moved, terms)
    }
}

#[cfg(test)]
mod tests;
