//! No verb writes among the files of others.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

use tempfile::{TempDir, tempdir};
use testkit::command::{Dtd, said, text};

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));

/// Every verb that writes to a place of the user's choice. `OUT` stands for that place.
const VERBS: [&[&str]; 20] = [
    &["generate", "demo.toml", "--out", "OUT"],
    &["generate", "demo.toml", "--out", "file://OUT"],
    &[
        "generate",
        "demo.toml",
        "--out",
        "s3://nowhere/corpus",
        "--staging",
        "OUT",
    ],
    &["fetch", "file:///nowhere", "--out", "OUT"],
    &["push", "CORPUS", "file://OUT"],
    &["train", "CORPUS", "--out", "OUT"],
    &["train", "CORPUS", "--search", "search.toml", "--out", "OUT"],
    &[
        "refit", "RUN", "--corpus", "CORPUS", "--view", "left", "--out", "OUT",
    ],
    &["evaluate", "RUN", "--corpus", "CORPUS", "--out", "OUT"],
    &[
        "evaluate",
        "--predictions",
        "mine.csv",
        "--corpus",
        "CORPUS",
        "--out",
        "OUT",
    ],
    &["predict", "RUN", "--corpus", "CORPUS", "--out", "OUT"],
    &["export", "CORPUS", "--to", "coco", "--out", "OUT"],
    &["export-estimators", "RUN", "--out", "OUT"],
    &["evaluate-detector", "CORPUS", "--out", "OUT"],
    &["train-detector", "CORPUS", "--out", "OUT"],
    &["tape", "--sim", "mock", "--out", "OUT"],
    &["examples", "OUT"],
    &["man", "OUT"],
    &["demo", "--out", "OUT"],
    &["paper", "--out", "OUT"],
];

/// A folder with what the verbs of others have made.
struct World {
    folder: TempDir,
}

impl World {
    fn new() -> Self {
        let folder = tempdir().unwrap();
        let world = Self { folder };
        for (name, content) in [
            ("corpus/plan.json", "{}"),
            ("corpus/claims/0001", ""),
            ("corpus/scenarios/0001/DONE.json", "{}"),
            ("corpus/scenarios/0001/MANIFEST.b3", ""),
            ("run/run.json", "{}"),
            ("run/config.json", "{}"),
            ("export/DONE.json", "{}"),
            ("export/MANIFEST.b3", ""),
            ("thesis.tex", "years of work"),
        ] {
            let path = world.path(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, content).unwrap();
        }
        symlink(
            world.path("corpus/scenarios/0001"),
            world.path("link-to-scenario"),
        )
        .unwrap();
        symlink(world.path("thesis.tex"), world.path("link-to-file")).unwrap();
        symlink(
            world.path("corpus/scenarios/new"),
            world.path("link-to-new"),
        )
        .unwrap();
        world
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Every path with what is there: the bytes of a file, the target of a link.
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

    /// Runs a verb of [`VERBS`]; it must be refused as bad input, with these words, and change nothing.
    fn refuse(&self, verb: &[&str], out: &Path, words: &str) {
        let fill = |argument: &&str| {
            argument
                .replace("OUT", text(out))
                .replace("CORPUS", text(&self.path("corpus")))
                .replace("RUN", text(&self.path("run")))
        };
        let arguments: Vec<String> = verb.iter().map(fill).collect();
        let before = self.state();
        let output = DTD.run(&arguments);
        let message = said(&output);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
        assert!(
            message.contains(words),
            "{arguments:?}: no {words:?} in {message}"
        );
        assert!(self.state() == before, "{arguments:?} changed something");
    }
}

#[test]
fn every_verb_refuses_the_places_of_others_and_changes_nothing() {
    let world = World::new();
    for verb in VERBS {
        for (place, words) in [
            ("link-to-scenario", ""),
            ("link-to-file", ""),
            ("link-to-new", ""),
            ("thesis.tex", "thesis.tex"),
            ("thesis.tex/inside", ""),
            ("corpus/scenarios/0001", ""),
            ("corpus/scenarios/0001/views/new", "is inside"),
            ("corpus/scenarios/new", "is inside"),
            ("corpus/scenarios/0001/../new", "is inside"),
            ("link-to-scenario/new", "is inside"),
            ("corpus/claims/new", "is inside"),
            ("corpus/failed/new", "is inside"),
            (
                "corpus/inner",
                "is a corpus and contains its own files only",
            ),
            ("run/inner", "is a run and contains its own files only"),
            ("export/inner", "is a sealed folder"),
        ] {
            world.refuse(verb, &world.path(place), words);
        }
    }
}

#[test]
fn a_new_file_in_a_folder_that_is_not_there_is_refused_before_the_work() {
    let world = World::new();
    for verb in VERBS {
        if ["predict", "tape"].contains(&verb[0]) {
            world.refuse(verb, &world.path("nowhere/file"), "which does not exist");
        }
    }
}

#[test]
fn a_run_a_corpus_and_an_export_are_continued_by_their_own_verbs_only() {
    let world = World::new();
    for verb in VERBS {
        let name = verb[0];
        let is_corpus = ["generate", "fetch", "push"].contains(&name);
        let is_run = ["train", "refit"].contains(&name);
        for (place, is_its_own) in [
            ("corpus", is_corpus),
            ("run", is_run),
            ("export", name == "export"),
        ] {
            if !is_its_own {
                world.refuse(verb, &world.path(place), "");
            }
        }
    }
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
