//! Report page errors.

/// A page that cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// An image crop.
    #[error("report: cannot encode a part of an image: {0}")]
    Crop(image::ImageError),
    /// The page itself.
    #[error("report: cannot draw the page: {0:#}")]
    Page(minijinja::Error),
}

/// Results of this crate.
pub type Result<T> = std::result::Result<T, Error>;
