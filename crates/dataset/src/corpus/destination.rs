//! Places where a corpus may be written: a corpus, or a folder without files of other programs.
//!
//! A corpus shows by its content, a plan or a sealed scenario: other programs have folders and files with the same names.

use std::fs;
use std::path::Path;

use serde::Deserialize;
use serde::de::IgnoredAny;

use crate::corpus::claim::CLAIMS;
use crate::corpus::splits::Splits;
use crate::corpus::{Corpus, seal};
use crate::error::{Error, Result};
use crate::files::corpus_names::SCENARIOS;
use crate::files::new_file::TEMPORARY_SUFFIX;
use crate::files::outside_file::{self, FileKind};

/// The staging mark, and the folder that a new disk comes with.
const HARMLESS: [&str; 2] = ["stage.json", "lost+found"];
/// Maximum number of foreign entries that a message names.
const MAX_SHOWN: usize = 3;
/// The corpus folders that are reserved for scenarios, claims and failure reports.
const OWN_FOLDERS: [&str; 3] = [SCENARIOS, CLAIMS, "failed"];

/// The reserved corpus folder that contains this path, if any: only the corpus' own files may be written there.
pub fn own_folder_around(path: &Path) -> Option<&Path> {
    path.ancestors().find(|folder| {
        let name = folder.file_name().and_then(|name| name.to_str());
        let corpus = folder.parent().unwrap_or(folder);
        name.is_some_and(|name| OWN_FOLDERS.contains(&name))
            && (Corpus::is_at(corpus) || has_sealed_scenario(corpus))
    })
}

/// Rejects a path that cannot hold a corpus, before anything is done: FFmpeg accepts only UTF-8 paths, and so do most tools that read a
/// corpus.
pub(crate) fn check_path(root: &Path) -> Result<()> {
    match root.to_str() {
        Some(_) => Ok(()),
        None => Err(Error::corpus(
            root,
            "is not a UTF-8 path, which FFmpeg requires; rename the folder",
        )),
    }
}

/// Rejects a folder that contains anything but a corpus: the corpus would mix with other files or replace them. Remains of interrupted
/// start are part of a corpus; hidden files and a new disk's `lost+found` are ignored.
pub fn check_place(root: &Path) -> Result<()> {
    check_path(root)?;
    if has_plan(root)? || has_sealed_scenario(root) {
        return Ok(());
    }
    // A missing or unreadable folder is reported where it is made or read.
    let Ok(entries) = fs::read_dir(root) else {
        return Ok(());
    };
    let names = entries.flatten().map(|entry| entry.file_name());
    let names = names.map(|name| name.to_string_lossy().into_owned());
    match foreign_entries(names.filter(|name| !is_of_interrupted_start(root, name))) {
        None => Ok(()),
        Some(found) => Err(Error::corpus(
            root,
            format!(
                "is not a corpus, and contains {found}; expected a corpus, an empty folder or a new name, such as {}",
                root.join("corpus").display()
            ),
        )),
    }
}

/// The entries that keep a corpus from being written to a place without plan and sealed scenarios, as text; `None` if there are none.
pub fn foreign_entries(names: impl Iterator<Item = String>) -> Option<String> {
    let mut foreign: Vec<String> = names.filter(|name| !is_harmless(name)).collect();
    if foreign.is_empty() {
        return None;
    }
    foreign.sort();
    let shown = foreign[..MAX_SHOWN.min(foreign.len())].join(", ");
    Some(match foreign.len().saturating_sub(MAX_SHOWN) {
        0 => shown,
        more => format!("{shown} and {more} more"),
    })
}

/// True if a corpus may begin beside this entry.
fn is_harmless(name: &str) -> bool {
    name.starts_with('.')
        || name.ends_with(TEMPORARY_SUFFIX)
        || OWN_FOLDERS.contains(&name)
        || HARMLESS.contains(&name)
}

/// True if the file may be left by a start that was interrupted before it wrote the plan. A sweep with a different name or text is judged
/// before it is replaced.
fn is_of_interrupted_start(root: &Path, name: &str) -> bool {
    let path = root.join(name);
    let is_empty = || fs::metadata(&path).is_ok_and(|found| found.is_file() && found.len() == 0);
    match name {
        Corpus::SWEEP => true,
        Corpus::SPLITS => is_empty() || Splits::read(&path).is_ok(),
        Corpus::PLAN => is_empty(),
        _ => false,
    }
}

/// Returns true for a corpus with a plan of any version.
fn has_plan(root: &Path) -> Result<bool> {
    match outside_file::read(&root.join(Corpus::PLAN), FileKind::PLAN) {
        Ok(text) => Ok(is_plan(&text)),
        Err(error) if error.is_of_disk() => Err(error),
        Err(_) => Ok(false),
    }
}

/// Returns true for a corpus with a sealed scenario, such as an imported one that has no plan.
fn has_sealed_scenario(root: &Path) -> bool {
    let entries = fs::read_dir(root.join(SCENARIOS));
    entries.is_ok_and(|entries| entries.flatten().any(|entry| seal::is_at(&entry.path())))
}

/// True if the text is a plan of any version, whether or not its values are valid.
pub fn is_plan(text: &[u8]) -> bool {
    #[derive(Deserialize)]
    struct AnyPlan {
        #[serde(rename = "plan_hash")]
        _plan_hash: String,
        #[serde(rename = "scenarios")]
        _scenarios: Vec<IgnoredAny>,
    }
    serde_json::from_slice::<AnyPlan>(text).is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAN: &str = r#"{"plan_hash": "0", "scenarios": []}"#;

    fn refusal(root: &Path) -> String {
        check_place(root).unwrap_err().to_string()
    }

    #[test]
    fn a_corpus_begins_in_a_vacant_folder_and_never_among_the_files_of_others() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path();
        check_place(&root.join("new")).unwrap();
        check_place(root).unwrap();
        for own in [".DS_Store", "corpus.toml", "splits.json", "stage.json"] {
            fs::write(root.join(own), "").unwrap();
        }
        fs::create_dir(root.join("claims")).unwrap();
        check_place(root).unwrap();
        for other in ["thesis.tex", "a.csv", "notes", "z"] {
            fs::write(root.join(other), "").unwrap();
        }
        let message = refusal(root);
        assert!(
            message.contains("contains a.csv, notes, thesis.tex and 1 more"),
            "{message}"
        );
        // Whoever keeps notes in a corpus may.
        fs::write(root.join(Corpus::PLAN), PLAN).unwrap();
        check_place(root).unwrap();
    }

    #[test]
    fn folders_and_files_of_others_with_the_names_of_a_corpus_are_no_corpus() {
        for (name, text) in [
            (Corpus::PLAN, r#"{"planned_values": {}, "scenarios": []}"#),
            (Corpus::SPLITS, r#"{"train": [1, 2], "test": [3]}"#),
        ] {
            let folder = tempfile::tempdir().unwrap();
            let root = folder.path();
            fs::create_dir_all(root.join("scenarios/one")).unwrap();
            check_place(root).unwrap();
            fs::write(root.join(name), text).unwrap();
            let message = refusal(root);
            assert!(message.contains(&format!("contains {name}")), "{message}");
        }
    }
}
