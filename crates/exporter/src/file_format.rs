//! Interface of an export format, and the data that it gets.

use std::collections::BTreeSet;
use std::path::PathBuf;

use dataset::corpus::splits::Side;
use dataset::work::watch::Watch;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::about::About;
use crate::destination::UnfinishedExport;
use crate::error::Result;
use crate::request::{Abilities, ExportRequest};
use crate::scenarios::{Selected, Source};

/// A format: what it refuses, and the files that it writes.
pub(crate) trait FileFormat: Sync {
    /// What the format can express. Options that need more are refused.
    fn abilities(&self) -> Abilities;

    /// Prepares an export before any scenario is opened.
    fn prepare(&mut self, _export: &Export<'_>) -> Result<()> {
        Ok(())
    }

    /// Adds inputs to the identity of an export that are neither in the request nor in the scenarios.
    fn hash(&self, _hasher: &mut blake3::Hasher) {}

    /// Checks a scenario before any file is written.
    fn check(&mut self, _source: &Source<'_>, _export: &Export<'_>) -> Result<()> {
        Ok(())
    }

    /// Checks the whole export before any file is written. Returns what the dataset lacks for training in its format, as a sentence.
    fn check_all(&self, _export: &Export<'_>) -> Result<Option<&'static str>> {
        Ok(None)
    }

    /// Writes the files of a scenario. Returns the record that [`Written::parts`] reads.
    fn write(&self, scenario: &Writing<'_>) -> Result<Value>;

    /// Writes the files that belong to all scenarios.
    fn finish(&self, written: &Written<'_>) -> Result<()>;
}

/// The data to export, checked against the corpus.
pub(crate) struct Export<'a> {
    pub(crate) request: &'a ExportRequest,
    pub(crate) abilities: Abilities,
    /// Name of the exported detections, possibly beside the ground-truth boxes.
    pub(crate) model: Option<String>,
    pub(crate) scenarios: Vec<PlannedScenario>,
    /// Sides of the split with images; scenarios without a side are for training.
    pub(crate) sides: BTreeSet<Side>,
    pub(crate) about: About,
}

/// A checked scenario of an export.
pub(crate) struct PlannedScenario {
    pub(crate) selected: Selected,
    pub(crate) pictures: u64,
}

impl Export<'_> {
    /// Opens a scenario. Tables of all scenarios at once would not fit into memory.
    pub(crate) fn open<'s>(&self, selected: &'s Selected) -> Result<Source<'s>> {
        let boxes = self.abilities.boxes;
        Source::open(selected, self.request, boxes, self.model.as_deref())
    }
}

/// A scenario whose files are being written.
pub(crate) struct Writing<'a> {
    pub(crate) export: &'a Export<'a>,
    pub(crate) source: Source<'a>,
    /// Folder of the export.
    pub(crate) folder: PathBuf,
    pub(crate) watch: &'a dyn Watch,
    pub(crate) count: &'a (dyn Fn(u64) + Sync),
}

impl Writing<'_> {
    /// Counts written images.
    pub(crate) fn pictures_done(&self, pictures: u64) {
        (self.count)(pictures);
    }

    /// The record of the scenario, as JSON.
    pub(crate) fn part(&self, part: &impl Serialize) -> Result<Value> {
        let part = serde_json::to_value(part);
        Ok(part.map_err(|error| dataset::Error::io("describe", &self.folder)(error.into()))?)
    }
}

/// An export whose scenarios are all written.
pub(crate) struct Written<'a> {
    pub(crate) export: &'a Export<'a>,
    pub(crate) unfinished: &'a UnfinishedExport,
    pub(crate) watch: &'a dyn Watch,
}

impl<'a> Written<'a> {
    /// Folder of the export.
    pub(crate) fn folder(&self) -> PathBuf {
        self.unfinished.files()
    }

    /// The scenarios, opened one after the other.
    pub(crate) fn sources(&self) -> impl Iterator<Item = Result<Source<'a>>> {
        let scenarios = self.export.scenarios.iter();
        scenarios.map(|scenario| self.export.open(&scenario.selected))
    }

    /// The records of the scenarios, read one after the other.
    pub(crate) fn parts<P: DeserializeOwned>(&self) -> impl Iterator<Item = Result<P>> {
        let scenarios = self.export.scenarios.iter();
        scenarios.map(|scenario| self.unfinished.part(&scenario.selected.id()))
    }
}
