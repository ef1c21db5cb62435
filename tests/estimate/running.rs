//! A `dtd estimate` at work.

use std::io::{BufRead, BufReader};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread;
use std::time::Duration;

use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

use crate::workshop::VIEWS;

/// No test takes longer.
const MAX_TIME: Duration = Duration::from_secs(150);

pub(crate) struct Running {
    pub(crate) child: Child,
    lines: Option<BufReader<ChildStdout>>,
    /// The watchdog ends with it.
    _alive: Sender<()>,
}

impl Running {
    pub(crate) fn start(command: &mut Command) -> Self {
        let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
        let lines = BufReader::new(child.stdout.take().unwrap());
        let pid = Pid::from_child(&child);
        let (alive, is_over) = channel::<()>();
        thread::spawn(move || {
            if is_over.recv_timeout(MAX_TIME) == Err(RecvTimeoutError::Timeout) {
                // Whoever waits for its lines then sees that it ended.
                let _ = kill_process(pid, Signal::KILL);
            }
        });
        Self {
            child,
            lines: Some(lines),
            _alive: alive,
        }
    }

    /// Takes the output, for a different reader.
    pub(crate) fn take_output(&mut self) -> BufReader<ChildStdout> {
        self.lines.take().unwrap()
    }

    pub(crate) fn next(&mut self) -> Value {
        let mut line = String::new();
        let read = self.lines.as_mut().unwrap().read_line(&mut line).unwrap();
        assert!(read > 0, "it ended");
        serde_json::from_str(&line).unwrap()
    }

    /// Reads on until both views have been in this state; returns all lines.
    pub(crate) fn until_both(&mut self, state: &str) -> String {
        let mut missing: Vec<&str> = VIEWS.to_vec();
        let mut said = String::new();
        while !missing.is_empty() {
            let line = self.next();
            if line["event"] == "view" && line["state"] == state {
                missing.retain(|view| line["view"] != *view);
            }
            said += &line.to_string();
        }
        said
    }

    pub(crate) fn last(&mut self) -> Value {
        let mut last = Value::Null;
        for line in self.take_output().lines() {
            last = serde_json::from_str(&line.unwrap()).unwrap();
        }
        last
    }

    pub(crate) fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.child), signal).unwrap();
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
