//! A corpus in the formats of other tools.
//!
//! Input: a corpus and a selection of its data. Output: a folder in a format that other programs read ([`Format`]), with a manifest of
//! hashes. Only sealed files are read, after checking their hashes. The folder is made in `DIR.partial` and gets its final name when it is
//! complete; a later run with the same request resumes it.
//!
//! `export.rs` selects, checks and counts the scenarios, decodes several at a time, resumes and seals. A format implements
//! `FileFormat` (`file_format.rs`) in a file of `formats/`, which `formats.rs` lists.

#![forbid(unsafe_code)]

mod about;
mod columns;
mod destination;
mod error;
mod export;
mod file_format;
mod formats;
mod request;
mod scenarios;
mod still;

pub use error::{Error, Result};
pub use export::{ExportOutcome, export};
pub use request::{BoxSource, ExportRequest, Format};
pub use scenarios::LostScenario;
pub use still::StillFormat;
