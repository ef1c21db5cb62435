//! A camera of the rig as fitted to labelled flights: the planned camera, slightly turned, zoomed and moved.

use dataset::corpus::calibration::CameraEntry;
use dataset::geometry::camera::Camera;
use serde::{Deserialize, Serialize};

use crate::samples::camera_adjustment::Adjustment;

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
    /// The camera for projection.
    pub(crate) fn camera(&self) -> Camera {
        self.adjustment.applied_to(&self.rig.camera())
    }
}
