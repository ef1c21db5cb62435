//! The user's command that restarts a simulator, which `dtd` cannot do itself: X-Plane is often started by a script, or on a second
//! computer.
//!
//! Input: a command line for `sh`, and the simulator's name in the environment variable [`SIMULATOR_VARIABLE`]. Output: exit status and
//! last output. The command is expected to end the old simulator, to start a new one in the background, and to end.
//!
//! The simulator that it starts must outlive `dtd`: the command runs in a separate process group, so that Ctrl-C does not reach it, and
//! writes into a file, because a program that writes into a closed pipe is killed.

use std::fs::File;
use std::io;
use std::num::NonZeroU32;
use std::os::unix::fs::FileExt;
use std::process::Stdio;
use std::time::Duration;

use rustix::process::{Pid, Signal, kill_process_group};
use tokio::process::{Child, Command};
use tokio::time::timeout;

use super::simulators::Simulators;
use crate::generate::error::GenerateError;
use crate::generate::session::SimulatorTarget;

/// The simulator to restart, as in `--sim`.
const SIMULATOR_VARIABLE: &str = "DTD_SIMULATOR";
/// Maximum logged output, bytes.
const OUTPUT_BYTES: u64 = 8 << 10;
/// Lines of output in an error message.
const LAST_LINES: usize = 3;

/// Restart command for simulators that are not started by `dtd`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Restart {
    /// A command line for `sh -c`.
    pub command: String,
    /// Live flights after which a simulator is restarted although it answers; never if absent.
    pub every: Option<NonZeroU32>,
}

/// Reason why a command did not restart a simulator.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(crate) struct RestartError(String);

impl RestartError {
    fn start(error: io::Error) -> Self {
        Self(format!(
            "cannot run `sh -c` for --restart-simulator: {error}"
        ))
    }
}

/// Checks that a command can restart the simulators; a tape has none, and stand-ins are restarted by `dtd` itself.
pub(crate) fn check(simulators: &Simulators) -> Result<(), GenerateError> {
    let targets = simulators.targets();
    let not_restartable = |target: &SimulatorTarget, why: &str| {
        GenerateError::BadInput(format!(
            "--restart-simulator: {target} {why}; the command is for an X-Plane that is named by HOST:PORT or `auto`"
        ))
    };
    let tape = targets
        .iter()
        .find(|target| matches!(target, SimulatorTarget::Tape(_)));
    if let Some(tape) = tape {
        return Err(not_restartable(tape, "is a recording, which never ends"));
    }
    if targets.iter().any(SimulatorTarget::runs_already) {
        Ok(())
    } else {
        Err(not_restartable(
            &SimulatorTarget::StandIn,
            "is started, and started again, by dtd itself",
        ))
    }
}

/// A command that was started.
pub(crate) struct Running {
    child: Child,
    output: File,
}

impl Restart {
    pub(crate) fn start(&self, simulator: &str) -> Result<Running, RestartError> {
        let output = tempfile::tempfile().map_err(RestartError::start)?;
        let copy = || output.try_clone().map_err(RestartError::start);
        let child = Command::new("sh")
            .args(["-c", &self.command])
            .env(SIMULATOR_VARIABLE, simulator)
            .stdin(Stdio::null())
            .stdout(copy()?)
            .stderr(copy()?)
            .process_group(0)
            .spawn()
            .map_err(RestartError::start)?;
        Ok(Running { child, output })
    }
}

impl Running {
    /// Waits for the end of the command, and logs its output.
    pub(crate) async fn ended(&mut self, limit: Duration) -> Result<(), RestartError> {
        let ended = timeout(limit, self.child.wait()).await;
        let output = self.output();
        for line in output.lines() {
            tracing::info!(line, "--restart-simulator");
        }
        match ended {
            Ok(Ok(status)) if status.success() => Ok(()),
            Ok(Ok(status)) => Err(RestartError(format!(
                "the command of --restart-simulator ended with {status}, expected exit status 0; its last output: {}",
                last_lines(&output)
            ))),
            Ok(Err(error)) => Err(RestartError::start(error)),
            Err(_) => Err(RestartError(format!(
                "the command of --restart-simulator still runs after {:.1} s; let it start X-Plane in the background (`&`, or `start` on \
                 Windows); its last output: {}",
                limit.as_secs_f64(),
                last_lines(&output)
            ))),
        }
    }

