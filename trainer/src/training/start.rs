//! Start of a training from an earlier run's networks and features.
//!
//! The networks need the same layers, and numbers with the same meaning. If the cameras are the same, offset and scale of the features are
//! taken from the run; otherwise they follow from the fitted cameras, as for a camera that was moved ([`crate::training::refit`]). Formulas
//! are fitted to the new flights alone. Flights that the run learned from also count as known to the new one.

use dataset::corpus::Corpus;
use dataset::corpus::splits::Side;
use serde_json::{Value, json};

use crate::config::TrainConfig;
use crate::error::{Error, Result};
use crate::estimators::geometry::self_calibration::SelfCalibrated;
use crate::networks::normalisation::Normalisation;
use crate::run::folder::RunFolder;
use crate::run::sealed::SealedRun;
use crate::run::trained::{RunSummary, TrainedRun};
use crate::samples::Samples;
use crate::samples::rig::json_differences::json_differences;
use crate::samples::rig::{are_same, form};

/// Run to start from.
pub(crate) struct Start {
    pub(crate) run: TrainedRun,
    pub(crate) weights_blake3: String,
}

impl Start {
    /// Reads the run that the settings name; rejects it if it does not fit settings or corpus.
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
            let fault = format!(
                "has other networks than this training, which cannot start from them; here, and there: {}; train with the settings of \
                 its config.json",
                differences.join("; ")
            );
            return Err(Error::run(root, fault));
        }
        let [here, there] = [&samples.rig.cameras, &run.summary.cameras].map(form);
        if here != there {
            let fault = format!(
                "was trained with the views {there}, and the corpus has {here}; start from a run with the same views and image sizes"
            );
            return Err(Error::run(root, fault));
        }
        refuse_known_flights(&run.summary, corpus, samples)?;
        let weights = sealed.bytes(RunFolder::WEIGHTS);
        Ok(Some(Self {
            weights_blake3: blake3::hash(weights).to_string(),
            run,
        }))
    }

    /// Offsets and scales that the networks were trained with, and the ranges of `fresh`, which was fitted to the new flights.
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
            let learned = if are_same {
                Some(known.clone())
            } else {
                moved()
            };
            if let Some(learned) = learned {
                features.offset_px[view] = learned.offset_px[view];
                features.scale_px[view] = learned.scale_px[view];
            }
        }
        features
    }
}

/// Settings that the networks of two trainings must share.
fn networks(config: &TrainConfig) -> Value {
    let (c, e) = (&config.calibration, &config.estimator);
    json!({
        "loss": config.loss,
        "target_unit_nm": config.target_unit_nm,
        "calibration": {
            "hidden": c.hidden,
            "features": c.features,
            "head_hidden": c.head_hidden,
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
            let fault = format!(
                "scenario {} flies {} on the {} side, and the run to start from has learned from that flight; start from another run, \
                 or put the flight on the training side",
                scenario.id, scenario.trajectory, scenario.side
            );
            Err(Error::corpus(corpus.root(), fault))
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::{Path, PathBuf};

    use dataset::corpus::splits::Splits;
    use dataset::work::watch::Silent;
    use testkit::synthetic::{Changed, SyntheticCorpus};

    use super::*;
    use crate::config::{CalibrationConfig, EstimatorConfig, MonoConfig, Optimisation};
    use crate::training::train;

    fn settings(steps: usize, learning_rate: f64, start_from: Option<PathBuf>) -> TrainConfig {
        let optimisation = || Optimisation {
            steps,
            batch_size: 64,
            learning_rate,
        };
        TrainConfig {
            start_from,
            calibration: CalibrationConfig {
                hidden: vec![16],
                features: 16,
                head_hidden: vec![16],
                optimisation: optimisation(),
                ..CalibrationConfig::default()
            },
            estimator: EstimatorConfig {
                lstm: vec![16],
                head_hidden: vec![16],
                optimisation: optimisation(),
                ..EstimatorConfig::default()
            },
            mono: MonoConfig {
                hidden: vec![16],
                optimisation: optimisation(),
                ..MonoConfig::default()
            },
            ..TrainConfig::default()
        }
    }

    /// Starts from the run in this folder, with a negligible learning rate.
    fn continued(folder: &Path) -> TrainConfig {
        settings(1, 1e-9, Some(folder.join("run")))
    }

    fn trained(folder: &Path, corpus: &SyntheticCorpus) -> (Corpus, f64) {
        let corpus = corpus.write(&folder.join("corpus")).unwrap();
        let out = folder.join("run");
        let outcome = train(&corpus, &out, &settings(400, 4e-3, None), &Silent).unwrap();
        (corpus, outcome.validation_mape_pct)
    }

    fn error_pct(folder: &Path, corpus: &Corpus, config: &TrainConfig) -> f64 {
        let outcome = train(corpus, &folder.join("other"), config, &Silent);
        outcome.unwrap().validation_mape_pct
    }

    fn refusal(folder: &Path, corpus: &Corpus, config: &TrainConfig) -> String {
        let outcome = train(corpus, &folder.join("other"), config, &Silent);
        outcome.unwrap_err().to_string()
    }

    #[test]
    fn a_training_starts_with_what_a_run_knows_also_under_a_moved_camera() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let corpus = SyntheticCorpus {
            train: 10,
            ..SyntheticCorpus::tiny()
        };
        let moved = SyntheticCorpus {
            changed: Some(Changed {
                view: "left",
                turned_deg: 2.0,
                zoom: 1.1,
            }),
            ..corpus.clone()
        };
        let (corpus, learned) = trained(folder, &corpus);
        let same = error_pct(folder, &corpus, &continued(folder));
        assert!((same / learned - 1.0).abs() < 1e-3, "{same} {learned}");
        let moved = moved.write(&folder.join("moved")).unwrap();
        let moved = error_pct(folder, &moved, &continued(folder));
        assert!(moved < 1.5 * learned, "{moved} {learned}");
        let random = error_pct(folder, &corpus, &settings(1, 1e-9, None));
        assert!(random > 3.0 * learned, "{random} {learned}");
    }

    #[test]
    fn what_does_not_fit_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let (corpus, _) = trained(folder, &SyntheticCorpus::tiny());
        let mut wider = continued(folder);
        wider.estimator.lstm = vec![24];
        let message = refusal(folder, &corpus, &wider);
        assert!(message.contains("estimator.lstm[0] 24 and 16"), "{message}");

        let mut samples = Samples::read(&corpus, None).unwrap();
        samples.rig.cameras.remove("left");
        let message = Start::of(&continued(folder), &corpus, &samples);
        let message = message.err().unwrap().to_string();
        assert!(message.contains("left 1920x1280"), "{message}");

        // A training flight of the run becomes one that judges.
        let mut splits = Splits::read(&corpus.splits_path()).unwrap();
        let id = splits.side(Side::Train).next().unwrap().to_owned();
        for side in [Side::Validation, Side::Test] {
            splits.scenarios.get_mut(&id).unwrap().side = side;
            splits.write(&corpus.splits_path()).unwrap();
            let message = refusal(folder, &corpus, &continued(folder));
            assert!(
                message.contains(&format!("scenario {id}")) && message.contains("learned from"),
                "{message}"
            );
        }
        let nowhere = settings(1, 1e-9, Some(folder.join("nowhere")));
        let message = refusal(folder, &corpus, &nowhere);
        assert!(message.contains("no training finished there"), "{message}");
    }
}
