//! A corpus in an object store: upload, listing, download.
//!
//! There are no renames and no locks in a bucket, so three rules replace them:
//!
//! - **A scenario counts once its `DONE.json` is there.** It is uploaded last, and readers ignore all other objects until then.
//! - **Every other object of a scenario is named after its content** and never changes ([`content_name`]). However late an upload arrives,
//!   it never replaces other content.
//! - **`DONE.json` is replaced only by comparison** with the version that was judged ([`commit`]), by the copy that goes before it
//!   ([`precedence`]). It notes size and ETag of each object, so one listing shows whether all of them are there ([`stored_seal`]), and a
//!   checksum of itself.
//!
//! Objects carry the BLAKE3 hash of the manifest as metadata, so a resumed upload compares instead of sending again.
//!
//! ```text
//! Place: folder or URL  ->  CorpusStore: what is committed, the files of the whole corpus  ->  upload, fetch: one scenario
//! ```
//!
//! Recording, labelling and training need seeks, locks and FFmpeg, so they work on folders: `dtd generate --out URL` records in a staging
//! folder and uploads finished scenarios in the meantime.

#![forbid(unsafe_code)]

mod commit;
mod content_name;
mod corpus_store;
mod detections;
mod error;
mod fetch;
mod leftovers;
mod listing;
mod location;
mod open;
mod patience;
mod place;
mod precedence;
mod send;
mod settle;
mod stored_fault;
mod stored_seal;
mod upload;

#[cfg(test)]
mod tests;

pub use corpus_store::CorpusStore;
pub use detections::{LeftDetections, MovedDetections};
pub use error::{Result, StoreError};
pub use fetch::Fetched;
pub use listing::{Listing, Objects};
pub use location::{CorpusLocation, StoreUrl, redacted};
pub use patience::{Patience, Transfer};
pub use settle::Keep;
pub use stored_fault::{StoredFault, StoredFaults};
pub use stored_seal::Committed;
pub use upload::{Before, Pushed};
