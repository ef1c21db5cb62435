//! Reasons why a run cannot be created at a path, or cannot be used.

use std::path::PathBuf;

use burn::store::SafetensorsStoreError;
use dataset::corpus::seal::{DONE, MANIFEST};
use dataset::numbers::limits::{FieldOutOfLimits, MAX_VIEWS};

/// Fault of a run folder or its files, with a remedy.
#[derive(Debug, thiserror::Error)]
#[expect(
    missing_docs,
    reason = "the messages describe the variants and their fields"
)]
pub enum RunFault {
    #[error("lies in a run, which holds nothing but its own files; name a place outside")]
    InRun,
    #[error(
        "has the results of another evaluation (evaluation.json): of other scenarios, detections or rules; name a folder for these with \
         --out DIR"
    )]
    OtherEvaluation,
    #[error(
        "appeared while {} was about to replace the run that is now at {}; keep one of the three and move the others away",
        new.display(),
        old.display()
    )]
    Contested { new: PathBuf, old: PathBuf },
    #[error("is not the run that {} was made to replace; move one of the two away", new.display())]
    OtherRun { new: PathBuf },
    #[error(
        "has no run.json, so no training finished there; make one with `dtd train CORPUS --out RUN`"
    )]
    Unfinished,
    #[error("has no {DONE}, so nothing says that its files belong together; train again")]
    Unsealed,
    #[error("is damaged: {0}; put the right file back, or train again")]
    DamagedSeal(dataset::Error),
    #[error("is missing, though the training wrote it; put it back, or train again")]
    Missing,
    #[error(
        "is not what the training wrote: its hash differs from {MANIFEST}; put the right file back, or train again"
    )]
    Changed,
    #[error(
        "belongs to a run of format {format}, written by dtd {dtd}, and this version reads format {readable}; {}",
        if format < readable { "train again" } else { "update dtd, or train again" }
    )]
    OtherFormat {
        format: u32,
        readable: u32,
        dtd: String,
    },
    #[error(
        "it and baselines.json have {views} views and numbers for {lengths:?}, expected as many for each, 1 to {MAX_VIEWS}"
    )]
    Lengths { views: usize, lengths: [usize; 5] },
    #[error(
        "{formula} does not fit the {views} views of the run, or lacks some of its numbers; train again"
    )]
    OtherFormula { formula: &'static str, views: usize },
    #[error(
        "has fitted no cameras, because fewer than two views saw the aircraft often enough; name a run that was trained on more flights"
    )]
    NoFittedCameras,
    #[error(
        "was trained on cameras that differ from scenario to scenario, so its fitted cameras are an average; name a run of cameras that stand still"
    )]
    CamerasVary,
    #[error("{0}; train again")]
    OutOfLimits(FieldOutOfLimits),
    #[error("has the number {number:e}, expected one up to {most:e} in size; train again")]
    ImpossibleNumber { number: f64, most: f64 },
    #[error("has no view {view:?}; its views are {}", views.join(", "))]
    NoSuchView { view: String, views: Vec<String> },
    #[error("do not match the backgrounds recorded in config.json and baselines.json; train again")]
    Backgrounds,
    #[error(
        "was trained with align_backgrounds, and a camera that looks elsewhere has no background to be aligned with; train again on \
         corpora with the new camera"
    )]
    AlignedRefit,
    #[error(
        "was trained with align_backgrounds, which compares the images of whole flights, so it cannot answer image by image; train without \
         it"
    )]
    AlignedOnline,
    #[error(
        "has no estimator {estimator:?} that answers image by image without a corpus; those that do are {}",
        known.join(", ")
    )]
    NotOnline {
        estimator: String,
        known: Vec<&'static str>,
    },
    #[error(
        "has no fit for {estimator}: no view saw enough on the training side, so it would never answer; choose another one, such as \
         mono_network_box, with --estimator, or train on more"
    )]
    NothingFitted { estimator: &'static str },
    #[error("is the run to fit again, which stays as it is; name another folder with --out")]
    RefitInPlace,
    #[error(
        "is a run, and a search has a folder of its own with a run for each training; name another folder with --out"
    )]
    SearchInRun,
    #[error(
        "fitting view {view} again would change numbers that do not belong to it; nothing was written. Please report this"
    )]
    NotFrozen { view: String },
    #[error("is not a Safetensors file; train again")]
    NotSafetensors,
    #[error("weights do not fit the networks of config.json: {0}; train again")]
    OtherNetworks(SafetensorsStoreError),
    #[error(
        "holds {}, which the networks of config.json do not have; train again", .0.join(", ")
    )]
    UnknownWeights(Vec<String>),
    #[error(
        "has other networks than this training, which cannot start from them; here, and there: {}; train with the settings of its \
         config.json",
        differences.join("; ")
    )]
    OtherStart { differences: Vec<String> },
    #[error(
        "was trained with the views {}, and the corpus has {}; start from a run with the same views and image sizes",
        sizes(there),
        sizes(here)
    )]
    OtherViews {
        here: Vec<(String, u32, u32)>,
        there: Vec<(String, u32, u32)>,
    },
    #[error("is damaged: {0}; remove it, and the training starts from the beginning")]
    DamagedCheckpoint(Box<dyn std::error::Error + Send + Sync>),
    #[error("weights cannot be written: {0}")]
    NotWritten(SafetensorsStoreError),
}

/// Views and the sizes of their images, for messages.
pub(crate) fn sizes(form: &[(String, u32, u32)]) -> String {
    let views = form.iter();
    let views: Vec<_> = views
        .map(|(view, width, height)| format!("{view} {width}x{height} px"))
        .collect();
    views.join(", ")
}
