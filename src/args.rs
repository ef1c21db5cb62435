//! Command-line arguments.
//!
//! A verb's argument is its subject, a run or a corpus; everything else is an option: `evaluate RUN --corpus CORPUS`,
//! `view CORPUS --run RUN`. `push` copies, from one argument to the other.

pub(crate) mod estimate;
pub(crate) mod estimator;
pub(crate) mod export;
mod local_udp;
mod output;
pub(crate) mod search;
mod shard;
pub(crate) mod view;

use std::env;
use std::ffi::OsString;
use std::net::IpAddr;
use std::num::NonZeroU32;
use std::path::PathBuf;
use std::process;
use std::str::FromStr;

use clap::builder::{PathBufValueParser, PossibleValuesParser, TypedValueParser};
use clap::{
    ArgAction, Args as ClapArgs, Command, CommandFactory, FromArgMatches, Parser, Subcommand,
    ValueEnum,
};
use clap_complete::Shell;
use dataset::numbers::frame_rate::FrameRate;
use dataset::video::VideoEncoder;
use dataset::work::memory::Bytes;
use generator::generate::{SimulatorTarget, Simulators};
use labeller::Device;
use mock_xplane::quirks::Quirks;
use mock_xplane::server::Faults;
use store::{CorpusLocation, StoreUrl, redacted};
use xplane_bridge::WebApiPlace;
use xplane_bridge::datarefs::Generation;
use xplane_bridge::pixels::PixelChoice;

