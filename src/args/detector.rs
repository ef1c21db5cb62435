//! Arguments of the verbs that use, judge and train detectors.

use std::path::PathBuf;

use clap::Args;
use labeller::{DetectOptions, Device, Mode};

use crate::args::folder;
use crate::args::shared::choice::choice;
use crate::args::shared::output::Output;
use crate::args::shared::search::{MODES, SearchArgs};
use crate::args::shared::shard::ShardArg;

#[derive(Debug, Args)]
pub(crate) struct DetectArgs {
    /// Folder of the corpus
    #[arg(value_parser = folder())]
    pub(crate) corpus: PathBuf,
    /// The detector, an ONNX file [default: the bundled one]
    ///
    /// The bundled one is for images of the bundled simulator, and has never seen a photograph. Which models work, and the settings next to
    /// them: docs/detectors.md.
    #[arg(long, value_name = "M.onnx")]
    pub(crate) model: Option<PathBuf>,
    /// Parts of the images to search
    #[arg(long, value_parser = choice(MODES), value_name = "MODE", default_value = "auto")]
    pub(crate) mode: Mode,
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
#[derive(Debug, Args)]
pub(crate) struct RuntimeArgs {
    /// ONNX Runtime's library, an absolute path
    ///
    /// The default is ORT_DYLIB_PATH, else ../lib/dtd/libonnxruntime.so relative to the program's folder.
    #[arg(long = "onnx-runtime", value_name = "FILE")]
    pub(crate) library: Option<PathBuf>,
    /// Device for the detector: cpu, cuda, tensorrt or openvino, or DEVICE:N for device N [default: cpu]
    ///
    /// All but cpu need a build of ONNX Runtime that has them (docs/detectors.md). Indices start at 0. `openvino` uses OpenVINO on the
    /// CPU, which is faster on CPUs with bfloat16; `openvino:N` is Intel's GPU N.
    #[arg(long, value_name = "DEVICE")]
    pub(crate) device: Option<Device>,
}

impl RuntimeArgs {
    /// Options of a search with this library and device.
    pub(crate) fn options(&self) -> DetectOptions {
        DetectOptions {
            onnx_runtime: self.library.clone(),
            device: self.device.unwrap_or_default(),
            ..DetectOptions::default()
        }
    }
}

#[derive(Debug, Args)]
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
        value_parser = choice(MODES),
        value_name = "MODES",
        value_delimiter = ',',
        default_value = "full,scaled,tracked"
    )]
    pub(crate) mode: Vec<Mode>,
    #[command(flatten)]
    pub(crate) search: SearchArgs,
    #[command(flatten)]
    pub(crate) runtime: RuntimeArgs,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
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
