//! Hull and wing-to-body fairing: lofts over elliptic cross-sections. Their outlines are the 737's; other types stretch them.

use std::f64::consts::TAU;

use glam::DVec3;

use crate::{Material, Mesh, frame::Frame, solid::add_loft};

const SEGMENTS: usize = 32;

/// Upright elliptic cross-section at a station.
#[derive(Clone, Copy)]
pub(crate) struct Ellipse {
    pub(crate) station_m: f64,
    pub(crate) half_width_m: f64,
    pub(crate) half_height_m: f64,
    /// Position of the centre below the frame's zero, metres.
    pub(crate) center_down_m: f64,
}

const fn ellipse(
    station_m: f64,
    half_width_m: f64,
    half_height_m: f64,
    center_down_m: f64,
) -> Ellipse {
    Ellipse {
        station_m,
        half_width_m,
        half_height_m,
        center_down_m,
    }
}

/// The nose hangs low, the cylinder is 3.76 m wide and 4.01 m high, the tail cone rises for rotation at take-off.
pub(crate) const HULL: [Ellipse; 17] = [
    ellipse(0.00, 0.06, 0.05, 0.52),
    ellipse(0.10, 0.34, 0.32, 0.51),
    ellipse(0.35, 0.64, 0.62, 0.47),
    ellipse(0.80, 0.95, 0.93, 0.39),
    ellipse(1.50, 1.27, 1.24, 0.29),
    ellipse(2.20, 1.48, 1.50, 0.15),
    ellipse(3.00, 1.65, 1.74, 0.02),
    ellipse(4.20, 1.80, 1.93, -0.07),
    ellipse(6.00, 1.88, 2.005, -0.10),
    ellipse(25.00, 1.88, 2.005, -0.10),
    ellipse(27.50, 1.83, 1.93, -0.17),
    ellipse(30.00, 1.62, 1.68, -0.40),
    ellipse(32.50, 1.28, 1.33, -0.70),
    ellipse(34.80, 0.90, 0.96, -0.96),
    ellipse(36.60, 0.55, 0.62, -1.18),
    ellipse(37.70, 0.28, 0.34, -1.32),
    ellipse(38.02, 0.14, 0.18, -1.38),
];

/// Bulge under the wing's centre section, where the main wheels stow.
pub(crate) const FAIRING: [Ellipse; 7] = [
    ellipse(11.8, 0.60, 0.30, 1.55),
    ellipse(13.0, 1.50, 0.62, 1.50),
    ellipse(14.8, 1.98, 0.82, 1.42),
    ellipse(18.5, 2.05, 0.86, 1.40),
    ellipse(21.0, 1.92, 0.76, 1.40),
    ellipse(22.8, 1.30, 0.52, 1.45),
    ellipse(24.0, 0.50, 0.24, 1.50),
];

/// Adds a hull of [`HULL`]'s sections, in its paint.
pub(crate) fn add_hull(mesh: &mut Mesh, hull: &[Ellipse; HULL.len()], frame: &Frame) {
    add_loft(mesh, &rings(hull, frame), hull_paint);
}

/// Adds a fairing.
pub(crate) fn add_fairing(mesh: &mut Mesh, sections: &[Ellipse], frame: &Frame) {
    add_loft(mesh, &rings(sections, frame), |_, _| Material::Belly);
}

/// Paint by the station on the 737's hull.
fn hull_paint(ring: usize, segment: usize) -> Material {
    let station_m = (HULL[ring].station_m + HULL[ring + 1].station_m) / 2.0;
    let up = (TAU * (segment as f64 + 0.5) / SEGMENTS as f64).sin();
    if (1.5..3.0).contains(&station_m) && (0.45..0.90).contains(&up) {
        Material::Window
    } else if up < -0.80 && (4.0..30.0).contains(&station_m) {
        Material::Belly
    } else if station_m > 32.0 {
        Material::Tail
    } else {
        Material::Fuselage
    }
}

fn rings(sections: &[Ellipse], frame: &Frame) -> Vec<Vec<DVec3>> {
    sections
        .iter()
        .map(|section| {
            (0..SEGMENTS)
                .map(|segment| {
                    let (sin, cos) = (TAU * segment as f64 / SEGMENTS as f64).sin_cos();
                    frame.at(
                        section.station_m,
                        section.half_width_m * cos,
                        section.center_down_m - section.half_height_m * sin,
                    )
                })
                .collect()
        })
        .collect()
}
