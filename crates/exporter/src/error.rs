//! Errors of an export.

use std::path::PathBuf;

use dataset::numbers::frame_rate::FrameRate;
use dataset::work::watch::Stopped;

/// An error of an export. Every message names its subject.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file cannot be read or written.
    #[error(transparent)]
    Dataset(#[from] dataset::Error),
    /// No scenario, view or side of that name.
    #[error("{what} {found:?} is not in the corpus; expected one of {known}")]
    Unknown {
        /// Kind of the name.
        what: &'static str,
        /// The name.
        found: String,
        /// The known names.
        known: String,
    },
    /// Detections are requested, but there are none.
    #[error("the selected scenarios have no detections; run `dtd detect` on the corpus first")]
    NoDetections,
    /// Detections of several models are there.
    #[error(
        "the corpus has the detections of several models: {known}; choose one with --detections"
    )]
    SeveralModels {
        /// The models.
        known: String,
    },
    /// An option that the format has no place for.
    #[error("{format} has no use for {option}: {reason}; leave it out, or choose another format")]
    NotInFormat {
        /// The option.
        option: &'static str,
        /// The format.
        format: &'static str,
        /// Reason.
        reason: &'static str,
    },
    /// A run without predictions.
    #[error("{} has no predictions; expected an evaluated run: run `dtd evaluate` on it first", run.display())]
    NoPredictions {
        /// The run.
        run: PathBuf,
    },
    /// A run answered for another scenario of the same name.
    #[error("run {run} {difference}")]
    OtherCorpus {
        /// The run.
        run: String,
        /// The difference.
        difference: String,
    },
    /// A run without predictions for the exported scenarios.
    #[error(
        "run {run} has predictions for none of the selected scenarios, only for {known}; leave it out, choose others, or evaluate it on \
         this corpus first"
    )]
    NotOfRun {
        /// The run.
        run: String,
        /// The scenarios that it has predictions for.
        known: String,
    },
    /// Two runs have the same name.
    #[error(
        "two runs are named {run}; predictions are identified by run name, so rename one of the folders"
    )]
    SameRun {
        /// Their name.
        run: String,
    },
    /// A crop that does not fit into an image.
    #[error(
        "scenario {scenario}, view {view}: a crop of {}x{} px does not fit into images of {}x{} px; choose a smaller one with --crop-px",
        crop_px[0], crop_px[1], picture_px[0], picture_px[1]
    )]
    CropTooLarge {
        /// The scenario.
        scenario: String,
        /// The view.
        view: String,
        /// Width and height of its images.
        picture_px: [u32; 2],
        /// Width and height of the crop.
        crop_px: [u32; 2],
    },
    /// No tick has a crop of each view.
    #[error(
        "nothing to export: at no tick of the selected scenarios has each view a box; choose views with --views, or other boxes with \
         --boxes"
    )]
    NoCrops,
    /// The request selects no data.
    #[error("nothing to export: no scenario is left with these options")]
    Nothing,
    /// The videos of every selected scenario are damaged.
    #[error("nothing to export: every selected scenario is damaged; the first one: {0}")]
    AllLost(String),
    /// A video does not have the images of its scenario.
    #[error(
        "scenario {scenario}, view {view}: at tick {tick} expected an image with timestamp {expected}, found {found}; generate it again"
    )]
    Video {
        /// The scenario.
        scenario: String,
        /// The view.
        view: String,
        /// The tick.
        tick: u32,
        /// Its timestamp.
        expected: i64,
        /// The image found in the video.
        found: String,
    },
    /// A video's images have no name in MCAP.
    #[error(
        "scenario {scenario}, view {view}: the video is FFV1, which Foxglove's schema of videos does not know; expected H.264, H.265 or AV1; \
         choose another format, or leave the scenario out with --only"
    )]
    Codec {
        /// The scenario.
        scenario: String,
        /// The view.
        view: String,
    },
    /// A rate that is no whole number.
    #[error(
        "scenario {scenario} would have {found} images per second; lerobot needs a whole number: {advice}"
    )]
    WholeRate {
        /// The scenario.
        scenario: String,
        /// Its rate in the export.
        found: String,
        /// Advice on how to correct the request.
        advice: String,
    },
    /// The requested rate exceeds the rate of the corpus.
    #[error(
        "scenario {scenario} has {rate} images per second, fewer than --rate {asked}; choose a lower one"
    )]
    RateTooHigh {
        /// The scenario.
        scenario: String,
        /// Its rate.
        rate: FrameRate,
        /// The requested rate.
        asked: u32,
    },
    /// Scenarios that one dataset cannot hold.
    #[error(
        "scenario {scenario} has {found}, the first one {first}; a LeRobot dataset has one rate, one size of images and one type of \
         files: choose scenarios with --only, or views with --views"
    )]
    Mixed {
        /// The scenario.
        scenario: String,
        /// Its properties.
        found: String,
        /// Properties of the first scenario.
        first: String,
    },
    /// An MCAP file cannot be written.
    #[error("cannot write {}: {source}", path.display())]
    Mcap {
        /// The file.
        path: PathBuf,
        /// Cause.
        r#source: Box<mcap::McapError>,
    },
    /// An image cannot be encoded.
    #[error("cannot encode {}: {source}", path.display())]
    Encode {
        /// The file.
        path: PathBuf,
        /// Cause.
        r#source: image::ImageError,
    },
    /// The destination is in the corpus, or the corpus in it.
    #[error("{} is the corpus {}, in it, or around it; choose a folder elsewhere", out.display(), corpus.display())]
    InCorpus {
        /// The destination.
        out: PathBuf,
        /// The corpus.
        corpus: PathBuf,
    },
    /// A finished export of which files were changed or lost.
    #[error("{} was exported, but then changed: {fault}; remove it to export again", out.display())]
    Changed {
        /// The destination.
        out: PathBuf,
        /// The first fault.
        fault: String,
    },
    /// An unfinished export of something else.
    #[error("{} is an unfinished export with other options or of other files; remove it, or export to another folder", partial.display())]
    OtherExport {
        /// The unfinished export.
        partial: PathBuf,
    },
    /// A finished export of something else.
    #[error("{} is an export with other options or of other files; remove it, or export to another folder", out.display())]
    OtherFinished {
        /// The finished export.
        out: PathBuf,
    },
    /// The caller stopped it.
    #[error(transparent)]
    Stopped(#[from] Stopped),
}

/// Results of this crate.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// True if files of the corpus are damaged: an export is only possible once they are repaired.
    pub(crate) fn is_fault_of_corpus(&self) -> bool {
        match self {
            Self::Dataset(dataset::Error::Memory(_)) => false,
            Self::Dataset(error) => error.is_bad_content(),
            Self::Video { .. } => true,
            _ => false,
        }
    }

    /// True if the request is at fault, so that a repetition would fail as well.
    pub fn is_bad_request(&self) -> bool {
        matches!(
            self,
            Self::Unknown { .. }
                | Self::NotInFormat { .. }
                | Self::NoPredictions { .. }
                | Self::SameRun { .. }
                | Self::OtherCorpus { .. }
                | Self::NotOfRun { .. }
                | Self::Codec { .. }
                | Self::WholeRate { .. }
                | Self::RateTooHigh { .. }
                | Self::Mixed { .. }
                | Self::CropTooLarge { .. }
                | Self::NoCrops
                | Self::Nothing
                | Self::AllLost(_)
                | Self::NoDetections
                | Self::SeveralModels { .. }
                | Self::InCorpus { .. }
                | Self::Changed { .. }
                | Self::OtherExport { .. }
                | Self::OtherFinished { .. }
        )
    }
}
