//! No verb writes among the files of others: their places are wrong values of every option that clap lists and that names an output.

use std::fs;
use std::os::unix::fs::symlink;
use std::path::PathBuf;

use clap::builder::ValueParser;
use clap::{Arg, Command, CommandFactory};
use tempfile::{TempDir, tempdir};

use crate::args::Args;

/// Arguments that take any path, because they name an input, or any text. Add one to this list only if nothing is written there.
/// `install-plugin` writes only into a folder that it knows as an X-Plane.
const INPUTS: [&str; 40] = [
    "airport",
    "airports",
    "against",
    "config",
    "corpora",
    "corpus",
    "detections",
    "estimator",
    "faults",
    "files",
    "from",
    "insecure_tls",
    "leave_out",
    "library",
    "model",
    "offsets",
    "only",
    "password_files",
    "plugin",
    "predictions",
    "pretrained_detector",
    "quirks",
    "recording",
    "registration_of",
    "restart_simulator",
    "run",
    "runs",
    "runway",
    "search",
    "sim",
    "start_from",
    "sweep",
    "tape",
    "tracks",
    "view",
    "views",
    "without",
    "aircraft show types",
    "fetch url",
    "install-plugin folder",
];

/// An argument that names an output: its verb and its name, and its parser.
struct OutputArgument {
    name: String,
    parser: ValueParser,
}

impl OutputArgument {
    /// Parses a place, as a URL where only these are taken.
    fn parse(&self, place: &str) -> Result<(), clap::Error> {
        let parse = |value: &str| {
            let value_of = Arg::new("value").value_parser(self.parser.clone());
            let command = Command::new("dtd").arg(value_of);
            command.try_get_matches_from(["dtd", value]).map(|_| ())
        };
        parse(place).or_else(|refused| {
            let is_url = refused.to_string().contains("begin with a scheme");
            if is_url {
                parse(&format!("file://{place}"))
            } else {
                Err(refused)
            }
        })
    }
}

/// The arguments of all verbs that accept this new place and are no inputs.
fn outputs(new: &str) -> Vec<OutputArgument> {
    fn add(command: &Command, of: &str, all: &mut Vec<OutputArgument>) {
        for argument in command.get_arguments() {
            let id = argument.get_id().as_str();
            let name = format!("{of}{id}");
            let is_input = INPUTS.contains(&id) || INPUTS.contains(&name.as_str());
            if argument.get_action().takes_values() && !is_input {
                let parser = argument.get_value_parser().clone();
                all.push(OutputArgument { name, parser });
            }
        }
        for verb in command.get_subcommands() {
            add(verb, &format!("{of}{} ", verb.get_name()), all);
        }
    }
    let mut all = Vec::new();
    add(&Args::command(), "", &mut all);
    all.retain(|argument| argument.parse(new).is_ok());
    all
}

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

    fn outputs(&self) -> Vec<OutputArgument> {
        // `predict` takes only such a name.
        outputs(self.path("new.parquet").to_str().unwrap())
    }

    /// Asserts that an argument rejects this place with these words.
    fn refuse(&self, argument: &OutputArgument, place: &str, words: &str) {
        let path = self.path(place).display().to_string();
        let name = &argument.name;
        let Err(error) = argument.parse(&path) else {
            panic!(
                "{name} accepts {place}; an input belongs into INPUTS, an output needs a parser of `Output`"
            );
        };
        let message = error.to_string();
        assert_eq!(error.exit_code(), 2, "{name}: {message}");
        assert!(
            message.contains(&path) && message.contains(words),
            "{name}: no {words:?} about {place} in {message}"
        );
    }
}

#[test]
fn every_output_refuses_the_places_of_others() {
    let world = World::new();
    let outputs = world.outputs();
    for known in [
        "tracks import out",
        "estimate keep_offsets",
        "push url",
        "predict out",
    ] {
        assert!(outputs.iter().any(|output| output.name == known), "{known}");
    }
    for output in outputs {
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
            // Here the verb looks whether it is its own earlier file (tests/outputs.rs, tests/estimate/clocks.rs).
            let is_checked_later = ["train-detector out", "estimate keep_offsets"];
            if place != "thesis.tex" || !is_checked_later.contains(&output.name.as_str()) {
                world.refuse(&output, place, words);
            }
        }
    }
}

#[test]
fn a_new_file_in_a_folder_that_is_not_there_is_refused() {
    let world = World::new();
    for output in world.outputs() {
        if ["predict out", "tape out"].contains(&output.name.as_str()) {
            world.refuse(&output, "nowhere/file", "which does not exist");
        }
    }
}

#[test]
fn a_run_a_corpus_and_an_export_are_continued_by_their_own_verbs_only() {
    let world = World::new();
    for output in world.outputs() {
        let verb = output.name.split(' ').next().unwrap_or_default();
        // `import` removes what a killed import left beside its corpus, and refuses the corpus by itself.
        let is_corpus = ["generate", "fetch", "push", "import"].contains(&verb);
        let is_run = ["train", "refit"].contains(&verb);
        for (place, is_its_own) in [
            ("corpus", is_corpus),
            ("run", is_run),
            ("export", verb == "export"),
        ] {
            if !is_its_own {
                world.refuse(&output, place, "");
            }
        }
    }
}
