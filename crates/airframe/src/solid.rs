//! Closed solids from rings of points: lofts (skins stretched over cross-sections) and surfaces of revolution.

use glam::DVec3;

use crate::{Material, Mesh, Triangle};

/// Adds the closed skin over `rings` (cross-sections of equally many points, in order along the body), with a flat cap on each end.
/// `material(ring, segment)` paints the quad between ring and ring + 1 at a segment; caps take the paint of the nearest quad.
/// The winding is turned outwards whatever the sense of the rings, so that a mirrored part needs no second version.
pub(crate) fn add_loft(
    mesh: &mut Mesh,
    rings: &[Vec<DVec3>],
    material: impl Fn(usize, usize) -> Material,
) {
    let first_vertex = mesh.vertices.len() as u32;
    let first_triangle = mesh.triangles.len();
    let size = rings[0].len();
    let index = |ring: usize, segment: usize| first_vertex + (ring * size + segment % size) as u32;

    mesh.vertices.extend(rings.iter().flatten());
    for ring in 0..rings.len() - 1 {
        for segment in 0..size {
            let [a, b] = [index(ring, segment), index(ring, segment + 1)];
            let [c, d] = [index(ring + 1, segment), index(ring + 1, segment + 1)];
            let material = material(ring, segment);
            mesh.triangles.push(Triangle {
                indices: [a, c, b],
                material,
            });
            mesh.triangles.push(Triangle {
                indices: [b, c, d],
                material,
            });
        }
    }
    let last = rings.len() - 1;
    for (ring, painted_as) in [(0, 0), (last, last - 1)] {
        let center = mesh.vertices.len() as u32;
        mesh.vertices
            .push(rings[ring].iter().sum::<DVec3>() / size as f64);
        for segment in 0..size {
            let [a, b] = [index(ring, segment), index(ring, segment + 1)];
            let indices = if ring == 0 {
                [center, a, b]
            } else {
                [center, b, a]
            };
            mesh.triangles.push(Triangle {
                indices,
                material: material(painted_as, segment),
            });
        }
    }
    turn_outwards(mesh, first_triangle);
}

/// Adds a body of revolution about an axis: `profile` lists (distance along the axis, radius), `axis` and `zero_direction` are
/// orthogonal unit vectors. Equal neighbouring radii make cylinders; the profile may turn back into itself (an intake).
pub(crate) fn add_revolution(
    mesh: &mut Mesh,
    origin: DVec3,
    axis: DVec3,
    zero_direction: DVec3,
    segments: usize,
    profile: &[(f64, f64)],
    material: impl Fn(usize) -> Material,
) {
    let other_direction = axis.cross(zero_direction);
    let rings: Vec<Vec<DVec3>> = profile
        .iter()
        .map(|&(along, radius)| {
            (0..segments)
                .map(|segment| {
                    let (sin, cos) =
                        (std::f64::consts::TAU * segment as f64 / segments as f64).sin_cos();
                    origin + axis * along + (zero_direction * cos + other_direction * sin) * radius
                })
                .collect()
        })
        .collect();
    add_loft(mesh, &rings, |ring, _| material(ring));
}

fn turn_outwards(mesh: &mut Mesh, first_triangle: usize) {
    // The signed volume about a point of the solid itself: about a distant origin, rounding would dominate for thin parts.
    let origin = mesh.vertices[mesh.triangles[first_triangle].indices[0] as usize];
    let volume: f64 = mesh.triangles[first_triangle..]
        .iter()
        .map(|triangle| {
            let [a, b, c] = mesh.corners(triangle).map(|corner| corner - origin);
            a.dot(b.cross(c))
        })
        .sum();
    if volume < 0.0 {
        for triangle in &mut mesh.triangles[first_triangle..] {
            triangle.indices.swap(1, 2);
        }
    }
}
