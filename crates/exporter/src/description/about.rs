//! Descriptions of a corpus as a whole, for dataset cards and `croissant.json`.

use std::collections::BTreeSet;

use dataset::corpus::Corpus;
use dataset::corpus::scenario::ScenarioRecord;
use dataset::corpus::splits::Side;
use dataset::plan::Plan;
use serde_json::json;

use crate::error::Result;

/// Name of a side in the formats that have splits; scenarios without a side are for training.
pub(crate) fn split_of(side: Option<Side>) -> &'static str {
    match side {
        None | Some(Side::Train) => "train",
        Some(Side::Validation) => "validation",
        Some(Side::Test) => "test",
    }
}

/// The same in the formats that abbreviate it.
pub(crate) fn short_split_of(side: Option<Side>) -> &'static str {
    match side {
        Some(Side::Validation) => "val",
        side => split_of(side),
    }
}

/// The corpus as a whole.
#[derive(Debug, Clone)]
pub(crate) struct About {
    /// Name of the corpus.
    pub(crate) name: String,
    /// SPDX identifier or URL, as the user gave it.
    pub(crate) license: Option<String>,
    /// Simulators that drew the images.
    pub(crate) simulators: BTreeSet<String>,
    /// The splits that there are.
    pub(crate) splits: BTreeSet<&'static str>,
    /// Hashes of the models whose detections are there.
    pub(crate) models: BTreeSet<String>,
}

impl About {
    /// A corpus of which no scenario was looked at yet.
    pub(crate) fn new(corpus: &Corpus, license: Option<String>) -> Result<Self> {
        let folder = corpus.root().canonicalize().ok();
        let folder = folder.as_deref().and_then(|folder| folder.file_name());
        let name = match Plan::of_corpus(corpus)? {
            Some(plan) => plan.corpus,
            None => folder.unwrap_or("corpus".as_ref()).to_string_lossy().into(),
        };
        Ok(Self {
            name,
            license,
            simulators: BTreeSet::new(),
            splits: BTreeSet::new(),
            models: BTreeSet::new(),
        })
    }

    /// Adds what a scenario says.
    pub(crate) fn add(&mut self, record: &ScenarioRecord, side: Option<Side>) {
        self.simulators.insert(record.versions.simulator.clone());
        self.splits.insert(split_of(side));
    }

    /// Its content, in a sentence.
    pub(crate) fn description(&self) -> String {
        format!(
            "{}: landing approaches of an aircraft, seen by synchronised, calibrated cameras, with its pose, its boxes in the images and \
             its distance to touchdown at every tick.",
            self.name
        )
    }

    /// The licence, as a line of a dataset card.
    pub(crate) fn card_license(&self) -> String {
        match &self.license {
            Some(url) if url.contains("://") => {
                format!("license: other\nlicense_link: {}\n", json!(url))
            }
            Some(spdx) => format!("license: {}\n", json!(spdx.to_lowercase())),
            None => String::new(),
        }
    }

    /// Heading and text with which a dataset card begins.
    pub(crate) fn introduction(&self) -> String {
        let Self { name, .. } = self;
        let (what, how, labels) = (self.description(), self.collection(), self.annotation());
        format!("# {name}\n\n{what}\n\n{how} {labels}")
    }

    /// Description of the recording.
    pub(crate) fn collection(&self) -> String {
        let simulators: Vec<&str> = self.simulators.iter().map(String::as_str).collect();
        format!(
            "Recorded by dtd from the simulator {}, in lockstep: each image was drawn for the pose and the camera of its tick. The splits \
             are by trajectory: no flown path is in two of them.",
            simulators.join(", ")
        )
    }

    /// Description of the labels' origin.
    pub(crate) fn annotation(&self) -> String {
        let mut text = "Distances and ground-truth boxes are computed from pose, runway, the aircraft's mesh and the calibration of the cameras; \
                        nobody drew them."
            .to_owned();
        if !self.models.is_empty() {
            let models: Vec<&str> = self.models.iter().map(String::as_str).collect();
            text.push_str(" Detections were made by the model ");
            text.push_str(&models.join(", "));
            text.push('.');
        }
        text
    }
}
