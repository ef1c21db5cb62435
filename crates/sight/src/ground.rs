//! The ground before a fixed camera, and what moves its image.

use dataset::geometry::camera::Camera;
use glam::{DVec2, DVec3};

/// Greatest elevation of stationary objects above the horizon, radians.
const ABOVE_HORIZON_RAD: f64 = 0.006;
/// Number of unknowns of a [`Motion`].
pub const UNKNOWNS: usize = 5;
/// The first two unknowns: the shift.
pub const SHIFT: std::ops::Range<usize> = 0..2;

/// Square pixels, for the unknowns of [`Motion::to_px`].
pub type Covariance = [[f64; UNKNOWNS]; UNKNOWNS];

/// Change of a place with each unknown, at no motion.
pub(crate) fn slopes(camera: &Camera, place_px: impl Fn(Motion) -> DVec2) -> [DVec2; UNKNOWNS] {
    const SMALL_PX: f64 = 1e-3;
    let here_px = place_px(Motion::default());
    std::array::from_fn(|unknown| {
        let mut step = [0.0; UNKNOWNS];
        step[unknown] = SMALL_PX;
        (place_px(Motion::of_px(step, camera)) - here_px) / SMALL_PX
    })
}

/// Motion of the ground between two images.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Motion {
    /// Shift at the image's centre by a turn of the camera, right and down, pixels.
    pub shift_px: DVec2,
    /// Rotation about the centre, clockwise, radians.
    pub roll_rad: f64,
    /// Relative growth of the focal length.
    pub zoom: f64,
    /// Relative growth of the camera's height, which stretches everything below the horizon.
    pub lift: f64,
}

impl Motion {
    /// The unknowns in pixels: rotation, zoom and lift as their effect at half of the image's width.
    pub fn to_px(self, camera: &Camera) -> [f64; UNKNOWNS] {
        let half_px = half_px(camera);
        let DVec2 { x, y } = self.shift_px;
        [
            x,
            y,
            self.roll_rad * half_px,
            self.zoom * half_px,
            self.lift * half_px,
        ]
    }

    /// The motion of these unknowns ([`Self::to_px`]).
    pub fn of_px([x, y, roll_px, zoom_px, lift_px]: [f64; UNKNOWNS], camera: &Camera) -> Self {
        let half_px = half_px(camera);
        Self {
            shift_px: DVec2::new(x, y),
            roll_rad: roll_px / half_px,
            zoom: zoom_px / half_px,
            lift: lift_px / half_px,
        }
    }

    /// This motion after another one. Motions are small: they add up.
    #[must_use]
    pub fn after(self, first: Self) -> Self {
        Self {
            shift_px: self.shift_px + first.shift_px,
            roll_rad: self.roll_rad + first.roll_rad,
            zoom: self.zoom + first.zoom,
            lift: self.lift + first.lift,
        }
    }

    /// The opposite motion.
    #[must_use]
    pub fn back(self) -> Self {
        Self {
            shift_px: -self.shift_px,
            roll_rad: -self.roll_rad,
            zoom: -self.zoom,
            lift: -self.lift,
        }
    }

    /// Place of a distant direction, in camera axes, after the motion.
    pub fn place_px(&self, camera: &Camera, direction: DVec3) -> DVec2 {
        let turned = camera.pixel_of(camera.turn(self.shift_px, self.roll_rad) * direction);
        camera.principal_px + (turned - camera.principal_px) * (1.0 + self.zoom)
    }

    /// Place before the motion of what appears at a place after it, far away.
    pub fn usual_px(&self, camera: &Camera, place_px: DVec2) -> DVec2 {
        let unzoomed = camera.principal_px + (place_px - camera.principal_px) / (1.0 + self.zoom);
        let turn = camera.turn(self.shift_px, self.roll_rad);
        camera.pixel_of(turn.transpose() * camera.image_of(unzoomed).extend(1.0))
    }
}

fn half_px(camera: &Camera) -> f64 {
    f64::from(camera.width_px) / 2.0
}

/// The ground that a camera sees, by its calibration: a mask, and the horizon.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ground {
    /// The camera.
    pub camera: Camera,
    /// Row of the horizon.
    pub horizon_px: f64,
    /// First row of stationary objects.
    pub top: usize,
}

impl Ground {
    /// The ground of a camera.
    pub fn of(camera: &Camera) -> Self {
        let up = camera.ecef_from_camera.transpose() * camera.center_ecef_m.normalize_or_zero();
        let horizon_px = camera.principal_px.y - camera.focal_px * up.z / up.y;
        let top_px = horizon_px - ABOVE_HORIZON_RAD * camera.focal_px;
        Self {
            camera: *camera,
            horizon_px,
            // NaN and values below 0 become 0.
            top: top_px as usize,
        }
    }

    /// Place of a point of the ground, by its direction and its place before the motion.
    pub(crate) fn place_px(&self, direction: DVec3, before_px: DVec2, motion: &Motion) -> DVec2 {
        let lifted_px = motion.lift * (before_px.y - self.horizon_px).max(0.0);
        motion.place_px(&self.camera, direction) + DVec2::new(0.0, lifted_px)
    }
}
