//! An RTSP server with a camera for each view (`tests/judges/rtsp_server.py`).

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};

use rustix::process::{Pid, Signal, kill_process};
use testkit::command::text;
use testkit::{repository, skipped};

/// Debian's Python, for which its GStreamer is built.
const PYTHON: &str = "/usr/bin/python3";

pub(crate) struct Server {
    child: Child,
    stdout: BufReader<ChildStdout>,
    port: String,
}

impl Server {
    /// Serves these cameras, `None` where there is no such server.
    pub(crate) fn start(options: &[&str], cameras: &[(&str, &Path)]) -> Option<Self> {
        let script = repository().join("tests/judges/rtsp_server.py");
        let cameras = cameras.iter();
        let child = Command::new(PYTHON)
            .arg(script)
            .args(options)
            .args(cameras.map(|(name, path)| format!("{name}={}", text(path))))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn();
        let mut child = match child {
            Ok(child) => child,
            Err(error) => {
                skipped(&format!("{PYTHON} does not start: {error}"));
                return None;
            }
        };
        let stdout = BufReader::new(child.stdout.take().unwrap());
        let mut server = Self {
            child,
            stdout,
            port: String::new(),
        };
        server.port = server.line();
        if server.port.is_empty() {
            skipped("there is no GStreamer with its RTSP server; scripts/setup.sh installs it");
            return None;
        }
        Some(server)
    }

    fn line(&mut self) -> String {
        let mut line = String::new();
        self.stdout.read_line(&mut line).unwrap();
        line.trim().into()
    }

    /// Waits until the videos are played; returns the UTC time, s.
    pub(crate) fn playing_s(&mut self) -> f64 {
        let line = self.line();
        line.strip_prefix("playing ").unwrap().parse().unwrap()
    }

    pub(crate) fn address(&self, camera: &str) -> String {
        format!("rtsp://127.0.0.1:{}/{camera}", self.port)
    }

    pub(crate) fn command(&mut self, command: &str) {
        let stdin = self.child.stdin.as_mut().unwrap();
        writeln!(stdin, "{command}").unwrap();
    }

    pub(crate) fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.child), signal).unwrap();
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
