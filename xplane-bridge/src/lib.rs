//! Communication with X-Plane: its UDP protocol, its datarefs and the capture link of our plugin.
//!
//! [`Simulator`] is the client that the generator uses; it treats X-Plane and the stand-in alike. Its parts can be used separately:
//! [`discovery`] (beacons), [`packet`] (bytes <-> UDP packets), [`subscription`] (datarefs that stay subscribed), [`datarefs`]
//! (names, and the only conversion of units), [`web_api`] (X-Plane 12's own), [`link`] (the TCP link for poses and images),
//! [`pixels`] (sources of a drawn frame's pixels) and [`fly`] (requests for live flights).

mod causes;
pub mod datarefs;
pub mod discovery;
pub mod doorway;
mod error;
pub mod fly;
pub mod install;
pub mod link;
pub mod packet;
mod peer_text;
pub mod pixels;
pub mod profile;
mod simulator;
pub mod simulator_address;
pub mod subscription;
mod udp_socket;
pub mod web_api;

pub use causes::with_causes;
pub use error::BridgeError;
pub use link::{CaptureRequest, CapturedFrame, Deliver};
pub use simulator::doctor;
pub use simulator::{
    BadWebApiPlace, BlockOfTicks, BlockRecording, BlockReport, BlockTrial, CONNECT_TIMEOUT,
    ConnectOptions, KnownBlocks, LINK_TOKEN_VARIABLE, Simulator, SimulatorDescription,
    WEB_API_VARIABLE, WebApiPlace, block_bytes, pictures_waiting, somebody_answers,
};
pub use udp_socket::{LocalUdp, PortNote};
