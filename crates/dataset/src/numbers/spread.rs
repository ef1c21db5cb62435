//! Distributions of numbers: median, mean, standard deviation, and their robust counterparts.

use serde::{Deserialize, Serialize};

/// Scale that makes a normal distribution's median absolute deviation its standard deviation.
const MAD_TO_SD: f64 = 1.4826;

/// A distribution of errors.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// Median: the bias.
    pub median: f64,
    /// Robust standard deviation: 1.4826 times the median absolute deviation, so that rare outliers do not hide the typical error.
    pub deviation: f64,
    /// Root of the mean square, outliers included.
    pub rms: f64,
}

impl Spread {
    /// The spread of some errors; `None` without any.
    pub fn of(mut errors: Vec<f64>) -> Option<Self> {
        let count = errors.len();
        if count == 0 {
            return None;
        }
        let rms = (errors.iter().map(|error| error * error).sum::<f64>() / count as f64).sqrt();
        let median = median(&mut errors);
        for error in &mut errors {
            *error = (*error - median).abs();
        }
        let deviation = MAD_TO_SD * self::median(&mut errors);
        Some(Self {
            median,
            deviation,
            rms,
        })
    }
}

/// Robust standard deviation of errors whose mean is known to be zero: 1.4826 times the median of their sizes; 0 if there are none.
pub fn deviation_from_zero(errors: impl Iterator<Item = f64>) -> f64 {
    let mut sizes: Vec<f64> = errors.map(f64::abs).collect();
    if sizes.is_empty() {
        return 0.0;
    }
    MAD_TO_SD * median(&mut sizes)
}

/// The upper median; reorders the values.
///
/// # Panics
/// There are no values.
pub fn median(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// The upper median; `None` without values.
pub fn median_of(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.into_iter().collect();
    (!values.is_empty()).then(|| median(&mut values))
}

/// Median slope over all pairs of points (Theil 1950, Sen 1968); `None` without any.
pub fn median_slope(points: impl IntoIterator<Item = (f64, f64)>) -> Option<f64> {
    let points: Vec<(f64, f64)> = points.into_iter().collect();
    let pairs = points.iter().enumerate();
    let pairs =
        pairs.flat_map(|(end, later)| points[..end].iter().map(move |first| (first, later)));
    let slopes = pairs.map(|(first, later)| (later.1 - first.1) / (later.0 - first.0));
    median_of(slopes.filter(|slope| slope.is_finite()))
}

/// The value that a share of the values does not exceed; reorders the values.
///
/// # Panics
/// There are no values.
pub fn quantile(values: &mut [f64], share: f64) -> f64 {
    let at = ((values.len() - 1) as f64 * share) as usize;
    *values.select_nth_unstable_by(at, f64::total_cmp).1
}

/// Population mean and standard deviation; both 0 without values.
pub fn mean_and_deviation(values: impl Iterator<Item = f64> + Clone) -> [f64; 2] {
    let count = values.clone().count().max(1) as f64;
    let mean = values.clone().sum::<f64>() / count;
    let variance = values.map(|value| (value - mean).powi(2)).sum::<f64>() / count;
    [mean, variance.sqrt()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spread_is_robust_against_one_slip() {
        let spread = Spread::of(vec![-0.1, 0.0, 0.1, 0.2, 100.0]).unwrap();
        assert_eq!(spread.median, 0.1);
        assert!(spread.deviation < 0.2 && spread.rms > 40.0, "{spread:?}");
        assert_eq!(Spread::of(Vec::new()), None);
    }

    #[test]
    fn errors_about_zero_have_a_deviation_that_one_slip_hardly_moves() {
        let deviation = deviation_from_zero([-0.1, 0.2, 100.0, -0.2, 0.1].into_iter());
        assert!((deviation - 0.2 * MAD_TO_SD).abs() < 1e-12, "{deviation}");
        assert_eq!(deviation_from_zero(std::iter::empty()), 0.0);
    }

    #[test]
    fn quantiles_are_values_and_no_values_have_no_median() {
        let mut values = [4.0, 1.0, 3.0, 2.0, 5.0];
        assert_eq!(
            [0.0, 0.5, 0.9, 1.0].map(|share| quantile(&mut values, share)),
            [1.0, 3.0, 4.0, 5.0]
        );
        assert_eq!(median_of(values), Some(3.0));
        assert_eq!(median_of([]), None);
    }

    #[test]
    fn mean_and_deviation_are_of_the_population_and_zero_without_values() {
        let values = [2.0, 4.0, 4.0, 4.0, 5.0, 5.0, 7.0, 9.0];
        assert_eq!(mean_and_deviation(values.into_iter()), [5.0, 2.0]);
        assert_eq!(mean_and_deviation(std::iter::empty()), [0.0; 2]);
    }
}
