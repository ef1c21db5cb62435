//! Units other than metres in which distances may have been written by mistake.

use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;

/// The unit, and its length in metres.
const UNITS: [(&str, f64); 3] = [
    ("nautical miles", METERS_PER_NAUTICAL_MILE),
    ("kilometres", 1_000.0),
    ("feet", 0.3048),
];
/// Distance of the median from the exact factor up to which the unit is the likely reason. Errors of estimators are smaller, and the units are
/// farther apart.
const TOLERANCE: f64 = 0.1;

/// A unit in which some distances probably are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ProbableUnit {
    pub unit: &'static str,
    /// Median of the predictions as shares of the truth.
    pub median_ratio: f64,
    /// The share that this unit gives.
    pub expected_ratio: f64,
}

impl ProbableUnit {
    /// The unit of predictions with these ratios to the truth in metres; `None` for metres, or if no unit explains the ratios.
    pub(super) fn of(mut ratios: Vec<f64>) -> Option<Self> {
        ratios.sort_by(f64::total_cmp);
        let median_ratio = *ratios.get(ratios.len() / 2)?;
        let is_near = |(_, meters): &&(&str, f64)| (median_ratio * meters - 1.0).abs() < TOLERANCE;
        let (unit, meters) = UNITS.iter().find(is_near)?;
        Some(Self {
            unit,
            median_ratio,
            expected_ratio: 1.0 / meters,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn miles_kilometres_and_feet_are_recognised_by_their_median_and_bad_estimates_are_none() {
        let unit = |ratios: &[f64]| ProbableUnit::of(ratios.to_vec()).map(|unit| unit.unit);
        assert_eq!(
            unit(&[1.0 / 1_852.0, 1.05 / 1_852.0, 7.0]),
            Some("nautical miles")
        );
        assert_eq!(unit(&[1.0, 0.95e-3, 0.9e-3]), Some("kilometres"));
        assert_eq!(unit(&[3.1, 3.3, 3.5]), Some("feet"));
        for ratios in [&[][..], &[1.0], &[0.5, 1.4, 2.0], &[0.0, 0.0, 0.0], &[2.5]] {
            assert_eq!(unit(ratios), None, "{ratios:?}");
        }
    }
}
