//! The words a person types.

use std::net::IpAddr;
use std::path::PathBuf;

use clap::{ArgAction, Args as ClapArgs, Parser, Subcommand};

/// Makes synchronised multi-camera recordings of approaches in X-Plane, labels them with the aircraft's distance to
/// touchdown (DTD), and trains and judges estimators of that distance.
///
/// The chain: plan -> generate -> label -> detect -> train -> evaluate. `dtd demo` runs all of it at small scale, without
/// X-Plane.
#[derive(Debug, Parser)]
#[command(
    name = "dtd",
    version,
    after_help = "Exit codes: 0 done, 1 failed, 2 bad arguments or input, 3 finished but some scenarios were lost, \
                  75 interrupted: run the same command again to go on.\n\
                  Results go to stdout, progress and logs to stderr."
)]
pub(crate) struct Args {
    /// Say more: -v what happens, -vv every detail. RUST_LOG overrides it.
    #[arg(short, long, global = true, action = ArgAction::Count)]
    pub(crate) verbose: u8,
    #[command(subcommand)]
    pub(crate) verb: Verb,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Verb {
    /// Show which scenarios a sweep expands to, without making them
    Plan(PlanArgs),
    /// Record the scenarios of a sweep: videos, 4D trajectory, calibration
    Generate(GenerateArgs),
    /// Compute distance-to-touchdown labels and true boxes
    Label(LabelArgs),
    /// Find the aircraft in the decoded videos with a detector
    Detect(DetectArgs),
    /// Train the distance estimators of a corpus, split by trajectory
    Train(TrainArgs),
    /// Judge a trained run on the held-out trajectories and write metrics.json and report.html
    Evaluate(EvaluateArgs),
    /// Prove that a corpus is whole and synchronised, and name every fault
    Verify(VerifyArgs),
    /// Train the single-class aircraft detector on a labelled corpus
    TrainDetector(TrainDetectorArgs),
    /// Run the stand-in X-Plane: UDP protocol, capture link, flight and renderer
    MockXplane(MockXplaneArgs),
    /// Run the whole chain at small scale, from sweep to report
    Demo(DemoArgs),
}

#[derive(Debug, ClapArgs)]
pub(crate) struct PlanArgs {
    /// The sweep, e.g. scenarios.toml
    #[arg(value_name = "SWEEP.toml")]
    pub(crate) sweep: PathBuf,
    /// Print the plan as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct GenerateArgs {
    /// The sweep, e.g. scenarios.toml
    #[arg(value_name = "SWEEP.toml")]
    pub(crate) sweep: PathBuf,
    /// Folder of the corpus; made if it is not there. Scenarios that are already whole are skipped
    #[arg(long, value_name = "CORPUS")]
    pub(crate) out: PathBuf,
    /// The simulator: `mock` starts the stand-in on this machine, HOST:PORT is X-Plane's UDP address
    #[arg(long, value_name = "mock|HOST:PORT", default_value = "mock")]
    pub(crate) sim: String,
    /// Make only these scenarios (identifiers as `dtd plan` prints them)
    #[arg(long, value_name = "ID", num_args = 1..)]
    pub(crate) only: Vec<String>,
    /// Print the outcome as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct LabelArgs {
    /// Folder of the corpus
    pub(crate) corpus: PathBuf,
    /// Print the outcome as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct DetectArgs {
    /// Folder of the corpus
    pub(crate) corpus: PathBuf,
    /// The detector, an ONNX file with a YOLO-like output
    #[arg(long, value_name = "M.onnx", default_value = "models/aircraft.onnx")]
    pub(crate) model: PathBuf,
    /// Detect again where this model's detections are already there
    #[arg(long)]
    pub(crate) again: bool,
    /// Print the outcome as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct TrainArgs {
    /// Folder of the corpus
    pub(crate) corpus: PathBuf,
    /// Folder for weights, settings and logs
    #[arg(long, value_name = "RUN")]
    pub(crate) out: PathBuf,
    /// Narrower layers and fewer steps, as the demo uses: about a minute for a small corpus
    #[arg(long, conflicts_with = "config")]
    pub(crate) quick: bool,
    /// Settings that differ from the defaults, a TOML file; the used ones are saved in RUN/config.json
    #[arg(long, value_name = "TRAIN.toml")]
    pub(crate) config: Option<PathBuf>,
    /// Which detections to learn from, if the corpus has those of several models: the model's hash
    #[arg(long, value_name = "HASH")]
    pub(crate) detections: Option<String>,
    /// Seed of weights and batches
    #[arg(long, value_name = "N")]
    pub(crate) seed: Option<u64>,
    /// Print the outcome as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct EvaluateArgs {
    /// Folder of the run, as `dtd train` wrote it
    pub(crate) run: PathBuf,
    /// Folder of the corpus
    #[arg(long, value_name = "CORPUS")]
    pub(crate) corpus: PathBuf,
    /// Print the metrics as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct VerifyArgs {
    /// Folder of the corpus
    pub(crate) corpus: PathBuf,
    /// Print the findings as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct TrainDetectorArgs {
    /// Folder of a labelled corpus
    pub(crate) corpus: PathBuf,
    /// The ONNX file to write; settings, checkpoint and report are written beside it
    #[arg(long, value_name = "M.onnx")]
    pub(crate) out: PathBuf,
    /// How long to train; the learning rate falls over this time
    #[arg(long, value_name = "MINUTES", default_value_t = 30.0)]
    pub(crate) minutes: f64,
    /// Print the report as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct MockXplaneArgs {
    /// Address to listen on
    #[arg(long, default_value = "127.0.0.1")]
    pub(crate) bind: IpAddr,
    /// UDP port; 0 takes any free one. The addresses are printed as one JSON line when it is ready
    #[arg(long, default_value_t = 49000)]
    pub(crate) port: u16,
    /// Stop when standard input ends, so that whoever started the stand-in takes it along, even when killed
    #[arg(long)]
    pub(crate) until_stdin_ends: bool,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct DemoArgs {
    /// The sweep to run
    #[arg(long, value_name = "SWEEP.toml", default_value = "demo.toml")]
    pub(crate) sweep: PathBuf,
    /// The detector
    #[arg(long, value_name = "M.onnx", default_value = "models/aircraft.onnx")]
    pub(crate) model: PathBuf,
    /// Folder for the corpus and the run
    #[arg(long, value_name = "FOLDER", default_value = "target/demo")]
    pub(crate) out: PathBuf,
    /// Throw away what an earlier demo left and start anew
    #[arg(long)]
    pub(crate) fresh: bool,
}
