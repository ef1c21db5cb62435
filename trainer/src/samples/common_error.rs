//! Errors that all ticks of a flight share, such as the error of a lag or of a camera's turn.
//!
//! The filter takes the errors of ticks as independent and averages them, which leaves a common one as it is. So its standard deviation is
//! stated to the filter as many times larger as the average of independent ones is smaller.

/// Time over which the filter averages, seconds.
const AVERAGED_S: f64 = 8.0;

/// Factor of the standard deviation of a common error. `times_s`: of the ticks.
pub(crate) fn times_larger(times_s: impl Iterator<Item = f64>) -> f64 {
    let times_s: Vec<f64> = times_s.collect();
    let [Some(first_s), Some(last_s)] = [times_s.first(), times_s.last()] else {
        return 1.0;
    };
    let averaged = AVERAGED_S * (times_s.len() - 1) as f64 / (last_s - first_s);
    // Not a number of a single tick.
    averaged.max(1.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_more_ticks_the_filter_averages_the_larger_is_what_they_have_in_common() {
        let at = |step_s: f64| times_larger((0..100).map(|tick| step_s * f64::from(tick)));
        assert!((at(2.0) - 2.0).abs() < 1e-9);
        assert!((at(0.5) - 4.0).abs() < 1e-9);
        assert_eq!(at(10.0), 1.0);
        assert_eq!(times_larger([3.0].into_iter()), 1.0);
        assert_eq!(times_larger([].into_iter()), 1.0);
    }
}
