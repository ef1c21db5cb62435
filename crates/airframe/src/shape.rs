//! Builder of an aircraft's parts from a type's figures: the 737's outlines, stretched to the type.
//!
//! Stations are metres behind the nose, heights metres over ground, angles those of leading edges.

use glam::DVec3;
use serde::Deserialize;

use crate::engine::{Engines, Mount, PROFILE_SIZE_M};
use crate::frame::Frame;
use crate::fuselage::{Ellipse, FAIRING, HULL};
use crate::gear::Leg;
use crate::lifting_surface::{Section, Surfaces, section};
use crate::parts::Parts;

/// Index of the section of [`HULL`] where its nose ends; the next one is where its tail begins.
const NOSE_END: usize = 8;
/// The centre of gravity's distance ahead of the main wheels, as a part of the wheelbase: the 737's.
const CG_AHEAD_OF_MAIN: f64 = 0.09;
/// Thickness ratios at root, kink and tip.
const WING_THICKNESS: [f64; 3] = [0.14, 0.12, 0.10];
/// Sections of the 737's winglet: parts of its reach, rise, aft shift and change of chord, and thickness ratio.
const WINGLET: [([f64; 4], f64); 3] = [
    ([0.47, 0.094, 0.20, 0.20], 0.09),
    ([0.69, 0.347, 0.47, 0.49], 0.08),
    ([1.0, 1.0, 1.0, 1.0], 0.056),
];
/// Lateral ends of the 737's flaps: parts of the hull's half-width, of the kink's position (inner flap, outer flap) and of the tip's.
const FLAPS: [f64; 4] = [1.12, 0.78, 1.02, 0.711];
/// Depth of the fin's lowest section below its root, as a part of the hull's height, and thickness ratios upwards from there.
const FIN_DEPTH: f64 = 0.5;
const FIN_THICKNESS: [f64; 4] = [0.05, 0.08, 0.10, 0.10];
/// The fillet's second section: parts of its length and depth.
const FILLET_MIDDLE: (f64, f64) = (0.28, 0.475);
/// Height of the legs' hinges above the hull's lowest line, as a part of the hull's height.
const HINGE_HEIGHT: f64 = 0.2;

/// Distance of the beacons ahead of the centre of gravity, metres: the 737's.
const BEACONS_AHEAD_M: f64 = 3.0;

