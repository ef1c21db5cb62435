//! Estimators of distance to touchdown, each with its training.

pub(crate) mod geometry;
pub(crate) mod inverse_range;
pub(crate) mod minimum;
pub(crate) mod mono_network;
pub(crate) mod mono_pinhole;
pub(crate) mod no_vision;
pub(crate) mod paper_lstm;

/// Standard deviations beyond which residuals count linearly: Huber's choice, which costs 5 % of the precision without outliers.
pub(crate) const HUBER: f64 = 1.345;
/// Maximum distance of a camera behind the touchdown target, unless the training side reaches farther, metres.
pub(crate) const MAX_SETBACK_M: f64 = 20_000.0;
