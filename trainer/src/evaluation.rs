//! Accuracy of a run on unseen trajectories: `metrics.json`, `predictions.parquet` and `report.html`.

use std::collections::BTreeSet;
use std::ops::RangeInclusive;

use dataset::columns::TableWriter;
use dataset::corpus::Corpus;
use dataset::json_file::write_json_unsynced;
use dataset::splits::Side;
use serde::{Deserialize, Serialize};

use crate::error::{CorpusFault, Error, Result};
use crate::estimator::{Estimator, Task};
use crate::metrics::{
    EstimatorMetrics, EstimatorOutcomes, Metrics, Outcome, SideCount, SplitSummary,
};
use crate::report;
use crate::rig::{Rig, are_same, form};
use crate::run_folder::RunFolder;
use crate::run_place::RunPlace;
use crate::samples::{DistanceRange, FARTHEST_NM, Sample, Samples};
use crate::sealed_run::SealedRun;
use crate::trained_run::{RunSummary, TrainedRun};
use dataset::progress::Progress;

/// Range of sensible widths of the distance bins, nautical miles.
const BIN_WIDTHS_NM: RangeInclusive<f64> = 0.01..=1_000.0;

/// Settings of an evaluation; saved as `evaluation.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EvaluationConfig {
    /// Minimum distance to the touchdown target, nautical miles. A percentage explodes near zero; the authors' code leaves out the
    /// last nautical mile.
    pub min_dtd_nm: f64,
    /// Maximum distance to the touchdown target, nautical miles.
    pub max_dtd_nm: Option<f64>,
    /// Width of the distance bins, nautical miles.
    pub distance_bin_nm: f64,
    /// Hash of the detection model; by default the training's.
    pub model_hash: Option<String>,
}

impl Default for EvaluationConfig {
    fn default() -> Self {
        Self {
            min_dtd_nm: 1.0,
            max_dtd_nm: None,
            distance_bin_nm: 1.0,
            model_hash: None,
        }
    }
}

impl EvaluationConfig {
    fn check(&self) -> Result<()> {
        let refuse = |setting, found: f64, expected| {
            Err(Error::Setting {
                setting,
                found: format!("{found:?}"),
                expected,
            })
        };
        if !(0.0..=FARTHEST_NM).contains(&self.min_dtd_nm) {
            let expected = format!("a number from 0 to {FARTHEST_NM}");
            return refuse("evaluation min_dtd_nm", self.min_dtd_nm, expected);
        }
        if let Some(max) = self.max_dtd_nm
            && !(max > self.min_dtd_nm && max <= FARTHEST_NM)
        {
            let expected = format!("a number above min_dtd_nm, at most {FARTHEST_NM}");
            return refuse("evaluation max_dtd_nm", max, expected);
        }
        if !BIN_WIDTHS_NM.contains(&self.distance_bin_nm) {
            let [least, most] = [BIN_WIDTHS_NM.start(), BIN_WIDTHS_NM.end()];
            let expected = format!("a number from {least} to {most}");
            return refuse("evaluation distance_bin_nm", self.distance_bin_nm, expected);
        }
        Ok(())
    }
}

/// Evaluates a run on the test side of a corpus and adds the results to the run, which is replaced by one with the same networks
/// and all results of this evaluation.
pub fn evaluate(
    run: &RunFolder,
    corpus: &Corpus,
    config: &EvaluationConfig,
    progress: &mut dyn Progress,
) -> Result<Metrics> {
    config.check()?;
    let place = RunPlace::take_existing(run)?;
    let sealed = SealedRun::read(&place.run())?;
    let trained = TrainedRun::of(&sealed)?;
    let range = DistanceRange {
        min_nm: config.min_dtd_nm,
        max_nm: config.max_dtd_nm,
    };
    let model_hash = config
        .model_hash
        .as_ref()
        .unwrap_or(&trained.summary.model_hash);
    let samples = Samples::read(corpus, Some(model_hash), range)?;
    check_fit(run, corpus, &trained, &samples)?;
    let test = samples.of_side(Side::Test);
    if test.is_empty() {
        let min_dtd_nm = config.min_dtd_nm;
        let fault = CorpusFault::NoTestSamples { min_dtd_nm };
        return Err(Error::corpus(corpus.root(), fault));
    }
    progress.begin("evaluation", Estimator::ALL.len() as u64);
    let boxes = |samples: &[&Sample]| samples.iter().map(|s| s.detections()).sum::<usize>();
    let found = boxes(&test);
    let other_cameras = samples.rig.cameras_vary && !trained.summary.cameras_vary;
    let test: Vec<Sample> = test
        .into_iter()
        .map(|sample| {
            trained
                .normalisation
                .without_outliers(sample, other_cameras)
        })
        .collect();
    let test: Vec<&Sample> = test.iter().collect();
    let predictions = predict_all(&trained, &samples, &test, progress);
    let bin_nm = config.distance_bin_nm;
    let metrics = Metrics {
        split: split_summary(&trained, &samples, config),
        disbelieved_boxes: found - boxes(&test),
        estimators: predictions
            .iter()
            .map(|p| {
                let name = p.estimator.name().to_owned();
                (name, EstimatorMetrics::of(&p.outcomes, bin_nm))
            })
            .collect(),
    };
    let new = place.begin()?;
    sealed.write(&new)?;
    write_json_unsynced(&new.evaluation_path(), config)?;
    write_predictions(&new, &samples, &test, &predictions)?;
    write_json_unsynced(&new.metrics_path(), &metrics)?;
    report::write(
        &new,
        &trained,
        &samples,
        &test,
        &predictions,
        &metrics,
        bin_nm,
    )?;
    place.commit(&sealed.config_hash)?;
    Ok(metrics)
}

