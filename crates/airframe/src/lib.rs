//! Shape model for a Boeing 737-800: one mesh, drawn by the stand-in and boxed by the labeller.
//!
//! Input: positions of flaps and gear. Output: a triangle mesh in body axes about the centre of gravity. The stand-in simulator
//! draws it and the labeller boxes it, so both use the same silhouette. Main dimensions follow Boeing's "737 Airplane
//! Characteristics for Airport Planning" (D6-58325): span 35.8 m with winglets, length 39.5 m, height 12.5 m over ground; details
//! that document lacks (airfoils, nose profile) are drawn by eye from its three-view.

#![forbid(unsafe_code)]

mod engine;
mod fuselage;
mod gear;
mod lifting_surface;
mod material;
mod mesh;
mod solid;

pub use gear::WHEEL_HEIGHT_BELOW_CG_M;
pub use material::Material;
pub use mesh::{Mesh, Triangle};

/// Positions of the parts that move and change the silhouette.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Configuration {
    /// Flaps, 0 up to 1 full (40 degrees). Values outside are clamped.
    pub flap_ratio: f64,
    /// Landing gear, 0 up to 1 down. Values outside are clamped.
    pub gear_ratio: f64,
}

/// Wing span over the winglets, metres.
pub const SPAN_M: f64 = 35.8;
/// Height of the fin's tip over ground on the ground, metres.
pub const HEIGHT_M: f64 = 12.5;

/// Distance of the centre of gravity behind the nose, metres: 1.4 m ahead of the main wheels, which puts a tenth of the weight
/// on the nose wheels.
const CG_STATION_M: f64 = 18.2;

/// Boeing 737-800 mesh (about three thousand triangles): closed solids that may intersect, wound counter-clockwise as seen from outside.
pub fn boeing_737_800(configuration: Configuration) -> Mesh {
    let flap_ratio = configuration.flap_ratio.clamp(0.0, 1.0);
    let gear_ratio = configuration.gear_ratio.clamp(0.0, 1.0);
    let mut mesh = Mesh::default();
    fuselage::add(&mut mesh);
    lifting_surface::add(&mut mesh, flap_ratio);
    engine::add(&mut mesh);
    gear::add(&mut mesh, gear_ratio);
    mesh
}

