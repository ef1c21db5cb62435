//! An X server without a screen, for as long as a value lives.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};

/// A running Xvfb on a display number that nobody else has.
#[derive(Debug)]
pub struct Xvfb {
    server: Child,
    display: String,
}

impl Xvfb {
    /// Starts one with a screen of this size and form, e.g. `320x240x24`.
    pub fn start(screen: &str) -> Self {
        let mut server = Command::new("Xvfb")
            // It chooses a free number itself and writes it to standard output once it is ready.
            .args([
                "-displayfd",
                "1",
                "-screen",
                "0",
                screen,
                // Without clients it stays as it is.
                "-noreset",
                "-nolisten",
                "tcp",
            ])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("Xvfb is there (scripts/setup.sh installs it)");
        let mut number = String::new();
        let stdout = server.stdout.take().expect("its output is a pipe");
        BufReader::new(stdout)
            .read_line(&mut number)
            .expect("Xvfb says its display");
        assert!(
            !number.trim().is_empty(),
            "Xvfb did not start with {screen}"
        );
        let display = format!(":{}", number.trim());
        Self { server, display }
    }

    /// Display name, for `DISPLAY`.
    pub fn display(&self) -> &str {
        &self.display
    }
}

impl Drop for Xvfb {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}
