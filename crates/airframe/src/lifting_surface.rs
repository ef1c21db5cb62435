//! Wings with winglets and flaps, horizontal and vertical tail: lofts over airfoil sections.

use glam::{DMat3, DVec3};

use crate::frame::Frame;
use crate::gear::WHEEL_HEIGHT_BELOW_CG_M;
use crate::{Material, Mesh, solid::add_loft};

/// Height of the 737's fin tip over ground on the ground, metres.
const HEIGHT_M: f64 = 12.5;
/// Points per airfoil side between leading and trailing edge.
const POINTS_PER_SIDE: usize = 6;
/// Deflection of full flaps, radians.
const FULL_FLAP_RAD: f64 = 40.0 * std::f64::consts::PI / 180.0;
/// Flap chord, as a part of the local wing chord.
const FLAP_CHORD_RATIO: f64 = 0.26;
/// Aft travel of full flaps, as a part of the local wing chord.
const FLAP_TRAVEL_RATIO: f64 = 0.12;

#[derive(Clone, Copy)]
pub(crate) struct Section {
    pub(crate) leading_edge: DVec3,
    chord_m: f64,
    thickness_ratio: f64,
    /// Unit vector towards the upper side.
    up: DVec3,
    /// Nose-down turn about the leading edge, radians (flaps).
    deflection_rad: f64,
}

pub(crate) const fn section(
    leading_edge: DVec3,
    chord_m: f64,
    thickness_ratio: f64,
    up: DVec3,
) -> Section {
    Section {
        leading_edge,
        chord_m,
        thickness_ratio,
        up,
        deflection_rad: 0.0,
    }
}

/// Wings, horizontal and vertical tail: sections of the right half, from the plane of symmetry outwards and upwards.
pub(crate) struct Surfaces {
    pub(crate) wing: Vec<Section>,
    /// Index of the last section of the wing itself; a winglet begins there.
    pub(crate) wing_tip: usize,
    /// Lateral ends of the flaps, metres right of the plane of symmetry.
    pub(crate) flaps_m: [(f64, f64); 2],
    pub(crate) tailplane: [Section; 2],
    pub(crate) fin: Vec<Section>,
}

/// The surfaces of the 737.
pub(crate) fn surfaces(frame: &Frame) -> Surfaces {
    Surfaces {
        wing: right_wing(frame).to_vec(),
        wing_tip: 3,
        flaps_m: [(2.10, 4.30), (5.60, 12.20)],
        tailplane: right_tailplane(frame),
        fin: fin(frame).to_vec(),
    }
}

/// The right wing, from its centre to the winglet's tip.
fn right_wing(frame: &Frame) -> [Section; 7] {
    let at = |station_m, right_m, down_m| frame.at(station_m, right_m, down_m);
    let wing_up = DVec3::new(0.0, -0.105, -1.0).normalize();
    let canted = DVec3::new(0.0, -0.75, -0.66).normalize();
    let winglet_up = DVec3::new(0.0, -0.97, -0.24).normalize();
    [
        section(at(13.20, 0.00, 1.25), 7.90, 0.14, wing_up),
        section(at(14.18, 1.88, 1.05), 7.05, 0.135, wing_up),
        section(at(16.08, 5.50, 0.67), 5.20, 0.12, wing_up),
        section(at(22.17, 17.16, -0.55), 1.62, 0.10, wing_up),
        section(at(22.55, 17.50, -0.78), 1.40, 0.09, canted),
        section(at(23.05, 17.66, -1.40), 1.10, 0.08, winglet_up),
        // The thickness of the tip itself makes up the last centimetres of the half span.
        section(at(24.05, 17.885, -3.00), 0.55, 0.056, winglet_up),
    ]
}

fn right_tailplane(frame: &Frame) -> [Section; 2] {
    let at = |station_m, right_m, down_m| frame.at(station_m, right_m, down_m);
    let up = DVec3::new(0.0, -0.12, -1.0).normalize();
    [
        section(at(33.40, 0.40, -1.28), 4.15, 0.11, up),
        section(at(37.80, 7.17, -2.10), 1.70, 0.10, up),
    ]
}

fn fin(frame: &Frame) -> [Section; 4] {
    let at = |station_m, right_m, down_m| frame.at(station_m, right_m, down_m);
    let up = DVec3::Y;
    let tip = at(36.40, 0.0, WHEEL_HEIGHT_BELOW_CG_M - HEIGHT_M);
    // The lowest two make the long dorsal fillet.
    [
        section(at(26.60, 0.0, -1.70), 10.20, 0.05, up),
        section(at(30.20, 0.0, -2.75), 7.00, 0.08, up),
        section(at(31.60, 0.0, -3.70), 5.85, 0.10, up),
        section(tip, 2.35, 0.10, up),
    ]
}

