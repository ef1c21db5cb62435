//! Fitted cameras, for registration without `calibration.json`.

use std::collections::BTreeMap;

use dataset::geometry::camera::Camera;

use crate::error::{Error, Result};
use crate::run::folder::RunFolder;
use crate::run::sealed::SealedRun;
use crate::run::trained::TrainedRun;

/// The cameras of `self_calibrated` by view, and the BLAKE3 hash of the run. Views that saw the aircraft too rarely are missing.
///
/// # Errors
/// The run cannot be read, or has fitted no cameras.
pub fn fitted_cameras(folder: &RunFolder) -> Result<(String, BTreeMap<String, Camera>)> {
    let sealed = SealedRun::read(folder)?;
    let run = TrainedRun::of(&sealed)?;
    if run.summary.cameras_vary {
        let fault = "was trained on cameras that differ from scenario to scenario, so its fitted cameras are an average; name a run of \
                     cameras that stand still";
        return Err(Error::run(folder.root(), fault));
    }
    let fitted = run.baselines.self_calibrated.as_ref().ok_or_else(|| {
        let fault = "has fitted no cameras, because fewer than two views saw the aircraft often enough; name a run that was trained on \
                     more flights";
        Error::run(folder.root(), fault)
    })?;
    let views = run.normalisation.views.into_iter().zip(fitted.cameras());
    let cameras = views.filter_map(|(view, camera)| Some((view, camera?)));
    Ok((sealed.blake3(), cameras.collect()))
}
