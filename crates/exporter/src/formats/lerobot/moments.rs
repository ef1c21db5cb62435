//! Range, mean and deviation of numbers that are seen one after the other (Welford 1962; Chan et al. 1979 for putting two together).

use serde::{Deserialize, Serialize};

/// Running statistics.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Moments {
    count: f64,
    pub(crate) mean: f64,
    /// Sum of the squared deviations from the mean.
    squares: f64,
    pub(crate) min: f64,
    pub(crate) max: f64,
}

impl Moments {
    pub(crate) fn of(value: f64) -> Self {
        Self {
            count: 1.0,
            mean: value,
            squares: 0.0,
            min: value,
            max: value,
        }
    }

    /// Moments of counted values 0, 1, 2, ..
    pub(crate) fn of_counts(counts: &[u64], scale: f64) -> Option<Self> {
        let weighted = counts.iter().zip(0u32..).filter(|(count, _)| **count > 0);
        let all = weighted.map(|(count, value)| Self {
            count: *count as f64,
            ..Self::of(f64::from(value) * scale)
        });
        all.reduce(Self::and)
    }

    /// Moments of both sets together.
    pub(crate) fn and(self, other: Self) -> Self {
        let count = self.count + other.count;
        let apart = other.mean - self.mean;
        Self {
            count,
            mean: self.mean + apart * other.count / count,
            squares: self.squares
                + other.squares
                + apart * apart * self.count * other.count / count,
            min: self.min.min(other.min),
            max: self.max.max(other.max),
        }
    }

    /// Standard deviation.
    pub(crate) fn deviation(&self) -> f64 {
        (self.squares / self.count).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_parts_have_the_moments_of_all_of_them() {
        let offset = 1e6;
        let values = [1.0, 4.0, -2.0, 7.5, 0.0].map(|value| value + offset);
        let of = |part: &[f64]| {
            let all = part.iter().map(|value| Moments::of(*value));
            all.reduce(Moments::and).unwrap()
        };
        let found = of(&values[..2]).and(of(&values[2..]));
        assert!((found.mean - offset - 2.1).abs() < 1e-9, "{found:?}");
        assert!((found.deviation() - 3.322_649_545_167_232).abs() < 1e-9);
        assert_eq!([found.min, found.max], [offset - 2.0, offset + 7.5]);

        let counted = Moments::of_counts(&[0, 2, 0, 1], 0.5).unwrap();
        let one_by_one = of(&[0.5, 0.5, 1.5]);
        assert!((counted.mean - one_by_one.mean).abs() < 1e-12);
        assert!((counted.deviation() - one_by_one.deviation()).abs() < 1e-12);
        assert_eq!(Moments::of_counts(&[0, 0], 1.0), None);
    }
}
