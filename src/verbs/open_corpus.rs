//! Opens the corpus that a caller named.

use std::path::Path;

use dataset::corpus::Corpus;

use crate::failure::Failure;

/// The corpus in a folder. One that is not there is the caller's to mend.
pub(crate) fn open_corpus(root: &Path) -> Result<Corpus, Failure> {
    Corpus::open(root).map_err(Failure::bad_input)
}
