//! A stand-in with our plugin in a separate process, as a user starts it, and `dtd` commands that use it.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{BufRead, BufReader};
use std::net::{SocketAddr, UdpSocket};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use mock_xplane::server::Addresses;
use tempfile::TempDir;
use xplane_bridge::LINK_TOKEN_VARIABLE;

use super::xvfb::Xvfb;

/// The folder of our plugin.
pub(crate) const PLUGIN: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/xplane-bridge/plugin");
/// The sweep of these tests.
pub(crate) const SWEEP: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/awkward/sweep.toml");
/// Size of its pictures.
const WINDOW: &str = "96x64";
/// How much faster than real time the simulator's clock runs: a minute of waiting takes three seconds.
const CLOCK_RATE: &str = "20";

/// Timeout of everything, on however busy a machine.
pub(crate) const PATIENCE: Duration = Duration::from_secs(120);

/// Runs while this value lives.
pub(crate) struct Simulator {
    process: Child,
    addresses: Addresses,
    /// X-Plane 12's pictures are available only off the screen.
    screen: Option<Xvfb>,
    folder: TempDir,
    /// The token of its link; none if it is empty.
    token: String,
}

impl Simulator {
    /// An X-Plane of a generation, 11 or 12, with some habits, or its default ones, and with a plugin.
    pub(crate) fn start(xplane: &str, quirks: Option<&str>, plugin: &Path) -> Self {
        Self::start_with_token(xplane, quirks, plugin, "")
    }

    /// The same with a link that requires a token, unless that is empty.
    pub(crate) fn start_with_token(
        xplane: &str,
        quirks: Option<&str>,
        plugin: &Path,
        token: &str,
    ) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let screen = (xplane == "12").then(|| Xvfb::start("96x64x24"));
        let mut command = Command::new(env!("CARGO_BIN_EXE_dtd"));
        command
            .args(["mock-xplane", "--port", "0", "--until-stdin-ends"])
            .args(["--no-beacon", "--clock-rate", CLOCK_RATE])
            .args(["--xplane", xplane, "--plugin"])
            .arg(plugin)
            .args(quirks.map(|quirks| format!("--quirks={quirks}")));
        match &screen {
            Some(screen) => command
                .args(["--window", WINDOW])
                .env("DISPLAY", screen.display()),
            None => command.args(["--plugin-window", WINDOW]),
        };
        let log = File::create(folder.path().join("log")).unwrap();
        let mut process = command
            .env("RUST_LOG", "info")
            .env(LINK_TOKEN_VARIABLE, token)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(log)
            .spawn()
            .unwrap();
        let mut line = String::new();
        let stdout = process.stdout.take().unwrap();
        BufReader::new(stdout).read_line(&mut line).unwrap();
        let simulator = |addresses| Self {
            process,
            addresses,
            screen,
            folder,
            token: token.to_owned(),
        };
        match serde_json::from_str(&line) {
            Ok(addresses) => simulator(addresses).with_its_plugin(),
            Err(error) => panic!("{error} in {line:?}"),
        }
    }

    /// Waits until the plugin serves the capture link: its Python takes seconds to start on a busy machine, and `dtd` waits for five.
    fn with_its_plugin(self) -> Self {
        let mut request = b"RREF\0\x0a\0\0\0\0\0\0\0dtd/bridge/capture_port".to_vec();
        request.resize(413, 0);
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.connect(self.addresses.udp).unwrap();
        socket
            .set_read_timeout(Some(Duration::from_secs(1)))
            .unwrap();
        let began = Instant::now();
        let mut answer = [0; 13];
        while began.elapsed() < PATIENCE {
            socket.send(&request).unwrap();
            let came = socket
                .recv(&mut answer)
                .is_ok_and(|length| length == answer.len());
            let port = [answer[9], answer[10], answer[11], answer[12]];
            if came && f32::from_le_bytes(port) > 0.0 {
                return self;
            }
        }
        panic!("the plugin does not serve: {}", self.log());
    }

    /// Its UDP address.
    pub(crate) fn udp(&self) -> SocketAddr {
        self.addresses.udp
    }

    /// The display that its window is on; empty if it has none.
    pub(crate) fn display(&self) -> &str {
        self.screen.as_ref().map_or("", Xvfb::display)
    }

    /// A `dtd` verb that uses it.
    pub(crate) fn dtd<S: AsRef<OsStr>>(&self, arguments: &[S]) -> Command {
        let web_api = self.addresses.web_api;
        let mut command = Command::new(env!("CARGO_BIN_EXE_dtd"));
        command
            .args(arguments)
            .args(["--sim", &self.addresses.udp.to_string()])
            .env(
                "DTD_WEB_API",
                web_api.map_or("off".to_owned(), |address| address.to_string()),
            )
            .env(LINK_TOKEN_VARIABLE, &self.token)
            .env_remove("SLURM_ARRAY_TASK_ID")
            .env_remove("JOB_COMPLETION_INDEX");
        if let Some(screen) = &self.screen {
            command.env("DISPLAY", screen.display());
        }
        command
    }

    /// Records scenarios of the sweep, all of them if none is named, into a corpus.
    pub(crate) fn generate(&self, only: &str, corpus: &Path) -> Output {
        let corpus = corpus.to_str().unwrap();
        let mut command = self.dtd(&["-v", "generate", SWEEP, "--out", corpus]);
        if !only.is_empty() {
            command.args(["--only", only]);
        }
        command.output().unwrap()
    }

    /// A folder that a test may write to.
    pub(crate) fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// What it has logged.
    pub(crate) fn log(&self) -> String {
        fs::read_to_string(self.folder.path().join("log")).unwrap_or_default()
    }
}

impl Drop for Simulator {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// A command's output, for failing tests.
pub(crate) fn said(output: &Output) -> String {
    format!(
        "{}{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    )
}

/// A copy of the plugin with changes: in a file, a text is replaced.
pub(crate) fn plugin_with(folder: &Path, changes: &[(&str, &str, &str)]) -> PathBuf {
    let copy = folder.join("plugin");
    let package = copy.join("dtd_bridge");
    fs::create_dir_all(&package).unwrap();
    fs::copy(
        Path::new(PLUGIN).join("PI_dtd_bridge.py"),
        copy.join("PI_dtd_bridge.py"),
    )
    .unwrap();
    for entry in fs::read_dir(Path::new(PLUGIN).join("dtd_bridge")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension() == Some(OsStr::new("py")) {
            fs::copy(&path, package.join(path.file_name().unwrap())).unwrap();
        }
    }
    for (file, from, to) in changes {
        let path = package.join(file);
        let text = fs::read_to_string(&path).unwrap();
        assert!(text.contains(from), "{file} has no {from:?}");
        fs::write(path, text.replace(from, to)).unwrap();
    }
    copy
}
