//! The folder of a demo, and which of its files the demo made and may therefore remove.
//!
//! A marker file, written before anything else, says that `corpus` and `run` are a demo's. Files that do not look like a demo's
//! belong to somebody else: they are never removed, and `--fresh` refuses to start next to them.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use dataset::corpus::claim::Claim;
use dataset::corpus::seal::{DONE, MANIFEST};
use dataset::corpus::workshop::{CLAIM, Workshop, lock, refuse_named};
use dataset::corpus::{Corpus, PARTIAL_SUFFIX, ScenarioFolder};
use dataset::files::json_file::{read_json, write_json};
use dataset::plan::PlannedScenarios;
use serde::{Deserialize, Serialize};
use trainer::RunFolder;

use crate::failure::Failure;

const MARKER: &str = "DEMO.json";
const CORPUS: &str = "corpus";
const RUN: &str = "run";

/// Content of the marker.
#[derive(Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Marker {
    made_by: String,
    owns: Vec<String>,
}

impl Marker {
    fn ours() -> Self {
        Self {
            made_by: "dtd demo".into(),
            owns: vec![CORPUS.into(), RUN.into()],
        }
    }
}

/// The folder of a demo, locked until this is dropped.
pub(super) struct OwnFolder {
    root: PathBuf,
    _claim: Claim,
}

impl OwnFolder {
    /// The folder, created and marked if it is new. With `fresh`, the results of an earlier demo are removed.
    pub(super) fn open(root: &Path, fresh: bool) -> Result<Self, Failure> {
        let claim = lock(root, root, Duration::ZERO).map_err(Failure::of_corpus)?;
        let folder = Self {
            root: root.to_owned(),
            _claim: claim.in_existing_folder(),
        };
        let marked = folder.is_marked();
        if !marked && fs::symlink_metadata(folder.marker()).is_ok() {
            return Err(Failure::bad_input_message(format!(
                "{} is not what `dtd demo` writes there; move it away, or give another --out",
                folder.marker().display()
            )));
        }
        if fresh {
            let found = folder.look(marked)?;
            folder.refuse(&found.of_others)?;
            folder.remove(&found)?;
        }
        // An existing folder without a marker is not ours to mark.
        if !marked && !folder.corpus().exists() && !folder.run().exists() {
            write_json(&folder.marker(), &Marker::ours()).map_err(Failure::bad_input)?;
        }
        Ok(folder)
    }

    /// Folder of the corpus.
    pub(super) fn corpus(&self) -> PathBuf {
        self.root.join(CORPUS)
    }

    /// Folder of the run.
    pub(super) fn run(&self) -> PathBuf {
        self.root.join(RUN)
    }

    fn marker(&self) -> PathBuf {
        self.root.join(MARKER)
    }

    fn is_marked(&self) -> bool {
        let marker = self.marker();
        let is_file = fs::symlink_metadata(&marker).is_ok_and(|found| found.is_file());
        is_file && read_json::<Marker>(&marker, "marker").is_ok_and(|found| found == Marker::ours())
    }

    fn refuse(&self, others: &[PathBuf]) -> Result<(), Failure> {
        let what = "--fresh removes only what a demo made, and nothing was removed:";
        let names = others.iter().map(|path| path.display().to_string());
        refuse_named(&self.root, what, names.collect()).map_err(Failure::of_corpus)
    }

    /// Sorts files into the demo's and others; in a folder without a marker, none is the demo's.
    fn look(&self, marked: bool) -> Result<Found, Failure> {
        let mut found = Found::default();
        let planned = self.planned();
        let mut folders = vec![PathBuf::new()];
        while let Some(folder) = folders.pop() {
            let path = self.root.join(&folder);
            for entry in fs::read_dir(&path).map_err(dataset::Error::io("list", &path))? {
                let entry = entry.map_err(dataset::Error::io("list", &path))?;
                let name = folder.join(entry.file_name());
                let kind = entry
                    .file_type()
                    .map_err(dataset::Error::io("look at", &path))?;
                let is_in_use = name == Path::new(CLAIM) || marked && name == Path::new(MARKER);
                if is_in_use {
                    continue;
                }
                if !marked || !is_own(&name, kind.is_dir(), kind.is_file(), &planned) {
                    found.of_others.push(name);
                } else if kind.is_dir() {
                    found.folders.push(name.clone());
                    folders.push(name);
                } else {
                    found.files.push(name);
                }
            }
        }
        found.of_others.sort();
        // A folder's contents come before the folder.
        found.folders.sort();
        found.folders.reverse();
        Ok(found)
    }

