//! Arguments of the verbs that train, refit, judge, use and export estimators.

use std::path::PathBuf;

use clap::builder::TypedValueParser;
use clap::{ArgGroup, Args as ClapArgs};
use trainer::{JudgedSide, MAX_APPROACHES};

use crate::args::folder;
use crate::args::shared::choice::{Choices, choice};
use crate::args::shared::output::Output;

#[derive(Debug, ClapArgs)]
pub(crate) struct TrainArgs {
    /// Folder of the corpus, or of several with the same rig
    #[arg(value_name = "CORPUS", required = true, value_parser = folder())]
    pub(crate) corpora: Vec<PathBuf>,
    /// Folder for weights, settings and logs
    #[arg(long, value_name = "RUN", value_parser = Output::Run.parser())]
    pub(crate) out: PathBuf,
    /// Narrower layers and fewer steps, as in the demo
    ///
    /// Takes about a minute on two cores for a dozen scenarios.
    #[arg(long, conflicts_with = "config")]
    pub(crate) quick: bool,
    /// TOML file with settings that differ from the defaults
    ///
    /// All resulting settings are saved in RUN/config.json, which this option also accepts.
    #[arg(long, value_name = "TRAIN.toml")]
    pub(crate) config: Option<PathBuf>,
    /// Hyperparameter search over settings and seeds in a TOML file: a run in RUN for each, and a comparison (docs/training.md)
    #[arg(long, value_name = "SEARCH.toml", conflicts_with_all = ["quick", "config", "seed"])]
    pub(crate) search: Option<PathBuf>,
    /// Model whose detections to use, by its file name or hash
    ///
    /// It must be named if the corpus has detections of several models.
    #[arg(long, value_name = "NAME|HASH")]
    pub(crate) detections: Option<String>,
    /// Run whose networks to start from instead of random ones; views and layers must be the same
    #[arg(long, value_name = "RUN")]
    pub(crate) start_from: Option<PathBuf>,
    /// Hold out a weather, time of day, aircraft type or graphics setting as the test side, e.g. weather=stormy, time=18:00 or type=A359
    ///
    /// `dtd verify` names graphics settings that differ within a corpus, e.g. graphics=renopt_MSAA=0.
    #[arg(
        long,
        value_name = "weather=NAME|time=HH:MM|type=NAME|graphics=SETTING=VALUE"
    )]
    pub(crate) leave_out: Option<String>,
    /// Draw this share of the scenarios for the test, whatever flights they share, e.g. 0.3 as in the paper
    ///
    /// Test flights may then occur in the training, as the report states.
    #[arg(long, value_name = "SHARE", conflicts_with = "leave_out")]
    pub(crate) split_by_scenario: Option<f64>,
    /// Also train on scenarios whose weather at the aircraft was not the planned one
    ///
    /// `dtd generate` marks them, and `dtd verify` names them. They are left out otherwise.
    #[arg(long)]
    pub(crate) accept_weather: bool,
    /// Seed of weights and batches
    #[arg(long, value_name = "N")]
    pub(crate) seed: Option<u64>,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct PredictArgs {
    /// Folder of the run, as written by `dtd train`
    #[arg(value_parser = folder())]
    pub(crate) run: PathBuf,
    /// Folder of the corpus: recorded and searched by `dtd detect`
    #[arg(long, value_name = "CORPUS", value_parser = folder())]
    pub(crate) corpus: PathBuf,
    /// Table to write: a row per tick, a column per estimator
    #[arg(long, value_name = "FILE.parquet", value_parser = Output::NewFile.parser().try_map(parquet))]
    pub(crate) out: PathBuf,
    /// Model whose detections to use, by its file name or hash
    ///
    /// The default is the model of the training.
    #[arg(long, value_name = "NAME|HASH")]
    pub(crate) detections: Option<String>,
    /// Use only the ticks up to each answer, as for a live camera
    #[arg(long)]
    pub(crate) online: bool,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

/// Rejects names of other formats: the table is Parquet.
fn parquet(path: PathBuf) -> Result<PathBuf, String> {
    match path.extension().and_then(|ending| ending.to_str()) {
        Some(ending) if !ending.eq_ignore_ascii_case("parquet") => Err(format!(
            "its name ends in .{ending}, but the table is Parquet; choose a name that ends in .parquet"
        )),
        _ => Ok(path),
    }
}

/// Scenarios to judge.
const SIDES: Choices<JudgedSide, 2> = [
    (
        "test",
        "Scenarios on the test side of the split",
        JudgedSide::Test,
    ),
    (
        "all",
        "Every scenario, if the training saw none of the trajectories",
        JudgedSide::All,
    ),
];

#[derive(Debug, ClapArgs)]
pub(crate) struct RefitArgs {
    /// Folder of the run, as written by `dtd train`
    #[arg(value_parser = folder())]
    pub(crate) run: PathBuf,
    /// Folder of the corpus recorded with the new camera, labelled and detected
    #[arg(long, value_name = "CORPUS", value_parser = folder())]
    pub(crate) corpus: PathBuf,
    /// View whose camera is fitted again
    #[arg(long, value_name = "NAME")]
    pub(crate) view: String,
    /// Folder for the new run; a run that is already there is replaced, with its evaluation
    #[arg(long, value_name = "RUN2", value_parser = Output::Run.parser())]
    pub(crate) out: PathBuf,
    /// Number of approaches to use, the first of the training side; 10 at most
    #[arg(long, value_name = "N", default_value_t = MAX_APPROACHES)]
    pub(crate) scenarios: usize,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, ClapArgs)]
