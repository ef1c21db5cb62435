//! The page, and the results that it follows from.

use std::collections::BTreeSet;
use std::fs;
use std::path::PathBuf;

use dataset::files::json_file::{read_json, write_atomically, write_json};
use dataset::numbers::frame_rate::FrameRate;
use detector_evaluation::{EvaluatedMode, Evaluation};
use paper_experiment::{CorpusFigures, Range, Results, Search, markdown, write_figures};
use trainer::Metrics;

use super::{Experiment, Place};
use crate::failure::Failure;

/// Estimators of the box plot, besides the recommended one.
const CHARTED: [&str; 2] = ["paper_lstm", "mono_network_box"];

/// The written page.
pub(super) struct Page {
    pub(super) path: PathBuf,
    pub(super) results: Results,
}

/// Writes page, figures and results.
pub(super) fn write(experiment: &Experiment<'_>) -> Result<Page, Failure> {
    let notes = &experiment.notes;
    let recommended = notes.noted(notes.found.recommended.clone())?;
    let metrics = |place| -> Result<Metrics, Failure> {
        let path = experiment.run_folder(place).metrics_path();
        Ok(read_json(&path, "figures of an evaluation")?)
    };
    let results = Results {
        dtd: env!("CARGO_PKG_VERSION").into(),
        corpus: corpus_figures(experiment)?,
        weaker: notes.noted(notes.found.weaker.clone())?,
        ranges: notes.found.ranges.clone(),
        recommended: recommended.clone(),
        by_trajectory: metrics(Place::ByTrajectory)?,
        by_scenario: metrics(Place::ByScenario)?,
        stages: notes.times(),
    }
    .without_flights();
    let out = &experiment.args.out;
    let charted: Vec<&str> = CHARTED.into_iter().chain([&*recommended]).collect();
    let run = experiment.run_folder(Place::ByScenario);
    let corpus = experiment.corpus()?;
    write_figures(
        out,
        &corpus,
        &notes.detections()?,
        (&run, &results.by_scenario),
        &charted,
    )?;
    let folder = out.join("results");
    fs::create_dir_all(&folder).map_err(dataset::Error::io("create", &folder))?;
    write_json(&folder.join("paper.json"), &results)?;
    let path = out.join("paper.md");
    write_atomically(&path, markdown(&results).as_bytes())?;
    Ok(Page { path, results })
}

fn corpus_figures(experiment: &Experiment<'_>) -> Result<CorpusFigures, Failure> {
    let mut figures = CorpusFigures {
        scale: experiment.args.scale.name().into(),
        simulator: String::new(),
        scenarios: 0,
        flights: 0,
        width_px: 0,
        height_px: 0,
        frame_rate: String::new(),
        pictures: 0,
    };
    let mut flights = BTreeSet::new();
    for folder in experiment.corpus()?.scenarios()? {
        let scenario = folder.open()?;
        let record = scenario.record()?;
        figures.scenarios += 1;
        figures.pictures += record.pictures();
        flights.insert(record.trajectory);
        figures.simulator = record.versions.simulator;
        let FrameRate {
            numerator,
            denominator,
        } = record.frame_rate;
        figures.frame_rate = match denominator {
            1 => numerator.to_string(),
            _ => format!("{numerator}/{denominator}"),
        };
        if let Some(camera) = scenario.calibration()?.cameras.values().next() {
            (figures.width_px, figures.height_px) = (camera.width_px, camera.height_px);
        }
    }
    figures.flights = flights.len();
    Ok(figures)
}

/// The rows of table 2 of a detector.
pub(super) fn ranges(evaluation: &Evaluation, is_pretrained: bool) -> Vec<Range> {
    let searches = [
        (EvaluatedMode::AutoSegmentation, Search::Tiles),
        (EvaluatedMode::Scaled, Search::Scaled),
        (EvaluatedMode::Tracked, Search::Tracked),
    ];
    let row = |(mode, search): (EvaluatedMode, Search)| {
        let figures = evaluation.modes.get(mode.key())?;
        Some(Range {
            model: evaluation.model.identity.model.clone().unwrap_or_default(),
            is_pretrained,
            search,
            max_range_nm: figures.range.max_range_nm,
            effective_range_nm: figures.range.effective_range_nm,
            farthest_expected_nm: figures.range.farthest_expected_nm,
            recall: figures.recall.recall,
            cpu_ms_per_picture: figures.cpu_ms_per_picture,
        })
    };
    searches.into_iter().filter_map(row).collect()
}