    /// Identifiers of the scenarios that the demo made or was about to make.
    fn planned(&self) -> BTreeSet<String> {
        let corpus = Corpus::open(&self.corpus());
        match corpus.and_then(|corpus| PlannedScenarios::read(&corpus)) {
            Ok(planned) => planned.ids().map(str::to_owned).collect(),
            Err(_) => BTreeSet::new(),
        }
    }

    /// Removes the files that were recognised as a demo's, and none that appeared since. The plan, which the recognition needs, goes last.
    fn remove(&self, found: &Found) -> Result<(), Failure> {
        let plan = Path::new(CORPUS).join(Corpus::PLAN);
        let is_late = |name: &Path| name == plan || name == Path::new(CORPUS);
        for late in [false, true] {
            let now = |name: &&PathBuf| is_late(name) == late;
            for name in found.files.iter().filter(now) {
                let path = self.root.join(name);
                fs::remove_file(&path).map_err(dataset::Error::io("remove", &path))?;
            }
            for name in found.folders.iter().filter(now) {
                let path = self.root.join(name);
                fs::remove_dir(&path).map_err(dataset::Error::io("remove", &path))?;
            }
        }
        Ok(())
    }
}

/// Contents of a demo's folder, relative to it.
#[derive(Debug, Default)]
struct Found {
    files: Vec<PathBuf>,
    folders: Vec<PathBuf>,
    of_others: Vec<PathBuf>,
}

/// True if a path, relative to a demo's folder, looks like a demo's output for these scenarios.
fn is_own(name: &Path, is_folder: bool, is_file: bool, planned: &BTreeSet<String>) -> bool {
    let parts: Option<Vec<&str>> = name.iter().map(|part| part.to_str()).collect();
    let Some(parts) = parts else {
        return false;
    };
    let beside = Workshop::beside(Path::new(RUN));
    let [place, inside @ ..] = parts.as_slice() else {
        return false;
    };
    match inside {
        [] if is_folder => [CORPUS, RUN].contains(place) || beside == Path::new(place),
        [] => is_file && without_temporary_ending(place) == MARKER,
        _ if *place == CORPUS => is_of_corpus(inside, is_folder, is_file, planned),
        [file] if *place == RUN => is_file && is_of_run(file),
        ["claim"] => is_file && *place != RUN,
        ["new" | "old" | "training"] => is_folder && *place != RUN,
        ["training", file] => {
            is_file && *place != RUN && without_temporary_ending(file) == RunFolder::CHECKPOINT
        }
        ["new" | "old", file] => is_file && *place != RUN && is_of_run(file),
        _ => false,
    }
}

fn is_of_run(file: &str) -> bool {
    RunFolder::FILES.contains(&without_temporary_ending(file))
}

fn is_of_corpus(
    inside: &[&str],
    is_folder: bool,
    is_file: bool,
    planned: &BTreeSet<String>,
) -> bool {
    let ends = |name: &str, endings: &[&str]| {
        let name = without_temporary_ending(name);
        endings.iter().any(|ending| name.ends_with(ending))
    };
    match inside {
        ["scenarios" | "claims" | "failed"] => is_folder,
        [name] => is_file && Corpus::FILES.contains(&without_temporary_ending(name)),
        ["claims", id] => is_file && planned.contains(*id),
        ["failed", name] => {
            let id = without_temporary_ending(name).strip_suffix(".json");
            is_file && id.is_some_and(|id| planned.contains(id))
        }
        ["scenarios", id, ..] if !planned.contains(id.trim_end_matches(PARTIAL_SUFFIX)) => false,
        ["scenarios", _] => is_folder,
        ["scenarios", _, "views" | "detections" | "registrations"] => is_folder,
        ["scenarios", _, "views", name] => is_file && ends(name, &[".mp4", ".mov"]),
        ["scenarios", _, "registrations", name] => is_file && ends(name, &[".parquet"]),
        ["scenarios", _, "detections", name] => is_file && ends(name, &[".parquet", ".json"]),
        ["scenarios", _, name] => {
            let name = without_temporary_ending(name);
            is_file && (ScenarioFolder::FILES.contains(&name) || [MANIFEST, DONE].contains(&name))
        }
        _ => false,
    }
}

