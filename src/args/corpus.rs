//! Arguments of the verbs that label, check and copy a corpus.

use std::path::PathBuf;

use clap::Args;
use clap::builder::{PathBufValueParser, TypedValueParser};
use store::{CorpusLocation, StoreUrl};

use crate::args::folder;
use crate::args::shared::output::Output;

#[derive(Debug, Args)]
pub(crate) struct LabelArgs {
    /// Folder of the corpus
    #[arg(value_parser = folder())]
    pub(crate) corpus: PathBuf,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct StatusArgs {
    /// Folder of the corpus, or its URL
    ///
    /// An object store does not show the scenarios that machines are recording.
    #[arg(value_name = "CORPUS|URL", value_parser = PathBufValueParser::new().try_map(|path| CorpusLocation::of(&path)))]
    pub(crate) corpus: CorpusLocation,
    /// Look again every 5 s, until all scenarios are recorded
    #[arg(long)]
    pub(crate) watch: bool,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct VerifyArgs {
    /// Folder of the corpus, or its URL
    ///
    /// From an object store, scenarios are downloaded one after the other into a temporary folder.
    #[arg(value_name = "CORPUS|URL", value_parser = PathBufValueParser::new().try_map(|path| CorpusLocation::of(&path)))]
    pub(crate) corpus: CorpusLocation,
    /// Do not decode the videos: check hashes, tables and plan only
    #[arg(long)]
    pub(crate) no_decode: bool,
    /// Count missing planned scenarios as faults
    ///
    /// By default they are only reported, since the corpus may be unfinished.
    #[arg(long)]
    pub(crate) complete: bool,
    /// Compare with this corpus
    ///
    /// A label that differs by over 1 mm, or a ground-truth box by over 0.01 px, is a fault. The videos of this corpus are not read and may
    /// be missing.
    #[arg(long, value_name = "EXPECTED", value_parser = folder())]
    pub(crate) against: Option<PathBuf>,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct FetchArgs {
    /// The corpus: s3://BUCKET/PREFIX or file:///FOLDER
    pub(crate) url: StoreUrl,
    /// Folder of the corpus, created if missing. Existing scenarios are left alone
    #[arg(long, value_name = "FOLDER", value_parser = Output::Corpus.parser())]
    pub(crate) out: PathBuf,
    /// Only these scenarios, separated by commas
    #[arg(long, value_name = "ID,..", value_delimiter = ',')]
    pub(crate) only: Vec<String>,
    /// Longest wait for a store that does not answer
    #[arg(long = "timeout", value_name = "SECONDS", default_value_t = 300)]
    pub(crate) timeout_s: u64,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct PushArgs {
    /// Folder of the corpus
    #[arg(value_parser = folder())]
    pub(crate) corpus: PathBuf,
    /// Destination: s3://BUCKET/PREFIX or file:///FOLDER
    ///
    /// Damaged scenarios are replaced there, and unlabelled ones by labelled ones of the same recording.
    #[arg(value_parser = Output::url())]
    pub(crate) url: StoreUrl,
    /// Longest wait for a store that does not answer
    #[arg(long = "timeout", value_name = "SECONDS", default_value_t = 300)]
    pub(crate) timeout_s: u64,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}
