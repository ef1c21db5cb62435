//! The `dtd` command, run to its end or as a server.

use std::ffi::OsStr;
use std::fs;
use std::io::{BufRead, BufReader};
use std::net::SocketAddr;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};

use serde_json::Value;
use tempfile::TempDir;

use crate::files::copy_folder;
use crate::repository;

/// The command under test: `Dtd::at(env!("CARGO_BIN_EXE_dtd"))`.
#[derive(Debug, Clone, Copy)]
pub struct Dtd(&'static str);

impl Dtd {
    /// The one that Cargo built for an integration test.
    pub const fn at(program: &'static str) -> Self {
        Self(program)
    }

    /// Path of the command.
    pub const fn program(self) -> &'static str {
        self.0
    }

    /// The command with these arguments, in the repository's root, without the environment of a scheduler that runs these tests.
    pub fn command(self, arguments: &[impl AsRef<OsStr>]) -> Command {
        let mut command = Command::new(self.0);
        command
            .args(arguments)
            .current_dir(repository())
            // Notes of clients that a test kills.
            .env("XDG_STATE_HOME", repository().join("target/state-of-tests"))
            .env_remove("SLURM_ARRAY_TASK_ID")
            .env_remove("JOB_COMPLETION_INDEX");
        command
    }

    /// Runs it to its end.
    pub fn run(self, arguments: &[impl AsRef<OsStr>]) -> Output {
        self.command(arguments).output().unwrap()
    }

    /// Runs a verb that must succeed.
    pub fn succeeds(self, arguments: &[impl AsRef<OsStr>]) -> Output {
        self.command(arguments).succeeds()
    }

    /// Runs a verb that must end with this exit code and print all of these words; returns everything that it printed.
    pub fn ends_with(self, arguments: &[impl AsRef<OsStr>], code: i32, words: &[&str]) -> String {
        self.command(arguments).ends_with(code, words)
    }

    /// Runs a verb that must succeed and returns what it prints as JSON.
    pub fn json(self, arguments: &[impl AsRef<OsStr>]) -> Value {
        json(&self.succeeds(arguments))
    }

    /// A folder with a sweep (`sweep.toml`, beside the recorded flights in `flights/`) and its recorded and labelled `corpus/`.
    pub fn recorded(self, sweep: &str) -> TempDir {
        let folder = tempfile::tempdir().unwrap();
        let flights = repository().join("tests/data/flights");
        copy_folder(&flights, &folder.path().join("flights"));
        fs::write(folder.path().join("sweep.toml"), sweep).unwrap();
        for arguments in [
            &["generate", "sweep.toml", "--out", "corpus"][..],
            &["label", "corpus"],
        ] {
            self.command(arguments)
                .current_dir(folder.path())
                .succeeds();
        }
        folder
    }

    /// Starts a verb that serves, on free ports.
    pub fn serve(self, arguments: &[impl AsRef<OsStr>]) -> Server {
        let mut command = self.command(arguments);
        Server::start(command.args(["--port", "0", "--until-stdin-ends"]))
    }
}

/// Runs a command to its end, which is checked.
pub trait Ending {
    /// Output of the command, which must succeed.
    fn succeeds(&mut self) -> Output;

    /// Everything that the command printed, which must end with this exit code and print all of these words: bad input, of exit code 2, is
    /// explained on standard error.
    fn ends_with(&mut self, code: i32, words: &[&str]) -> String;
}

impl Ending for Command {
    fn succeeds(&mut self) -> Output {
        let output = self.output().unwrap();
        assert!(output.status.success(), "{self:?}: {}", said(&output));
        output
    }

    fn ends_with(&mut self, code: i32, words: &[&str]) -> String {
        let output = self.output().unwrap();
        let said = said(&output);
        assert_eq!(output.status.code(), Some(code), "{self:?}: {said}");
        let errors = String::from_utf8_lossy(&output.stderr);
        let place = if code == 2 { &*errors } else { &*said };
        for word in words {
            assert!(place.contains(word), "{self:?}: no {word:?} in {said}");
        }
        said
    }
}

/// Standard output and standard error of a process, in this order.
pub fn said(output: &Output) -> String {
    format!(
        "{}{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    )
}

/// A process's output as JSON.
pub fn json(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", said(output)))
}

/// Splits a command line into words.
pub fn words(line: &str) -> Vec<&str> {
    line.split_whitespace().collect()
}

/// A path as an argument.
pub fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A process that serves until its standard input ends, and is killed with this value.
#[derive(Debug)]
pub struct Server {
    child: Child,
    ready: Value,
}

impl Server {
    /// Starts it, and waits for the line of JSON that it prints once it listens.
    pub fn start(command: &mut Command) -> Self {
        let mut child = command
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        let stdout = child.stdout.take().unwrap();
        BufReader::new(stdout).read_line(&mut line).unwrap();
        match serde_json::from_str(&line) {
            Ok(ready) => Self { child, ready },
            Err(error) => {
                let _ = child.kill();
                panic!("{error} in {line:?} of {command:?}")
            }
        }
    }

    /// Addresses by name, as printed.
    pub fn ready(&self) -> &Value {
        &self.ready
    }

    /// A named address.
    pub fn address(&self, name: &str) -> SocketAddr {
        self.text(name).parse().unwrap()
    }

    /// UDP address, as an argument.
    pub fn udp(&self) -> &str {
        self.text("udp")
    }

    /// Web API address, as an argument; empty for X-Plane 11.
    pub fn web_api(&self) -> &str {
        self.ready["web_api"].as_str().unwrap_or_default()
    }

    fn text(&self, name: &str) -> &str {
        let found = self.ready[name].as_str();
        found.unwrap_or_else(|| panic!("no {name:?} in {}", self.ready))
    }

    /// The child process, e.g. to send signals or to read its log.
    pub fn process(&mut self) -> &mut Child {
        &mut self.child
    }

    /// Ends it in good order.
    pub fn end(mut self) {
        let early = self.child.try_wait().unwrap();
        assert!(early.is_none(), "it ended by itself: {early:?}");
        drop(self.child.stdin.take());
        assert!(self.child.wait().unwrap().success());
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
