//! Training checkpoints: a killed run resumes where it stopped.
//!
//! A training is a sequence of stages, each a network that [`crate::networks::training_loop`] trains. `checkpoint.json` contains all begun
//! stages, with steps, weights, optimiser, position in the random numbers and log. It is replaced atomically, while the training runs and
//! after each stage.
//!
//! The result depends on the [`Origin`] alone. A training with the same origin continues from the checkpoint to the same numbers; with a
//! different origin it starts afresh, as it would replace a finished run.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use base64::prelude::{BASE64_STANDARD, Engine};
use burn::module::Module;
use burn::optim::ModuleOptimizer;
use burn::store::{ModuleRecord, RecordError};
use burn::tensor::Bytes;
use dataset::files::json_file::write_json;
use dataset::files::outside_file::{self, FileKind};
use dataset::work::watch::Watch;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::config::TrainConfig;
use crate::error::{Error, Result};
use crate::networks::stage::Cycle;
use crate::networks::training_loop::{Learned, Task};
use crate::samples::rig::json_differences::json_differences;

/// Limit: the weights of the largest networks, three times, in base 64.
const CHECKPOINT: FileKind = FileKind::new("checkpoint", 16 << 30).unlinked();
/// Divisor: saving takes at most a fiftieth of the time.
const SHARE_OF_TIME: u32 = 50;

/// Everything that determines the result.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(crate) struct Origin {
    /// Version of dtd.
    pub(crate) dtd: String,
    pub(crate) config: TrainConfig,
    /// BLAKE3 of the initial weights, unless they are random.
    pub(crate) start_blake3: Option<String>,
    /// BLAKE3 of the training and validation samples ([`crate::samples::Samples::hash`]).
    pub(crate) samples_blake3: String,
}

/// The content of `checkpoint.json`.
#[derive(Default, Serialize, Deserialize)]
struct Saved {
    origin: Origin,
    /// Training time, seconds.
    spent_s: f64,
    stages: Vec<Stage>,
}

/// Training stage, running or done.
#[derive(Serialize, Deserialize)]
struct Stage {
    /// [`Task::NAME`].
    network: String,
    /// Position in the random numbers.
    random_words: u128,
    /// [`Task::state`].
    state: Value,
    reached: Reached,
}

/// Stage progress.
#[derive(Clone, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Reached {
    /// Between two steps.
    Step(RunningWeights),
    /// Done.
    End(Learned<Base64>),
}

/// State between two steps.
#[derive(Clone, Serialize, Deserialize)]
pub(crate) struct RunningWeights {
    /// Steps done.
    pub(crate) step: usize,
    /// Weights.
    pub(crate) weights: Base64,
    /// State of the optimiser.
    pub(crate) optimiser: Base64,
    /// Finished cycles.
    pub(crate) cycles: Vec<Cycle>,
}

/// Bytes, as text in base 64.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub(crate) struct Base64(Vec<u8>);

impl From<Base64> for String {
    fn from(bytes: Base64) -> Self {
        BASE64_STANDARD.encode(bytes.0)
    }
}

impl TryFrom<String> for Base64 {
    type Error = base64::DecodeError;

    fn try_from(text: String) -> std::result::Result<Self, Self::Error> {
        BASE64_STANDARD.decode(text).map(Self)
    }
}

/// Checkpoint file of the running training.
pub(crate) struct Checkpoints {
    /// `None` without a checkpoint file.
    path: Option<PathBuf>,
    saved: Saved,
    /// Number of stages that this process has begun or skipped.
    begun: usize,
    /// Start of this process, and the training time of earlier processes, seconds.
    began: Instant,
    before_s: f64,
    last_save: Instant,
    last_save_took: Duration,
}

impl Checkpoints {
    /// Resumes from the checkpoint at `path` if its origin is the same.
    pub(crate) fn open(path: &Path, origin: Origin, began: Instant, watch: &dyn Watch) -> Self {
        let saved = read(path, &origin).unwrap_or_else(|| Saved {
            origin,
            ..Saved::default()
        });
        if let Some(stage) = saved.stages.last() {
            let place = match &stage.reached {
                Reached::Step(running) => format!("step {}", running.step),
                Reached::End(_) => "the end".into(),
            };
            watch.say(&format!(
                "resuming at {place} of {}, from {}",
                stage.network,
                path.display()
            ));
        }
        Self {
            began,
            ..Self::new(Some(path.to_owned()), saved)
        }
    }

    /// Writes no checkpoint: for short trainings.
    pub(crate) fn none() -> Self {
        Self::new(None, Saved::default())
    }

