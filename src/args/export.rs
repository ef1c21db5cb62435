//! Options of `dtd export`.

use std::num::NonZeroU32;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use dataset::corpus::splits::Side;
use exporter::{BoxSource, ExportRequest, Format, StillFormat, Ticks};

use crate::args::output::Output;
use crate::args::{WindowSize, folder, from_one};

/// Options of `dtd export`.
#[derive(Debug, Args)]
pub(crate) struct ExportArgs {
    /// Folder of the corpus; only `--to croissant` writes to it
    #[arg(value_parser = folder())]
    pub(crate) corpus: PathBuf,
    /// Format of the export
    #[arg(long, value_enum, value_name = "FORMAT")]
    to: To,
    /// Folder of the export, new or empty; it appears when the export is complete (not with croissant)
    #[arg(long, value_name = "FOLDER", value_parser = Output::Export.parser())]
    out: Option<PathBuf>,
    /// Only these scenarios, separated by commas
    #[arg(long, value_name = "ID,..", value_delimiter = ',')]
    only: Vec<String>,
    /// Export only these views, separated by commas
    #[arg(long, value_name = "VIEW,..", value_delimiter = ',')]
    views: Vec<String>,
    /// Export every N-th tick, from the first
    #[arg(long, value_name = "N", default_value = "1", value_parser = from_one)]
    every: NonZeroU32,
    /// Export N ticks per second, each the nearest to its time (lerobot)
    #[arg(long, value_name = "N", value_parser = from_one, conflicts_with = "every")]
    rate: Option<NonZeroU32>,
    /// Side of the split to export [default: all]
    #[arg(long, value_enum)]
    side: Option<OneSide>,
    /// Boxes to export, and around which to crop (crops) [default: truth]
    #[arg(long, value_enum)]
    boxes: Option<Boxes>,
    /// Model whose detections to use, by its file name or hash
    ///
    /// It must be named if the corpus has detections of several models.
    #[arg(long, value_name = "NAME|HASH")]
    detections: Option<String>,
    /// Width and height of crops [default: 160x160]
    #[arg(long, value_name = "WIDTHxHEIGHT")]
    crop_px: Option<WindowSize>,
    /// Seed of the order of crops [default: 0]
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Format of images that are files of their own [default: png]
    #[arg(long, value_enum)]
    pictures: Option<Pictures>,
    /// Evaluated run whose predictions to export (huggingface); may be repeated
    #[arg(long, value_name = "RUN")]
    run: Vec<PathBuf>,
    /// Licence that the export states: an SPDX identifier or a URL
    #[arg(long, value_name = "SPDX|URL", value_parser = license)]
    license: Option<String>,
    /// Print the result as JSON
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
    /// WebDataset: tar archives with a sample per tick
    Webdataset,
    /// WebDataset with crops around the aircraft in place of whole images, in a shuffled order
    Crops,
    /// MCAP for Foxglove: a file per scenario, with its videos
    Mcap,
    /// LeRobotDataset v3.0: an episode per scenario, with its videos; whole rates only
    Lerobot,
    /// Only croissant.json, written into the corpus to describe it; every export has its own
    Croissant,
}

/// Request made by the arguments.
pub(crate) enum Asked<'a> {
    /// An export to a folder.
    Export(ExportRequest, &'a Path),
    /// A description in the corpus itself.
    Description {
        /// The licence that it states.
        license: Option<String>,
    },
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum OneSide {
    Train,
    Validation,
    Test,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Boxes {
    /// Ground truth
    Truth,
    /// Detections of confirmed tracks
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
    if is_url || is_spdx {
        Ok(text.to_owned())
    } else {
        Err("expected an SPDX identifier, such as CC-BY-4.0, or a URL".into())
    }
}

impl ExportArgs {
    /// The request; options that do not apply to a description are refused.
    pub(crate) fn asked(&self) -> Result<Asked<'_>, String> {
        let format = match self.to {
            To::Coco => Format::Coco,
            To::Yolo => Format::Yolo,
            To::Huggingface => Format::HuggingFace,
            To::Webdataset => Format::WebDataset,
            To::Crops => Format::Crops,
            To::Mcap => Format::Mcap,
            To::Lerobot => Format::LeRobot,
            To::Croissant => return self.description(),
        };
        match &self.out {
            Some(out) => Ok(Asked::Export(self.request(format), out)),
            None => Err("--out FOLDER is missing: where the export is to be written".into()),
        }
    }

    fn description(&self) -> Result<Asked<'_>, String> {
        let given = [
            ("--out", self.out.is_some()),
            ("--only", !self.only.is_empty()),
            ("--views", !self.views.is_empty()),
            ("--every", self.every.get() > 1),
            ("--rate", self.rate.is_some()),
            ("--side", self.side.is_some()),
            ("--boxes", self.boxes.is_some()),
            ("--detections", self.detections.is_some()),
            ("--crop-px", self.crop_px.is_some()),
            ("--seed", self.seed.is_some()),
            ("--pictures", self.pictures.is_some()),
            ("--run", !self.run.is_empty()),
        ];
        match given.into_iter().find(|(_, is_given)| *is_given) {
            Some((option, _)) => Err(format!(
                "--to croissant describes the whole corpus, in its own folder; leave out {option}"
            )),
            None => Ok(Asked::Description {
                license: self.license.clone(),
            }),
        }
    }

    fn request(&self, format: Format) -> ExportRequest {
        let asked = |names: &[String]| (!names.is_empty()).then(|| names.to_vec());
        ExportRequest {
            format,
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
            ticks: self.rate.map_or(Ticks::Every(self.every), Ticks::PerSecond),
            boxes: match self.boxes {
                None | Some(Boxes::Truth) => BoxSource::Truth,
                Some(Boxes::Detections) => BoxSource::Detections,
            },
            crop_px: self.crop_px.map(|size| [size.width_px, size.height_px]),
            seed: self.seed,
            detections: self.detections.clone(),
            runs: self.run.clone(),
            license: self.license.clone(),
        }
    }
}