use crate::help;
use estimate::EstimateArgs;
use estimator::{EvaluateArgs, ExportEstimatorsArgs, PredictArgs, RefitArgs, TrainArgs};
use export::ExportArgs;
use local_udp::LocalUdpArgs;
use output::Output;
use search::{SearchArgs, SearchMode};
use shard::ShardArg;
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
            .unwrap_or_else(|error| exit_without_secrets(&error));
        Self::from_arg_matches(&matches).unwrap_or_else(|error| exit_without_secrets(&error))
    }
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
        /// Files that it describes
        #[arg(default_value = "sweep")]
        of: SchemaOf,
    },
    /// Write the bundled sweeps, to copy and change
    ///
    /// demo.toml, scenarios.toml, paper.toml and detector.toml, with the flights and the detector that they name.
    #[command(after_help = help::EXAMPLES)]
    Examples(ExamplesArgs),
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
    /// Check that a corpus is sound, and name every fault
    #[command(after_help = help::VERIFY)]
    Verify(VerifyArgs),
    /// Show a corpus and its runs in the browser
    #[command(after_help = help::VIEW)]
    View(ViewArgs),
    /// Train the aircraft detector on a labelled corpus; resumes
    #[command(after_help = help::TRAIN_DETECTOR)]
    TrainDetector(TrainDetectorArgs),
    /// Make a runway's table for a sweep from published ones
    #[command(after_help = help::AIRPORT_IMPORT)]
    Airport(AirportArgs),
    /// Make recordings for a sweep from tracks of real arrivals
    #[command(after_help = help::TRACKS_IMPORT)]
    Tracks(TracksArgs),
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
    /// Settings of live estimation: ESTIMATE.toml of estimate
    Estimate,
    /// Lines on stderr with --progress json
    Progress,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct PlanArgs {
    /// The sweep, e.g. scenarios.toml
    #[arg(value_name = "SWEEP.toml")]
    pub(crate) sweep: PathBuf,
    /// Compare with this corpus, or its URL: which scenarios are complete, new, changed, removed
    ///
    /// The default is ./corpus if it was made from a sweep of this name.
    #[arg(long, value_name = "CORPUS|URL", value_parser = PathBufValueParser::new().try_map(|path| CorpusLocation::of(&path)))]
    pub(crate) against: Option<CorpusLocation>,
    /// Estimate the recording time with this simulator
    ///
    /// `mock` records a few images of every weather with the bundled simulator on this machine and measures. For an X-Plane (HOST:PORT, or
    /// `auto`), the profile measured by `dtd doctor` is used. By default, figures of the bundled simulator on two cores are used.
    #[arg(long, value_name = "mock|auto|HOST:PORT")]
    pub(crate) sim: Option<SimulatorTarget>,
    #[command(flatten)]
    pub(crate) local_udp: LocalUdpArgs,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

/// A whole number from 1.
pub(crate) fn from_one(text: &str) -> Result<NonZeroU32, String> {
    let number = text.parse();
    number.map_err(|_| format!("expected a whole number from 1 to {}", u32::MAX))
}

#[derive(Debug, ClapArgs)]
pub(crate) struct GenerateArgs {
    /// The sweep, e.g. scenarios.toml
    #[arg(value_name = "SWEEP.toml")]
    pub(crate) sweep: PathBuf,
    /// Folder of the corpus, created if missing, or its URL; finished scenarios are skipped
    ///
    /// A URL is s3://BUCKET/PREFIX or file:///FOLDER, with credentials from the environment (docs/corpus.md).
    #[arg(long, value_name = "CORPUS|URL", value_parser = Output::corpus_or_url())]
    pub(crate) out: CorpusLocation,
    /// For a URL: folder where scenarios are recorded before they are uploaded
    ///
    /// Runs on one machine may share it. The default is one per URL in the user's cache folder.
    #[arg(long, value_name = "FOLDER", value_parser = Output::Corpus.parser())]
    pub(crate) staging: Option<PathBuf>,
    /// For a URL: keep scenarios in the staging folder after the upload
    #[arg(long)]
    pub(crate) keep_staged: bool,
    /// The simulator, or several that share the work, separated by commas
    ///
    /// `mock` starts the bundled simulator on this machine, `mock:N` starts N, `mock:awkward` one with all awkward habits of live
    /// X-Plane (docs/simulator.md). HOST:PORT is X-Plane's UDP address, `auto` the X-Plane that announces itself on the network, tape:FILE
    /// a session recorded with `dtd tape`.
    #[arg(
        long,
        value_name = "mock[:N|:awkward]|auto|HOST:PORT|tape:FILE,..",
        default_value = "mock"
    )]
    pub(crate) sim: Simulators,
    #[command(flatten)]
    pub(crate) local_udp: LocalUdpArgs,
    /// Source of the images
    ///
    /// `link` sends them (the bundled simulator), `gl` reads X-Plane 11's frame back, `screen` grabs the simulator's window, `screenshot`
    /// has X-Plane write files (slow: an image takes seconds); `auto` uses the simulator's first offer.
    #[arg(long, value_name = "SOURCE", default_value_t = PixelChoice::Auto, value_parser = one_of::<PixelChoice>(&["auto", "link", "gl", "screen", "screenshot"]))]
    pub(crate) pixels: PixelChoice,
    /// Encoder of the videos; the sweep's codec stays as it is (h264 or h265 for a GPU)
    ///
    /// The default is software. An encoder that is named is tried first, with 100 images on this machine: their order, timestamps and
    /// colours, and what a kill would leave. One that fails is refused. scenario.json names the encoder (docs/video.md).
    #[arg(long, value_name = "ENCODER", value_parser = encoder())]
    pub(crate) encoder: Option<VideoEncoder>,
    /// Only these scenarios, separated by commas
    ///
    /// Their identifiers are those that `dtd plan` prints.
    #[arg(long, value_name = "ID,..", value_delimiter = ',')]
    pub(crate) only: Vec<String>,
    #[command(flatten)]
    pub(crate) shard: ShardArg,
    /// Longest wait for a simulator or an object store that does not answer
    ///
    /// Recording then continues without that simulator; without the store it ends.
    #[arg(long = "timeout", value_name = "SECONDS", default_value_t = 300)]
    pub(crate) timeout_s: u64,
    /// Shell command that restarts an X-Plane that is away for longer than --timeout
    ///
    /// It gets --sim's name of the X-Plane in DTD_SIMULATOR, ends the old X-Plane if it is still there, starts a new one in the background,
    /// and ends with status 0 (docs/x-plane.md has an example). Then the X-Plane's version, window and profile are checked again.
    #[arg(long, value_name = "COMMAND")]
    pub(crate) restart_simulator: Option<String>,
    /// Restart X-Plane after every N live flights, e.g. 45
    #[arg(long, value_name = "N", value_parser = from_one, requires = "restart_simulator")]
    pub(crate) restart_every: Option<NonZeroU32>,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct FetchArgs {
    /// The corpus: s3://BUCKET/PREFIX or file:///FOLDER
    pub(crate) url: StoreUrl,
    /// Folder of the corpus, created if missing. Existing scenarios are left alone
    #[arg(long, value_name = "FOLDER", value_parser = Output::Corpus.parser())]
    pub(crate) out: PathBuf,
    /// Only these scenarios, separated by commas
    #[arg(long, value_name = "ID,..", value_delimiter = ',')]
    pub(crate) only: Vec<String>,
    /// Longest wait for a store that does not answer
    #[arg(long = "timeout", value_name = "SECONDS", default_value_t = 300)]
    pub(crate) timeout_s: u64,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct PushArgs {
    /// Folder of the corpus
    #[arg(value_parser = folder())]
    pub(crate) corpus: PathBuf,
    /// Destination: s3://BUCKET/PREFIX or file:///FOLDER
    ///
    /// Damaged scenarios are replaced there, and unlabelled ones by labelled ones of the same recording.
    #[arg(value_parser = Output::url())]
    pub(crate) url: StoreUrl,
    /// Longest wait for a store that does not answer
    #[arg(long = "timeout", value_name = "SECONDS", default_value_t = 300)]
    pub(crate) timeout_s: u64,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

/// An encoder by its name.
fn encoder() -> impl TypedValueParser<Value = VideoEncoder> {
    let names = VideoEncoder::ALL.map(VideoEncoder::name);
    PossibleValuesParser::new(names).map(|name| {
        let all = VideoEncoder::ALL.into_iter();
        let mut named = all.filter(|encoder| encoder.name() == name);
        named.next().unwrap_or_default()
    })
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

#[derive(Debug, ClapArgs)]
pub(crate) struct LabelArgs {
    /// Folder of the corpus
    #[arg(value_parser = folder())]
    pub(crate) corpus: PathBuf,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct DetectArgs {
    /// Folder of the corpus
    #[arg(value_parser = folder())]
    pub(crate) corpus: PathBuf,
    /// The detector, an ONNX file [default: the bundled one]
    ///
    /// The bundled one is for images of the bundled simulator. Which models work, and the settings next to them: docs/detectors.md.
    #[arg(long, value_name = "M.onnx")]
    pub(crate) model: Option<PathBuf>,
    /// Parts of the images to search
    #[arg(long, value_enum, value_name = "MODE", default_value = "auto")]
    pub(crate) mode: SearchMode,
    #[command(flatten)]
    pub(crate) search: SearchArgs,
    #[command(flatten)]
    pub(crate) shard: ShardArg,
    #[command(flatten)]
    pub(crate) runtime: RuntimeArgs,
    /// Detect again even if this model's detections exist
    #[arg(long)]
    pub(crate) force: bool,
    /// Register the views again, with the cameras fitted by this run
    ///
    /// For a wrong calibration.json, as `dtd train` reports. Existing boxes stay.
    #[arg(long, value_name = "RUN", value_parser = folder(), conflicts_with = "force")]
    pub(crate) registration_of: Option<PathBuf>,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

/// Options of running a model.
#[derive(Debug, ClapArgs)]
pub(crate) struct RuntimeArgs {
    /// ONNX Runtime's library, an absolute path
    ///
    /// The default is ORT_DYLIB_PATH, else ../lib/dtd/libonnxruntime.so relative to the program's folder.
    #[arg(long = "onnx-runtime", value_name = "FILE")]
    pub(crate) library: Option<PathBuf>,
    /// Device for the detector: cpu, cuda, tensorrt, openvino, coreml or directml, or DEVICE:N for device N [default: cpu]
    ///
    /// All but cpu need a build of ONNX Runtime that has them (docs/detectors.md). Indices start at 0. `openvino` uses OpenVINO on the
    /// CPU, which is faster on CPUs with bfloat16; `openvino:N` is Intel's GPU N.
    #[arg(long, value_name = "DEVICE")]
    pub(crate) device: Option<Device>,
}

impl RuntimeArgs {
    /// Device for the detector.
    pub(crate) fn device(&self) -> Device {
        self.device.unwrap_or_default()
    }
}

#[derive(Debug, ClapArgs)]
pub(crate) struct EvaluateDetectorArgs {
    /// Folder of the labelled corpus; it is only read
    #[arg(value_parser = folder())]
    pub(crate) corpus: PathBuf,
    /// Folder for evaluation.json, report.html and partial results
    #[arg(long, value_name = "FOLDER", value_parser = Output::Folder.parser())]
    pub(crate) out: PathBuf,
    /// The detector, an ONNX file [default: the bundled one]
    #[arg(long, value_name = "M.onnx")]
    pub(crate) model: Option<PathBuf>,
    /// Parts of the images to search; all modes are compared
    #[arg(
        long,
        value_enum,
        value_name = "MODES",
        value_delimiter = ',',
        default_value = "full,scaled,tracked"
    )]
    pub(crate) mode: Vec<SearchMode>,
    #[command(flatten)]
    pub(crate) search: SearchArgs,
    #[command(flatten)]
    pub(crate) runtime: RuntimeArgs,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct VerifyArgs {
    /// Folder of the corpus, or its URL
    ///
    /// From an object store, scenarios are downloaded one after the other into a temporary folder.
    #[arg(value_name = "CORPUS|URL", value_parser = PathBufValueParser::new().try_map(|path| CorpusLocation::of(&path)))]
    pub(crate) corpus: CorpusLocation,
    /// Do not decode the videos: check hashes, tables and plan only
    #[arg(long)]
    pub(crate) no_decode: bool,
    /// Count missing planned scenarios as faults
    ///
    /// By default they are only reported, since the corpus may be unfinished.
    #[arg(long)]
    pub(crate) complete: bool,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct TrainDetectorArgs {
    /// Folder of the labelled corpus
    #[arg(value_parser = folder())]
    pub(crate) corpus: PathBuf,
    /// The ONNX file to write; settings, checkpoint and report are written next to it
    #[arg(long, value_name = "M.onnx", value_parser = Output::File.parser())]
    pub(crate) out: PathBuf,
    /// Duration of the training; the learning rate falls over this time [default: 30]
    #[arg(long, value_name = "MINUTES")]
    pub(crate) minutes: Option<f64>,
    /// A detector of this verb to start from instead of random weights
    #[arg(long, value_name = "M.onnx")]
    pub(crate) start_from: Option<PathBuf>,
    /// TOML file with settings that differ from the defaults
    ///
    /// All resulting settings are saved in the report.
    #[arg(long, value_name = "DETECTOR.toml")]
    pub(crate) config: Option<PathBuf>,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct AirportArgs {
    #[command(subcommand)]
    pub(crate) command: AirportCommand,
}

#[derive(Debug, Subcommand)]
pub(crate) enum AirportCommand {
    /// Print `[airport.ICAO.runway.NAME]` with the source of each figure, and where the tables differ
    #[command(after_help = help::AIRPORT_IMPORT)]
    Import(AirportImportArgs),
}

#[derive(Debug, ClapArgs)]
pub(crate) struct AirportImportArgs {
    /// The airport, e.g. EDDM
    #[arg(value_name = "ICAO")]
    pub(crate) airport: String,
    /// The runway in the landing direction, e.g. 26L
    pub(crate) runway: String,
    /// X-Plane's `apt.dat` and `earth_nav.dat`, or `runways.csv` of OurAirports; better several
    #[arg(long, required = true, num_args = 1.., value_name = "FILE")]
    pub(crate) from: Vec<PathBuf>,
    /// Tracks of arrivals as in `dtd tracks import`: how far they fly beside the runway
    #[arg(long, num_args = 1.., value_name = "FILE")]
    pub(crate) tracks: Vec<PathBuf>,
    /// Take the recommended figures where the files differ
    #[arg(long)]
    pub(crate) accept: bool,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct TracksArgs {
    #[command(subcommand)]
    pub(crate) command: TracksCommand,
}

#[derive(Debug, Subcommand)]
pub(crate) enum TracksCommand {
    /// Smooth the arrivals in files of tracks, and complete them to recordings
    #[command(after_help = help::TRACKS_IMPORT)]
    Import(TracksImportArgs),
}

#[derive(Debug, ClapArgs)]
pub(crate) struct TracksImportArgs {
    /// Tracks: CSV of `traffic` or OpenSky, `trace_full` of readsb, JSON lines of jet1090, or X-Plane's `Data.txt` or `.fdr`
    #[arg(required = true, value_name = "FILE")]
    pub(crate) files: Vec<PathBuf>,
    /// The runway on which they land, e.g. LFPG/09R
    #[arg(long, value_name = "ICAO/RUNWAY")]
    pub(crate) runway: String,
    /// A file with the runway's `[airport]` table: a sweep, or the output of `dtd airport import` [default: the built-in runways]
    #[arg(long, value_name = "FILE.toml")]
    pub(crate) airports: Option<PathBuf>,
    /// Folder for the recordings, one CSV file per arrival
    #[arg(long, value_name = "FOLDER")]
    pub(crate) out: PathBuf,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct InstallPluginArgs {
    /// The installation folder of X-Plane 11 or 12
    #[arg(value_name = "XPLANE_FOLDER")]
    pub(crate) folder: PathBuf,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct MockXplaneArgs {
    /// Address to listen on
    #[arg(long, default_value = "127.0.0.1")]
    pub(crate) bind: IpAddr,
    /// UDP port; 0 takes any free one
    ///
    /// The addresses are printed as one JSON line when it is ready.
    #[arg(long, default_value_t = 49000)]
    pub(crate) port: u16,
    /// X-Plane to imitate: versions, dataref names and weather handling differ
    #[arg(long, value_name = "VERSION", default_value = "12", value_parser = generation())]
    pub(crate) xplane: Generation,
    /// TCP port of X-Plane 12's Web API; 0 takes any free one [default: 8086, or any if --port is 0]
    ///
    /// It listens on this computer only.
    #[arg(long)]
    pub(crate) web_port: Option<u16>,
    /// Send no beacon
    #[arg(long)]
    pub(crate) no_beacon: bool,
    /// Replay a session recorded with `dtd tape`. Everything but address and beacon is then as recorded
    #[arg(long, value_name = "FILE.mcap", conflicts_with_all = ["xplane", "faults", "quirks", "clock_rate"])]
    pub(crate) tape: Option<PathBuf>,
    /// Faults, e.g. loss=0.1,reorder=0.05,seed=7,freeze=10:2,restart=captures:20:3
    ///
    /// WHEN of freeze=WHEN[:FOR_S] and restart=WHEN[:DOWN_S] is seconds, frames:N or captures:N. Cameras, VIEW from 0:
    /// late=VIEW:MS, shake=VIEW:RMS_PX:HZ, stick=VIEW:SHARE, turn=VIEW:RIGHT_DEG:AFTER_S.
    #[arg(
        long,
        value_name = "FAULTS",
        default_value = "",
        hide_default_value = true
    )]
    pub(crate) faults: Faults,
    /// Awkward habits of live X-Planes to imitate
    ///
    /// All of this X-Plane version, none, quick (those that do not slow clients down), or names from docs/reference/quirks.md separated by
    /// commas; a - before a name excludes it, e.g. all,-late_clouds. With `all`, the first scenario takes minutes.
    #[arg(
        long,
        value_name = "all|none|quick|NAME,..",
        default_value = "all",
        allow_hyphen_values = true
    )]
    pub(crate) quirks: Quirks,
    /// Run the simulator's clock this many times faster than real time
    #[arg(long, value_name = "N", default_value = "1", value_parser = clock_rate)]
    pub(crate) clock_rate: f64,
    /// Show the images in a window on the X11 display named by DISPLAY
    ///
    /// For `dtd generate --pixels screen`.
    #[arg(
        long,
        value_name = "WIDTHxHEIGHT",
        num_args = 0..=1,
        default_missing_value = "1920x1280"
    )]
    pub(crate) window: Option<WindowSize>,
    /// Serve the capture link with the plugin in this folder, xplane-bridge/plugin
    ///
    /// Python runs it against a fake of XPPython3. Images come from --xplane 11, which can read them back, or off the screen with
    /// --window, whose size the plugin then sees.
    #[arg(long, value_name = "FOLDER")]
    pub(crate) plugin: Option<PathBuf>,
    /// Size of the window that the plugin sees: the images' size
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "1920x1280")]
    pub(crate) plugin_window: WindowSize,
    /// Rare states of X-Plane, for tests
    #[arg(
        long,
        value_enum,
        value_name = "STATE,..",
        value_delimiter = ',',
        hide = true,
        conflicts_with = "tape"
    )]
    pub(crate) state: Vec<MockState>,
    /// Stop when standard input ends, besides Ctrl-C and SIGTERM
    ///
    /// It then ends with its parent process, even if that is killed.
    #[arg(long)]
    pub(crate) until_stdin_ends: bool,
}

