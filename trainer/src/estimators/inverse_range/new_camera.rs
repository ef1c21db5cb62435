//! Adaptation to a new camera: the fits that contain its view are refitted to a few approaches, and the network on the residual of one of
//! them continues training.
//!
//! The effect of light and distance on a shift depends on the camera, but not on it alone, and ten approaches show only some light. So the
//! network keeps what it has learned: its expected scale is adjusted to the new camera, its fit is chosen such that both together give the
//! distances of the approaches, and then it continues training at a low rate. The same is done without each part of the approaches in turn,
//! whose errors then decide what is best: the original network, the adapted one, or the formula alone. A single flight does not allow this
//! decision, and the network stays as it was.

use std::fmt;

use dataset::geometry::camera::Camera;
use rand_chacha::ChaCha12Rng;
use serde::{Deserialize, Serialize};

use super::residual::{Residual, answered};
use super::residual_training::{Networks, ResidualTask, Trainee, formula_mape_pct, thinned};
use super::{CrossFitted, Fit, InverseRange};
use crate::config::{Optimisation, ResidualConfig};
use crate::error::Result;
use crate::networks::training_loop::{Companions, learn};
use crate::samples::Sample;
use crate::samples::flight_parts::FlightParts;

/// Steps, and the factor on the learning rate of a training from scratch: on approaches left out in turn (see docs/results.md) the error is
/// lower than after 500 steps at a tenth of the rate.
const STEPS: usize = 1_000;
const RATE_FACTOR: f64 = 0.2;

/// A camera that is to be fitted again.
#[derive(Debug, Clone, Copy)]
pub(crate) struct NewCamera {
    /// Index of its view.
    pub(crate) view: usize,
    /// The old and the new one, as fitted; if one is not known, a network expects aircraft as large as before.
    pub(crate) cameras: Option<[Camera; 2]>,
}

/// Fits for a new camera.
pub(crate) struct Refitted {
    /// In the order of those before.
    pub(crate) fits: CrossFitted,
    /// Outcome for the network on the residual, if a fit of the view had one and there are flights to judge it.
    pub(crate) residual: Option<RefittedResidual>,
}

/// Benefit of a network on the residual for a new camera (`run.json`): errors of `inverse_range` at approaches that were left out in turn
/// from fitting and training, where the fit with the network applies; mean absolute errors, percent of the formula's distance (below 0.5
/// NM: of 0.5 NM).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RefittedResidual {
    /// Of the formula alone.
    pub formula_mape_pct: f64,
    /// With the network as it was.
    pub as_it_was_mape_pct: f64,
    /// With the network trained on.
    pub trained_on_mape_pct: f64,
    /// Outcome with the lowest of these errors.
    pub network: Outcome,
}

/// Outcome for a network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// It stayed.
    AsItWas,
    /// It was trained on.
    TrainedOn,
    /// There is none any more.
    Dropped,
}

impl Outcome {
    fn of_errors(formula: f64, as_it_was: f64, trained_on: f64) -> Self {
        match trained_on < as_it_was {
            _ if formula <= as_it_was.min(trained_on) => Self::Dropped,
            true => Self::TrainedOn,
            false => Self::AsItWas,
        }
    }
}

impl fmt::Display for RefittedResidual {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let outcome = match self.network {
            Outcome::AsItWas => "it is kept as it was",
            Outcome::TrainedOn => "it is trained on",
            Outcome::Dropped => {
                "it is dropped, and a further refit of this run will not have it either"
            }
        };
        write!(
            f,
            "at approaches left out in turn, inverse_range is off by {:.4} % without a network on its residual, by {:.4} % with the network as \
             it was, by {:.4} % with the network trained on; {outcome}",
            self.formula_mape_pct, self.as_it_was_mape_pct, self.trained_on_mape_pct
        )
    }
}

impl InverseRange {
    /// The same fits in the same order for a new camera, with the sets that contain its view fitted to `approaches`; `None` if these are
    /// too few for one of them. `config`: settings of the training of the network.
    pub(crate) fn for_new_camera(
        &self,
        new: NewCamera,
        parts: FlightParts,
        approaches: &[&Sample],
        config: &ResidualConfig,
        random: ChaCha12Rng,
        companions: &mut Companions,
    ) -> Result<Option<Refitted>> {
        let Some(all) = self.alone_with_view_refitted(new.view, approaches) else {
            return Ok(None);
        };
        let others = parts.others(approaches);
        let others = others.map(|others| self.alone_with_view_refitted(new.view, &others));
        let alone = CrossFitted {
            all,
            others: others.collect(),
            parts,
        };
        let Some(known) = self.residual_of_view(new.view) else {
            return Ok(Some(Refitted {
                fits: alone,
                residual: None,
            }));
        };
        let known = Residual {
            inputs: (new.cameras).map_or_else(
                || known.inputs.clone(),
                |cameras| known.inputs.for_new_camera(new.view, cameras, approaches),
            ),
            layers: known.layers.clone(),
        };
        let corrected = alone.corrected(&known, approaches);
        let refitted =
            corrected.trained_on(alone, &known, approaches, config, random, companions)?;
        Ok(Some(refitted))
    }

