//! Trainings and evaluations that are killed at any moment, checked by the files left on disk.

use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use dataset::corpus::seal;
use tempfile::tempdir;
use testkit::TINY_TRAINING;
use testkit::command::{Dtd, said};
use testkit::synthetic::SyntheticCorpus;

const KILLS: u32 = 24;
/// What `kill` sends.
const SIGKILL: i32 = 9;
const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));

struct Workshop {
    corpus: PathBuf,
    settings: PathBuf,
    run: PathBuf,
}

impl Workshop {
    fn new(root: &Path) -> Self {
        let made = Self {
            corpus: root.join("corpus"),
            settings: root.join("train.toml"),
            run: root.join("run"),
        };
        SyntheticCorpus::tiny().write(&made.corpus).unwrap();
        fs::write(&made.settings, TINY_TRAINING).unwrap();
        made
    }

    fn train(&self, run: &Path, seed: u32) -> Command {
        let mut command = DTD.command(&["train"]);
        command
            .arg(&self.corpus)
            .arg("--config")
            .arg(&self.settings)
            .args(["--seed", &seed.to_string(), "--out"])
            .arg(run);
        command
    }

    fn evaluate(&self) -> Command {
        let mut command = DTD.command(&["evaluate"]);
        command.arg(&self.run).arg("--corpus").arg(&self.corpus);
        command
    }
}

fn weights_and_settings(run: &Path) -> [Vec<u8>; 2] {
    ["weights.safetensors", "config.json"].map(|name| fs::read(run.join(name)).unwrap())
}

fn assert_whole(run: &Path) {
    assert_eq!(seal::faults(run).unwrap(), Vec::<String>::new());
}

#[test]
fn a_run_that_is_killed_at_any_moment_is_one_training_and_one_evaluation_or_none() {
    let folder = tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let workshop = Workshop::new(folder.path());
    let mut took = Duration::ZERO;
    let undisturbed = [0, 1].map(|seed| {
        let began = Instant::now();
        let run = path(&format!("seed-{seed}"));
        let output = workshop.train(&run, seed).output().unwrap();
        assert!(output.status.success(), "{}", said(&output));
        took = began.elapsed();
        weights_and_settings(&run)
    });
    assert!(undisturbed[0] != undisturbed[1]);
    let mut struck = 0;
    for kill in 0..KILLS {
        // A training, then an evaluation, then another training ... each killed slightly later than the last of its kind.
        let mut command = match kill % 3 {
            0 => workshop.train(&workshop.run, 0),
            1 => workshop.evaluate(),
            _ => workshop.train(&workshop.run, 1),
        };
        let part = f64::from(kill) / f64::from(KILLS);
        let mut process = command
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        sleep(took.mul_f64(1.2 * part));
        let _ = process.kill();
        let killed = process.wait().unwrap().signal() == Some(SIGKILL);
        struck += u32::from(killed);
        if workshop.run.exists() {
            assert_whole(&workshop.run);
        }
        let output = workshop.evaluate().output().unwrap();
        if !workshop.run.exists() {
            // No training has ended yet.
            assert_eq!(output.status.code(), Some(2), "{}", said(&output));
            continue;
        }
        assert!(output.status.success(), "kill {kill}: {}", said(&output));
        assert_whole(&workshop.run);
        let found = weights_and_settings(&workshop.run);
        assert!(undisturbed.contains(&found), "kill {kill}: a mixture");
        // Checkpoints stay for a training that goes on.
        let left = fs::read_dir(path("run.partial")).into_iter().flatten();
        let left: Vec<_> = left.map(|entry| entry.unwrap().file_name()).collect();
        assert!(
            left.iter().all(|name| name == "training"),
            "kill {kill}: {left:?}"
        );
    }
    // Two of three are trainings, most of them killed before they would have ended, however the machine's speed changes meanwhile.
    assert!(struck >= KILLS / 4, "only {struck} of {KILLS} were killed");
    let output = workshop.train(&workshop.run, 1).output().unwrap();
    assert!(output.status.success(), "{}", said(&output));
    assert!(weights_and_settings(&workshop.run) == undisturbed[1]);
    assert!(!workshop.run.join("metrics.json").exists());
}

#[test]
fn a_training_that_is_killed_again_and_again_goes_on_to_the_same_weights() {
    let folder = tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let workshop = Workshop::new(folder.path());
    let began = Instant::now();
    let output = workshop.train(&path("straight"), 0).output().unwrap();
    assert!(output.status.success(), "{}", said(&output));
    let took = began.elapsed();
    let mut resumed = 0;
    // A machine that gets busier takes longer than the first training did.
    for kill in 1..=40 {
        let mut process = workshop
            .train(&workshop.run, 0)
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        sleep(took.mul_f64(f64::from(kill) / 10.0));
        let _ = process.kill();
        let output = process.wait_with_output().unwrap();
        resumed += u32::from(said(&output).contains("train: resuming at "));
        if output.status.success() {
            break;
        }
        assert!(!workshop.run.exists(), "kill {kill}");
    }
    assert!(resumed > 0, "no checkpoint was left");
    let output = workshop.train(&workshop.run, 0).output().unwrap();
    assert!(output.status.success(), "{}", said(&output));
    let [found, expected] = [&workshop.run, &path("straight")].map(|run| weights_and_settings(run));
    assert!(found == expected);
    assert!(!path("run.partial").exists());
}

#[test]
fn the_settings_that_a_run_saved_make_the_same_run_again() {
    let folder = tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    Workshop::new(folder.path());
    let train = |settings: PathBuf, out: &str| {
        let mut command = DTD.command(&["train"]);
        command.arg(path("corpus")).arg("--config").arg(settings);
        let output = command.arg("--out").arg(path(out)).output().unwrap();
        assert!(output.status.success(), "{}", said(&output));
        weights_and_settings(&path(out))
    };
    let first = train(path("train.toml"), "first");
    assert!(train(path("first/config.json"), "again") == first);
}
