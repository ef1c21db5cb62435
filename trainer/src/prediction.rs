//! Distances for a corpus without truth: what every estimator answers at every tick.

use std::path::Path;

use dataset::columns::TableWriter;
use dataset::corpus::Corpus;
use dataset::progress::Progress;

use crate::error::{CorpusFault, Error, Result};
use crate::estimator::{Estimator, Task};
use crate::evaluation::{add_estimates, check_cameras};
use crate::run_folder::RunFolder;
use crate::samples::Samples;
use crate::sealed_run::SealedRun;
use crate::trained_run::TrainedRun;

/// How much was predicted.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Predicted {
    /// Scenarios.
    pub scenarios: usize,
    /// Ticks, each a row of the table.
    pub ticks: usize,
    /// Ticks with an answer, by name of the estimator.
    pub answered: Vec<(&'static str, usize)>,
}

/// Writes the answers of all estimators at all ticks of a corpus to a table (Parquet). The corpus needs detections by the model of the
/// training, or by `detections`, but neither labels nor a split.
pub fn predict(
    run: &RunFolder,
    corpus: &Corpus,
    detections: Option<&str>,
    out: &Path,
    progress: &mut dyn Progress,
) -> Result<Predicted> {
    let trained = TrainedRun::of(&SealedRun::read(run)?)?;
    let model = detections.unwrap_or(&trained.summary.model_hash);
    let (corpus_read, flights) = Samples::without_truth(corpus, Some(model))?;
    check_cameras(run, corpus, &trained, &corpus_read)?;
    if flights.is_empty() {
        return Err(Error::corpus(corpus.root(), CorpusFault::NoScenarios));
    }
    let believed = trained.believed(&flights, &corpus_read);
    let task = Task::new(&trained, &corpus_read.scenarios, &believed);
    let scenario = |index: usize| &corpus_read.scenarios[index].id;
    let mut table = TableWriter::new()
        .text(
            "scenario",
            believed.iter().map(|seen| scenario(seen.scenario)),
        )
        .u32("tick", believed.iter().map(|seen| seen.tick))
        .i64("time_ns", believed.iter().map(|seen| seen.time_ns))
        .u32(
            "detections",
            believed.iter().map(|seen| seen.detections() as u32),
        );
    let mut answered = Vec::new();
    progress.begin("prediction", Estimator::ALL.len() as u64);
    for estimator in Estimator::ALL {
        let answers = estimator.predict(&task);
        answered.push((estimator.name(), answers.iter().flatten().count()));
        table = table.optional_f64(&format!("{}_dtd_m", estimator.name()), answers);
        if let Some(estimates) = estimator.estimates(&task) {
            table = add_estimates(table, estimator.name(), &estimates);
        }
        progress.advance(answered.len() as u64, estimator.name());
    }
    table.write(out)?;
    Ok(Predicted {
        scenarios: corpus_read.scenarios.len(),
        ticks: believed.len(),
        answered,
    })
}
