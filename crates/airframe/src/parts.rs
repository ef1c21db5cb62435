//! The parts of an aircraft, put together; and the 737's, which are drawn by hand.

use crate::engine::{self, Engines};
use crate::frame::Frame;
use crate::fuselage::{self, Ellipse};
use crate::gear::{self, Leg, WHEEL_HEIGHT_BELOW_CG_M};
use crate::lifting_surface::{self, Surfaces};
use crate::{Configuration, Mesh};

/// Distance of the 737's centre of gravity behind the nose, metres: 1.4 m ahead of the main wheels, which puts a tenth of the weight
/// on the nose wheels.
const CG_STATION_M: f64 = 18.2;

/// Boeing 737-800 mesh (about three thousand triangles): closed solids that may intersect, wound counter-clockwise as seen from outside.
pub fn boeing_737_800(configuration: Configuration) -> Mesh {
    let frame = Frame {
        cg_station_m: CG_STATION_M,
    };
    Parts {
        hull: fuselage::HULL,
        fairings: vec![fuselage::FAIRING],
        surfaces: lifting_surface::surfaces(&frame),
        engines: engine::engines(),
        legs: gear::legs(&frame),
        ground_m: WHEEL_HEIGHT_BELOW_CG_M,
        frame,
    }
    .mesh(configuration)
}

/// The parts of an aircraft.
pub(crate) struct Parts {
    pub(crate) frame: Frame,
    pub(crate) hull: [Ellipse; fuselage::HULL.len()],
    pub(crate) fairings: Vec<[Ellipse; fuselage::FAIRING.len()]>,
    pub(crate) surfaces: Surfaces,
    pub(crate) engines: Engines,
    pub(crate) legs: [Leg; 3],
    /// Distance of the ground below the centre of gravity on the ground, metres.
    pub(crate) ground_m: f64,
}

impl Parts {
    pub(crate) fn mesh(&self, configuration: Configuration) -> Mesh {
        let flap_ratio = configuration.flap_ratio.clamp(0.0, 1.0);
        let gear_ratio = configuration.gear_ratio.clamp(0.0, 1.0);
        let mut mesh = Mesh::default();
        fuselage::add_hull(&mut mesh, &self.hull, &self.frame);
        for fairing in &self.fairings {
            fuselage::add_fairing(&mut mesh, fairing, &self.frame);
        }
        lifting_surface::add(&mut mesh, &self.surfaces, flap_ratio);
        engine::add(&mut mesh, &self.engines, &self.frame);
        gear::add(&mut mesh, &self.legs, self.ground_m, gear_ratio);
        mesh
    }
}
