//! Trainings and evaluations that are killed at any moment, checked by the files left on disk.

use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use dataset::seal;
use tempfile::tempdir;
use testkit::command::{Dtd, said};
use testkit::synthetic::SyntheticCorpus;

const KILLS: u32 = 24;
/// What `kill` sends.
const SIGKILL: i32 = 9;
const SETTINGS: &str = "
[augmentation]
fill_up_to_samples = 500
[calibration]
hidden = [16]
features = 16
head_hidden = [16]
optimisation = { steps = 60, batch_size = 64, learning_rate = 0.003 }
[estimator]
lstm = [16]
head_hidden = [16]
optimisation = { steps = 60, batch_size = 64, learning_rate = 0.003 }
[mono]
optimisation = { steps = 60, batch_size = 64, learning_rate = 0.003 }
";

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));

struct Workshop {
    corpus: PathBuf,
    settings: PathBuf,
    run: PathBuf,
}

impl Workshop {
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
    SyntheticCorpus::tiny().write(&path("corpus")).unwrap();
    fs::write(path("train.toml"), SETTINGS).unwrap();
    let workshop = Workshop {
        corpus: path("corpus"),
        settings: path("train.toml"),
        run: path("run"),
    };
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
        assert!(!path("run.partial").exists(), "kill {kill}");
    }
    // Two of three are trainings, most of them killed before they would have ended, however the machine's speed changes meanwhile.
    assert!(struck >= KILLS / 4, "only {struck} of {KILLS} were killed");
    let output = workshop.train(&workshop.run, 1).output().unwrap();
    assert!(output.status.success(), "{}", said(&output));
    assert!(weights_and_settings(&workshop.run) == undisturbed[1]);
    assert!(!workshop.run.join("metrics.json").exists());
}
