//! A corpus in the formats of other tools.
//!
//! Input: a corpus and what of it is wanted. Output: a folder in a format that other programs read ([`Format`]), with a manifest of
//! hashes. Only sealed files are read, and checked. A folder under its final name is complete: it is made in `DIR.partial`, which
//! a later run with the same request continues.

#![forbid(unsafe_code)]

mod about;
mod coco;
mod columns_text;
mod corpus_croissant;
mod croissant;
mod error;
mod export;
mod foxglove;
mod huggingface;
mod lerobot;
mod long_tables;
mod mcap_files;
mod moments;
mod part;
mod picture_files;
mod pictures;
mod place;
mod predictions;
mod request;
mod selection;
mod source;
mod still;
mod webdataset;
mod yolo;

pub use corpus_croissant::{describe_corpus, is_described_as_it_is};
pub use error::{Error, Result};
pub use export::{ExportOutcome, export};
pub use request::{BoxSource, ExportRequest, Format, Ticks, USUAL_CROP_PX};
pub use still::StillFormat;
