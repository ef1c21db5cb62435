//! No verb writes among the files of others: their places are wrong arguments of every verb.

use std::fs;
use std::os::unix::fs::symlink;
use std::path::PathBuf;

use clap::Parser;
use tempfile::{TempDir, tempdir};

use crate::args::Args;

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

    /// Asserts that the verb, one of [`VERBS`], rejects this place with these words.
    fn refuse(&self, verb: &[&str], place: &str, words: &str) {
        let path = |name: &str| self.path(name).display().to_string();
        let fill = |argument: &&str| {
            argument
                .replace("OUT", &path(place))
                .replace("CORPUS", &path("corpus"))
                .replace("RUN", &path("run"))
        };
        let arguments = ["dtd".to_owned()].into_iter().chain(verb.iter().map(fill));
        let error = Args::try_parse_from(arguments).expect_err(place);
        let message = error.to_string();
        assert_eq!(error.exit_code(), 2, "{verb:?}: {message}");
        assert!(
            message.contains(&path(place)) && message.contains(words),
            "{verb:?}: no {words:?} about {place} in {message}"
        );
    }
}

#[test]
fn every_verb_refuses_the_places_of_others() {
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
            // Here the verb looks whether it is the file of an earlier training (tests/outputs.rs).
            let is_checked_later = verb[0] == "train-detector" && place == "thesis.tex";
            if !is_checked_later {
                world.refuse(verb, place, words);
            }
        }
    }
}

#[test]
fn a_new_file_in_a_folder_that_is_not_there_is_refused() {
    let world = World::new();
    for verb in VERBS {
        if ["predict", "tape"].contains(&verb[0]) {
            world.refuse(verb, "nowhere/file", "which does not exist");
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
                world.refuse(verb, place, "");
            }
        }
    }
}
