//! The page, and the results that it follows from.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use dataset::files::json_file::{read_json, write_atomically, write_json};
use detector_evaluation::{Evaluation, mode};
use labeller::Mode;
use paper_experiment::{CorpusFigures, Range, Results, Search, markdown, write_figures};
use trainer::Metrics;

use super::{Experiment, Place};
use crate::args::experiment::PaperArgs;
use crate::failure::Failure;

/// Estimators of the box plot, besides the recommended one: the paper's two.
const CHARTED: [&str; 2] = ["paper_lstm", "mono_network"];

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
        command: command(experiment.args),
        corpus: corpus_figures(experiment)?,
        weaker: notes.noted(notes.found.weaker.clone())?,
        ranges: notes.found.ranges.clone(),
        recommended: recommended.clone(),
        lateral_spread_m: notes.found.lateral_spread_m,
        by_trajectory: metrics(Place::ByTrajectory)?,
        by_scenario: metrics(Place::ByScenario)?,
        stages: notes.times(),
    }
    .compared();
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

/// The command that makes these figures anywhere: the options that change them, and a folder.
fn command(args: &PaperArgs) -> String {
    let mut command = format!("dtd paper --out paper --scale {}", args.scale.name());
    if let Some(rate) = args.frame_rate {
        command += &format!(" --frame-rate {rate}");
    }
    let files = [
        ("sweep", &args.sweep),
        ("config", &args.config),
        ("model", &args.model),
    ];
    for (option, file) in files {
        if let Some(file) = file {
            command += &format!(" --{option} {}", file.display());
        }
    }
    // Models of others are outside the repository.
    let pretrained = args.pretrained_detector.as_deref();
    if let Some(name) = pretrained.and_then(Path::file_name) {
        command += &format!(" --pretrained-detector {}", name.display());
    }
    command
}

fn corpus_figures(experiment: &Experiment<'_>) -> Result<CorpusFigures, Failure> {
    let mut figures = CorpusFigures {
        scale: experiment.args.scale.name().into(),
        ..CorpusFigures::default()
    };
    let mut flights = BTreeSet::new();
    for folder in experiment.corpus()?.scenarios()? {
        let scenario = folder.open()?;
        let record = scenario.record()?;
        figures.scenarios += 1;
        figures.pictures += record.pictures();
        figures.weathers.push(record.weather_name().to_owned());
        figures.times.push(record.time_of_day().to_owned());
        flights.insert(record.trajectory);
        figures.runway = format!("{} {}", record.runway.airport, record.runway.name);
        (figures.aircraft, figures.rig) = (record.aircraft, record.rig);
        figures.simulators.extend(record.versions.simulator);
        figures.frame_rate = record.frame_rate.to_string();
        if let Some(camera) = scenario.calibration()?.cameras.values().next() {
            (figures.width_px, figures.height_px) = (camera.width_px, camera.height_px);
        }
    }
    figures.flights = flights.len();
    for words in [
        &mut figures.simulators,
        &mut figures.weathers,
        &mut figures.times,
    ] {
        words.sort();
        words.dedup();
    }
    Ok(figures)
}

/// A detector's rows in table 2.
pub(super) fn ranges(evaluation: &Evaluation, is_pretrained: bool) -> Vec<Range> {
    let searches = [
        (Mode::Full, Search::Tiles),
        (Mode::Scaled, Search::Scaled),
        (Mode::Tracked, Search::Tracked),
    ];
    let row = |(mode, search): (Mode, Search)| {
        let figures = evaluation.modes.get(mode::key(mode))?;
        Some(Range {
            model: evaluation.model.identity.model.clone().unwrap_or_default(),
            model_blake3: evaluation.model.identity.blake3(),
            weather: evaluation.range_weather.clone(),
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
