//! A stand-in X-Plane: UDP server, Web API, capture link, flight, sky and renderer.
//!
//! [`server`] is the process that answers like X-Plane with our plugin; [`datarefs`] is its table of values. What it shows
//! comes from [`flight`] and [`render`], and can be seen in a [`window`]. Nothing of it is X-Plane's: it exists so that the whole
//! chain runs, over real sockets, where there is no X-Plane.

#![forbid(unsafe_code)]

pub mod datarefs;
pub mod flight;
pub mod quirks;
pub mod render;
pub mod server;
pub mod window;
