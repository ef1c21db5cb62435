//! Evaluation identity, as stored in `evaluation.json`: scenarios, boxes and rules.

use std::collections::BTreeSet;

use dataset::corpus::Corpus;
use dataset::corpus::splits::Side;
use dataset::files::json_file::read_json;
use serde::{Deserialize, Serialize};

use crate::evaluation::rules::EvaluationRules;
use crate::run::folder::RunFolder;
use crate::run::sealed::SealedRun;
use crate::samples::Samples;

/// Scenarios to evaluate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum JudgedSide {
    /// The test side.
    #[default]
    Test,
    /// All scenarios, for a corpus that training never saw.
    All,
}

pub(crate) fn corpus_name(corpus: &Corpus) -> String {
    let root = corpus.root();
    let real = root.canonicalize().unwrap_or_else(|_| root.to_owned());
    let name = real.file_name().unwrap_or_default();
    name.to_string_lossy().into()
}

/// Hash of the scenario identifiers and manifests.
pub(crate) fn scenarios_blake3(samples: &Samples) -> String {
    let mut hash = blake3::Hasher::new();
    for scenario in samples.scenarios_of(Side::Test) {
        hash.update(format!("{} {}\n", scenario.id, scenario.manifest_blake3).as_bytes());
    }
    hash.finalize().to_string()
}

/// ICAO code and designator of each runway.
pub(crate) fn runways(samples: &Samples) -> BTreeSet<String> {
    let judged = samples.scenarios_of(Side::Test);
    judged
        .map(|s| format!("{} {}", s.runway.airport, s.runway.name))
        .collect()
}

/// Evaluation identity (`evaluation.json`), which distinguishes evaluations of the same run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Judged {
    /// Name of the corpus's folder.
    pub corpus: String,
    /// Hash of the scenario identifiers and manifests.
    pub scenarios_blake3: String,
    /// Hash that also covers the observations (boxes and registered shifts) and the ground truth.
    pub samples_blake3: String,
    /// Evaluated part of the scenarios.
    pub side: JudgedSide,
    /// ICAO code and designator of each runway.
    pub runways: BTreeSet<String>,
    /// Name of the rig.
    pub rig: String,
    /// View names.
    pub views: Vec<String>,
    /// File name of the detection model, if it is recorded.
    pub model: Option<String>,
    /// Name of the detections.
    pub model_hash: String,
    /// Hash of the run's weights.
    pub weights_blake3: String,
    /// Version of the rules.
    pub rules: u32,
}

impl Judged {
    pub(crate) fn of(
        corpus: &Corpus,
        samples: &Samples,
        side: JudgedSide,
        run: &SealedRun,
        rules: &EvaluationRules,
    ) -> Self {
        Self {
            corpus: corpus_name(corpus),
            scenarios_blake3: scenarios_blake3(samples),
            samples_blake3: samples.hash(&[Side::Test]),
            side,
            runways: runways(samples),
            rig: samples.rig.name.clone(),
            views: samples.views.clone(),
            model: samples.detections.model.clone(),
            model_hash: samples.detections.hash.clone(),
            weights_blake3: blake3::hash(run.bytes(RunFolder::WEIGHTS)).to_string(),
            rules: rules.version,
        }
    }

    /// True if the folder has results from a different evaluation.
    pub(crate) fn is_other_than_in(&self, folder: &RunFolder) -> bool {
        let path = folder.path(RunFolder::EVALUATION);
        let same = |there: Self| {
            Self {
                corpus: there.corpus.clone(),
                ..self.clone()
            } == there
        };
        path.exists() && !read_json(&path, "evaluation").is_ok_and(same)
    }
}
