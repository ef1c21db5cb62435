//! Camera motion between two images of the same scene: a rotation and a small change in height.
//!
//! A rotation moves every direction alike. Height moves the ground below the horizon, the more the closer it is: a point at depth z is
//! drawn `focal H / z` below the horizon, so raising the camera from height H by s H stretches everything below the horizon by
//! s. The horizon itself, and an aircraft beyond it, stays.

use dataset::geometry::camera::Camera;
use glam::{DMat3, DQuat, DVec2, DVec3};

pub(crate) const UNKNOWNS: usize = 4;

/// Motion from the first image to the second.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Motion {
    /// Rotation vector (axis times angle) in camera axes, radians, from directions in the first image to directions in the second.
    pub(crate) turn_rad: DVec3,
    /// Relative vertical stretch below the horizon.
    pub(crate) stretch: f64,
}

impl Motion {
    pub(crate) fn to_array(self) -> [f64; UNKNOWNS] {
        let DVec3 { x, y, z } = self.turn_rad;
        [x, y, z, self.stretch]
    }

    pub(crate) fn from_array([x, y, z, stretch]: [f64; UNKNOWNS]) -> Self {
        Self {
            turn_rad: DVec3::new(x, y, z),
            stretch,
        }
    }

    /// Ground point position in the second image, with the horizon in the given row.
    pub(crate) fn of_ground(&self, camera: &Camera, horizon_px: f64, place: DVec2) -> DVec2 {
        let down = self.stretch * (place.y - horizon_px).max(0.0);
        turned(camera, matrix(self.turn_rad), place) + DVec2::new(0.0, down)
    }
}

pub(crate) fn matrix(turn_rad: DVec3) -> DMat3 {
    DMat3::from_quat(DQuat::from_scaled_axis(turn_rad))
}

/// Composition: `first`, then `then`.
pub(crate) fn after(then: DVec3, first: DVec3) -> DVec3 {
    (DQuat::from_scaled_axis(then) * DQuat::from_scaled_axis(first)).to_scaled_axis()
}

/// Pixel position after a rotation.
pub(crate) fn turned(camera: &Camera, turn: DMat3, place: DVec2) -> DVec2 {
    camera.pixel_of(turn * camera.image_of(place).extend(1.0))
}
