//! Reasons why a run cannot be created at a path, or cannot be used.

use std::path::PathBuf;

use burn::store::SafetensorsStoreError;
use dataset::corpus::seal::{DONE, MANIFEST};
use dataset::numbers::limits::{FieldOutOfLimits, MAX_VIEWS};

/// Fault of a run's folder or of one of its files, with its remedy.
#[derive(Debug, thiserror::Error)]
#[expect(
    missing_docs,
    reason = "the fields are described by the messages that show them"
)]
pub enum RunFault {
    /// Results would be foreign files in a run.
    #[error("lies in a run, which holds nothing but its own files; name a place outside")]
    InRun,
    /// Results would replace the results of another evaluation.
    #[error(
        "has the results of another evaluation (evaluation.json): of other scenarios, detections or rules; name a folder for these with \
         --out DIR"
    )]
    OtherEvaluation,
    /// A third run is where two of a replacement belong.
    #[error(
        "appeared while {} was about to replace the run that is now at {}; keep one of the three and move the others away",
        new.display(),
        old.display()
    )]
    Contested { new: PathBuf, old: PathBuf },
    /// A finished run would replace one that it does not know.
    #[error("is not the run that {} was made to replace; move one of the two away", new.display())]
    OtherRun { new: PathBuf },
    /// No result of a training.
    #[error(
        "has no run.json, so no training finished there; make one with `dtd train CORPUS --out RUN`"
    )]
    Unfinished,
    /// Its files may be of different trainings.
    #[error("has no {DONE}, so nothing says that its files belong together; train again")]
    Unsealed,
    /// The seal or the list of files is damaged.
    #[error("is damaged: {0}; put the right file back, or train again")]
    DamagedSeal(dataset::Error),
    /// A file was removed.
    #[error("is missing, though the training wrote it; put it back, or train again")]
    Missing,
    /// A file was changed.
    #[error(
        "is not what the training wrote: its hash differs from {MANIFEST}; put the right file back, or train again"
    )]
    Changed,
    /// A run of another version.
    #[error(
        "belongs to a run of format {format}, written by dtd {dtd}, and this version reads format {readable}; {}",
        if format < readable { "train again" } else { "update dtd, or train again" }
    )]
    OtherFormat {
        format: u32,
        readable: u32,
        dtd: String,
    },
    /// Its files contradict each other.
    #[error(
        "it and baselines.json have {views} views and numbers for {lengths:?}, expected as many for each, 1 to {MAX_VIEWS}"
    )]
    Lengths { views: usize, lengths: [usize; 5] },
    /// A formula for other views.
    #[error(
        "{formula} does not fit the {views} views of the run, or lacks some of its numbers; train again"
    )]
    OtherFormula { formula: &'static str, views: usize },
    /// A run without `self_calibrated`.
    #[error(
        "has fitted no cameras, because fewer than two views saw the aircraft often enough; name a run that was trained on more flights"
    )]
    NoFittedCameras,
    /// The cameras of a run that has several.
    #[error(
        "was trained on cameras that differ from scenario to scenario, so its fitted cameras are an average; name a run of cameras that stand still"
    )]
    CamerasVary,
    /// A number that makes every answer meaningless.
    #[error("{0}; train again")]
    OutOfLimits(FieldOutOfLimits),
    /// The same in a formula.
    #[error("has the number {number:e}, expected one up to {most:e} in size; train again")]
    Formula { number: f64, most: f64 },
    /// The same in a network.
    #[error("has the weight {weight:e}, expected numbers up to {most:e} in size; train again")]
    Weight { weight: f32, most: f32 },
    /// A view that the run was not trained with.
    #[error("has no view {view:?}; its views are {}", views.join(", "))]
    NoSuchView { view: String, views: Vec<String> },
    /// Images that cameras are aligned with.
    #[error("do not match the backgrounds recorded in config.json and baselines.json; train again")]
    Backgrounds,
    /// A refit of a run whose cameras are aligned.
    #[error(
        "was trained with align_backgrounds, and a camera that looks elsewhere has no background to be aligned with; train again on \
         corpora with the new camera"
    )]
    AlignedRefit,
    /// A run of which cameras are aligned, which takes whole flights.
    #[error(
        "was trained with align_backgrounds, which compares the images of whole flights, so it cannot answer image by image; train without \
         it"
    )]
    AlignedOnline,
    /// An estimator that needs more than the ticks so far.
    #[error(
        "has no estimator {estimator:?} that answers image by image without a corpus; those that do are {}",
        known.join(", ")
    )]
    NotOnline {
        estimator: String,
        known: Vec<&'static str>,
    },
    /// An estimator that the training could fit to nothing.
    #[error(
        "has no fit for {estimator}: no view saw enough on the training side, so it would never answer; choose another one, such as \
         mono_network_box, with --estimator, or train on more"
    )]
    NothingFitted { estimator: &'static str },
    /// A refit that would replace the run that it starts from.
    #[error("is the run to fit again, which stays as it is; name another folder with --out")]
    RefitInPlace,
    /// A search in the folder of a run.
    #[error(
        "is a run, and a search has a folder of its own with a run for each training; name another folder with --out"
    )]
    SearchInRun,
    /// More than one view would change.
    #[error(
        "fitting view {view} again would change numbers that do not belong to it; nothing was written. Please report this"
    )]
    NotFrozen { view: String },
    /// The weights are not in their format.
    #[error("is not a Safetensors file; train again")]
    NotSafetensors,
    /// The numbers are of other networks.
    #[error("weights do not fit the networks of config.json: {0}; train again")]
    OtherNetworks(SafetensorsStoreError),
    /// There are numbers for networks that the settings do not have.
    #[error(
        "holds {}, which the networks of config.json do not have; train again", .0.join(", ")
    )]
    UnknownWeights(Vec<String>),
    /// A run to start from that has other networks.
    #[error(
        "has other networks than this training, which cannot start from them; here, and there: {}; train with the settings of its \
         config.json",
        differences.join("; ")
    )]
    OtherStart { differences: Vec<String> },
    /// A run to start from that has other views.
    #[error(
        "was trained with the views {}, and the corpus has {}; start from a run with the same views and image sizes",
        sizes(there),
        sizes(here)
    )]
    OtherViews {
        here: Vec<(String, u32, u32)>,
        there: Vec<(String, u32, u32)>,
    },
    /// A checkpoint with a state or weights that do not fit the training.
    #[error("is damaged: {0}; remove it, and the training starts from the beginning")]
    DamagedCheckpoint(Box<dyn std::error::Error + Send + Sync>),
    /// The numbers cannot be written.
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
