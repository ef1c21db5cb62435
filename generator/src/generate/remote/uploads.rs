//! Finished scenarios on their way to the object store: one worker uploads them, one after the other, while others are recorded.

use std::time::{Duration, Instant};

use dataset::corpus::claim::{Claim, Claimed};
use dataset::corpus::{Corpus, ScenarioFolder};
use dataset::plan::PlannedScenario;
use dataset::work::watch::{self, Watch};
use store::{Pushed, StoreError};
use tokio::sync::mpsc;
use tokio::time::sleep;

use crate::generate::error::GenerateError;
use crate::generate::event::{Event, Reporter};
use crate::generate::freeze::is_whole;
use crate::generate::outcome::Stopped;
use crate::generate::remote::Remote;
use crate::generate::run::tally::Tally;

/// Scenarios that may wait for the current upload. Together with that one, this many folders are on the stage besides those being
/// recorded.
pub(crate) const WAITING: usize = 1;
/// Longest time for a cancelled transfer to stop.
const CANCEL_TIMEOUT: Duration = Duration::from_secs(5);
/// Interval for checking a staged scenario that is being uploaded elsewhere.
const POLL_INTERVAL: Duration = Duration::from_millis(500);

/// A finished scenario to upload. Its claim keeps others off until the store has it.
struct Job<'a> {
    scenario: &'a PlannedScenario,
    claim: Claim,
}

/// The worker that uploads finished scenarios.
pub(crate) struct Uploader<'r, 'a> {
    pub(crate) remote: &'r Remote,
    pub(crate) stage: &'r Corpus,
    pub(crate) reporter: &'r Reporter<'a>,
    pub(crate) tally: &'r Tally,
}

/// Handle for submitting finished scenarios to the uploader, which ends when all handles are dropped.
#[derive(Clone)]
pub(crate) struct Uploads<'r, 'a> {
    jobs: mpsc::Sender<Job<'a>>,
    uploader: &'r Uploader<'r, 'a>,
}

impl<'a> Uploads<'_, 'a> {
    /// Queues a finished scenario for upload; waits while the queue is full. If the run ends before, it stays on the stage.
    pub(crate) async fn hand_over(&self, scenario: &'a PlannedScenario, claim: Claim) {
        let job = Job { scenario, claim };
        let job = match self.jobs.try_send(job) {
            Ok(()) => return,
            Err(mpsc::error::TrySendError::Full(job) | mpsc::error::TrySendError::Closed(job)) => {
                job
            }
        };
        self.uploader.reporter.say(&format!(
            "{} waits for its upload: recording is faster than uploading",
            scenario.id
        ));
        let sent = tokio::select! {
            biased;
            () = self.uploader.tally.halt.cancelled() => false,
            sent = self.jobs.send(job) => sent.is_ok(),
        };
        if !sent {
            self.uploader.tally.stays_staged(scenario);
        }
    }

    /// Queues what earlier runs left on the stage.
    pub(crate) async fn hand_over_staged(self, staged: &[&'a PlannedScenario]) {
        for scenario in staged {
            match self.claim_staged(scenario).await {
                Ok(Some(claim)) => self.hand_over(scenario, claim).await,
                Ok(None) => {}
                Err(error) => self.uploader.tally.fail(error),
            }
        }
    }

    /// The claim on a staged scenario; `None` if it needs no upload, because it was uploaded elsewhere or the run ends.
    async fn claim_staged(
        &self,
        scenario: &PlannedScenario,
    ) -> Result<Option<Claim>, GenerateError> {
        let Uploader { stage, tally, .. } = self.uploader;
        loop {
            if tally.halt.is_cancelled() {
                tally.stays_staged(scenario);
                return Ok(None);
            }
            match Claim::take(stage, &scenario.id)? {
                Claimed::Mine(claim) if is_whole(stage, scenario)? => return Ok(Some(claim)),
                Claimed::Mine(_) => {
                    tally.skipped(scenario);
                    return Ok(None);
                }
                Claimed::Theirs(_) => sleep(POLL_INTERVAL).await,
            }
        }
    }
}