/// A point in body axes from its station (metres behind the nose), metres right of the plane of symmetry, and metres below the
/// centre of gravity.
fn at(station_m: f64, right_m: f64, down_m: f64) -> glam::DVec3 {
    glam::DVec3::new(CG_STATION_M - station_m, right_m, down_m)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::{BTreeMap, BTreeSet};

    /// From the nose to the tips of the horizontal tail, metres.
    const LENGTH_M: f64 = 39.5;

    const LANDING: Configuration = Configuration {
        flap_ratio: 0.75,
        gear_ratio: 1.0,
    };

    #[test]
    fn the_aircraft_has_the_published_span_length_and_height() {
        let (min, max) = boeing_737_800(LANDING).bounds();
        assert!(
            (max.y - min.y - SPAN_M).abs() < 0.02,
            "span {}",
            max.y - min.y
        );
        assert!(
            (max.x - min.x - LENGTH_M).abs() < 0.05,
            "length {}",
            max.x - min.x
        );
        assert!(
            (max.z - min.z - HEIGHT_M).abs() < 0.05,
            "height {}",
            max.z - min.z
        );
    }

    #[test]
    fn extended_gear_reaches_the_ground_and_retracted_gear_does_not() {
        let down = boeing_737_800(LANDING).bounds().1.z;
        assert!(
            (down - WHEEL_HEIGHT_BELOW_CG_M).abs() < 1e-9,
            "wheels reach {down}"
        );
        let up = boeing_737_800(Configuration {
            gear_ratio: 0.0,
            ..LANDING
        })
        .bounds()
        .1
        .z;
        assert!(
            up < WHEEL_HEIGHT_BELOW_CG_M - 0.3,
            "without gear the lowest point is {up}"
        );
    }

    #[test]
    fn the_mesh_is_the_same_on_both_sides() {
        let mesh = boeing_737_800(LANDING);
        let key = |v: glam::DVec3| [v.x, v.y, v.z].map(|c| (c * 1e5).round() as i64);
        let present: BTreeSet<_> = mesh.vertices.iter().map(|&v| key(v)).collect();
        for vertex in &mesh.vertices {
            assert!(
                present.contains(&key(glam::DVec3::new(vertex.x, -vertex.y, vertex.z))),
                "{vertex} has no twin"
            );
        }
    }

    #[test]
    fn every_edge_joins_exactly_two_triangles_of_opposite_direction() {
        for gear_ratio in [0.0, 0.4, 1.0] {
            let mesh = boeing_737_800(Configuration {
                flap_ratio: 1.0,
                gear_ratio,
            });
            let mut uses = BTreeMap::new();
            for triangle in &mesh.triangles {
                let [a, b, c] = triangle.indices;
                for edge in [(a, b), (b, c), (c, a)] {
                    *uses.entry(edge).or_insert(0) += 1;
                }
            }
            for (&(a, b), &count) in &uses {
                assert_eq!(
                    count, 1,
                    "edge {a}-{b} is used {count} times in one direction"
                );
                assert_eq!(uses.get(&(b, a)), Some(&1), "edge {a}-{b} has no neighbour");
            }
        }
    }

    #[test]
    fn every_solid_faces_outwards() {
        let mesh = boeing_737_800(LANDING);
        // Solids share no vertices, so they are the connected components.
        let mut parent: Vec<usize> = (0..mesh.vertices.len()).collect();
        fn root(parent: &mut [usize], mut i: usize) -> usize {
            while parent[i] != i {
                parent[i] = parent[parent[i]];
                i = parent[i];
            }
            i
        }
        for triangle in &mesh.triangles {
            let [a, b, c] = triangle.indices.map(|i| i as usize);
            for other in [b, c] {
                let (from, to) = (root(&mut parent, a), root(&mut parent, other));
                parent[from] = to;
            }
        }
        let mut volumes = BTreeMap::new();
        for triangle in &mesh.triangles {
            let [a, b, c] = mesh.corners(triangle);
            *volumes
                .entry(root(&mut parent, triangle.indices[0] as usize))
                .or_insert(0.0) += a.dot(b.cross(c)) / 6.0;
        }
        assert!(volumes.len() > 15, "only {} solids", volumes.len());
        assert!(volumes.values().all(|&volume| volume > 0.0), "{volumes:?}");
        // The volume of the pressurised hull and its tail cone is roughly 400 cubic metres.
        let largest = volumes.values().copied().fold(0.0, f64::max);
        assert!(
            (300.0..450.0).contains(&largest),
            "fuselage of {largest} m3"
        );
    }

    #[test]
    fn flaps_come_down_behind_the_wing() {
        let area_from_ahead = |flap_ratio| {
            let mesh = boeing_737_800(Configuration {
                flap_ratio,
                gear_ratio: 0.0,
            });
            mesh.triangles
                .iter()
                .filter(|t| t.material == Material::Flap)
                .map(|t| {
                    let [a, b, c] = mesh.corners(t);
                    ((b - a).cross(c - a).x / 2.0).max(0.0)
                })
                .sum::<f64>()
        };
        assert!(
            area_from_ahead(1.0) > 2.5 * area_from_ahead(0.0),
            "{} {}",
            area_from_ahead(1.0),
            area_from_ahead(0.0)
        );
    }

    #[test]
    fn the_mesh_stays_small_enough_to_be_drawn_every_frame() {
        let triangles = boeing_737_800(LANDING).triangles.len();
        assert!((1_500..6_000).contains(&triangles), "{triangles} triangles");
    }
}
