//! The end of a stage of a training, and the record of the stage.
//!
//! A stage trains in cycles: in each the learning rate rises and falls (Loshchilov and Hutter, *SGDR*, 2017), so that at its end the errors
//! are free of the noise of mini-batches. Each cycle is twice as long as the one before. The stage has come to its end if a whole cycle
//! lowers no error by more than the threshold by which the paper's Algorithm 1 recognises a plateau of its full-batch losses; the paper's
//! training ends after a number of epochs. A stage without a plateau is one cycle of all its steps.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use crate::config::Plateau;

/// Steps of the cycle that a step is in: `limit` steps in all, and the last cycle takes what is left for less than two.
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
    /// Steps from the start of the stage to its end.
    pub steps: usize,
    /// Errors on the validation side at its end, of each view or of the estimator, percent; `null` for what cannot be measured.
    pub validation_mape_pct: Vec<Option<f64>>,
}

/// True if the last of these cycles lowered no error by more than the threshold.
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

/// Cause of the end of a stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EndedBy {
    /// Its errors no longer fell.
    Plateau,
    /// It made all steps that its settings allow.
    Steps,
}

/// A stage of a training, as `run.json` has it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StageSummary {
    /// The networks that it trained.
    pub network: String,
    /// The view whose network it trained, if it is one view's.
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
    /// Passes over these samples: what an epoch of the paper is one of.
    pub passes: f64,
    /// Cause of its end.
    pub ended_by: EndedBy,
    /// Its cycles.
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
