//! A camera of the rig as fitted to labelled flights: the planned camera, slightly turned, zoomed and moved.

use dataset::corpus::calibration::{CameraEntry, RigidTransform};
use dataset::geometry::camera::Camera;
use serde::{Deserialize, Serialize};

use crate::samples::rig::moved_rig::Move;
use crate::samples::training_cameras::camera_adjustment::Adjustment;

/// A fitted camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct FittedCamera {
    /// The camera of the rig that the fit started from.
    pub rig: CameraEntry,
    /// The fitted difference.
    pub adjustment: Adjustment,
    /// Its standard deviations.
    pub sd: Adjustment,
    /// Ticks at which it saw the aircraft and that it was fitted to.
    pub ticks: usize,
}

impl FittedCamera {
    /// Moves the camera with its runway to another one. Its adjustment, which has directions of the compass, becomes a part of the camera.
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

    /// The camera for projection.
    pub(crate) fn camera(&self) -> Camera {
        self.adjustment.applied_to(&self.rig.camera())
    }
}
