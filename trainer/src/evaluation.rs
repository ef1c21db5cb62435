//! Run evaluation on unseen trajectories: `evaluation.json`, `metrics.json`, `predictions.parquet` and `report.html`.
//!
//! Estimators process one whole flight after the other, first as observed, and then again for each removal of views
//! ([`crate::evaluation::view_removal`]). `evaluation-rules.toml` defines which ticks count, and how.

pub(crate) mod answers;
mod contradictions;
pub mod figures;
pub(crate) mod judged;
pub(crate) mod judged_table;
pub(crate) mod metrics;
pub(crate) mod prediction;
pub(crate) mod prediction_table;
pub(crate) mod report;
pub(crate) mod rules;
pub(crate) mod view_removal;

use std::collections::BTreeMap;
use std::path::PathBuf;

use dataset::corpus::Corpus;
use dataset::corpus::detections::RegisteredWith;
use dataset::corpus::splits::Side;
use dataset::files::json_file::write_json_unsynced;
use dataset::tables::columns::{TableParts, TableWriter};
use dataset::work::watch::Watch;

use crate::error::{Error, Result};
use crate::estimators::inverse_range::contradiction::Withheld;
use crate::evaluation::answers::{Answers, JudgedTicks};
use crate::evaluation::contradictions::Contradictions;
use crate::evaluation::judged::{Judged, JudgedSide};
use crate::evaluation::metrics::{
    AgainstOneView, EstimatorMetrics, Metrics, RemovedFigures, SideCount, SplitSummary,
    TrainingFigures,
};
use crate::evaluation::prediction_table::{add_answers, judged_ticks};
use crate::evaluation::rules::EvaluationRules;
use crate::evaluation::view_removal::{Remaining, ViewRemoval};
use crate::run::estimator::{Answered, Estimator, Task};
use crate::run::folder::RunFolder;
use crate::run::place::RunPlace;
use crate::run::sealed::SealedRun;
use crate::run::trained::{Baselines, RunSummary, TrainedRun};
use crate::samples::camera_health::Corrections;
use crate::samples::camera_health::late_images::{Pair, warn_of_lags};
use crate::samples::rig::moved_rig::differences_elsewhere;
use crate::samples::rig::{Rig, are_same, differences, form};
use crate::samples::sides::leave_out::LeftOut;
use crate::samples::sides::marked_scenarios;
use crate::samples::{Observation, Sample, Samples};

/// Evaluation input and output.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct EvaluationConfig {
    /// Scenarios to evaluate.
    pub side: JudgedSide,
    /// File name or hash of the detection model; by default the one used in training.
    pub detections: Option<String>,
    /// An empty or new folder; by default the run itself.
    pub out: Option<PathBuf>,
}

/// Input of the estimators.
struct Evaluation<'a> {
    run: &'a TrainedRun,
    samples: &'a Samples,
    rules: &'a EvaluationRules,
}

/// Answers for one flight.
struct FlightAnswers<'a> {
    flight: &'a [Sample],
    is_judged: &'a [bool],
    believed: &'a [Observation],
    withheld: &'a [Withheld],
    answered: &'a [Answered],
}

