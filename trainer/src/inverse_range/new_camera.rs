//! A new camera: the fits that contain its view learn it from a few approaches, and the network on the residual of one of them is trained
//! on.
//!
//! What light and distance do to a shift depends on the camera, too, but not on it alone, and approaches in one light do not tell all. So
//! the network goes on from what it knows: it expects the scale that the new focal length gives, its fit is such that both together give
//! the distances of the approaches, and then it is trained on at a low rate. Approaches that fits and networks did not see, each in turn,
//! tell what is best: the network as it was, as it came to be, or a fit without it.

use rand_chacha::ChaCha12Rng;

use super::residual::{Residual, answered};
use super::residual_training::{
    Networks, ResidualRecord, ResidualTask, Trainee, formula_mape_pct, thinned,
};
use super::{CrossFitted, Fit, InverseRange};
use crate::config::{Optimisation, ResidualConfig};
use crate::error::Result;
use crate::flight_parts::FlightParts;
use crate::samples::Sample;
use crate::training_loop::{Watch, learn};

/// Steps.
const STEPS: usize = 1_000;
/// Part of the learning rate of a training from the start.
const RATE: f64 = 0.2;

/// A camera that is to be fitted again.
#[derive(Debug, Clone, Copy)]
pub(crate) struct NewCamera {
    /// Index of its view.
    pub(crate) view: usize,
    /// Its focal length over that of the old camera; without it a network on the residual of a fit of it is dropped.
    pub(crate) zoom: Option<f64>,
}

/// Fits for a new camera.
pub(crate) struct Refitted {
    /// In the order of those before.
    pub(crate) fits: CrossFitted,
    /// What the network on the residual is worth for the new camera, if there was one and other approaches could judge it.
    pub(crate) residual: Option<ResidualRecord>,
}

impl InverseRange {
    /// The same fits in the same order for a new camera, those of sets that contain its view fitted to `approaches`; `None` if these are
    /// too few for one of them. `config` is that of the training of its network.
    pub(crate) fn for_new_camera(
        &self,
        new: NewCamera,
        parts: &FlightParts,
        approaches: &[&Sample],
        config: &ResidualConfig,
        random: ChaCha12Rng,
        watch: &mut Watch,
    ) -> Result<Option<Refitted>> {
        let refit = RefitOfView {
            before: self,
            view: new.view,
            parts,
            approaches,
        };
        let known = self.residual.as_ref().filter(|_| self.corrects(new.view));
        let Some(alone) = refit.with(None) else {
            return Ok(None);
        };
        let with_network = match known.zip(new.zoom) {
            None => None,
            Some((known, zoom)) => {
                let known = Residual {
                    inputs: known.inputs.clone().zoomed(new.view, zoom),
                    layers: known.layers.clone(),
                };
                refit.trained_on(&known, &alone, config, random, watch)?
            }
        };
        Ok(Some(match with_network {
            None => Refitted {
                fits: alone,
                residual: None,
            },
            Some((fits, record)) => Refitted {
                fits: if record.is_kept() { fits } else { alone },
                residual: Some(record),
            },
        }))
    }

    /// Those of sets that contain the view fitted again to these approaches. `residual`: the network on one of them.
    fn with_view_refitted(
        &self,
        view: usize,
        residual: Option<&Residual>,
        approaches: &[&Sample],
    ) -> Option<Self> {
        let refitted = |(number, fit): (usize, &Fit)| {
            if !fit.set.views.contains(&view) {
                return Some(fit.clone());
            }
            match residual.filter(|of| of.fit() == number) {
                None => Fit::of(fit.set.clone(), approaches),
                Some(residual) => {
                    let with_error = approaches.iter().map(|sample| residual.with_error(sample));
                    let with_error: Vec<Sample> = with_error.collect();
                    Fit::of(fit.set.clone(), &with_error.iter().collect::<Vec<_>>())
                }
            }
        };
        let fits = self.fits.iter().enumerate().map(refitted);
        let kept = self.residual.as_ref().filter(|_| !self.corrects(view));
        Some(Self {
            fits: fits.collect::<Option<_>>()?,
            residual: residual.or(kept).cloned(),
        })
    }
}

