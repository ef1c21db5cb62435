//! Cameras that a training has fitted, for the registration of the views instead of those of `calibration.json`.

use std::collections::BTreeMap;

use dataset::geometry::camera::Camera;

use crate::error::{Error, Result};

/// Fitted cameras from a run.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedCameras {
    /// BLAKE3 hash of the run, which the record of the registrations names.
    pub run_blake3: String,
    /// Cameras by view.
    pub cameras: BTreeMap<String, Camera>,
}

impl FittedCameras {
    /// The cameras for a scenario's views. Image sizes must match the stated cameras.
    pub(crate) fn of_views(
        &self,
        scenario: &str,
        views: &[String],
        stated: &[Camera],
    ) -> Result<Vec<Camera>> {
        let camera = |(view, stated): (&String, &Camera)| {
            let camera = self.cameras.get(view).copied().ok_or_else(|| {
                let known: Vec<&str> = self.cameras.keys().map(String::as_str).collect();
                let message = format!(
                    "the run has no fitted camera of view {view}, only of {}; name a run that was trained with this view",
                    known.join(", ")
                );
                Error::scenario(scenario, message)
            })?;
            let size = |of: &Camera| format!("{}x{}", of.width_px, of.height_px);
            if size(&camera) != size(stated) {
                let message = format!(
                    "view {view} has images of {} pixels, the run's camera has {}; name a run that was trained with these cameras",
                    size(stated),
                    size(&camera)
                );
                return Err(Error::scenario(scenario, message));
            }
            Ok(camera)
        };
        views.iter().zip(stated).map(camera).collect()
    }
}