/// Evaluates a run on a corpus. The results go to a new folder, or are added to the run, which is replaced by a copy with the same networks
/// and all results. Results from a different evaluation are never replaced.
pub fn evaluate(
    run: &RunFolder,
    corpus: &Corpus,
    config: &EvaluationConfig,
    watch: &dyn Watch,
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
    let mut samples = Samples::read(corpus, Some(model))?;
    match config.side {
        JudgedSide::All => samples.test_all(),
        JudgedSide::Test => match &trained.summary.scenario_split {
            Some(split) if !split.restore(&mut samples) => {
                let fault = "has none of the scenarios that the run drew for its test; `dtd evaluate --side all` judges all scenarios of \
                             a corpus that it has not seen";
                return Err(Error::corpus(corpus.root(), fault));
            }
            Some(_) => {}
            None => split_again(corpus, &mut samples, trained.config.leave_out.as_deref())?,
        },
    }
    let trained = trained.for_corpus(run, corpus, &samples, watch)?;
    check_unseen(run, corpus, &trained, &samples, config.side)?;
    let alignment = (trained.backgrounds).align(&mut samples, (&[Side::Test], false), watch)?;
    alignment.report(watch);
    let pairs = trained.pairs(&samples);
    let late_views = samples.put_in_time(&[Side::Test], &pairs);
    warn_of_lags(&late_views, watch);
    let samples = &samples;
    let tested = samples.scenarios.iter().filter(|of| of.side == Side::Test);
    if let Some(line) = Corrections::line(tested.map(|of| of.corrections)) {
        watch.say(&line);
    }
    let recorded = || samples.ticks_of_side(Side::Test);
    let is_seen = |sample: &Sample| rules.is_there(sample) && sample.detections() > 0;
    if !recorded().any(is_seen) {
        return Err(rules.nothing_to_judge(corpus));
    }
    let judged = Judged::of(corpus, samples, config.side, &sealed, rules);
    if config.out.is_none() && judged.is_other_than_in(&place.run()) {
        let fault = "has the results of another evaluation (evaluation.json): of other scenarios, detections or rules; name a folder \
                     for these with --out DIR";
        return Err(Error::run(run.root(), fault));
    }
    let ticks = JudgedTicks::of(samples, rules);
    let evaluation = Evaluation {
        run: &trained,
        samples,
        rules,
    };
    let removals = ViewRemoval::all(samples.views.len(), &rules.removed_views);
    watch.begin("evaluation", evaluation.steps(&removals));
    let new = place.begin()?;
    if config.out.is_none() {
        sealed.write(&new)?;
    }
    write_json_unsynced(&new.path(RunFolder::EVALUATION), &judged)?;
    let mut predictions = TableParts::new(&new.predictions_path());
    let mut steps = Steps { watch, done: 0 };
    let mut contradictions = Contradictions::default();
    let all = evaluation.answers(None, &mut steps, |flown| {
        let seen = flown.flight.iter().map(|sample| &sample.observed);
        contradictions.add(samples, seen, (flown.believed, flown.withheld));
        Ok(predictions.add(evaluation.rows(flown))?)
    })?;
    contradictions.report(watch);
    predictions.finish()?;
    let mut views_removed: [BTreeMap<String, RemovedFigures>; Estimator::ALL.len()] =
        Default::default();
    for removal in removals {
        let name = removal.name(&samples.views, &rules.removed_views);
        let answers = evaluation.answers(Some(removal), &mut steps, |_| Ok(()))?;
        for (estimator, of) in views_removed.iter_mut().enumerate() {
            let figures = RemovedFigures::of(&ticks.outcomes(&answers, estimator), rules);
            of.insert(name.clone(), figures);
        }
    }
    let common = all.common();
    let of_estimators = Estimator::ALL.into_iter().zip(views_removed).enumerate();
    let estimators = of_estimators.map(|(number, (estimator, views_removed))| {
        let outcomes = ticks.outcomes(&all, number);
        let figures = EstimatorMetrics::of(&outcomes, &common, views_removed, rules);
        (estimator.name().to_owned(), figures)
    });
    let estimators = estimators.collect();
    let found: usize = ticks.ticks().iter().map(|s| s.detections()).sum();
    let metrics = Metrics {
        rules: rules.clone(),
        split: split_summary(
            &trained.summary,
            samples,
            config.side,
            all.seen().unwrap_or_default(),
        ),
        ticks: ticks.counts(all.seen(), &common),
        disbelieved_boxes: found - all.boxes(),
        dropped_training_boxes: trained.summary.dropped_training_boxes.clone(),
        deviations_from_paper: trained.deviations_from_paper(),
        cut_off_boxes: ticks.ticks().iter().map(|s| s.cut_off).sum(),
        training: TrainingFigures {
            stages: trained.summary.stages.clone(),
            training_s: trained.summary.training_s,
        },
        against_one_view: AgainstOneView::all(&estimators),
        estimators,
        judged,
        alignment,
        late_views,
        weather_at_aircraft: marked_scenarios::reported_on_test_side(samples),
    };
    write_json_unsynced(&new.metrics_path(), &metrics)?;
    report::write(
        &new,
        &report::Results {
            corpus,
            trained: &trained,
            samples,
            ticks: &ticks,
            answers: &all,
            metrics: &metrics,
        },
    )?;
    place.commit(&sealed.config_hash)?;
    Ok(metrics)
}

/// Makes the left-out condition, if any, the test side.
pub(crate) fn split_again(
    corpus: &Corpus,
    samples: &mut Samples,
    leave_out: Option<&str>,
) -> Result<()> {
    match leave_out {
        Some(setting) if !LeftOut::parse(setting).is_some_and(|of| of.split(samples)) => {
            let fault = format!(
                "has no scenario with {setting}, which the training leaves out for the test side; `dtd plan` lists weathers and times"
            );
            Err(Error::corpus(corpus.root(), fault))
        }
        _ => Ok(()),
    }
}