    fn new(path: Option<PathBuf>, saved: Saved) -> Self {
        let now = Instant::now();
        Self {
            path,
            begun: 0,
            began: now,
            before_s: saved.spent_s,
            last_save: now,
            last_save_took: Duration::ZERO,
            saved,
        }
    }

    /// Training time of all processes, seconds.
    pub(crate) fn spent_s(&self) -> f64 {
        self.before_s + self.began.elapsed().as_secs_f64()
    }

    /// Starts the next stage from the checkpoint and restores the task's state. `None` if the checkpoint does not contain the stage.
    pub(crate) fn next_stage<T: Task>(&mut self, task: &mut T) -> Result<Option<Reached>> {
        let stage = self.saved.stages.get(self.begun);
        self.begun += 1;
        let Some(stage) = stage else {
            return Ok(None);
        };
        task.restore(&stage.state)
            .map_err(|error| self.damaged(error))?;
        task.setup().random.set_word_pos(stage.random_words);
        Ok(Some(stage.reached.clone()))
    }

    pub(crate) fn is_due(&self) -> bool {
        self.path.is_some() && self.last_save.elapsed() >= SHARE_OF_TIME * self.last_save_took
    }

    /// Saves the stage that was begun last.
    pub(crate) fn save<T: Task>(
        &mut self,
        task: &mut T,
        reached: impl FnOnce(&Self) -> Result<Reached>,
    ) -> Result<()> {
        let Some(path) = self.path.clone() else {
            return Ok(());
        };
        let began = Instant::now();
        let stage = Stage {
            network: T::NAME.into(),
            random_words: task.setup().random.get_word_pos(),
            state: (task.state()).map_err(|error| self.damaged(error))?,
            reached: reached(self)?,
        };
        self.saved.stages.truncate(self.begun - 1);
        self.saved.stages.push(stage);
        self.saved.spent_s = self.spent_s();
        let folder = path.parent().unwrap_or(&path);
        fs::create_dir_all(folder).map_err(dataset::Error::io("create", folder))?;
        write_json(&path, &self.saved)?;
        (self.last_save, self.last_save_took) = (Instant::now(), began.elapsed());
        Ok(())
    }

    pub(crate) fn network_bytes<N: Module>(&self, network: &N) -> Result<Base64> {
        let bytes = network.clone().into_record().into_bytes();
        self.sound(bytes.map(|bytes| Base64(bytes.to_vec())))
    }

    pub(crate) fn network<N: Module>(&self, bytes: &Base64, network: N) -> Result<N> {
        let record = ModuleRecord::from_bytes(Bytes::from_bytes_vec(bytes.0.clone()));
        self.sound(record.and_then(|record| network.try_load_record(record)))
    }

    pub(crate) fn optimiser_bytes(&self, optimiser: &ModuleOptimizer) -> Result<Base64> {
        let bytes = optimiser.into_bytes();
        self.sound(bytes.map(|bytes| Base64(bytes.to_vec())))
    }

    pub(crate) fn optimiser(
        &self,
        bytes: &Base64,
        optimiser: ModuleOptimizer,
    ) -> Result<ModuleOptimizer> {
        self.sound(optimiser.from_bytes(Bytes::from_bytes_vec(bytes.0.clone())))
    }

    fn sound<V>(&self, value: std::result::Result<V, RecordError>) -> Result<V> {
        value.map_err(|error| self.damaged(error))
    }

    fn damaged(&self, error: impl std::error::Error) -> Error {
        let path = self.path.as_deref().unwrap_or(Path::new(""));
        let remedy = "remove it, and the training starts from the beginning";
        Error::run(path, format!("is damaged: {error}; {remedy}"))
    }
}

/// The checkpoint at `path`; `None` if it is missing or its origin differs.
fn read(path: &Path, origin: &Origin) -> Option<Saved> {
    let shown = path.display();
    let bytes = match outside_file::read(path, CHECKPOINT) {
        Ok(bytes) => bytes,
        Err(error) if error.is_not_found() => return None,
        Err(error) => {
            tracing::warn!("the training starts from the beginning, because {error}");
            return None;
        }
    };
    let saved: Saved = match serde_json::from_slice(&bytes) {
        Ok(saved) => saved,
        Err(error) => {
            tracing::warn!(
                "{shown} cannot be read, so the training starts from the beginning: {error}"
            );
            return None;
        }
    };
    if saved.origin == *origin {
        return Some(saved);
    }
    let [here, there] =
        [origin, &saved.origin].map(|origin| serde_json::to_value(origin).unwrap_or_default());
    tracing::warn!(
        "{shown} is of another training, so this one starts from the beginning; here, and there: {}",
        json_differences(&here, &there).join("; ")
    );
    None
}