/// The final name of a possibly temporary file: `.<name>.<digits>.tmp`, `<name>.tmp` or `<name>.new`.
fn without_temporary_ending(name: &str) -> &str {
    if let Some(written) = name.strip_prefix('.').and_then(|n| n.strip_suffix(".tmp")) {
        return written.rsplit_once('.').map_or(written, |(name, _)| name);
    }
    [".tmp", ".new"]
        .iter()
        .find_map(|ending| name.strip_suffix(ending))
        .unwrap_or(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_new_folder_is_marked_first_and_what_is_made_in_it_goes_with_fresh() {
        let place = tempfile::tempdir().unwrap();
        let place = place.path();
        let made = [
            "corpus/plan.json",
            "corpus/splits.json",
            "corpus/claims/1200-clear-r1",
            "corpus/scenarios/1200-clear-r1.partial/views/left.mp4",
            "corpus/scenarios/1200-clear-r1/views/left.mp4",
            "corpus/scenarios/1200-clear-r1/detections/abc.json",
            "corpus/scenarios/1200-clear-r1/registrations/abc.parquet",
            "corpus/scenarios/1200-clear-r1/DONE.json.new",
            "run/weights.safetensors",
            "run.partial/new/config.json",
            "run.partial/training/checkpoint.json",
        ];
        let folder = OwnFolder::open(place, false).unwrap();
        assert!(folder.marker().is_file());
        for name in made {
            let path = place.join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(
                path,
                r#"{"scenarios": [{"id": "1200-clear-r1", "config_hash": "0"}]}"#,
            )
            .unwrap();
        }
        let second = OwnFolder::open(place, true);
        assert!(matches!(second, Err(Failure::TryAgain(_))), "one at a time");
        drop(folder);
        drop(OwnFolder::open(place, false).unwrap());
        assert!(place.join("run/weights.safetensors").exists());
        for strange in [
            "corpus/failed/notes.txt",
            "corpus/scenarios/mine/views/left.mp4",
            "corpus/scenarios/1200-clear-r1.partial/thesis.docx",
            "run.partial/new/photos/a.jpg",
        ] {
            let path = place.join(strange);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(&path, "").unwrap();
            let refused = OwnFolder::open(place, true);
            assert!(matches!(refused, Err(Failure::BadInput(_))), "{strange}");
            assert!(path.exists() && place.join("run/weights.safetensors").exists());
            fs::remove_file(&path).unwrap();
            // Our own folders may be empty.
            let _ = fs::remove_dir(path.parent().unwrap());
            let _ = fs::remove_dir(path.parent().unwrap().parent().unwrap());
        }
        drop(OwnFolder::open(place, true).unwrap());
        let left: Vec<_> = fs::read_dir(place).unwrap().collect();
        assert_eq!(left.len(), 1, "only the marker: {left:?}");
    }

    #[test]
    fn a_file_of_the_markers_name_that_no_demo_wrote_stays() {
        let place = tempfile::tempdir().unwrap();
        let marker = place.path().join(MARKER);
        fs::write(&marker, r#"{"precious": 1}"#).unwrap();
        let refused = OwnFolder::open(place.path(), false);
        assert!(matches!(refused, Err(Failure::BadInput(_))));
        assert_eq!(fs::read_to_string(&marker).unwrap(), r#"{"precious": 1}"#);
    }
}
