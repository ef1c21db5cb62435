//! Speaks to X-Plane: its UDP protocol, its datarefs and the capture link of our plugin.
//!
//! [`Simulator`] is the client that the generator uses; it cannot tell X-Plane from the stand-in. Below it lie, each usable
//! alone: [`packet`] (bytes <-> UDP packets), [`datarefs`] (names, and the only conversion of units), [`link`] (the TCP link
//! for poses and pictures) and [`fly`] (what a live flight is asked to be).

#![forbid(unsafe_code)]

pub mod datarefs;
mod error;
pub mod fly;
pub mod link;
pub mod packet;
mod simulator;

pub use error::BridgeError;
pub use link::{CaptureRequest, CapturedFrame};
pub use simulator::{CONNECT_TIMEOUT, Simulator, SimulatorDescription};
