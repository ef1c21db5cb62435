//! Distances for a corpus without truth: what every estimator answers at every tick.

use std::path::Path;

use dataset::corpus::Corpus;
use dataset::corpus::splits::Side;
use dataset::tables::columns::{TableParts, TableWriter};
use dataset::work::watch::Watch;
use serde::{Serialize, Serializer};

use crate::error::{CorpusFault, Error, Result};
use crate::evaluation::answers::Answered;
use crate::evaluation::check_cameras;
use crate::evaluation::prediction_table::add_answers;
use crate::run::estimator::{Estimator, Task};
use crate::run::folder::RunFolder;
use crate::run::place::refuse_in_run;
use crate::run::sealed::SealedRun;
use crate::run::trained::TrainedRun;
use crate::samples::Samples;
use crate::samples::camera_health::Corrections;

/// How much was predicted.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Predicted {
    /// Scenarios.
    pub scenarios: usize,
    /// Ticks, each a row of the table.
    pub ticks: usize,
    /// Ticks with an answer, by name of the estimator.
    #[serde(serialize_with = "as_map")]
    pub answered: Vec<(&'static str, usize)>,
}

fn as_map<S: Serializer>(
    pairs: &[(&'static str, usize)],
    serializer: S,
) -> std::result::Result<S::Ok, S::Error> {
    serializer.collect_map(pairs.iter().copied())
}

/// Writes the answers of all estimators at all ticks of a corpus to a table (Parquet). The corpus needs detections by the model of the
/// training, or by `detections`, but neither labels nor a split.
pub fn predict(
    run: &RunFolder,
    corpus: &Corpus,
    detections: Option<&str>,
    out: &Path,
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
    let (mut corpus_read, mut flights) = Samples::without_truth(corpus, Some(model))?;
    check_cameras(run, corpus, &trained, &corpus_read)?;
    if flights.is_empty() {
        return Err(Error::corpus(corpus.root(), CorpusFault::NoScenarios));
    }
    if let Some(backgrounds) = &trained.backgrounds {
        let alignment = backgrounds.align_observations(
            &mut corpus_read,
            &[Side::Test],
            flights.iter_mut(),
            watch,
        )?;
        watch.say(&alignment.to_string());
    }
    let corrections = corpus_read.scenarios.iter().map(|of| of.corrections);
    if let Some(line) = Corrections::line(corrections) {
        watch.say(&line);
    }
    let mut table = TableParts::new(out);
    let mut answered = Estimator::ALL.map(|estimator| (estimator.name(), 0));
    watch.begin("prediction", corpus_read.scenarios.len() as u64);
    let mut done = 0;
    for flight in flights.chunk_by(|a, b| a.scenario == b.scenario) {
        watch.check()?;
        let believed = trained.believed(flight, &corpus_read);
        let of_flight = Answered::of_all(&Task::new(&trained, &corpus_read.scenarios, &believed));
        for ((_, count), of) in answered.iter_mut().zip(&of_flight) {
            *count += of.distances_m.iter().flatten().count();
        }
        let scenario = &corpus_read.scenarios[flight[0].scenario].id;
        let columns = TableWriter::new()
            .text("scenario", believed.iter().map(|_| scenario))
            .u32("tick", believed.iter().map(|seen| seen.tick))
            .i64("time_ns", believed.iter().map(|seen| seen.time_ns))
            .u32(
                "detections",
                believed.iter().map(|seen| seen.detections() as u32),
            );
        let ticks: Vec<usize> = (0..believed.len()).collect();
        table.add(add_answers(columns, &ticks, &of_flight))?;
        done += 1;
        watch.advance(done, scenario);
    }
    match table.finish_new() {
        // Made by another process in the meantime.
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
