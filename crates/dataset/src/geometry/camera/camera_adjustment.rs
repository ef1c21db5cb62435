//! Rotation, zoom and displacement relative to a given camera.

use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

use crate::geometry::camera::Camera;
use crate::geometry::geodesy::Geodetic;

/// Numbers of an [`Adjustment`].
pub const UNKNOWNS: usize = 7;

/// Difference from a given camera, or its standard deviations.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Adjustment {
    /// Pan of the optical axis to the right, degrees.
    pub pan_deg: f64,
    /// Upward tilt of the optical axis, degrees.
    pub tilt_deg: f64,
    /// Roll about the optical axis, right side down, degrees.
    pub roll_deg: f64,
    /// Increase of the focal length, percent.
    pub focal_pct: f64,
    /// Displacement to the north, metres.
    pub north_m: f64,
    /// Displacement to the east, metres.
    pub east_m: f64,
    /// Upward displacement, metres.
    pub up_m: f64,
}

impl Adjustment {
    /// The numbers in the order of the fields.
    pub fn to_array(self) -> [f64; UNKNOWNS] {
        [
            self.pan_deg,
            self.tilt_deg,
            self.roll_deg,
            self.focal_pct,
            self.north_m,
            self.east_m,
            self.up_m,
        ]
    }

    /// The difference with these numbers, in the order of the fields.
    pub fn from_array(numbers: [f64; UNKNOWNS]) -> Self {
        let [
            pan_deg,
            tilt_deg,
            roll_deg,
            focal_pct,
            north_m,
            east_m,
            up_m,
        ] = numbers;
        Self {
            pan_deg,
            tilt_deg,
            roll_deg,
            focal_pct,
            north_m,
            east_m,
            up_m,
        }
    }

    /// Applies the difference to a camera.
    pub fn applied_to(&self, given: &Camera) -> Camera {
        // Camera axes: x right, y down, z forward.
        let turned = DMat3::from_rotation_y(self.pan_deg.to_radians())
            * DMat3::from_rotation_x(self.tilt_deg.to_radians())
            * DMat3::from_rotation_z(self.roll_deg.to_radians());
        let ecef_from_ned = Geodetic::from_ecef(given.center_ecef_m).ecef_from_ned();
        let moved_m = ecef_from_ned * DVec3::new(self.north_m, self.east_m, -self.up_m);
        Camera {
            focal_px: given.focal_px * (1.0 + self.focal_pct / 100.0),
            ecef_from_camera: given.ecef_from_camera * turned,
            center_ecef_m: given.center_ecef_m + moved_m,
            ..*given
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;
    use crate::geometry::camera::CameraPose;
    use crate::geometry::pose::Pose;

    fn camera() -> Camera {
        let placed = CameraPose {
            pose: Pose {
                latitude_deg: 1.36,
                longitude_deg: 103.98,
                altitude_msl_m: 16.7,
                heading_true_deg: 197.7,
                pitch_deg: 1.6,
                roll_deg: 0.0,
            },
            hfov_deg: 10.0,
        };
        Camera::from_pose(&placed, 1920, 1280)
    }

    #[test]
    fn each_number_moves_the_picture_the_way_its_name_says() {
        let rig = camera();
        // Ahead of the camera, up and to the right of its axis.
        let point_m =
            rig.center_ecef_m + rig.ecef_from_camera * DVec3::new(200.0, -100.0, 10_000.0);
        let before = rig.project(point_m).unwrap();
        let moved_px =
            |adjustment: Adjustment| adjustment.applied_to(&rig).project(point_m).unwrap() - before;
        let none = Adjustment::default();
        assert_eq!(moved_px(none), DVec2::ZERO);
        let pan = moved_px(Adjustment {
            pan_deg: 0.1,
            ..none
        });
        assert!(pan.x < -19.0 && pan.y.abs() < 0.1, "turned right: {pan}");
        let tilt = moved_px(Adjustment {
            tilt_deg: 0.1,
            ..none
        });
        assert!(tilt.y > 19.0 && tilt.x.abs() < 0.1, "turned up: {tilt}");
        let roll = moved_px(Adjustment {
            roll_deg: 0.1,
            ..none
        });
        assert!(roll.x < 0.0 && roll.y < 0.0, "right side down: {roll}");
        let zoom = moved_px(Adjustment {
            focal_pct: 1.0,
            ..none
        });
        assert!(zoom.x > 2.0 && zoom.y < -1.0, "longer: {zoom}");
        let up = moved_px(Adjustment { up_m: 1.0, ..none });
        assert!(up.y > 1.0 && up.x.abs() < 0.01, "moved up: {up}");
    }

    #[test]
    fn numbers_are_read_back_in_the_same_order() {
        let numbers = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
        assert_eq!(Adjustment::from_array(numbers).to_array(), numbers);
        assert_eq!(Adjustment::from_array(numbers).focal_pct, 4.0);
    }
}
