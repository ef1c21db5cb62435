//! Figures reported in the paper, shown beside ours.

/// A weather or a local time in the paper's table 3.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PaperCondition {
    /// Name of the weather, or the time.
    pub name: &'static str,
    /// MAPE and standard deviation of the ticks that both views saw, percent.
    pub dual_pct: [f64; 2],
    /// MAPE and standard deviation of the ticks that at least one view saw, percent.
    pub combination_pct: [f64; 2],
}

/// Table 3: four weathers, then five times.
pub const TABLE_3: [PaperCondition; 9] = [
    condition("clear", [0.10, 0.15], [0.18, 0.75]),
    condition("cloudy", [0.22, 0.68], [0.30, 0.91]),
    condition("foggy", [0.09, 0.09], [0.21, 0.70]),
    condition("stormy", [0.11, 0.15], [0.18, 0.57]),
    condition("06:00", [0.13, 0.27], [0.25, 0.79]),
    condition("08:00", [0.14, 0.18], [0.23, 0.66]),
    condition("12:00", [0.18, 0.52], [0.25, 0.75]),
    condition("17:00", [0.16, 0.18], [0.23, 0.62]),
    condition("18:00", [0.13, 0.14], [0.19, 0.55]),
];

/// MAPE of the paper's method, percent.
pub const MAPE_PCT: f64 = 0.18;
/// MAPE of the paper's monoscopic model, percent.
pub const MONO_MAPE_PCT: f64 = 0.58;
/// Reduction against it, as the paper states it, percent.
pub const REDUCTION_PCT: f64 = 67.0;
/// Maximum number of Algorithm 1's epochs.
pub const EPOCHS: usize = 225_000;
/// Duration of the paper's training on an RTX 3080, hours.
pub const TRAINING_HOURS: f64 = 2.0;

const fn condition(
    name: &'static str,
    dual_pct: [f64; 2],
    combination_pct: [f64; 2],
) -> PaperCondition {
    PaperCondition {
        name,
        dual_pct,
        combination_pct,
    }
}
