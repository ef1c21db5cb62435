//! The ground-truth box of an aircraft in an image: its mesh at its pose, seen by a calibrated camera, and what others hide of it.
//!
//! The box spans the projected vertices in continuous pixel coordinates (pixel centres at whole numbers): its centre is the
//! midpoint of their extremes, its edges touch the outermost ones.

use airframe::Mesh;
use dataset::geometry::camera::Camera;
use dataset::geometry::pose::Pose;
use dataset::tables::pixel_box::PixelBox;
use glam::{DVec2, DVec3};

use silhouette::{HalfSpace, SampleGrid};

/// Least distance from the camera of points that are projected, metres.
const NEAR_M: f64 = 0.1;
/// Samples along the box's longer side when the visible part is counted: for 21 pixels a grid with 1/24 px steps.
const SAMPLES: usize = 512;

/// The visible aircraft in a camera's image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Projection {
    /// Box of the projected mesh, clipped to the image.
    pub pixel_box: PixelBox,
    /// Part of the silhouette inside the image and above the ground, 0 to 1.
    pub visible_fraction: f64,
    /// Part of the unclipped box outside the image, 0 to 1.
    pub truncation: f64,
    /// Distance of the centre of gravity from the camera, metres.
    pub range_m: f64,
}

/// A visible aircraft in an image.
pub(crate) struct Sighting<'a> {
    body: BodyInCamera<'a>,
    /// Its box.
    pub(crate) projection: Projection,
}

impl<'a> Sighting<'a> {
    /// Projects an aircraft; `None` if it is not visible in the image. The ground is level at `ground_msl_m`: lower parts of the mesh are
    /// hidden, as the camera stands above.
    pub(crate) fn of(
        mesh: &'a Mesh,
        pose: &Pose,
        camera: &Camera,
        ground_msl_m: f64,
    ) -> Option<Self> {
        let body = BodyInCamera::new(mesh, pose, camera, ground_msl_m);
        let projection = body.projected(camera)?;
        Some(Self { body, projection })
    }

    /// Part of its visible silhouette that nearer ones of `all` hide.
    pub(crate) fn occluded_fraction(&self, all: &[Option<Self>], camera: &Camera) -> f64 {
        let own = &self.projection;
        let nearer: Vec<&BodyInCamera<'_>> = (all.iter().flatten())
            .filter(|other| {
                let overlap = other.projection.pixel_box.intersection(&own.pixel_box);
                other.projection.range_m < own.range_m && overlap > 0.0
            })
            .map(|other| &other.body)
            .collect();
        if nearer.is_empty() {
            0.0
        } else {
            self.body.occluded_fraction(&own.pixel_box, &nearer, camera)
        }
    }
}

/// The mesh in camera axes, metres.
struct BodyInCamera<'a> {
    mesh: &'a Mesh,
    vertices: Vec<DVec3>,
    above_ground: HalfSpace,
    range_m: f64,
}

const IN_FRONT: HalfSpace = HalfSpace {
    normal: DVec3::Z,
    offset_m: NEAR_M,
};

impl<'a> BodyInCamera<'a> {
    fn new(mesh: &'a Mesh, pose: &Pose, camera: &Camera, ground_msl_m: f64) -> Self {
        let camera_from_ecef = camera.ecef_from_camera.transpose();
        let camera_from_body = camera_from_ecef * pose.ecef_from_body();
        let origin = camera.to_camera(pose.position().to_ecef());
        // The tangent plane below the aircraft: over its length the ellipsoid deviates by 0.03 mm.
        let foot = dataset::geometry::geodesy::Geodetic {
            altitude_msl_m: ground_msl_m,
            ..pose.position()
        };
        let up = camera_from_ecef * -foot.ecef_from_ned().z_axis;
        Self {
            mesh,
            vertices: mesh
                .vertices
                .iter()
                .map(|vertex| origin + camera_from_body * *vertex)
                .collect(),
            above_ground: HalfSpace {
                normal: up,
                offset_m: up.dot(camera.to_camera(foot.to_ecef())),
            },
            // Refraction makes the aircraft appear elsewhere, not farther away.
            range_m: match camera.refraction {
                None => origin.length(),
                Some(_) => camera.center_ecef_m.distance(pose.position().to_ecef()),
            },
        }
    }

