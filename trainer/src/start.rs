//! Another run as the start of a training: its networks, and the features that they know.
//!
//! The networks need the same layers and mean the same numbers. Features mean what they meant to them: under the same cameras offset and
//! scale are those of the run, and under others they follow from the fitted cameras, as when a camera was moved ([`crate::refit`]).
//! Formulas are fitted to the new flights alone. What the run has learned from, the new one knows, too.

use dataset::corpus::Corpus;
use dataset::splits::Side;
use serde_json::{Value, json};

use crate::config::TrainConfig;
use crate::error::{CorpusFault, Error, Result, RunFault};
use crate::json_differences::json_differences;
use crate::normalisation::Normalisation;
use crate::rig::{are_same, form};
use crate::run_folder::RunFolder;
use crate::samples::Samples;
use crate::sealed_run::SealedRun;
use crate::self_calibration::SelfCalibrated;
use crate::trained_run::{RunSummary, TrainedRun};

/// A run to start from.
pub(crate) struct Start {
    /// The run.
    pub(crate) run: TrainedRun,
    /// BLAKE3 of its weights.
    pub(crate) weights_blake3: String,
}

impl Start {
    /// The run that the settings name; rejects one that does not fit settings or corpus.
    pub(crate) fn of(
        config: &TrainConfig,
        corpus: &Corpus,
        samples: &Samples,
    ) -> Result<Option<Self>> {
        let Some(root) = &config.start_from else {
            return Ok(None);
        };
        let sealed = SealedRun::read(&RunFolder::at(root))?;
        let run = TrainedRun::of(&sealed)?;
        let differences = json_differences(&networks(config), &networks(&run.config));
        if !differences.is_empty() {
            return Err(Error::run(root, RunFault::OtherStart { differences }));
        }
        let [here, there] = [&samples.rig.cameras, &run.summary.cameras].map(form);
        if here != there {
            return Err(Error::run(root, RunFault::OtherViews { here, there }));
        }
        refuse_known_flights(&run.summary, corpus, samples)?;
        let weights = sealed.bytes(RunFolder::WEIGHTS);
        Ok(Some(Self {
            weights_blake3: blake3::hash(weights).to_string(),
            run,
        }))
    }

    /// Offsets and scales that mean to the networks what they know, with the ranges of `fresh`, which was fitted to the new flights.
    pub(crate) fn normalisation(
        &self,
        fresh: Normalisation,
        samples: &Samples,
        fitted: Option<&SelfCalibrated>,
    ) -> Normalisation {
        let known = &self.run.normalisation;
        let are_same = !self.run.summary.cameras_vary
            && !samples.rig.cameras_vary
            && are_same(&self.run.summary.cameras, &samples.rig.cameras);
        let cameras = |fitted: Option<&SelfCalibrated>, view: usize| fitted?.cameras()[view];
        let old = self.run.baselines.self_calibrated.as_ref();
        let mut features = fresh;
        for view in 0..features.views.len() {
            let moved = || {
                let (old, new) = (cameras(old, view)?, cameras(fitted, view)?);
                known.moved(view, &old, &new)
            };
            let learned = match are_same {
                true => Some(known.clone()),
                false => moved(),
            };
            if let Some(learned) = learned {
                features.offset_px[view] = learned.offset_px[view];
                features.scale_px[view] = learned.scale_px[view];
            }
        }
        features
    }
}

/// What the networks of two trainings must have in common.
fn networks(config: &TrainConfig) -> Value {
    let (c, e) = (&config.calibration, &config.estimator);
    json!({
        "loss": config.loss,
        "calibration": {
            "hidden": c.hidden,
            "features": c.features,
            "head_hidden": c.head_hidden,
            "linear_path": c.linear_path,
        },
        "estimator": { "lstm": e.lstm, "head_hidden": e.head_hidden },
        "mono": { "hidden": config.mono.hidden },
    })
}

/// Flights that the networks know cannot judge them.
fn refuse_known_flights(run: &RunSummary, corpus: &Corpus, samples: &Samples) -> Result<()> {
    let is_judge_and_known = |scenario: &&crate::samples::ScenarioSummary| match scenario.side {
        Side::Train => false,
        Side::Validation => run.training_flights.contains(&scenario.flight),
        Side::Test => run.knows(scenario),
    };
    match samples.scenarios.iter().find(is_judge_and_known) {
        None => Ok(()),
        Some(scenario) => {
            let fault = CorpusFault::KnownToStart {
                scenario: scenario.id.clone(),
                trajectory: scenario.trajectory.clone(),
                side: scenario.side,
            };
            Err(Error::corpus(corpus.root(), fault))
        }
    }
}
