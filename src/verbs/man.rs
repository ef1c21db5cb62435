//! `dtd man`: the manual pages.

use std::fs;
use std::path::Path;

use dataset::Error;
use dataset::files::json_file::write_atomically;
use dataset::files::outside_file::{self, FileKind};
use tempfile::TempDir;

use super::Outcome;
use crate::args::Args;
use crate::failure::{Ending, Failure};

const PAGE: FileKind = FileKind::new("manual page", 1 << 20).unlinked();
/// Start of every page's title line.
const TITLE: &str = ".TH dtd";

/// Runs the verb: a page for the program, and one for each verb. Earlier pages are replaced, and no other files.
pub(crate) fn run(folder: &Path) -> Outcome {
    let temporary = std::env::temp_dir();
    let made = TempDir::with_prefix("dtd-").map_err(Error::io("create", &temporary))?;
    clap_mangen::generate_to(Args::grouped_command(), made.path())
        .map_err(Error::io("write to", made.path()))?;
    let mut pages = Vec::new();
    for entry in fs::read_dir(made.path()).map_err(Error::io("list", made.path()))? {
        let page = entry.map_err(Error::io("list", made.path()))?;
        let target = folder.join(page.file_name());
        refuse_other_file(&target)?;
        pages.push((page.path(), target));
    }
    fs::create_dir_all(folder).map_err(Error::io("create", folder))?;
    for (page, target) in pages {
        write_atomically(&target, &outside_file::read(&page, PAGE)?)?;
    }
    eprintln!("man: pages written to {}", folder.display());
    Ok(Ending::Done)
}

fn refuse_other_file(page: &Path) -> Result<(), Failure> {
    match outside_file::read_text(page, PAGE) {
        Ok(text) if text.lines().any(|line| line.starts_with(TITLE)) => Ok(()),
        Ok(_) => Err(Failure::bad_input_message(format!(
            "{} is not a manual page of dtd and is not replaced; move it away, or name another folder",
            page.display()
        ))),
        Err(error) if error.is_not_found() => Ok(()),
        Err(error) => Err(Failure::of_corpus(error)),
    }
}
