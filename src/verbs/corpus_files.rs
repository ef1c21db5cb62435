//! The files of the whole corpus, `plan.json`, `splits.json` and `corpus.toml`, local and in an object store: whether each is
//! valid, whether they belong together, and which of two versions wins.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{anyhow, bail};
use dataset::corpus::Corpus;
use dataset::corpus::splits::{Leak, Splits};
use dataset::files::outside_file::{self, FileKind};
use dataset::files::own_path::own_path;
use dataset::plan::{Difference, Plan};
use generator::plan::{assign_sides, expand, is_seeded_by};
use generator::sweep::{SplitFractions, Sweep};
use serde::Deserialize;
use serde::de::IgnoredAny;
use store::{CorpusStore, StoreError};

/// One of the files, read and valid.
pub(super) enum CorpusFile {
    Plan(Box<Plan>),
    Splits(Splits),
    Sweep(SweepHead),
}

/// Information that a sweep's text determines without the files that it names.
#[derive(Deserialize)]
pub(super) struct SweepHead {
    corpus: generator::sweep::Corpus,
    #[serde(default)]
    split: SplitFractions,
    /// Rules that name recordings, which are files beside the sweep.
    #[serde(default)]
    recorded: Vec<IgnoredAny>,
}

/// Relation between the local version of a file and the remote one.
pub(super) enum Standing {
    /// They say the same.
    Same,
    /// The local one contains the remote one, and more.
    OursHasMore,
    /// The remote one contains the local one, and more.
    TheirsHasMore,
    /// They contradict each other.
    Conflict(String),
    /// The files themselves do not decide: it follows the plan.
    AsThePlan,
}

impl CorpusFile {
    /// Reads a file by its name; the error says what is wrong with it.
    pub(super) fn parse(name: &str, bytes: &[u8]) -> anyhow::Result<Self> {
        if bytes.iter().all(u8::is_ascii_whitespace) {
            bail!("it is empty");
        }
        match name {
            Corpus::PLAN => {
                let plan = Plan::parse(bytes, Path::new(name))?;
                plan.check_hashes()?;
                Ok(Self::Plan(Box::new(plan)))
            }
            Corpus::SPLITS => Ok(Self::Splits(Splits::parse(bytes, Path::new(name))?)),
            _ => {
                let text = std::str::from_utf8(bytes)?;
                toml::from_str(text)
                    .map(Self::Sweep)
                    // In the middle of a sentence: without the line that it is about.
                    .map_err(|error| anyhow!("{}", error.message()))
            }
        }
    }

    /// Compares this file with the remote one of the same name.
    pub(super) fn standing(&self, theirs: &Self) -> Standing {
        match (self, theirs) {
            (Self::Plan(ours), Self::Plan(theirs)) => {
                let conflict = |plan, with| Difference::between(with, plan).conflict();
                let records_sweep = |plan: &Plan| plan.sweep_blake3.is_some();
                match (conflict(ours, theirs), conflict(theirs, ours)) {
                    (None, None) if records_sweep(ours) && !records_sweep(theirs) => {
                        Standing::OursHasMore
                    }
                    (None, None) if records_sweep(theirs) && !records_sweep(ours) => {
                        Standing::TheirsHasMore
                    }
                    (None, None) => Standing::Same,
                    (None, Some(_)) => Standing::OursHasMore,
                    (Some(_), None) => Standing::TheirsHasMore,
                    (Some(difference), Some(_)) => Standing::Conflict(difference),
                }
            }
            (Self::Splits(ours), Self::Splits(theirs)) => {
                let other = ours.scenarios.iter().find(|(id, side)| {
                    let theirs = theirs.scenarios.get(*id);
                    theirs.is_some_and(|theirs| theirs != *side)
                });
                if let Some((id, ours)) = other {
                    return Standing::Conflict(format!(
                        "scenario {id} is on the {:?} side in one and on another in the other",
                        ours.side
                    ));
                }
                let lacks = |some: &Splits, others: &Splits| {
                    others
                        .scenarios
                        .keys()
                        .any(|id| !some.scenarios.contains_key(id))
                };
                match (lacks(theirs, ours), lacks(ours, theirs)) {
                    (false, false) => Standing::Same,
                    (true, false) => Standing::OursHasMore,
                    (false, true) => Standing::TheirsHasMore,
                    (true, true) => Standing::Conflict("each lacks scenarios of the other".into()),
                }
            }
            _ => Standing::AsThePlan,
        }
    }
}

/// The existing files of one corpus, with their bytes.
#[derive(Default)]
pub(super) struct CorpusFiles {
    files: BTreeMap<&'static str, (Vec<u8>, CorpusFile)>,
}