impl TrainedRun {
    /// The run at a corpus's runway. Rejects cameras that it was not trained for; warns of different registration and of missing
    /// backgrounds.
    pub(crate) fn for_corpus(
        self,
        run: &RunFolder,
        corpus: &Corpus,
        samples: &Samples,
        watch: &dyn Watch,
    ) -> Result<Self> {
        let moved = self.at_runway_of(samples);
        check_cameras(run, corpus, &moved, samples)?;
        let of_run = moved.summary.registered_with.as_ref();
        if let Some(line) = other_registration(of_run, samples.registered_with()) {
            watch.warn(&line);
        }
        if !moved.is_elsewhere && !moved.backgrounds.has_references() {
            watch.warn(
                "the run has no backgrounds to compare cameras with, because the training's corpus had none; run `dtd detect` on that \
                 corpus, and train again",
            );
        }
        if moved.is_elsewhere {
            watch.say(
                "the run has no background of this airport, so cameras are taken to look as they did in the training, to their stability",
            );
        }
        Ok(moved)
    }

    /// A whole flight with the boxes of one aircraft, without boxes unlike the training's and boxes in views that contradict each other;
    /// and these contradictions.
    pub(crate) fn believed(
        &self,
        flight: &[Observation],
        samples: &Samples,
    ) -> (Vec<Observation>, Vec<Withheld>) {
        let other_cameras = self.has_other_cameras(samples);
        let usual = flight.iter();
        let usual = usual.map(|of| self.normalisation.without_outliers(of, other_cameras));
        let usual: Vec<Observation> = usual.collect();
        if other_cameras {
            // Positions from varying cameras carry no information about the relation between views.
            return (usual, Vec::new());
        }
        let Baselines {
            paired_views,
            flight_filter,
            inverse_range,
            ..
        } = &self.baselines;
        let followed = if paired_views.is_empty() {
            usual
                .into_iter()
                .map(|observed| (Some(0), observed))
                .collect()
        } else {
            paired_views.followed(&usual)
        };
        flight_filter.without_contradictions(inverse_range, followed)
    }

    /// Views whose rows are known: none if the cameras or the airport differ from the training's.
    fn pairs(&self, samples: &Samples) -> Vec<Pair<'_>> {
        if self.is_elsewhere || self.has_other_cameras(samples) {
            return Vec::new();
        }
        self.baselines.inverse_range.pairs()
    }

    /// True if the cameras of these samples vary and the training's did not.
    pub(crate) fn has_other_cameras(&self, samples: &Samples) -> bool {
        samples.rig.cameras_vary && !self.summary.cameras_vary
    }
}

struct Steps<'a> {
    watch: &'a dyn Watch,
    done: u64,
}

impl<'a> Evaluation<'a> {
    fn flights(&self) -> impl Iterator<Item = &'a [Sample]> {
        self.samples.flights_of_side(Side::Test)
    }

    /// Number of flights to estimate, over all removals.
    fn steps(&self, removals: &[ViewRemoval]) -> u64 {
        (self.flights().count() * (1 + removals.len())) as u64
    }

    /// Answers from all estimators, flight by flight; `each` receives each flight.
    fn answers(
        &self,
        removal: Option<ViewRemoval>,
        steps: &mut Steps,
        mut each: impl FnMut(&FlightAnswers) -> Result<()>,
    ) -> Result<Answers> {
        let (run, scenarios) = (self.run, &self.samples.scenarios);
        let rules = &self.rules.removed_views;
        let ticks = self.flights().flatten();
        let judged = ticks.filter(|sample| self.rules.is_there(sample)).count();
        let mut answers = Answers::with_room_for(judged);
        for flight in self.flights() {
            steps.watch.check()?;
            let observed: Vec<Observation> = flight.iter().map(|s| s.observed.clone()).collect();
            let Remaining {
                observations,
                removed,
            } = match removal {
                Some(removal) => removal.apply(rules, scenarios, &observed),
                None => Remaining {
                    removed: vec![false; observed.len()],
                    observations: observed,
                },
            };
            let (believed, withheld) = run.believed(&observations, self.samples);
            let task = Task::new(run, scenarios, &believed);
            let answered = Estimator::ALL.map(|estimator| estimator.answers(&task));
            let is_judged: Vec<bool> = flight.iter().map(|s| self.rules.is_there(s)).collect();
            answers.add(&is_judged, (&believed, &removed), &answered);
            each(&FlightAnswers {
                flight,
                is_judged: &is_judged,
                believed: &believed,
                withheld: &withheld,
                answered: &answered,
            })?;
            steps.done += 1;
            let id = &scenarios[flight[0].scenario].id;
            steps.watch.advance(steps.done, id);
        }
        Ok(answers)
    }

    /// Rows of `predictions.parquet` for a flight.
    fn rows(&self, flown: &FlightAnswers) -> TableWriter {
        let judged: Vec<usize> = (0..flown.flight.len())
            .filter(|&tick| flown.is_judged[tick])
            .collect();
        let ticks: Vec<&Sample> = judged.iter().map(|&tick| &flown.flight[tick]).collect();
        let detections = judged
            .iter()
            .map(|&tick| flown.believed[tick].detections() as u32);
        let table = judged_ticks(&ticks, Some(detections.collect()), self.samples, self.rules);
        add_answers(table, &judged, flown.answered)
    }
}

