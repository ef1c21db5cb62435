//! Opens the corpus that a caller named.

use std::path::Path;

use dataset::corpus::Corpus;

use crate::failure::Failure;

/// The corpus in a folder. A missing one is an input error.
pub(crate) fn open_corpus(root: &Path) -> Result<Corpus, Failure> {
    Corpus::open(root).map_err(Failure::bad_input)
}

/// The same, for verbs that need scenarios in it.
pub(crate) fn open_filled_corpus(root: &Path) -> Result<Corpus, Failure> {
    let corpus = open_corpus(root)?;
    if corpus.scenarios().map_err(Failure::of_corpus)?.is_empty() {
        return Err(Failure::bad_input_message(format!(
            "{} contains no complete scenario yet; record some with `dtd generate SWEEP.toml --out {0}`",
            root.display()
        )));
    }
    Ok(corpus)
}
