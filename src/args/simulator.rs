//! Arguments of the verbs around the simulator.

use std::net::IpAddr;
use std::path::PathBuf;

use clap::{Args, ValueEnum};
use mock_xplane::quirks::Quirks;
use mock_xplane::server::Faults;
use xplane_bridge::WebApiPlace;
use xplane_bridge::datarefs::Generation;

use crate::args::shared::choice::{choice, size};
use crate::args::shared::local_udp::LocalUdpArgs;
use crate::args::shared::output::Output;

#[derive(Debug, Args)]
pub(crate) struct InstallPluginArgs {
    /// The installation folder of X-Plane 11 or 12
    #[arg(value_name = "XPLANE_FOLDER")]
    pub(crate) folder: PathBuf,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct MockXplaneArgs {
    /// Address to listen on
    #[arg(long, default_value = "127.0.0.1")]
    pub(crate) bind: IpAddr,
    /// UDP port; 0 takes any free one
    ///
    /// The addresses are printed as one JSON line when it is ready.
    #[arg(long, default_value_t = 49000)]
    pub(crate) port: u16,
    /// X-Plane to imitate: versions, dataref names and weather handling differ
    #[arg(long, value_name = "VERSION", default_value = "12", value_parser = choice([("11", "", Generation::XPlane11), ("12", "", Generation::XPlane12)]))]
    pub(crate) xplane: Generation,
    /// TCP port of X-Plane 12's Web API; 0 takes any free one [default: 8086, or any if --port is 0]
    ///
    /// It listens on this computer only.
    #[arg(long)]
    pub(crate) web_port: Option<u16>,
    /// Send no beacon
    #[arg(long)]
    pub(crate) no_beacon: bool,
    /// Replay a session recorded with `dtd tape`. Everything but address and beacon is then as recorded
    #[arg(long, value_name = "FILE.mcap", conflicts_with_all = ["xplane", "faults", "quirks", "clock_rate"])]
    pub(crate) tape: Option<PathBuf>,
    /// Faults, e.g. loss=0.1,reorder=0.05,seed=7,freeze=10:2,restart=captures:20:3
    ///
    /// WHEN of freeze=WHEN[:FOR_S] and restart=WHEN[:DOWN_S] is seconds, frames:N or captures:N. Cameras, VIEW from 0:
    /// late=VIEW:MS[:AFTER_S], shake=VIEW:RMS_PX:HZ, stick=VIEW:SHARE, turn=VIEW:RIGHT_DEG:AFTER_S, tilt=VIEW:DOWN_DEG:AFTER_S,
    /// zoom=VIEW:PERCENT:AFTER_S (longer focal length), drift=VIEW:RIGHT_DEG:OVER_S (without end), source=VIEW:OTHER (shows what the camera
    /// of view OTHER sees). With --plugin and --window: swing=THINGS:PERIOD_S:PX:LEVELS (things of PX that swing, even in a pause), and
    /// shares of frames whose number is an earlier one (repeat), missing (vanish) or half drawn (half), or before which a driver shows the
    /// mean of two (insert). The process: cold=SECONDS (no answer for so long after its start), held=SECONDS (keeps its ports so long after
    /// its end), menu=yes (starts in the main menu, without plugins, until the Web API starts a flight), asks=FILE (asks for safe mode at a
    /// start after an unclean end, which FILE marks).
    #[arg(
        long,
        value_name = "FAULTS",
        default_value = "",
        hide_default_value = true
    )]
    pub(crate) faults: Faults,
    /// Awkward habits of live X-Planes to imitate
    ///
    /// All of this X-Plane version, none, quick (those that do not slow clients down), or names from docs/reference/quirks.md separated by
    /// commas; a - before a name excludes it, e.g. all,-late_clouds. With `all`, the first scenario takes minutes.
    #[arg(
        long,
        value_name = "all|none|quick|NAME,..",
        default_value = "all",
        allow_hyphen_values = true
    )]
    pub(crate) quirks: Quirks,
    /// Run the simulator's clock this many times faster than real time
    #[arg(long, value_name = "N", default_value = "1", value_parser = clock_rate)]
    pub(crate) clock_rate: f64,
    /// Show the images in a window on the X11 display named by DISPLAY
    ///
    /// For `dtd generate --pixels screen`.
    #[arg(
        long,
        value_name = "WIDTHxHEIGHT",
        num_args = 0..=1,
        default_missing_value = "1920x1280",
        value_parser = size
    )]
    pub(crate) window: Option<[u32; 2]>,
    /// Serve the capture link with the plugin in this folder, xplane-bridge/plugin
    ///
    /// Python runs it against a fake of XPPython3. Images come from --xplane 11, which can read them back, or off the screen with
    /// --window, whose size the plugin then sees.
    #[arg(long, value_name = "FOLDER")]
    pub(crate) plugin: Option<PathBuf>,
    /// Size of the window that the plugin sees: the images' size
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "1920x1280", value_parser = size)]
    pub(crate) plugin_window: [u32; 2],
    /// Rare states of X-Plane, for tests
    #[arg(
        long,
        value_enum,
        value_name = "STATE,..",
        value_delimiter = ',',
        hide = true,
        conflicts_with = "tape"
    )]
    pub(crate) state: Vec<MockState>,
    /// Stop when standard input ends, besides Ctrl-C and SIGTERM
    ///
    /// It then ends with its parent process, even if that is killed.
    #[arg(long)]
    pub(crate) until_stdin_ends: bool,
}

