//! A run: workers, each with its own simulator, take scenarios from one queue until none is left or no worker can continue.
//!
//! A failed attempt is retried after a growing delay, by whichever worker is free then; after the last one the scenario is set aside. As
//! many attempts again do not count if no simulator answers. An error that must repeat ends the attempts at its scenario at once, one
//! that every scenario would meet with this simulator ends its worker. A simulator that does not answer is waited for (`away.rs`); if it
//! does not come back, its worker ends and leaves the rest to the others. A full disk ends the run, since no scenario could succeed.
//!
//! If the corpus is in an object store, finished scenarios go to one more worker, which uploads them (`uploads.rs`).

pub(crate) mod attempt;
mod away;
pub(crate) mod patience;
mod queue;
pub(crate) mod tally;

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use dataset::corpus::claim::Claim;
use dataset::corpus::effective_weather::WeatherDifference;
use dataset::corpus::set_aside::SetAside;
use dataset::plan::PlannedScenario;
use futures_util::future::join_all;
use indicatif::DecimalBytes;
use store::Committed;
use xplane_bridge::BridgeError;

use super::error::{Blame, GenerateError, ScenarioError};
use super::event::{Event, Reporter};
use super::options::{Cancel, GenerateOptions};
use super::outcome::{Outcome, Stopped};
use super::record::{Recorded, Work, record};
use super::remote::Remote;
use super::remote::uploads::{Uploader, Uploads};
use super::session::Session;
use super::session::restart::Restart;
use super::space;
use crate::plan::{counted, room_bytes};
use attempt::Attempt;
use patience::Patience;
use queue::{Next, Queue, Task};
use tally::Tally;

/// A simulator that fails this often in a row, whatever the scenario, is considered gone.
const FAILURES_IN_A_ROW: u32 = 9;

/// State shared by all workers.
pub(super) struct Run<'a> {
    work: Work<'a>,
    reporter: Reporter<'a>,
    patience: Patience,
    restart: Option<&'a Restart>,
    /// Destination of finished scenarios, if not a folder.
    remote: Option<&'a Remote>,
    queue: Mutex<Queue<'a>>,
    tally: Tally,
}

/// Decision after a scenario: the worker continues or leaves.
#[derive(PartialEq)]
enum Then {
    GoOn,
    Leave,
}

