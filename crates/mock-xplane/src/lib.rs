//! A stand-in X-Plane: UDP server, Web API, capture link, sky and renderer.
//!
//! [`server`] is the process that answers like X-Plane with our plugin; `datarefs` is its table of values. Its flights come from
//! [`flight_model`], its images from [`render`]; they can be shown in a [`window`]. None of it is X-Plane's code: it exists so that the
//! whole pipeline runs, over real sockets, without X-Plane.

#![forbid(unsafe_code)]

mod datarefs;
pub mod quirks;
pub mod render;
pub mod server;
pub mod window;
