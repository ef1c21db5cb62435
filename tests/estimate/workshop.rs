//! A corpus with detections and a tiny training run, shared by all tests.

use std::fs;
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{OnceLock, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};

use dataset::corpus::Corpus;
use serde_json::Value;
use testkit::TINY_TRAINING;
use testkit::command::{Dtd, Ending, text};
use testkit::sweep::{SmallSweep, starting_from};

pub(crate) const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));
pub(crate) const VIEWS: [&str; 2] = ["left", "right"];
/// Tests that share the machine, or one that needs it alone.
static MACHINE: RwLock<()> = RwLock::new(());

/// Five arrivals, seen as in `tests/data/live.toml`.
fn arrivals() -> String {
    let start = starting_from(4.2, 4.4, 400);
    let tables = [
        &*start,
        "[split]\ntrain = 0.6\nvalidation = 0.2\ntest = 0.2\n",
        "[weather.clear]\nvisibility_m = 80000\n",
    ];
    SmallSweep {
        name: "arrivals",
        seed: 12,
        weathers: &["clear"],
        repeats: 5,
        size_px: (960, 640),
        frame_rate: "1/4",
        tables: &tables.concat(),
    }
    .toml()
}

pub(crate) struct Workshop {
    pub(crate) folder: tempfile::TempDir,
}

/// The workshop, beside other tests or alone, until this is dropped.
pub(crate) struct Use<Lock> {
    workshop: &'static Workshop,
    _lock: Lock,
}

impl<Lock> Deref for Use<Lock> {
    type Target = Workshop;

    fn deref(&self) -> &Workshop {
        self.workshop
    }
}

impl Workshop {
    /// Beside other tests.
    pub(crate) fn shared() -> Use<RwLockReadGuard<'static, ()>> {
        let lock = MACHINE.read();
        Use {
            workshop: Self::made(),
            _lock: lock.unwrap_or_else(PoisonError::into_inner),
        }
    }

    /// For tests that measure time.
    pub(crate) fn alone() -> Use<RwLockWriteGuard<'static, ()>> {
        let lock = MACHINE.write();
        Use {
            workshop: Self::made(),
            _lock: lock.unwrap_or_else(PoisonError::into_inner),
        }
    }

    /// Made once per run of the tests.
    fn made() -> &'static Self {
        static SHARED: OnceLock<Workshop> = OnceLock::new();
        SHARED.get_or_init(|| {
            let folder = tempfile::tempdir().unwrap();
            let made = Self { folder };
            let corpus = made.corpus();
            let settings = made.folder.path().join("train.toml");
            fs::write(&settings, TINY_TRAINING).unwrap();
            let run = made.run();
            let sweep = made.folder.path().join("arrivals.toml");
            fs::write(&sweep, arrivals()).unwrap();
            done(&["generate", text(&sweep), "--out", text(&corpus)]);
            done(&["label", text(&corpus)]);
            done(&["detect", text(&corpus)]);
            let out = ["--out", text(&run), "--config", text(&settings)];
            done(&[&["train", text(&corpus)][..], &out].concat());
            made
        })
    }

    pub(crate) fn corpus(&self) -> PathBuf {
        self.folder.path().join("corpus")
    }

    pub(crate) fn run(&self) -> PathBuf {
        self.folder.path().join("run")
    }

    /// Videos from the end of an approach, five images per second. Recorded once.
    pub(crate) fn flight(&self) -> &'static [PathBuf; 2] {
        static FLIGHT: OnceLock<[PathBuf; 2]> = OnceLock::new();
        FLIGHT.get_or_init(|| {
            let corpus = self.folder.path().join("live");
            done(&["generate", "tests/data/live.toml", "--out", text(&corpus)]);
            videos(&corpus)
        })
    }

    /// Identifiers of the scenarios.
    pub(crate) fn scenarios(&self) -> Vec<String> {
        let corpus = Corpus::open(&self.corpus()).unwrap();
        let mut ids: Vec<String> = (corpus.scenarios().unwrap().iter())
            .map(|folder| folder.id())
            .collect();
        ids.sort();
        ids
    }

    /// The first scenario as a source.
    pub(crate) fn source(&self) -> String {
        format!("corpus:{}/{}", text(&self.corpus()), self.scenarios()[0])
    }

    pub(crate) fn command(&self, sources: [&str; 2]) -> Command {
        let mut command = DTD.command(&["estimate", text(&self.run())]);
        for (view, source) in VIEWS.iter().zip(sources) {
            command.args(["--view", &format!("{view}={source}")]);
        }
        command
    }

    pub(crate) fn lines(&self, sources: [&str; 2], more: &[&str]) -> Vec<Value> {
        let output = self.command(sources).args(more).succeeds();
        let lines = String::from_utf8(output.stdout).unwrap();
        let lines = lines.lines();
        lines
            .map(|line| serde_json::from_str(line).unwrap())
            .collect()
    }
}

fn done(arguments: &[&str]) {
    DTD.succeeds(arguments);
}

/// Videos of the first scenario.
pub(crate) fn videos(corpus: &Path) -> [PathBuf; 2] {
    let corpus = Corpus::open(corpus).unwrap();
    let scenarios = corpus.scenarios().unwrap();
    let first = scenarios.iter().min_by_key(|folder| folder.id()).unwrap();
    let scenario = first.open().unwrap();
    VIEWS.map(|view| scenario.video_path(view).unwrap())
}

pub(crate) fn ffmpeg(arguments: &[&str]) {
    Command::new("ffmpeg")
        .args(["-loglevel", "error", "-y"])
        .args(arguments)
        .succeeds();
}
