//! Means over the batches since the last log entry.

use serde::{Deserialize, Serialize};

/// Mean that grows number by number.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(crate) struct RunningMean {
    sum: f64,
    count: u64,
}

impl RunningMean {
    /// Adds a number unless it is infinite or NaN.
    pub(crate) fn add(&mut self, number: f64) {
        if number.is_finite() {
            self.sum += number;
            self.count += 1;
        }
    }

    /// Returns the mean and resets it; `None` without numbers.
    pub(crate) fn take(&mut self) -> Option<f64> {
        let Self { sum, count } = std::mem::take(self);
        (count > 0).then(|| sum / count as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mean_is_taken_once_and_of_finite_numbers() {
        let mut mean = RunningMean::default();
        for number in [1.0, f64::NAN, 4.0] {
            mean.add(number);
        }
        assert_eq!(mean.take(), Some(2.5));
        assert_eq!(mean.take(), None);
    }
}
