//! The stand-in simulator as a child process.

use std::ffi::OsString;
use std::net::SocketAddr;
use std::path::Path;
use std::process::Stdio;
use std::time::Duration;

use futures_util::future::BoxFuture;
use serde::Deserialize;
use tokio::io::{AsyncBufReadExt, BufReader};
use tokio::process::{Child, ChildStdout, Command};
use tokio::time::timeout;

/// Timeout for the first line; an idle machine needs 0.1 s.
const READY_WITHIN: Duration = Duration::from_secs(20);

/// A stand-in simulator that runs while this value lives.
#[derive(Debug)]
pub struct StandIn {
    child: Child,
    address: SocketAddr,
    /// Kept open: a process that writes into a closed pipe dies.
    _stdout: BufReader<ChildStdout>,
}

/// Reason why the stand-in does not run.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct StandInError(String);

/// Relevant part of the stand-in's ready message.
#[derive(Deserialize)]
struct ReadyLine {
    udp: SocketAddr,
}

/// Stand-in's task.
#[derive(Debug, Clone, Copy)]
pub enum StandInTask<'a> {
    /// A simulator without delays.
    Simulate,
    /// A simulator with all awkward habits of live X-Planes.
    BeAwkward,
    /// A simulator without delays, with a window of this width and height in pixels that shows the images.
    Show((u32, u32)),
    /// A replay of the answers on a tape.
    Play(&'a Path),
}

impl StandInTask<'_> {
    /// The arguments for `dtd mock-xplane`.
    fn arguments(self) -> Vec<OsString> {
        match self {
            Self::Simulate => vec!["--quirks=none".into()],
            Self::BeAwkward => vec!["--quirks=all".into()],
            Self::Show((width, height)) => vec![
                "--quirks=none".into(),
                format!("--window={width}x{height}").into(),
            ],
            Self::Play(tape) => vec!["--tape".into(), tape.into()],
        }
    }
}

impl StandIn {
    /// Starts `program mock-xplane` on free ports for a task and waits until it is ready.
    pub fn start<'a>(
        program: &'a Path,
        task: StandInTask<'a>,
    ) -> BoxFuture<'a, Result<Self, StandInError>> {
        Box::pin(async move {
            let name = format!("the stand-in simulator, {} mock-xplane,", program.display());
            let failed =
                |error: std::io::Error| StandInError(format!("{name} cannot be started: {error}"));
            let mut child = Command::new(program)
                // Its standard input ends with this process, even if this process is killed: no stand-in is left behind.
                .args(["mock-xplane", "--port", "0", "--until-stdin-ends"])
                .args(task.arguments())
                .stdin(Stdio::piped())
                .stdout(Stdio::piped())
                .kill_on_drop(true)
                // Ctrl-C in a terminal goes to the whole group: the stand-in must survive until we have stopped cleanly.
                .process_group(0)
                .spawn()
                .map_err(failed)?;
            let stdout = child
                .stdout
                .take()
                .ok_or_else(|| failed(std::io::ErrorKind::BrokenPipe.into()))?;
            let mut stdout = BufReader::new(stdout);
            let mut line = String::new();
            let read = timeout(READY_WITHIN, stdout.read_line(&mut line)).await;
            let not_ready = |found: String| {
                StandInError(format!("{name} did not print its addresses: {found}"))
            };
            match read {
                Err(_) => return Err(not_ready(format!("nothing within {READY_WITHIN:?}"))),
                Ok(Err(error)) => return Err(not_ready(error.to_string())),
                Ok(Ok(0)) => return Err(not_ready("it ended at once".into())),
                Ok(Ok(_)) => {}
            }
            let ready: ReadyLine = serde_json::from_str(&line)
                .map_err(|error| not_ready(format!("{error} in {}", line.trim())))?;
            Ok(Self {
                child,
                address: ready.udp,
                _stdout: stdout,
            })
        })
    }

    /// UDP address.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    pub(crate) fn is_running(&mut self) -> bool {
        matches!(self.child.try_wait(), Ok(None))
    }

    /// Ends it and waits until it is gone.
    pub fn stop(mut self) -> BoxFuture<'static, ()> {
        Box::pin(async move {
            if let Err(error) = self.child.kill().await {
                tracing::debug!(%error, "the stand-in had ended already");
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_program_that_is_not_there_or_no_stand_in_is_named() {
        let error = StandIn::start(Path::new("/no/such/dtd"), StandInTask::Simulate)
            .await
            .unwrap_err();
        assert!(error.to_string().contains("/no/such/dtd"), "{error}");
        let error = StandIn::start(Path::new("true"), StandInTask::Simulate)
            .await
            .unwrap_err();
        assert!(error.to_string().contains("ended at once"), "{error}");
        let error = StandIn::start(Path::new("echo"), StandInTask::Simulate)
            .await
            .unwrap_err();
        assert!(
            error.to_string().contains("mock-xplane --port 0"),
            "{error}"
        );
    }
}
