//! Units that may have been used by mistake instead of metres.

use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;

/// Name and length in metres.
const UNITS: [(&str, f64); 3] = [
    ("nautical miles", METERS_PER_NAUTICAL_MILE),
    ("kilometres", 1_000.0),
    ("feet", 0.3048),
];
/// Maximum distance between the median ratio and the exact factor for a likely unit or change of sign. Errors of estimators are smaller,
/// and the units are farther apart.
pub(super) const TOLERANCE: f64 = 0.1;

/// The unit with its length in metres, from the median ratio of predictions to ground truth in metres; `None` for metres, or if no unit
/// explains the ratio.
pub(super) fn probable_unit(median_ratio: f64) -> Option<(&'static str, f64)> {
    let is_near = |(_, meters): &(&str, f64)| (median_ratio * meters - 1.0).abs() < TOLERANCE;
    UNITS.into_iter().find(is_near)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn miles_kilometres_and_feet_are_recognised_and_bad_estimates_are_none() {
        let unit = |median_ratio| probable_unit(median_ratio).map(|(unit, _)| unit);
        assert_eq!(unit(1.05 / 1_852.0), Some("nautical miles"));
        assert_eq!(unit(0.95e-3), Some("kilometres"));
        assert_eq!(unit(3.3), Some("feet"));
        for ratio in [0.0, 0.5, 1.0, 1.4, 2.5, -1e-3] {
            assert_eq!(unit(ratio), None, "{ratio}");
        }
    }
}