pub(crate) fn add(mesh: &mut Mesh, surfaces: &Surfaces, flap_ratio: f64) {
    let Surfaces { wing, wing_tip, .. } = surfaces;
    let flaps = surfaces.flaps_m.map(|(inner_m, outer_m)| {
        [
            flap(wing, inner_m, flap_ratio),
            flap(wing, outer_m, flap_ratio),
        ]
    });
    for mirrored in [false, true] {
        add_surface(mesh, wing, mirrored, |section| {
            if section <= *wing_tip {
                Material::Wing
            } else {
                Material::Tail
            }
        });
        add_surface(mesh, &surfaces.tailplane, mirrored, |_| Material::Wing);
        for flap in &flaps {
            add_surface(mesh, flap, mirrored, |_| Material::Flap);
        }
    }
    add_surface(mesh, &surfaces.fin, false, |_| Material::Tail);
}

/// The flap's section at a span station: nested in the wing's trailing edge, or moved aft and turned down.
fn flap(wing: &[Section], right_m: f64, flap_ratio: f64) -> Section {
    let local = section_at(wing, right_m);
    let aft = -DVec3::X;
    let along_chord = (1.0 - FLAP_CHORD_RATIO) + FLAP_TRAVEL_RATIO * flap_ratio;
    Section {
        leading_edge: local.leading_edge + aft * (local.chord_m * along_chord)
            - local.up * (0.012 * local.chord_m * flap_ratio),
        chord_m: local.chord_m * FLAP_CHORD_RATIO * 0.98,
        // Thin enough to vanish inside the wing when it is up.
        thickness_ratio: 0.08,
        up: local.up,
        deflection_rad: FULL_FLAP_RAD * flap_ratio,
    }
}

/// Interpolated section at a span station.
fn section_at(sections: &[Section], right_m: f64) -> Section {
    let outer = sections
        .iter()
        .position(|s| s.leading_edge.y >= right_m)
        .unwrap_or(sections.len() - 1)
        .max(1);
    let (a, b) = (&sections[outer - 1], &sections[outer]);
    let part = (right_m - a.leading_edge.y) / (b.leading_edge.y - a.leading_edge.y);
    section(
        a.leading_edge.lerp(b.leading_edge, part),
        a.chord_m + (b.chord_m - a.chord_m) * part,
        a.thickness_ratio + (b.thickness_ratio - a.thickness_ratio) * part,
        a.up.lerp(b.up, part).normalize(),
    )
}

/// Adds the closed skin over sections, or over their mirror images.
pub(crate) fn add_surface(
    mesh: &mut Mesh,
    sections: &[Section],
    mirrored: bool,
    material: impl Fn(usize) -> Material,
) {
    let mirror = if mirrored {
        DVec3::new(1.0, -1.0, 1.0)
    } else {
        DVec3::ONE
    };
    let rings: Vec<Vec<DVec3>> = sections
        .iter()
        .map(|section| {
            section
                .outline()
                .into_iter()
                .map(|point| point * mirror)
                .collect()
        })
        .collect();
    add_loft(mesh, &rings, |ring, _| material(ring));
}

impl Section {
    /// The outline, from the leading edge over the upper side to the trailing edge and back below.
    fn outline(&self) -> Vec<DVec3> {
        // A flap turns about its own span line, nose-down, so its trailing edge falls.
        let turn = DMat3::from_axis_angle(DVec3::X.cross(self.up).normalize(), self.deflection_rad);
        let (aft, up) = (turn * -DVec3::X, turn * self.up);
        let point = |chordwise: f64, side: f64| {
            self.leading_edge
                + aft * (chordwise * self.chord_m)
                + up * (side * self.half_thickness_m(chordwise))
        };
        // Cosine spacing puts points where the outline curves.
        let chordwise = |k: usize| {
            (1.0 - (std::f64::consts::PI * k as f64 / (POINTS_PER_SIDE + 1) as f64).cos()) / 2.0
        };
        let mut outline = vec![point(0.0, 0.0)];
        outline.extend((1..=POINTS_PER_SIDE).map(|k| point(chordwise(k), 1.0)));
        outline.push(point(1.0, 0.0));
        outline.extend(
            (1..=POINTS_PER_SIDE)
                .rev()
                .map(|k| point(chordwise(k), -1.0)),
        );
        outline
    }

    /// Half-thickness by the symmetric NACA four-digit formula with a closed trailing edge.
    fn half_thickness_m(&self, x: f64) -> f64 {
        let form = 0.2969 * x.sqrt() - 0.1260 * x - 0.3516 * x.powi(2) + 0.2843 * x.powi(3)
            - 0.1036 * x.powi(4);
        5.0 * self.thickness_ratio * form * self.chord_m
    }
}
