//! A tiny corpus with everything in it (five scenarios recorded by the stand-in, labels, detections, a trained and evaluated run), made
//! once, and copies of it for tests that race, damage or starve the command.
#![allow(dead_code, reason = "each test file uses a part of it")]

use std::ffi::OsStr;
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::LazyLock;
use std::thread;
use std::time::{Duration, Instant};

use dataset::corpus::ScenarioFolder;
use dataset::corpus::seal::seal_folder;
use dataset::tables::frames::Frames;
use testkit::command::{Dtd, Ending};
use testkit::files::copy_folder;
use testkit::sweep::{FROM_2_NM, SmallSweep};
use testkit::{MadeOnce, TINY_TRAINING, onnx_runtime};

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));

/// Five live approaches from 2 NM, six images per view.
fn sweep_toml() -> String {
    SmallSweep {
        name: "tiny",
        seed: 5,
        weathers: &["clear"],
        repeats: 5,
        size_px: (480, 320),
        frame_rate: "1/8",
        tables: &format!(
            "{FROM_2_NM}{}",
            r#"
[split]
train = 0.6
validation = 0.2
test = 0.2

[weather.clear]
visibility_m = 80000
"#
        ),
    }
    .toml()
}

/// Longer than any verb takes here.
pub(crate) const TOO_LONG: Duration = Duration::from_secs(300);

/// Number of scenarios that the sweep has.
pub(crate) const SCENARIOS: usize = 5;

/// A folder with `sweep.toml`, `training.toml`, `corpus/` and `run/`.
pub(crate) struct Tiny {
    root: PathBuf,
    /// Removes a copy.
    _copy: Option<tempfile::TempDir>,
}

static MADE: LazyLock<(MadeOnce, Tiny)> = LazyLock::new(|| {
    let made = MadeOnce::made("tiny", make);
    let tiny = Tiny::at(made.path());
    (made, tiny)
});

/// Minimal steps that create every file of a run.
fn write_training(folder: &Path) {
    let few = TINY_TRAINING.replace("steps = 60, batch_size = 64", "steps = 10, batch_size = 16");
    fs::write(folder.join("training.toml"), few).unwrap();
}

/// The paper's experiment with a quarter of the small scale's images.
pub(crate) const PAPER: &str =
    "paper --scale small --frame-rate 1/12 --config training.toml --out paper";

/// A folder with `training.toml` and what [`PAPER`] made in it. Never changed.
pub(crate) fn paper() -> &'static Path {
    static MADE: LazyLock<MadeOnce> = LazyLock::new(|| {
        MadeOnce::made("paper", |folder| {
            write_training(folder);
            let mut command = DTD.command(&PAPER.split(' ').collect::<Vec<_>>());
            command.current_dir(folder).succeeds();
        })
    });
    MADE.path()
}

fn make(folder: &Path) {
    fs::write(folder.join("sweep.toml"), sweep_toml()).unwrap();
    write_training(folder);
    let tiny = Tiny::at(folder);
    for line in [
        "generate sweep.toml --out corpus",
        "label corpus",
        "detect corpus --model {model}",
        "train corpus --out run --config training.toml",
        "evaluate run --corpus corpus",
        "verify corpus --complete",
    ] {
        tiny.line(line).succeeds();
    }
}

/// The bundled detector.
pub(crate) const MODEL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/models/aircraft.onnx");

