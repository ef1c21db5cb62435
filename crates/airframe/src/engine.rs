//! Two CFM56-7B nacelles, hung ahead of and below the wings, and their pylons.

use glam::DVec3;

use crate::{
    Material, Mesh, at,
    solid::{add_loft, add_revolution},
};

const SEGMENTS: usize = 24;
/// Lateral distance between engine axis and plane of symmetry, metres.
const RIGHT_M: f64 = 4.83;
/// Height of the axis: the cowling clears the ground by about half a metre.
const DOWN_M: f64 = 1.60;
const LIP_STATION_M: f64 = 11.9;

/// Metres behind the lip and radius: out of the intake, over the cowling, into the nozzle and down to the plug.
const PROFILE: [(f64, f64); 13] = [
    (0.70, 0.78),
    (0.30, 0.79),
    (0.05, 0.84),
    (0.00, 0.90),
    (0.10, 0.97),
    (0.60, 1.05),
    (1.60, 1.09),
    (2.60, 1.05),
    (3.50, 0.92),
    (3.50, 0.74),
    (4.40, 0.52),
    (4.40, 0.36),
    (5.00, 0.08),
];

pub(crate) fn add(mesh: &mut Mesh) {
    for side in [1.0, -1.0] {
        add_revolution(
            mesh,
            at(LIP_STATION_M, side * RIGHT_M, DOWN_M),
            -DVec3::X,
            DVec3::Y * side,
            SEGMENTS,
            &PROFILE,
            |ring| match ring {
                0 | 1 => Material::Intake,
                2 | 3 => Material::Leg,
                4..=7 => Material::Cowling,
                _ => Material::Intake,
            },
        );
        add_pylon(mesh, side);
    }
}

fn add_pylon(mesh: &mut Mesh, side: f64) {
    // Cross-sections are rectangles along the pylon; (station, top, bottom) below the centre of gravity.
    let half_width_m = 0.22;
    let sections = [
        (12.9, 0.62, 0.80),
        (14.4, 0.52, 1.30),
        (16.6, 0.66, 1.40),
        (18.2, 0.80, 0.98),
    ];
    let rings: Vec<Vec<DVec3>> = sections
        .iter()
        .map(|&(station_m, top_m, bottom_m)| {
            [
                (-half_width_m, top_m),
                (half_width_m, top_m),
                (half_width_m, bottom_m),
                (-half_width_m, bottom_m),
            ]
            .map(|(right_m, down_m)| at(station_m, side * (RIGHT_M + right_m), down_m))
            .to_vec()
        })
        .collect();
    add_loft(mesh, &rings, |_, _| Material::Cowling);
}
