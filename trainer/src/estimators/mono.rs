//! Monoscopic baselines: estimators that see a single view.

pub(crate) mod network;
pub(crate) mod pinhole;
