//! Simulators that are away: waited for, restarted by the user's command, given up.

use std::time::{Duration, Instant};

use super::attempt::unless_cancelled;
use super::{Run, Then};
use crate::generate::error::ScenarioError;
use crate::generate::outcome::Stopped;
use crate::generate::session::Session;
use crate::generate::session::restart::Restart;
use crate::plan::counted;

/// A simulator that was restarted this often without recording a scenario is given up.
const MAX_RESTARTS_IN_VAIN: u32 = 3;
/// Parts of the time limit: one before the first restart, and the others for the tries of it. X-Plane was seen to take five minutes to
/// start (PilotsDeck 167), and the default limit gives each try more.
const PARTS: u32 = 4;

impl Run<'_> {
    /// Decides about a simulator that had trouble when the run began.
    pub(super) async fn take_over_with(
        &self,
        session: &mut Session,
        trouble: &ScenarioError,
    ) -> Then {
        if trouble.is_bad_setup() {
            self.give_up_on(session, trouble);
            return Then::Leave;
        }
        self.wait_for(session, trouble).await
    }

    /// Waits for a simulator that caused trouble. Reports it only if it does not answer at once.
    pub(super) async fn wait_for(&self, session: &mut Session, trouble: &ScenarioError) -> Then {
        match self.until_back(session, Duration::ZERO).await {
            Ok(()) => return Then::GoOn,
            Err(ScenarioError::Cancelled) => return Then::Leave,
            Err(_) => {}
        }
        let name = session.name().to_owned();
        self.reporter.warn(&format!(
            "simulator {name} does not answer, waiting for it: {trouble}"
        ));
        let limit = match self.restart.filter(|_| session.runs_already()) {
            Some(_) => self.patience.simulator / PARTS,
            None => self.patience.simulator,
        };
        match self.until_back(session, limit).await {
            Ok(()) => {
                self.reporter.say(&format!("simulator {name} is back"));
                Then::GoOn
            }
            Err(ScenarioError::Cancelled) => Then::Leave,
            Err(last) if last.is_setup() => self.restart_or_give_up(session, &last).await,
            Err(_) => self.restart_or_give_up(session, trouble).await,
        }
    }

    /// Waits for a simulator up to a time; the error is [`ScenarioError::Cancelled`], or the last reason why it cannot be used.
    async fn until_back(
        &self,
        session: &mut Session,
        limit: Duration,
    ) -> Result<(), ScenarioError> {
        unless_cancelled(&self.tally.halt, session.come_back(limit)).await
    }

    /// Restarts a simulator that has flown as many live flights as the user allows, if there is still something to record.
    pub(super) async fn restart_if_due(&self, session: &mut Session) -> Then {
        let due = self
            .restart
            .filter(|_| session.runs_already() && self.queue().has_waiting())
            .filter(|restart| {
                let due = |every| session.live_flights >= u32::from(every);
                restart.every.is_some_and(due)
            });
        match due {
            Some(restart) => self.restart(session, restart, None).await,
            None => Then::GoOn,
        }
    }

    /// The last resort for a simulator that does not come back, or whose attempts keep failing.
    pub(super) async fn restart_or_give_up(
        &self,
        session: &mut Session,
        trouble: &ScenarioError,
    ) -> Then {
        match self.restart.filter(|_| session.runs_already()) {
            Some(restart) if session.restarts_in_vain < MAX_RESTARTS_IN_VAIN => {
                self.restart(session, restart, Some(trouble)).await
            }
            _ => {
                self.give_up_on(session, trouble);
                Then::Leave
            }
        }
    }

    /// Runs the user's command and waits until the simulator can be used, again and again until the time is up: the old simulator may
    /// hold its port for minutes, and a new one may ask something that only its end answers.
    async fn restart(
        &self,
        session: &mut Session,
        restart: &Restart,
        trouble: Option<&ScenarioError>,
    ) -> Then {
        let name = session.name().to_owned();
        self.reporter.say(&format!(
            "restarting simulator {name} after {}",
            counted(session.live_flights as usize, "live flight")
        ));
        session.leave_to_restart().await;
        let part = self.patience.simulator / PARTS;
        let until = Instant::now() + part * (PARTS - 1);
        loop {
            let last = match self.try_restart(session, restart, part).await {
                Ok(()) => {
                    self.reporter.say(&format!("simulator {name} is back"));
                    return Then::GoOn;
                }
                Err(ScenarioError::Cancelled) => return Then::Leave,
                Err(last) => last,
            };
            let is_other = matches!(last, ScenarioError::OtherSimulator { .. });
            if is_other || Instant::now() >= until {
                let trouble = trouble.filter(|_| !last.is_setup()).unwrap_or(&last);
                self.give_up_on(session, trouble);
                return Then::Leave;
            }
            self.reporter.warn(&format!(
                "simulator {name} is not back, restarting it again: {last}. If it runs, it may show a question (after an unclean end X-Plane \
                 asks whether to start in safe mode), or its start menu"
            ));
        }
    }

    /// Runs the command once; the error is [`ScenarioError::Cancelled`], or why the simulator cannot be used.
    async fn try_restart(
        &self,
        session: &mut Session,
        restart: &Restart,
        part: Duration,
    ) -> Result<(), ScenarioError> {
        let name = session.name().to_owned();
        let mut running = None;
        let commanded = async {
            let command = running.insert(restart.start(&name)?);
            command.ended(part).await
        };
        let restarted = async { Ok::<_, ScenarioError>(commanded.await) };
        // If the run is cancelled, the command goes on: half a restart would be worse.
        if let Err(error) = unless_cancelled(&self.tally.halt, restarted).await? {
            self.reporter
                .warn(&format!("simulator {name} was not restarted: {error}"));
        }
        let back = self.until_back(session, part).await;
        if let (Err(error), Some(running)) = (&back, running)
            && !matches!(error, ScenarioError::Cancelled)
        {
            running.kill_if_it_runs();
        }
        back
    }

    /// Giving up the last simulator ends the run: the workers have left, and scenarios remain.
    pub(super) fn give_up_on(&self, session: &Session, trouble: &ScenarioError) {
        let reason = format!("{}: {trouble}", session.name());
        self.reporter.warn(&format!("giving up simulator {reason}"));
        self.tally.gave_up_simulator(if trouble.is_setup() {
            Stopped::Setup { reason }
        } else {
            Stopped::NoSimulator { reason }
        });
    }
}