/// What is fitted again, and to what.
struct RefitOfView<'a> {
    before: &'a InverseRange,
    view: usize,
    parts: &'a FlightParts,
    approaches: &'a [&'a Sample],
}

impl RefitOfView<'_> {
    /// `residual`: the network on the residual of one of the view's fits.
    fn with(&self, residual: Option<&Residual>) -> Option<CrossFitted> {
        let refitted = |approaches: &[&Sample]| {
            self.before
                .with_view_refitted(self.view, residual, approaches)
        };
        let others = self.parts.others(self.approaches);
        Some(CrossFitted {
            all: refitted(self.approaches)?,
            others: others.map(|others| refitted(&others)).collect(),
            parts: self.parts.clone(),
        })
    }

    /// With the network trained on, and what it is worth beside the fits alone; `None` if no approach can judge it.
    fn trained_on(
        &self,
        known: &Residual,
        alone: &CrossFitted,
        config: &ResidualConfig,
        random: ChaCha12Rng,
        watch: &mut Watch,
    ) -> Result<Option<(CrossFitted, ResidualRecord)>> {
        let Some(mut fits) = self.with(Some(known)) else {
            return Ok(None);
        };
        let judged = |fits: &CrossFitted| {
            let trainees = self.trainees(known, fits);
            trainees.filter(|trainees| trainees.iter().any(Trainee::is_judged))
        };
        let (Some(formulas), Some(trainees)) = (judged(alone), judged(&fits)) else {
            return Ok(None);
        };
        let settings = Optimisation {
            steps: STEPS,
            batch_size: config.optimisation.batch_size,
            learning_rate: RATE * config.optimisation.learning_rate,
        };
        let mut task = ResidualTask {
            trainees: &trainees,
            batch_size: settings.batch_size,
            random,
        };
        let as_it_was = Networks::alike(&known.layers, trainees.len());
        let error_pct = task.error_pct(&as_it_was);
        let trained = learn(&mut task, as_it_was.clone(), &settings, watch)?;
        let (networks, error_pct) = match trained.error_pct < error_pct {
            true => (trained.network, trained.error_pct),
            false => (as_it_was, error_pct),
        };
        let record = ResidualRecord {
            formula_mape_pct: formula_mape_pct(&formulas),
            corrected_mape_pct: error_pct,
        };
        watch
            .progress
            .say(&record.said_of("approaches left out in turn"));
        let others = fits.others.iter_mut().flatten();
        let residuals = networks.residuals(trainees);
        for (fits, residual) in std::iter::once(&mut fits.all).chain(others).zip(residuals) {
            fits.residual = Some(residual);
        }
        Ok(Some((fits, record)))
    }

    /// What the networks of all fits learn from, and what judges those that did not see it; `None` if one has nothing to learn from.
    fn trainees(&self, known: &Residual, fits: &CrossFitted) -> Option<Vec<Trainee>> {
        let trainee = |fits: &InverseRange, learned_from: &[&Sample], judges: &[&Sample]| {
            let learned_from = thinned(answered(fits, known.fit(), learned_from));
            let judges = answered(fits, known.fit(), judges);
            Trainee::of(known.inputs.clone(), &learned_from, &judges)
        };
        let others = self.parts.others(self.approaches).zip(&fits.others);
        let of_parts = others.enumerate().filter_map(|(part, (others, fits))| {
            let inside = self.approaches.iter().copied();
            let inside = inside.filter(|tick| self.parts.contains(part, tick));
            Some(trainee(
                fits.as_ref()?,
                &others,
                &inside.collect::<Vec<_>>(),
            ))
        });
        std::iter::once(trainee(&fits.all, self.approaches, &[]))
            .chain(of_parts)
            .collect()
    }
}

#[cfg(test)]
mod tests;