    /// The sets that contain the view fitted again to these approaches, without a network on one of them.
    fn alone_with_view_refitted(&self, view: usize, approaches: &[&Sample]) -> Option<Self> {
        let refitted = |fit: &Fit| match fit.set.views.contains(&view) {
            true => Fit::of(fit.set.clone(), approaches),
            false => Some(fit.clone()),
        };
        Some(Self {
            fits: self.fits.iter().map(refitted).collect::<Option<_>>()?,
            residual: self.without(view).residual,
        })
    }

    /// The same with this network, and its fit such that both together give the distances. `with_error`: samples at the distances that the
    /// fit must give.
    fn corrected(&self, residual: &Residual, with_error: &[&Sample]) -> Option<Self> {
        let mut corrected = self.clone();
        let fit = &mut corrected.fits[residual.fit()];
        *fit = Fit::of(fit.set.clone(), with_error)?;
        corrected.residual = Some(residual.clone());
        Some(corrected)
    }
}

impl CrossFitted {
    /// All of them with this network; a part that does not determine its fit then has none.
    fn corrected(&self, residual: &Residual, approaches: &[&Sample]) -> Self {
        let with_error = approaches.iter().map(|sample| residual.with_error(sample));
        let with_error: Vec<Sample> = with_error.collect();
        let with_error: Vec<&Sample> = with_error.iter().collect();
        let others = self.parts.others(&with_error).zip(&self.others);
        let others = others.map(|(others, fits)| fits.as_ref()?.corrected(residual, &others));
        let all = self.all.corrected(residual, &with_error);
        Self {
            others: others.collect(),
            // Samples that determine a fit alone also determine it with any other distances.
            all: all.unwrap_or_else(|| self.all.clone()),
            parts: self.parts.clone(),
        }
    }

    /// Chooses the best: these fits, with the network trained on or as it was, or the formulas alone.
    fn trained_on(
        mut self,
        alone: Self,
        known: &Residual,
        approaches: &[&Sample],
        config: &ResidualConfig,
        random: ChaCha12Rng,
        companions: &mut Companions,
    ) -> Result<Refitted> {
        let fit = known.fit();
        let inside = |part| {
            let ticks = approaches.iter().copied();
            let inside = ticks.filter(|tick| self.parts.contains(part, tick));
            inside.collect::<Vec<&Sample>>()
        };
        let trainee = |fits: &InverseRange, learned_from: &[&Sample], judges: &[&Sample]| {
            let learned_from = thinned(answered(fits, fit, learned_from));
            let judges = answered(fits, fit, judges);
            Trainee::of(known.inputs.clone(), &learned_from, &judges)
        };
        let mut judges_of_alone = Vec::new();
        let of_all = trainee(&self.all, approaches, &[]);
        let mut pairs = Vec::from_iter(of_all.map(|trainee| (trainee, &mut self.all)));
        let others = self.parts.others(approaches).zip(&mut self.others);
        for ((part, (learned_from, fits)), alone) in others.enumerate().zip(&alone.others) {
            let inside = inside(part);
            if let (Some(fits), Some(alone)) = (fits, alone)
                && let Some(trainee) = trainee(fits, &learned_from, &inside)
            {
                judges_of_alone.extend(answered(alone, fit, &inside));
                pairs.push((trainee, fits));
            }
        }
        let (trainees, trained): (Vec<_>, Vec<_>) = pairs.into_iter().unzip();
        if !trainees.iter().any(Trainee::is_judged) {
            let said = "no other flight tells whether the network on the residual of inverse_range helps: it stays as it was";
            companions.watch.say(said);
            return Ok(Refitted {
                fits: self,
                residual: None,
            });
        }
        let settings = Optimisation {
            steps: STEPS,
            batch_size: config.optimisation.batch_size,
            learning_rate: RATE_FACTOR * config.optimisation.learning_rate,
        };
        let mut task = ResidualTask {
            trainees: &trainees,
            batch_size: settings.batch_size,
            random,
        };
        let as_it_was = Networks::alike(&known.layers, trainees.len());
        let as_it_was_mape_pct = task.error_pct(&as_it_was);
        let kept = learn(&mut task, as_it_was, &settings, companions)?;
        let formula_mape_pct = formula_mape_pct(&judges_of_alone);
        let trained_on_mape_pct = kept.error_pct;
        let record = RefittedResidual {
            formula_mape_pct,
            as_it_was_mape_pct,
            trained_on_mape_pct,
            network: Outcome::of_errors(formula_mape_pct, as_it_was_mape_pct, trained_on_mape_pct),
        };
        companions.watch.say(&record.to_string());
        if record.network == Outcome::TrainedOn {
            for (fits, residual) in trained.into_iter().zip(kept.network.residuals(trainees)) {
                fits.residual = Some(residual);
            }
        }
        Ok(Refitted {
            fits: match record.network {
                Outcome::Dropped => alone,
                Outcome::AsItWas | Outcome::TrainedOn => self,
            },
            residual: Some(record),
        })
    }
}

#[cfg(test)]
mod tests;
