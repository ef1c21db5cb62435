//! What can go wrong between us and a simulator, with what a person can do about it.

use std::net::SocketAddr;
use std::time::Duration;

use crate::link::LinkError;
use crate::packet::PacketError;

/// Why the simulator could not be made to do something.
#[derive(Debug, thiserror::Error)]
pub enum BridgeError {
    /// Nothing came back over UDP.
    #[error(
        "no simulator answered at {address} (UDP) within {waited:.1?}. Is X-Plane running, is Settings > Network > \
         \"Accept incoming connections\" on, and is this its address? Without X-Plane, use the stand-in: --sim mock"
    )]
    NobodyAnswers {
        /// Where we asked.
        address: SocketAddr,
        /// For how long.
        waited: Duration,
    },
    /// X-Plane is there but cannot capture.
    #[error(
        "X-Plane answers at {address} but offers no capture link: dataref {} is missing or 0 after {waited:.1?}. Install \
         this project's XPPython3 plugin into Resources/plugins/PythonPlugins and restart X-Plane, or use the stand-in: \
         --sim mock",
        crate::datarefs::CAPTURE_PORT
    )]
    NoPlugin {
        /// Where we asked.
        address: SocketAddr,
        /// For how long.
        waited: Duration,
    },
    /// The capture link could not be opened.
    #[error(
        "cannot open the capture link at {address} (TCP), which the simulator announced: {source}. Is a firewall between?"
    )]
    CannotOpenLink {
        /// Where it should listen.
        address: SocketAddr,
        /// Why not.
        source: std::io::Error,
    },
    /// A socket of our own failed.
    #[error("cannot use UDP towards {address}: {source}")]
    Udp {
        /// The simulator's address.
        address: SocketAddr,
        /// Why not.
        source: std::io::Error,
    },
    /// A packet could not be made.
    #[error(transparent)]
    Packet(#[from] PacketError),
    /// The capture link broke or does not speak our language.
    #[error("capture link, while waiting for {doing}: {source}")]
    Link {
        /// What was expected.
        doing: &'static str,
        /// What came instead.
        source: LinkError,
    },
    /// No answer over the capture link.
    #[error(
        "the simulator did not answer over the capture link within {waited:?}, while waiting for {doing}"
    )]
    LinkTimeout {
        /// What was expected.
        doing: &'static str,
        /// How long we waited.
        waited: Duration,
    },
    /// An earlier failure left the link between two messages.
    #[error("the capture link was closed after an earlier failure; connect again")]
    LinkClosed,
    /// The simulator refused.
    #[error("the simulator refused {doing}: {text}")]
    Refused {
        /// What was asked.
        doing: &'static str,
        /// What it said.
        text: String,
    },
    /// The simulator answered something else.
    #[error("capture link: expected {expected}, found {found}")]
    WrongAnswer {
        /// What was due.
        expected: String,
        /// What came.
        found: String,
    },
    /// More captures asked for than the link may hold.
    #[error(
        "{outstanding} captures are outstanding, which is the most the capture link holds: receive a frame first"
    )]
    TooManyOutstanding {
        /// How many.
        outstanding: usize,
    },
    /// A frame awaited that nobody asked for.
    #[error("no capture is outstanding: send one before receiving a frame")]
    NothingOutstanding,
    /// Conditions that X-Plane cannot have.
    #[error("conditions that X-Plane cannot have: {what}")]
    BadConditions {
        /// Which and why.
        what: String,
    },
    /// A dataref that does not take its value.
    #[error(
        "dataref {name} was written {attempts} times as {wanted}, but {}. Does another plugin or a real-weather setting \
         hold it?", .found.map_or("never answered".to_owned(), |value| format!("reads {value}"))
    )]
    NotTaken {
        /// Which dataref.
        name: String,
        /// How often it was written.
        attempts: u32,
        /// What was written.
        wanted: f32,
        /// What came back, if anything did.
        found: Option<f32>,
    },
}