/// A state of the bundled simulator that a test asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum MockState {
    /// The main menu: the Web API has no datarefs until a flight is loaded.
    MainMenu,
    /// "Accept incoming connections" is off: UDP is ignored and the Web API answers 403.
    IncomingOff,
    /// The beacon has no name, as X-Plane 12 may send it.
    NamelessBeacon,
    /// Our plugin is not installed: no capture link, so no recording.
    NoPlugin,
}

fn clock_rate(text: &str) -> Result<f64, String> {
    let rate = text.parse::<f64>().ok();
    rate.filter(|rate| (1.0..=1_000.0).contains(rate))
        .ok_or_else(|| "expected 1 to 1000".into())
}

#[derive(Debug, Args)]
pub(crate) struct DoctorArgs {
    /// The simulator: X-Plane's UDP address [default: the address in its beacon, else 127.0.0.1:49000]
    #[arg(long, value_name = "auto|HOST:PORT")]
    pub(crate) sim: Option<String>,
    #[command(flatten)]
    pub(crate) local_udp: LocalUdpArgs,
    /// Address of X-Plane 12's Web API
    ///
    /// The default is DTD_WEB_API, else port 8086 if X-Plane runs on this computer.
    #[arg(long, value_name = "HOST:PORT|off")]
    pub(crate) web_api: Option<WebApiPlace>,
    /// The sweep to record, whose images must fit the window [default: demo.toml if it exists]
    #[arg(long, value_name = "SWEEP.toml")]
    pub(crate) sweep: Option<PathBuf>,
    /// Measure what users have reported differently, even if this installation has a profile
    #[arg(long)]
    pub(crate) measure: bool,
    /// Skip the measurements
    #[arg(long, conflicts_with = "measure")]
    pub(crate) no_measure: bool,
    /// Measure the open questions about X-Plane, with a landing, and write a report and a tape into this folder
    #[arg(long, value_name = "FOLDER", conflicts_with = "no_measure", value_parser = Output::Folder.parser())]
    pub(crate) first_hour: Option<PathBuf>,
    /// Shell command that restarts X-Plane, to measure at the end of the first hour whether it comes back
    #[arg(long, value_name = "COMMAND", requires = "first_hour")]
    pub(crate) restart_simulator: Option<String>,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct TapeArgs {
    /// The simulator: X-Plane's UDP address, `auto` for the X-Plane that announces itself, or the bundled simulator
    ///
    /// The bundled simulator (`mock:awkward` has all awkward habits of live X-Planes) runs as long as the recorder.
    #[arg(long, value_name = "auto|mock|HOST:PORT")]
    pub(crate) sim: String,
    #[command(flatten)]
    pub(crate) local_udp: LocalUdpArgs,
    /// The tape to write. An existing file is never overwritten
    #[arg(long, value_name = "FILE.mcap", value_parser = Output::NewFile.parser())]
    pub(crate) out: PathBuf,
    /// Address to listen on
    #[arg(long, default_value = "127.0.0.1")]
    pub(crate) bind: IpAddr,
    /// UDP port for the clients; 0 takes any free one
    ///
    /// The addresses are printed as one JSON line when it is ready.
    #[arg(long, default_value_t = 49100)]
    pub(crate) port: u16,
    /// Stop when standard input ends, besides Ctrl-C and SIGTERM
    #[arg(long)]
    pub(crate) until_stdin_ends: bool,
}
