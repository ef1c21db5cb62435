//! The evaluation itself: searches every scenario in every mode, counts, and writes the results.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};

use dataset::corpus::Corpus;
use dataset::corpus::open_scenario::OpenScenario;
use dataset::files::json_file::{write_atomically, write_json};
use dataset::work::watch::Watch;
use labeller::{DetectOptions, Failure, Findings, Mode, Searcher};

use crate::error::{Error, Result};
use crate::figures::{EvaluatedModel, Evaluation, RegistrationFigures, Tally};
use crate::mode;
use crate::outcome::Searched;
use crate::outcome::picture::pictures_of;
use crate::report;
use crate::report::example::Candidates;
use crate::search_store::{EVALUATION, REPORT, SearchStore};

/// Evaluation options.
#[derive(Debug, Clone)]
pub struct EvaluationOptions {
    /// The detector, an ONNX file.
    pub model: PathBuf,
    /// Options of the search in the videos; its mode is replaced by each of `modes`.
    pub detect: DetectOptions,
    /// The modes to compare.
    pub modes: Vec<Mode>,
    /// Folder of the results.
    pub out: PathBuf,
}

/// Evaluation outcome.
#[derive(Debug)]
pub enum Ended {
    /// `evaluation.json` and `report.html` are written.
    Done(Box<Evaluation>),
    /// The caller stopped it; the same call resumes it.
    Stopped {
        /// Scenarios that are searched, in all modes.
        searched: usize,
        /// Scenarios not yet searched.
        left: usize,
    },
}

/// Evaluates a detector on all scenarios of a labelled corpus. The corpus is only read. A scenario that cannot be searched is reported and
/// does not stop the others.
///
/// # Errors
/// The model, the options or the folder for the results cannot be used, or a scenario has no labels.
pub fn evaluate_detector(
    corpus: &Corpus,
    options: &EvaluationOptions,
    watch: &dyn Watch,
) -> Result<Ended> {
    let mut modes = options.modes.clone();
    modes.sort();
    modes.dedup();
    let searchers = modes
        .iter()
        .map(|&mode| {
            let mut detect = options.detect.clone();
            detect.mode = mode;
            Ok((mode, Searcher::load(&options.model, &detect)?))
        })
        .collect::<Result<Vec<_>>>()?;
    let mut ids = labelled(corpus)?;
    if let Some(only) = &options.detect.only {
        ids.retain(|(id, _)| only.contains(id));
    }
    let store = SearchStore::take(&options.out, corpus.root())?;
    let Some((_, searcher)) = searchers.first() else {
        return Err(Error::NoMode);
    };
    let model = EvaluatedModel {
        identity: searcher.model().clone(),
        device: options.detect.device.to_string(),
    };
    let mut run = Run {
        corpus,
        model,
        store,
        searchers,
        pictures_done: AtomicU64::new(0),
        counted: BTreeMap::new(),
        visibility_m: BTreeMap::new(),
    };
    let pictures: u64 = ids.iter().map(|(_, pictures)| pictures).sum();
    watch.begin("", modes.len() as u64 * pictures);
    let (mut searched, mut failed) = (Vec::new(), Vec::new());
    for (id, pictures) in &ids {
        let before = run.pictures_done.load(Ordering::Relaxed);
        match run.scenario(id, watch) {
            Ok(()) => searched.push(id.clone()),
            Err(Error::Search(labeller::Error::Stopped(_))) => {
                return Ok(Ended::Stopped {
                    searched: searched.len(),
                    left: ids.len() - searched.len() - failed.len(),
                });
            }
            // For the caller to change, not a fault of the scenario.
            Err(error @ Error::Search(labeller::Error::Option { .. })) => return Err(error),
            Err(Error::Search(error)) if error.is_of_environment() => return Err(error.into()),
            Err(Error::Dataset(error)) if error.is_of_environment() => return Err(error.into()),
            Err(error @ (Error::Dataset(_) | Error::Search(_))) => {
                failed.push(Failure {
                    id: id.clone(),
                    reason: error.to_string(),
                });
                let after = before + modes.len() as u64 * pictures;
                run.pictures_done.store(after, Ordering::Relaxed);
            }
            Err(error) => return Err(error),
        }
    }
    run.finish(searched, failed)
        .map(|evaluation| Ended::Done(Box::new(evaluation)))
}

