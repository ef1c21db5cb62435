//! A stand-in X-Plane: UDP server, Web API, capture link, flight, sky and renderer.
//!
//! [`server`] is the process that answers like X-Plane with our plugin; `datarefs` is its table of values. Its pictures come from
//! [`flight`] and [`render`], and can be shown in a [`window`]. None of it is X-Plane's code: it exists so that the whole pipeline
//! runs, over real sockets, without X-Plane.

#![forbid(unsafe_code)]

mod datarefs;
pub mod flight;
pub mod quirks;
pub mod render;
pub mod server;
pub mod window;
