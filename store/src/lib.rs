//! A corpus in an object store: sent there, found there, brought back.
//!
//! In a bucket a corpus has the same names as in a folder (`docs/dataset.md`). There is no renaming and no locking there, so one rule
//! takes their place: **a scenario counts when its `DONE.json` is there**. That file is sent last and taken away first, and nobody looks
//! at anything else before. Objects appear whole or not at all, so what is there with the right size and the right hash need not be
//! sent again: each carries the BLAKE3 hash of `MANIFEST.b3` as metadata. (An ETag would not do: its form differs from store to store
//! and with the size of the parts.)
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
mod open;
mod patience;
mod place;
mod upload;

#[cfg(test)]
mod tests;

pub use corpus_store::{CorpusStore, Keep, Settled};
pub use detections::{LeftDetections, MovedDetections};
pub use error::{Result, StoreError};
pub use fetch::Fetched;
pub use patience::{Patience, Watch};
pub use place::{Place, SCHEMES, StoreUrl};
pub use upload::{OnOther, Pushed};