/// Figures of a type.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Shape {
    fuselage: Fuselage,
    wing: Wing,
    tailplane: Tailplane,
    fin: Fin,
    engines: EngineFigures,
    #[serde(default)]
    fairing: Vec<Fairing>,
    gear: Gear,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Fuselage {
    height_m: f64,
    axis_height_m: f64,
    length_m: f64,
    nose_length_m: f64,
    /// Drop of the nose's tip below the axis.
    nose_droop_m: f64,
    tail_length_m: f64,
    /// Rise of the tail's end above the axis.
    tail_rise_m: f64,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Wing {
    station_m: f64,
    height_m: f64,
    root_chord_m: f64,
    kink_m: f64,
    kink_chord_m: f64,
    /// Half span without winglet.
    tip_m: f64,
    tip_chord_m: f64,
    sweep_deg: f64,
    dihedral_deg: f64,
    winglet: Option<Winglet>,
}

/// A winglet, or a raked tip: it ends at half the span.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Winglet {
    rise_m: f64,
    aft_m: f64,
    tip_chord_m: f64,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Tailplane {
    station_m: f64,
    height_m: f64,
    root_chord_m: f64,
    tip_chord_m: f64,
    span_m: f64,
    sweep_deg: f64,
    dihedral_deg: f64,
}

/// The fin above its fillet; its tip is the aircraft's highest point.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Fin {
    station_m: f64,
    height_m: f64,
    root_chord_m: f64,
    tip_chord_m: f64,
    sweep_deg: f64,
    /// Length of the fillet ahead of the root.
    fillet_m: f64,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct EngineFigures {
    mount: MountName,
    station_m: f64,
    right_m: f64,
    height_m: f64,
    diameter_m: f64,
    length_m: f64,
    propeller_m: Option<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum MountName {
    Wing,
    Rear,
    Propeller,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Fairing {
    station_m: f64,
    length_m: f64,
    width_m: f64,
    depth_m: f64,
    height_m: f64,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Gear {
    cg_height_m: f64,
    nose_station_m: f64,
    main_station_m: f64,
    track_m: f64,
    main_axles: u32,
    main_wheel_m: f64,
    nose_wheel_m: f64,
}

/// Places of an aircraft's lamps in body axes, metres. Those at the wings are right ones.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LampPlaces {
    /// Position light.
    pub wing_tip: [f64; 3],
    /// Strobe light.
    pub strobe: [f64; 3],
    /// White light at the tail's end.
    pub tail: [f64; 3],
    /// Red beacon on top.
    pub upper_beacon: [f64; 3],
    /// Red beacon below.
    pub lower_beacon: [f64; 3],
    /// Landing light at the wing's root.
    pub landing: [f64; 3],
    /// Taxi light on the nose leg.
    pub nose_leg: [f64; 3],
}

/// The dimensions that the shape fills exactly.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Size {
    pub(crate) span_m: f64,
    pub(crate) height_m: f64,
    pub(crate) fuselage_width_m: f64,
}

impl Shape {
    /// Height of the centre of gravity over ground on the ground, metres.
    pub(crate) fn cg_height_m(&self) -> f64 {
        self.gear.cg_height_m
    }

    pub(crate) fn parts(&self, size: Size) -> Parts {
        let Gear {
            main_station_m,
            nose_station_m,
            ..
        } = self.gear;
        let frame = Frame {
            cg_station_m: main_station_m - CG_AHEAD_OF_MAIN * (main_station_m - nose_station_m),
        };
        Parts {
            hull: self.hull(size.fuselage_width_m),
            fairings: self.fairing.iter().map(|one| self.fairing(one)).collect(),
            surfaces: self.surfaces(size, &frame),
            engines: self.engines(&frame),
            legs: self.legs(&frame),
            ground_m: self.gear.cg_height_m,
            frame,
        }
    }

    /// Places of the lamps: at the wing's tip, its root, the hull's top, bottom and end, and on the nose leg.
    pub(crate) fn lamp_places(&self, size: Size) -> LampPlaces {
        let parts = self.parts(size);
        let wing_tip = parts.surfaces.wing[parts.surfaces.wing_tip].leading_edge;
        let root = parts.surfaces.wing[0].leading_edge;
        let [end, cylinder] = [HULL.len() - 1, NOSE_END].map(|index| parts.hull[index]);
        let on_hull = |down_m: f64| {
            let behind_nose_m = parts.frame.cg_station_m - BEACONS_AHEAD_M;
            parts.frame.at(behind_nose_m, 0.0, down_m).to_array()
        };
        // Just outside of what would hide them.
        let tip = wing_tip + DVec3::new(0.1, 0.1, 0.0);
        let right_m = 0.75 * size.fuselage_width_m;
        let aft_m = self.wing.sweep_deg.to_radians().tan() * right_m;
        let nose_hinge = parts.legs[0].hinge;
        LampPlaces {
            wing_tip: tip.to_array(),
            strobe: (tip - DVec3::X * 0.2).to_array(),
            tail: parts
                .frame
                .at(end.station_m + 0.2, 0.0, end.center_down_m)
                .to_array(),
            upper_beacon: on_hull(cylinder.center_down_m - cylinder.half_height_m - 0.1),
            lower_beacon: on_hull(cylinder.center_down_m + cylinder.half_height_m + 0.1),
            landing: (root + DVec3::new(0.2 - aft_m, right_m, 0.0)).to_array(),
            nose_leg: (nose_hinge + DVec3::new(0.1, 0.0, 0.8)).to_array(),
        }
    }

    fn down_m(&self, height_m: f64) -> f64 {
        self.gear.cg_height_m - height_m
    }

    fn hull(&self, width_m: f64) -> [Ellipse; HULL.len()] {
        let Fuselage {
            height_m,
            axis_height_m,
            length_m,
            nose_length_m,
            nose_droop_m,
            tail_length_m,
            tail_rise_m,
        } = self.fuselage;
        let (tip, cylinder, tail, end) = (
            HULL[0],
            HULL[NOSE_END],
            HULL[NOSE_END + 1],
            HULL[HULL.len() - 1],
        );
        let lower_m = |of: &Ellipse| of.center_down_m - cylinder.center_down_m;
        let mut hull = HULL;
        for (index, ellipse) in hull.iter_mut().enumerate() {
            let (station_m, droop_m) = if index <= NOSE_END {
                (
                    ellipse.station_m / cylinder.station_m * nose_length_m,
                    lower_m(ellipse) / lower_m(&tip) * nose_droop_m,
                )
            } else {
                let along = (ellipse.station_m - tail.station_m) / (end.station_m - tail.station_m);
                (
                    length_m - tail_length_m * (1.0 - along),
                    -lower_m(ellipse) / lower_m(&end) * tail_rise_m,
                )
            };
            *ellipse = Ellipse {
                station_m,
                half_width_m: ellipse.half_width_m / cylinder.half_width_m * width_m / 2.0,
                half_height_m: ellipse.half_height_m / cylinder.half_height_m * height_m / 2.0,
                center_down_m: self.down_m(axis_height_m) + droop_m,
            };
        }
        hull
    }

    fn fairing(&self, of: &Fairing) -> [Ellipse; FAIRING.len()] {
        let (first, last) = (FAIRING[0], FAIRING[FAIRING.len() - 1]);
        let widest = FAIRING
            .iter()
            .max_by(|a, b| a.half_width_m.total_cmp(&b.half_width_m));
        let widest = *widest.unwrap_or(&first);
        FAIRING.map(|ellipse| {
            let along = (ellipse.station_m - first.station_m) / (last.station_m - first.station_m);
            let deeper = of.depth_m / 2.0 / widest.half_height_m;
            Ellipse {
                station_m: of.station_m + along * of.length_m,
                half_width_m: ellipse.half_width_m / widest.half_width_m * of.width_m / 2.0,
                half_height_m: ellipse.half_height_m * deeper,
                center_down_m: self.down_m(of.height_m)
                    + (ellipse.center_down_m - widest.center_down_m) * deeper,
            }
        })
    }

    fn surfaces(&self, size: Size, frame: &Frame) -> Surfaces {
        let Wing { kink_m, tip_m, .. } = self.wing;
        let wing = self.right_wing(size.span_m, frame);
        let [inner, of_kink, from_kink, of_tip] = FLAPS;
        Surfaces {
            wing_tip: 2,
            flaps_m: [
                (inner * size.fuselage_width_m / 2.0, of_kink * kink_m),
                (from_kink * kink_m, of_tip * tip_m),
            ],
            tailplane: self.right_tailplane(frame),
            fin: self.fin(size.height_m, frame),
            wing,
        }
    }

    fn right_wing(&self, span_m: f64, frame: &Frame) -> Vec<Section> {
        let wing = &self.wing;
        let (aft, rise) = (
            wing.sweep_deg.to_radians().tan(),
            wing.dihedral_deg.to_radians().tan(),
        );
        let up = DVec3::new(0.0, -rise, -1.0).normalize();
        let place = |right_m: f64| {
            let station_m = wing.station_m + aft * right_m;
            (station_m, self.down_m(wing.height_m) - rise * right_m)
        };
        let chords = [
            (0.0, wing.root_chord_m),
            (wing.kink_m, wing.kink_chord_m),
            (wing.tip_m, wing.tip_chord_m),
        ];
        let mut sections: Vec<Section> = chords
            .iter()
            .zip(WING_THICKNESS)
            .map(|(&(right_m, chord_m), thickness)| {
                let (station_m, down_m) = place(right_m);
                section(frame.at(station_m, right_m, down_m), chord_m, thickness, up)
            })
            .collect();
        if let Some(winglet) = &wing.winglet {
            let (station_m, down_m) = place(wing.tip_m);
            let reach = span_m / 2.0 - wing.tip_m;
            let winglet_up = DVec3::new(0.0, -winglet.rise_m, -reach).normalize();
            // The thickness of the tip itself makes up the last centimetres of the half span.
            let reach_m = reach - 0.5 * WINGLET[2].1 * winglet.tip_chord_m * -winglet_up.y;
            for (index, ([out, over, behind, narrower], thickness)) in
                WINGLET.into_iter().enumerate()
            {
                let up = if index == 0 {
                    (up + winglet_up).normalize()
                } else {
                    winglet_up
                };
                sections.push(section(
                    frame.at(
                        station_m + behind * winglet.aft_m,
                        wing.tip_m + out * reach_m,
                        down_m - over * winglet.rise_m,
                    ),
                    wing.tip_chord_m + narrower * (winglet.tip_chord_m - wing.tip_chord_m),
                    thickness,
                    up,
                ));
            }
        }
        sections
    }

    fn right_tailplane(&self, frame: &Frame) -> [Section; 2] {
        let of = &self.tailplane;
        let (aft, rise) = (
            of.sweep_deg.to_radians().tan(),
            of.dihedral_deg.to_radians().tan(),
        );
        let up = DVec3::new(0.0, -rise, -1.0).normalize();
        let at = |right_m: f64| {
            frame.at(
                of.station_m + aft * right_m,
                right_m,
                self.down_m(of.height_m) - rise * right_m,
            )
        };
        [
            section(at(0.0), of.root_chord_m, 0.11, up),
            section(at(of.span_m / 2.0), of.tip_chord_m, 0.10, up),
        ]
    }

    fn fin(&self, height_m: f64, frame: &Frame) -> Vec<Section> {
        let of = &self.fin;
        let aft = of.sweep_deg.to_radians().tan();
        let tall_m = height_m - of.height_m;
        let trailing_aft = (aft * tall_m + of.tip_chord_m - of.root_chord_m) / tall_m;
        let depth_m = FIN_DEPTH * self.fuselage.height_m;
        let (ahead, below) = FILLET_MIDDLE;
        let below_root = |ahead_m: f64, below_m: f64| {
            let leading_m = of.station_m - ahead_m;
            let trailing_m = of.station_m + of.root_chord_m - trailing_aft * below_m;
            (leading_m, of.height_m - below_m, trailing_m - leading_m)
        };
        let sections = [
            below_root(of.fillet_m, depth_m),
            below_root(ahead * of.fillet_m, below * depth_m),
            below_root(0.0, 0.0),
            (of.station_m + aft * tall_m, height_m, of.tip_chord_m),
        ];
        let with_thickness = sections.into_iter().zip(FIN_THICKNESS);
        with_thickness
            .map(|((station_m, height_m, chord_m), thickness)| {
                let place = frame.at(station_m, 0.0, self.down_m(height_m));
                section(place, chord_m, thickness, DVec3::Y)
            })
            .collect()
    }

    fn engines(&self, frame: &Frame) -> Engines {
        let of = &self.engines;
        let down_m = self.down_m(of.height_m);
        let mount = match of.mount {
            MountName::Wing => Mount::Wing(self.pylon()),
            MountName::Rear => {
                let stub = |right_m: f64| {
                    let place = frame.at(of.station_m + 0.25 * of.length_m, right_m, down_m);
                    section(place, 0.5 * of.length_m, 0.12, -DVec3::Z)
                };
                Mount::Tail([stub(0.0), stub(of.right_m)])
            }
            MountName::Propeller => Mount::Propeller(of.propeller_m.unwrap_or_default()),
        };
        let (radius_m, length_m) = PROFILE_SIZE_M;
        Engines {
            lip_station_m: of.station_m,
            right_m: of.right_m,
            down_m,
            scale: (of.diameter_m / 2.0 / radius_m, of.length_m / length_m),
            mount,
        }
    }

    /// Cross-sections from the top of the nacelle to the lower side of the wing, in the proportions of the 737's.
    fn pylon(&self) -> [(f64, f64, f64); 4] {
        let (of, wing) = (&self.engines, &self.wing);
        let (radius_m, axis_m) = (of.diameter_m / 2.0, self.down_m(of.height_m));
        let leading_m = wing.station_m + wing.sweep_deg.to_radians().tan() * of.right_m;
        let wing_m = self.down_m(wing.height_m) - wing.dihedral_deg.to_radians().tan() * of.right_m;
        let inboard = of.right_m / wing.kink_m;
        let chord_m =
            wing.root_chord_m + (wing.kink_chord_m - wing.root_chord_m) * inboard.clamp(0.0, 1.0);
        [
            (
                of.station_m + 0.2 * of.length_m,
                axis_m - 0.90 * radius_m,
                axis_m - 0.73 * radius_m,
            ),
            (
                of.station_m + 0.5 * of.length_m,
                (axis_m - 0.99 * radius_m).min(wing_m - 0.02 * chord_m),
                axis_m - 0.28 * radius_m,
            ),
            (
                leading_m + 0.16 * chord_m,
                wing_m - 0.015 * chord_m,
                axis_m - 0.18 * radius_m,
            ),
            (
                leading_m + 0.45 * chord_m,
                wing_m + 0.011 * chord_m,
                wing_m + 0.044 * chord_m,
            ),
        ]
    }

    fn legs(&self, frame: &Frame) -> [Leg; 3] {
        let of = &self.gear;
        let Fuselage {
            axis_height_m,
            height_m,
            ..
        } = self.fuselage;
        let hinge_m = self.down_m(axis_height_m - height_m / 2.0 + HINGE_HEIGHT * height_m);
        // Proportions of the 737's wheels of 1.13 m and 0.69 m.
        let main = |side: f64| Leg {
            hinge: frame.at(of.main_station_m, side * of.track_m / 2.0, hinge_m),
            hinge_axis: DVec3::X * side,
            wheel_radius_m: of.main_wheel_m / 2.0,
            wheel_width_m: 0.354 * of.main_wheel_m,
            half_track_m: 0.38 * of.main_wheel_m,
            leg_radius_m: 0.124 * of.main_wheel_m,
            axles: of.main_axles,
        };
        let nose = Leg {
            hinge: frame.at(of.nose_station_m, 0.0, hinge_m),
            hinge_axis: DVec3::Y,
            wheel_radius_m: of.nose_wheel_m / 2.0,
            wheel_width_m: 0.29 * of.nose_wheel_m,
            half_track_m: 0.304 * of.nose_wheel_m,
            leg_radius_m: 0.145 * of.nose_wheel_m,
            axles: 1,
        };
        [nose, main(1.0), main(-1.0)]
    }
}
