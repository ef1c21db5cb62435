//! The files of the whole corpus, frozen by the first run, and which scenarios are complete already.

use std::path::Path;
use std::time::{Duration, Instant};

use dataset::corpus::claim::{Claim, WHOLE_CORPUS};
use dataset::corpus::seal;
use dataset::corpus::{Corpus, check_place};
use dataset::files::json_file::write_atomically;
use dataset::files::new_file::clear_leftovers;
use dataset::files::outside_file::{self, FileKind};
use dataset::plan::{Difference, Plan, PlannedScenario};
use tokio::time::sleep;

use super::error::GenerateError;
use crate::plan::assign_sides;
use crate::sweep::Sweep;

/// Another process needs a moment to write the plan.
const HELD_FOR_LONG: Duration = Duration::from_secs(30);
const POLL_INTERVAL: Duration = Duration::from_millis(100);

/// The plan that a corpus was started from; rejects one that is not part of `plan`, and a folder with other things in it.
pub(super) fn frozen_plan(corpus_root: &Path, plan: &Plan) -> Result<Option<Plan>, GenerateError> {
    if corpus_root.exists() && !corpus_root.is_dir() {
        return Err(GenerateError::NotAFolder {
            path: corpus_root.to_owned(),
        });
    }
    check_place(corpus_root)?;
    let frozen = match Corpus::open(corpus_root) {
        Ok(corpus) if corpus.plan_path().exists() => Plan::read(&corpus.plan_path())?,
        _ => return check_sweep(corpus_root, plan).map(|()| None),
    };
    match Difference::between(&frozen, plan).conflict() {
        Some(difference) => Err(GenerateError::OtherPlan {
            corpus: corpus_root.to_owned(),
            difference,
        }),
        None => Ok(Some(frozen)),
    }
}

/// Missing files of the corpus as a whole; includes the sweep if it differs from the plan's text.
pub(super) fn lost_files(corpus_root: &Path, plan: &Plan) -> dataset::Result<Vec<&'static str>> {
    let has_sweep = has_sweep(corpus_root, plan)?;
    let is_lost = |name: &&str| match *name {
        Corpus::SWEEP => !has_sweep,
        name => !corpus_root.join(name).exists(),
    };
    Ok(Corpus::FILES.into_iter().filter(is_lost).collect())
}

/// Rejects a sweep that is not this plan's and would be replaced: without a plan beside it, it may be anybody's work.
fn check_sweep(corpus_root: &Path, plan: &Plan) -> Result<(), GenerateError> {
    let path = corpus_root.join(Corpus::SWEEP);
    match outside_file::read(&path, FileKind::SWEEP.unlinked()) {
        Ok(text) if text.is_empty() || plan.is_of_sweep(&text) => Ok(()),
        Ok(_) => Err(dataset::Error::corpus(
            &path,
            "differs from the sweep of this run, and there is no plan.json that was made from it; move it away, or use another folder",
        )
        .into()),
        Err(error) if error.is_not_found() => Ok(()),
        Err(error) => Err(error.into()),
    }
}

/// True if the sweep that the plan was expanded from is present.
fn has_sweep(corpus_root: &Path, plan: &Plan) -> dataset::Result<bool> {
    let path = corpus_root.join(Corpus::SWEEP);
    match outside_file::read(&path, FileKind::SWEEP.unlinked()) {
        Ok(text) => Ok(plan.is_of_sweep(&text)),
        Err(error) if error.is_not_found() => Ok(false),
        Err(error) => Err(error),
    }
}

/// Freezes plan and split in the corpus, or extends the existing ones. Runs that start at once take turns. `split_there`: the split
/// of an object store for which the corpus is the stage; it takes precedence.
pub(super) async fn freeze(
    corpus: &Corpus,
    sweep: &Sweep,
    plan: &Plan,
    split_there: Option<&[u8]>,
) -> Result<(), GenerateError> {
    let began = Instant::now();
    let _claim = loop {
        match Claim::take(corpus, WHOLE_CORPUS)?.or_held(corpus.root(), HELD_FOR_LONG) {
            Ok(claim) => break claim,
            Err(error) if began.elapsed() > HELD_FOR_LONG => return Err(error.into()),
            Err(_) => sleep(POLL_INTERVAL).await,
        }
    };
    clear_leftovers(corpus.root());
    // Read again: another run may have frozen its plan since this one looked.
    let frozen = frozen_plan(corpus.root(), plan)?;
    let path = corpus.splits_path();
    if let Some(split) = split_there {
        write_atomically(&path, split)?;
    }
    let earlier = if path.exists() {
        Some(corpus.splits()?)
    } else {
        None
    };
    let splits = assign_sides(plan, &sweep.split, sweep.corpus.seed, earlier.as_ref())
        .map_err(|message| dataset::Error::corpus(&path, message))?;
    if earlier.as_ref() != Some(&splits) {
        splits.write(&path)?;
    }
    let has_sweep = has_sweep(corpus.root(), plan)?;
    if let Some(frozen) = &frozen
        && !has_sweep
        && frozen.sweep_blake3 == plan.sweep_blake3
    {
        tracing::warn!(
            "{} was missing or had been changed since it was frozen; it is the sweep again that the plan was made from",
            corpus.sweep_path().display()
        );
    }
    if frozen.as_ref() != Some(plan) || !has_sweep {
        write_atomically(&corpus.sweep_path(), sweep.text.as_bytes())?;
        plan.write(&corpus.plan_path())?;
    }
    Ok(())
}

/// True if a scenario exists, matches its seal, and was made from exactly these parameters. Videos are only checked for existence: `dtd
/// verify` reads them.
pub(super) fn is_whole(corpus: &Corpus, scenario: &PlannedScenario) -> Result<bool, GenerateError> {
    let folder = corpus.scenario(&scenario.id);
    let foreign = |message: String| {
        Err(GenerateError::ForeignFolder {
            folder: folder.root().to_owned(),
            message,
        })
    };
    if !folder.root().exists() {
        return Ok(false);
    }
    match folder.seal() {
        Err(error) if error.is_damage() => foreign(format!("it is damaged: {error}")),
        Err(error) => Err(error.into()),
        Ok(None) => foreign("it has no seal (DONE.json)".into()),
        Ok(Some(seal)) if seal.config_hash != scenario.config_hash => {
            foreign("it was made from other parameters".into())
        }
        Ok(Some(_)) => match seal::faults_besides_videos(folder.root()) {
            Ok(faults) if faults.is_empty() => Ok(true),
            Ok(faults) => foreign(format!("it is damaged: {}", faults.join("; "))),
            Err(error) if error.is_damage() => foreign(format!("it is damaged: {error}")),
            Err(error) => Err(error.into()),
        },
    }
}
