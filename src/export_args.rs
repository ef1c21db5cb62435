//! Options of `dtd export`.

use std::num::NonZeroU32;
use std::path::PathBuf;

use clap::{Args, ValueEnum};
use dataset::splits::Side;
use exporter::{BoxSource, ExportRequest, Format, StillFormat};

use crate::args::{folder, output};

/// What to export, and where to.
#[derive(Debug, Args)]
pub(crate) struct ExportArgs {
    /// Folder of the corpus; nothing is written to it
    #[arg(value_parser = folder())]
    pub(crate) corpus: PathBuf,
    /// Format of the export
    #[arg(long, value_enum, value_name = "FORMAT")]
    to: To,
    /// Folder of the export, new or empty; it appears when the export is complete
    #[arg(long, value_name = "DIR", value_parser = output())]
    pub(crate) out: PathBuf,
    /// Export only these scenarios, separated by commas
    #[arg(long, value_name = "ID,..", value_delimiter = ',')]
    only: Vec<String>,
    /// Export only these views, separated by commas
    #[arg(long, value_name = "VIEW,..", value_delimiter = ',')]
    views: Vec<String>,
    /// Export every N-th tick, from the first
    #[arg(long, value_name = "N", default_value = "1")]
    every: NonZeroU32,
    /// Export one side of the split
    #[arg(long, value_enum)]
    side: Option<OneSide>,
    /// Boxes to export
    #[arg(long, value_enum, default_value = "truth")]
    boxes: Boxes,
    /// Model whose detections to export, by its file name or hash, if the corpus has several
    #[arg(long, value_name = "NAME|HASH")]
    detections: Option<String>,
    /// Picture format
    #[arg(long, value_enum, default_value = "png")]
    pictures: Pictures,
    /// Print the counts as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

/// Formats.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum To {
    /// COCO: annotations.json and images/
    Coco,
    /// Ultralytics' YOLO: data.yaml, images/ and labels/ by side of the split
    Yolo,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum OneSide {
    Train,
    Validation,
    Test,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Boxes {
    /// The true ones
    Truth,
    /// Detected ones, of confirmed tracks only
    Detections,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Pictures {
    /// Exactly the decoded pixels
    Png,
    /// A fifth of the size, with losses
    Jpeg,
}

impl ExportArgs {
    /// What is asked for.
    pub(crate) fn request(&self) -> ExportRequest {
        let asked = |names: &[String]| (!names.is_empty()).then(|| names.to_vec());
        ExportRequest {
            format: match self.to {
                To::Coco => Format::Coco,
                To::Yolo => Format::Yolo,
            },
            stills: match self.pictures {
                Pictures::Png => StillFormat::Png,
                Pictures::Jpeg => StillFormat::Jpeg,
            },
            only: asked(&self.only),
            views: asked(&self.views),
            side: self.side.map(|side| match side {
                OneSide::Train => Side::Train,
                OneSide::Validation => Side::Validation,
                OneSide::Test => Side::Test,
            }),
            every: self.every,
            boxes: match self.boxes {
                Boxes::Truth => BoxSource::Truth,
                Boxes::Detections => BoxSource::Detections,
            },
            detections: self.detections.clone(),
        }
    }
}
