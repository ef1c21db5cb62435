//! Files of the whole corpus, `plan.json`, `splits.json` and `corpus.toml`, in a folder and in a store.
//!
//! The three belong together. Sound files replace damaged ones and those with fewer scenarios; equal ones stay. If both copies contradict
//! each other, no file is transferred.

use std::collections::BTreeMap;
use std::fmt::Display;
use std::path::Path;

use dataset::corpus::Corpus;
use dataset::corpus::splits::{Leak, Splits};
use dataset::files::outside_file::{self, FileKind};
use dataset::files::own_path::own_path;
use dataset::plan::{Difference, Plan};
use object_store::ObjectMeta;

use crate::client::Connection;
use crate::error::{Result, StoreError};

/// Language of sweeps and `corpus.toml`, implemented by the generator.
pub trait SweepLanguage: Sync {
    /// Reason why a text is not a sweep, if it is none.
    fn fault(&self, sweep: &[u8]) -> Option<String>;

    /// Reason why sweep and plan are not from the same corpus, by name or seed.
    fn other_corpus(&self, sweep: &[u8], plan: &Plan) -> Option<String>;

    /// New split of the plan, as the sweep divides it; `None` if the text is not a sweep.
    fn split(&self, sweep: &[u8], plan: &Plan) -> Option<std::result::Result<Splits, Leak>>;
}

/// A file of the whole corpus that cannot be used; the message follows its name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{fault}")]
pub(crate) struct BadFile {
    /// The file.
    pub(crate) name: &'static str,
    /// The fault.
    pub(crate) fault: String,
}

impl BadFile {
    pub(crate) fn of(name: &'static str, fault: impl Display) -> Self {
        let fault = fault.to_string();
        Self { name, fault }
    }
}

/// Existing files by name.
pub(crate) type Contents = BTreeMap<&'static str, Vec<u8>>;

/// Sound files that belong together.
#[derive(Default)]
pub(crate) struct CorpusFiles {
    pub(crate) contents: Contents,
    plan: Option<Plan>,
    splits: Option<Splits>,
}

#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct Decision {
    pub(crate) write: Vec<&'static str>,
    /// Files that replace existing ones, with the reason.
    pub(crate) replaced: Vec<(&'static str, String)>,
    /// True if the destination has more scenarios than the source.
    pub(crate) has_more: bool,
    /// File of the destination that cannot be used, although its plan has more scenarios.
    pub(crate) left: Option<BadFile>,
}

impl CorpusFiles {
    /// Checks each file and that they belong together; the error names the file that does not.
    pub(crate) fn parse(
        contents: Contents,
        sweeps: &dyn SweepLanguage,
    ) -> std::result::Result<Self, BadFile> {
        let mut files = Self::default();
        for (&name, bytes) in &contents {
            let bad = |fault: &dyn Display| BadFile::of(name, fault);
            if bytes.iter().all(u8::is_ascii_whitespace) {
                return Err(bad(&"it is empty"));
            }
            match name {
                Corpus::PLAN => files.plan = Some(parse_plan(bytes)?),
                Corpus::SPLITS => {
                    let splits = Splits::parse(bytes, Path::new(name));
                    files.splits = Some(splits.map_err(|error| bad(&error))?);
                }
                _ => sweeps
                    .fault(bytes)
                    .map_or(Ok(()), |fault| Err(bad(&fault)))?,
            }
        }
        files.contents = contents;
        files.check_together(sweeps).map(|()| files)
    }

    fn check_together(&self, sweeps: &dyn SweepLanguage) -> std::result::Result<(), BadFile> {
        let Some(plan) = &self.plan else {
            return Ok(());
        };
        if let Some(splits) = &self.splits {
            for scenario in &plan.scenarios {
                let found = splits.scenarios.get(&scenario.id);
                let found = found.map(|assignment| assignment.trajectory.as_str());
                if found != Some(&scenario.trajectory) {
                    let found =
                        found.map_or("nothing".into(), |found| format!("trajectory {found}"));
                    return Err(BadFile::of(
                        Corpus::SPLITS,
                        format!(
                            "it has {found} for scenario {}, which flies trajectory {} by plan.json",
                            scenario.id, scenario.trajectory
                        ),
                    ));
                }
            }
        }
        let Some(sweep) = self.contents.get(Corpus::SWEEP) else {
            return Ok(());
        };
        let fault = sweeps.other_corpus(sweep, plan).or_else(|| {
            (!plan.is_of_sweep(sweep)).then(|| {
                "it is not the text that plan.json was made from: its hash differs from sweep_blake3 there"
                    .into()
            })
        });
        fault.map_or(Ok(()), |fault| Err(BadFile::of(Corpus::SWEEP, fault)))
    }

