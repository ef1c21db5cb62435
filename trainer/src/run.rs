//! A run: the folder that a training writes as a whole, and the estimators that are read from it.

pub(crate) mod estimator;
pub(crate) mod folder;
pub(crate) mod place;
pub(crate) mod sealed;
pub(crate) mod trained;
