//! A corpus in an object store: upload, listing, download.
//!
//! There are no renames and no locks in a bucket, so five rules replace them:
//!
//! - **Objects first, `DONE.json` last.** A scenario counts once its `DONE.json` is there, and all other objects are named after their
//!   content. `DONE.json` is created, or replaces the one that was judged: damaged, or unlabelled and from the same recording
//!   (`upload.rs`).
//! - **Detections that the store lacks are added** (`detections.rs`).
//! - **Whole means that name, size and noted ETag agree.** With a different ETag an object is read; with none noted, the hash in its
//!   metadata counts (`stored.rs`).
//! - **A local copy is removed only if the store's is whole** (the generator's uploads).
//! - **One damaged scenario stops no other** (`mirror.rs`).
//!
//! ```text
//! CorpusLocation: folder or URL  ->  CorpusStore, Connection: requests  ->  stored: wholeness  ->  upload, download, detections
//!                                                                                                  ->  mirror: a whole corpus
//! ```
//!
//! Recording, labelling and training need seeks, locks and FFmpeg, so they work on folders: `dtd generate --out URL` records in a staging
//! folder and uploads finished scenarios in the meantime.

#![forbid(unsafe_code)]

mod client;
mod corpus_files;
mod detections;
mod download;
mod error;
mod location;
mod mirror;
mod stored;
mod upload;

#[cfg(test)]
mod tests;

pub use client::{Connection, CorpusStore, Listing, Logged};
pub use corpus_files::{SweepLanguage, sweep_fault};
pub use download::Fetched;
pub use error::{Fault, Faults, Result, StoreError};
pub use location::{CorpusLocation, StoreUrl, redacted};
pub use mirror::{MirrorReport, SPLIT_AGAIN};
pub use stored::Committed;
pub use upload::{Before, Pushed};
