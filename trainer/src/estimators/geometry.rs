//! Estimators that intersect lines of sight, and cameras of the rig fitted to labelled flights.

pub(crate) mod self_calibration;
pub(crate) mod triangulation;

use dataset::corpus::calibration::{CameraEntry, RigidTransform};
use dataset::geometry::camera::Camera;
use serde::{Deserialize, Serialize};

use crate::samples::rig::moved_rig::Move;
use dataset::geometry::camera::camera_adjustment::Adjustment;

/// The planned camera, slightly turned, zoomed and moved.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct FittedCamera {
    /// Starting point of the fit.
    pub rig: CameraEntry,
    /// Fitted difference.
    pub adjustment: Adjustment,
    /// Standard deviations of the difference.
    pub sd: Adjustment,
    /// Ticks that it was fitted to.
    pub ticks: usize,
}

impl FittedCamera {
    /// Moves the camera with its runway to a different airport. The adjustment, which has compass directions, is included in the rig
    /// camera.
    pub(crate) fn move_with(&mut self, motion: &Move) {
        let fitted = self.camera();
        let mut rig = motion.entry(&self.rig);
        let moved = motion.camera(&fitted);
        rig.k = fitted.k();
        rig.ecef_from_camera = RigidTransform {
            rotation: moved.ecef_from_camera.transpose().to_cols_array_2d(),
            translation_m: moved.center_ecef_m.to_array(),
        };
        self.rig = rig;
        self.adjustment = Adjustment::default();
    }

    pub(crate) fn camera(&self) -> Camera {
        self.adjustment.applied_to(&self.rig.camera())
    }
}