/// A state of the bundled simulator that a test asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum MockState {
    /// The main menu: the Web API has no datarefs until a flight is loaded.
    MainMenu,
    /// "Accept incoming connections" is off: UDP is ignored and the Web API answers 403.
    IncomingOff,
    /// The beacon has no name, as X-Plane 12 may send it.
    NamelessBeacon,
    /// Our plugin is not installed: no capture link, so no recording.
    NoPlugin,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct DoctorArgs {
    /// The simulator: X-Plane's UDP address [default: the address in its beacon, else 127.0.0.1:49000]
    #[arg(long, value_name = "auto|HOST:PORT")]
    pub(crate) sim: Option<String>,
    #[command(flatten)]
    pub(crate) local_udp: LocalUdpArgs,
    /// Address of X-Plane 12's Web API
    ///
    /// The default is DTD_WEB_API, else port 8086 if X-Plane runs on this computer.
    #[arg(long, value_name = "HOST:PORT|off")]
    pub(crate) web_api: Option<WebApiPlace>,
    /// The sweep to record, whose images must fit the window [default: demo.toml if it exists]
    #[arg(long, value_name = "SWEEP.toml")]
    pub(crate) sweep: Option<PathBuf>,
    /// Measure what reports disagree on, even if this installation has a profile
    #[arg(long)]
    pub(crate) measure: bool,
    /// Skip the measurements
    #[arg(long, conflicts_with = "measure")]
    pub(crate) no_measure: bool,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct TapeArgs {
    /// The simulator: X-Plane's UDP address, `auto` for the X-Plane that announces itself, or the bundled simulator
    ///
    /// The bundled simulator (`mock:awkward` has all awkward habits) runs as long as the recorder.
    #[arg(long, value_name = "auto|mock|HOST:PORT")]
    pub(crate) sim: String,
    #[command(flatten)]
    pub(crate) local_udp: LocalUdpArgs,
    /// The tape to write. An existing file is never overwritten
    #[arg(long, value_name = "FILE.mcap", value_parser = Output::NewFile.parser())]
    pub(crate) out: PathBuf,
    /// Address to listen on
    #[arg(long, default_value = "127.0.0.1")]
    pub(crate) bind: IpAddr,
    /// UDP port for the clients; 0 takes any free one
    ///
    /// The addresses are printed as one JSON line when it is ready.
    #[arg(long, default_value_t = 49100)]
    pub(crate) port: u16,
    /// Stop when standard input ends, besides Ctrl-C and SIGTERM
    #[arg(long)]
    pub(crate) until_stdin_ends: bool,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct ExamplesArgs {
    /// Folder to write them to; existing files are kept
    #[arg(default_value = ".", value_parser = Output::Folder.parser())]
    pub(crate) folder: PathBuf,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct DemoArgs {
    /// The sweep to run [default: the bundled demo.toml]
    #[arg(long, value_name = "SWEEP.toml")]
    pub(crate) sweep: Option<PathBuf>,
    /// The detector, an ONNX file [default: the bundled one]
    #[arg(long, value_name = "M.onnx")]
    pub(crate) model: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) runtime: RuntimeArgs,
    /// Folder for the corpus and the run
    #[arg(long, value_name = "FOLDER", default_value = "target/demo", value_parser = Output::Folder.parser())]
    pub(crate) out: PathBuf,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct PaperArgs {
    /// Folder for paper.md, its figures, and all that they follow from; created if missing
    #[arg(long, value_name = "FOLDER", value_parser = Output::Folder.parser())]
    pub(crate) out: PathBuf,
    /// Scale of the experiment
    #[arg(long, value_enum, value_name = "SCALE", default_value = "full")]
    pub(crate) scale: Scale,
    /// The sweep to record [default: the bundled paper.toml]
    #[arg(long, value_name = "SWEEP.toml")]
    pub(crate) sweep: Option<PathBuf>,
    /// Images per second: 30 as in the paper, or a fraction such as 1/4 [default: the sweep's, 2]
    #[arg(long, value_name = "N", value_parser = frame_rate)]
    pub(crate) frame_rate: Option<FrameRate>,
    /// The simulator, or several that share the work, separated by commas
    ///
    /// As for `dtd generate`.
    #[arg(
        long,
        value_name = "mock[:N|:awkward]|auto|HOST:PORT|tape:FILE,..",
        default_value = "mock"
    )]
    pub(crate) sim: Simulators,
    /// The detector, an ONNX file [default: the bundled one]
    #[arg(long, value_name = "M.onnx")]
    pub(crate) model: Option<PathBuf>,
    /// A detector pretrained on photographs, to compare its range
    ///
    /// An ONNX file, e.g. a YOLO model of COCO, whose class of airplanes is used (docs/detectors.md). It may be named in a later call.
    #[arg(long, value_name = "M.onnx")]
    pub(crate) pretrained_detector: Option<PathBuf>,
    /// TOML file with settings that differ from the defaults
    ///
    /// As for `dtd train`. To train with other settings on the same corpus, move the runs away.
    #[arg(long, value_name = "TRAIN.toml")]
    pub(crate) config: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) runtime: RuntimeArgs,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

/// Parts of the paper's experiment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Scale {
    /// Eight scenarios with small images and little training, as a smoke test
    Small,
    /// The complete experiment
    Full,
}

