//! A run: workers, each with its own simulator, take scenarios from one queue until none is left or nothing works any more.
//!
//! A failed attempt is retried after a growing delay, by whichever worker is free then; after the last one the scenario is set
//! aside. A simulator that does not answer is waited for; if it does not come back, its worker ends and leaves the rest to the
//! others. A full disk ends the run, since nothing else could succeed.
//!
//! If the corpus is in an object store, finished scenarios go to one more worker, which uploads them (`remote.rs`).

use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use dataset::claim::Claim;
use dataset::plan::PlannedScenario;
use futures_util::future::join_all;
use indicatif::DecimalBytes;
use tokio::sync::mpsc;

use super::attempt::{Attempt, unless_cancelled};
use super::error::{Blame, GenerateError, ScenarioError};
use super::event::{Event, Reporter};
use super::outcome::{FailedScenario, Outcome, Stopped};
use super::patience::Patience;
use super::queue::{Next, Queue, Task};
use super::record::{Work, record};
use super::remote::{Job, Remote, WAITING};
use super::session::Session;
use super::set_aside::SetAside;
use super::space;
use super::{Cancel, GenerateOptions};
use crate::plan::room_bytes;

/// A simulator that fails this often in a row, whatever the scenario, is considered gone.
const FAILURES_IN_A_ROW: u32 = 9;

/// Shared by the workers of a run.
pub(super) struct Run<'a> {
    pub(super) work: Work<'a>,
    pub(super) reporter: Reporter<'a>,
    pub(super) patience: Patience,
    /// Destination of finished scenarios, if not a folder.
    pub(super) remote: Option<&'a Remote>,
    /// Set when the run must end, for whatever reason.
    pub(super) halt: Cancel,
    /// Receives finished scenarios; gone when nobody records any more.
    pub(super) uploads: Mutex<Option<mpsc::Sender<Job<'a>>>>,
    queue: Mutex<Queue<'a>>,
    pub(super) tally: Mutex<Tally>,
}

#[derive(Default)]
pub(super) struct Tally {
    pub(super) outcome: Outcome,
    pub(super) fatal: Option<GenerateError>,
    /// The problem of the simulator that was given up last.
    last_simulator_failure: Option<String>,
    told_of_waiting: bool,
}

/// Whether a worker continues.
#[derive(PartialEq)]
enum Then {
    GoOn,
    Leave,
}

pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
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
            remote: options.remote.as_ref(),
            uploads: Mutex::new(None),
            halt: Cancel::new(),
            queue: Mutex::new(Queue::new(to_make)),
            tally: Mutex::new(Tally {
                outcome,
                ..Tally::default()
            }),
        }
    }

    /// Lets every session record scenarios, and uploads those that are `staged` already; ends when all are recorded and uploaded,
    /// when nothing works any more, or when `cancel` is set.
    pub(super) async fn work_through(
        self,
        sessions: Vec<(Session, Option<ScenarioError>)>,
        staged: &[&'a PlannedScenario],
        cancel: &Cancel,
    ) -> Result<Outcome, GenerateError> {
        let workers = sessions
            .into_iter()
            .map(|(session, trouble)| self.worker(session, trouble));
        let until_cancelled = async {
            cancel.cancelled().await;
            self.stop(Stopped::Interrupted);
            std::future::pending::<()>().await;
        };
        let (handed_over, uploads) = mpsc::channel(WAITING);
        *lock(&self.uploads) = Some(handed_over);
        let make = async {
            tokio::join!(join_all(workers), self.hand_over_staged(staged));
            lock(&self.uploads).take();
        };
        tokio::select! {
            _ = async { tokio::join!(make, self.upload_all(uploads)) } => {}
            () = until_cancelled => {}
        }
        Claim::tidy(self.work.corpus);
        let Tally {
            mut outcome,
            fatal,
            last_simulator_failure,
            ..
        } = self
            .tally
            .into_inner()
            .unwrap_or_else(PoisonError::into_inner);
        if let Some(error) = fatal {
            return Err(error);
        }
        let queue = self
            .queue
            .into_inner()
            .unwrap_or_else(PoisonError::into_inner);
        outcome.not_made = queue.left().map(|scenario| scenario.id.clone()).collect();
        // Several workers end in any order; the plan has one.
        let places: HashMap<&str, usize> = self
            .work
            .plan
            .scenarios
            .iter()
            .map(|s| s.id.as_str())
            .zip(0..)
            .collect();
        let place = |id: &str| places.get(id).copied();
        outcome.committed.sort_by_key(|id| place(id));
        outcome.skipped.sort_by_key(|id| place(id));
        outcome.not_made.sort_by_key(|id| place(id));
        outcome.staged.sort_by_key(|id| place(id));
        outcome.failed.sort_by_key(|scenario| place(&scenario.id));
        if outcome.stopped.is_none()
            && !outcome.not_made.is_empty()
            && let Some(reason) = last_simulator_failure
        {
            outcome.stopped = Some(Stopped::NoSimulator { reason });
        }
        Ok(outcome)
    }

    /// Ends the run early. The first reason counts.
    pub(super) fn stop(&self, reason: Stopped) {
        lock(&self.tally).outcome.stopped.get_or_insert(reason);
        self.halt.cancel();
    }

    async fn worker(&self, mut session: Session, trouble: Option<ScenarioError>) {
        if let Some(trouble) = trouble
            && self.wait_for(&mut session, &trouble).await == Then::Leave
        {
            session.close().await;
            return;
        }
        let mut failures_in_a_row = 0;
        while !self.halt.is_cancelled() {
            let next = lock(&self.queue).next(self.work.corpus);
            match next {
                Err(GenerateError::Corpus(error)) if self.is_storage_failure(&error) => {
                    self.stop(self.storage(&error));
                }
                Err(error) => {
                    lock(&self.tally).fatal.get_or_insert(error);
                    self.halt.cancel();
                }
                Ok(Next::Finished) => break,
                Ok(Next::Whole(task, claim)) => {
                    if self.remote.is_some() {
                        self.hand_over(task.scenario, claim).await;
                        lock(&self.queue).done_with(task);
                    } else {
                        self.made_elsewhere(task);
                    }
                }
                Ok(Next::Later(pause, elsewhere)) => {
                    if let Some(elsewhere) = elsewhere
                        && !std::mem::replace(&mut lock(&self.tally).told_of_waiting, true)
                    {
                        self.reporter.tell(Event::Waiting {
                            scenarios: elsewhere.scenarios,
                            holder: &elsewhere.holder,
                        });
                    }
                    self.pause(pause).await;
                }
                Ok(Next::Make(task, _claim)) if self.is_in_store(&task).await => {
                    self.made_elsewhere(task);
                }
                Ok(Next::Make(task, claim)) => {
                    let made = self.make(&task, &claim, &mut session).await;
                    if self
                        .settle(task, claim, made, &mut session, &mut failures_in_a_row)
                        .await
                        == Then::Leave
                    {
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
        lock(&self.tally).outcome.skipped.push(scenario.id.clone());
        lock(&self.queue).done_with(task);
    }

    /// Whether another run has uploaded a scenario to the object store since this one started. An unreachable store is reported at
    /// the next upload.
    async fn is_in_store(&self, task: &Task<'a>) -> bool {
        match self.remote {
            Some(remote) => {
                let seal = remote.store.seal(&task.scenario.id).await;
                seal.is_ok_and(|seal| seal.is_some())
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
        let began = Instant::now();
        self.reporter.tell(Event::Started {
            id: &scenario.id,
            ticks: scenario.ticks,
        });
        let attempt = Attempt {
            id: &scenario.id,
            cancel: &self.halt,
            reporter: &self.reporter,
            answer_limit: self.patience.answer,
        };
        let recorded = record(&self.work, scenario, claim, session, &attempt).await;
        let ticks = match session.tape() {
            Some(tape) => recorded.map_err(|error| error.of_tape(tape))?,
            None => recorded?,
        };
        SetAside::clear(self.work.corpus, &scenario.id);
        self.reporter.tell(Event::Committed {
            id: &scenario.id,
            ticks,
            seconds: began.elapsed().as_secs_f64(),
        });
        Ok(())
    }

    /// Decides the consequences of an attempt for its scenario, its simulator and the run.
    async fn settle(
        &self,
        mut task: Task<'a>,
        claim: Claim,
        made: Result<(), ScenarioError>,
        session: &mut Session,
        failures_in_a_row: &mut u32,
    ) -> Then {
        let id = task.scenario.id.as_str();
        let error = match made {
            Ok(()) => {
                *failures_in_a_row = 0;
                if self.remote.is_some() {
                    self.hand_over(task.scenario, claim).await;
                } else {
                    lock(&self.tally).outcome.committed.push(id.to_owned());
                }
                lock(&self.queue).done_with(task);
                return Then::GoOn;
            }
            Err(error) => error,
        };
        let blame = error.blame(self.work.corpus.root());
        match (blame, &error) {
            (Blame::Nobody, _) => {
                lock(&self.queue).give_back(task, Duration::ZERO);
                return Then::Leave;
            }
            (Blame::Storage, ScenarioError::Corpus(error)) => {
                lock(&self.queue).give_back(task, Duration::ZERO);
                self.stop(self.storage(error));
                return Then::Leave;
            }
            _ => {}
        }
        tracing::warn!(id, simulator = session.name(), %error, "attempt failed");
        let reason = error.to_string();
        task.reasons.push(reason.clone());
        let failed = task.reasons.len() as u32;
        if failed < self.patience.attempts && !error.is_certain() {
            self.reporter.tell(Event::Retrying {
                id,
                reason: &reason,
            });
            lock(&self.queue).give_back(task, self.patience.pause_after(failed));
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
            self.give_up_on(session, &error);
            return Then::Leave;
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
        lock(&self.tally).outcome.failed.push(FailedScenario {
            id: id.clone(),
            reason,
        });
        lock(&self.queue).done_with(task);
    }

    /// Waits for a simulator that caused trouble. Reports it only if it does not answer at once.
    async fn wait_for(&self, session: &mut Session, trouble: &ScenarioError) -> Then {
        let name = session.name().to_owned();
        match self.until_back(session, Duration::ZERO).await {
            Ok(true) => return Then::GoOn,
            Ok(false) => {}
            Err(_) => return Then::Leave,
        }
        self.reporter.tell(Event::SimulatorLost {
            simulator: &name,
            reason: &trouble.to_string(),
        });
        match self.until_back(session, self.patience.simulator).await {
            Ok(true) => {
                self.reporter
                    .tell(Event::SimulatorBack { simulator: &name });
                Then::GoOn
            }
            Ok(false) => {
                self.give_up_on(session, trouble);
                Then::Leave
            }
            Err(_) => Then::Leave,
        }
    }

    /// Whether the simulator comes back within a time; an error if the run was cancelled in the meantime.
    async fn until_back(
        &self,
        session: &mut Session,
        limit: Duration,
    ) -> Result<bool, ScenarioError> {
        let back = async { Ok::<_, ScenarioError>(session.come_back(limit).await) };
        unless_cancelled(&self.halt, back).await
    }

    /// Giving up the last simulator ends the run: the workers have left, and scenarios remain.
    fn give_up_on(&self, session: &Session, trouble: &ScenarioError) {
        self.reporter.tell(Event::SimulatorGone {
            simulator: session.name(),
        });
        lock(&self.tally).last_simulator_failure = Some(format!("{}: {trouble}", session.name()));
    }

    fn is_storage_failure(&self, error: &dataset::Error) -> bool {
        space::is_storage_failure(error, self.work.corpus.root())
    }

    fn storage(&self, error: &dataset::Error) -> Stopped {
        let root = self.work.corpus.root();
        let needed = room_bytes(&self.work.plan.common, lock(&self.queue).left());
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
            () = self.halt.cancelled() => {}
            () = tokio::time::sleep(pause) => {}
        }
    }
}
