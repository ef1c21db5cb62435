//! The files of the whole corpus, `plan.json`, `splits.json` and `corpus.toml`, in a folder or in a store: whether each is valid, whether
//! they belong together, and which of two versions stays.

use std::collections::BTreeMap;
use std::fmt::Display;
use std::path::Path;

use dataset::corpus::Corpus;
use dataset::corpus::splits::{Leak, Splits};
use dataset::files::outside_file::{self, FileKind};
use dataset::files::own_path::own_path;
use dataset::plan::{Difference, Plan};

use super::{FileDecision, SweepLanguage};
use crate::corpus_store::CorpusStore;
use crate::error::StoreError;

/// A file of the whole corpus that cannot be used; the message follows its name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{fault}")]
pub struct BadFile {
    /// The file.
    pub name: &'static str,
    /// The fault.
    pub fault: String,
    /// True if the file is valid, and not of the plan beside it.
    pub is_of_other_plan: bool,
}

impl BadFile {
    pub(super) fn damaged(name: &'static str, fault: impl Display) -> Self {
        Self {
            name,
            fault: fault.to_string(),
            is_of_other_plan: false,
        }
    }

    fn of_other_plan(name: &'static str, fault: String) -> Self {
        Self {
            name,
            fault,
            is_of_other_plan: true,
        }
    }
}

/// Reason why the file of the source replaces the one in the destination.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Replaced {
    /// It was damaged.
    Damaged(BadFile),
    /// The source has all of it, and more.
    HadLess,
    /// The plan beside it was replaced.
    WithPlan,
    /// It was not the sweep that the plan beside it was made from.
    NotOfPlan,
}

/// Relation between two versions of a file.
#[derive(Debug, PartialEq, Eq)]
enum Standing {
    /// They say the same.
    Same,
    /// The first one contains the second one, and more.
    HasMore,
    /// The second one contains the first one, and more.
    HasLess,
    /// They contradict each other.
    Conflict(String),
    /// The files themselves do not decide: the sweep follows the plan.
    AsThePlan,
}

/// A difference between two files that cannot be of copies of one corpus.
pub(super) struct Conflict(pub(super) String);

/// One of the files, read and valid.
enum CorpusFile {
    Plan(Box<Plan>),
    Splits(Splits),
    Sweep,
}

impl CorpusFile {
    fn parse(
        name: &'static str,
        bytes: &[u8],
        sweeps: &dyn SweepLanguage,
    ) -> Result<Self, BadFile> {
        let damaged = |fault: &dyn Display| BadFile::damaged(name, fault);
        if bytes.iter().all(u8::is_ascii_whitespace) {
            return Err(damaged(&"it is empty"));
        }
        match name {
            Corpus::PLAN => {
                let plan = Plan::parse(bytes, Path::new(name)).map_err(|e| damaged(&e))?;
                plan.check_hashes().map_err(|e| damaged(&e))?;
                Ok(Self::Plan(Box::new(plan)))
            }
            Corpus::SPLITS => {
                let splits = Splits::parse(bytes, Path::new(name)).map_err(|e| damaged(&e))?;
                Ok(Self::Splits(splits))
            }
            _ => match sweeps.fault(bytes) {
                None => Ok(Self::Sweep),
                Some(fault) => Err(damaged(&fault)),
            },
        }
    }

    /// Compares this version with another one of the same file.
    fn standing(&self, other: &Self) -> Standing {
        match (self, other) {
            (Self::Plan(one), Self::Plan(other)) => {
                let conflict = |plan, with| Difference::between(with, plan).conflict();
                match (conflict(one, other), conflict(other, one)) {
                    (None, None) => Standing::Same,
                    (None, Some(_)) => Standing::HasMore,
                    (Some(_), None) => Standing::HasLess,
                    (Some(difference), Some(_)) => Standing::Conflict(difference),
                }
            }
            (Self::Splits(one), Self::Splits(other)) => {
                let (one, other) = (&one.scenarios, &other.scenarios);
                let moved = one
                    .iter()
                    .find(|(id, side)| other.get(*id).is_some_and(|theirs| theirs != *side));
                if let Some((id, one)) = moved {
                    return Standing::Conflict(format!(
                        "scenario {id} is on the {:?} side in one and on another in the other",
                        one.side
                    ));
                }
                let has_all = |of: &BTreeMap<String, _>, in_: &BTreeMap<String, _>| {
                    of.keys().all(|id| in_.contains_key(id))
                };
                match (has_all(one, other), has_all(other, one)) {
                    (true, true) => Standing::Same,
                    (false, true) => Standing::HasMore,
                    (true, false) => Standing::HasLess,
                    (false, false) => {
                        Standing::Conflict("each lacks scenarios of the other".into())
                    }
                }
            }
            _ => Standing::AsThePlan,
        }
    }
}