    pub(crate) fn read(corpus: &Corpus) -> dataset::Result<Contents> {
        let mut contents = Contents::new();
        for name in Corpus::FILES {
            let path = own_path(corpus.root(), name)?;
            if path.exists() {
                let kind = FileKind::PLAN.unlinked();
                contents.insert(name, outside_file::read(&path, kind)?);
            }
        }
        Ok(contents)
    }

    /// Split made again from the plan, for a corpus that lost it; `None` without plan and sweep.
    pub(crate) fn split_again(
        &self,
        sweeps: &dyn SweepLanguage,
    ) -> Option<std::result::Result<Splits, BadFile>> {
        let sweep = self.contents.get(Corpus::SWEEP)?;
        let split = sweeps.split(sweep, self.plan.as_ref()?)?;
        Some(split.map_err(|leak| BadFile::of(Corpus::SPLITS, leak)))
    }

    /// Decides which files to write to a destination; the error is a difference between copies that cannot be from the same corpus.
    pub(crate) fn decide(
        &self,
        there: &Contents,
        sweeps: &dyn SweepLanguage,
    ) -> std::result::Result<Decision, BadFile> {
        let parsed = Self::parse(there.clone(), sweeps);
        let their_plan = there
            .get(Corpus::PLAN)
            .and_then(|plan| parse_plan(plan).ok());
        let missing_here = |old: &Plan, new: &Plan| Difference::between(old, new).conflict();
        let (lacks, has_more) = match (&their_plan, &self.plan) {
            (Some(theirs), Some(ours)) => (missing_here(theirs, ours), missing_here(ours, theirs)),
            (Some(_), None) => (Some("there is no plan.json here".into()), None),
            (None, _) => (None, Some(String::new())),
        };
        if let (Some(difference), Some(_)) = (&lacks, &has_more) {
            let difference = difference.clone();
            return Err(BadFile::of(Corpus::PLAN, difference));
        }
        let splits = self
            .splits
            .iter()
            .zip(parsed.iter().filter_map(|it| it.splits.as_ref()));
        for (ours, theirs) in splits {
            let is_moved = |id: &&String| {
                let [one, other] = [ours, theirs].map(|splits| splits.scenarios.get(*id));
                one != other && other.is_some()
            };
            if let Some(id) = ours.scenarios.keys().find(is_moved) {
                let difference = format!("scenario {id} is on different sides");
                return Err(BadFile::of(Corpus::SPLITS, difference));
            }
        }
        let mut decision = Decision {
            has_more: lacks.is_some(),
            ..Decision::default()
        };
        if decision.has_more {
            decision.left = parsed.err();
            return Ok(decision);
        }
        for (&name, ours) in &self.contents {
            match there.get(name) {
                None => decision.write.push(name),
                Some(theirs) if theirs == ours => {}
                Some(_) => {
                    let reason = match &parsed {
                        Err(bad) if bad.name == name => format!("which was damaged: {bad}"),
                        Err(_) => "along with the other files".into(),
                        Ok(_) if has_more.is_some() => "which had less".into(),
                        Ok(_) => continue,
                    };
                    decision.write.push(name);
                    decision.replaced.push((name, reason));
                }
            }
        }
        // The plan first: the others depend on it.
        decision
            .write
            .sort_by_key(|name| Corpus::FILES.iter().position(|it| it == name));
        Ok(decision)
    }
}

fn parse_plan(bytes: &[u8]) -> std::result::Result<Plan, BadFile> {
    let bad = |fault: &dyn Display| BadFile::of(Corpus::PLAN, fault);
    let plan = Plan::parse(bytes, Path::new(Corpus::PLAN)).map_err(|error| bad(&error))?;
    plan.check_hashes().map_err(|error| bad(&error))?;
    Ok(plan)
}

/// Fault in the sweep, alone or beside the plan; `None` also if there is no valid plan.
pub fn sweep_fault(corpus: &Corpus, sweeps: &dyn SweepLanguage) -> Option<String> {
    let read = |name| {
        let path = own_path(corpus.root(), name)?;
        outside_file::read(&path, FileKind::PLAN.unlinked())
    };
    let plan = read(Corpus::PLAN).ok()?;
    parse_plan(&plan).ok()?;
    let sweep = match read(Corpus::SWEEP) {
        Ok(sweep) => sweep,
        Err(error) if error.is_not_found() => return Some("it is missing".into()),
        Err(error) => return Some(error.to_string()),
    };
    let contents = Contents::from([(Corpus::PLAN, plan), (Corpus::SWEEP, sweep)]);
    CorpusFiles::parse(contents, sweeps)
        .err()
        .map(|bad| bad.fault)
}

