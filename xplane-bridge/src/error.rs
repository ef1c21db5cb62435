//! Errors between us and a simulator, with remedies for the user.

pub(crate) mod causes;
pub(crate) mod peer_text;

use std::net::SocketAddr;
use std::time::Duration;

use dataset::corpus::effective_weather::WeatherDifference;

use crate::datarefs::{BadConditions, WeatherSource};
use crate::link::LinkError;
use crate::packet::PacketError;
use crate::pixels::PixelError;
use crate::simulator::BadWebApiPlace;

/// The first request on the capture link, in messages.
pub(crate) const HELLO: &str = "hello";

/// Failed request to the simulator.
#[derive(Debug, thiserror::Error)]
pub enum BridgeError {
    /// An environment variable has an invalid value.
    #[error("the environment variable {name} is {found:?}: {why}")]
    BadVariable {
        /// Name of the variable.
        name: &'static str,
        /// Value of the variable.
        found: String,
        /// Fault of the value, with the expected form.
        why: BadWebApiPlace,
    },
    /// No datagram came back over UDP.
    #[error(
        "no simulator answered at {address} (UDP) within {waited:.1?}{}. Is X-Plane running, is Settings > Network > \
         \"Accept incoming connections\" on, and is this its address? Without X-Plane, use the bundled simulator: --sim mock",
        if *.refused { ": no program listens on that port" } else { "" }
    )]
    NobodyAnswers {
        /// Address of the request.
        address: SocketAddr,
        /// Time waited.
        waited: Duration,
        /// True if its computer reported that the port is closed.
        refused: bool,
    },
    /// The local port that the user chose is not available.
    #[error(
        "cannot use UDP port {port} of this computer for the simulator's answers: {source}. Does another dtd or program use it? Choose another \
         one with --udp-port, or leave it out for any free port"
    )]
    LocalPort {
        /// The port.
        port: u16,
        /// Underlying error.
        r#source: std::io::Error,
    },
    /// No beacon was heard.
    #[error(
        "no simulator announced itself within {:.1} s. The beacon is multicast, which firewalls and other networks drop: \
         give the address, --sim HOST:PORT, e.g. --sim 127.0.0.1:49000. Without X-Plane, use the bundled simulator: --sim mock",
        waited.as_secs_f64()
    )]
    NobodyAnnounced {
        /// Time waited.
        waited: Duration,
    },
    /// Several simulators were heard.
    #[error(
        "several simulators announced themselves: {}. Say which: --sim HOST:PORT",
        .addresses.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
    )]
    SeveralAnnounced {
        /// UDP addresses of the simulators.
        addresses: Vec<SocketAddr>,
    },
    /// The port of the beacon is not available.
    #[error(
        "cannot listen for beacons on UDP port {port} of this computer: {source}. Another program uses it alone, or the system reserves it \
         (Windows, for Hyper-V: `netsh interface ipv4 show excludedportrange protocol=udp`). Give the simulator's address: --sim HOST:PORT"
    )]
    NoBeaconPort {
        /// The port.
        port: u16,
        /// Underlying error.
        r#source: std::io::Error,
    },
    /// This computer cannot receive multicast.
    #[error(
        "cannot listen to the beacon (multicast {}:{}): {source}. Give the address: --sim HOST:PORT",
        crate::packet::BEACON_GROUP,
        crate::packet::BEACON_PORT
    )]
    NoMulticast {
        /// Underlying error.
        r#source: std::io::Error,
    },
    /// The simulator draws ideal images only.
    #[error(
        "{simulator} draws images of ideal pinholes along straight lines, but view {view} is to have {wanted}. Only the bundled simulator \
         (--sim mock) can: take [imaging] and the cameras' distortion out of the sweep"
    )]
    NoImaging {
        /// Name of the simulator.
        simulator: String,
        /// Number of the view, from 0.
        view: usize,
        /// Property that it cannot draw, as named in the link.
        wanted: String,
    },
    /// The simulator is not the one that was set up.
    #[error(
        "the simulator at {address} was restarted: it runs for {found_s:.1} s, and ran for {before_s:.1} s before. What was set \
         is lost; connect again and repeat the settings"
    )]
    Restarted {
        /// Address of the simulator.
        address: SocketAddr,
        /// Running time last reported before, seconds.
        before_s: f32,
        /// Running time reported now, seconds.
        found_s: f32,
    },
    /// A confirmed setting has changed.
    #[error(
        "dataref {name} was set to {wanted} and confirmed, but {} now. Was the simulator restarted, or does another program \
         change it?", .found.map_or("does not answer".to_owned(), |value| format!("reads {value}"))
    )]
    SettingLost {
        /// Name of the dataref.
        name: String,
        /// The confirmed value.
        wanted: f32,
        /// The current value, if it answers.
        found: Option<f32>,
    },
    /// The frame on the screen never stayed until it was grabbed.
    #[error(
        "another view appeared in X-Plane each of the {grabs} times that a frame was grabbed off its window. Leave its keys and mouse alone, \
         switch off other plugins that move the camera, and run the same command again"
    )]
    ViewTaken {
        /// Number of grabs.
        grabs: u32,
    },
    /// Simulated time does not move.
    #[error(
        "no flight is on at {address}: simulated time did not move for {:.1} s, twice, and toggling the main menu did not help. Is Flight \
         Configuration, a menu or a question open in X-Plane? Start any flight, and run the same command again",
        waited.as_secs_f64()
    )]
    NotReady {
        /// Address of the simulator.
        address: SocketAddr,
        /// Duration of each wait.
        waited: Duration,
    },
    /// The wrong aircraft would be in the images.
    #[error(
        "the aircraft that is loaded is {found}, expected {wanted} ({path}): load it in X-Plane, and run the same command again"
    )]
    WrongAircraft {
        /// Type named by the sweep.
        wanted: &'static str,
        /// Type reported by X-Plane.
        found: String,
        /// File of the wanted one.
        path: &'static str,
    },
    /// An aircraft of the right type with impossible dimensions.
    #[error(
        "the aircraft that is loaded says that it is a {icao}, but is {found_m:.1} m large ({name}), expected about {expected_m:.1} m: ground-truth boxes \
         would not fit it. Load {path} in X-Plane, and run the same command again"
    )]
    WrongSize {
        /// Dataref of the dimension.
        name: &'static str,
        /// The type.
        icao: &'static str,
        /// Dimension of the loaded aircraft, metres.
        found_m: f64,
        /// Dimension of the type, metres.
        expected_m: f64,
        /// Aircraft file with the right dimensions.
        path: &'static str,
    },
    /// The aircraft is not where a flight should begin.
    #[error(
        "the aircraft was put to {wanted_latitude_deg:.4}, {wanted_longitude_deg:.4} {attempts} times ({by}), but {}",
        .found.map_or("its position never came (RPOS)".to_owned(), |(latitude, longitude)| format!("is at {latitude:.4}, {longitude:.4}"))
    )]
    NotPlaced {
        /// Way of placing it.
        by: &'static str,
        /// Number of attempts to place it.
        attempts: u32,
        /// Requested latitude, degrees.
        wanted_latitude_deg: f64,
        /// Requested longitude, degrees.
        wanted_longitude_deg: f64,
        /// Actual latitude and longitude, if known.
        found: Option<(f64, f64)>,
    },
    /// Scenery does not finish loading.
    #[error(
        "X-Plane has been loading scenery for {waited:.0?} (dataref {} is not 0). Look for a message in X-Plane, start any flight, and run the \
         same command again",
        crate::datarefs::SCENERY_LOADING
    )]
    StillLoading {
        /// Since the flight was requested.
        waited: Duration,
    },
    /// The Web API failed.
    #[error(transparent)]
    WebApi(#[from] crate::web_api::WebApiError),
    /// X-Plane is there but cannot capture.
    #[error(
        "X-Plane answers at {address} but offers no capture link: dataref {} is missing or 0 after {waited:.1?}. Put \
         our plugin into Resources/plugins/PythonPlugins (dtd install-plugin XPLANE_DIR) and restart X-Plane, or use the \
         bundled simulator: --sim mock",
        crate::datarefs::CAPTURE_PORT
    )]
    NoPlugin {
        /// Address of the request.
        address: SocketAddr,
        /// Time waited.
        waited: Duration,
    },
    /// The capture link could not be opened.
    #[error(
        "cannot open the capture link at {address} (TCP), which the simulator announced: {source}. Is a firewall between?"
    )]
    CannotOpenLink {
        /// Expected address of the link.
        address: SocketAddr,
        /// Underlying error.
        r#source: std::io::Error,
    },
    /// A socket of our own failed.
    #[error("cannot use UDP towards {address}: {source}")]
    Udp {
        /// The simulator's address.
        address: SocketAddr,
        /// Underlying error.
        r#source: std::io::Error,
    },
    /// A packet could not be made.
    #[error(transparent)]
    Packet(#[from] PacketError),
    /// The capture link broke or the other side does not speak its protocol.
    #[error("capture link, while waiting for {doing}: {source}")]
    Link {
        /// The expected message.
        doing: &'static str,
        /// Underlying error.
        r#source: LinkError,
    },
    /// No answer over the capture link.
    #[error(
        "the simulator did not answer over the capture link within {:.1} s, while waiting for {doing}",
        waited.as_secs_f64()
    )]
    LinkTimeout {
        /// The expected message.
        doing: &'static str,
        /// Time waited.
        waited: Duration,
    },
    /// An earlier failure left the link between two messages.
    #[error("the capture link was closed after an earlier failure; connect again")]
    LinkClosed,
    /// The simulator rejected the request.
    #[error("the simulator refused {doing}: {text}")]
    Refused {
        /// The request.
        doing: &'static str,
        /// Text of the refusal.
        text: String,
        /// True if the simulator reports that the same request would be refused again.
        repeats: bool,
    },
    /// The simulator gave an unexpected answer.
    #[error("capture link: expected {expected}, found {found}")]
    WrongAnswer {
        /// The expected answer.
        expected: String,
        /// The answer received.
        found: String,
    },
    /// Too many captures were requested.
    #[error(
        "{outstanding} captures are outstanding, which is the most the capture link holds: receive a frame first"
    )]
    TooManyOutstanding {
        /// Number of outstanding captures.
        outstanding: usize,
    },
    /// A frame awaited without a request.
    #[error("no capture is outstanding: send one before receiving a frame")]
    NothingOutstanding,
    /// Images are unavailable, or cannot be trusted.
    #[error(transparent)]
    Pixels(#[from] PixelError),
    /// Conditions that X-Plane cannot have.
    #[error(transparent)]
    BadConditions(#[from] BadConditions),
    /// A dataref that does not accept its value.
    #[error(
        "dataref {name} was written {attempts} times as {wanted}, but {}. Does another plugin or a real-weather setting \
         hold it?", .found.map_or("never answered".to_owned(), |value| format!("reads {value}"))
    )]
    NotTaken {
        /// Name of the dataref.
        name: String,
        /// Number of writes.
        attempts: u32,
        /// The written value.
        wanted: f32,
        /// The value read back, if any.
        found: Option<f32>,
    },
    /// The written weather reads back, but it is not the weather at the aircraft.
    #[error(
        "the weather at the aircraft is not what was set: {difference}, for {:.1} s, although what was written reads back and `dtd doctor` \
         measured that this quantity follows. Set the weather to manual and static in X-Plane, switch off other weather plugins, and run the same \
         command again; if X-Plane or its plugins have changed since, measure again with `dtd doctor --measure`",
        waited.as_secs_f64()
    )]
    OtherWeatherShows {
        /// The difference.
        difference: WeatherDifference,
        /// Time allowed for it.
        waited: Duration,
    },
    /// A command without its effect.
    #[error(
        "command {command} was sent {attempts} times, but dataref {name} {}, expected {wanted}. Close menus and dialogs in X-Plane, and run no \
         other plugin that undoes it",
        .found.map_or("never answered".to_owned(), |value| format!("reads {value}"))
    )]
    CommandWithoutEffect {
        /// Name of the command.
        command: String,
        /// Number of times it was sent.
        attempts: u32,
        /// The dataref that shows its effect.
        name: String,
        /// Expected value.
        wanted: f32,
        /// Current value, if the simulator answers.
        found: Option<f32>,
    },
    /// The requested weather does not arrive.
    #[error(
        "the weather does not become what was set: {name} was set to {wanted}, but {} {patience:?} later, although it was written once more \
         and given as long again. X-Plane 12 keeps old clouds for up to a minute and lets temperatures slide for some; longer means that {}. \
         Set the weather to manual and static in X-Plane, switch off other weather plugins, and run the same command again",
        .found.map_or("does not answer".to_owned(), |value| format!("reads {value}")),
        maker(*.made_by)
    )]
    WeatherNotTaken {
        /// Name of the dataref.
        name: String,
        /// The written value.
        wanted: f32,
        /// The current value, if it answers.
        found: Option<f32>,
        /// Time waited after each write.
        patience: Duration,
        /// The source of the weather, according to X-Plane.
        made_by: Option<WeatherSource>,
    },
}

impl BridgeError {
    /// True if every request to this simulator would fail until somebody changes its settings, the sweep or this computer.
    pub fn is_setup(&self) -> bool {
        match self {
            Self::BadVariable { .. }
            | Self::NoPlugin { .. }
            | Self::NoImaging { .. }
            | Self::WrongAircraft { .. }
            | Self::WrongSize { .. } => true,
            Self::Refused { doing, repeats, .. } => *repeats && *doing == HELLO,
            Self::Link { source, .. } => matches!(source, LinkError::OtherSide(_)),
            Self::Pixels(error) => error.is_setup(),
            _ => false,
        }
    }
}

/// The cause that keeps the weather from changing.
fn maker(source: Option<WeatherSource>) -> &'static str {
    match source {
        Some(WeatherSource::Real) => "real weather is on (weather_source reads 1)",
        Some(WeatherSource::ControlPad) => "an instructor's pad sets it (weather_source reads 2)",
        Some(WeatherSource::Plugin) => "another plugin sets it (weather_source reads 3)",
        Some(WeatherSource::Preset) | None => "something holds it",
    }
}
