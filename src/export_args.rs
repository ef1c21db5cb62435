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
    /// Format of pictures that are files of their own; png, if it is left out
    #[arg(long, value_enum)]
    pictures: Option<Pictures>,
    /// An evaluated run whose predictions to export, too (huggingface); may be repeated
    #[arg(long, value_name = "RUN")]
    run: Vec<PathBuf>,
    /// Licence that the export states: an SPDX identifier or a URL
    #[arg(long, value_name = "SPDX|URL", value_parser = license)]
    license: Option<String>,
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
    /// Hugging Face's datasets: Parquet tables over all scenarios, videos, a dataset card
    Huggingface,
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

/// An SPDX identifier or a URL.
fn license(text: &str) -> Result<String, String> {
    let is_url = text.starts_with("https://") || text.starts_with("http://");
    let of_spdx = |c: char| c.is_ascii_alphanumeric() || "-.+".contains(c);
    let is_spdx = !text.is_empty() && text.chars().all(of_spdx);
    match is_url || is_spdx {
        true => Ok(text.to_owned()),
        false => Err("expected an SPDX identifier, such as CC-BY-4.0, or a URL".into()),
    }
}

impl ExportArgs {
    /// What is asked for.
    pub(crate) fn request(&self) -> ExportRequest {
        let asked = |names: &[String]| (!names.is_empty()).then(|| names.to_vec());
        ExportRequest {
            format: match self.to {
                To::Coco => Format::Coco,
                To::Yolo => Format::Yolo,
                To::Huggingface => Format::HuggingFace,
            },
            stills: self.pictures.map(|pictures| match pictures {
                Pictures::Png => StillFormat::Png,
                Pictures::Jpeg => StillFormat::Jpeg,
            }),
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
            runs: self.run.clone(),
            license: self.license.clone(),
        }
    }
}
