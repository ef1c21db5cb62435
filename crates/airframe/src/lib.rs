//! Shapes of airliners: one mesh per type, drawn by the stand-in and boxed by the labeller.
//!
//! Input: a type, and positions of flaps and gear. Output: a triangle mesh in body axes about the centre of gravity. The stand-in
//! simulator draws it and the labeller boxes it, so both use the same silhouette.
//!
//! A type is a file of `types/` with published dimensions and their sources. The Boeing 737-800 is drawn by hand; its main dimensions
//! follow Boeing's "737 Airplane Characteristics for Airport Planning" (D6-58325): span 35.8 m with winglets, length 39.5 m, height
//! 12.5 m over ground; details that document lacks (airfoils, nose profile) are drawn by eye from its three-view. All other types are
//! built from their figures with the 737's outlines, and the 737's own file shows how close that comes.

#![forbid(unsafe_code)]

mod aircraft_type;
mod engine;
mod frame;
mod fuselage;
mod gear;
mod lifting_surface;
mod material;
mod mesh;
mod parts;
mod shape;
mod solid;
mod three_views;

pub use aircraft_type::{AircraftType, Published, UnknownType, XPlaneFiles};
pub use gear::WHEEL_HEIGHT_BELOW_CG_M;
pub use material::Material;
pub use mesh::{Mesh, Triangle};
pub use parts::boeing_737_800;
pub use shape::LampPlaces;
pub use three_views::{Drawing, View, draw, three_views};

/// Positions of the parts that move and change the silhouette.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Configuration {
    /// Flaps, 0 up to 1 full (40 degrees). Values outside are clamped.
    pub flap_ratio: f64,
    /// Landing gear, 0 up to 1 down. Values outside are clamped.
    pub gear_ratio: f64,
}

#[cfg(test)]
mod tests;
