//! The thread that writes the tape, and the short queue to it: compressing an image takes longer than a datagram may wait.

use std::collections::BTreeMap;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use tokio::sync::mpsc;
use tokio::task::{JoinError, JoinHandle, spawn_blocking};
use tokio::time::interval;

use crate::error::TapeError;
use crate::format::Channel;
use crate::link_message::LinkMessage;
use crate::writer::{TapeSummary, TapeWriter};

/// Maximum queued messages. When the queue is full, clients and simulator wait.
const QUEUE: usize = 32;
/// Interval for checking an idle tape.
const LOOK_EVERY: Duration = Duration::from_millis(500);

enum Job {
    AddChannel(Channel, BTreeMap<String, String>),
    Write(Channel, u64, Vec<u8>),
    Look,
    Stop,
}

/// The writer's thread and its queue.
pub(super) struct TapeThread {
    jobs: mpsc::Sender<Job>,
}

impl TapeThread {
    /// Starts the thread. It ends on an error, or on request.
    pub(super) fn start(tape: TapeWriter) -> (Self, JoinHandle<Result<TapeSummary, TapeError>>) {
        let (jobs, waiting) = mpsc::channel(QUEUE);
        let writing = spawn_blocking(move || write(tape, waiting));
        let look = jobs.downgrade();
        tokio::spawn(async move {
            let mut often = interval(LOOK_EVERY);
            loop {
                often.tick().await;
                let Some(jobs) = look.upgrade() else { return };
                if jobs.send(Job::Look).await.is_err() {
                    return;
                }
            }
        });
        (Self { jobs }, writing)
    }

    /// Adds a channel, with its metadata.
    pub(super) async fn add_channel(&self, channel: Channel, about: &[(&str, String)]) {
        let about = about
            .iter()
            .map(|(key, value)| ((*key).to_owned(), value.clone()));
        self.hand_over(Job::AddChannel(channel, about.collect()))
            .await;
    }

    pub(super) async fn write(&self, channel: Channel, bytes: &[u8]) {
        self.hand_over(Job::Write(channel, now_ns(), bytes.to_owned()))
            .await;
    }

    /// Writes a message of the link without its token, a secret that must not be stored.
    pub(super) async fn write_message(&self, channel: Channel, message: &LinkMessage) {
        let safe = message.without_token();
        self.write(channel, safe.as_ref().unwrap_or(message).bytes())
            .await;
    }

    /// Ends the tape after everything that was queued.
    pub(super) async fn stop(&self) {
        self.hand_over(Job::Stop).await;
    }

    /// Queues a job. If the thread has ended, the recorder ends as well and reports why.
    async fn hand_over(&self, job: Job) {
        let _ = self.jobs.send(job).await;
    }
}

/// Result of the thread.
pub(super) fn ended(
    joined: Result<Result<TapeSummary, TapeError>, JoinError>,
) -> Result<TapeSummary, TapeError> {
    joined.unwrap_or_else(|_| Err(TapeError::Failed("the tape's writer stopped".into())))
}

fn write(mut tape: TapeWriter, mut jobs: mpsc::Receiver<Job>) -> Result<TapeSummary, TapeError> {
    while let Some(job) = jobs.blocking_recv() {
        match job {
            Job::AddChannel(channel, about) => tape.add_channel(channel, &about)?,
            Job::Write(channel, time_ns, bytes) => tape.write(channel, time_ns, &bytes)?,
            Job::Look => tape.flush_if_due()?,
            Job::Stop => break,
        }
    }
    tape.finish()
}

fn now_ns() -> u64 {
    let since = SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .unwrap_or_default();
    u64::try_from(since.as_nanos()).unwrap_or(u64::MAX)
}
