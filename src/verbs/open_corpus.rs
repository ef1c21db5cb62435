//! The corpus that a caller named.

use std::path::Path;

use dataset::corpus::Corpus;

use crate::failure::{Ending, Failure};

/// The corpus in a folder. A missing one is an input error.
pub(crate) fn open_corpus(root: &Path) -> Result<Corpus, Failure> {
    Corpus::open(root).map_err(Failure::bad_input)
}

/// The same without its damaged scenarios, for verbs that read all of it. They are named, and the work is then done with losses.
pub(crate) fn open_sound_corpus(verb: &str, root: &Path) -> Result<(Corpus, Ending), Failure> {
    let (sound, damaged) = open_corpus(root)?
        .without_damaged()
        .map_err(Failure::of_corpus)?;
    for scenario in &damaged {
        eprint_warning!(
            "{verb}: scenario {} is damaged and left out: {}; move its folder out of {}/scenarios and run `dtd generate` or `dtd fetch` again",
            scenario.id,
            scenario.reason,
            root.display()
        );
    }
    let ending = if damaged.is_empty() {
        Ending::Done
    } else {
        Ending::Losses
    };
    Ok((sound, ending))
}

/// The same as [`open_corpus`], for verbs that need scenarios in it.
pub(crate) fn open_filled_corpus(root: &Path) -> Result<Corpus, Failure> {
    let corpus = open_corpus(root)?;
    refuse_empty(&corpus)?;
    Ok(corpus)
}

/// Rejects a corpus without a scenario that could be used.
pub(crate) fn refuse_empty(corpus: &Corpus) -> Result<(), Failure> {
    if corpus.scenarios().map_err(Failure::of_corpus)?.is_empty() {
        return Err(Failure::bad_input_message(format!(
            "{} contains no complete scenario yet; record some with `dtd generate SWEEP.toml --out {0}`",
            corpus.root().display()
        )));
    }
    Ok(())
}
