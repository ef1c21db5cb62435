//! A run is complete or absent: existing files in its place, interruptions, and edited files.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, mpsc};
use std::thread;

mod hardly_trained;

use dataset::corpus::Corpus;
use dataset::corpus::seal;
use dataset::work::watch::{Silent, Watch};
use hardly_trained::tiny;
use tempfile::{TempDir, tempdir};
use trainer::{Error, EvaluationConfig, RunFolder, TrainConfig, evaluate, train};

/// The method with almost no training: a second.
fn config(seed: u64) -> TrainConfig {
    let mut config = TrainConfig {
        seed,
        ..TrainConfig::demo()
    };
    config.calibration.optimisation.steps = 20;
    config.estimator.optimisation.steps = 20;
    config.mono.optimisation.steps = 20;
    config
}

struct Workshop {
    folder: TempDir,
    corpus: Corpus,
}

impl Workshop {
    fn new() -> Self {
        let folder = tempdir().unwrap();
        let corpus = tiny(folder.path());
        Self { folder, corpus }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn train(&self, name: &str, seed: u64) -> Result<RunFolder, Error> {
        train(&self.corpus, &self.path(name), &config(seed), &Silent).map(|outcome| outcome.run)
    }

    fn evaluate(&self, name: &str) -> Result<(), Error> {
        let run = RunFolder::at(&self.path(name));
        evaluate(&run, &self.corpus, &EvaluationConfig::default(), &Silent).map(|_| ())
    }

    fn refusal(&self, name: &str) -> String {
        let error = self.train(name, 0).unwrap_err();
        assert!(
            matches!(error, Error::Run { .. } | Error::Dataset(_)),
            "{error}"
        );
        error.to_string()
    }
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for name in names(from) {
        fs::copy(from.join(&name), to.join(&name)).unwrap();
    }
}

/// Seals an edited run again.
fn seal_again(run: &Path) {
    let seal = seal::read_seal(run).unwrap().unwrap();
    seal::seal_folder(run, &seal.config_hash).unwrap();
}

/// Turns a run into one that was made to replace `replaced`.
fn made_to_replace(run: &Path, replaced: &Path) {
    let hash = seal::read_seal(replaced).unwrap().unwrap().manifest_blake3;
    fs::write(
        run.join("replaces.json"),
        format!("{{\"run\": \"{hash}\"}}"),
    )
    .unwrap();
    seal_again(run);
}

fn assert_whole(run: &Path) {
    assert_eq!(seal::faults(run).unwrap(), Vec::<String>::new());
}

#[test]
fn what_is_no_run_is_never_replaced_and_is_named_before_anything_is_computed() {
    let workshop = Workshop::new();
    fs::write(workshop.path("file"), "precious").unwrap();
    assert!(workshop.refusal("file").contains("expected a folder"));
    assert!(
        workshop
            .refusal("file/run")
            .contains("cannot be made there")
    );
    for (name, precious, words) in [
        ("mine", "thesis.tex", "holds thesis.tex"),
        ("tool", "config.json", "has no run.json"),
    ] {
        fs::create_dir(workshop.path(name)).unwrap();
        fs::write(workshop.path(name).join(precious), "precious").unwrap();
        let message = workshop.refusal(name);
        assert!(message.contains(words), "{message}");
        assert_eq!(names(&workshop.path(name)), [precious]);
    }
    fs::create_dir(workshop.path("taken.partial")).unwrap();
    fs::write(workshop.path("taken.partial/notes"), "precious").unwrap();
    assert!(workshop.refusal("taken").contains("holds notes"));
    std::os::unix::fs::symlink(workshop.path("mine"), workshop.path("link")).unwrap();
    assert!(workshop.refusal("link").contains("thesis.tex"));
    let left = names(workshop.folder.path());
    let expected = ["corpus", "file", "link", "mine", "taken.partial", "tool"];
    assert_eq!(left, expected, "nothing else was made, nothing is gone");
}

#[test]
fn a_run_is_not_made_where_a_corpus_keeps_what_is_its_own() {
    let workshop = Workshop::new();
    for name in [
        "corpus/scenarios/0009",
        "corpus/scenarios",
        "corpus/claims",
        "corpus/failed/run",
    ] {
        let message = workshop.refusal(name);
        assert!(
            message.contains("which is reserved for files of the corpus"),
            "{message}"
        );
    }
    assert!(!workshop.path("corpus/claims").exists() && !workshop.path("corpus/failed").exists());
    assert_eq!(workshop.corpus.scenarios().unwrap().len(), 7);
}

#[test]
fn what_somebody_put_beside_a_run_is_neither_removed_nor_taken_for_a_run() {
    let workshop = Workshop::new();
    let run = workshop.train("run", 0).unwrap();
    let other = workshop.train("other", 1).unwrap();
    let weights = fs::read(run.weights_path()).unwrap();
    let beside = workshop.path("run.partial");
    for folder in ["new", "old"] {
        fs::create_dir_all(beside.join(folder)).unwrap();
        fs::copy(
            other.root().join("DONE.json"),
            beside.join(folder).join("DONE.json"),
        )
        .unwrap();
        fs::write(beside.join(folder).join("photo.jpg"), "precious").unwrap();
        for message in [
            workshop.refusal("run"),
            workshop.evaluate("run").unwrap_err().to_string(),
        ] {
            assert!(message.contains("holds photo.jpg"), "{message}");
        }
        fs::remove_file(beside.join(folder).join("photo.jpg")).unwrap();
        // A seal alone is not a run.
        workshop.evaluate("run").unwrap();
        assert!(!beside.exists());
    }
    // A complete run that was not made to replace this one.
    copy(other.root(), &beside.join("new"));
    for message in [
        workshop.refusal("run"),
        workshop.evaluate("run").unwrap_err().to_string(),
    ] {
        assert!(message.contains("is not the run that"), "{message}");
    }
    assert_whole(&beside.join("new"));
    assert!(fs::read(run.weights_path()).unwrap() == weights);
    assert_whole(run.root());
}

#[test]
fn numbers_that_no_training_leaves_are_refused_by_file() {
    let workshop = Workshop::new();
    let run = workshop.train("run", 0).unwrap();
    let weights = fs::read(run.weights_path()).unwrap();
    for number in [f32::NAN, f32::INFINITY, 1e30] {
        let mut spoilt = weights.clone();
        let last = spoilt.len() - 4;
        spoilt[last..].copy_from_slice(&number.to_le_bytes());
        fs::write(run.weights_path(), spoilt).unwrap();
        seal_again(run.root());
        let message = workshop.evaluate("run").unwrap_err().to_string();
        assert!(
            message.contains("weights.safetensors: has the number"),
            "{message}"
        );
    }
    fs::write(run.weights_path(), weights).unwrap();
    for (field, name) in [
        ("offset_px", "normalisation.json"),
        ("scale_px", "normalisation.json"),
        ("constant_px", "baselines.json"),
    ] {
        let path = run.path(name);
        let text = fs::read_to_string(&path).unwrap();
        let at = text.find(field).unwrap();
        let digit = at + text[at..].find(|c: char| c.is_ascii_digit()).unwrap();
        let end = digit + text[digit..].find([',', '\n']).unwrap();
        let spoilt = format!("{}1e308{}", &text[..digit], &text[end..]);
        fs::write(&path, spoilt).unwrap();
        seal_again(run.root());
        let message = workshop.evaluate("run").unwrap_err().to_string();
        assert!(
            message.contains(name) && message.contains("1e308"),
            "{message}"
        );
        fs::write(&path, text).unwrap();
    }
    seal_again(run.root());
    workshop.evaluate("run").unwrap();
}

#[test]
fn a_run_of_another_version_is_refused_as_such_whatever_else_it_lacks() {
    let workshop = Workshop::new();
    let run = workshop.train("run", 0).unwrap();
    let path = run.root().join("run.json");
    for (summary, expected) in [
        (
            r#"{"format": 9, "dtd": "0.0.9"}"#,
            "format 9, written by dtd 0.0.9, and this version reads format 14; train again",
        ),
        (
            r#"{"format": 99, "dtd": "9.9.0"}"#,
            "format 99, written by dtd 9.9.0, and this version reads format 14; update dtd",
        ),
    ] {
        fs::write(&path, summary).unwrap();
        seal_again(run.root());
        let message = workshop.evaluate("run").unwrap_err().to_string();
        assert!(message.contains(expected), "{message}");
    }
}

#[test]
fn a_training_that_fails_leaves_the_run_that_was_there() {
    let workshop = Workshop::new();
    let run = workshop.train("run", 0).unwrap();
    workshop.evaluate("run").unwrap();
    let before: Vec<_> = names(run.root())
        .iter()
        .map(|name| fs::read(run.root().join(name)).unwrap())
        .collect();
    assert!(run.report_path().is_file());
    let splits = workshop.corpus.splits_path();
    let split = fs::read(&splits).unwrap();
    fs::write(&splits, "").unwrap();
    workshop.train("run", 1).unwrap_err();
    let after: Vec<_> = names(run.root())
        .iter()
        .map(|name| fs::read(run.root().join(name)).unwrap())
        .collect();
    assert!(before == after);
    assert_eq!(names(workshop.folder.path()), ["corpus", "run"]);
    // A training that succeeds removes them: its figures would not belong to the new weights.
    fs::write(&splits, split).unwrap();
    workshop.train("run", 1).unwrap();
    assert!(!run.metrics_path().exists() && !run.report_path().exists());
    assert_whole(run.root());
    workshop.evaluate("run").unwrap();
    assert_whole(run.root());
    assert_eq!(names(run.root()).len(), RunFolder::FILES.len());
    assert_eq!(names(workshop.folder.path()), ["corpus", "run"]);
}

#[test]
fn files_of_another_training_and_edited_ones_are_refused_by_name() {
    let workshop = Workshop::new();
    let run = workshop.train("run", 0).unwrap();
    let other = workshop.train("other", 1).unwrap();
    for name in [
        "config.json",
        "run.json",
        "normalisation.json",
        "baselines.json",
        "weights.safetensors",
        "backgrounds.png",
        "convergence.json",
    ] {
        let path = run.root().join(name);
        let whole = fs::read(&path).unwrap();
        let mut flipped = whole.clone();
        let middle = flipped.len() / 2;
        flipped[middle] ^= 1;
        let theirs = fs::read(other.root().join(name)).unwrap();
        for changed in [flipped, theirs, Vec::new()] {
            if changed == whole {
                continue;
            }
            fs::write(&path, changed).unwrap();
            let message = workshop.evaluate("run").unwrap_err().to_string();
            assert!(
                message.contains(name) && message.contains("not what the training wrote"),
                "{message}"
            );
        }
        fs::write(&path, whole).unwrap();
    }
    assert!(!run.metrics_path().exists());
    workshop.evaluate("run").unwrap();
    // An edited result does not count, and does no harm: it is regenerated.
    fs::write(run.report_path(), "my notes").unwrap();
    workshop.evaluate("run").unwrap();
    assert_whole(run.root());
    fs::remove_file(run.root().join("DONE.json")).unwrap();
    let message = workshop.evaluate("run").unwrap_err().to_string();
    assert!(message.contains("no DONE.json"), "{message}");
}

#[test]
fn wherever_a_kill_falls_the_next_start_finds_one_whole_run() {
    let workshop = Workshop::new();
    let first = workshop.train("first", 0).unwrap();
    let second = workshop.train("second", 1).unwrap();
    let half: &[&str] = &["config.json", "weights.safetensors"];
    // State of RUN, RUN.partial/new and RUN.partial/old after a kill, and which of the two runs must result.
    type Case<'a> = (
        &'a str,
        [Option<&'a RunFolder>; 3],
        Option<&'a [&'a str]>,
        &'a RunFolder,
    );
    let cases: [Case; 6] = [
        (
            "while training",
            [Some(&first), None, None],
            Some(half),
            &first,
        ),
        ("sealed", [Some(&first), Some(&second), None], None, &second),
        (
            "moved away",
            [None, Some(&second), Some(&first)],
            None,
            &second,
        ),
        (
            "in place",
            [Some(&second), None, Some(&first)],
            None,
            &second,
        ),
        (
            "nothing there before",
            [None, Some(&second), None],
            None,
            &second,
        ),
        ("new one lost", [None, None, Some(&first)], None, &first),
    ];
    for (what, [run, new, old], unsealed, expected) in cases {
        let name = what.replace(' ', "-");
        let root = workshop.path(&name);
        let beside = workshop.path(&format!("{name}.partial"));
        fs::create_dir(&beside).unwrap();
        fs::write(beside.join("claim"), "").unwrap();
        for (from, to) in [
            (run, root.clone()),
            (new, beside.join("new")),
            (old, beside.join("old")),
        ] {
            if let Some(from) = from {
                copy(from.root(), &to);
            }
        }
        if let (Some(_), Some(replaced)) = (new, run.or(old)) {
            made_to_replace(&beside.join("new"), replaced.root());
        }
        if let Some(files) = unsealed {
            fs::create_dir(beside.join("new")).unwrap();
            for file in files {
                fs::copy(second.root().join(file), beside.join("new").join(file)).unwrap();
            }
        }
        workshop
            .evaluate(&name)
            .unwrap_or_else(|error| panic!("{what}: {error}"));
        assert_whole(&root);
        for file in ["config.json", "weights.safetensors"] {
            let [found, expected] =
                [&root, expected.root()].map(|run| fs::read(run.join(file)).unwrap());
            assert!(found == expected, "{what}: {file}");
        }
        assert!(!beside.exists(), "{what}: {:?}", names(&beside));
    }
}

