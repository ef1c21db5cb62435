//! A triangle mesh with paint.

use glam::DVec3;

use crate::Material;

/// Triangle mesh in body axes (x forward, y right, z down), metres, origin at the centre of gravity.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Mesh {
    /// Corner points, metres.
    pub vertices: Vec<DVec3>,
    /// Faces, counter-clockwise as seen from outside.
    pub triangles: Vec<Triangle>,
}

/// Face of a [`Mesh`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Triangle {
    /// Indices of the corners in [`Mesh::vertices`].
    pub indices: [u32; 3],
    /// Material of the face.
    pub material: Material,
}

impl Mesh {
    /// Corners of a triangle, metres in body axes.
    pub fn corners(&self, triangle: &Triangle) -> [DVec3; 3] {
        triangle.indices.map(|index| self.vertices[index as usize])
    }

    /// Smallest and largest coordinates over all vertices, metres in body axes. Infinite (and reversed) for an empty mesh.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        self.vertices.iter().fold(
            (DVec3::INFINITY, DVec3::NEG_INFINITY),
            |(min, max), &vertex| (min.min(vertex), max.max(vertex)),
        )
    }
}