#[command(group(ArgGroup::new("judged").args(["run", "predictions"]).required(true)))]
pub(crate) struct EvaluateArgs {
    /// Folder of the run, as written by `dtd train`
    #[arg(value_parser = folder())]
    pub(crate) run: Option<PathBuf>,
    /// Table of predictions to judge instead of a run: Parquet or .csv
    ///
    /// Its columns are `scenario`, `tick` and, for each estimator, `NAME_dtd_m` in metres, empty where it has no prediction; optionally
    /// `NAME_dtd_m_from` and `NAME_dtd_m_to` (or `NAME_from_m` and `NAME_to_m`), a 90 % interval, and `detections`, the number
    /// of views that saw the aircraft. Other columns are ignored. `dtd predict` writes such tables.
    #[arg(long, value_name = "TABLE", conflicts_with = "detections")]
    pub(crate) predictions: Option<PathBuf>,
    /// Folder of the corpus
    #[arg(long, value_name = "CORPUS", value_parser = folder())]
    pub(crate) corpus: PathBuf,
    /// Folder for the results, new or empty; by default they are added to RUN
    ///
    /// Results of other evaluations are never replaced. With --predictions, the default is to write no files.
    #[arg(long, value_name = "FOLDER", value_parser = Output::Folder.parser())]
    pub(crate) out: Option<PathBuf>,
    /// Side of the split to judge
    #[arg(long, default_value = "test", value_parser = choice(SIDES))]
    pub(crate) side: JudgedSide,
    /// Model whose detections to use, by its file name or hash
    ///
    /// The default is the model of the training.
    #[arg(long, value_name = "NAME|HASH")]
    pub(crate) detections: Option<String>,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct ExportEstimatorsArgs {
    /// Folder of the run, as written by `dtd train`
    #[arg(value_parser = folder())]
    pub(crate) run: PathBuf,
    /// Folder for the models and MODEL_CARD.md; a new one, or an empty one
    #[arg(long, value_name = "FOLDER", value_parser = Output::Folder.parser())]
    pub(crate) out: PathBuf,
    /// ONNX Runtime's library, an absolute path
    ///
    /// The models are checked with it. The default is ORT_DYLIB_PATH, else ../lib/dtd/libonnxruntime.so relative to the program's folder.
    #[arg(long = "onnx-runtime", value_name = "FILE")]
    pub(crate) library: Option<PathBuf>,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}
