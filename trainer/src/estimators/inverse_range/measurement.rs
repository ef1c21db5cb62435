//! Distance measurements from single fits at a tick.

use super::Fit;
use super::InverseRange;
use super::robust_fit::{NEAREST_M, precision};
use super::row_misfit::RowRelation;
use crate::samples::view_shift::Places;
use crate::samples::{CommonError, Observation, Sample};

/// Step for the numerical sensitivity to a position, pixels.
const STEP_PX: f64 = 0.01;

/// Distance measured by one fit. The formula is inverted exactly, so filters need no linearisation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Measurement {
    /// Index of the fit, the most precise one first.
    pub fit: usize,
    pub of_one_view: bool,
    /// Distance to touchdown, metres.
    pub distance_m: f64,
    /// Relative precision of positions and formula, 1 for the best: the error is inversely proportional. Common errors are not included.
    pub precision: f64,
    /// Standard deviation of the error common to all ticks, metres.
    pub common_sd_m: f64,
}

impl Measurement {
    /// Relative error, normalised to the best precision: positive if the measurement is too far.
    pub(crate) fn error_at(&self, distance_m: f64) -> f64 {
        (self.distance_m - distance_m) * self.precision / scale_m(distance_m)
    }
}

/// Reference for relative errors, metres: the distance, except near touchdown.
pub(crate) fn scale_m(distance_m: f64) -> f64 {
    distance_m.max(NEAREST_M)
}

impl InverseRange {
    /// Measurements from all fits whose views saw the aircraft, the most precise first.
    pub(crate) fn measurements(&self, observed: &Observation) -> Vec<Measurement> {
        let fits = 0..self.fits.len();
        fits.filter_map(|fit| self.measurement(fit, observed))
            .collect()
    }

    /// Views of a fit, ascending.
    pub(super) fn views_of(&self, fit: usize) -> &[usize] {
        &self.fits[fit].set.views
    }

    /// Distance of a fit's cameras behind the touchdown target, metres.
    pub(crate) fn setback_m(&self, fit: usize) -> f64 {
        self.fits[fit].setback_m
    }

    /// Measurement from one fit; `None` if one of its views is empty, or its formula has no distance at these positions.
    pub(super) fn measurement(&self, number: usize, observed: &Observation) -> Option<Measurement> {
        let fit = &self.fits[number];
        let places = fit.set.places(observed)?;
        let terms = fit.scales.terms(&places);
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

    /// Standard deviations of relative errors on the training side, fit by fit.
    pub(crate) fn deviations(&self) -> impl ExactSizeIterator<Item = f64> {
        self.fits.iter().map(|fit| fit.deviation)
    }

    /// The same fits in the same order with coefficients from other samples. A fit that these samples do not determine stays.
    pub(crate) fn refitted(&self, training: &[&Sample]) -> Self {
        let refitted = |fit: &Fit| {
            let refitted = Fit::at(fit.set.clone(), fit.setback_m, fit.set.rows(training));
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
    /// Standard deviation of the distance due to common errors, metres. Infinite if the formula has no distance next to these positions.
    fn common_sd_m(&self, places: &Places, distance_m: f64, errors: &[CommonError]) -> f64 {
        let variance_m2 = |error: &CommonError| {
            let number = self.set.views.iter().position(|&view| view == error.view)?;
            let steps = error.sd_px.length() / STEP_PX;
            let moved_m = [1.0, -1.0].into_iter().find_map(|direction| {
                let mut moved = places.clone();
                moved.centres_px[number] += direction * error.sd_px / steps;
                self.distance_m(&self.scales.terms(&moved))
            });
            let slope_m = moved_m.map_or(f64::INFINITY, |moved_m| moved_m - distance_m);
            Some((steps * slope_m).powi(2))
        };
        errors.iter().filter_map(variance_m2).sum::<f64>().sqrt()
    }
}
