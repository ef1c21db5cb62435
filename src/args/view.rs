//! Options of `dtd view`.

use std::path::PathBuf;

use clap::Args;

use crate::args::folder;

/// Options of the viewer.
#[derive(Debug, Args)]
pub(crate) struct ViewArgs {
    /// Folder of the corpus, finished or in the making; it is only read
    #[arg(default_value = "corpus", value_parser = folder())]
    pub(crate) corpus: PathBuf,
    /// Run whose errors to show, or a table of `dtd predict`; may be repeated
    #[arg(long = "run", value_name = "RUN", value_parser = folder())]
    pub(crate) runs: Vec<PathBuf>,
    /// Port on this computer; 0 takes any free one
    ///
    /// The address is printed as one JSON line when the page is ready. Other computers cannot reach it.
    #[arg(long, default_value_t = 4180, allow_negative_numbers = true)]
    pub(crate) port: u16,
    /// Do not open the page in a browser
    #[arg(long)]
    pub(crate) no_open: bool,
    /// Stop when standard input ends, besides Ctrl-C and SIGTERM
    #[arg(long)]
    pub(crate) until_stdin_ends: bool,
}
