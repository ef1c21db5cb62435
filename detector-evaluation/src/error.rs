//! Evaluation errors.

/// An error of this crate.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A corpus cannot be read, or a result not written.
    #[error(transparent)]
    Dataset(#[from] dataset::Error),
    /// The videos cannot be searched.
    #[error(transparent)]
    Search(#[from] labeller::Error),
    /// The report cannot be made.
    #[error(transparent)]
    Report(#[from] report_page::Error),
    /// No mode was given.
    #[error("no mode is given; expected at least one")]
    NoMode,
    /// There is no truth to compare with.
    #[error("scenario {0} has no labels; run `dtd label` on the corpus first")]
    Unlabelled(String),
    /// Boxes in a view that cannot show the aircraft according to the calibration.
    #[error(
        "scenario {scenario}: both views found the aircraft at tick {tick}, but calibration.json has it behind the camera of view {view}, \
         or lacks that camera; label the corpus again"
    )]
    Projection {
        /// The scenario.
        scenario: String,
        /// The view.
        view: String,
        /// The tick.
        tick: u32,
    },
}

/// Results of this crate.
pub type Result<T> = std::result::Result<T, Error>;
