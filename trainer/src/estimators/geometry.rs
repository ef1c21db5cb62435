//! Estimators that intersect the lines of sight of cameras, and the fit of those cameras.

pub(crate) mod fitted_camera;
pub(crate) mod self_calibration;
pub(crate) mod triangulation;
