//! Arguments of the verbs that plan and record a corpus.

use std::num::NonZeroU32;
use std::path::PathBuf;

use clap::Args;
use clap::builder::{PathBufValueParser, PossibleValuesParser, TypedValueParser};
use generator::generate::{SimulatorTarget, Simulators};
use store::CorpusLocation;
use xplane_bridge::pixels::PixelChoice;

use crate::args::shared::choice::from_one;
use crate::args::shared::local_udp::LocalUdpArgs;
use crate::args::shared::output::Output;
use crate::args::shared::shard::ShardArg;

#[derive(Debug, Args)]
pub(crate) struct PlanArgs {
    /// The sweep, e.g. scenarios.toml
    #[arg(value_name = "SWEEP.toml")]
    pub(crate) sweep: PathBuf,
    /// Compare with this corpus
    ///
    /// Shows which scenarios are complete, new, changed or removed there. The default is ./corpus if it was made from a sweep of this name.
    #[arg(long, value_name = "CORPUS|URL", value_parser = PathBufValueParser::new().try_map(|path| CorpusLocation::of(&path)))]
    pub(crate) against: Option<CorpusLocation>,
    /// Estimate the recording time with this simulator
    ///
    /// For an X-Plane (HOST:PORT, or `auto`), the profile measured by `dtd doctor` is used. By default, and with `mock`, figures of the
    /// bundled simulator on two cores are used.
    #[arg(long, value_name = "mock|auto|HOST:PORT")]
    pub(crate) sim: Option<SimulatorTarget>,
    #[command(flatten)]
    pub(crate) local_udp: LocalUdpArgs,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct GenerateArgs {
    /// The sweep, e.g. scenarios.toml
    #[arg(value_name = "SWEEP.toml")]
    pub(crate) sweep: PathBuf,
    /// Folder of the corpus, created if missing, or its URL; finished scenarios are skipped
    ///
    /// A URL is s3://BUCKET/PREFIX or file:///FOLDER, with credentials from the environment (docs/corpus.md).
    #[arg(long, value_name = "CORPUS|URL", value_parser = Output::corpus_or_url())]
    pub(crate) out: CorpusLocation,
    /// For a URL: folder where scenarios are recorded before they are uploaded
    ///
    /// Runs on one machine may share it. The default is one per URL in the user's cache folder.
    #[arg(long, value_name = "FOLDER", value_parser = Output::Corpus.parser())]
    pub(crate) staging: Option<PathBuf>,
    /// For a URL: keep scenarios in the staging folder after the upload
    #[arg(long)]
    pub(crate) keep_staged: bool,
    /// The simulator, or several that share the work, separated by commas
    ///
    /// `mock` starts the bundled simulator on this machine, `mock:N` starts N, `mock:awkward` one with all awkward habits of live
    /// X-Plane (docs/simulator.md). HOST:PORT is X-Plane's UDP address, `auto` the X-Plane that announces itself on the network, tape:FILE
    /// a session recorded with `dtd tape`.
    #[arg(
        long,
        value_name = "mock[:N|:awkward]|auto|HOST:PORT|tape:FILE,..",
        default_value = "mock"
    )]
    pub(crate) sim: Simulators,
    #[command(flatten)]
    pub(crate) local_udp: LocalUdpArgs,
    /// Source of the images
    ///
    /// `link` sends them (the bundled simulator), `gl` reads X-Plane 11's frame back, `screen` grabs the simulator's window;
    /// `auto` uses the simulator's first offer.
    #[arg(long, value_name = "SOURCE", default_value_t = PixelChoice::Auto, value_parser = PossibleValuesParser::new(["auto", "link", "gl", "screen"]).try_map(|word| word.parse::<PixelChoice>()))]
    pub(crate) pixels: PixelChoice,
    /// Only these scenarios, separated by commas
    ///
    /// Their identifiers are those that `dtd plan` prints.
    #[arg(long, value_name = "ID,..", value_delimiter = ',')]
    pub(crate) only: Vec<String>,
    #[command(flatten)]
    pub(crate) shard: ShardArg,
    /// Longest wait for a simulator or an object store that does not answer
    ///
    /// Recording then continues without that simulator; without the store it ends.
    #[arg(long = "timeout", value_name = "SECONDS", default_value_t = 1600)]
    pub(crate) timeout_s: u64,
    /// Shell command that restarts an X-Plane that is away for a quarter of --timeout
    ///
    /// It gets --sim's name of the X-Plane in DTD_SIMULATOR, ends the old X-Plane if it is still there, starts a new one in the background,
    /// and ends with status 0 (docs/x-plane.md has an example). Then the X-Plane's version, window and profile are checked again.
    #[arg(long, value_name = "COMMAND")]
    pub(crate) restart_simulator: Option<String>,
    /// Restart X-Plane after every N live flights, e.g. 45
    #[arg(long, value_name = "N", value_parser = from_one, requires = "restart_simulator")]
    pub(crate) restart_every: Option<NonZeroU32>,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}
