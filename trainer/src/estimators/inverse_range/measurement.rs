//! Measurements of the single fits at a tick, to be weighed against each other and against earlier ticks.

use super::Fit;
use super::InverseRange;
use super::robust_fit::{NEAREST_M, precision};
use super::row_misfit::RowRelation;
use crate::samples::view_shift::Places;
use crate::samples::{CommonError, Observation, Sample};

/// Step by which the sensitivity to a place is measured, pixels.
const STEP_PX: f64 = 0.01;

/// The distance that one fit reads from the places at a tick. The formula of the inverse range is inverted exactly, so that no filter has
/// to linearise it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Measurement {
    /// Number of the fit, from the most precise one.
    pub fit: usize,
    /// True if it needs one view only.
    pub of_one_view: bool,
    /// Distance to touchdown, metres.
    pub distance_m: f64,
    /// Precision of the places, relative to the best ones, and of the formula there: its error is as many times larger as this is smaller.
    /// It does not include the common errors.
    pub precision: f64,
    /// Standard deviation of the part of its error that all ticks share, metres.
    pub common_sd_m: f64,
}

impl Measurement {
    /// Its error relative to the true distance, as it were with places of the best precision: positive if it reads too far.
    pub(crate) fn error_at(&self, distance_m: f64) -> f64 {
        (self.distance_m - distance_m) * self.precision / scale_m(distance_m)
    }
}

/// Reference of relative errors, metres: the distance, except near touchdown.
pub(crate) fn scale_m(distance_m: f64) -> f64 {
    distance_m.max(NEAREST_M)
}

impl InverseRange {
    /// Measurements of all fits whose views all saw the aircraft, the most precise first.
    pub(crate) fn measurements(&self, observed: &Observation) -> Vec<Measurement> {
        let fits = 0..self.fits.len();
        fits.filter_map(|fit| self.measurement(fit, observed))
            .collect()
    }

    /// Distance of the cameras behind the touchdown target by a fit, metres.
    pub(crate) fn setback_m(&self, fit: usize) -> f64 {
        self.fits[fit].setback_m
    }

    /// Measurement of one fit; `None` if one of its views is empty, or its formula gives no distance at these positions.
    pub(super) fn measurement(&self, number: usize, observed: &Observation) -> Option<Measurement> {
        let fit = &self.fits[number];
        let places = fit.set.places(observed)?;
        let terms = fit.terms(&places);
        let distance_m = fit.distance_m(&terms)?;
        let best = precision(&places);
        let leverage = fit.leverage(&terms, distance_m);
        Some(Measurement {
            fit: number,
            of_one_view: fit.set.views.len() == 1,
            distance_m,
            precision: best / (1.0 + best * best * leverage).sqrt(),
            common_sd_m: fit.common_sd_m(&places, distance_m, &observed.common_errors),
        })
    }

    /// Standard deviations of the relative errors on the training side, fit by fit.
    pub(crate) fn deviations(&self) -> impl ExactSizeIterator<Item = f64> {
        self.fits.iter().map(|fit| fit.deviation)
    }

    /// The same fits in the same order with coefficients from other samples. A fit that these samples do not determine stays as it is.
    pub(crate) fn refitted(&self, training: &[&Sample]) -> Self {
        let refitted = |fit: &Fit| {
            let (rows, scales) = fit.set.rows(training);
            let refitted = Fit::at(fit.set.clone(), fit.setback_m, &rows, scales);
            refitted.unwrap_or_else(|| fit.clone())
        };
        let views = self.rows.iter().flat_map(|row| row.views).max();
        Self {
            fits: self.fits.iter().map(refitted).collect(),
            rows: views.map_or(Vec::new(), |last| RowRelation::all(last + 1, training)),
        }
    }
}

impl Fit {
    /// Standard deviation of the distance due to common errors of the places, metres. Infinite where no step from the places is one that
    /// the formula has a distance for.
    fn common_sd_m(&self, places: &Places, distance_m: f64, errors: &[CommonError]) -> f64 {
        let variance_m2 = |error: &CommonError| {
            let number = self.set.views.iter().position(|&view| view == error.view)?;
            let steps = error.sd_px.length() / STEP_PX;
            let moved_m = [1.0, -1.0].into_iter().find_map(|direction| {
                let mut moved = places.clone();
                moved.centres_px[number] += direction * error.sd_px / steps;
                self.distance_m(&self.terms(&moved))
            });
            let slope_m = moved_m.map_or(f64::INFINITY, |moved_m| moved_m - distance_m);
            Some((steps * slope_m).powi(2))
        };
        errors.iter().filter_map(variance_m2).sum::<f64>().sqrt()
    }
}