impl Connection<'_> {
    /// The store's files, with their versions.
    async fn corpus_files(&self) -> Result<(Contents, BTreeMap<&'static str, ObjectMeta>)> {
        let (mut contents, mut versions) = (Contents::new(), BTreeMap::new());
        for name in Corpus::FILES {
            if let Some((bytes, version)) = self.read_object(name).await? {
                contents.insert(name, bytes);
                versions.insert(name, version);
            }
        }
        Ok((contents, versions))
    }

    pub(crate) async fn corpus_contents(&self) -> Result<Contents> {
        Ok(self.corpus_files().await?.0)
    }

    /// Uploads sound files, each if the store's is still the one that was judged, until the store has them.
    ///
    /// # Errors
    /// The store has a different corpus.
    pub(crate) async fn settle(
        &self,
        ours: &CorpusFiles,
        sweeps: &dyn SweepLanguage,
    ) -> Result<Decision> {
        let mut retries = self.retries();
        let mut settled: Option<Decision> = None;
        loop {
            let (contents, versions) = self.corpus_files().await?;
            let decision = ours.decide(&contents, sweeps).map_err(|BadFile { name, fault }| {
                StoreError::unusable(format!(
                    "{}: the corpus was started from a different sweep or split, {name} differs: {fault}. A corpus can only be added to: \
                     push to another prefix",
                    self.store.name()
                ))
            })?;
            let Some(first) = decision.write.first() else {
                return Ok(settled.unwrap_or(decision));
            };
            if settled.is_some() {
                let error = self.store.not_kept(first);
                self.wait(&mut retries, error).await?;
            }
            for name in &decision.write {
                // The plan goes first: a process that loses a race notices there.
                if !self
                    .replace(name, &ours.contents[name], versions.get(name))
                    .await?
                {
                    break;
                }
            }
            settled.get_or_insert(decision);
        }
    }

    /// Uploads the stage's files.
    ///
    /// # Errors
    /// They are damaged, or the store has a different corpus.
    pub async fn publish(&self, stage: &Corpus, sweeps: &dyn SweepLanguage) -> Result<()> {
        let files = CorpusFiles::parse(CorpusFiles::read(stage)?, sweeps);
        let files = files.map_err(|bad| StoreError::Damaged {
            place: stage.root().join(bad.name).display().to_string(),
            message: bad.fault,
        })?;
        self.settle(&files, sweeps).await?;
        Ok(())
    }
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

        fn split(&self, _: &[u8], _: &Plan) -> Option<std::result::Result<Splits, Leak>> {
            None
        }
    }

    fn contents(name: &'static str, text: &str) -> Contents {
        Contents::from([(name, text.as_bytes().to_vec())])
    }

    fn decide(ours: &str, theirs: &Contents) -> std::result::Result<Decision, BadFile> {
        let ours = CorpusFiles::parse(contents(Corpus::SPLITS, ours), &Tables);
        ours.ok().unwrap().decide(theirs, &Tables)
    }

    #[test]
    fn empty_and_damaged_files_are_told_from_sound_ones_and_replaced() {
        for name in Corpus::FILES {
            for damaged in ["", "  \n", "\0\0\0", "{", "[1"] {
                let parsed = CorpusFiles::parse(contents(name, damaged), &Tables);
                assert!(parsed.is_err(), "{name}: {damaged:?}");
            }
        }
        let leak = SPLIT.replace("}}}", r#"}, "b": {"trajectory": "x", "side": "test"}}}"#);
        let decision = decide(SPLIT, &contents(Corpus::SPLITS, &leak)).unwrap();
        assert_eq!(decision.write, [Corpus::SPLITS]);
        assert!(decision.replaced[0].1.contains("damaged"));
        let same = decide(SPLIT, &contents(Corpus::SPLITS, SPLIT)).unwrap();
        assert_eq!(same, Decision::default());
    }

    #[test]
    fn a_split_with_other_sides_contradicts_and_a_missing_one_is_written() {
        let other = SPLIT.replace("train", "test");
        let conflict = decide(SPLIT, &contents(Corpus::SPLITS, &other)).unwrap_err();
        assert_eq!(conflict.name, Corpus::SPLITS);
        let decision = decide(SPLIT, &Contents::new()).unwrap();
        assert_eq!(
            (decision.write, decision.replaced),
            (vec![Corpus::SPLITS], vec![])
        );
    }
}
