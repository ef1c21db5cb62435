//! Accuracy of a run on trajectories that it never saw: `evaluation.json`, `metrics.json`, `predictions.parquet` and `report.html`.
//!
//! Estimators get whole flights, once as observed and once for each removal of views ([`crate::view_removal`]). Which ticks count, and how,
//! is in `evaluation-rules.toml`.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use dataset::columns::TableWriter;
use dataset::corpus::Corpus;
use dataset::json_file::{read_json, write_json_unsynced};
use dataset::progress::Progress;
use dataset::splits::Side;
use serde::{Deserialize, Serialize};

use crate::error::{CorpusFault, Error, Result, RunFault};
use crate::estimator::{Estimator, Task};
use crate::evaluation_rules::EvaluationRules;
use crate::flight_filter::{Estimate, Estimated};
use crate::leave_out::LeftOut;
use crate::metrics::{
    EstimatorMetrics, EstimatorOutcomes, Metrics, Outcome, SideCount, SplitSummary, TickCounts,
    common_ticks,
};
use crate::report;
use crate::rig::{Rig, are_same, differences, form};
use crate::run_folder::RunFolder;
use crate::run_place::RunPlace;
use crate::samples::{DistanceRange, Observation, Sample, Samples};
use crate::sealed_run::SealedRun;
use crate::trained_run::{RunSummary, TrainedRun};
use crate::view_removal::{Remaining, ViewRemoval};

/// Which scenarios of a corpus are judged.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum JudgedSide {
    /// Those on the test side of its split.
    #[default]
    Test,
    /// All of them: for a corpus that no training saw any of.
    All,
}

/// What to evaluate, and where the results go.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct EvaluationConfig {
    /// Which scenarios are judged.
    pub side: JudgedSide,
    /// File name or hash of the detection model; by default the training's.
    pub detections: Option<String>,
    /// An empty or new folder; by default the run itself.
    pub out: Option<PathBuf>,
}

/// What was judged (`evaluation.json`). Another evaluation of the same run differs in it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Judged {
    /// Name of the corpus's folder.
    pub corpus: String,
    /// Hash of the judged scenarios: of their identifiers and the hashes of their manifests.
    pub scenarios_blake3: String,
    /// Which of its scenarios.
    pub side: JudgedSide,
    /// ICAO code of the airport and designator of each runway.
    pub runways: BTreeSet<String>,
    /// Name of the rig.
    pub rig: String,
    /// Its views.
    pub views: Vec<String>,
    /// File name of the detection model, if it is recorded.
    pub model: Option<String>,
    /// Name of its detections.
    pub model_hash: String,
    /// Hash of the weights of the run.
    pub weights_blake3: String,
    /// Version of the rules.
    pub rules: u32,
}

impl Judged {
    fn of(
        corpus: &Corpus,
        samples: &Samples,
        side: JudgedSide,
        run: &SealedRun,
        rules: &EvaluationRules,
    ) -> Self {
        let scenarios = || samples.scenarios.iter().filter(|s| s.side == Side::Test);
        let mut hash = blake3::Hasher::new();
        for scenario in scenarios() {
            hash.update(format!("{} {}\n", scenario.id, scenario.manifest_blake3).as_bytes());
        }
        let root = corpus.root();
        let real = root.canonicalize().unwrap_or_else(|_| root.to_owned());
        Self {
            corpus: real
                .file_name()
                .unwrap_or_default()
                .to_string_lossy()
                .into(),
            scenarios_blake3: hash.finalize().to_string(),
            side,
            runways: scenarios()
                .map(|s| format!("{} {}", s.runway.airport, s.runway.name))
                .collect(),
            rig: samples.rig.name.clone(),
            views: samples.views.clone(),
            model: samples.detections.model.clone(),
            model_hash: samples.detections.hash.clone(),
            weights_blake3: blake3::hash(run.bytes(RunFolder::WEIGHTS)).to_string(),
            rules: rules.version,
        }
    }

    /// Whether this is another evaluation than the one whose results a folder has.
    fn is_other_than_in(&self, folder: &RunFolder) -> bool {
        let path = folder.evaluation_path();
        let same = |there: Self| {
            Self {
                corpus: there.corpus.clone(),
                ..self.clone()
            } == there
        };
        path.exists() && !read_json(&path, "evaluation").is_ok_and(same)
    }
}

