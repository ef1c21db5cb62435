//! `dtd paper`: the paper's own experiment, from recording to the page that compares every table and figure with ours.
//!
//! The stages are the other verbs, in their order. Each stage's findings and time are kept in `PAPER.json`, so that a later call resumes
//! there.

mod notes;
mod results;
mod sweeps;
mod weaker;

use std::ops;
use std::path::{Path, PathBuf};
use std::slice;
use std::time::Instant;

use dataset::corpus::Corpus;
use dataset::corpus::splits::Side;
use detector_evaluation::EvaluationOptions;
use generator::plan::expand;
use generator::sweep::Sweep;
use labeller::detector::ModelFile;
use labeller::tiling::TilingSettings;
use labeller::{DetectOptions, Mode, SearchBands};
use paper_experiment::{SINGLE_VIEW_SHARE, SeenTicks, SingleViews, WeakerDetector};
use trainer::config::ScenarioSplitConfig;
use trainer::{EvaluationConfig, RunFolder, TrainConfig};

use super::Outcome;
use super::detect::{self, detect, refuse_other_models};
use super::evaluate::evaluate;
use super::evaluate_detector;
use super::generate::{ending_of, generate, options};
use super::label::{self, label};
use super::output::{Next, finish, print_json};
use super::train::{settings_in, train};
use crate::args::experiment::{PaperArgs, Scale};
use crate::failure::{Ending, Failure};
use crate::shipped::Detector;
use notes::{Notes, Settings};
use sweeps::PaperSweep;

/// Share of the scenarios that judge, as in the paper, where scenarios are drawn.
const TEST_SHARE: f64 = 0.3;
/// Side of the paper's tiles, pixels.
const TILE_PX: u32 = 640;
/// Shrink factor of the weaker detector's first pass.
const SHRINK: u32 = 2;
/// Shares of ticks that one view alone sees that are near enough to the paper's.
const SHARES: ops::Range<f64> = 0.13..0.17;
/// The weaker detector may see no less than this share of the ticks that the detector sees: without the far ones the test would be easier.
const MIN_SEEN: f64 = 0.9;
/// Stages in their order.
const CORPUS: &str = "corpus";
const LABELS: &str = "labels";
const DETECTIONS: &str = "detections";
const WEAKER: &str = "detections of the weaker detector";
const BY_TRAJECTORY: &str = "training, other flights";
const BY_SCENARIO: &str = "training, scenarios drawn";
const EVALUATIONS: &str = "evaluation of estimators";
/// Stages whose results depend on the settings of the training.
const OF_TRAINING: [&str; 3] = [BY_TRAJECTORY, BY_SCENARIO, EVALUATIONS];
/// Trainings, and the folders of their runs.
const RUNS: [(&str, Place); 2] = [
    (BY_TRAJECTORY, Place::ByTrajectory),
    (BY_SCENARIO, Place::ByScenario),
];
const RANGE_CORPUS: &str = "corpus for ranges";
const RANGES: &str = "ranges";

/// Runs the verb.
pub(crate) fn run(args: &PaperArgs) -> Outcome {
    let began = Instant::now();
    let sweep = PaperSweep::read(args)?;
    let detector = Detector::chosen(args.model.as_deref())?;
    for model in [Some(detector.path()), args.pretrained_detector.as_deref()] {
        model.map_or(Ok(()), refuse_other_models)?;
    }
    let training = training(args)?;
    let recorded = sweep.corpus()?;
    let settings = Settings {
        scale: args.scale.name().into(),
        plan_hash: expand(&recorded).plan_hash,
        model_blake3: identity(detector.path())?,
        dtd: env!("CARGO_PKG_VERSION").into(),
        training: training.clone(),
    };
    let mut experiment = Experiment {
        args,
        sweep,
        recorded,
        detector,
        training,
        notes: Notes::open(&args.out, settings)?,
    };
    if let Some(ending) = experiment.stages()? {
        return Ok(ending);
    }
    let page = results::write(&experiment)?;
    if args.json {
        print_json(&page.results)?;
    } else {
        println!("page: {}", page.path.display());
    }
    let run = experiment.place(Place::ByTrajectory);
    let next = Next::verb("view", &experiment.place(Place::Corpus));
    finish("paper", began, &next.and("--run").and(run.display()));
    Ok(Ending::Done)
}

/// Settings of the trainings, but for boxes and split.
fn training(args: &PaperArgs) -> Result<TrainConfig, Failure> {
    match (&args.config, args.scale) {
        (Some(path), _) => settings_in(path),
        (None, Scale::Full) => Ok(TrainConfig::default()),
        (None, Scale::Small) => Ok(sweeps::small_training()),
    }
}

/// Folders of the experiment.
#[derive(Debug, Clone, Copy)]
enum Place {
    Corpus,
    RangeCorpus,
    ByTrajectory,
    ByScenario,
    Weaker,
}

impl Place {
    /// Prefix of folders with a detector's ranges.
    const RANGES_OF: &str = "ranges-";

    const ALL: [Self; 5] = [
        Self::Corpus,
        Self::RangeCorpus,
        Self::ByTrajectory,
        Self::ByScenario,
        Self::Weaker,
    ];

