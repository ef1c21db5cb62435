//! Reasons why a corpus cannot be used for training or evaluation.

use std::path::PathBuf;

use dataset::corpus::detections::RegisteredWith;
use dataset::corpus::splits::Side;

use super::run_fault::sizes;

/// Properties that all scenarios of one corpus share.
#[derive(Debug, Clone, PartialEq)]
pub struct RigKind {
    pub(crate) name: String,
    /// View, width and height of the images of each camera.
    pub(crate) form: Vec<(String, u32, u32)>,
}

/// Corpus or scenario fault, with its remedy.
#[derive(Debug, thiserror::Error)]
#[expect(
    missing_docs,
    reason = "the messages describe the variants and their fields"
)]
pub enum CorpusFault {
    #[error("has no complete scenario; record some with `dtd generate`")]
    NoScenarios,
    #[error(
        "its detections do not say which boxes counted at each moment, because an earlier version made them; run `dtd detect --force` on the \
         corpus with that model"
    )]
    NoLiveBoxes,
    #[error("is not in splits.json, so it is on no side; make the corpus again from one plan")]
    NotInSplit,
    #[error(
        "flies trajectory {recorded} by its scenario.json but {split} by splits.json; the split cannot be trusted"
    )]
    OtherTrajectory { recorded: String, split: String },
    #[error(
        "scenario {} ({}, {} side) and scenario {} ({}, {} side) fly the same flight on different sides of the split; put both on one \
         side in splits.json",
        one.0, one.1, one.2, other.0, other.1, other.2
    )]
    FlightOnTwoSides {
        one: (String, String, Side),
        other: (String, String, Side),
    },
    #[error(
        "scenario {scenario} flies {trajectory} on the {side} side, and the run to start from has learned from that flight; start from \
         another run, or put the flight on the training side"
    )]
    KnownToStart {
        scenario: String,
        trajectory: String,
        side: Side,
    },
    #[error("camera {view} of calibration.json {fault}")]
    BadCamera { view: String, fault: String },
    #[error(
        "its rig {} ({}) differs from the rig of scenario {first}, {} ({}); a network learns one rig: keep scenarios of different rigs in different \
         corpora",
        found.name, sizes(&found.form), expected.name, sizes(&expected.form)
    )]
    OtherRig {
        found: Box<RigKind>,
        first: String,
        expected: Box<RigKind>,
    },
    #[error(
        "its views were registered with {found}, the views of scenario {first} with {expected}, and shifts by different cameras do not fit \
         each other; register all again: `dtd detect CORPUS --registration-of RUN`, or `dtd detect CORPUS --force` for calibration.json"
    )]
    OtherRegistration {
        found: RegisteredWith,
        first: String,
        expected: RegisteredWith,
    },
    #[error(
        "its planned cameras differ from the cameras of {}, and a training learns one rig; here, and there: {}. Train on one at a time, or start from \
         its run (--start-from)",
        first.display(),
        differences.join("; ")
    )]
    RigOfAnotherCorpus {
        first: PathBuf,
        differences: Vec<String>,
    },
    #[error(
        "its cameras are not those that run {} was trained with; here, and there: {}; if one of them was turned, moved or replaced, \
         `dtd refit` fits its view again",
        run.display(),
        differences.join("; ")
    )]
    OtherCameras {
        run: PathBuf,
        differences: Vec<String>,
    },
    #[error(
        "its cameras beside {view} are not those that run {} was trained with: identifiers, image sizes, places and optics must be the \
         same; fit one view at a time again",
        run.display()
    )]
    OtherCamerasBeside { view: String, run: PathBuf },
    #[error(
        "view {view} saw the aircraft at {ticks} ticks of {approaches} approaches on the training side, expected at least {least}; record, \
         label and detect more, or use more of them (--scenarios)"
    )]
    TooFewTicks {
        view: String,
        approaches: usize,
        ticks: usize,
        least: usize,
    },
    #[error(
        "view {view} and others together saw the aircraft too rarely in {approaches} approaches to fit inverse_range to; record, label and \
         detect more, or use more of them (--scenarios)"
    )]
    TooFewTogether { view: String, approaches: usize },
    #[error(
        "the camera of view {view} cannot be fitted to these approaches; use more of them (--scenarios), of a corpus with plan.json"
    )]
    NoFittedCamera { view: String },
    #[error("has no detections; run `dtd detect` first")]
    NoDetections,
    #[error("has no detections of model {0}; run `dtd detect` first")]
    NoDetectionsOf(String),
    #[error("has no detections of model {asked}, only of {listed}")]
    OtherDetections { asked: String, listed: String },
    #[error(
        "has detections of several models: {0}; choose one with --detections, by its file or hash"
    )]
    SeveralModels(String),
    #[error("has detections of view {0}, which calibration.json does not list")]
    UnknownView(String),
    #[error("has no labels in frames.parquet; run `dtd label` on the corpus first")]
    NoLabels,
    #[error(
        "frames.parquet: tick {tick}: {column} is {value:?}, expected a distance on Earth, at most {most_m} m; label the corpus again"
    )]
    NotOnEarth {
        tick: u32,
        column: &'static str,
        value: f64,
        most_m: f64,
    },
    #[error(
        "has no samples on the {side} side: {}, none with a detection before touchdown within the \
         distance range; generate, label and detect more, change the split, leave out less (leave_out), or accept marked \
         scenarios (accept_weather)",
        if *scenarios == 1 { "1 scenario is there".to_owned() } else { format!("{scenarios} scenarios are there") }
    )]
    NoSamples { side: Side, scenarios: usize },
    #[error(
        "has no scenario with {setting}, which the training leaves out for the test side; `dtd plan` lists weathers and times"
    )]
    NothingLeftOut { setting: String },
    #[error(
        "has none of the scenarios that the run drew for its test; `dtd evaluate --side all` judges all scenarios of a corpus that it has \
         not seen"
    )]
    NothingDrawn,
    #[error("has no samples on the test side from {min_dtd_nm} to {max_dtd_nm} NM")]
    NoTestSamples { min_dtd_nm: f64, max_dtd_nm: f64 },
    #[error(
        "has {samples} samples on the {} side, but no box of theirs is where a camera near that of calibration.json sees the aircraft of \
         frames.parquet; label and detect again, or check the calibration with `dtd verify`",
        Side::Train
    )]
    NoTrueBoxes { samples: usize },
    #[error(
        "has {samples} samples on the {} side, but no box of theirs is near the places and sizes of the boxes on the training side; \
         change the split, or detect again",
        Side::Validation
    )]
    NoUsualBoxes { samples: usize },
}
