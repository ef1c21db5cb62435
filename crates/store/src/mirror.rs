//! The rules by which a corpus in a folder and its copy in a store are made equal.
//!
//! 1. Each file of the whole corpus (plan, split, sweep) is compared with the other copy's. The file that contains the other one stays. If
//!    they contradict each other, the call ends before a scenario is transferred ([`corpus_files`]).
//! 2. A copy whose own files contradict each other is not transferred.
//! 3. The planned scenarios follow one by one, each by the rule for two copies of it (`scenario/precedence.rs`), and then their
//!    detections. A scenario that cannot be transferred does not stop the others.
//!
//! This crate cannot read sweeps; [`SweepLanguage`] does.

mod corpus_files;
mod error;
mod fetch;
mod push;
mod settle;

use dataset::corpus::Corpus;
use dataset::corpus::claim::Claim;
use dataset::corpus::splits::{Leak, Splits};
use dataset::plan::Plan;
use tokio::task::spawn_blocking;

use crate::corpus_store::CorpusStore;
use crate::patience::{Patience, Transfer};

pub use corpus_files::{BadFile, Replaced, sweep_fault};
pub use error::MirrorError;
pub use fetch::{FetchedCorpus, FetchedScenario};
pub use push::{PushedCorpus, PushedScenario};
pub use settle::Keep;

/// A store with a copy of a corpus, to upload to or download from.
pub struct Mirror<'a> {
    /// The store.
    pub store: &'a CorpusStore,
    /// Reader of `corpus.toml`.
    pub sweeps: &'a dyn SweepLanguage,
    /// Timeout for a store that does not answer.
    pub patience: Patience,
    /// The transfers; their watch counts the scenarios.
    pub transfer: &'a Transfer<'a>,
}

/// The claim of the files of the whole corpus; waits for another writer, on another thread, so that the wait can be dropped.
async fn claim_corpus(corpus: &Corpus) -> dataset::Result<Claim> {
    let corpus = corpus.clone();
    let claimed = spawn_blocking(move || corpus.claim()).await;
    claimed.unwrap_or_else(|panic| std::panic::resume_unwind(panic.into_panic()))
}

/// The language of sweeps, in which `corpus.toml` is written. The generator implements it.
pub trait SweepLanguage: Sync {
    /// Reason why a text is not a sweep, if it is none.
    fn fault(&self, sweep: &[u8]) -> Option<String>;

    /// Reason why a sweep of another corpus than the plan, by its name or its seed, is one.
    fn other_corpus(&self, sweep: &[u8], plan: &Plan) -> Option<String>;

    /// A new split of the plan, as the sweep divides it; `None` if the text is not a sweep.
    fn split(&self, sweep: &[u8], plan: &Plan) -> Option<Result<Splits, Leak>>;
}

/// Decision about a file of the whole corpus.
#[derive(Debug)]
pub enum FileDecision {
    /// The one in the destination was replaced.
    Replaced(Replaced),
    /// The one in the destination contains more and stays.
    HasMore,
    /// Only the store has it; it stays there.
    OnlyInStore,
    /// Neither copy has it.
    Missing,
    /// Neither copy had the split: it was made again from plan and seed.
    SplitAgain,
}
