//! Cameras: where they are, and where a point of the world appears in their image. Pinholes, unless a calibration specifies lens
//! distortion or refraction.
//!
//! Camera axes are OpenCV's: x right, y down, z forward. Pixel (0, 0) is the **centre** of the top-left pixel, so an image covers -0.5 to
//! width - 0.5.

pub mod camera_adjustment;

use glam::{DMat3, DQuat, DVec2, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::geometry::distortion::{Distortion, FIELD_OVER_HALF_DIAGONAL};
use crate::geometry::imaging::Imaging;
use crate::geometry::pose::Pose;
use crate::geometry::refraction::Refraction;

/// A camera's placement: a pose whose forward axis is the optical axis, and a horizontal field of view.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CameraPose {
    /// Position and direction of the camera.
    #[serde(flatten)]
    pub pose: Pose,
    /// Horizontal field of view over the whole width of the image, degrees.
    pub hfov_deg: f64,
}

/// Camera intrinsics and extrinsics.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Width of the image, pixels.
    pub width_px: u32,
    /// Height of the image, pixels.
    pub height_px: u32,
    /// Focal length, pixels (square pixels).
    pub focal_px: f64,
    /// Principal point, pixels.
    pub principal_px: DVec2,
    /// Rotation from camera axes to ECEF.
    pub ecef_from_camera: DMat3,
    /// The projection centre in ECEF, metres.
    pub center_ecef_m: DVec3,
    /// Distortion of the lens; `None` for a pinhole.
    pub distortion: Option<Distortion>,
    /// Refraction of the air; `None` for straight light.
    pub refraction: Option<Refraction>,
}

impl Camera {
    /// The camera for a placement: principal point in the centre of the image, `focal = (width / 2) / tan(hfov / 2)`.
    pub fn from_pose(placed: &CameraPose, width_px: u32, height_px: u32) -> Self {
        // Columns: the camera's right, down and forward axes in body axes (forward, right, down).
        let body_from_camera = DMat3::from_cols(DVec3::Y, DVec3::Z, DVec3::X);
        Self {
            width_px,
            height_px,
            focal_px: f64::from(width_px) / 2.0 / (placed.hfov_deg.to_radians() / 2.0).tan(),
            principal_px: DVec2::new(
                (f64::from(width_px) - 1.0) / 2.0,
                (f64::from(height_px) - 1.0) / 2.0,
            ),
            ecef_from_camera: placed.pose.ecef_from_body() * body_from_camera,
            center_ecef_m: placed.pose.position().to_ecef(),
            distortion: None,
            refraction: None,
        }
    }

    /// The camera with the lens and the refraction of `imaging`.
    #[must_use]
    pub fn seen_through(self, imaging: &Imaging) -> Self {
        Self {
            distortion: imaging.distortion,
            refraction: Refraction::new(imaging.refraction_coefficient, self.center_ecef_m),
            ..self
        }
    }

    /// Apparent position of the ECEF point, in camera axes (right, down, forward), metres: its true position unless there is refraction.
    pub fn to_camera(&self, ecef_m: DVec3) -> DVec3 {
        let seen_m = ecef_m - self.center_ecef_m;
        let appears_m = match self.refraction {
            None => seen_m,
            Some(refraction) => seen_m + refraction.lift(seen_m),
        };
        self.ecef_from_camera.transpose() * appears_m
    }

    /// The pixel where an ECEF point appears; `None` if it is not in front of the camera. The pixel may be outside the image.
    pub fn project(&self, ecef_m: DVec3) -> Option<DVec2> {
        let point = self.to_camera(ecef_m);
        (point.z > 0.0).then(|| self.pixel_of(point))
    }

    /// True if an ECEF point is within the image.
    pub fn shows(&self, ecef_m: DVec3) -> bool {
        // Pixel (0, 0) covers -0.5 to 0.5.
        let inside =
            |place_px: f64, size_px: u32| (-0.5..f64::from(size_px) - 0.5).contains(&place_px);
        self.project(ecef_m)
            .is_some_and(|at| inside(at.x, self.width_px) && inside(at.y, self.height_px))
    }

    /// The pixel where a point in camera axes appears; the point must be in front of the camera.
    pub fn pixel_of(&self, camera_m: DVec3) -> DVec2 {
        match self.distortion {
            None => {
                DVec2::new(camera_m.x, camera_m.y) * (self.focal_px / camera_m.z)
                    + self.principal_px
            }
            Some(lens) => {
                let ideal = camera_m.truncate() / camera_m.z;
                lens.distort_within(ideal, self.field()) * self.focal_px + self.principal_px
            }
        }
    }

    /// A pixel's undistorted direction: right and down of the optical axis per unit of depth.
    pub fn image_of(&self, pixel: DVec2) -> DVec2 {
        let seen = (pixel - self.principal_px) / self.focal_px;
        match self.distortion {
            None => seen,
            Some(lens) => lens.undistort_within(seen, self.field()),
        }
    }

    /// Unit vector in ECEF from the camera through a pixel: the direction that light comes from.
    pub fn ray(&self, pixel: DVec2) -> DVec3 {
        (self.ecef_from_camera * self.image_of(pixel).extend(1.0)).normalize()
    }

    /// Unit vector in ECEF from the camera to the object seen at a pixel and at this distance: below the arriving light if there is
    /// refraction.
    pub fn ray_to(&self, pixel: DVec2, distance_m: f64) -> DVec3 {
        let arrives = self.ray(pixel);
        match self.refraction {
            None => arrives,
            Some(refraction) => {
                let appears_m = arrives * distance_m;
                (appears_m - refraction.lift(appears_m)).normalize()
            }
        }
    }

