//! Speaks to X-Plane: its UDP protocol, its datarefs and the capture link of our plugin.
//!
//! [`Simulator`] is the client that the generator uses; it cannot tell X-Plane from the stand-in. Below it lie, each usable
//! alone: [`discovery`] (who announces itself), [`packet`] (bytes <-> UDP packets), [`subscription`] (datarefs that stay
//! subscribed), [`datarefs`] (names, and the only conversion of units), [`web_api`] (X-Plane 12's own), [`link`] (the TCP
//! link for poses and pictures), [`pixels`] (where the pixels of a drawn frame come from) and [`fly`] (what a live flight is
//! asked to be).

pub mod datarefs;
pub mod discovery;
pub mod doorway;
mod error;
pub mod fly;
pub mod install;
pub mod link;
pub mod packet;
pub mod pixels;
pub mod profile;
mod simulator;
pub mod subscription;
pub mod tape;
mod udp_socket;
pub mod web_api;

pub use error::BridgeError;
pub use link::{CaptureRequest, CapturedFrame, Deliver};
pub use simulator::doctor;
pub use simulator::{
    CONNECT_TIMEOUT, ConnectOptions, LINK_TOKEN_VARIABLE, SETTLE_FRAMES, SHARED_MEMORY_VARIABLE,
    Simulator, SimulatorDescription, WEB_API_VARIABLE, WebApiPlace, somebody_answers,
};
