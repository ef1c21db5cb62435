//! Errors between us and a simulator, with remedies for the user.

pub(crate) mod causes;
pub(crate) mod peer_text;

use std::fmt::Display;
use std::net::SocketAddr;
use std::time::Duration;

use dataset::corpus::effective_weather::WeatherDifference;

use crate::datarefs::BadConditions;
use crate::link::LinkError;
use crate::packet::PacketError;
use crate::pixels::PixelError;

/// The first request on the capture link, in messages.
pub(crate) const HELLO: &str = "hello";

/// Failed request to the simulator.
#[derive(Debug, thiserror::Error)]
pub enum BridgeError {
    /// The simulator, the sweep or this computer must be changed first: every scenario would fail.
    #[error("{0}")]
    Setup(String),
    /// The simulator is gone or was restarted, the conversation with it broke, or this computer cannot listen to it.
    #[error("{0}")]
    Failed(String),
    /// No flight is on, or it did not begin where it should.
    #[error("{0}")]
    NotReady(String),
    /// A dataref does not take its value, or a command has no effect on it.
    #[error("{text}")]
    NotTaken {
        /// Name of the dataref.
        name: String,
        /// The expected value.
        wanted: f32,
        /// The value read, if any.
        found: Option<f32>,
        /// Attempts, and what to do.
        text: String,
    },
    /// An environment variable has an invalid value.
    #[error("{0}")]
    BadVariable(String),
    /// No datagram came back over UDP.
    #[error("{}", no_answer(*.address, *.waited, *.silence))]
    NobodyAnswers {
        /// Address of the request.
        address: SocketAddr,
        /// Time waited.
        waited: Duration,
        /// Further findings.
        silence: Silence,
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
    /// Several simulators were heard.
    #[error(
        "several simulators announced themselves: {}. Say which: --sim HOST:PORT",
        .addresses.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
    )]
    SeveralAnnounced {
        /// UDP addresses of the simulators.
        addresses: Vec<SocketAddr>,
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
    /// A frame awaited without a request.
    #[error("no capture is outstanding: send one before receiving a frame")]
    NothingOutstanding,
    /// Images are unavailable, or cannot be trusted.
    #[error(transparent)]
    Pixels(#[from] PixelError),
    /// Conditions that X-Plane cannot have.
    #[error(transparent)]
    BadConditions(#[from] BadConditions),
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
}

/// Forms of silence over UDP.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Silence {
    /// No datagram came.
    Nothing,
    /// The simulator's computer reported that the port is closed.
    Refused,
    /// The simulator had answered before, and its capture link is closed.
    Ended,
}

fn no_answer(address: SocketAddr, waited: Duration, silence: Silence) -> String {
    let hint = match silence {
        Silence::Ended => {
            return format!(
                "the simulator at {address} has probably ended: its capture link is closed, and it did not answer over UDP within {waited:.1?}. \
                 Start it, and run the same command again"
            );
        }
        Silence::Refused => ": no program listens on that port",
        Silence::Nothing => "",
    };
    format!(
        "no simulator answered at {address} (UDP) within {waited:.1?}{hint}. Is X-Plane running, is Settings > Network > \
         \"Accept incoming connections\" on, and is this its address? Without X-Plane, use the bundled simulator: --sim mock"
    )
}

impl BridgeError {
    /// An answer over the capture link that was not expected.
    pub(crate) fn wrong_answer(expected: impl Display, found: impl Display) -> Self {
        Self::Failed(format!("capture link: expected {expected}, found {found}"))
    }

    /// True if every request to this simulator would fail until somebody changes its settings, the sweep or this computer.
    pub fn is_setup(&self) -> bool {
        match self {
            Self::Setup(_) | Self::BadVariable(_) | Self::NoPlugin { .. } => true,
            Self::Refused { doing, repeats, .. } => *repeats && *doing == HELLO,
            Self::Link { source, .. } => matches!(source, LinkError::OtherSide(_)),
            Self::Pixels(error) => error.is_setup(),
            _ => false,
        }
    }
}

/// A value that was read, or words for none.
pub(crate) fn reads(found: Option<f32>, none: &str) -> String {
    found.map_or_else(|| none.to_owned(), |value| format!("reads {value}"))
}