impl CorpusFiles {
    /// Adds an existing file.
    pub(super) fn add(&mut self, name: &'static str, bytes: Vec<u8>) -> anyhow::Result<()> {
        let file = CorpusFile::parse(name, &bytes)?;
        self.files.insert(name, (bytes, file));
        Ok(())
    }

    pub(super) fn get(&self, name: &str) -> Option<&(Vec<u8>, CorpusFile)> {
        self.files.get(name)
    }

    /// Names and bytes, in the order of [`Corpus::FILES`].
    pub(super) fn contents(&self) -> impl Iterator<Item = (&'static str, &[u8])> {
        let names = Corpus::FILES.into_iter();
        names.filter_map(|name| Some((name, self.files.get(name)?.0.as_slice())))
    }

    /// Compares the file of this name with a remote one; the error describes the fault of the remote one.
    pub(super) fn standing(&self, name: &str, theirs: &[u8]) -> anyhow::Result<Standing> {
        let theirs = CorpusFile::parse(name, theirs)?;
        let ours = self.get(name);
        Ok(ours.map_or(Standing::TheirsHasMore, |(_, ours)| ours.standing(&theirs)))
    }

    /// Difference between a text and the sweep that the plan was made from, if the plan is present.
    pub(super) fn difference_from_sweep(&self, text: &[u8]) -> Option<String> {
        difference_from_sweep(self.plan()?, text)
    }

    /// True if another copy of this plan records the same sweep text.
    pub(super) fn has_sweep_of(&self, theirs: &[u8]) -> bool {
        let theirs = Plan::parse(theirs, Path::new(Corpus::PLAN)).ok();
        let ours = self.plan().map(|plan| &plan.sweep_blake3);
        theirs.is_some_and(|theirs| ours == Some(&theirs.sweep_blake3))
    }

    fn plan(&self) -> Option<&Plan> {
        match self.get(Corpus::PLAN) {
            Some((_, CorpusFile::Plan(plan))) => Some(plan),
            _ => None,
        }
    }

    fn sweep(&self) -> Option<&SweepHead> {
        match self.get(Corpus::SWEEP) {
            Some((_, CorpusFile::Sweep(sweep))) => Some(sweep),
            _ => None,
        }
    }

    /// Checks that the files belong to one corpus; the error names the file that does not, and the reason.
    pub(super) fn check_together(&self) -> Result<(), (&'static str, String)> {
        let Some(plan) = self.plan() else {
            return Ok(());
        };
        if let Some((_, CorpusFile::Splits(splits))) = self.get(Corpus::SPLITS) {
            for scenario in &plan.scenarios {
                let found = splits.scenarios.get(&scenario.id);
                let found = found.map(|assignment| assignment.trajectory.as_str());
                if found != Some(&scenario.trajectory) {
                    return Err((
                        Corpus::SPLITS,
                        format!(
                            "it has {} for scenario {}, which flies trajectory {} by plan.json",
                            found.map_or("nothing".into(), |found| format!("trajectory {found}")),
                            scenario.id,
                            scenario.trajectory
                        ),
                    ));
                }
            }
        }
        let Some(sweep) = self.sweep() else {
            return Ok(());
        };
        if sweep.corpus.name != plan.corpus || !is_seeded_by(plan, sweep.corpus.seed) {
            return Err((
                Corpus::SWEEP,
                format!(
                    "its corpus {:?} with seed {} is not the one that plan.json was made from, {:?}",
                    sweep.corpus.name, sweep.corpus.seed, plan.corpus
                ),
            ));
        }
        if let Some((bytes, _)) = self.get(Corpus::SWEEP)
            && let Some(difference) = difference_from_sweep(plan, bytes)
        {
            return Err((
                Corpus::SWEEP,
                format!("it is not the text that plan.json was made from: {difference}"),
            ));
        }
        Ok(())
    }

    /// A split regenerated from the plan, for a corpus that lost it; `None` without plan and sweep.
    pub(super) fn split_again(&self) -> Option<Result<Splits, Leak>> {
        let (plan, sweep) = (self.plan()?, self.sweep()?);
        Some(assign_sides(plan, &sweep.split, sweep.corpus.seed, None))
    }

    /// Names of the missing files.
    pub(super) fn missing(&self) -> impl Iterator<Item = &'static str> {
        let names = Corpus::FILES.into_iter();
        names.filter(|name| !self.files.contains_key(name))
    }
}