/// Reports a transfer to the run's listener.
struct Watching<'r, 'a> {
    uploader: &'r Uploader<'r, 'a>,
    id: &'r str,
}

impl Watch for Watching<'_, '_> {
    fn warn(&self, reason: &str) {
        let line = format!("{} cannot be uploaded now; {reason}", self.id);
        self.uploader.reporter.warn(&line);
    }

    fn is_stopped(&self) -> bool {
        self.uploader.tally.halt.is_cancelled()
    }
}

impl<'r, 'a> Uploader<'r, 'a> {
    /// The handle for submitting scenarios, and the future that uploads them.
    pub(crate) fn start(&'r self) -> (Uploads<'r, 'a>, impl Future<Output = ()>) {
        let (sender, mut jobs) = mpsc::channel::<Job<'a>>(WAITING);
        let uploads = Uploads {
            jobs: sender,
            uploader: self,
        };
        let work = async move {
            while let Some(job) = jobs.recv().await {
                if self.tally.halt.is_cancelled() {
                    self.tally.stays_staged(job.scenario);
                } else {
                    self.upload(job.scenario).await;
                }
                drop(job.claim);
            }
        };
        (uploads, work)
    }

    async fn upload(&self, scenario: &PlannedScenario) {
        let id = scenario.id.as_str();
        let began = Instant::now();
        match self.push(id).await {
            // The store has a whole copy, this one or a different one.
            Ok(pushed) => {
                self.remote.forget_failure(id).await;
                if !self.remote.keep_staged && !self.is_only_labelled_copy(id, &pushed) {
                    self.remote.unstage(self.stage, id).await;
                }
                match pushed {
                    Pushed::Committed { .. } => self.tally.committed(scenario),
                    Pushed::Same | Pushed::Other | Pushed::Labelled => self.tally.skipped(scenario),
                }
                let seconds = began.elapsed().as_secs_f64();
                self.reporter
                    .say(&format!("{id}: uploaded in {seconds:.0} s"));
            }
            Err(StoreError::Stopped(_)) => self.tally.stays_staged(scenario),
            Err(error) if error.is_of_scenario() => {
                let reason = format!(
                    "{error}. If {} is damaged, move it away, then the scenario will be recorded again",
                    self.stage.scenario(id).root().display()
                );
                self.reporter.tell(Event::Failed {
                    id,
                    reason: &reason,
                });
                self.tally.failed(scenario, reason);
            }
            Err(error) => {
                self.tally.stays_staged(scenario);
                self.tally.stop(Stopped::Store {
                    reason: format!(
                        "{error}. Nothing is lost: complete scenarios that are not uploaded yet stay in {}; run the same command again to resume",
                        self.stage.root().display()
                    ),
                });
            }
        }
    }

    /// True if the store keeps a different copy and this one is labelled: its labels exist only here.
    fn is_only_labelled_copy(&self, id: &str, pushed: &Pushed) -> bool {
        let folder = self.stage.scenario(id);
        let labels = folder.root().join(ScenarioFolder::TRUTH_BOXES);
        if *pushed != Pushed::Other || !labels.exists() {
            return false;
        }
        tracing::warn!(
            id,
            "stays on the stage: it is labelled, and the store has a different copy of it"
        );
        true
    }

    /// Sends a scenario, as long as the store can be reached and the run does not end.
    async fn push(&self, id: &str) -> store::Result<Pushed> {
        let folder = self.stage.scenario(id);
        let watching = Watching { uploader: self, id };
        let store = self.remote.store.watched(&watching);
        let no_longer = async {
            self.tally.halt.cancelled().await;
            sleep(CANCEL_TIMEOUT).await;
        };
        tokio::select! {
            pushed = store.push_scenario(&folder) => pushed,
            () = no_longer => Err(watch::Stopped.into()),
        }
    }
}
