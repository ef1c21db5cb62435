//! Simulators that are away: waited for, restarted by the user's command, given up.

use std::time::Duration;

use super::attempt::unless_cancelled;
use super::{Run, Then};
use crate::generate::error::ScenarioError;
use crate::generate::outcome::Stopped;
use crate::generate::session::Session;
use crate::generate::session::restart::Restart;
use crate::plan::counted;

/// A simulator that was restarted this often without recording a scenario is given up.
const MAX_RESTARTS_IN_VAIN: u32 = 3;

impl Run<'_> {
    /// Decides about a simulator that had trouble when the run began.
    pub(super) async fn take_over_with(
        &self,
        session: &mut Session,
        trouble: &ScenarioError,
    ) -> Then {
        if trouble.is_setup() {
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
        match self.until_back(session, self.patience.simulator).await {
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

    /// Runs the user's command and waits until the simulator can be used. A command that failed may have left the old one running.
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
        let mut running = None;
        let commanded = async {
            let command = running.insert(restart.start(&name)?);
            command.ended(self.patience.simulator).await
        };
        let restarted = async { Ok::<_, ScenarioError>(commanded.await) };
        let limit = match unless_cancelled(&self.tally.halt, restarted).await {
            // The command goes on: half a restart would be worse.
            Err(_) => return Then::Leave,
            Ok(Ok(())) => self.patience.simulator,
            Ok(Err(error)) => {
                let line = format!("simulator {name} was not restarted: {error}");
                self.reporter.warn(&line);
                Duration::ZERO
            }
        };
        match self.until_back(session, limit).await {
            Ok(()) => {
                self.reporter.say(&format!("simulator {name} is back"));
                Then::GoOn
            }
            Err(ScenarioError::Cancelled) => Then::Leave,
            Err(last) => {
                if let Some(running) = running {
                    running.kill();
                }
                self.give_up_on(
                    session,
                    trouble.filter(|_| !last.is_setup()).unwrap_or(&last),
                );
                Then::Leave
            }
        }
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
