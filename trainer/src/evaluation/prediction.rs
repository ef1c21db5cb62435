//! Distances for a corpus without ground truth: answers from every estimator at every tick, from whole flights or as in live operation.

use std::path::Path;

use dataset::corpus::Corpus;
use dataset::corpus::splits::Side;
use dataset::tables::columns::{TableParts, TableWriter};
use dataset::work::watch::Watch;
use serde::{Serialize, Serializer};

use crate::background::Alignment;
use crate::error::{Error, Result};
use crate::estimators::inverse_range::contradiction::Withheld;
use crate::estimators::inverse_range::flight_filter::Estimate;
use crate::evaluation::contradictions::Contradictions;
use crate::evaluation::prediction_table::add_answers;
use crate::live::{InSight, JudgedAircraft, Phase};
use crate::run::estimator::{Answered, Estimator, Task};
use crate::run::folder::RunFolder;
use crate::run::place::refuse_in_run;
use crate::run::sealed::SealedRun;
use crate::run::trained::TrainedRun;
use crate::samples::camera_health::Corrections;
use crate::samples::camera_health::late_images::{PastLags, put_in_time, warn_of_lags};
use crate::samples::{Moment, NO_SCENARIOS, Observation, Samples};

/// Prediction size.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Predicted {
    /// Number of scenarios.
    pub scenarios: usize,
    /// Number of ticks, each a row of the table.
    pub ticks: usize,
    /// Answered ticks by estimator name.
    #[serde(serialize_with = "as_map")]
    pub answered: Vec<(&'static str, usize)>,
}

