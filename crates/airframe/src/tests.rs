use super::*;
use std::collections::{BTreeMap, BTreeSet};

/// Wing span of the 737 over the winglets, metres.
const SPAN_M: f64 = 35.8;
/// From its nose to the tips of its horizontal tail, metres.
const LENGTH_M: f64 = 39.5;
/// Height of its fin's tip over ground on the ground, metres.
const HEIGHT_M: f64 = 12.5;

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
    for of in AircraftType::all() {
        let mesh = of.mesh(LANDING);
        // Off the round numbers of the figures, where rounding would be decided by the last bit.
        let key = |v: glam::DVec3| [v.x, v.y, v.z].map(|c| (c * 1e5 + 0.317).round() as i64);
        let present: BTreeSet<_> = mesh.vertices.iter().map(|&v| key(v)).collect();
        for vertex in &mesh.vertices {
            assert!(
                present.contains(&key(glam::DVec3::new(vertex.x, -vertex.y, vertex.z))),
                "{}: {vertex} has no twin",
                of.name
            );
        }
    }
}

#[test]
fn every_edge_joins_exactly_two_triangles_of_opposite_direction() {
    let types = AircraftType::all().iter();
    for (of, gear_ratio) in types.flat_map(|of| [0.0, 0.4, 1.0].map(|gear| (of, gear))) {
        let mesh = of.mesh(Configuration {
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
    for of in AircraftType::all() {
        let largest_m3 = volumes_face_outwards(&of.mesh(LANDING));
        // The hull is roughly a cylinder over three quarters of its length.
        let Published {
            length_m,
            fuselage_width_m: width_m,
            ..
        } = of.published;
        let cylinder_m3 = std::f64::consts::FRAC_PI_4 * width_m * width_m * length_m;
        let part = largest_m3 / cylinder_m3;
        assert!((0.65..0.95).contains(&part), "{}: {part}", of.name);
    }
}

/// The largest volume of a solid, cubic metres.
fn volumes_face_outwards(mesh: &Mesh) -> f64 {
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
    volumes.values().copied().fold(0.0, f64::max)
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
    for of in AircraftType::all() {
        let triangles = of.mesh(LANDING).triangles.len();
        assert!(
            (1_500..9_000).contains(&triangles),
            "{}: {triangles} triangles",
            of.name
        );
    }
}

fn is_near(found_m: f64, published_m: f64) -> bool {
    (found_m / published_m - 1.0).abs() < 0.005
}

#[test]
fn every_type_has_its_published_dimensions() {
    for of in AircraftType::all() {
        let published = of.published;
        let name = &of.name;
        let (min, max) = of.mesh(LANDING).bounds();
        let size = max - min;
        assert!(is_near(size.y, published.span_m), "{name}: span {}", size.y);
        assert!(
            is_near(size.x, published.length_m),
            "{name}: length {}",
            size.x
        );
        assert!(
            is_near(size.z, published.height_m),
            "{name}: height {}",
            size.z
        );
        assert!(
            (max.z - of.wheel_height_below_cg_m()).abs() < 1e-9,
            "{name}: wheels reach {}",
            max.z
        );
        let hull = of.mesh(Configuration::default());
        let width = hull
            .triangles
            .iter()
            .filter(|triangle| triangle.material == Material::Fuselage)
            .flat_map(|triangle| hull.corners(triangle))
            .fold(0.0, |width: f64, corner| width.max(2.0 * corner.y));
        assert!(
            is_near(width, published.fuselage_width_m),
            "{name}: fuselage {width}"
        );
    }
}

#[test]
fn the_builder_makes_the_silhouette_of_the_737_that_is_drawn_by_hand() {
    let of = AircraftType::boeing_737_800();
    for configuration in [Configuration::default(), LANDING] {
        let (drawn, built) = (of.mesh(configuration), of.built_mesh(configuration));
        assert_ne!(drawn, built);
        for view in [View::Ahead, View::Side] {
            let overlap = three_views::overlap(&drawn, &built, view, 0.02);
            assert!(overlap >= 0.97, "{view:?} {configuration:?}: {overlap}");
        }
    }
}

#[test]
fn a_type_is_found_by_name_and_designator_and_a_wrong_one_names_the_nearest() {
    for of in AircraftType::all() {
        assert_eq!(AircraftType::named(&of.name).unwrap().name, of.name);
        assert_eq!(AircraftType::named(&of.designator).unwrap().name, of.name);
    }
    for (wrong, nearest) in [
        ("A350-1000", "A350-900"),
        ("ATR 72-600", "ATR72-600"),
        ("b77w", "B777-300ER"),
    ] {
        assert_eq!(AircraftType::named(wrong).unwrap_err().nearest, nearest);
    }
    let error = AircraftType::named("A380").unwrap_err();
    assert!(error.to_string().contains("B77W"), "{error}");
}
