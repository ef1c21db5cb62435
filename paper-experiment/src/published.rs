//! The paper's figures of its detector. `trainer::paper` has what it states about estimators.

/// Share of the data points that miss one view.
pub const SINGLE_VIEW_SHARE: f64 = 0.15;
/// Maximum and effective range of Auto Segmentation, nautical miles.
pub(crate) const TILES_NM: [f64; 2] = [9.95, 9.74];
/// Maximum and effective range of conventional scaling, nautical miles.
pub(crate) const SCALED_NM: [f64; 2] = [7.00, 4.96];