/// Fault of the sweep of a corpus, alone or in combination with the plan; other files are checked elsewhere.
pub(super) fn sweep_fault(corpus: &Corpus) -> Option<String> {
    let mut files = CorpusFiles::default();
    for name in [Corpus::PLAN, Corpus::SWEEP] {
        let read = own_path(corpus.root(), name)
            .and_then(|path| outside_file::read(&path, FileKind::PLAN.unlinked()));
        let added = match read {
            Ok(bytes) => files.add(name, bytes),
            Err(error) if error.is_not_found() => Err(anyhow!("it is missing")),
            Err(error) => Err(error.into()),
        };
        match added {
            Ok(()) => {}
            Err(_) if name == Corpus::PLAN => return None,
            Err(fault) => return Some(format!("{fault:#}; {WRITE_AGAIN}")),
        }
    }
    let fault = files.check_together().err();
    fault.map(|(_, fault)| format!("{fault}; {WRITE_AGAIN}"))
}

/// Difference between a text and the sweep that a plan was made from, found by its hash in the plan or, for plans of earlier versions, by
/// its expansion. `None` if they are the same, or if it has no hash and names recordings, which are not here.
pub(super) fn difference_from_sweep(plan: &Plan, text: &[u8]) -> Option<String> {
    if let Some(is_same) = plan.is_of_sweep(text) {
        return (!is_same).then(|| "its hash differs from sweep_blake3 there".into());
    }
    let head = match CorpusFile::parse(Corpus::SWEEP, text) {
        Ok(CorpusFile::Sweep(head)) => head,
        Ok(_) => return None,
        Err(fault) => return Some(fault.to_string()),
    };
    if !head.recorded.is_empty() {
        return None;
    }
    let text = String::from_utf8_lossy(text).into_owned();
    // It names no files, so its folder does not matter.
    match Sweep::parse(Path::new(Corpus::SWEEP), Path::new(""), text) {
        Ok(sweep) => difference_from_expansion(plan, &expand(&sweep)),
        Err(error) => Some(error.message),
    }
}

fn difference_from_expansion(plan: &Plan, expanded: &Plan) -> Option<String> {
    if plan.plan_hash == expanded.plan_hash {
        return None;
    }
    let difference = Difference::between(plan, expanded);
    let added = difference.added.first();
    let added = added.map(|id| format!("scenario {id} is not in plan.json"));
    let conflict = difference.conflict().or(added);
    Some(conflict.unwrap_or_else(|| "it gives another order of scenarios".into()))
}

/// The files of the whole corpus in a store; or the name of one that is damaged, and the reason.
pub(super) async fn files_of(
    store: &CorpusStore,
) -> Result<Result<CorpusFiles, (&'static str, String)>, StoreError> {
    let mut files = CorpusFiles::default();
    for name in Corpus::FILES {
        if let Some(bytes) = store.read(name).await?
            && let Err(fault) = files.add(name, bytes)
        {
            return Ok(Err((name, format!("{fault:#}"))));
        }
    }
    Ok(Ok(files))
}

/// Advice for a sweep that is lost or was changed.
const WRITE_AGAIN: &str = "`dtd generate` with the sweep of the corpus writes it again";

/// The message about a regenerated split.
pub(super) const SPLIT_AGAIN: &str = "splits.json was lost and has been regenerated from plan and seed; if the corpus was ever added to, its \
                                      sides may not be those of before: train again before you evaluate";

#[cfg(test)]
mod tests {
    use super::*;

    const SPLIT: &str =
        r#"{"by": "trajectory", "scenarios": {"a": {"trajectory": "x", "side": "train"}}}"#;

    #[test]
    fn empty_and_damaged_files_are_told_from_sound_ones() {
        for name in Corpus::FILES {
            for damaged in ["", "  \n", "\0\0\0", "{", "[1"] {
                assert!(
                    CorpusFile::parse(name, damaged.as_bytes()).is_err(),
                    "{name}: {damaged:?}"
                );
            }
        }
        assert!(CorpusFile::parse("splits.json", SPLIT.as_bytes()).is_ok());
        let leak = SPLIT.replace("}}}", r#"}, "b": {"trajectory": "x", "side": "test"}}}"#);
        assert!(CorpusFile::parse("splits.json", leak.as_bytes()).is_err());
    }

    #[test]
    fn a_split_with_more_scenarios_wins_and_one_with_other_sides_contradicts() {
        let parse = |text: &str| CorpusFile::parse("splits.json", text.as_bytes()).unwrap();
        let ours = parse(SPLIT);
        let more = parse(&SPLIT.replace("}}}", r#"}, "b": {"trajectory": "y", "side": "test"}}}"#));
        let other = parse(&SPLIT.replace("train", "test"));
        assert!(matches!(ours.standing(&ours), Standing::Same));
        assert!(matches!(ours.standing(&more), Standing::TheirsHasMore));
        assert!(matches!(more.standing(&ours), Standing::OursHasMore));
        assert!(matches!(ours.standing(&other), Standing::Conflict(_)));
    }
}
