//! Confidence intervals for figures, over the choice of flights.
//!
//! Ticks within a trajectory have correlated errors, so whole trajectories are drawn with replacement, with all scenarios that fly them. A
//! flight that is drawn twice counts twice.

use std::collections::BTreeMap;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;
use serde::{Deserialize, Serialize};

use super::Outcome;
use super::figures::quantile;
use crate::evaluation::rules::BootstrapRules;

/// Lower and upper ends.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Intervals {
    /// Mean absolute percentage error.
    pub mape_pct: [f64; 2],
    /// Median of the absolute percentage error.
    pub median_pct: [f64; 2],
    /// 95 % quantile of the absolute percentage error.
    pub p95_pct: [f64; 2],
    /// Number of trajectories with an answer.
    pub trajectories: usize,
}

impl Intervals {
    /// Intervals by resampling trajectories; `None` with fewer than two.
    pub(crate) fn of<'a>(
        outcomes: impl IntoIterator<Item = &'a Outcome<'a>>,
        rules: &BootstrapRules,
    ) -> Option<Self> {
        let mut places: BTreeMap<&str, usize> = BTreeMap::new();
        let mut errors: Vec<(f64, usize)> = Vec::new();
        for outcome in outcomes {
            if let Some(error_pct) = outcome.signed_error_pct() {
                let next = places.len();
                let trajectory = *places.entry(outcome.of.flight).or_insert(next);
                errors.push((error_pct.abs(), trajectory));
            }
        }
        let trajectories = places.len();
        if trajectories < 2 {
            return None;
        }
        errors.sort_by(|a, b| a.0.total_cmp(&b.0));
        let random = &mut ChaCha12Rng::seed_from_u64(rules.seed);
        let mut drawn = [(); 3].map(|()| Vec::with_capacity(rules.resamples));
        for _ in 0..rules.resamples {
            let mut times = vec![0_usize; trajectories];
            for _ in 0..trajectories {
                times[random.random_range(0..trajectories)] += 1;
            }
            for (all, one) in drawn.iter_mut().zip(figures(&errors, &times)) {
                all.push(one);
            }
        }
        let ends = |mut figures: Vec<f64>| -> Option<[f64; 2]> {
            figures.sort_by(f64::total_cmp);
            let outside = (1.0 - rules.share) / 2.0;
            Some([
                quantile(&figures, outside)?,
                quantile(&figures, 1.0 - outside)?,
            ])
        };
        let [mape_pct, median_pct, p95_pct] = drawn.map(ends);
        Some(Self {
            mape_pct: mape_pct?,
            median_pct: median_pct?,
            p95_pct: p95_pct?,
            trajectories,
        })
    }
}

/// Mean, median and 95 % quantile of sorted errors, each weighted by trajectory draws.
fn figures(errors: &[(f64, usize)], times: &[usize]) -> [f64; 3] {
    let count: usize = errors.iter().map(|&(_, t)| times[t]).sum();
    let ranks = [0.5, 0.95].map(|share| (count as f64 * share).ceil() as usize);
    let mut quantiles = [0.0; 2];
    let (mut mean, mut passed) = (0.0, 0);
    for &(error, trajectory) in errors {
        let before = passed;
        passed += times[trajectory];
        mean += error / count as f64 * times[trajectory] as f64;
        for (found, rank) in quantiles.iter_mut().zip(ranks) {
            if (before + 1..=passed).contains(&rank) {
                *found = error;
            }
        }
    }
    [mean, quantiles[0], quantiles[1]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluation::metrics::ErrorFigures;
    use crate::evaluation::metrics::Group;

    const RULES: BootstrapRules = BootstrapRules {
        seed: 1,
        resamples: 2_000,
        share: 0.9,
    };

    /// Flights with a constant percentage error each.
    fn flights(errors_pct: &[f64]) -> Vec<Outcome<'static>> {
        const NAMES: [&str; 8] = ["a", "b", "c", "d", "e", "f", "g", "h"];
        let ticks = |(&error_pct, flight): (&f64, &'static str)| {
            (1..=50).map(move |tick| {
                let dtd_m = f64::from(tick) * 200.0;
                let alike = Outcome::of_answer(dtd_m, Some(dtd_m * (1.0 + error_pct / 100.0)));
                Outcome {
                    of: Group {
                        flight,
                        ..*alike.of
                    }
                    .leaked(),
                    ..alike
                }
            })
        };
        errors_pct.iter().zip(NAMES).flat_map(ticks).collect()
    }

    #[test]
    fn a_resample_that_has_every_flight_once_has_the_figures_themselves() {
        let outcomes = flights(&[1.0, 2.0, 4.0]);
        let mut errors: Vec<_> = outcomes
            .iter()
            .enumerate()
            .map(|(tick, o)| (o.signed_error_pct().unwrap().abs(), tick / 50))
            .collect();
        errors.sort_by(|a, b| a.0.total_cmp(&b.0));
        let [mean, median, p95] = figures(&errors, &[1, 1, 1]);
        let all = ErrorFigures::of(&outcomes);
        assert!((mean - all.mape_pct.unwrap()).abs() < 1e-12);
        assert_eq!([Some(median), Some(p95)], [all.median_pct, all.p95_pct]);
    }

    #[test]
    fn flights_that_err_alike_have_a_narrow_interval_and_one_that_errs_more_widens_it() {
        let alike = Intervals::of(&flights(&[1.0; 8]), &RULES).unwrap();
        assert!(
            (alike.mape_pct[1] - alike.mape_pct[0]).abs() < 1e-9,
            "{alike:?}"
        );
        let one_off = flights(&[1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 9.0]);
        let wide = Intervals::of(&one_off, &RULES).unwrap();
        // With probability (7/8)^8 = 34 % the odd one is never drawn, with 8 % three times or more: mean 1 + 8 * 3 / 8.
        assert!((wide.mape_pct[0] - 1.0).abs() < 1e-9, "{wide:?}");
        assert!((wide.mape_pct[1] - 4.0).abs() < 1e-9, "{wide:?}");
        assert_eq!(wide.trajectories, 8);
        assert_eq!(
            Intervals::of(&one_off, &RULES),
            Some(wide),
            "the same draws"
        );
    }

    #[test]
    fn one_flight_has_no_interval() {
        assert_eq!(Intervals::of(&flights(&[1.0]), &RULES), None);
        assert_eq!(Intervals::of(&[], &RULES), None);
    }
}