impl Tiny {
    /// The original. Never changed.
    pub(crate) fn made() -> &'static Self {
        &MADE.1
    }

    fn at(folder: &Path) -> Self {
        Self {
            root: folder.to_owned(),
            _copy: None,
        }
    }

    /// A copy to be changed.
    pub(crate) fn copy(&self) -> Self {
        let folder = tempfile::tempdir().unwrap();
        copy_folder(self.root(), folder.path());
        Self {
            root: folder.path().to_owned(),
            _copy: Some(folder),
        }
    }

    pub(crate) fn root(&self) -> &Path {
        &self.root
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.root().join(name)
    }

    pub(crate) fn corpus(&self) -> PathBuf {
        self.path("corpus")
    }

    /// The scenarios' folders, sorted.
    pub(crate) fn scenarios(&self) -> Vec<PathBuf> {
        let mut found: Vec<_> = fs::read_dir(self.corpus().join("scenarios"))
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .collect();
        found.sort();
        found
    }

    /// URL of the object store beside the corpus.
    pub(crate) fn store(&self) -> String {
        format!("file://{}", self.path("store").display())
    }

    /// The words of a command line, with `{store}` for that URL, `{model}` for the bundled detector and `{scenario}` for the first one.
    pub(crate) fn arguments(&self, line: &str) -> Vec<String> {
        let fill = |word: &str| match word {
            "{store}" => self.store(),
            "{model}" => MODEL.into(),
            _ if word.contains("{scenario}") => {
                let first = &self.scenarios()[0];
                let id = first.file_name().unwrap().to_str().unwrap();
                word.replace("{scenario}", id)
            }
            _ => word.into(),
        };
        line.split_whitespace().map(fill).collect()
    }

    /// The command with the words of a line, as [`Tiny::arguments`] reads them.
    pub(crate) fn line(&self, line: &str) -> Command {
        self.dtd(&self.arguments(line))
    }

    /// Uploads the corpus and removes a scenario here, so that only the store has it.
    pub(crate) fn leave_to_store(&self, scenario: &Path) {
        self.line("push corpus {store}").succeeds();
        fs::remove_dir_all(scenario).unwrap();
    }

    /// The command, run within the folder without a scheduler's environment.
    pub(crate) fn dtd(&self, arguments: &[impl AsRef<OsStr>]) -> Command {
        let mut command = DTD.command(arguments);
        command
            .current_dir(self.root())
            .env("ORT_DYLIB_PATH", onnx_runtime());
        command
    }

    /// Runs the command with limited address space. The standard library cannot set a limit for a child, so a shell does.
    pub(crate) fn dtd_within(&self, memory_kib: u64, arguments: &[impl AsRef<OsStr>]) -> Command {
        let plain = self.dtd(arguments);
        let mut command = Command::new("bash");
        command
            .args(["-c", "ulimit -v \"$0\"; exec \"$@\""])
            .arg(memory_kib.to_string())
            .arg(plain.get_program())
            .args(plain.get_args())
            .current_dir(self.root());
        for (name, value) in plain.get_envs() {
            match value {
                Some(value) => command.env(name, value),
                None => command.env_remove(name),
            };
        }
        command
    }

    /// Every file below the folder, relative, sorted.
    pub(crate) fn files(&self) -> Vec<String> {
        fn walk(folder: &Path, root: &Path, found: &mut Vec<String>) {
            for entry in fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                if path.is_dir() && !path.is_symlink() {
                    walk(&path, root, found);
                } else {
                    found.push(
                        path.strip_prefix(root)
                            .unwrap()
                            .to_string_lossy()
                            .into_owned(),
                    );
                }
            }
        }
        let mut found = Vec::new();
        walk(self.root(), self.root(), &mut found);
        found.sort();
        found
    }
}

/// Gives scenarios labels that are off by less than any check's tolerance, so that `dtd label` has work.
pub(crate) fn label_otherwise<'a>(folders: impl IntoIterator<Item = &'a ScenarioFolder>) {
    for folder in folders {
        let mut frames = Frames::read(&folder.frames_path()).unwrap();
        for row in &mut frames.rows {
            row.labels.as_mut().unwrap().dtd_m += 1e-7;
        }
        frames.write(&folder.frames_path()).unwrap();
        let config_hash = folder.seal().unwrap().unwrap().config_hash;
        seal_folder(folder.root(), &config_hash).unwrap();
    }
}

/// Runs a command to its end; `None` if it times out and is killed.
pub(crate) fn run(command: &mut Command, patience: Duration) -> Option<Output> {
    let mut process = command
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let streams: [Box<dyn Read + Send>; 2] = [
        Box::new(process.stdout.take().unwrap()),
        Box::new(process.stderr.take().unwrap()),
    ];
    // Read continuously: a full pipe would stop the process.
    let [stdout, stderr] = streams.map(|mut stream| {
        thread::spawn(move || {
            let mut bytes = Vec::new();
            stream.read_to_end(&mut bytes).unwrap();
            bytes
        })
    });
    let began = Instant::now();
    let status = loop {
        if let Some(status) = process.try_wait().unwrap() {
            break status;
        }
        if began.elapsed() > patience {
            process.kill().unwrap();
            process.wait().unwrap();
            return None;
        }
        thread::sleep(Duration::from_millis(2));
    };
    Some(Output {
        status,
        stdout: stdout.join().unwrap(),
        stderr: stderr.join().unwrap(),
    })
}