    /// Distance of the image's corners from its centre, in image coordinates.
    pub fn corner(&self) -> f64 {
        f64::from(self.width_px).hypot(f64::from(self.height_px)) / 2.0 / self.focal_px
    }

    /// Up to this radius, in image coordinates, the lens follows its polynomials.
    fn field(&self) -> f64 {
        FIELD_OVER_HALF_DIAGONAL * self.corner()
    }

    /// Rotation of directions, in camera axes, that moves what appears at the principal point by some pixels and turns the image about it,
    /// clockwise, for small angles.
    pub fn turn(&self, shift_px: DVec2, roll_rad: f64) -> DMat3 {
        let [x, y] = (shift_px / self.focal_px).to_array();
        DMat3::from_quat(DQuat::from_scaled_axis(DVec3::new(-y, x, roll_rad)))
    }

    /// The 3x3 matrix of intrinsics, row-major.
    pub fn k(&self) -> [[f64; 3]; 3] {
        [
            [self.focal_px, 0.0, self.principal_px.x],
            [0.0, self.focal_px, self.principal_px.y],
            [0.0, 0.0, 1.0],
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::geodesy::LatLon;

    fn camera() -> (CameraPose, Camera) {
        let placed = CameraPose {
            pose: Pose {
                latitude_deg: 1.36,
                longitude_deg: 103.98,
                altitude_msl_m: 16.7,
                heading_true_deg: 203.0,
                pitch_deg: 0.0,
                roll_deg: 0.0,
            },
            hfov_deg: 10.0,
        };
        (placed, Camera::from_pose(&placed, 1920, 1280))
    }

    #[test]
    fn a_point_straight_ahead_falls_on_the_principal_point() {
        let (placed, camera) = camera();
        let ahead = placed
            .pose
            .body_point_to_ecef(DVec3::new(5_000.0, 0.0, 0.0));
        assert!(
            camera
                .project(ahead)
                .unwrap()
                .abs_diff_eq(DVec2::new(959.5, 639.5), 1e-6)
        );
    }

    #[test]
    fn right_is_right_and_down_is_down_and_behind_is_nowhere() {
        let (placed, camera) = camera();
        let pixel = camera
            .project(
                placed
                    .pose
                    .body_point_to_ecef(DVec3::new(1_000.0, 10.0, 5.0)),
            )
            .unwrap();
        assert!(pixel.x > 959.5 && pixel.y > 639.5, "{pixel}");
        assert_eq!(
            camera.project(
                placed
                    .pose
                    .body_point_to_ecef(DVec3::new(-1_000.0, 0.0, 0.0))
            ),
            None
        );
    }

    #[test]
    fn half_the_field_of_view_reaches_the_edge_of_the_picture() {
        let (placed, camera) = camera();
        let edge = DVec3::new(1.0, 5.0_f64.to_radians().tan(), 0.0) * 1_000.0;
        let pixel = camera
            .project(placed.pose.body_point_to_ecef(edge))
            .unwrap();
        assert!((pixel.x - 1919.5).abs() < 1e-6, "{pixel}");
    }

    #[test]
    fn a_ray_goes_back_through_its_pixel() {
        let (_, camera) = camera();
        let pixel = DVec2::new(123.25, 1_000.75);
        let point = camera.center_ecef_m + camera.ray(pixel) * 12_345.0;
        assert!(camera.project(point).unwrap().abs_diff_eq(pixel, 1e-6));
    }

    #[test]
    fn a_ray_through_a_lens_and_bent_light_goes_back_to_its_point() {
        let (placed, camera) = camera();
        let camera = camera.seen_through(&Imaging {
            distortion: Some(Distortion {
                k1: -2.0,
                p2: 0.003,
                ..Distortion::default()
            }),
            refraction_coefficient: 0.13,
            degradation: None,
        });
        let point = placed
            .pose
            .body_point_to_ecef(DVec3::new(18_520.0, 1_400.0, -700.0));
        let pixel = camera.project(point).unwrap();
        let distance_m = point.distance(camera.center_ecef_m);
        let back = camera.center_ecef_m + camera.ray_to(pixel, distance_m) * distance_m;
        assert!(back.distance(point) < 1e-3, "{}", back.distance(point));
        let straight = camera.center_ecef_m + camera.ray(pixel) * distance_m;
        let above_m = straight.distance(point);
        assert!((above_m - 3.51).abs() < 0.03, "{above_m}");
    }

    #[test]
    fn refraction_lifts_an_aircraft_at_ten_miles_by_two_pixels_of_ten_degrees() {
        let (placed, camera) = camera();
        let bent = camera.seen_through(&Imaging {
            refraction_coefficient: 0.13,
            ..Imaging::default()
        });
        let point = placed
            .pose
            .body_point_to_ecef(DVec3::new(18_520.0, 0.0, 0.0));
        let [plain, lifted] = [camera, bent].map(|camera| camera.project(point).unwrap());
        let off = lifted - plain;
        assert!((off.y + 2.07).abs() < 0.02 && off.x.abs() < 1e-9, "{off}");
    }

    #[test]
    fn the_earth_curves_away_by_27_metres_at_ten_nautical_miles() {
        let (placed, camera) = camera();
        let here = LatLon {
            latitude_deg: 1.36,
            longitude_deg: 103.98,
        };
        let there = here
            .destination(203.0, 18_520.0)
            .at_altitude_m(placed.pose.altitude_msl_m);
        let drop_m = camera.to_camera(there.to_ecef()).y;
        assert!((drop_m - 27.0).abs() < 0.2, "{drop_m}");
    }
}
