//! Rates of states, of the autopilot and of integration.

/// State rate, hertz.
pub const OUTPUT_RATE_HZ: u32 = 30;

/// Integration steps per state, and per update of the autopilot.
pub(crate) const STEPS_PER_STATE: u64 = 4;
pub(crate) const STEP_S: f64 = 1.0 / (OUTPUT_RATE_HZ as f64 * STEPS_PER_STATE as f64);
pub(crate) const AUTOPILOT_STEP_S: f64 = 1.0 / OUTPUT_RATE_HZ as f64;
