//! Command-line arguments.
//!
//! A verb's argument is its subject, a run or a corpus; everything else is an option: `evaluate RUN --corpus CORPUS`,
//! `view CORPUS --run RUN`. `push` copies, from one argument to the other.

pub(crate) mod corpus;
pub(crate) mod detector;
pub(crate) mod estimate;
pub(crate) mod estimator;
pub(crate) mod experiment;
pub(crate) mod export;
pub(crate) mod imports;
pub(crate) mod recording;
pub(crate) mod shared;
pub(crate) mod simulator;
pub(crate) mod view;

use std::env;
use std::ffi::OsString;
use std::path::PathBuf;
use std::process;

use clap::builder::{PathBufValueParser, TypedValueParser};
use clap::error::{ContextKind, ContextValue};
use clap::{ArgAction, Command, CommandFactory, FromArgMatches, Parser, Subcommand, ValueEnum};
use clap_complete::Shell;
use dataset::work::memory::Bytes;
use store::{CorpusLocation, redacted};

use crate::help;
use corpus::{FetchArgs, LabelArgs, PushArgs, StatusArgs, VerifyArgs};
use detector::{DetectArgs, EvaluateDetectorArgs, TrainDetectorArgs};
use estimate::EstimateArgs;
use estimator::{EvaluateArgs, ExportEstimatorsArgs, PredictArgs, RefitArgs, TrainArgs};
use experiment::{DemoArgs, PaperArgs};
use export::ExportArgs;
use imports::{AircraftArgs, AirportCommand, ImportArgs, TracksCommand};
use recording::{GenerateArgs, PlanArgs};
use shared::output::Output;
use simulator::{DoctorArgs, InstallPluginArgs, MockXplaneArgs, TapeArgs};
use view::ViewArgs;

/// Heading of the options that every verb has.
const GLOBAL: &str = "Global options";

/// Makes synchronised multi-camera recordings of approaches in X-Plane, labels them with the aircraft's distance to touchdown
/// (DTD), and trains and evaluates estimators of that distance.
///
/// The pipeline: plan -> generate -> label -> detect -> train -> evaluate. `dtd demo` runs all of it at small scale, without
/// X-Plane.
#[derive(Debug, Parser)]
#[command(
    name = "dtd",
    version,
    after_help = help::ENDINGS
)]
pub(crate) struct Args {
    /// Verbose output: -v for events, -vv for every detail
    ///
    /// RUST_LOG overrides it.
    #[arg(short, long, global = true, action = ArgAction::Count, display_order = 900, help_heading = GLOBAL)]
    pub(crate) verbose: u8,
    /// Reject work that needs more memory than this, e.g. 512M or 4G
    ///
    /// The default is what the machine, its container and `ulimit -v` leave.
    #[arg(long, global = true, value_name = "SIZE", display_order = 901, help_heading = GLOBAL)]
    pub(crate) max_memory: Option<Bytes>,
    /// Form of stderr: `json` writes one object per line (`dtd schema progress`)
    #[arg(
        long,
        global = true,
        value_name = "FORM",
        default_value = "auto",
        hide_default_value = true,
        hide_possible_values = true,
        display_order = 902,
        help_heading = GLOBAL
    )]
    pub(crate) progress: ProgressForm,
    #[command(subcommand)]
    pub(crate) verb: Verb,
}

/// Forms of stderr.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum ProgressForm {
    /// Bars on a terminal, else lines with their times
    Auto,
    /// Programs
    Json,
}

impl Args {
    /// The command, whose help shows its verbs in groups.
    pub(crate) fn grouped_command() -> Command {
        let command = Self::command().max_term_width(help::COLUMNS);
        let template = help::template(&command);
        command.help_template(template)
    }

    /// The arguments of this process; ends it with a message if they are wrong.
    pub(crate) fn of_process() -> Self {
        let matches = Self::grouped_command()
            .try_get_matches_from(arguments(env::args_os().collect()))
            .unwrap_or_else(|error| exit_without_secrets(&with_hint(error)));
        Self::from_arg_matches(&matches).unwrap_or_else(|error| exit_without_secrets(&error))
    }
}