/// The judged ticks of all flights, and what an estimator answered.
struct Flights<'a> {
    samples: &'a Samples,
    rules: &'a EvaluationRules,
    /// All ticks, with the boxes that the run takes for the aircraft.
    flown: Vec<Sample>,
}

/// Evaluates a run on a corpus. The results go to a new folder, or are added to the run: it is replaced by one with the same networks and
/// all results of this evaluation. Results of another evaluation are never replaced.
pub fn evaluate(
    run: &RunFolder,
    corpus: &Corpus,
    config: &EvaluationConfig,
    progress: &mut dyn Progress,
) -> Result<Metrics> {
    let rules = &EvaluationRules::current();
    let (sealed, place) = match &config.out {
        None => {
            let place = RunPlace::take_existing(run)?;
            (SealedRun::read(&place.run())?, place)
        }
        Some(out) => (SealedRun::read(run)?, RunPlace::take_vacant(out)?),
    };
    let trained = TrainedRun::of(&sealed)?;
    let model = &trained.summary.model_hash;
    let model = config.detections.as_ref().unwrap_or(model);
    let mut samples = Samples::read(corpus, Some(model), DistanceRange::ALL)?;
    match config.side {
        JudgedSide::All => samples.test_all(),
        JudgedSide::Test => split_again(corpus, &mut samples, trained.config.leave_out.as_deref())?,
    }
    let samples = &samples;
    check_cameras(run, corpus, &trained, samples)?;
    check_unseen(run, corpus, &trained, samples)?;
    let recorded = || samples.ticks_of_side(Side::Test);
    let is_seen = |sample: &Sample| rules.is_there(sample) && sample.detections() > 0;
    if !recorded().any(is_seen) {
        let EvaluationRules {
            min_dtd_nm,
            max_dtd_nm,
            ..
        } = *rules;
        let fault = CorpusFault::NoTestSamples {
            min_dtd_nm,
            max_dtd_nm,
        };
        return Err(Error::corpus(corpus.root(), fault));
    }
    let judged = Judged::of(corpus, samples, config.side, &sealed, rules);
    if config.out.is_none() && judged.is_other_than_in(&place.run()) {
        return Err(Error::run(run.root(), RunFault::OtherEvaluation));
    }
    let observed: Vec<Observation> = recorded().map(|s| s.observed.clone()).collect();
    let believed = trained.believed(&observed, samples);
    let flights = Flights {
        samples,
        rules,
        flown: recorded()
            .zip(&believed)
            .map(|(sample, believed)| sample.with(believed.clone()))
            .collect(),
    };
    let found = recorded()
        .filter(|s| rules.is_there(s))
        .map(|s| s.detections())
        .sum::<usize>();
    let shown = flights.answers(&trained, &observed, &believed, progress);
    let common = common_ticks(&shown);
    let seen: usize = flights.judged().map(|sample| sample.detections()).sum();
    let metrics = Metrics {
        rules: rules.clone(),
        split: split_summary(&trained.summary, samples, &flights),
        ticks: TickCounts {
            there: flights.judged().count(),
            hidden_by_fog: flights.judged().filter(|s| rules.is_hidden(s)).count(),
            seen: flights.judged().filter(|s| s.detections() > 0).count(),
            common: common.iter().filter(|&&common| common).count(),
        },
        disbelieved_boxes: found - seen,
        deviations_from_paper: trained.config.deviations_from_paper(),
        cut_off_boxes: flights.judged().map(|sample| sample.cut_off).sum(),
        estimators: shown
            .iter()
            .map(|one| {
                let name = one.estimator.name().to_owned();
                (name, EstimatorMetrics::of(one, &common, rules))
            })
            .collect(),
        judged,
    };
    let new = place.begin()?;
    if config.out.is_none() {
        sealed.write(&new)?;
    }
    let judged_ticks: Vec<&Sample> = flights.judged().collect();
    write_json_unsynced(&new.evaluation_path(), &metrics.judged)?;
    write_predictions(&new, &flights, &shown)?;
    write_json_unsynced(&new.metrics_path(), &metrics)?;
    report::write(
        &new,
        &report::Results {
            trained: &trained,
            samples,
            judged: &judged_ticks,
            shown: &shown,
            metrics: &metrics,
        },
    )?;
    place.commit(&sealed.config_hash)?;
    Ok(metrics)
}

