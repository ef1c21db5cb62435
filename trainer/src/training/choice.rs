//! Choice of the recommended estimator.
//!
//! `inverse_range` learns everything that the images show from the training flights, including effects outside any camera model, but only
//! near these flights: `docs/estimators.md` has figures. Fitted cameras also apply away from the flights. So flights that keep closely to
//! one line call for `self_calibrated`, and others for `inverse_range`.

use crate::run::choice::Choice;
use crate::run::estimator::Estimator;
use crate::run::trained::Baselines;
use crate::samples::Sample;
use crate::samples::lateral_spread::lateral_spread_m;

/// Minimum lateral spread for `inverse_range`: flights 60 m off the usual path at 10 NM then cost a quarter of the precision.
const MIN_LATERAL_SPREAD_M: f64 = 2.0;

impl Choice {
    /// Chooses among the fitted estimators.
    pub(crate) fn of(baselines: &Baselines, training: &[&Sample]) -> Self {
        Self::for_spread(
            lateral_spread_m(training),
            baselines.self_calibrated.is_some(),
            !baselines.inverse_range.is_empty(),
        )
    }

    fn for_spread(lateral_spread_m: f64, has_cameras: bool, has_fits: bool) -> Self {
        let (estimator, reason) = match (lateral_spread_m < MIN_LATERAL_SPREAD_M, has_cameras) {
            (_, true) if !has_fits => (
                Estimator::SelfCalibrated,
                "and no view saw enough for inverse_range to be fitted".to_owned(),
            ),
            _ if !has_fits => (
                Estimator::MonoNetworkBox,
                "and no view saw enough for inverse_range or for cameras to be fitted; expect large errors, or record more"
                    .to_owned(),
            ),
            (false, _) => (
                Estimator::InverseRange,
                format!(
                    "at least {MIN_LATERAL_SPREAD_M} m, so that it learned what an aircraft beside the usual path looks like"
                ),
            ),
            (true, true) => (
                Estimator::SelfCalibrated,
                format!(
                    "less than {MIN_LATERAL_SPREAD_M} m, so that inverse_range would be wrong for an aircraft beside that path"
                ),
            ),
            (true, false) => (
                Estimator::InverseRange,
                format!(
                    "less than {MIN_LATERAL_SPREAD_M} m, but no two views saw enough for cameras to be fitted; expect errors for an aircraft beside that path"
                ),
            ),
        };
        Self {
            estimator: estimator.name().to_owned(),
            lateral_spread_m,
            reason: format!(
                "the paths of the training flights deviate by {lateral_spread_m:.1} m to the side (standard deviation), {reason}"
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flights_on_one_line_call_for_cameras_and_spread_ones_for_the_formula() {
        for (spread_m, has_cameras, has_fits, estimator, words) in [
            (
                0.4,
                true,
                true,
                "self_calibrated",
                "0.4 m to the side (standard deviation), less than 2 m",
            ),
            (
                3.0,
                true,
                true,
                "inverse_range",
                "3.0 m to the side (standard deviation), at least 2 m",
            ),
            (3.0, false, true, "inverse_range", "at least 2 m"),
            (0.4, false, true, "inverse_range", "no two views"),
            (3.0, true, false, "self_calibrated", "no view saw enough"),
            (3.0, false, false, "mono_network_box", "no view saw enough"),
        ] {
            let choice = Choice::for_spread(spread_m, has_cameras, has_fits);
            assert_eq!(choice.estimator, estimator);
            assert!(choice.reason.contains(words), "{}", choice.reason);
        }
    }
}
