//! `inverse_range_filtered` and `inverse_range_smoothed`: a causal filter and an offline smoother for the distance over a whole flight,
//! from the measurements of [`crate::estimators::inverse_range`].
//!
//! The unknowns are distance to touchdown, ground speed and acceleration ([`motion`]), and the smooth part of each fit's error
//! ([`correlated_error`]), because such errors last for many ticks. At a tick any views may be missing: the most precise available fit
//! corrects the distance; without a measurement the filter only predicts. Like those fits, the filter hardly depends on the calibration.
//!
//! Input: observations during a flight in temporal order. Output: per tick distance, ground speed and time to touchdown, each with a
//! standard deviation and a 90 % interval. The flight's own misfits reveal outliers and error sizes ([`forward`]); interval
//! widths are chosen to hold 90 % ([`held_share`]) of the labels on flights that the fits did not see ([`labelled_flight`]).
//!
//! Intervals also grow with common errors ([`widening`]). Views that contradict each other for some time are not used
//! ([`super::contradiction`]).
//!
//! The measurements are distances, because a fit's formula inverts exactly: the filter is linear.

mod backward;
mod correlated_error;
mod estimate;
mod forward;
mod gaussian;
mod held_share;
mod hypothesis;
mod labelled_flight;
mod mixture;
mod motion;
mod widening;

use std::borrow::Borrow;

use dataset::numbers::spread::Spread;
use serde::{Deserialize, Serialize};

use crate::estimators::inverse_range::contradiction::{
    Contradiction, ContradictionWatch, KeptInTraining, Withheld, without_contradictions,
};
use crate::estimators::inverse_range::{CrossFitted, InverseRange, Measurement, Tick};
use crate::networks::normalisation::Normalisation;
use crate::samples::sides::flight_parts::MAX_PARTS;
use crate::samples::{Observation, Sample, Samples};

use backward::smooth;
use correlated_error::CorrelatedError;
use estimate::HalfWidths;
pub(crate) use estimate::{Estimate, Estimated};
use forward::{Filter, filter};
use hypothesis::Model;
use labelled_flight::LabelledFlight;
use motion::Motion;
pub(crate) use widening::Knowing;
use widening::{LastCommonError, common_sds_per_m};

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct FlightFilter {
    motion: Motion,
    /// Errors of the fits in `inverse_range`, in their order.
    errors: Vec<CorrelatedError>,
    /// Usual time between ticks in training, seconds.
    tick_s: f64,
    pub(crate) kept: KeptInTraining,
    /// Interval half widths for the filter.
    filtered: HalfWidths,
    /// Interval half widths for the smoother.
    smoothed: HalfWidths,
}

/// Live filter for one aircraft, with bounded memory.
#[derive(Clone)]
pub(crate) struct OnlineFilter {
    filter: Filter,
    common: LastCommonError,
}

impl FlightFilter {
    /// Fits motion, errors and intervals to training flights, held out from the fits in turn, and to validation flights.
    pub(crate) fn fit(
        fits: &CrossFitted,
        samples: &Samples,
        normalisation: &Normalisation,
    ) -> Self {
        let believed = |observed: &Observation| normalisation.without_outliers(observed, false);
        let flights = LabelledFlight::held_out(fits, samples, believed);
        let mut fitted = Self::fit_to(&flights, fits.all.deviations());
        fitted.kept = fitted.kept_in(&fits.all, &flights);
        fitted
    }

    fn kept_in(&self, fits: &InverseRange, flights: &[LabelledFlight]) -> KeptInTraining {
        let flights = flights.iter().map(|flight| flight.ticks.as_slice());
        KeptInTraining::of(fits, |of| self.variance_m2(of), flights)
    }

    /// Copy for another airport, where other paths are usual.
    pub(crate) fn elsewhere(mut self) -> Self {
        self.kept.paths = None;
        self
    }

