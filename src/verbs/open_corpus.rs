//! The corpus that a caller named.

use std::path::Path;

use dataset::corpus::detections::{choose, provenance};
use dataset::corpus::{Corpus, ScenarioFolder};
use trainer::RunFolder;

use super::output::listed;
use crate::failure::{Ending, Failure};

pub(crate) fn open_corpus(root: &Path) -> Result<Corpus, Failure> {
    Corpus::open(root).map_err(Failure::bad_input)
}

/// The corpus without its damaged scenarios, for verbs that read every scenario. Damaged ones are named and count as losses.
pub(crate) fn open_sound_corpus(verb: &str, root: &Path) -> Result<(Corpus, Ending), Failure> {
    let (sound, damaged) = open_corpus(root)?
        .without_damaged()
        .map_err(Failure::of_corpus)?;
    for scenario in &damaged {
        eprint_warning!(
            "{verb}: scenario {} is damaged or may not be read, and is left out: {}; move its folder {}",
            scenario.id,
            scenario.reason,
            out_of(root)
        );
    }
    let ending = Ending::with_losses(&damaged);
    Ok((sound, ending))
}

/// The remedy for a damaged scenario, after "move its folder".
pub(crate) fn out_of(root: &Path) -> String {
    format!(
        "out of {}/scenarios and run `dtd generate` or `dtd fetch` again",
        root.display()
    )
}

/// The remedy as a line, after scenarios that failed.
pub(crate) fn repair(root: &Path) -> String {
    format!("move the folder of a damaged scenario {}", out_of(root))
}

/// The corpus without the scenarios that a model has not searched, if it has searched others: `dtd detect` cannot search all, or has not
/// yet. They are named, and the work is then done with losses. `asked` is the model by name or hash; without it, the only one.
pub(crate) fn leave_out_unsearched(
    verb: &str,
    corpus: Corpus,
    asked: Option<&str>,
) -> Result<(Corpus, Ending), Failure> {
    let folders = corpus.scenarios().map_err(Failure::of_corpus)?;
    let Ok(model) = choose(&folders, asked).map_err(Failure::of_corpus)? else {
        // Rejected by the reader, with the models that there are.
        return Ok((corpus, Ending::Done));
    };
    // A damaged record is rejected by the reader: `dtd detect` replaces it.
    let is_unsearched =
        |folder: &&ScenarioFolder| matches!(provenance(folder, &model.hash), Ok(None));
    let unsearched: Vec<String> = (folders.iter().filter(is_unsearched))
        .map(ScenarioFolder::id)
        .collect();
    if unsearched.is_empty() || unsearched.len() == folders.len() {
        return Ok((corpus, Ending::Done));
    }
    eprint_warning!(
        "{verb}: {} not searched by {model} and left out: {}; run `dtd detect` on them, and if it cannot search one, move its folder {}",
        match unsearched.len() {
            1 => "1 scenario is".to_owned(),
            many => format!("{many} scenarios are"),
        },
        listed(&unsearched),
        out_of(corpus.root())
    );
    Ok((corpus.without(unsearched), Ending::Losses))
}

/// [`leave_out_unsearched`] with the run's model, unless `asked` names a model.
pub(crate) fn leave_out_unsearched_by_run(
    verb: &str,
    corpus: Corpus,
    run: &Path,
    asked: Option<&str>,
) -> Result<(Corpus, Ending), Failure> {
    let model = match asked {
        Some(asked) => Some(asked.to_owned()),
        None => RunFolder::at(run).model_hash(),
    };
    match model {
        Some(model) => leave_out_unsearched(verb, corpus, Some(&model)),
        // A run that cannot be read is rejected by its reader.
        None => Ok((corpus, Ending::Done)),
    }
}

/// A corpus with at least one scenario.
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
