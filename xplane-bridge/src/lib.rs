//! Communication with X-Plane: its UDP protocol, its datarefs and the capture link of our plugin.
//!
//! [`Simulator`] is the client that the generator uses; it treats X-Plane and the stand-in alike. Its parts can be used separately:
//! [`udp::discovery`] (beacons), [`packet`] (bytes <-> UDP packets), [`udp::subscription`] (datarefs that stay subscribed), [`datarefs`]
//! (names, and the only conversion of units), [`web_api`] (X-Plane 12's own), [`link`] (the TCP link for poses and images), [`pixels`]
//! (sources of a drawn frame's pixels) and [`fly`] (requests for live flights).

#![forbid(unsafe_code)]

pub mod datarefs;
mod error;
pub mod fly;
pub mod install;
pub mod link;
pub mod packet;
pub mod pixels;
pub mod profile;
mod simulator;
pub mod udp;
pub mod web_api;

pub use error::causes::with_causes;
pub use error::{BridgeError, Silence};
pub use link::{CaptureRequest, CapturedFrame, Deliver};
pub use simulator::doctor;
pub use simulator::{
    BadWebApiPlace, BlockOfTicks, BlockRecording, BlockReport, BlockTrial, CONNECT_TIMEOUT,
    ConnectOptions, KnownBlocks, LINK_TOKEN_VARIABLE, Simulator, TrafficPath, WEATHER_SETTLE,
    WEB_API_VARIABLE, WebApiPlace, announced_link_port, block_bytes, pictures_waiting,
    somebody_answers,
};
pub use udp::socket::{LocalUdp, PortNote};
