//! Lateral spread of training flights around their common path.

use dataset::numbers::spread::{mean_and_deviation, median_of};
use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;

use crate::samples::Sample;

/// Minimum number of ticks in a bin.
const MIN_TICKS: usize = 3;

/// Standard deviation of the cross-track position at equal distances, metres: the median over bins one nautical mile wide, so that a single
/// intercept far out has little effect. 0 without enough ticks.
pub(crate) fn lateral_spread_m(samples: &[&Sample]) -> f64 {
    let mut bins: Vec<Vec<f64>> = Vec::new();
    // The first mile is left out: flights converge at the runway.
    let is_far = |sample: &&&Sample| sample.dtd_m >= METERS_PER_NAUTICAL_MILE;
    for sample in samples.iter().filter(is_far) {
        let bin = (sample.dtd_m / METERS_PER_NAUTICAL_MILE) as usize;
        if bins.len() <= bin {
            bins.resize_with(bin + 1, Vec::new);
        }
        bins[bin].push(sample.cross_track_m);
    }
    let filled = bins.iter().filter(|bin| bin.len() >= MIN_TICKS);
    let deviations = filled.map(|bin| mean_and_deviation(bin.iter().copied())[1]);
    median_of(deviations).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(dtd_m: f64, cross_track_m: f64) -> Sample {
        Sample {
            cross_track_m,
            ..Sample::of_boxes(dtd_m, vec![None])
        }
    }

    fn spread_m(flights: &[&dyn Fn(f64) -> f64]) -> f64 {
        let distances = (0..180).map(|i| f64::from(i) * 100.0);
        let samples: Vec<Sample> = distances
            .flat_map(|dtd_m| {
                flights
                    .iter()
                    .map(move |cross_m| sample(dtd_m, cross_m(dtd_m)))
            })
            .collect();
        lateral_spread_m(&samples.iter().collect::<Vec<_>>())
    }

    #[test]
    fn flights_on_one_line_have_no_spread_and_parallel_ones_that_of_their_distance() {
        assert_eq!(spread_m(&[&|_| 7.0]), 0.0);
        let apart = spread_m(&[&|_| -4.0, &|_| 4.0]);
        assert!((apart - 4.0).abs() < 1e-9, "{apart}");
        assert_eq!(lateral_spread_m(&[]), 0.0);
    }

    #[test]
    fn an_intercept_far_out_is_not_the_spread_of_the_approach() {
        let intercept = |dtd_m: f64| (dtd_m - 15_000.0).max(0.0);
        let spread = spread_m(&[&intercept, &|_| 0.2]);
        assert!(spread < 0.2, "{spread}");
    }
}
