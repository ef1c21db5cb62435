//! Uncertainty of a proportion.
//!
//! E. B. Wilson, "Probable inference, the law of succession, and statistical inference", JASA 22 (1927). Unlike the usual formula it
//! remains valid near 0 and 1, where a detector's recall is.

/// The standard normal's quantile that leaves 2.5 % on either side.
const Z: f64 = 1.959_963_984_540_054;

/// 95 % interval of a probability after `hits` in `trials`; 0 to 1 without trials.
pub(crate) fn interval(hits: u64, trials: u64) -> [f64; 2] {
    if trials == 0 {
        return [0.0, 1.0];
    }
    let (n, share) = (trials as f64, hits as f64 / trials as f64);
    let scale = 1.0 + Z * Z / n;
    let middle = (share + Z * Z / (2.0 * n)) / scale;
    let half = Z / scale * (share * (1.0 - share) / n + Z * Z / (4.0 * n * n)).sqrt();
    [(middle - half).max(0.0), (middle + half).min(1.0)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_are_those_of_statsmodels() {
        // statsmodels.stats.proportion.proportion_confint(hits, trials, method="wilson")
        for (hits, trials, low, high) in [
            (0, 10, 0.0, 0.27753279986288926),
            (5, 10, 0.23659309051256394, 0.7634069094874361),
            (99, 100, 0.9455138038212946, 0.9982325679358593),
            (380, 380, 0.989992069036793, 0.9999999999999999),
            (381, 381, 0.9900180743715453, 0.9999999999999999),
            (9999, 10000, 0.9994337311025987, 0.9999823473263989),
        ] {
            let [found_low, found_high] = interval(hits, trials);
            assert!(
                (found_low - low).abs() < 1e-12,
                "{hits}/{trials}: {found_low}"
            );
            assert!(
                (found_high - high).abs() < 1e-12,
                "{hits}/{trials}: {found_high}"
            );
        }
    }

    #[test]
    fn nothing_is_known_without_trials() {
        assert_eq!(interval(0, 0), [0.0, 1.0]);
    }
}
