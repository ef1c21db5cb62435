//! The geometry that all crates must agree on: positions on the WGS-84 ellipsoid, poses, cameras, runways and flights.

pub mod approach_profile;
pub mod camera;
pub mod distortion;
pub mod echo;
pub mod flight;
pub mod geodesy;
pub mod imaging;
pub mod pose;
pub mod rays;
pub mod refraction;
pub mod runway;
pub mod sun;
