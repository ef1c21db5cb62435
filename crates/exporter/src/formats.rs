//! Formats of other tools, a file per format: what each can express, and its files.
//!
//! `export.rs` selects, checks and counts the scenarios, decodes several at a time, resumes and seals. A format implements [`FileFormat`].
//! [`Format`] lists them all with their [`Abilities`].

mod coco;
mod huggingface;
mod lerobot;
mod mcap_files;
mod picture_files;
mod webdataset;
mod yolo;

use std::path::{Path, PathBuf};

use dataset::work::watch::Watch;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::description::croissant::Contents;
use crate::error::Result;
use crate::export::{Export, ExportOutcome, export_as};
use crate::place::Place;
use crate::request::Format;
use crate::scenarios::Source;

/// A format: what it refuses, and the files that it writes.
pub(crate) trait FileFormat: Default + Sync {
    /// Record of a scenario whose files are all written, for the files that belong to all scenarios.
    type Part: Serialize + DeserializeOwned;

    /// True if the scenarios are written side by side of the split, because its splits are ranges.
    const BY_SIDE: bool = false;

    /// Prepares an export, of which no scenario was opened yet.
    fn prepare(&mut self, _export: &Export<'_>) -> Result<()> {
        Ok(())
    }

    /// Adds to the identity of an export what is neither in the request nor in the scenarios.
    fn hash(&self, _hasher: &mut blake3::Hasher) {}

    /// Checks a scenario before any file is written.
    fn check(&mut self, _source: &Source<'_>, _export: &Export<'_>) -> Result<()> {
        Ok(())
    }

    /// Checks the export as a whole before any file is written, and may add a remark to its outcome.
    fn check_all(&self, _export: &Export<'_>, _outcome: &mut ExportOutcome) -> Result<()> {
        Ok(())
    }

    /// Writes the files of a scenario.
    fn write(&self, scenario: &Writing<'_>) -> Result<Self::Part>;

    /// Writes the files that belong to all scenarios; returns what the export contains.
    fn finish(&self, written: &Written<'_>) -> Result<Contents>;
}

/// Abilities of a format. Options that need more are refused.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Abilities {
    /// Its name.
    pub(crate) word: &'static str,
    /// True if it has images as separate files.
    pub(crate) has_stills: bool,
    /// Ticks that it can leave out.
    pub(crate) ticks: TickChoice,
    /// Boxes that it has.
    pub(crate) boxes: BoxUse,
}

/// Choices of ticks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum TickChoice {
    /// All ticks, as an image of a video needs those before it.
    All,
    /// Every n-th tick.
    EveryNth,
    /// Any rate.
    AnyRate,
}

/// Uses of boxes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum BoxUse {
    /// All boxes, each with its score or its visibility.
    All,
    /// Only boxes that are certain; the format cannot say that an aircraft may be hidden or is mostly outside the image.
    Certain,
    /// All boxes of confirmed tracks; an image is cropped to the surroundings of one.
    Crops,
    /// None.
    None,
}

impl Format {
    /// Abilities of the format.
    pub(crate) fn abilities(self) -> Abilities {
        let (word, has_stills, ticks, boxes) = match self {
            Self::Coco => ("coco", true, TickChoice::EveryNth, BoxUse::All),
            Self::Yolo => ("yolo", true, TickChoice::EveryNth, BoxUse::Certain),
            Self::HuggingFace => ("huggingface", false, TickChoice::EveryNth, BoxUse::All),
            Self::WebDataset => ("webdataset", true, TickChoice::EveryNth, BoxUse::All),
            Self::Crops => ("crops", true, TickChoice::EveryNth, BoxUse::Crops),
            Self::Mcap => ("mcap", false, TickChoice::All, BoxUse::All),
            Self::LeRobot => ("lerobot", false, TickChoice::AnyRate, BoxUse::None),
        };
        Abilities {
            word,
            has_stills,
            ticks,
            boxes,
        }
    }

    /// Makes an export in this format.
    pub(crate) fn export(
        self,
        export: Export<'_>,
        out: &Path,
        watch: &dyn Watch,
    ) -> Result<ExportOutcome> {
        match self {
            Self::Coco => export_as::<coco::Coco>(export, out, watch),
            Self::Yolo => export_as::<yolo::Yolo>(export, out, watch),
            Self::HuggingFace => export_as::<huggingface::HuggingFace>(export, out, watch),
            Self::WebDataset => export_as::<webdataset::WebDataset>(export, out, watch),
            Self::Crops => export_as::<webdataset::crops::Crops>(export, out, watch),
            Self::Mcap => export_as::<mcap_files::Mcap>(export, out, watch),
            Self::LeRobot => export_as::<lerobot::LeRobot>(export, out, watch),
        }
    }
}

/// A scenario whose files are written.
pub(crate) struct Writing<'a> {
    pub(crate) export: &'a Export<'a>,
    pub(crate) source: Source<'a>,
    /// Its place in the export, from 0.
    pub(crate) number: usize,
    /// Folder of the export.
    pub(crate) folder: PathBuf,
    pub(crate) watch: &'a dyn Watch,
    pub(crate) count: &'a (dyn Fn(u64) + Sync),
}

impl Writing<'_> {
    /// Counts images that are written.
    fn pictures_done(&self, pictures: u64) {
        (self.count)(pictures);
    }
}

/// An export whose scenarios are all written.
pub(crate) struct Written<'a> {
    pub(crate) export: &'a Export<'a>,
    pub(crate) place: &'a Place,
    pub(crate) watch: &'a dyn Watch,
}

impl<'a> Written<'a> {
    /// Folder of the export.
    fn folder(&self) -> PathBuf {
        self.place.files()
    }

    /// The scenarios, opened one after the other.
    fn sources(&self) -> impl Iterator<Item = Result<Source<'a>>> {
        let scenarios = self.export.scenarios.iter();
        scenarios.map(|scenario| self.export.open(scenario))
    }

    /// The records of the scenarios, read one after the other.
    fn parts<P: DeserializeOwned>(&self) -> impl Iterator<Item = Result<P>> {
        let scenarios = self.export.scenarios.iter();
        scenarios.map(|scenario| self.place.part(&scenario.selected.id()))
    }
}