fn as_map<S: Serializer>(
    pairs: &[(&'static str, usize)],
    serializer: S,
) -> std::result::Result<S::Ok, S::Error> {
    serializer.collect_map(pairs.iter().copied())
}

/// Writes the answers of all estimators at all ticks to a table (Parquet). The corpus needs detections by the training's model, or by
/// `detections`, but neither labels nor a split. Live, each tick is answered from past ticks, as by [`crate::live::OnlineRun`], for the
/// followed aircraft, with its phase in a column; there is no smoother.
pub fn predict(
    run: &RunFolder,
    corpus: &Corpus,
    detections: Option<&str>,
    out: &Path,
    moment: Moment,
    watch: &dyn Watch,
) -> Result<Predicted> {
    if out.symlink_metadata().is_ok() {
        return Err(Error::Exists {
            path: out.to_owned(),
        });
    }
    refuse_in_run(out)?;
    let trained = TrainedRun::of(&SealedRun::read(run)?)?;
    let model = detections.unwrap_or(&trained.summary.model_hash);
    let (mut corpus_read, mut flights) = Samples::without_truth(corpus, Some(model), moment)?;
    let trained = trained.for_corpus(run, corpus, &corpus_read, watch)?;
    if flights.is_empty() {
        return Err(Error::corpus(corpus.root(), NO_SCENARIOS));
    }
    if moment == Moment::Hindsight {
        let alignment = trained.backgrounds.align_observations(
            &mut corpus_read,
            (&[Side::Test], false),
            flights.iter_mut(),
            watch,
        )?;
        alignment.report(watch);
    }
    let pairs = trained.pairs(&corpus_read);
    let mut late_views = Vec::new();
    if moment == Moment::Hindsight {
        let Samples {
            views, scenarios, ..
        } = &mut corpus_read;
        late_views = put_in_time(views, scenarios, flights.iter_mut(), &pairs);
    }
    let mut table = TableParts::new(out);
    let mut answered = Estimator::ALL.map(|estimator| (estimator.name(), 0));
    watch.begin("prediction", corpus_read.scenarios.len() as u64);
    let mut done = 0;
    let mut seen_live = Alignment::default();
    let mut contradictions = Contradictions::default();
    let mut late = Corrections::default();
    for flight in flights.chunk_by(|a, b| a.scenario == b.scenario) {
        watch.check()?;
        let of_flight = match moment {
            Moment::Hindsight => FlightPredictions::whole(&trained, &corpus_read, flight),
            Moment::Live => {
                let backgrounds = &trained.backgrounds;
                let seen = backgrounds.seen_live(&corpus_read, flight, &mut seen_live)?;
                let mut lags = PastLags::default();
                let seen = seen.into_iter().map(|of| lags.corrected(&pairs, of));
                let seen: Vec<Observation> = seen.collect();
                let id = &corpus_read.scenarios[flight[0].scenario].id;
                late_views.extend(lags.named(id, &corpus_read.views));
                late += lags.counts;
                FlightPredictions::live(&trained, &corpus_read, &seen)
            }
        };
        for ((_, count), of) in answered.iter_mut().zip(&of_flight.answered) {
            *count += of.distances_m.iter().flatten().count();
        }
        let believed = (&*of_flight.observed, &*of_flight.withheld);
        contradictions.add(&corpus_read, flight.iter(), believed);
        let scenario = &corpus_read.scenarios[flight[0].scenario].id;
        table.add(of_flight.columns(scenario))?;
        done += 1;
        watch.advance(done, scenario);
    }
    if moment == Moment::Live {
        seen_live.report(watch);
    }
    warn_of_lags(&late_views, watch);
    let corrections = corpus_read.scenarios.iter().map(|of| of.corrections);
    if let Some(line) = Corrections::line(corrections.chain([late])) {
        watch.say(&line);
    }
    contradictions.report(watch);
    match table.finish_new() {
        // A different process has created it in the meantime.
        Err(error) if error.is_taken() => {
            return Err(Error::Exists {
                path: out.to_owned(),
            });
        }
        result => result?,
    }
    Ok(Predicted {
        scenarios: corpus_read.scenarios.len(),
        ticks: flights.len(),
        answered: answered.into(),
    })
}

/// Answers for one flight.
struct FlightPredictions {
    observed: Vec<Observation>,
    answered: Vec<Answered>,
    /// Contradictions.
    withheld: Vec<Withheld>,
    /// Live, phase of the followed aircraft at each tick, if any.
    phases: Option<Vec<Option<Phase>>>,
}

impl FlightPredictions {
    fn whole(trained: &TrainedRun, samples: &Samples, flight: &[Observation]) -> Self {
        let (observed, withheld) = trained.believed(flight, samples);
        let task = Task::new(trained, &samples.scenarios, &observed);
        Self {
            answered: Estimator::ALL
                .map(|estimator| estimator.answers(&task))
                .into(),
            observed,
            withheld,
            phases: None,
        }
    }

    fn live(trained: &TrainedRun, samples: &Samples, flight: &[Observation]) -> Self {
        let other_cameras = trained.has_other_cameras(samples);
        let mut in_sight = InSight::default();
        let followed: Vec<Option<JudgedAircraft>> = (flight.iter())
            .map(|observed| {
                let judged = in_sight.take(trained, other_cameras, observed);
                judged.into_iter().find(|of| of.is_followed)
            })
            .collect();
        let contradictions = followed.iter().flatten();
        let contradictions = contradictions.filter_map(|of| of.contradiction.as_ref());
        let begun = contradictions.filter(|found| found.begins);
        let withheld = begun.map(|found| found.withheld.clone()).collect();
        let seen = flight.iter().zip(&followed).map(|(observed, followed)| {
            let nothing = || observed.with_boxes_that(|_, _| false);
            followed
                .as_ref()
                .map_or_else(nothing, |of| of.observed.clone())
        });
        let observed: Vec<Observation> = seen.collect();
        let phases: Vec<_> = (followed.iter())
            .map(|of| of.as_ref().map(|of| of.phase))
            .collect();
        let stated = followed.iter().map(|of| of.as_ref()?.stated().copied());
        let estimates: Vec<Option<Estimate>> = stated.collect();
        let task = Task::new(trained, &samples.scenarios, &observed);
        let answered = Estimator::ALL.map(|estimator| match estimator {
            Estimator::InverseRangeFiltered => Answered::of_estimates(estimates.clone()),
            Estimator::InverseRangeSmoothed => Answered::of_estimates(vec![None; observed.len()]),
            _ => {
                let mut answered = estimator.answers(&task);
                for (answer, phase) in answered.distances_m.iter_mut().zip(&phases) {
                    *answer = answer.filter(|_| *phase == Some(Phase::Arrival));
                }
                answered
            }
        });
        Self {
            answered: answered.into(),
            observed,
            withheld,
            phases: Some(phases),
        }
    }

    fn columns(&self, scenario: &str) -> TableWriter {
        let observed = &self.observed;
        let mut columns = TableWriter::new()
            .text("scenario", observed.iter().map(|_| scenario))
            .u32("tick", observed.iter().map(|seen| seen.tick))
            .i64("time_ns", observed.iter().map(|seen| seen.time_ns))
            .u32(
                "detections",
                observed.iter().map(|seen| seen.detections() as u32),
            );
        if let Some(phases) = &self.phases {
            let words = phases.iter().map(|phase| phase.map(Phase::word));
            columns = columns.optional_text("phase", words);
        }
        let ticks: Vec<usize> = (0..observed.len()).collect();
        add_answers(columns, &ticks, &self.answered)
    }
}