/// Rejects cameras that the run was not trained for, and trajectories that it was trained on.
fn check_fit(
    run: &RunFolder,
    corpus: &Corpus,
    trained: &TrainedRun,
    samples: &Samples,
) -> Result<()> {
    if !same_rig(&trained.summary, &samples.rig) {
        let names =
            |ids: &mut dyn Iterator<Item = &String>| ids.cloned().collect::<Vec<_>>().join(", ");
        let fault = CorpusFault::OtherCameras {
            cameras: names(&mut samples.rig.cameras.keys()),
            run: run.root().to_owned(),
            trained: names(&mut trained.summary.cameras.keys()),
        };
        return Err(Error::corpus(corpus.root(), fault));
    }
    let known: BTreeSet<&String> = trained
        .summary
        .training_trajectories
        .union(&trained.summary.validation_trajectories)
        .collect();
    match samples
        .scenarios
        .iter()
        .find(|s| s.side == Side::Test && known.contains(&s.trajectory))
    {
        None => Ok(()),
        Some(scenario) => Err(Error::Leak {
            run: run.root().to_owned(),
            corpus: corpus.root().to_owned(),
            trajectory: scenario.trajectory.clone(),
            scenario: scenario.id.clone(),
        }),
    }
}

/// Whether the networks of a run apply to a corpus: exactly the same cameras, or, where a sweep jitters or turns them, the
/// same views of the same rig.
fn same_rig(run: &RunSummary, rig: &Rig) -> bool {
    if run.cameras_vary || rig.cameras_vary {
        let same_form = form(&run.cameras) == form(&rig.cameras);
        return run.rig.as_deref() == Some(&rig.name) && same_form;
    }
    are_same(&run.cameras, &rig.cameras)
}

fn predict_all<'a>(
    run: &TrainedRun,
    samples: &'a Samples,
    test: &[&Sample],
    progress: &mut dyn Progress,
) -> Vec<EstimatorOutcomes<'a>> {
    let task = Task::new(run, &samples.scenarios, test);
    let mut all = Vec::new();
    for estimator in Estimator::ALL {
        let outcome = |(sample, predicted_m): (&&Sample, Option<f64>)| {
            let scenario = &samples.scenarios[sample.scenario];
            Outcome {
                dtd_m: sample.dtd_m,
                predicted_m,
                detections: sample.detections(),
                weather: &scenario.weather,
                time_of_day: &scenario.time_of_day,
            }
        };
        let predicted = estimator.predict(&task);
        all.push(EstimatorOutcomes {
            estimator,
            outcomes: test.iter().zip(predicted).map(outcome).collect(),
        });
        progress.advance(all.len() as u64, estimator.name());
    }
    all
}

fn split_summary(run: &TrainedRun, samples: &Samples, config: &EvaluationConfig) -> SplitSummary {
    let count = |side| SideCount {
        scenarios: samples
            .scenarios
            .iter()
            .filter(|scenario| scenario.side == side)
            .count(),
        trajectories: samples.trajectories(side).len(),
        samples: samples.of_side(side).len(),
    };
    SplitSummary {
        by: "trajectory".into(),
        train: SideCount {
            samples: run.summary.training_samples,
            ..count(Side::Train)
        },
        validation: SideCount {
            samples: run.summary.validation_samples,
            ..count(Side::Validation)
        },
        test: count(Side::Test),
        min_dtd_nm: config.min_dtd_nm,
        max_dtd_nm: config.max_dtd_nm,
    }
}

fn write_predictions(
    run: &RunFolder,
    samples: &Samples,
    test: &[&Sample],
    predictions: &[EstimatorOutcomes],
) -> Result<()> {
    let mut table = TableWriter::new()
        .text(
            "scenario",
            test.iter()
                .map(|sample| &samples.scenarios[sample.scenario].id),
        )
        .u32("tick", test.iter().map(|sample| sample.tick))
        .u32(
            "detections",
            test.iter().map(|sample| sample.detections() as u32),
        )
        .f64("dtd_m", test.iter().map(|sample| sample.dtd_m));
    for EstimatorOutcomes {
        estimator,
        outcomes,
    } in predictions
    {
        let column = format!("{}_dtd_m", estimator.name());
        table = table.optional_f64(&column, outcomes.iter().map(|outcome| outcome.predicted_m));
    }
    Ok(table.write(&run.predictions_path())?)
}
