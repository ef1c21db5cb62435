//! Errors of a report page.

use std::io;

use plotters::drawing::DrawingAreaErrorKind;

/// A failure to draw an SVG.
pub type DrawingError = DrawingAreaErrorKind<io::Error>;

/// A page that cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A chart.
    #[error("report: cannot draw the chart of {what}: {cause}")]
    Chart {
        /// The chart.
        what: &'static str,
        /// Error of the drawing library.
        cause: DrawingError,
    },
    /// A part of an image.
    #[error("report: cannot encode a part of an image: {0}")]
    Crop(image::ImageError),
    /// The page itself.
    #[error("report: cannot draw the page: {0:#}")]
    Page(minijinja::Error),
}

/// Results of this crate.
pub type Result<T> = std::result::Result<T, Error>;