/// Makes the condition that a training leaves out, if any, the test side.
pub(crate) fn split_again(
    corpus: &Corpus,
    samples: &mut Samples,
    leave_out: Option<&str>,
) -> Result<()> {
    let Some(setting) = leave_out else {
        return Ok(());
    };
    let is_there = LeftOut::parse(setting).is_some_and(|left_out| left_out.split(samples));
    match is_there {
        true => Ok(()),
        false => {
            let setting = setting.to_owned();
            let fault = CorpusFault::NothingLeftOut { setting };
            Err(Error::corpus(corpus.root(), fault))
        }
    }
}

impl TrainedRun {
    /// Observations without the boxes that are unlike any of the training side.
    pub(crate) fn believed(
        &self,
        observations: &[Observation],
        samples: &Samples,
    ) -> Vec<Observation> {
        let other_cameras = samples.rig.cameras_vary && !self.summary.cameras_vary;
        let observations = observations.iter();
        observations
            .map(|observed| self.normalisation.without_outliers(observed, other_cameras))
            .collect()
    }
}

impl<'a> Flights<'a> {
    /// The ticks that count.
    fn judged(&self) -> impl Iterator<Item = &Sample> {
        self.flown
            .iter()
            .filter(|sample| self.rules.is_there(sample))
    }

    /// The answers of all estimators, with all views and with some removed.
    fn answers(
        &self,
        run: &TrainedRun,
        observed: &[Observation],
        believed: &[Observation],
        progress: &mut dyn Progress,
    ) -> Vec<EstimatorOutcomes<'a>> {
        let (samples, rules) = (self.samples, &self.rules.removed_views);
        let removals = ViewRemoval::all(samples.views.len(), rules);
        progress.begin(
            "evaluation",
            (Estimator::ALL.len() * (1 + removals.len())) as u64,
        );
        let mut done = 0;
        let mut predict = |observations: &[Observation], removed: &[bool]| {
            let task = Task::new(run, &samples.scenarios, observations);
            Estimator::ALL.map(|estimator| {
                let estimates = estimator.estimates(&task);
                let answers = match &estimates {
                    Some(estimates) => Estimate::distances_m(estimates),
                    None => estimator.predict(&task),
                };
                done += 1;
                progress.advance(done, estimator.name());
                let none = vec![None; answers.len()];
                let known = estimates.as_ref().unwrap_or(&none);
                let outcomes = self.outcomes(observations, &answers, known, removed);
                (outcomes, estimates.map(|all| self.at_judged_ticks(all)))
            })
        };
        let all = predict(believed, &vec![false; believed.len()]);
        let mut shown: Vec<EstimatorOutcomes> = Estimator::ALL
            .into_iter()
            .zip(all)
            .map(|(estimator, (outcomes, estimates))| EstimatorOutcomes {
                estimator,
                outcomes,
                estimates,
                views_removed: BTreeMap::new(),
            })
            .collect();
        for removal in removals {
            let Remaining {
                observations,
                removed,
            } = removal.apply(rules, &samples.scenarios, observed);
            let answers = predict(&run.believed(&observations, samples), &removed);
            for (one, (outcomes, _)) in shown.iter_mut().zip(answers) {
                let name = removal.name(&samples.views, rules);
                one.views_removed.insert(name, outcomes);
            }
        }
        shown
    }

    /// What belongs to the ticks that count.
    fn at_judged_ticks<T>(&self, of_all: Vec<T>) -> Vec<T> {
        let ticks = self.flown.iter().zip(of_all);
        ticks
            .filter(|(sample, _)| self.rules.is_there(sample))
            .map(|(_, of_tick)| of_tick)
            .collect()
    }

    /// Answers at the ticks that count.
    fn outcomes(
        &self,
        observations: &[Observation],
        answers: &[Option<f64>],
        estimates: &[Option<Estimate>],
        removed: &[bool],
    ) -> Vec<Outcome<'a>> {
        let ticks = self.flown.iter().zip(observations);
        ticks
            .zip(answers.iter().zip(estimates).zip(removed))
            .filter(|((sample, _), _)| self.rules.is_there(sample))
            .map(
                |((sample, observed), ((&predicted_m, estimate), &is_removed))| {
                    let scenario = &self.samples.scenarios[sample.scenario];
                    Outcome {
                        dtd_m: sample.dtd_m,
                        predicted_m,
                        interval_m: estimate.map(|estimate| estimate.distance_m.interval),
                        detections: observed.detections(),
                        is_hidden: self.rules.is_hidden(sample),
                        is_removed,
                        scenario: &scenario.id,
                        trajectory: &scenario.trajectory,
                        flight: &scenario.flight,
                        weather: &scenario.weather,
                        time_of_day: &scenario.time_of_day,
                    }
                },
            )
            .collect()
    }
}

