//! A corpus in an object store: upload, listing, download.
//!
//! There are no renames and no locks in a bucket, so three rules replace them:
//!
//! - **A scenario counts once its `DONE.json` is there.** It is uploaded last, and readers ignore all other objects until then.
//! - **Every other object of a scenario is named after its content** and never changes (`scenario/content_name.rs`). However late an upload
//!   arrives, it never replaces other content.
//! - **`DONE.json` is replaced only by comparison** with the version that was judged (`corpus_store/commit.rs`), by the copy that goes
//!   before it (`scenario/precedence.rs`). It notes size and ETag of each object, so one listing shows whether all of them are there
//!   (`scenario/stored_seal.rs`), and a checksum of itself.
//!
//! Objects carry the BLAKE3 hash of the manifest as metadata, so a resumed upload compares instead of sending again.
//!
//! ```text
//! CorpusLocation: folder or URL  ->  CorpusStore: what is committed  ->  scenario: upload and download of one
//!                                                                    ->  mirror: a whole corpus and its files
//! ```
//!
//! Recording, labelling and training need seeks, locks and FFmpeg, so they work on folders: `dtd generate --out URL` records in a staging
//! folder and uploads finished scenarios in the meantime.

#![forbid(unsafe_code)]

mod corpus_store;
mod error;
mod location;
mod mirror;
mod patience;
mod scenario;

#[cfg(test)]
mod tests;

pub use corpus_store::{CorpusStore, Listing, Objects};
pub use error::{Result, StoreError};
pub use location::{CorpusLocation, StoreUrl, redacted};
pub use mirror::{
    BadFile, FetchedCorpus, FetchedScenario, FileDecision, Keep, Mirror, MirrorError, PushedCorpus,
    PushedScenario, Replaced, SweepLanguage, sweep_fault,
};
pub use patience::{Patience, Transfer};
pub use scenario::{
    Before, Committed, Fetched, LeftDetections, MovedDetections, Pushed, StoredFault, StoredFaults,
};