    fn projected(&self, camera: &Camera) -> Option<Projection> {
        let outline = self.outline(camera)?;
        let inside = outline.clipped_to(camera.width_px, camera.height_px)?;
        let is_inside = is_inside(&outline, camera);
        // The areas of the same rectangle, computed in two ways, differ in the last digit.
        let truncation = if is_inside {
            0.0
        } else {
            1.0 - inside.area() / outline.area()
        };
        let whole = is_inside && self.is_above_ground();
        let visible_fraction = if whole {
            1.0
        } else {
            self.visible_fraction(&outline, camera)
        };
        (visible_fraction > 0.0).then_some(Projection {
            pixel_box: inside,
            visible_fraction,
            truncation: truncation.max(0.0),
            range_m: self.range_m,
        })
    }

    fn triangles(&self) -> impl Iterator<Item = [DVec3; 3]> {
        self.mesh
            .triangles
            .iter()
            .map(|triangle| triangle.indices.map(|index| self.vertices[index as usize]))
    }

    /// The box around everything in front of the camera, unclipped.
    fn outline(&self, camera: &Camera) -> Option<PixelBox> {
        let mut extremes: Option<(DVec2, DVec2)> = None;
        let mut include = |point: DVec3| {
            let pixel = camera.pixel_of(point);
            let (low, high) = extremes.unwrap_or((pixel, pixel));
            extremes = Some((low.min(pixel), high.max(pixel)));
        };
        for triangle in self.triangles() {
            if triangle.iter().all(|point| point.z >= NEAR_M) {
                triangle.into_iter().for_each(&mut include);
            } else {
                IN_FRONT.clip(&triangle).into_iter().for_each(&mut include);
            }
        }
        extremes.map(|(low, high)| PixelBox::from_edges(low.x, low.y, high.x, high.y))
    }

    fn is_above_ground(&self) -> bool {
        self.triangles()
            .flatten()
            .all(|point| self.above_ground.height_m(point) >= 0.0)
    }

    /// Adds the silhouette to a grid, once as a whole and once above the ground.
    fn fill(&self, grid: &mut SampleGrid, camera: &Camera, [whole, above_ground]: [u8; 2]) {
        for triangle in self.triangles() {
            let front = IN_FRONT.clip(&triangle);
            let pixels = |polygon: &[DVec3]| {
                polygon
                    .iter()
                    .map(|point| camera.pixel_of(*point))
                    .collect::<Vec<_>>()
            };
            grid.fill(&pixels(&front), whole);
            grid.fill(&pixels(&self.above_ground.clip(&front)), above_ground);
        }
    }

    fn visible_fraction(&self, outline: &PixelBox, camera: &Camera) -> f64 {
        const WHOLE: u8 = 1;
        const ABOVE_GROUND: u8 = 2;
        let mut grid = grid_over(outline);
        self.fill(&mut grid, camera, [WHOLE, ABOVE_GROUND]);
        let (right, bottom) = (
            f64::from(camera.width_px) - 0.5,
            f64::from(camera.height_px) - 0.5,
        );
        let in_picture =
            |at: DVec2| at.x >= -0.5 && at.x <= right && at.y >= -0.5 && at.y <= bottom;
        let whole = grid.count(|_, mark| mark & WHOLE != 0);
        let seen = grid.count(|at, mark| mark & ABOVE_GROUND != 0 && in_picture(at));
        if whole == 0 {
            0.0
        } else {
            (seen as f64 / whole as f64).min(1.0)
        }
    }

    /// Part of the silhouette within its box, which is clipped to the image, that nearer ones hide.
    fn occluded_fraction(&self, within: &PixelBox, nearer: &[&Self], camera: &Camera) -> f64 {
        const OWN: u8 = 1;
        const NEARER: u8 = 2;
        let mut grid = grid_over(within);
        self.fill(&mut grid, camera, [0, OWN]);
        for other in nearer {
            other.fill(&mut grid, camera, [0, NEARER]);
        }
        let own = grid.count(|_, mark| mark & OWN != 0);
        let hidden = grid.count(|_, mark| mark & (OWN | NEARER) == OWN | NEARER);
        hidden as f64 / own.max(1) as f64
    }
}

fn grid_over(outline: &PixelBox) -> SampleGrid {
    let [left, top, right, bottom] = outline.edges();
    SampleGrid::over(DVec2::new(left, top), DVec2::new(right, bottom), SAMPLES)
}

fn is_inside(outline: &PixelBox, camera: &Camera) -> bool {
    let [left, top, right, bottom] = outline.edges();
    left >= -0.5
        && top >= -0.5
        && right <= f64::from(camera.width_px) - 0.5
        && bottom <= f64::from(camera.height_px) - 0.5
}

mod silhouette;
#[cfg(test)]
mod tests;
