//! A corpus in an object store: upload, listing, download.
//!
//! In a bucket a corpus has the same names as in a folder (`docs/dataset.md`). There are no renames and no locks, so one rule
//! replaces them: **a scenario counts once its `DONE.json` is there**. That file is uploaded last and deleted first, and readers
//! look at nothing else before. Objects appear atomically, so one with the right size and hash need not be sent again: each carries
//! the BLAKE3 hash of `MANIFEST.b3` as metadata. (An ETag would not do: it differs from store to store and with the part size.)
//!
//! ```text
//! Place: folder or URL  ->  CorpusStore: what is committed, the files of the whole corpus  ->  upload, fetch: one scenario
//! ```

#![forbid(unsafe_code)]

mod corpus_store;
mod detections;
mod error;
mod fetch;
mod leftovers;
mod location;
mod open;
mod patience;
mod settle;
mod upload;

#[cfg(test)]
mod tests;

pub use corpus_store::CorpusStore;
pub use detections::{LeftDetections, MovedDetections};
pub use error::{Result, StoreError};
pub use fetch::Fetched;
pub use location::{CorpusLocation, StoreUrl};
pub use patience::{Patience, Watch};
pub use settle::Keep;
pub use upload::{OnOther, Pushed};
