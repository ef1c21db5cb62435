//! A corpus in the formats of other tools.
//!
//! Input: a corpus and what of it is wanted. Output: a folder in a format that other programs read ([`Format`]), with a manifest of
//! hashes. Only sealed files are read, and checked. A folder under its final name is complete: it is made in `DIR.partial`, which
//! a later run with the same request continues.

#![forbid(unsafe_code)]

mod description;
mod error;
mod export;
mod formats;
mod place;
mod request;
mod scenarios;
mod still;

pub use description::{describe_corpus, is_described_as_it_is};
pub use error::{Error, Result};
pub use export::{ExportOutcome, export};
pub use request::{BoxSource, ExportRequest, Format, Ticks};
pub use scenarios::LostScenario;
pub use still::StillFormat;