/// The existing files of one copy of a corpus, each valid, with their bytes.
pub(super) struct CorpusFiles<'a> {
    sweeps: &'a dyn SweepLanguage,
    files: BTreeMap<&'static str, (Vec<u8>, CorpusFile)>,
}

impl<'a> CorpusFiles<'a> {
    pub(super) fn new(sweeps: &'a dyn SweepLanguage) -> Self {
        Self {
            sweeps,
            files: BTreeMap::new(),
        }
    }

    /// The files of a store, if they belong together.
    pub(super) async fn of_store(
        store: &CorpusStore,
        sweeps: &'a dyn SweepLanguage,
    ) -> Result<Result<Self, BadFile>, StoreError> {
        let mut files = Self::new(sweeps);
        for name in Corpus::FILES {
            if let Some(bytes) = store.read(name).await?
                && let Err(bad) = files.add(name, bytes)
            {
                return Ok(Err(bad));
            }
        }
        Ok(files.check_together().map(|()| files))
    }

    /// Adds an existing file.
    pub(super) fn add(&mut self, name: &'static str, bytes: Vec<u8>) -> Result<(), BadFile> {
        let file = CorpusFile::parse(name, &bytes, self.sweeps)?;
        self.files.insert(name, (bytes, file));
        Ok(())
    }

    /// Names and bytes, in the order of [`Corpus::FILES`].
    pub(super) fn contents(&self) -> impl Iterator<Item = (&'static str, &[u8])> {
        let names = Corpus::FILES.into_iter();
        names.filter_map(|name| Some((name, self.bytes(name)?)))
    }