    /// Kills a command that does not end, with all processes that it started. The simulator that an ended one has started goes on.
    pub(crate) fn kill_if_it_runs(mut self) {
        if matches!(self.child.try_wait(), Ok(None)) {
            self.kill();
        }
    }

    fn kill(&self) {
        let group = self.child.id().and_then(|id| Pid::from_raw(id as i32));
        if let Some(group) = group
            && let Err(error) = kill_process_group(group, Signal::KILL)
        {
            tracing::warn!(%error, "the command of --restart-simulator could not be ended");
        }
    }

    fn output(&self) -> String {
        let length = self.output.metadata().map_or(0, |found| found.len());
        let from = length.saturating_sub(OUTPUT_BYTES);
        let mut bytes = vec![0; (length - from) as usize];
        let read = self.output.read_at(&mut bytes, from).unwrap_or(0);
        String::from_utf8_lossy(&bytes[..read]).into_owned()
    }
}

fn last_lines(output: &str) -> String {
    let lines: Vec<&str> = output.lines().map(str::trim_end).collect();
    match lines.as_slice() {
        [] => "none".into(),
        lines => lines[lines.len().saturating_sub(LAST_LINES)..].join(" / "),
    }
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use super::*;

    fn start(command: &str) -> Running {
        let restart = Restart {
            command: command.into(),
            every: None,
        };
        restart.start("127.0.0.1:49000").unwrap()
    }

    const LONG: Duration = Duration::from_secs(60);

    #[tokio::test]
    async fn a_command_gets_the_simulator_and_is_given_to_a_shell() {
        let mut command = start("test \"$DTD_SIMULATOR\" = 127.0.0.1:49000 && echo 'it is' >&2");
        command.ended(LONG).await.unwrap();
        assert_eq!(command.output(), "it is\n");
    }

    #[tokio::test]
    async fn a_command_that_fails_is_reported_with_its_last_output() {
        let mut command = start("for n in 1 2 3 4; do echo line $n; done; exit 7");
        let error = command.ended(LONG).await.unwrap_err().to_string();
        assert!(
            error.contains("exit status: 7") && error.contains("line 2 / line 3 / line 4"),
            "{error}"
        );
        let error = start("no-such-command-here").ended(LONG).await;
        let error = error.unwrap_err().to_string();
        assert!(error.contains("127"), "{error}");
    }

    #[tokio::test]
    async fn what_a_command_leaves_in_the_background_is_not_waited_for_and_can_write_on() {
        let folder = tempfile::tempdir().unwrap();
        let written = folder.path().join("written");
        let line = format!(
            "(sleep 0.3; echo more && echo done >{}) & echo started",
            written.display()
        );
        let mut command = start(&line);
        command.ended(LONG).await.unwrap();
        drop(command);
        let began = Instant::now();
        while !written.exists() {
            assert!(began.elapsed() < LONG, "it was ended");
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    }

    #[tokio::test]
    async fn a_command_that_never_ends_is_reported_and_can_be_ended_with_all_that_it_started() {
        let mut command = start("echo waiting; sleep 1000 & wait");
        let error = command.ended(Duration::from_millis(300)).await;
        let error = error.unwrap_err().to_string();
        assert!(
            error.contains("still runs") && error.contains("waiting"),
            "{error}"
        );
        command.kill();
        let ended = command.ended(LONG).await.unwrap_err().to_string();
        assert!(ended.contains("ended with"), "{ended}");
    }

    #[test]
    fn only_a_simulator_that_somebody_else_starts_is_restarted() {
        let check = |text: &str| check(&text.parse().unwrap()).map_err(|error| error.to_string());
        assert_eq!(check("auto"), Ok(()));
        assert_eq!(check("mock,127.0.0.1:49000"), Ok(()));
        assert!(check("mock:2").unwrap_err().contains("by dtd itself"));
        let tape = concat!(
            "127.0.0.1:49000,tape:",
            env!("CARGO_MANIFEST_DIR"),
            "/../tests/data/tape/session.mcap"
        );
        assert!(check(tape).unwrap_err().contains("is a recording"));
    }
}