    /// Copy for a new camera: the errors of fits with its view are estimated from its approaches, each measured by fits that did not see
    /// it. A single approach changes no errors.
    pub(crate) fn with_camera_refitted(
        &self,
        view: usize,
        fits: &CrossFitted,
        approaches: &[&Sample],
        normalisation: &Normalisation,
    ) -> Self {
        let believed = |observed: &Observation| normalisation.without_outliers(observed, false);
        let flights = LabelledFlight::left_out(fits, approaches, believed);
        let errors = self.errors.iter().zip(fits.all.contain(view)).enumerate();
        let errors = errors.map(|(fit, (known, is_of_view))| {
            let errors: Vec<_> = flights.iter().map(|flight| flight.errors_of(fit)).collect();
            let fitted = is_of_view.then(|| CorrelatedError::fit(&errors)).flatten();
            fitted.unwrap_or_else(|| known.clone())
        });
        Self {
            errors: errors.collect(),
            ..self.clone()
        }
    }

    /// Copy without the errors of fits with this view.
    pub(crate) fn without(&self, view: usize, fits: &InverseRange) -> Self {
        let errors = self.errors.iter().zip(fits.contain(view));
        let others = errors.filter(|(_, is_of_view)| !is_of_view);
        Self {
            errors: others.map(|(error, _)| error.clone()).collect(),
            ..self.clone()
        }
    }

    /// `deviations`: standard deviations for fits without any measured errors.
    fn fit_to(flights: &[LabelledFlight], deviations: impl Iterator<Item = f64>) -> Self {
        let labels: Vec<_> = flights.iter().map(LabelledFlight::labels).collect();
        let errors_of = |fit: usize, is_used: &dyn Fn(&LabelledFlight) -> bool| -> Vec<_> {
            let used = flights.iter().filter(|flight| is_used(flight));
            used.map(|flight| flight.errors_of(fit)).collect()
        };
        let errors = deviations.enumerate().map(|(fit, deviation)| {
            let fitted = CorrelatedError::fit(&errors_of(fit, &|_| true));
            fitted.unwrap_or_else(|| CorrelatedError::of_deviation(deviation))
        });
        let mut fitted = Self {
            motion: Motion::fit(&labels),
            errors: errors.collect(),
            tick_s: usual_tick_s(flights).unwrap_or(1.0),
            kept: KeptInTraining::default(),
            filtered: HalfWidths::NORMAL,
            smoothed: HalfWidths::NORMAL,
        };
        // Each part is evaluated with error sizes from the other flights, like a new flight.
        let parts: Vec<Self> = (0..MAX_PARTS)
            .map(|part| {
                let is_outside = |flight: &LabelledFlight| flight.flown % MAX_PARTS != part;
                let errors = fitted.errors.iter().enumerate();
                let of_others = errors
                    .map(|(fit, error)| error.with_deviations_of(&errors_of(fit, &is_outside)));
                Self {
                    errors: of_others.collect(),
                    ..fitted.clone()
                }
            })
            .collect();
        let widths = |knowing| {
            HalfWidths::fit(flights, |flight| {
                parts[flight.flown % MAX_PARTS].of_ticks(&flight.ticks, knowing)
            })
        };
        let (filtered, smoothed) = (widths(Knowing::Past), widths(Knowing::All));
        fitted.filtered = filtered;
        fitted.smoothed = smoothed;
        fitted
    }

    /// Estimates for one flight, tick by tick; `None` before the first measurement, and while the distance is too uncertain. `fits` are the
    /// fits that the filter was trained with.
    pub(crate) fn predict(
        &self,
        fits: &InverseRange,
        flight: &[Observation],
        knowing: Knowing,
    ) -> Vec<Option<Estimate>> {
        let parts = flight.chunk_by(|_, next| !next.restarts);
        let estimates = parts.flat_map(|part| self.of_ticks(&ticks(fits, part), knowing));
        estimates.collect()
    }

    /// A filter for a new aircraft.
    pub(crate) fn online(&self) -> OnlineFilter {
        let fits = (0..self.errors.len()).collect();
        OnlineFilter {
            filter: Filter::new(fits),
            common: LastCommonError::default(),
        }
    }

    /// Estimate at the next tick, equal to [`Self::predict`] with past ticks.
    pub(crate) fn next(&self, online: &mut OnlineFilter, tick: &Tick) -> Option<Estimate> {
        let common_sd_per_m = online.common.after(tick);
        let known = online.filter.take(self.model(), tick)?;
        self.filtered
            .estimate(&self.motion, &known, common_sd_per_m)
    }

