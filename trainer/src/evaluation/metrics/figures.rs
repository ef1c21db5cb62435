//! Error figures and coverage over some ticks.

use serde::{Deserialize, Serialize};

use super::Outcome;

/// Errors over the answered ticks, and coverage over all ticks. `None` without any tick.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ErrorFigures {
    /// Mean absolute percentage error.
    pub mape_pct: Option<f64>,
    /// Median of the absolute percentage error: the smallest that half of the answers do not exceed.
    pub median_pct: Option<f64>,
    /// 95 % quantile of the percentage error: the smallest that 95 % of the answers do not exceed.
    pub p95_pct: Option<f64>,
    /// Standard deviation of the absolute percentage error.
    pub sd_pct: Option<f64>,
    /// Mean absolute error, metres.
    pub mae_m: Option<f64>,
    /// 95 % quantile of the absolute error, metres.
    pub p95_m: Option<f64>,
    /// Number of answered ticks.
    pub samples: usize,
    /// Number of ticks with the aircraft present.
    pub ticks: usize,
    /// `samples / ticks`.
    pub coverage: Option<f64>,
    /// Coverage without ticks hidden by fog.
    pub coverage_in_sight: Option<f64>,
}

impl ErrorFigures {
    pub(crate) fn of<'a>(outcomes: impl IntoIterator<Item = &'a Outcome<'a>>) -> Self {
        let (mut errors_pct, mut errors_m) = (Vec::new(), Vec::new());
        let (mut ticks, mut in_sight, mut answered_in_sight) = (0, 0, 0);
        for outcome in outcomes {
            let error_pct = outcome.signed_error_pct();
            if let (Some(error_pct), Some(error_m)) = (error_pct, outcome.error_m()) {
                errors_pct.push(error_pct.abs());
                errors_m.push(error_m);
            }
            ticks += 1;
            if !outcome.is_hidden {
                in_sight += 1;
                answered_in_sight += usize::from(error_pct.is_some());
            }
        }
        let samples = errors_pct.len();
        let [mape_pct, mae_m] = [&errors_pct, &errors_m].map(|errors| mean(errors));
        let sd_pct = deviation(&errors_pct);
        let sorted = |mut errors: Vec<f64>| {
            errors.sort_by(f64::total_cmp);
            errors
        };
        let (errors_pct, errors_m) = (sorted(errors_pct), sorted(errors_m));
        Self {
            mape_pct,
            median_pct: quantile(&errors_pct, 0.5),
            p95_pct: quantile(&errors_pct, 0.95),
            sd_pct,
            mae_m,
            p95_m: quantile(&errors_m, 0.95),
            samples,
            ticks,
            coverage: share(samples, ticks),
            coverage_in_sight: share(answered_in_sight, in_sight),
        }
    }
}

fn share(part: usize, whole: usize) -> Option<f64> {
    (whole > 0).then(|| part as f64 / whole as f64)
}

/// Quantile of sorted numbers: the smallest number that this share does not exceed.
pub(crate) fn quantile(sorted: &[f64], share: f64) -> Option<f64> {
    let rank = (sorted.len() as f64 * share).ceil() as usize;
    sorted.get(rank.saturating_sub(1)).copied()
}

/// Mean of finite numbers: finite, because each number is divided before it is added; `None` if there are none.
fn mean(numbers: &[f64]) -> Option<f64> {
    let count = numbers.len() as f64;
    let sum = numbers.iter().map(|number| number / count).sum();
    (!numbers.is_empty()).then_some(sum)
}

/// Standard deviation of finite numbers: finite, because ratios to the largest deviation are squared.
fn deviation(numbers: &[f64]) -> Option<f64> {
    let mean = mean(numbers)?;
    let from_mean: Vec<f64> = numbers.iter().map(|number| (number - mean).abs()).collect();
    let largest = from_mean.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    let squares: Vec<f64> = from_mean.iter().map(|x| (x / largest).powi(2)).collect();
    Some(largest * self::mean(&squares)?.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quantile_is_the_smallest_number_that_so_many_do_not_exceed() {
        let hundred: Vec<f64> = (1..=100).map(f64::from).collect();
        for (share, expected) in [(0.5, 50.0), (0.95, 95.0), (0.0, 1.0), (1.0, 100.0)] {
            assert_eq!(quantile(&hundred, share), Some(expected));
        }
        assert_eq!(quantile(&[7.0], 0.5), Some(7.0));
        assert_eq!(quantile(&[], 0.5), None);
    }
}
