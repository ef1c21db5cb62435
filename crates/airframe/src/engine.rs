//! Nacelles in the shape of the CFM56-7B's, and pylons under wings.

use glam::DVec3;

use crate::{
    Material, Mesh,
    frame::Frame,
    lifting_surface::{Section, add_surface},
    solid::{add_loft, add_revolution},
};

const SEGMENTS: usize = 24;
/// Lateral distance between the 737's engine axis and its plane of symmetry, metres.
const RIGHT_M: f64 = 4.83;
/// Height of the 737's axis: the cowling clears the ground by about half a metre.
const DOWN_M: f64 = 1.60;
const LIP_STATION_M: f64 = 11.9;
/// Cross-sections of the 737's pylon, rectangles: (station, top, bottom) below the centre of gravity.
const PYLON: [(f64, f64, f64); 4] = [
    (12.9, 0.62, 0.80),
    (14.4, 0.52, 1.30),
    (16.6, 0.66, 1.40),
    (18.2, 0.80, 0.98),
];
/// Largest radius and length of [`PROFILE`].
pub(crate) const PROFILE_SIZE_M: (f64, f64) = (1.09, 5.00);

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

/// Size of the propeller's spinner and of the nacelle behind it: parts of the nacelle's length, and of its largest radius.
const PROPELLER_PROFILE: [(f64, f64); 8] = [
    (0.00, 0.05),
    (0.04, 0.32),
    (0.12, 0.50),
    (0.14, 0.78),
    (0.30, 1.00),
    (0.60, 0.95),
    (0.85, 0.60),
    (1.00, 0.10),
];
const BLADES: usize = 6;
/// Chord and thickness of a blade, parts of its length: by eye, from photographs of the ATR 72's.
const BLADE_CHORD_RATIO: f64 = 0.13;
const BLADE_THICKNESS_RATIO: f64 = 0.03;

/// A pair of engines.
pub(crate) struct Engines {
    pub(crate) lip_station_m: f64,
    pub(crate) right_m: f64,
    /// Position of the axis below the frame's zero, metres.
    pub(crate) down_m: f64,
    /// Factors on radius and length of [`PROFILE`].
    pub(crate) scale: (f64, f64),
    pub(crate) mount: Mount,
}

/// The part that joins an engine to the aircraft.
pub(crate) enum Mount {
    /// A pylon under the wing. Cross-sections: (station, top, bottom) below the frame's zero.
    Wing([(f64, f64, f64); 4]),
    /// A stub beside the tail: its root section and its tip section.
    Tail([Section; 2]),
    /// The wing itself, with a propeller of this diameter, metres.
    Propeller(f64),
}

/// The engines of the 737.
pub(crate) fn engines() -> Engines {
    Engines {
        lip_station_m: LIP_STATION_M,
        right_m: RIGHT_M,
        down_m: DOWN_M,
        scale: (1.0, 1.0),
        mount: Mount::Wing(PYLON),
    }
}

pub(crate) fn add(mesh: &mut Mesh, engines: &Engines, frame: &Frame) {
    for side in [1.0, -1.0] {
        let lip = frame.at(
            engines.lip_station_m,
            side * engines.right_m,
            engines.down_m,
        );
        match &engines.mount {
            Mount::Wing(pylon) => {
                add_nacelle(mesh, lip, side, engines.scale);
                add_pylon(mesh, engines.right_m, side, pylon, frame);
            }
            Mount::Tail(stub) => {
                add_nacelle(mesh, lip, side, engines.scale);
                add_surface(mesh, stub, side < 0.0, |_| Material::Cowling);
            }
            Mount::Propeller(diameter_m) => {
                add_turboprop(mesh, lip, side, engines.scale, *diameter_m);
            }
        }
    }
}

fn add_nacelle(mesh: &mut Mesh, lip: DVec3, side: f64, (wider, longer): (f64, f64)) {
    let profile = PROFILE.map(|(along_m, radius_m)| (along_m * longer, radius_m * wider));
    add_revolution(
        mesh,
        lip,
        -DVec3::X,
        DVec3::Y * side,
        SEGMENTS,
        &profile,
        |ring| match ring {
            0 | 1 => Material::Intake,
            2 | 3 => Material::Leg,
            4..=7 => Material::Cowling,
            _ => Material::Intake,
        },
    );
}

fn add_pylon(
    mesh: &mut Mesh,
    right_m: f64,
    side: f64,
    sections: &[(f64, f64, f64)],
    frame: &Frame,
) {
    let half_width_m = 0.22;
    let rings: Vec<Vec<DVec3>> = sections
        .iter()
        .map(|&(station_m, top_m, bottom_m)| {
            [
                (-half_width_m, top_m),
                (half_width_m, top_m),
                (half_width_m, bottom_m),
                (-half_width_m, bottom_m),
            ]
            .map(|(across_m, down_m)| frame.at(station_m, side * (right_m + across_m), down_m))
            .to_vec()
        })
        .collect();
    add_loft(mesh, &rings, |_, _| Material::Cowling);
}

fn add_turboprop(
    mesh: &mut Mesh,
    spinner: DVec3,
    side: f64,
    (wider, longer): (f64, f64),
    diameter_m: f64,
) {
    let (radius_m, length_m) = (PROFILE_SIZE_M.0 * wider, PROFILE_SIZE_M.1 * longer);
    let profile = PROPELLER_PROFILE.map(|(along, radius)| (along * length_m, radius * radius_m));
    add_revolution(
        mesh,
        spinner,
        -DVec3::X,
        DVec3::Y * side,
        SEGMENTS,
        &profile,
        |ring| {
            if ring < 2 {
                Material::Leg
            } else {
                Material::Cowling
            }
        },
    );
    let hub = spinner - DVec3::X * (PROPELLER_PROFILE[1].0 * length_m);
    let blade_m = diameter_m / 2.0;
    let (chord_m, thickness_m) = (blade_m * BLADE_CHORD_RATIO, blade_m * BLADE_THICKNESS_RATIO);
    for blade in 0..BLADES {
        // A blade points straight down, so that the ground clearance is the published one.
        let angle = std::f64::consts::TAU * blade as f64 / BLADES as f64;
        let outwards = DVec3::new(0.0, side * angle.sin(), angle.cos());
        let across = DVec3::X.cross(outwards);
        let rings = [(0.1, 1.0), (0.8, 1.0), (1.0, 0.6)].map(|(along, width)| {
            let corner = |a: f64, b: f64| {
                hub + outwards * (along * blade_m)
                    + across * (a * width * chord_m / 2.0)
                    + DVec3::X * (b * thickness_m / 2.0)
            };
            vec![
                corner(-1.0, -1.0),
                corner(1.0, -1.0),
                corner(1.0, 1.0),
                corner(-1.0, 1.0),
            ]
        });
        add_loft(mesh, &rings, |_, _| Material::Intake);
    }
}