    /// Slowly varying measurement error as a standard deviation, metres, its half-life, seconds, and standard deviation of the new error
    /// per tick, metres.
    pub(crate) fn deviations_m(&self, measurement: &Measurement) -> (f64, f64, f64) {
        let error = &self.errors[measurement.fit];
        let [smooth_m, new_m] = error.parts_m(measurement, measurement.distance_m);
        (smooth_m, error.half_time_s, new_m)
    }

    /// Variance of a measurement with all errors, square metres.
    fn variance_m2(&self, of: &Measurement) -> f64 {
        let (slow_m, _, new_m) = self.deviations_m(of);
        slow_m.powi(2) + new_m.powi(2) + of.common_sd_m.powi(2)
    }

    /// Takes the next tick of an aircraft into its watch for contradictions.
    pub(crate) fn contradiction(
        &self,
        watch: &mut ContradictionWatch,
        fits: &InverseRange,
        seen: (&Observation, &Tick),
    ) -> Option<Contradiction> {
        watch.take((fits, self.kept), |of| self.variance_m2(of), seen)
    }

    /// A flight without the boxes of views that contradict each other, and the contradictions. `followed`: the number of the aircraft and
    /// the tick with its boxes.
    pub(crate) fn without_contradictions(
        &self,
        fits: &InverseRange,
        followed: Vec<(Option<usize>, Observation)>,
    ) -> (Vec<Observation>, Vec<Withheld>) {
        without_contradictions(followed, |watch, observed| {
            self.contradiction(watch, fits, (observed, &Tick::of(fits, observed)))
        })
    }

    fn model(&self) -> Model<'_> {
        Model {
            motion: &self.motion,
            errors: &self.errors,
            tick_s: self.tick_s,
        }
    }

    fn of_ticks(&self, ticks: &[Tick], knowing: Knowing) -> Vec<Option<Estimate>> {
        let model = self.model();
        let filtered = filter(model, ticks);
        let (widths, known) = match knowing {
            Knowing::Past => (&self.filtered, filtered.known),
            Knowing::All => (&self.smoothed, smooth(model, ticks, &filtered.decisions)),
        };
        let estimates = known.iter().zip(common_sds_per_m(ticks, knowing));
        let estimates = estimates.map(|(known, common_sd_per_m)| {
            widths.estimate(&self.motion, known.as_ref()?, common_sd_per_m)
        });
        estimates.collect()
    }

    /// True if there is an error for each fit, and all numbers are plausible.
    pub(crate) fn is_of(&self, fits: &InverseRange) -> bool {
        let whole = |error: &CorrelatedError| {
            !error.distances_m.is_empty()
                && error.distances_m.len() == error.deviations.len()
                && error.distances_m.is_sorted()
                && error.new_share < 1.0
        };
        self.errors.len() == fits.deviations().len()
            && self.errors.iter().all(whole)
            && self.kept.is_possible()
            && self.constants().all(|number| number > 0.0)
    }

    fn constants(&self) -> impl Iterator<Item = f64> {
        let motion = &self.motion;
        let errors = self.errors.iter().flat_map(|error| {
            let distances = error.distances_m.iter();
            let numbers = distances.chain(&error.deviations).copied();
            numbers.chain([error.new_share, error.half_time_s])
        });
        [
            motion.mean_speed_mps,
            motion.speed_sd_mps,
            motion.acceleration_sd_mps2,
            motion.acceleration_time_s,
            self.tick_s,
        ]
        .into_iter()
        .chain(errors)
        .chain(self.filtered.to_array())
        .chain(self.smoothed.to_array())
    }
}

/// Median time between ticks, seconds; `None` without any.
fn usual_tick_s(flights: &[LabelledFlight]) -> Option<f64> {
    let between = |flight: &LabelledFlight| -> Vec<f64> {
        let pairs = flight.ticks.windows(2);
        pairs.map(|pair| pair[1].time_s - pair[0].time_s).collect()
    };
    let usual = Spread::of(flights.iter().flat_map(between).collect())?;
    (usual.median > 0.0).then_some(usual.median)
}

/// Measurements at each tick in a flight.
fn ticks<O: Borrow<Observation>>(
    fits: &InverseRange,
    flight: impl IntoIterator<Item = O>,
) -> Vec<Tick> {
    let tick = |observed: O| Tick::of(fits, observed.borrow());
    flight.into_iter().map(tick).collect()
}

#[cfg(test)]
mod tests;
