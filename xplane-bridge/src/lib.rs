//! Speaks to X-Plane: its UDP protocol, its datarefs and the capture link of our plugin.

#![forbid(unsafe_code)]

pub mod fly;