fn check_cameras(
    run: &RunFolder,
    corpus: &Corpus,
    trained: &TrainedRun,
    samples: &Samples,
) -> Result<()> {
    let summary = &trained.summary;
    if !same_rig(trained, &samples.rig) {
        let [here, there] = summary
            .comparable(&samples.rig)
            .unwrap_or([&samples.rig.cameras, &summary.cameras]);
        let (here, there) = ((&*samples.rig.name, here), (&*summary.rig, there));
        let differences = if trained.is_elsewhere {
            differences_elsewhere(here, there)
        } else {
            differences(here, there)
        };
        let fault = format!(
            "its cameras are not those that run {} was trained with; here, and there: {}; if one of them was turned, moved or replaced, \
             `dtd refit` fits its view again",
            run.root().display(),
            differences.join("; ")
        );
        return Err(Error::corpus(corpus.root(), fault));
    }
    Ok(())
}

/// Line for users if a corpus was registered with different cameras than the training.
fn other_registration(
    of_run: Option<&RegisteredWith>,
    of_corpus: Option<&RegisteredWith>,
) -> Option<String> {
    let (of_run, of_corpus) = (of_run?, of_corpus?);
    let remedy = match of_run {
        RegisteredWith::Run(_) => "name that run in `dtd detect CORPUS --registration-of RUN`",
        RegisteredWith::Calibration => "train again on corpora that are registered alike",
    };
    (of_run != of_corpus).then(|| {
        format!(
            "the views of the corpus were registered with {of_corpus}, those of the training with {of_run}, so that distances may be off; \
             {remedy}"
        )
    })
}

/// Rejects flights from training, except scenarios drawn for the test: these share flights, and the report says so.
fn check_unseen(
    run: &RunFolder,
    corpus: &Corpus,
    trained: &TrainedRun,
    samples: &Samples,
    side: JudgedSide,
) -> Result<()> {
    let drawn = trained.summary.scenario_split.as_ref();
    let drawn = drawn.filter(|_| side == JudgedSide::Test);
    let mut tested = (samples.scenarios.iter())
        .filter(|s| s.side == Side::Test && !drawn.is_some_and(|split| split.tests(s)));
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

/// True if a run's networks apply to a corpus: the same cameras, or, where a sweep jitters or turns them, the same views of the same rig
/// with the same plan.
fn same_rig(trained: &TrainedRun, rig: &Rig) -> bool {
    let run = &trained.summary;
    let same_kind = !(run.cameras_vary || rig.cameras_vary)
        || (run.rig == rig.name && form(&run.cameras) == form(&rig.cameras));
    same_kind
        && run.comparable(rig).is_none_or(|[here, there]| {
            if trained.is_elsewhere {
                differences_elsewhere((&rig.name, here), (&run.rig, there)).is_empty()
            } else {
                are_same(here, there)
            }
        })
}

/// `seen`: number of evaluated ticks that a view saw.
fn split_summary(
    run: &RunSummary,
    samples: &Samples,
    side: JudgedSide,
    seen: usize,
) -> SplitSummary {
    let drawn = run.scenario_split.as_ref();
    let drawn = drawn.filter(|_| side == JudgedSide::Test);
    SplitSummary {
        by: if drawn.is_some() {
            "scenario".into()
        } else {
            "trajectory".into()
        },
        test_scenarios_sharing_flights: drawn.map_or(0, |split| split.sharing_flights.len()),
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
            samples: seen,
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_corpus_that_is_registered_otherwise_than_the_training_is_named_with_a_remedy() {
        let stated = RegisteredWith::Calibration;
        let fitted = RegisteredWith::Run("ab".repeat(32));
        for same in [&stated, &fitted] {
            assert_eq!(other_registration(Some(same), Some(same)), None);
            assert_eq!(other_registration(None, Some(same)), None);
        }
        let line = other_registration(Some(&fitted), Some(&stated)).unwrap();
        assert!(
            line.contains("run abababababab") && line.contains("--registration-of"),
            "{line}"
        );
    }
}
