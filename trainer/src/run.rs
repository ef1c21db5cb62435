//! A run: the folder that a training writes as a whole, and the estimators that are read from it.

pub(crate) mod choice;
pub(crate) mod elsewhere;
pub(crate) mod estimator;
pub(crate) mod fitted_cameras;
pub(crate) mod folder;
pub(crate) mod place;
pub(crate) mod refitted_view;
pub(crate) mod sealed;
pub(crate) mod trained;
