//! Places of the aircraft in images that turbulent air and a swaying mast move.
//!
//! Ground-truth boxes assume still air and a still mast. The calibration has the settings of both motions and their seed, and
//! [`image_motion`](dataset::geometry::imaging::image_motion) computes them, so that images are compared with the place where they have to
//! show the aircraft, as strictly as a fixed camera's images.

use glam::DVec3;

use dataset::corpus::calibration::CameraEntry;
use dataset::geometry::imaging::image_motion::{SwayMotion, TiltMotion};
use dataset::tables::frames::TickRow;
use dataset::tables::pixel_box::PixelBox;

/// Motion of the camera's images.
pub(super) struct MovingImage {
    centre_ecef_m: DVec3,
    tilt: Option<TiltMotion>,
    sway: Option<SwayMotion>,
}

impl MovingImage {
    /// `None` if the images stand still.
    pub(super) fn of(camera: &CameraEntry) -> Option<Self> {
        let degradation = camera.degradation?;
        let seed = degradation.seed;
        let focal_px = camera.k[0][0];
        let tilt = (degradation.seeing).map(|seeing| TiltMotion::new(&seeing, focal_px, seed));
        let sway = degradation.sway.map(|sway| SwayMotion::new(&sway, seed));
        (tilt.is_some() || sway.is_some()).then(|| Self {
            centre_ecef_m: camera.ecef_from_camera.translation_m.into(),
            tilt,
            sway,
        })
    }

    /// The place where a ground-truth box's aircraft appears.
    pub(super) fn place(&self, truth: PixelBox, row: &TickRow) -> PixelBox {
        let time_s = row.time_ns as f64 / 1e9;
        let aircraft_m = row.pose.position().to_ecef();
        let tilt = self.tilt.as_ref();
        let sway = self.sway.as_ref();
        let shift_px = tilt.map_or_else(Default::default, |tilt| {
            tilt.shift_px(aircraft_m.distance(self.centre_ecef_m), time_s)
        }) + sway.map_or_else(Default::default, |sway| sway.shift_px(time_s));
        PixelBox {
            cx_px: truth.cx_px + shift_px.x,
            cy_px: truth.cy_px + shift_px.y,
            ..truth
        }
    }
}
