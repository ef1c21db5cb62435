//! No verb follows or replaces what others put into a folder. Whole places of others are wrong arguments (src/args/shared/output/tests.rs).

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

use tempfile::{TempDir, tempdir};
use testkit::command::{Dtd, text};

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));

/// A folder with outputs of several verbs.
struct World {
    folder: TempDir,
}

impl World {
    fn new() -> Self {
        let folder = tempdir().unwrap();
        let world = Self { folder };
        for (name, content) in [
            ("corpus/plan.json", "{}"),
            ("corpus/scenarios/0001/DONE.json", "{}"),
            ("corpus/scenarios/0001/MANIFEST.b3", ""),
            ("run/run.json", "{}"),
            ("run/config.json", "{}"),
            ("thesis.tex", "years of work"),
        ] {
            let path = world.path(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, content).unwrap();
        }
        world
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Every path with its content: file bytes or link target.
    fn state(&self) -> BTreeMap<PathBuf, Vec<u8>> {
        let mut found = BTreeMap::new();
        let mut folders = vec![self.folder.path().to_owned()];
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                let kind = fs::symlink_metadata(&path).unwrap().file_type();
                let content = if kind.is_symlink() {
                    text(&fs::read_link(&path).unwrap()).into()
                } else if kind.is_dir() {
                    folders.push(path.clone());
                    Vec::new()
                } else {
                    fs::read(&path).unwrap()
                };
                found.insert(path, content);
            }
        }
        found
    }

    /// Runs a verb, where `OUT` stands for a place; it must be refused as bad input, with these words, and change nothing.
    fn refuse(&self, verb: &[&str], out: &Path, words: &str) {
        let fill = |argument: &&str| {
            argument
                .replace("OUT", text(out))
                .replace("CORPUS", text(&self.path("corpus")))
                .replace("RUN", text(&self.path("run")))
        };
        let arguments: Vec<String> = verb.iter().map(fill).collect();
        let before = self.state();
        DTD.ends_with(&arguments, 2, &[words]);
        assert!(self.state() == before, "{arguments:?} changed something");
    }
}

#[test]
fn a_trained_detector_replaces_no_file_of_others() {
    let world = World::new();
    let train = ["train-detector", "CORPUS", "--out", "OUT"];
    world.refuse(&train, &world.path("thesis.tex"), "thesis.tex");
}

#[test]
fn what_a_folder_contains_already_is_neither_followed_nor_replaced() {
    let world = World::new();
    let out = world.path("out");
    let target = world.path("elsewhere");
    fs::create_dir_all(&target).unwrap();
    let planted = |name: &str, to: &str| {
        let path = out.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        symlink(world.path(to), path).unwrap();
    };
    for (verb, name, to) in [
        (&["man", "OUT"][..], "dtd.1", "thesis.tex"),
        (&["man", "OUT"], "dtd-label.1", "new-file"),
        (&["examples", "OUT"], "scenarios.toml", "new-file"),
        (&["examples", "OUT"], "tests/data", "elsewhere"),
        (
            &["evaluate-detector", "CORPUS", "--out", "OUT"],
            "searched",
            "elsewhere",
        ),
        (
            &["evaluate-detector", "CORPUS", "--out", "OUT"],
            "searched/scaled",
            "elsewhere",
        ),
    ] {
        planted(name, to);
        world.refuse(verb, &out, "");
        fs::remove_dir_all(&out).unwrap();
    }
    for (verb, name) in [
        (&["man", "OUT"][..], "dtd.1"),
        (
            &["evaluate-detector", "CORPUS", "--out", "OUT"],
            "report.html",
        ),
        (&["evaluate-detector", "CORPUS", "--out", "OUT"], "searched"),
        (
            &["export-estimators", "RUN", "--out", "OUT"],
            "MODEL_CARD.md",
        ),
    ] {
        fs::create_dir_all(&out).unwrap();
        fs::write(out.join(name), "another's").unwrap();
        world.refuse(verb, &out, "");
        fs::remove_dir_all(&out).unwrap();
    }
}
