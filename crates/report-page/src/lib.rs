//! Report pages: one HTML file each, which opens offline.
//!
//! Input: the template of a page and its values, the series of its charts, and images. Output: HTML, with charts as SVG and parts of
//! images inside it. All pages have the same shell and style sheet ([`page`]), tables ([`table`]) and charts ([`chart`]).

#![forbid(unsafe_code)]

pub mod chart;
pub mod crop;
mod error;
mod number;
pub mod page;
pub mod table;

pub use error::{Error, Result};
pub use number::{decimal, optional, percent, signed};
