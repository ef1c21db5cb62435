//! A stand-in with our plugin in a separate process, as a user starts it, and `dtd` commands that use it.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::net::{SocketAddr, UdpSocket};
use std::path::Path;
use std::process::{Command, Output};
use std::time::{Duration, Instant};

use tempfile::TempDir;
use testkit::command::{Dtd, Server};
use xplane_bridge::LINK_TOKEN_VARIABLE;

use crate::Xvfb;

/// The sweep that fits its window.
pub const SWEEP: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../tests/awkward/sweep.toml"
);
/// Image size.
const WINDOW: &str = "96x64";
/// Speed of the simulator's clock relative to real time: a minute of waiting takes three seconds.
const CLOCK_RATE: &str = "20";

/// Timeout of everything, on however busy a machine.
pub const PATIENCE: Duration = Duration::from_secs(120);

/// Runs while this value lives.
#[derive(Debug)]
pub struct SimulatorProcess {
    dtd: Dtd,
    server: Server,
    /// X-Plane 12's images are available only off the screen.
    screen: Option<Xvfb>,
    folder: TempDir,
    /// Link token; none if empty.
    token: String,
}

impl SimulatorProcess {
    /// Starts X-Plane 11 or 12 with these quirks, or its default ones, and a plugin.
    pub fn start(dtd: Dtd, xplane: &str, quirks: Option<&str>, plugin: &Path) -> Self {
        Self::start_with_token(dtd, xplane, quirks, plugin, "")
    }

    /// [`SimulatorProcess::start`] with a link that requires a token, unless that is empty.
    pub fn start_with_token(
        dtd: Dtd,
        xplane: &str,
        quirks: Option<&str>,
        plugin: &Path,
        token: &str,
    ) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let screen = (xplane == "12").then(|| Xvfb::start("96x64x24"));
        let mut command = dtd.command(&["mock-xplane", "--port", "0", "--until-stdin-ends"]);
        command
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
        command
            .env("RUST_LOG", "info")
            .env(LINK_TOKEN_VARIABLE, token)
            .stderr(log);
        let simulator = Self {
            dtd,
            server: Server::start(&mut command),
            screen,
            folder,
            token: token.to_owned(),
        };
        simulator.wait_for_its_plugin();
        simulator
    }

    /// Waits until the plugin serves the capture link: its Python takes seconds to start on a busy machine, and `dtd` waits for five.
    fn wait_for_its_plugin(&self) {
        let mut request = b"RREF\0\x0a\0\0\0\0\0\0\0dtd/bridge/capture_port".to_vec();
        request.resize(413, 0);
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket
            .set_read_timeout(Some(Duration::from_secs(1)))
            .unwrap();
        let began = Instant::now();
        let mut answer = [0; 13];
        while began.elapsed() < PATIENCE {
            socket.send_to(&request, self.udp()).unwrap();
            let came = socket
                .recv(&mut answer)
                .is_ok_and(|length| length == answer.len());
            let port = [answer[9], answer[10], answer[11], answer[12]];
            if came && f32::from_le_bytes(port) > 0.0 {
                return;
            }
        }
        panic!("the plugin does not serve: {}", self.log());
    }

    /// UDP address.
    pub fn udp(&self) -> SocketAddr {
        self.server.address("udp")
    }

    /// The display that its window is on; empty if it has none.
    pub fn display(&self) -> &str {
        self.screen.as_ref().map_or("", Xvfb::display)
    }

    /// A `dtd` verb that uses it.
    pub fn dtd<S: AsRef<OsStr>>(&self, arguments: &[S]) -> Command {
        let web_api = match self.server.web_api() {
            "" => "off",
            address => address,
        };
        let mut command = self.dtd.command(arguments);
        command
            .args(["--sim", self.server.udp()])
            .env("DTD_WEB_API", web_api)
            .env(LINK_TOKEN_VARIABLE, &self.token);
        if let Some(screen) = &self.screen {
            command.env("DISPLAY", screen.display());
        }
        command
    }

    /// Records the named scenario of the sweep, or all if the name is empty.
    pub fn generate(&self, only: &str, corpus: &Path) -> Output {
        let corpus = corpus.to_str().unwrap();
        let mut command = self.dtd(&["-v", "generate", SWEEP, "--out", corpus]);
        if !only.is_empty() {
            command.args(["--only", only]);
        }
        command.output().unwrap()
    }

    /// A folder that a test may write to.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// The simulator's log.
    pub fn log(&self) -> String {
        fs::read_to_string(self.folder.path().join("log")).unwrap_or_default()
    }
}
