//! Description of an exported corpus, for dataset cards.

use std::collections::BTreeSet;

use dataset::corpus::Corpus;
use dataset::corpus::scenario::ScenarioRecord;
use dataset::corpus::splits::Side;
use dataset::plan::Plan;
use serde_json::json;

use crate::error::Result;

/// Split name of a side; scenarios without a side are for training.
pub(crate) fn split_of(side: Option<Side>) -> &'static str {
    match side {
        None | Some(Side::Train) => "train",
        Some(Side::Validation) => "validation",
        Some(Side::Test) => "test",
    }
}

/// Abbreviated split name.
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
    license: Option<String>,
    /// Simulators that drew the images.
    simulators: BTreeSet<String>,
    /// Hashes of the models whose detections are there.
    models: BTreeSet<String>,
}

impl About {
    /// The corpus, without scenarios.
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
            models: BTreeSet::new(),
        })
    }

    pub(crate) fn add(&mut self, record: &ScenarioRecord, model: Option<&str>) {
        self.simulators.extend(record.versions.simulator.clone());
        self.models.extend(model.map(str::to_owned));
    }

    /// Licence line for a dataset card.
    pub(crate) fn card_license(&self) -> String {
        match &self.license {
            Some(url) if url.contains("://") => {
                format!("license: other\nlicense_link: {}\n", json!(url))
            }
            Some(spdx) => format!("license: {}\n", json!(spdx.to_lowercase())),
            None => String::new(),
        }
    }

    /// Opening text for a dataset card: content, recording, and origin of the labels.
    pub(crate) fn introduction(&self) -> String {
        let joined = |names: &BTreeSet<String>| {
            let names: Vec<&str> = names.iter().map(String::as_str).collect();
            names.join(", ")
        };
        let (name, simulators) = (&self.name, joined(&self.simulators));
        let mut text = format!(
            "# {name}\n\n{name}: landing approaches of an aircraft, seen by synchronised, calibrated cameras, with its pose, its boxes in the \
             images and its distance to touchdown at every tick.\n\nRecorded by dtd from the simulator {simulators}, in lockstep: each image \
             was drawn for the pose and the camera of its tick. The splits are by trajectory: no flown path is in two of them. Distances \
             and ground-truth boxes are computed from pose, runway, the aircraft's mesh and the calibration of the cameras; none was \
             drawn by hand."
        );
        if !self.models.is_empty() {
            let models = joined(&self.models);
            text.push_str(&format!(" Detections were made by the model {models}."));
        }
        text
    }
}
