//! Errors of this crate.

/// A figure that cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The corpus cannot be read, or a file cannot be written.
    #[error(transparent)]
    Dataset(#[from] dataset::Error),
    /// A run cannot be read.
    #[error(transparent)]
    Run(#[from] trainer::Error),
    /// No tick of the corpus can be shown.
    #[error(
        "no scenario of the corpus shows the aircraft near {dtd_nm} NM, so there is no image of it"
    )]
    NoPicture {
        /// Distance to touchdown, nautical miles.
        dtd_nm: f64,
    },
}

/// Results of this crate.
pub type Result<T> = std::result::Result<T, Error>;
