//! A training from corpus to model.

use std::path::{Path, PathBuf};
use std::time::Duration;

use burn::tensor::Device;
use dataset::corpus::Corpus;
use dataset::corpus::claim::Claim;
use dataset::corpus::seal::{hash_bytes, hash_file};
use dataset::corpus::workshop::lock;
use dataset::files::json_file::{read_json, write_atomically, write_json};
use dataset::work::watch::Watch;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::error::{Error, Result};
use crate::export;
use crate::samples::corpus_samples;
use crate::training::checkpoint;
use crate::training::start::start_from;
use crate::training::train;
use crate::training::training_config::TrainingConfig;

/// Settings for training a detector.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DetectorConfig {
    /// Training settings.
    pub training: TrainingConfig,
}

/// The result; also written next to the model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DetectorReport {
    /// BLAKE3 hash of the model file.
    pub model_blake3: String,
    /// Size of the model file, bytes.
    pub model_bytes: usize,
    /// Trained numbers.
    pub parameters: usize,
    /// Steps of the training.
    pub steps: u64,
    /// Crops that it saw.
    pub crops: u64,
    /// Duration, seconds.
    pub seconds: f64,
    /// Pieces of frames with a visible aircraft for crops.
    pub pieces_with_aircraft: usize,
    /// Whole frames for background.
    pub background_frames: usize,
    /// Pieces and whole frames that were left out because they show several aircraft.
    pub left_out_with_several_aircraft: usize,
    /// Settings.
    pub config: DetectorConfig,
}

/// Trains a detector on a corpus and writes the model to `out`, a report to `out` with the extension `.json`. Until it is done, the
/// folder `out` with the extension `.checkpoint` contains what a stopped or killed training needs to resume.
///
/// Trains on the scenarios of the training and validation sides: no decisions are made during training.
pub fn train_detector(
    corpus: &Corpus,
    out: &Path,
    config: &DetectorConfig,
    watch: &dyn Watch,
) -> Result<DetectorReport> {
    let checkpoint = beside(out, "checkpoint");
    let _claim = claim(out, &checkpoint)?;
    if let Some(model) = &config.training.start_from {
        // A wrong one is refused before the videos are read, which takes minutes.
        start_from(model, &Device::flex())?;
    }
    let videos = corpus_samples::videos(corpus)?;
    let samples = corpus_samples::read_samples(&videos, watch)?;
    if samples.aircraft_count() == 0 {
        return Err(Error::Input(format!(
            "corpus {}: shows no visible aircraft in its training scenarios; do the ground-truth boxes belong to these videos?",
            corpus.root().display()
        )));
    }
    let trained = train(&samples, &config.training, Some(&checkpoint), watch)?;

    let model = export::onnx_bytes(&trained.network);
    let model_blake3 = hash_bytes(&model);
    checkpoint::note_model(&checkpoint, &model_blake3)?;
    write_atomically(out, &model)?;
    let report = DetectorReport {
        model_blake3,
        model_bytes: model.len(),
        parameters: burn::module::Module::num_params(&trained.network),
        steps: trained.position.step,
        crops: trained.position.crops,
        seconds: trained.position.seconds,
        pieces_with_aircraft: samples.aircraft_count(),
        background_frames: samples.backgrounds.len(),
        left_out_with_several_aircraft: samples.left_out,
        config: config.clone(),
    };
    write_json(&beside(out, "json"), &report)?;
    checkpoint::clear(&checkpoint)?;
    Ok(report)
}

/// Checks before the training that the model can be written, and locks its checkpoint folder against other processes.
fn claim(out: &Path, checkpoint: &Path) -> Result<Claim> {
    let refused = |fault: &str| Error::Input(format!("run {}: {fault}", out.display()));
    if out.is_dir() || out.file_name().is_none() {
        return Err(refused("is a folder; expected the name of a file"));
    }
    let report = beside(out, "json");
    let is_report = |found: Value| found.get("model_blake3").is_some_and(Value::is_string);
    if report.exists() && !read_json(&report, "report of a detector").is_ok_and(is_report) {
        return Err(refused(&format!(
            "would have its report in {}, where something else lies; move that away, or give another --out",
            report.display()
        )));
    }
    checkpoint::refuse_strangers(checkpoint)?;
    if !is_own(out, &report, checkpoint)? {
        return Err(refused(
            "is not a detector that `dtd train-detector` wrote there, with its report beside it; move it away, or give another --out",
        ));
    }
    Ok(lock(checkpoint, out, Duration::ZERO)?)
}

/// True if the model may be replaced: it does not exist, it is the model of the report, or it was written by this training, which was
/// interrupted before its report.
fn is_own(out: &Path, report: &Path, checkpoint: &Path) -> Result<bool> {
    if !out.exists() {
        return Ok(true);
    }
    let hash = hash_file(out)?;
    if checkpoint::noted_model(checkpoint).is_some_and(|noted| noted == hash) {
        return Ok(true);
    }
    let reported = read_json::<Value>(report, "report of a detector");
    Ok(reported.is_ok_and(|found| found["model_blake3"] == hash.as_str()))
}

fn beside(out: &Path, ending: &str) -> PathBuf {
    out.with_extension(ending)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_model_of_an_interrupted_training_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("net.onnx");
        let checkpoint = beside(&out, "checkpoint");
        std::fs::create_dir(&checkpoint).unwrap();
        std::fs::write(&out, "a person's").unwrap();
        assert!(claim(&out, &checkpoint).is_err());
        checkpoint::note_model(&checkpoint, &hash_bytes(b"a model")).unwrap();
        assert!(claim(&out, &checkpoint).is_err());
        std::fs::write(&out, "a model").unwrap();
        drop(claim(&out, &checkpoint).unwrap());
        checkpoint::clear(&checkpoint).unwrap();
        assert!(!checkpoint.exists());
    }
}
