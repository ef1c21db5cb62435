//! Report pages: one HTML file each, which opens offline.
//!
//! Input: the template of a page and its values, the series of its charts, and images. Output: HTML, with charts as SVG and parts of
//! images inside it. All pages have the same look: [`page`] adds the style sheet, [`chart`] the axes and colours.

#![forbid(unsafe_code)]

pub mod chart;
#[cfg(test)]
mod colour_vision;
pub mod crop;
mod error;
mod number;
pub mod page;

pub use error::{DrawingError, Error, Result};
pub use number::{decimal, signed};