impl<'a> Run<'a> {
    pub(super) fn new(
        work: Work<'a>,
        reporter: Reporter<'a>,
        options: &'a GenerateOptions,
        to_make: &[&'a PlannedScenario],
        outcome: Outcome,
    ) -> Self {
        Self {
            work,
            reporter,
            patience: options.patience,
            restart: options.restart.as_ref(),
            remote: options.remote.as_ref(),
            queue: Mutex::new(Queue::new(to_make)),
            tally: Tally::new(outcome),
        }
    }

    /// Lets every session record scenarios, and uploads those that are `staged` already; ends when all are recorded and uploaded, when no
    /// worker can continue, or when `cancel` is set.
    pub(super) async fn work_through(
        self,
        sessions: Vec<(Session, Option<ScenarioError>)>,
        staged: &[&'a PlannedScenario],
        cancel: &Cancel,
    ) -> Result<Outcome, GenerateError> {
        let (stage, tally) = (self.work.corpus, &self.tally);
        let uploader = self.remote.map(|remote| Uploader {
            remote,
            stage,
            reporter: &self.reporter,
            tally,
        });
        let (uploads, sending) = uploader.as_ref().map(Uploader::start).unzip();
        let workers: Vec<_> = sessions
            .into_iter()
            .map(|(session, trouble)| self.worker(session, trouble, uploads.clone()))
            .collect();
        let send = async {
            if let (Some(uploads), Some(sending)) = (uploads, sending) {
                tokio::join!(uploads.hand_over_staged(staged), sending);
            }
        };
        let until_cancelled = async {
            cancel.cancelled().await;
            tally.stop(Stopped::Interrupted);
            std::future::pending::<()>().await;
        };
        tokio::select! {
            _ = async { tokio::join!(join_all(workers), send) } => {}
            () = until_cancelled => {}
        }
        Claim::tidy(stage);
        let queue = self
            .queue
            .into_inner()
            .unwrap_or_else(PoisonError::into_inner);
        self.tally.into_outcome(self.work.plan, queue.left())
    }

    fn queue(&self) -> MutexGuard<'_, Queue<'a>> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    async fn worker(
        &self,
        mut session: Session,
        trouble: Option<ScenarioError>,
        uploads: Option<Uploads<'_, 'a>>,
    ) {
        if let Some(trouble) = trouble
            && self.take_over_with(&mut session, &trouble).await == Then::Leave
        {
            session.close().await;
            return;
        }
        let mut failures_in_a_row = 0;
        while !self.tally.halt.is_cancelled() {
            if self.restart_if_due(&mut session).await == Then::Leave {
                break;
            }
            let next = self.queue().next(self.work.corpus);
            match next {
                Err(GenerateError::Corpus(error)) if self.is_storage_failure(&error) => {
                    self.tally.stop(self.storage(&error));
                }
                Err(error) => self.tally.fail(error),
                Ok(Next::Finished) => break,
                Ok(Next::Whole(task, claim)) => match &uploads {
                    Some(_) => self.made(task, claim, uploads.as_ref()).await,
                    None => self.made_elsewhere(task),
                },
                Ok(Next::Later(pause, elsewhere)) => {
                    if let Some(elsewhere) = elsewhere
                        && self.tally.is_first_to_wait()
                    {
                        self.reporter.say(&format!(
                            "waiting for {} that others make ({})",
                            counted(elsewhere.scenarios, "scenario"),
                            elsewhere.holder
                        ));
                    }
                    self.pause(pause).await;
                }
                Ok(Next::Make(task, _claim)) if self.is_in_store(&task).await => {
                    self.made_elsewhere(task);
                }
                Ok(Next::Make(task, claim)) => {
                    let then = match self.make(&task, &claim, &mut session).await {
                        Ok(()) => {
                            failures_in_a_row = 0;
                            session.restarts_in_vain = 0;
                            self.made(task, claim, uploads.as_ref()).await;
                            Then::GoOn
                        }
                        Err(error) => {
                            self.settle(task, claim, error, &mut session, &mut failures_in_a_row)
                                .await
                        }
                    };
                    if then == Then::Leave {
                        break;
                    }
                }
            }
        }
        session.close().await;
    }

    fn made_elsewhere(&self, task: Task<'a>) {
        let scenario = task.scenario;
        self.reporter.tell(Event::MadeElsewhere {
            id: &scenario.id,
            ticks: scenario.ticks,
        });
        self.tally.skipped(scenario);
        self.queue().done_with(task);
    }

    /// True if a concurrent run has uploaded a scenario since this one started, and it is complete in the store. An unreachable store is
    /// reported at the next upload.
    async fn is_in_store(&self, task: &Task<'a>) -> bool {
        match self.remote {
            Some(remote) => {
                let store = remote.connection();
                let state = store.state(&task.scenario.id).await;
                matches!(state, Ok(Committed::Whole(_)))
            }
            None => false,
        }
    }

    async fn make(
        &self,
        task: &Task<'a>,
        claim: &Claim,
        session: &mut Session,
    ) -> Result<(), ScenarioError> {
        let scenario = task.scenario;
        let failed = task.reasons.len() as u32;
        let began = Instant::now();
        self.reporter.tell(Event::Started {
            id: &scenario.id,
            ticks: scenario.ticks,
        });
        let attempt = Attempt {
            id: &scenario.id,
            cancel: &self.tally.halt,
            reporter: &self.reporter,
            answer_limit: self.patience.answer,
            settles: task.images_failed && failed + 1 >= self.patience.attempts,
        };
        let recorded = record(&self.work, scenario, claim, session, &attempt).await;
        let recorded = match session.tape() {
            Some(tape) => recorded.map_err(|error| error.of_tape(tape))?,
            None => recorded?,
        };
        SetAside::clear(self.work.corpus, &scenario.id);
        self.reporter.tell(Event::Committed {
            id: &scenario.id,
            ticks: recorded.ticks,
            seconds: began.elapsed().as_secs_f64(),
        });
        self.note_weather(&scenario.id, &recorded, session);
        Ok(())
    }

    /// Notes the weather at the aircraft in a recorded scenario.
    fn note_weather(&self, id: &str, recorded: &Recorded, session: &mut Session) {
        if let Some(shown) = &recorded.effective_weather {
            session.followed.shown(id, shown);
        }
        if recorded.marks.is_empty() {
            return;
        }
        let differences: Vec<String> = recorded.marks.iter().map(ToString::to_string).collect();
        self.reporter.warn(&format!(
            "{id} is marked, the weather at the aircraft is not the planned one: {}",
            differences.join("; ")
        ));
        self.tally.marked(id, differences);
        self.note_differences(id, &recorded.marks, session);
    }

    /// Reports quantities that differ in scenario after scenario, once.
    fn note_differences(&self, id: &str, differences: &[WeatherDifference], session: &mut Session) {
        for quantity in session.followed.differed(id, differences) {
            self.reporter.warn(&format!(
                "simulator {} does not follow the {quantity} that is set: it differed in three scenarios alike. It is no longer waited for, \
                 and scenarios in which it differs are marked; `dtd doctor --measure` examines it",
                session.name()
            ));
        }
    }

    /// A scenario is complete in the corpus' folder.
    async fn made(&self, task: Task<'a>, claim: Claim, uploads: Option<&Uploads<'_, 'a>>) {
        match uploads {
            Some(uploads) => uploads.hand_over(task.scenario, claim).await,
            None => self.tally.committed(task.scenario),
        }
        self.queue().done_with(task);
    }

    /// Decides a failed attempt's consequences for scenario, simulator and run.
    async fn settle(
        &self,
        mut task: Task<'a>,
        claim: Claim,
        error: ScenarioError,
        session: &mut Session,
        failures_in_a_row: &mut u32,
    ) -> Then {
        let id = task.scenario.id.as_str();
        let blame = error.blame(self.work.corpus.root());
        match (blame, &error) {
            (Blame::Nobody, _) => {
                self.queue().give_back(task, Duration::ZERO);
                return Then::Leave;
            }
            (Blame::Storage, ScenarioError::Corpus(error)) => {
                self.queue().give_back(task, Duration::ZERO);
                self.tally.stop(self.storage(error));
                return Then::Leave;
            }
            _ => {}
        }
        if let Some(difference) = error.weather_difference() {
            self.note_differences(id, &[difference], session);
        }
        tracing::warn!(id, simulator = session.name(), %error, "attempt failed");
        if blame == Blame::Setup {
            // Other simulators may be able to make it, and so may this one later.
            self.queue().give_back(task, Duration::ZERO);
            self.give_up_on(session, &error);
            return Then::Leave;
        }
        let reason = error.to_string();
        task.images_failed |= matches!(error, ScenarioError::Bridge(BridgeError::Pixels(_)));
        // A simulator that has ended says nothing about the scenario, unless it ends at this one again and again.
        if error.is_silence() && task.silences < self.patience.attempts {
            task.silences += 1;
        } else {
            task.reasons.push(reason.clone());
        }
        let failed = task.reasons.len() as u32;
        if failed < self.patience.attempts && !error.is_certain() {
            self.reporter.tell(Event::Retrying {
                id,
                reason: &reason,
            });
            self.queue()
                .give_back(task, self.patience.pause_after(failed));
        } else {
            self.set_aside(task, reason).await;
        }
        // Only now may others have it.
        drop(claim);
        if blame != Blame::Simulator {
            return Then::GoOn;
        }
        *failures_in_a_row += 1;
        if *failures_in_a_row >= FAILURES_IN_A_ROW {
            *failures_in_a_row = 0;
            return self.restart_or_give_up(session, &error).await;
        }
        self.wait_for(session, &error).await
    }

    async fn set_aside(&self, task: Task<'a>, reason: String) {
        let id = &task.scenario.id;
        self.reporter.tell(Event::Failed {
            id,
            reason: &reason,
        });
        let record = SetAside {
            id: id.clone(),
            config_hash: task.scenario.config_hash.clone(),
            reasons: task.reasons.clone(),
        };
        if let Err(error) = record.write(self.work.corpus) {
            tracing::error!(id, %error, "the reason could not be kept");
        } else if let Some(remote) = self.remote {
            remote.tell_of_failure(self.work.corpus, id).await;
        }
        self.tally.failed(task.scenario, reason);
        self.queue().done_with(task);
    }

    fn is_storage_failure(&self, error: &dataset::Error) -> bool {
        space::is_storage_failure(error, self.work.corpus.root())
    }

    fn storage(&self, error: &dataset::Error) -> Stopped {
        let root = self.work.corpus.root();
        let needed = room_bytes(&self.work.plan.common, self.queue().left());
        let free = space::free_bytes(root).map_or("an unknown amount".into(), |free| {
            DecimalBytes(free).to_string()
        });
        Stopped::Storage {
            reason: format!(
                "{error}. {} has {free} free, and about {} more are needed; nothing that is whole is lost: make room, or move the \
                 corpus, and run the same command again",
                root.display(),
                DecimalBytes(needed)
            ),
        }
    }

    async fn pause(&self, pause: Duration) {
        tokio::select! {
            () = self.tally.halt.cancelled() => {}
            () = tokio::time::sleep(pause) => {}
        }
    }
}
