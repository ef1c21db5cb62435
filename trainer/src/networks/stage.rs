//! Cycles, ends and records of training stages.
//!
//! A stage trains in cycles: in each the learning rate rises and falls (Loshchilov and Hutter, *SGDR*, 2017), which removes the noise of
//! mini-batches from the errors at the end. Each cycle is twice as long as the one before. The stage ends if a whole cycle lowers no error
//! by more than Algorithm 1's plateau threshold, which the paper applies to full-batch losses; the paper's training ends after a number of
//! epochs. A stage without a plateau is a single cycle.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use crate::config::Plateau;

/// The cycle that contains `step`. There are `limit` steps in all; a remainder shorter than a cycle is added to the last cycle.
pub(crate) fn cycle_of(step: usize, limit: usize, plateau: Option<Plateau>) -> Range<usize> {
    let Some(Plateau { first_cycle, .. }) = plateau else {
        return 0..limit;
    };
    let (mut start, mut length) = (0, first_cycle.max(1));
    loop {
        let end = start + length;
        if end + 2 * length > limit {
            return start..limit;
        }
        if step < end {
            return start..end;
        }
        (start, length) = (end, 2 * length);
    }
}

/// A finished cycle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Cycle {
    /// Steps from the stage's start to the cycle's end.
    pub steps: usize,
    /// Validation errors at the end, per view or for the estimator, percent; `null` if unmeasurable.
    pub validation_mape_pct: Vec<Option<f64>>,
}

/// True if the last cycle lowered no error by more than the threshold.
pub(crate) fn is_reached(plateau: Plateau, cycles: &[Cycle]) -> bool {
    let Some((last, before)) = cycles.split_last() else {
        return false;
    };
    let lowest_before = |view: usize| {
        let errors = before
            .iter()
            .filter_map(|cycle| cycle.validation_mape_pct[view]);
        errors.reduce(f64::min)
    };
    let errors = last.validation_mape_pct.iter().enumerate();
    let mut falls_pct = errors.filter_map(|(view, error)| Some(lowest_before(view)? - (*error)?));
    !before.is_empty() && falls_pct.all(|fall_pct| fall_pct <= plateau.threshold_pct)
}

/// Reason why a stage ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EndedBy {
    /// Errors no longer fell.
    Plateau,
    /// All steps were made.
    Steps,
}

/// Training stage, as recorded in `run.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StageSummary {
    /// Name of the networks.
    pub network: String,
    /// View, if the network belongs to a single view.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub view: Option<String>,
    /// Mini-batches.
    pub steps: usize,
    /// Mini-batches after which the weights were kept.
    pub kept_step: usize,
    /// Samples in a mini-batch.
    pub batch_size: usize,
    /// Samples of the training side.
    pub samples: usize,
    /// Passes over these samples (the paper's epochs).
    pub passes: f64,
    /// Cause of the end.
    pub ended_by: EndedBy,
    /// Finished cycles.
    pub cycles: Vec<Cycle>,
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLATEAU: Plateau = Plateau {
        first_cycle: 100,
        threshold_pct: 0.01,
    };

    #[test]
    fn cycles_double_and_the_last_one_takes_what_is_left() {
        let cycle = |step| cycle_of(step, 1_000, Some(PLATEAU));
        assert_eq!([cycle(0), cycle(99)], [0..100, 0..100]);
        assert_eq!([cycle(100), cycle(299)], [100..300, 100..300]);
        // 300..700 would leave less than the 800 of the next.
        assert_eq!([cycle(300), cycle(999)], [300..1_000, 300..1_000]);
        assert_eq!(cycle_of(5, 40, Some(PLATEAU)), 0..40);
        assert_eq!(cycle_of(5, 1_000, None), 0..1_000);
    }

    #[test]
    fn a_stage_is_over_when_a_cycle_lowers_no_error_by_more_than_the_threshold() {
        let cycles = |errors: &[[Option<f64>; 2]]| -> Vec<Cycle> {
            let errors = errors.iter();
            errors
                .map(|errors| Cycle {
                    steps: 0,
                    validation_mape_pct: errors.to_vec(),
                })
                .collect()
        };
        for (errors, expected) in [
            (&[[Some(1.0), Some(3.0)]][..], false),
            (&[[Some(1.0), Some(3.0)], [Some(1.0), Some(2.0)]], false),
            (&[[Some(1.0), Some(3.0)], [Some(0.995), Some(3.1)]], true),
            (&[[None, Some(3.0)], [None, Some(3.0)]], true),
            // Worse, then as good as before: not better than the best.
            (
                &[[Some(1.0), None], [Some(1.5), None], [Some(1.0), None]],
                true,
            ),
        ] {
            assert_eq!(is_reached(PLATEAU, &cycles(errors)), expected, "{errors:?}");
        }
    }
}