/// Rejects cameras that the run was not trained for.
pub(crate) fn check_cameras(
    run: &RunFolder,
    corpus: &Corpus,
    trained: &TrainedRun,
    samples: &Samples,
) -> Result<()> {
    let summary = &trained.summary;
    if !same_rig(summary, &samples.rig) {
        let fault = CorpusFault::OtherCameras {
            run: run.root().to_owned(),
            differences: differences(
                (&samples.rig.name, &samples.rig.cameras),
                (&summary.rig, &summary.cameras),
            ),
        };
        return Err(Error::corpus(corpus.root(), fault));
    }
    Ok(())
}

/// Rejects flights that the run was trained on.
fn check_unseen(
    run: &RunFolder,
    corpus: &Corpus,
    trained: &TrainedRun,
    samples: &Samples,
) -> Result<()> {
    let mut tested = samples.scenarios.iter().filter(|s| s.side == Side::Test);
    match tested.find(|scenario| trained.summary.knows(scenario)) {
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
        return run.rig == rig.name && same_form;
    }
    are_same(&run.cameras, &rig.cameras)
}

fn split_summary(run: &RunSummary, samples: &Samples, flights: &Flights) -> SplitSummary {
    SplitSummary {
        by: "trajectory".into(),
        train: SideCount {
            scenarios: run.training_scenarios,
            trajectories: run.training_trajectories.len(),
            samples: run.training_samples,
        },
        validation: SideCount {
            scenarios: run.validation_scenarios,
            trajectories: run.validation_trajectories.len(),
            samples: run.validation_samples,
        },
        test: SideCount {
            scenarios: samples.scenario_count(Side::Test),
            trajectories: samples.flights(Side::Test).len(),
            samples: flights.judged().filter(|s| s.detections() > 0).count(),
        },
    }
}

fn write_predictions(
    run: &RunFolder,
    flights: &Flights,
    predictions: &[EstimatorOutcomes],
) -> Result<()> {
    let scenario = |sample: &Sample| &flights.samples.scenarios[sample.scenario].id;
    let mut table = TableWriter::new()
        .text("scenario", flights.judged().map(scenario))
        .u32("tick", flights.judged().map(|sample| sample.tick))
        .u32(
            "detections",
            flights.judged().map(|sample| sample.detections() as u32),
        )
        .bool(
            "hidden_by_fog",
            flights
                .judged()
                .map(|sample| flights.rules.is_hidden(sample)),
        )
        .f64("dtd_m", flights.judged().map(|sample| sample.dtd_m));
    for one in predictions {
        let column = format!("{}_dtd_m", one.estimator.name());
        let answers = one.outcomes.iter().map(|outcome| outcome.predicted_m);
        table = table.optional_f64(&column, answers);
        if let Some(estimates) = &one.estimates {
            table = add_estimates(table, one.estimator.name(), estimates);
        }
    }
    Ok(table.write(&run.predictions_path())?)
}

/// A number that an estimator states, of a column's name.
type Stated = (&'static str, fn(&Estimate) -> Option<Estimated>);
/// A column of such a number, of the suffix of its name.
type Part = (&'static str, fn(Estimated) -> f64);

/// Columns of what else an estimator knows.
pub(crate) fn add_estimates(
    mut table: TableWriter,
    name: &str,
    estimates: &[Option<Estimate>],
) -> TableWriter {
    let numbers: [Stated; 3] = [
        ("dtd_m", |estimate| Some(estimate.distance_m)),
        ("ground_speed_mps", |estimate| {
            Some(estimate.ground_speed_mps)
        }),
        ("time_to_touchdown_s", |estimate| {
            estimate.time_to_touchdown_s
        }),
    ];
    for (quantity, number) in numbers {
        let parts: [Part; 4] = [
            ("", |number| number.value),
            ("_sd", |number| number.sd),
            ("_from", |number| number.interval[0]),
            ("_to", |number| number.interval[1]),
        ];
        // The distance itself has a column like that of every estimator.
        for (suffix, part) in parts.into_iter().skip(usize::from(quantity == "dtd_m")) {
            let of = |estimate: &Option<Estimate>| estimate.as_ref().and_then(number).map(part);
            let column = format!("{name}_{quantity}{suffix}");
            table = table.optional_f64(&column, estimates.iter().map(of));
        }
    }
    table
}