/// Words that are tried for verbs.
const OTHER_NAMES: [(&str, &str); 6] = [
    ("record", "generate"),
    ("replay", "generate"),
    ("simulate", "generate"),
    ("live", "estimate"),
    ("check", "verify"),
    ("init", "examples"),
];

/// The error with the verb that was probably meant.
fn with_hint(mut error: clap::Error) -> clap::Error {
    let given = error.get(ContextKind::InvalidSubcommand);
    let meant = OTHER_NAMES
        .iter()
        .find(|(other, _)| matches!(given, Some(ContextValue::String(given)) if given == other));
    if let Some((_, verb)) = meant {
        let verbs = ContextValue::Strings(vec![(*verb).to_owned()]);
        error.insert(ContextKind::SuggestedSubcommand, verbs);
    }
    error
}

/// Arguments for clap, whose `help` takes only verbs: `dtd help --help` is `dtd help`.
fn arguments(mut given: Vec<OsString>) -> Vec<OsString> {
    if given.len() == 3 && given[1] == "help" && (given[2] == "--help" || given[2] == "-h") {
        given.pop();
    }
    given
}

/// Ends with clap's error. It repeats the argument, but not its credentials: logs keep the output.
fn exit_without_secrets(error: &clap::Error) -> ! {
    let mut text = error.render().to_string();
    let arguments: Vec<String> = env::args_os()
        .filter_map(|argument| argument.into_string().ok())
        .collect();
    let values = arguments.iter().flat_map(|argument| {
        let value = argument.split_once('=').map(|(_, value)| value);
        // A list of simulators is quoted one by one.
        let parts = value.unwrap_or(argument).split(',');
        value.into_iter().chain([argument.as_str()]).chain(parts)
    });
    let mut has_secrets = false;
    for value in values.filter(|value| redacted(value) != *value) {
        has_secrets = true;
        text = text.replace(value, &redacted(value));
    }
    if !has_secrets {
        error.exit();
    }
    eprint!("{text}");
    process::exit(error.exit_code());
}

