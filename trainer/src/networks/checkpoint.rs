//! Training checkpoints: a killed run resumes where it stopped.
//!
//! A training is a sequence of stages, each a network that [`crate::networks::training_loop`] trains. `checkpoint.json` contains all stages
//! so far, with steps, weights, optimiser, position in the random numbers and log. It is replaced atomically, while the training runs and
//! after each stage.
//!
//! The result of a training depends on its [`Origin`] alone. So a training with the same origin continues from the checkpoint to the same
//! numbers, and one with another origin starts afresh: it would replace a finished run as well.

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
use crate::error::{Error, Result, RunFault};
use crate::networks::stage::{Cycle, EndedBy};
use crate::networks::training_loop::Task;
use crate::samples::rig::json_differences::json_differences;

/// The weights of the largest networks, three times, in base 64.
const CHECKPOINT: FileKind = FileKind::new("checkpoint", 16 << 30).unlinked();
/// Saving takes at most one part in this many of the time.
const SHARE_OF_TIME: u32 = 50;

/// All that determines the numbers of a training.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(crate) struct Origin {
    /// Version of this software.
    pub(crate) dtd: String,
    /// The settings.
    pub(crate) config: TrainConfig,
    /// BLAKE3 of the weights that it starts from, if they are not random.
    pub(crate) start_blake3: Option<String>,
    /// BLAKE3 of what networks and formulas learn from and are judged by ([`crate::samples::Samples::hash`]).
    pub(crate) samples_blake3: String,
}

/// The content of `checkpoint.json`.
#[derive(Default, Serialize, Deserialize)]
struct Saved {
    origin: Origin,
    /// Time that the training has taken, seconds.
    spent_s: f64,
    stages: Vec<Stage>,
}

/// A network, in training or done.
#[derive(Serialize, Deserialize)]
struct Stage {
    /// [`Task::NAME`].
    network: String,
    /// Place in the random numbers.
    random_words: u128,
    /// [`Task::State`].
    state: Value,
    reached: Reached,
}

/// Progress of a stage.
#[derive(Clone, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Reached {
    /// Between two steps.
    Step(RunningWeights),
    /// It is done.
    End(EndedStage),
}

/// A network in training.
#[derive(Clone, Serialize, Deserialize)]
pub(crate) struct RunningWeights {
    /// Steps done.
    pub(crate) step: usize,
    /// Its numbers.
    pub(crate) weights: Base64,
    /// State of the optimiser.
    pub(crate) optimiser: Base64,
    /// The network with the lowest error so far.
    pub(crate) best: Option<KeptWeights>,
    /// Judgements since then.
    pub(crate) since_best: usize,
    /// Finished cycles.
    pub(crate) cycles: Vec<Cycle>,
}

/// A network that is trained.
#[derive(Clone, Serialize, Deserialize)]
pub(crate) struct EndedStage {
    /// The network.
    pub(crate) kept: KeptWeights,
    /// Steps done.
    pub(crate) steps: usize,
    /// Cause of its end.
    pub(crate) ended_by: EndedBy,
    /// Its cycles.
    pub(crate) cycles: Vec<Cycle>,
}

/// A network that is kept.
#[derive(Clone, Serialize, Deserialize)]
pub(crate) struct KeptWeights {
    /// Steps that made it.
    pub(crate) step: usize,
    /// Its error, percent.
    pub(crate) error_pct: f64,
    /// Its numbers.
    pub(crate) weights: Base64,
}

/// Bytes, as text in base 64.
#[derive(Clone, Serialize, Deserialize)]
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

/// The checkpoint of a training that is at work.
pub(crate) struct Checkpoints {
    /// `None` for a training that is not kept.
    path: Option<PathBuf>,
    saved: Saved,
    /// Stages that this process has begun or skipped.
    begun: usize,
    /// When this process began to train, and what others had spent before, seconds.
    began: Instant,
    before_s: f64,
    last_save: Instant,
    last_save_took: Duration,
}

impl Checkpoints {
    /// Goes on from the checkpoint at `path` if it has the same origin.
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

    /// For a training that is too short to be kept.
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

    /// Time that the training has taken, by all processes, seconds.
    pub(crate) fn spent_s(&self) -> f64 {
        self.before_s + self.began.elapsed().as_secs_f64()
    }

    /// Starts the next stage: from the checkpoint, with the task restored to its saved state. `None` if the checkpoint does not contain the
    /// stage.
    pub(crate) fn next_stage<T: Task>(&mut self, task: &mut T) -> Result<Option<Reached>> {
        let stage = self.saved.stages.get(self.begun);
        self.begun += 1;
        let Some(stage) = stage else {
            return Ok(None);
        };
        let state = T::State::deserialize(&stage.state);
        let state = state.map_err(|error| self.unusable(RunFault::CheckpointState(error)))?;
        task.restore(state);
        task.random().set_word_pos(stage.random_words);
        Ok(Some(stage.reached.clone()))
    }

    /// True if it is time to save.
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
            random_words: task.random().get_word_pos(),
            state: serde_json::to_value(task.state())
                .map_err(|error| self.unusable(RunFault::CheckpointState(error)))?,
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

    /// The numbers of a network.
    pub(crate) fn network_bytes<N: Module>(&self, network: &N) -> Result<Base64> {
        let bytes = network.clone().into_record().into_bytes();
        self.sound(bytes.map(|bytes| Base64(bytes.to_vec())))
    }

    /// The network with such numbers.
    pub(crate) fn network<N: Module>(&self, bytes: &Base64, network: N) -> Result<N> {
        let record = ModuleRecord::from_bytes(Bytes::from_bytes_vec(bytes.0.clone()));
        self.sound(record.and_then(|record| network.try_load_record(record)))
    }

    /// The numbers of an optimiser.
    pub(crate) fn optimiser_bytes(&self, optimiser: &ModuleOptimizer) -> Result<Base64> {
        let bytes = optimiser.into_bytes();
        self.sound(bytes.map(|bytes| Base64(bytes.to_vec())))
    }

    /// The optimiser with such numbers.
    pub(crate) fn optimiser(
        &self,
        bytes: &Base64,
        optimiser: ModuleOptimizer,
    ) -> Result<ModuleOptimizer> {
        self.sound(optimiser.from_bytes(Bytes::from_bytes_vec(bytes.0.clone())))
    }

    fn sound<V>(&self, value: std::result::Result<V, RecordError>) -> Result<V> {
        value.map_err(|error| self.unusable(RunFault::CheckpointWeights(error)))
    }

    fn unusable(&self, fault: RunFault) -> Error {
        Error::run(self.path.as_deref().unwrap_or(Path::new("")), fault)
    }
}

/// The checkpoint at `path`; `None` if there is none, or if it is of another training.
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