/// Signals when a training is running, and holds it there until it is released.
struct Gate {
    at_work: mpsc::Sender<()>,
    /// `None` once it is passed.
    go_on: Mutex<Option<mpsc::Receiver<()>>>,
}

impl Watch for Gate {
    fn begin(&self, _stage: &str, _total: u64) {
        if let Some(go_on) = self.go_on.lock().unwrap().take() {
            self.at_work.send(()).unwrap();
            go_on.recv().unwrap();
        }
    }
}

#[test]
fn two_who_work_on_one_run_exclude_each_other_and_neighbours_do_not() {
    let workshop = Workshop::new();
    workshop.train("run", 0).unwrap();
    let (at_work, is_at_work) = mpsc::channel();
    let (go_on, may_go_on) = mpsc::channel();
    thread::scope(|scope| {
        let first = scope.spawn(|| {
            let gate = Gate {
                at_work,
                go_on: Mutex::new(Some(may_go_on)),
            };
            train(&workshop.corpus, &workshop.path("run"), &config(1), &gate).unwrap();
        });
        is_at_work.recv().unwrap();
        for error in [
            workshop.train("run", 2).unwrap_err(),
            workshop.evaluate("run").unwrap_err(),
        ] {
            assert!(
                matches!(&error, Error::Dataset(error) if error.is_passing()),
                "{error}"
            );
        }
        workshop.train("neighbour", 2).unwrap();
        go_on.send(()).unwrap();
        first.join().unwrap();
    });
    let text = fs::read_to_string(workshop.path("run/config.json")).unwrap();
    assert!(text.contains("\"seed\": 1"), "{text}");
    assert_whole(&workshop.path("run"));
}