    fn name(self) -> &'static str {
        match self {
            Self::Corpus => "corpus",
            Self::RangeCorpus => "range-corpus",
            Self::ByTrajectory => "run-other-flights",
            Self::ByScenario => "run-scenarios-drawn",
            Self::Weaker => "weaker-detector",
        }
    }
}

/// A stage's work.
type Stage = fn(&mut Experiment<'_>) -> Outcome;

/// The experiment in its folder.
struct Experiment<'a> {
    args: &'a PaperArgs,
    sweep: PaperSweep,
    /// The corpus, as it is recorded.
    recorded: Sweep,
    detector: Detector,
    training: TrainConfig,
    notes: Notes,
}

impl Experiment<'_> {
    fn place(&self, place: Place) -> PathBuf {
        self.args.out.join(place.name())
    }

    fn corpus(&self) -> Result<Corpus, Failure> {
        Corpus::open(&self.place(Place::Corpus)).map_err(Failure::of_corpus)
    }

    /// Runs all stages; returns the ending of an incomplete one.
    fn stages(&mut self) -> Result<Option<Ending>, Failure> {
        let stages: [(&str, Stage); 8] = [
            (CORPUS, |this| this.record(&this.recorded, Place::Corpus)),
            (LABELS, |this| label_in(&this.place(Place::Corpus))),
            (DETECTIONS, |this| this.detect()),
            (WEAKER, |this| this.detect_weaker()),
            (BY_TRAJECTORY, |this| this.train(Place::ByTrajectory)),
            (BY_SCENARIO, |this| this.train(Place::ByScenario)),
            (EVALUATIONS, |this| this.evaluate()),
            (RANGE_CORPUS, |this| this.record_for_ranges()),
        ];
        for (name, work) in stages {
            if let Some(ending) = self.stage(name, work)? {
                return Ok(Some(ending));
            }
        }
        let own = self.detector.path().to_owned();
        if let Some(ending) = self.stage(RANGES, |this| this.ranges(&own, false))? {
            return Ok(Some(ending));
        }
        let Some(model) = self.args.pretrained_detector.clone() else {
            return Ok(None);
        };
        let name = format!(
            "{RANGES}, {} {}",
            file_name(&model),
            short(&identity(&model)?)
        );
        self.stage(&name, |this| this.ranges(&model, true))
    }

    /// Runs a stage unless an earlier call did; the ending if it did not reach its end.
    fn stage(
        &mut self,
        name: &str,
        work: impl Fn(&mut Self) -> Outcome,
    ) -> Result<Option<Ending>, Failure> {
        if let Some(seconds) = self.notes.done_in_s(name) {
            eprintln!("paper: {name}: done already, in {seconds:.0} s");
            return Ok(None);
        }
        eprintln!("paper: {name}");
        let began = Instant::now();
        let ending = work(self);
        let is_done = matches!(ending, Ok(Ending::Done));
        self.notes.add(name, began.elapsed(), is_done)?;
        Ok(Some(ending?).filter(|ending| *ending != Ending::Done))
    }

    fn record(&self, sweep: &Sweep, place: Place) -> Outcome {
        let options = options(self.args.sim.clone())?;
        let generated = generate(sweep, &self.place(place), &options)?;
        for failed in &generated.failed {
            eprint_warning!("paper: {}: {}", failed.id, failed.reason);
        }
        ending_of(&generated)
    }

    fn record_for_ranges(&self) -> Outcome {
        match self.record(&self.sweep.range_corpus()?, Place::RangeCorpus)? {
            Ending::Done => label_in(&self.place(Place::RangeCorpus)),
            other => Ok(other),
        }
    }

    fn detect(&mut self) -> Outcome {
        let model = self.detector.path().to_owned();
        self.detect_with(&model, |notes, hash| notes.found.detections = Some(hash))
    }

    /// Searches with a detector that misses aircraft, so that one view alone sees as many ticks as in the paper: the first pass shrinks the
    /// images, and if that is not enough, boxes with low scores do not count either.
    fn detect_weaker(&mut self) -> Outcome {
        let corpus = self.corpus()?;
        let folder = self.place(Place::Weaker);
        let training = |hash: &str| SeenTicks::read(&corpus, hash, Some(Side::Train));
        let whole = training(&self.notes.detections()?)?.single_views(0.0).all;
        let mut search = |shrink: u32, least_score: f64| -> Result<(Ending, String), Failure> {
            let model = weaker::write(self.detector.path(), shrink, least_score, &folder)?;
            let ending = self.detect_with(&model, |notes, hash| {
                notes.found.weaker_detections = Some(hash);
            })?;
            let hash = self.notes.found.weaker_detections.clone();
            Ok((ending, hash.unwrap_or_default()))
        };
        let mut shrink = SHRINK;
        let (mut ending, mut hash) = search(shrink, 0.0)?;
        if ending == Ending::Done {
            let shrunk = training(&hash)?.single_views(0.0);
            let sees_less = (shrunk.all.seen as f64) < MIN_SEEN * whole.seen as f64;
            if sees_less || share(&shrunk) > SHARES.end {
                shrink = 1;
                (ending, hash) = search(shrink, 0.0)?;
            }
        }
        if ending != Ending::Done {
            return Ok(ending);
        }
        let least_score = training(&hash)?.least_score(SINGLE_VIEW_SHARE);
        if least_score > 0.0 {
            (ending, hash) = search(shrink, least_score)?;
            if ending != Ending::Done {
                return Ok(ending);
            }
        }
        let seen = |hash: &str| -> Result<SingleViews, Failure> {
            Ok(SeenTicks::read(&corpus, hash, None)?.single_views(0.0))
        };
        let single_views = seen(&hash)?;
        let reached = share(&single_views);
        if !SHARES.contains(&reached) {
            eprint_warning!(
                "paper: one view alone sees {:.1} % of the ticks, in the paper {:.0} %",
                100.0 * reached,
                100.0 * SINGLE_VIEW_SHARE
            );
        }
        self.notes.found.weaker = Some(WeakerDetector {
            first_pass_shrink: shrink,
            least_score,
            single_views,
            of_detector: seen(&self.notes.detections()?)?,
        });
        Ok(Ending::Done)
    }

    fn detect_with(&mut self, model: &Path, keep: impl Fn(&mut Notes, String)) -> Outcome {
        let corpus = self.corpus()?;
        let bands = SearchBands::of_training_side(&corpus)?;
        let detected = detect(
            &corpus,
            model,
            DetectOptions {
                settings: TilingSettings {
                    rows: bands.map(|bands| bands.small),
                    half_scale_rows: bands.and_then(|bands| bands.large),
                    ..TilingSettings::default()
                },
                mode: Mode::Full,
                ..self.args.runtime.options()
            },
        )?;
        let ending = detect::ending_of(&detected);
        if ending == Ending::Done {
            keep(&mut self.notes, detected.model_hash);
        }
        Ok(ending)
    }

    fn train(&mut self, place: Place) -> Outcome {
        let config = TrainConfig {
            model_hash: self.notes.found.weaker_detections.clone(),
            scenario_split: matches!(place, Place::ByScenario).then(|| ScenarioSplitConfig {
                test_share: TEST_SHARE,
                ..ScenarioSplitConfig::default()
            }),
            ..self.training.clone()
        };
        let corpus = self.corpus()?;
        let outcome = train(slice::from_ref(&corpus), &self.place(place), &config, true)?;
        if matches!(place, Place::ByTrajectory) {
            self.notes.found.recommended = Some(outcome.choice.estimator);
            self.notes.found.lateral_spread_m = Some(outcome.choice.lateral_spread_m);
        }
        Ok(Ending::Done)
    }

    fn evaluate(&self) -> Outcome {
        let corpus = self.corpus()?;
        for place in [Place::ByTrajectory, Place::ByScenario] {
            evaluate(&self.place(place), &corpus, &EvaluationConfig::default())?;
        }
        Ok(Ending::Done)
    }

    fn ranges(&mut self, model: &Path, is_pretrained: bool) -> Outcome {
        let hash = identity(model)?;
        let out = format!("{}{}", Place::RANGES_OF, short(&hash));
        let corpus = Corpus::open(&self.place(Place::RangeCorpus)).map_err(Failure::of_corpus)?;
        let mut modes = vec![Mode::Full, Mode::Scaled];
        // A detector that finds little has no track to follow.
        if !is_pretrained {
            modes.push(Mode::Tracked);
        }
        let evaluation = evaluate_detector::evaluate(
            &corpus,
            &EvaluationOptions {
                model: model.to_owned(),
                detect: DetectOptions {
                    settings: TilingSettings {
                        tile_px: Some(TILE_PX),
                        ..TilingSettings::default()
                    },
                    ..self.args.runtime.options()
                },
                modes,
                out: self.args.out.join(out),
            },
        )?;
        let Some(evaluation) = evaluation else {
            return Ok(Ending::Interrupted);
        };
        self.notes
            .found
            .ranges
            .retain(|range| range.model_blake3 != hash);
        self.notes
            .found
            .ranges
            .extend(results::ranges(&evaluation, is_pretrained));
        Ok(Ending::with_losses(&evaluation.failed))
    }

    fn run_folder(&self, place: Place) -> RunFolder {
        RunFolder::at(&self.place(place))
    }
}

fn label_in(corpus: &Path) -> Outcome {
    let corpus = Corpus::open(corpus).map_err(Failure::of_corpus)?;
    Ok(label::ending_of(&label(&corpus)?))
}

/// Share of the seen ticks that one view alone sees.
fn share(seen: &SingleViews) -> f64 {
    seen.all.of_seen().unwrap_or(0.0)
}

/// Hash of the model and its settings.
fn identity(model: &Path) -> Result<String, Failure> {
    let file = ModelFile::read(model).map_err(Failure::bad_input)?;
    Ok(file.identity().blake3())
}

fn short(hash: &str) -> &str {
    &hash[..8]
}

fn file_name(path: &Path) -> String {
    path.file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}