    /// Names of the missing files.
    pub(super) fn missing(&self) -> Vec<&'static str> {
        let mut names = Corpus::FILES.to_vec();
        names.retain(|name| !self.files.contains_key(name));
        names
    }

    fn bytes(&self, name: &str) -> Option<&[u8]> {
        self.files.get(name).map(|(bytes, _)| bytes.as_slice())
    }

    pub(super) fn plan(&self) -> Option<&Plan> {
        match self.files.get(Corpus::PLAN) {
            Some((_, CorpusFile::Plan(plan))) => Some(plan),
            _ => None,
        }
    }

    /// Checks that the files belong to one corpus; the error names the file that does not.
    pub(super) fn check_together(&self) -> Result<(), BadFile> {
        let Some(plan) = self.plan() else {
            return Ok(());
        };
        if let Some((_, CorpusFile::Splits(splits))) = self.files.get(Corpus::SPLITS) {
            for scenario in &plan.scenarios {
                let found = splits.scenarios.get(&scenario.id);
                let found = found.map(|assignment| assignment.trajectory.as_str());
                if found != Some(&scenario.trajectory) {
                    return Err(BadFile::of_other_plan(
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
        let Some(sweep) = self.bytes(Corpus::SWEEP) else {
            return Ok(());
        };
        let fault = self.sweeps.other_corpus(sweep, plan).or_else(|| {
            (!plan.is_of_sweep(sweep)).then(|| {
                "it is not the text that plan.json was made from: its hash differs from \
                 sweep_blake3 there"
                    .into()
            })
        });
        match fault {
            None => Ok(()),
            Some(fault) => Err(BadFile::of_other_plan(Corpus::SWEEP, fault)),
        }
    }

    /// A split made again from the plan, for a corpus that lost it; `None` without plan and sweep.
    pub(super) fn split_again(&self) -> Option<Result<Splits, Leak>> {
        self.sweeps.split(self.bytes(Corpus::SWEEP)?, self.plan()?)
    }
}

/// Compares the files of a source with different ones in the destination, in the order of [`Corpus::FILES`].
pub(super) struct Judge<'a> {
    source: &'a CorpusFiles<'a>,
    /// The plan that the destination has, if it is valid.
    plan_there: Option<Plan>,
}

impl<'a> Judge<'a> {
    /// `plan_there`: the plan that the destination has unless another one is judged.
    pub(super) fn new(source: &'a CorpusFiles<'a>, plan_there: Option<Plan>) -> Self {
        Self { source, plan_there }
    }

    /// Decides which version of a file stays; `None` if the destination's stays and contains no more. `is_plan_replaced`: the plan of the
    /// destination was replaced, or was missing.
    pub(super) fn verdict(
        &mut self,
        name: &'static str,
        there: &[u8],
        is_plan_replaced: bool,
    ) -> Result<Option<FileDecision>, Conflict> {
        let parsed = CorpusFile::parse(name, there, self.source.sweeps);
        if name == Corpus::PLAN {
            self.plan_there = None;
        }
        let there_file = match parsed {
            Ok(file) => file,
            Err(bad) => return Ok(Some(FileDecision::Replaced(Replaced::Damaged(bad)))),
        };
        let ours = self.source.files.get(name);
        let standing = ours.map_or(Standing::HasLess, |(_, ours)| ours.standing(&there_file));
        if let CorpusFile::Plan(plan) = there_file {
            self.plan_there = Some(*plan);
        }
        let reason = match standing {
            Standing::Conflict(difference) => return Err(Conflict(difference)),
            Standing::HasLess => return Ok(Some(FileDecision::HasMore)),
            Standing::HasMore => Replaced::HadLess,
            Standing::AsThePlan if is_plan_replaced => Replaced::WithPlan,
            Standing::AsThePlan if self.is_of_other_plan(there) && self.has_sweep_of_plan() => {
                Replaced::NotOfPlan
            }
            Standing::Same | Standing::AsThePlan => return Ok(None),
        };
        Ok(Some(FileDecision::Replaced(reason)))
    }

    /// True if this is not the sweep of the plan in the destination.
    fn is_of_other_plan(&self, sweep: &[u8]) -> bool {
        let plan = self.plan_there.as_ref();
        plan.is_some_and(|plan| !plan.is_of_sweep(sweep))
    }

    fn has_sweep_of_plan(&self) -> bool {
        let sweep = self.source.bytes(Corpus::SWEEP);
        sweep.is_some_and(|sweep| !self.is_of_other_plan(sweep))
    }
}

/// Fault of the sweep of a corpus, alone or beside the plan; `None` also if there is no valid plan.
pub fn sweep_fault(corpus: &Corpus, sweeps: &dyn SweepLanguage) -> Option<String> {
    let mut files = CorpusFiles::new(sweeps);
    for name in [Corpus::PLAN, Corpus::SWEEP] {
        let read = own_path(corpus.root(), name)
            .and_then(|path| outside_file::read(&path, FileKind::PLAN.unlinked()));
        let added = match read {
            Ok(bytes) => files.add(name, bytes),
            Err(error) if error.is_not_found() => Err(BadFile::damaged(name, "it is missing")),
            Err(error) => Err(BadFile::damaged(name, error)),
        };
        match added {
            Ok(()) => {}
            Err(_) if name == Corpus::PLAN => return None,
            Err(bad) => return Some(bad.fault),
        }
    }
    files.check_together().err().map(|bad| bad.fault)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SPLIT: &str =
        r#"{"by": "trajectory", "scenarios": {"a": {"trajectory": "x", "side": "train"}}}"#;

    /// Sweeps are texts that begin with a table.
    struct Tables;

    impl SweepLanguage for Tables {
        fn fault(&self, sweep: &[u8]) -> Option<String> {
            (!sweep.starts_with(b"[corpus]")).then(|| "it has no corpus".into())
        }

        fn other_corpus(&self, _: &[u8], _: &Plan) -> Option<String> {
            None
        }

        fn split(&self, _: &[u8], _: &Plan) -> Option<Result<Splits, Leak>> {
            None
        }
    }

    fn parse(name: &'static str, text: &str) -> Result<CorpusFile, BadFile> {
        CorpusFile::parse(name, text.as_bytes(), &Tables)
    }

    #[test]
    fn empty_and_damaged_files_are_told_from_sound_ones() {
        for name in Corpus::FILES {
            for damaged in ["", "  \n", "\0\0\0", "{", "[1"] {
                assert!(parse(name, damaged).is_err(), "{name}: {damaged:?}");
            }
        }
        assert!(parse(Corpus::SPLITS, SPLIT).is_ok());
        let leak = SPLIT.replace("}}}", r#"}, "b": {"trajectory": "x", "side": "test"}}}"#);
        assert!(parse(Corpus::SPLITS, &leak).is_err());
    }

    #[test]
    fn a_split_with_more_scenarios_wins_and_one_with_other_sides_contradicts() {
        let parse = |text: &str| parse(Corpus::SPLITS, text).ok().unwrap();
        let ours = parse(SPLIT);
        let more = parse(&SPLIT.replace("}}}", r#"}, "b": {"trajectory": "y", "side": "test"}}}"#));
        let other = parse(&SPLIT.replace("train", "test"));
        assert_eq!(ours.standing(&ours), Standing::Same);
        assert_eq!(ours.standing(&more), Standing::HasLess);
        assert_eq!(more.standing(&ours), Standing::HasMore);
        assert!(matches!(ours.standing(&other), Standing::Conflict(_)));
    }
}
