//! Quartiles and whiskers of signed errors, for a box plot.

use serde::{Deserialize, Serialize};

/// Signed percentage errors, positive if the answers are too far.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct BoxFigures {
    /// First quartile, median and third quartile.
    pub quartiles_pct: [f64; 3],
    /// The outermost errors within 1.5 box lengths of the quartiles.
    pub whiskers_pct: [f64; 2],
    /// Mean.
    pub mean_pct: f64,
}

impl BoxFigures {
    /// `None` without errors, or if they overflow.
    pub(crate) fn of(mut errors_pct: Vec<f64>) -> Option<Self> {
        errors_pct.sort_by(f64::total_cmp);
        let (first, last) = (*errors_pct.first()?, *errors_pct.last()?);
        let count = errors_pct.len() as f64;
        let quartiles_pct = [0.25, 0.5, 0.75].map(|part| {
            let place = part * (count - 1.0);
            let (below, above) = (
                errors_pct[place.floor() as usize],
                errors_pct[place.ceil() as usize],
            );
            below + (above - below) * place.fract()
        });
        let reach = 1.5 * (quartiles_pct[2] - quartiles_pct[0]);
        let errors = || errors_pct.iter().copied();
        let low = errors().find(|&error| error >= quartiles_pct[0] - reach);
        let high = errors()
            .rev()
            .find(|&error| error <= quartiles_pct[2] + reach);
        let whiskers_pct = [low.unwrap_or(first), high.unwrap_or(last)];
        let mean_pct: f64 = errors().map(|error| error / count).sum();
        let mut all = quartiles_pct.iter().chain(&whiskers_pct);
        (all.all(|number| number.is_finite()) && mean_pct.is_finite()).then_some(Self {
            quartiles_pct,
            whiskers_pct,
            mean_pct,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quartiles_are_interpolated_and_an_outlier_is_beyond_the_whiskers() {
        let found = BoxFigures::of(vec![4.0, 1.0, 100.0, 3.0, 2.0]).unwrap();
        assert_eq!(found.quartiles_pct, [2.0, 3.0, 4.0]);
        assert_eq!(found.whiskers_pct, [1.0, 4.0]);
        assert!((found.mean_pct - 22.0).abs() < 1e-12);
        assert_eq!(BoxFigures::of(Vec::new()), None);
        assert_eq!(BoxFigures::of(vec![-1e308, -1e308, 1e308, 1e308]), None);
    }
}
