//! Options of `dtd export`.

use std::num::NonZeroU32;
use std::path::PathBuf;

use clap::Args;
use dataset::corpus::splits::Side;
use exporter::{BoxSource, ExportRequest, Format, StillFormat};

use crate::args::folder;
use crate::args::shared::choice::{Choices, choice, from_one, size};
use crate::args::shared::output::Output;

#[derive(Debug, Args)]
pub(crate) struct ExportArgs {
    /// Folder of the corpus
    #[arg(value_parser = folder())]
    pub(crate) corpus: PathBuf,
    /// Format of the export
    #[arg(long = "to", value_name = "FORMAT", value_parser = choice(FORMATS))]
    format: Format,
    /// Folder of the export, new or empty; it appears when the export is complete
    #[arg(long, value_name = "FOLDER", value_parser = Output::Export.parser())]
    pub(crate) out: PathBuf,
    /// Only these scenarios, separated by commas
    #[arg(long, value_name = "ID,..", value_delimiter = ',')]
    only: Option<Vec<String>>,
    /// Export only these views, separated by commas
    #[arg(long, value_name = "VIEW,..", value_delimiter = ',')]
    views: Option<Vec<String>>,
    /// Export every N-th tick, from the first
    #[arg(long, value_name = "N", default_value = "1", value_parser = from_one)]
    every: NonZeroU32,
    /// Side of the split to export [default: all]
    #[arg(long, value_parser = choice(SIDES))]
    side: Option<Side>,
    /// Boxes to export, and around which to crop (crops) [default: truth]
    #[arg(long, value_parser = choice(BOXES))]
    boxes: Option<BoxSource>,
    /// Model whose detections to use, by its file name or hash
    ///
    /// It must be named if the corpus has detections of several models.
    #[arg(long, value_name = "NAME|HASH")]
    detections: Option<String>,
    /// Width and height of crops [default: 160x160]
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = size)]
    crop_px: Option<[u32; 2]>,
    /// Minimum number of shards per side, for as many loader workers (webdataset, crops) [default: 16]
    #[arg(long, value_name = "N", value_parser = from_one)]
    shards: Option<NonZeroU32>,
    /// Format of images in separate files [default: png]
    #[arg(long, value_parser = choice(PICTURES))]
    pictures: Option<StillFormat>,
    /// Evaluated run whose predictions to export (huggingface); may be repeated
    #[arg(long, value_name = "RUN")]
    run: Vec<PathBuf>,
    /// Licence that the export states: an SPDX identifier or a URL (huggingface, coco)
    #[arg(long, value_name = "SPDX|URL", value_parser = license)]
    license: Option<String>,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

const FORMATS: Choices<Format, 6> = [
    ("coco", "COCO: annotations.json and images/", Format::Coco),
    (
        "yolo",
        "Ultralytics' YOLO: data.yaml, images/ and labels/ by side of the split",
        Format::Yolo,
    ),
    (
        "huggingface",
        "Hugging Face's datasets: Parquet tables over all scenarios, videos, a dataset card",
        Format::HuggingFace,
    ),
    (
        "webdataset",
        "WebDataset: tar archives with a sample per tick",
        Format::WebDataset,
    ),
    (
        "crops",
        "WebDataset with crops around the aircraft in place of whole images, in a shuffled order",
        Format::Crops,
    ),
    (
        "mcap",
        "MCAP for Foxglove: a file per scenario, with its videos",
        Format::Mcap,
    ),
];

const SIDES: Choices<Side, 3> = [
    ("train", "", Side::Train),
    ("validation", "", Side::Validation),
    ("test", "", Side::Test),
];

const BOXES: Choices<BoxSource, 2> = [
    ("truth", "Ground truth", BoxSource::Truth),
    (
        "detections",
        "Detections of confirmed tracks",
        BoxSource::Detections,
    ),
];

const PICTURES: Choices<StillFormat, 2> = [
    ("png", "Exactly the decoded pixels", StillFormat::Png),
    (
        "jpeg",
        "A fifth of the size, with losses",
        StillFormat::Jpeg,
    ),
];

/// An SPDX identifier or a URL.
fn license(text: &str) -> Result<String, String> {
    let is_url = text.starts_with("https://") || text.starts_with("http://");
    let of_spdx = |c: char| c.is_ascii_alphanumeric() || "-.+".contains(c);
    let is_spdx = !text.is_empty() && text.chars().all(of_spdx);
    if is_url || is_spdx {
        Ok(text.to_owned())
    } else {
        Err("expected an SPDX identifier, such as CC-BY-4.0, or a URL".into())
    }
}

impl ExportArgs {
    /// The request.
    pub(crate) fn request(&self) -> ExportRequest {
        ExportRequest {
            format: self.format,
            stills: self.pictures,
            only: self.only.clone(),
            views: self.views.clone(),
            side: self.side,
            every: self.every,
            boxes: self.boxes.unwrap_or(BoxSource::Truth),
            crop_px: self.crop_px,
            shards: self.shards,
            detections: self.detections.clone(),
            runs: self.run.clone(),
            license: self.license.clone(),
        }
    }
}