/// Scenarios and their numbers of images; all must have labels.
fn labelled(corpus: &Corpus) -> Result<Vec<(String, u64)>> {
    let mut ids = Vec::new();
    for folder in corpus.scenarios()? {
        // One that cannot be opened is reported when it is its turn.
        let truth = folder.open().and_then(|scenario| {
            let is_labelled = scenario.truth_boxes_if_labelled()?.is_some();
            Ok((is_labelled, scenario.record()?.pictures()))
        });
        let pictures = match truth {
            Ok((true, pictures)) => pictures,
            Ok((false, _)) => return Err(Error::Unlabelled(folder.id())),
            Err(_) => 0,
        };
        ids.push((folder.id(), pictures));
    }
    Ok(ids)
}

struct Run<'a> {
    corpus: &'a Corpus,
    model: EvaluatedModel,
    store: SearchStore,
    searchers: Vec<(Mode, Searcher)>,
    pictures_done: AtomicU64,
    counted: BTreeMap<Mode, (Tally, Candidates)>,
    /// The shortest visibility of each weather, metres.
    visibility_m: BTreeMap<String, f64>,
}

impl Run<'_> {
    /// Searches a scenario in all modes and counts it. One that cannot be searched in one mode is counted in none.
    fn scenario(&mut self, id: &str, watch: &dyn Watch) -> Result<()> {
        let scenario = self.corpus.scenario(id).open()?;
        let record = scenario.record()?;
        let pictures = pictures_of(&scenario)?;
        let found = self
            .searchers
            .iter()
            .map(|(mode, searcher)| Ok((*mode, self.findings(*mode, searcher, &scenario, watch)?)))
            .collect::<Result<Vec<_>>>()?;
        for (mode, findings) in found {
            let searched = Searched::all(&pictures, &record.views, &findings.detections);
            let (tally, candidates) = self.counted.entry(mode).or_default();
            tally.count(&scenario, &searched, &findings)?;
            candidates.offer(&scenario, &searched)?;
        }
        if let Some(weather) = record.weather() {
            let visibility_m = self
                .visibility_m
                .entry(record.weather_name().to_owned())
                .or_insert(f64::INFINITY);
            *visibility_m = visibility_m.min(weather.visibility_m);
        }
        Ok(())
    }

    /// Findings in a scenario, from the search or from an earlier one.
    fn findings(
        &self,
        mode: Mode,
        searcher: &Searcher,
        scenario: &OpenScenario,
        watch: &dyn Watch,
    ) -> Result<Findings> {
        let progress = |done: u64| {
            let done = self.pictures_done.fetch_add(done, Ordering::Relaxed) + done;
            watch.advance(done, "");
        };
        let identity = searcher.identity();
        if let Some(findings) = self.store.load(mode, &identity, scenario)? {
            progress(scenario.record()?.pictures());
            return Ok(findings);
        }
        let findings = searcher.search(scenario, &|| progress(1), watch)?;
        self.store.keep(mode, &identity, scenario, &findings)?;
        Ok(findings)
    }

    /// Writes the results.
    fn finish(self, scenarios: Vec<String>, failed: Vec<Failure>) -> Result<Evaluation> {
        let range_weather = self
            .visibility_m
            .iter()
            .max_by(|a, b| a.1.total_cmp(b.1))
            .map(|(name, _)| name.clone());
        let mut tallies = self.counted.values().map(|(tally, _)| tally);
        let recall_weathers = tallies.next().map(Tally::open_weathers).unwrap_or_default();
        let (mut modes, mut examples) = (BTreeMap::new(), Vec::new());
        for (mode, (tally, candidates)) in self.counted {
            let figures = tally.figures(range_weather.as_ref(), &recall_weathers);
            modes.insert(mode::key(mode).to_owned(), figures);
            examples.push((mode, candidates.cut(self.corpus)?));
        }
        let first = examples
            .first()
            .and_then(|(mode, _)| modes.get(mode::key(*mode)));
        let registration = first.and_then(RegistrationFigures::of);
        let evaluation = Evaluation {
            dtd: env!("CARGO_PKG_VERSION").into(),
            model: self.model,
            scenarios,
            failed,
            range_weather,
            recall_weathers,
            modes,
            registration,
        };
        let page = report::page(&evaluation, &examples)?;
        write_atomically(&self.store.path(REPORT), page.as_bytes())?;
        write_json(&self.store.path(EVALUATION), &evaluation)?;
        Ok(evaluation)
    }
}
