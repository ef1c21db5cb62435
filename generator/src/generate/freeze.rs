//! The files of the whole corpus, frozen by the first run, and which scenarios are complete already.

use std::path::Path;
use std::time::{Duration, Instant};

use dataset::corpus::claim::{Claim, WHOLE_CORPUS};
use dataset::corpus::seal::{self, Seal};
use dataset::corpus::{Corpus, ScenarioFolder, check_place};
use dataset::files::json_file::write_atomically;
use dataset::files::new_file::clear_leftovers;
use dataset::files::outside_file::{self, FileKind};
use dataset::plan::{Difference, Plan, PlannedScenario};
use tokio::time::sleep;

use super::error::GenerateError;
use crate::plan::assign_sides;
use crate::sweep::Sweep;

/// Time that other processes need to write the plan.
const HELD_FOR_LONG: Duration = Duration::from_secs(30);
const POLL_INTERVAL: Duration = Duration::from_millis(100);

/// The plan that a corpus was started from; rejects one that is not part of `plan`, and a folder with other things in it.
pub(super) fn frozen_plan(corpus_root: &Path, plan: &Plan) -> Result<Option<Plan>, GenerateError> {
    if corpus_root.exists() && !corpus_root.is_dir() {
        return Err(GenerateError::BadInput(format!(
            "{}: is a file, expected a folder, or a name under which one can be made",
            corpus_root.display()
        )));
    }
    check_place(corpus_root)?;
    let frozen = match Corpus::open(corpus_root) {
        Ok(corpus) if corpus.plan_path().exists() => Plan::read(&corpus.plan_path())?,
        _ => {
            check_sweep(corpus_root, plan)?;
            return Ok(None);
        }
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
fn check_sweep(corpus_root: &Path, plan: &Plan) -> dataset::Result<()> {
    match sweep_there(corpus_root)? {
        Some(text) if !text.is_empty() && !plan.is_of_sweep(&text) => Err(dataset::Error::corpus(
            &corpus_root.join(Corpus::SWEEP),
            "differs from the sweep of this run, and there is no plan.json that was made from it; move it away, or use another folder",
        )),
        _ => Ok(()),
    }
}

/// True if the sweep that the plan was expanded from is present.
fn has_sweep(corpus_root: &Path, plan: &Plan) -> dataset::Result<bool> {
    let text = sweep_there(corpus_root)?;
    Ok(text.is_some_and(|text| plan.is_of_sweep(&text)))
}

fn sweep_there(corpus_root: &Path) -> dataset::Result<Option<Vec<u8>>> {
    let path = corpus_root.join(Corpus::SWEEP);
    match outside_file::read(&path, FileKind::SWEEP.unlinked()) {
        Ok(text) => Ok(Some(text)),
        Err(error) if error.is_not_found() => Ok(None),
        Err(error) => Err(error),
    }
}

/// Freezes plan and split in the corpus, or extends the existing ones. Runs that start at once take turns. `split_there` is the object
/// store's split if the corpus is a stage; it takes precedence.
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
    // Read again: a concurrent run may have frozen its plan since this one looked.
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

/// State of a scenario's folder.
pub(crate) enum FolderState {
    Absent,
    Sealed(Seal),
    Damaged(String),
}

impl FolderState {
    /// Examines a folder; `faults` lists the damaged files of a sealed one.
    pub(crate) fn of(
        folder: &ScenarioFolder,
        faults: fn(&Path) -> dataset::Result<Vec<String>>,
    ) -> dataset::Result<Self> {
        let examined = || {
            let seal = match folder.seal()? {
                Some(seal) => seal,
                None if !folder.root().exists() => return Ok(Self::Absent),
                // Once more: a recording may have been finished between the two looks.
                None => match folder.seal()? {
                    Some(seal) => seal,
                    None => return Ok(Self::Damaged("it has no seal (DONE.json)".into())),
                },
            };
            let faults = faults(folder.root())?;
            Ok(if faults.is_empty() {
                Self::Sealed(seal)
            } else {
                Self::Damaged(faults.join("; "))
            })
        };
        match examined() {
            Err(error) if dataset::Error::is_damage(&error) => Ok(Self::Damaged(error.to_string())),
            state => state,
        }
    }
}

/// True if a scenario exists, matches its seal, and was made from exactly these parameters. Videos are only checked for existence: `dtd
/// verify` reads them.
pub(super) fn is_whole(corpus: &Corpus, scenario: &PlannedScenario) -> Result<bool, GenerateError> {
    let folder = corpus.scenario(&scenario.id);
    let message = match FolderState::of(&folder, seal::faults_besides_videos)? {
        FolderState::Absent => return Ok(false),
        FolderState::Sealed(seal) if seal.config_hash == scenario.config_hash => return Ok(true),
        FolderState::Sealed(_) => "it was made from other parameters".into(),
        FolderState::Damaged(what) => format!("it is damaged: {what}"),
    };
    Err(GenerateError::ForeignFolder {
        folder: folder.root().to_owned(),
        message,
    })
}