#[derive(Debug, Subcommand)]
pub(crate) enum Verb {
    /// Show a sweep's scenarios and cost without recording
    #[command(after_help = help::PLAN)]
    Plan(PlanArgs),
    /// Print the JSON Schema of sweeps, settings or progress
    #[command(after_help = help::SCHEMA)]
    Schema {
        /// The files that the schema describes
        #[arg(default_value = "sweep")]
        of: SchemaOf,
    },
    /// Write the bundled sweeps, to copy and change
    ///
    /// demo.toml, scenarios.toml, paper.toml and detector.toml, with the flights and the detector that they name.
    #[command(after_help = help::EXAMPLES)]
    Examples {
        /// Folder to write them to; existing files are kept
        #[arg(default_value = ".", value_parser = Output::Folder.parser())]
        folder: PathBuf,
    },
    /// Record a sweep: videos, 4D trajectory, calibration; resumes
    #[command(after_help = help::GENERATE)]
    Generate(GenerateArgs),
    /// Download a corpus from an object store; resumes
    #[command(after_help = help::FETCH)]
    Fetch(FetchArgs),
    /// Upload a corpus to an object store; resumes
    ///
    /// Labels and detections are included.
    #[command(after_help = help::PUSH)]
    Push(PushArgs),
    /// Compute DTD and ground-truth boxes; resumes
    #[command(after_help = help::LABEL)]
    Label(LabelArgs),
    /// Find the aircraft, and register the views; resumes
    #[command(after_help = help::DETECT)]
    Detect(DetectArgs),
    /// Train distance estimators, split by trajectory; resumes
    #[command(after_help = help::TRAIN)]
    Train(TrainArgs),
    /// Fit a run's camera again from a few approaches
    ///
    /// For a camera that is new, moved, turned or zoomed. Everything else is left unchanged (docs/training.md).
    #[command(after_help = help::REFIT)]
    Refit(RefitArgs),
    /// Evaluate a run, or predictions, on held-out trajectories
    #[command(after_help = help::EVALUATE)]
    Evaluate(EvaluateArgs),
    /// Write a run's distances for a corpus, labelled or not
    #[command(after_help = help::PREDICT)]
    Predict(PredictArgs),
    /// Estimate distances from camera feeds, while they run
    #[command(after_help = help::ESTIMATE)]
    Estimate(EstimateArgs),
    /// Export a run's estimators as ONNX models with a model card
    #[command(after_help = help::EXPORT_ESTIMATORS)]
    ExportEstimators(ExportEstimatorsArgs),
    /// Evaluate a detector: range, recall, accuracy, cost; resumes
    #[command(after_help = help::EVALUATE_DETECTOR)]
    EvaluateDetector(EvaluateDetectorArgs),
    /// Export a corpus to the formats of other tools; resumes
    #[command(after_help = help::EXPORT)]
    Export(ExportArgs),
    /// Show how far a corpus is, and the time left
    #[command(after_help = help::STATUS)]
    Status(StatusArgs),
    /// Check that a corpus is sound, and name every fault
    #[command(after_help = help::VERIFY)]
    Verify(VerifyArgs),
    /// Show a corpus and its runs in the browser
    #[command(after_help = help::VIEW)]
    View(ViewArgs),
    /// Train the aircraft detector on a labelled corpus; resumes
    #[command(after_help = help::TRAIN_DETECTOR)]
    TrainDetector(TrainDetectorArgs),
    /// List the aircraft types that sweeps may name, and draw them
    #[command(after_help = help::AIRCRAFT)]
    Aircraft(AircraftArgs),
    /// Make a runway's table for a sweep from published ones
    #[command(subcommand, after_help = help::AIRPORT_IMPORT)]
    Airport(AirportCommand),
    /// Make recordings for a sweep from tracks of real arrivals
    #[command(subcommand, after_help = help::TRACKS_IMPORT)]
    Tracks(TracksCommand),
    /// Make a corpus of recorded videos, cameras and tracks
    #[command(after_help = help::IMPORT)]
    Import(ImportArgs),
    /// Install the plugin for poses and images into X-Plane
    #[command(after_help = help::INSTALL_PLUGIN)]
    InstallPlugin(InstallPluginArgs),
    /// Run the bundled simulator, with X-Plane's protocols
    #[command(after_help = help::MOCK_XPLANE)]
    MockXplane(MockXplaneArgs),
    /// Examine the connection to X-Plane, and say how to fix it
    #[command(after_help = help::DOCTOR)]
    Doctor(DoctorArgs),
    /// Record a session with X-Plane on a tape (MCAP), as a proxy
    #[command(after_help = help::TAPE)]
    Tape(TapeArgs),
    /// Run the whole pipeline at small scale, from sweep to report
    #[command(after_help = help::DEMO)]
    Demo(DemoArgs),
    /// Repeat the paper's experiment, and compare; resumes
    ///
    /// Records its corpus, finds the aircraft, trains and judges its estimators and ours, and writes paper.md, in which each table and
    /// figure of the paper stands beside ours, or the reason why there is none.
    #[command(after_help = help::PAPER)]
    Paper(PaperArgs),
    /// Print a script that completes arguments in a shell
    #[command(after_help = help::COMPLETIONS)]
    Completions {
        /// Shell
        shell: Shell,
    },
    /// Write the manual pages, one per verb
    #[command(after_help = help::MAN)]
    Man {
        /// Folder to write them to, created if missing
        #[arg(value_parser = Output::Folder.parser())]
        folder: PathBuf,
    },
}

/// Files with a JSON Schema.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum SchemaOf {
    /// Sweeps: SWEEP.toml of plan and generate
    Sweep,
    /// Training settings: TRAIN.toml of train
    Train,
    /// Lines on stderr with --progress json
    Progress,
}

/// A folder, for verbs that work on local files: a URL is rejected instead of being taken for a folder name.
pub(crate) fn folder() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().try_map(local)
}

/// A local path.
pub(crate) fn local(path: PathBuf) -> Result<PathBuf, String> {
    match CorpusLocation::of(&path) {
        Ok(CorpusLocation::Folder(path)) => Ok(path),
        Ok(CorpusLocation::Store(url)) => Err(format!(
            "expected a folder: download the corpus first, with `dtd fetch {url} --out FOLDER`, and upload it with `dtd push FOLDER {url}`"
        )),
        Err(error) => Err(error.to_string()),
    }
}
