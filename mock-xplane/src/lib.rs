//! A stand-in X-Plane: UDP server, capture link, flight, sky and renderer.

#![forbid(unsafe_code)]

pub mod render;
