//! Arguments of the verbs that run the whole pipeline.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use dataset::numbers::frame_rate::{FrameRate, text};
use generator::generate::Simulators;
use serde::de::{IntoDeserializer, value};

use crate::args::detector::RuntimeArgs;
use crate::args::shared::output::Output;

#[derive(Debug, Args)]
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

#[derive(Debug, Args)]
pub(crate) struct PaperArgs {
    /// Folder for paper.md, its figures, and the corpus and runs behind them; created if missing
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

fn frame_rate(rate: &str) -> Result<FrameRate, value::Error> {
    text::deserialize(rate.into_deserializer())
}