impl Scale {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Small => "small",
            Self::Full => "full",
        }
    }
}

fn frame_rate(text: &str) -> Result<FrameRate, String> {
    let (numerator, denominator) = text.split_once('/').unwrap_or((text, "1"));
    let terms = numerator
        .trim()
        .parse()
        .ok()
        .zip(denominator.trim().parse().ok());
    let (numerator, denominator) =
        terms.ok_or("expected a number such as 30, or a fraction such as 1/2")?;
    FrameRate::new(numerator, denominator).map_err(|error| error.to_string())
}

/// Parser of a word from a list, which help and completions show.
fn one_of<T>(words: &'static [&'static str]) -> impl TypedValueParser<Value = T>
where
    T: FromStr<Err: std::error::Error + Send + Sync> + Clone + Send + Sync + 'static,
{
    PossibleValuesParser::new(words).try_map(|word| word.parse())
}

fn generation() -> impl TypedValueParser<Value = Generation> {
    PossibleValuesParser::new(["11", "12"]).map(|word| match word.as_str() {
        "11" => Generation::XPlane11,
        _ => Generation::XPlane12,
    })
}

fn clock_rate(text: &str) -> Result<f64, String> {
    let rate = text.parse::<f64>().ok();
    rate.filter(|rate| (1.0..=1_000.0).contains(rate))
        .ok_or_else(|| "expected 1 to 1000".into())
}

/// Window size, pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct WindowSize {
    pub(crate) width_px: u32,
    pub(crate) height_px: u32,
}

impl FromStr for WindowSize {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let side = |text: &str| text.parse::<u32>().ok().filter(|px| *px > 0);
        text.split_once('x')
            .and_then(|(width, height)| side(width).zip(side(height)))
            .map(|(width_px, height_px)| Self {
                width_px,
                height_px,
            })
            .ok_or_else(|| format!("{text:?} is not a size, expected e.g. 1920x1280"))
    }
}
