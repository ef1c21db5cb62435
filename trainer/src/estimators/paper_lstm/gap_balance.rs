//! Algorithm 1 of the paper as a state machine: which views' calibration networks are trained next.
//!
//! All views train until every view's error stagnates. Views that then lag behind the best one train on alone, with the shared head
//! frozen, until the errors stagnate again. Input: each view's error, as a mean over at least a whole pass through the training side, which
//! mini-batches' noise hardly moves.

use dataset::numbers::spread::mean_and_deviation;
use serde::{Deserialize, Serialize};

/// Number of log entries over which errors must stagnate.
const WINDOW: usize = 3;

/// Algorithm state.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct GapBalance {
    min_steps: usize,
    plateau_threshold: f64,
    gap_threshold: f64,
    optimised: Vec<bool>,
    steps_since_change: usize,
    log: Vec<Vec<Option<f64>>>,
}

impl GapBalance {
    /// All views optimised; thresholds in the unit of the errors.
    pub(crate) fn new(
        views: usize,
        min_steps: usize,
        plateau_threshold: f64,
        gap_threshold: f64,
    ) -> Self {
        Self {
            min_steps,
            plateau_threshold,
            gap_threshold,
            optimised: vec![true; views],
            steps_since_change: 0,
            log: Vec::new(),
        }
    }

    /// For each view, true if it is being optimised.
    pub(crate) fn optimised(&self) -> &[bool] {
        &self.optimised
    }

    /// True if all views are optimised, and with them the shared head.
    pub(crate) fn all_optimised(&self) -> bool {
        self.optimised.iter().all(|&optimised| optimised)
    }

    /// Records the errors over the last `steps` steps, one per view; `None` for a view that cannot be measured, which then never
    /// counts as lagging.
    pub(crate) fn observe(&mut self, steps: usize, errors: &[Option<f64>]) {
        self.steps_since_change += steps;
        self.log.push(errors.to_vec());
        if self.steps_since_change <= self.min_steps || !self.on_plateau() {
            return;
        }
        let lagging = self.lagging(errors);
        if lagging.contains(&true) {
            self.optimised = lagging;
            self.steps_since_change = 0;
        } else {
            self.optimised = vec![true; errors.len()];
        }
    }

    /// For each view, true if its error exceeds the lowest by more than the threshold.
    fn lagging(&self, errors: &[Option<f64>]) -> Vec<bool> {
        let best = errors
            .iter()
            .flatten()
            .copied()
            .fold(f64::INFINITY, f64::min);
        let lags = |error: &Option<f64>| error.is_some_and(|e| e - best > self.gap_threshold);
        errors.iter().map(lags).collect()
    }

    fn on_plateau(&self) -> bool {
        let Some(recent) = self
            .log
            .len()
            .checked_sub(WINDOW)
            .map(|from| &self.log[from..])
        else {
            return false;
        };
        (0..self.optimised.len()).all(|view| {
            let [_, deviation] = mean_and_deviation(recent.iter().filter_map(|entry| entry[view]));
            deviation < self.plateau_threshold
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn observe(balance: &mut GapBalance, times: usize, left: f64, right: f64) {
        for _ in 0..times {
            balance.observe(100, &[Some(left), Some(right)]);
        }
    }

    #[test]
    fn all_views_train_until_the_minimum_of_steps() {
        let mut balance = GapBalance::new(2, 1_000, 0.1, 0.2);
        observe(&mut balance, 10, 1.0, 3.0);
        assert!(balance.all_optimised());
        observe(&mut balance, 1, 1.0, 3.0);
        assert_eq!(balance.optimised(), [false, true]);
    }

    #[test]
    fn nothing_changes_while_any_view_still_moves() {
        let mut balance = GapBalance::new(2, 0, 0.1, 0.2);
        for step in 0..20 {
            balance.observe(100, &[Some(1.0), Some(10.0 - 0.3 * f64::from(step))]);
            assert!(balance.all_optimised());
        }
    }

    #[test]
    fn a_lagging_view_trains_alone_until_it_has_caught_up() {
        let mut balance = GapBalance::new(2, 400, 0.1, 0.2);
        observe(&mut balance, 5, 3.0, 1.0);
        assert_eq!(balance.optimised(), [true, false]);
        // The counter restarts: four more entries are too few, however flat.
        observe(&mut balance, 4, 1.1, 1.0);
        assert_eq!(balance.optimised(), [true, false]);
        observe(&mut balance, 1, 1.1, 1.0);
        assert!(balance.all_optimised());
    }

    #[test]
    fn the_best_of_three_views_waits_for_both_others() {
        let mut balance = GapBalance::new(3, 0, 0.1, 0.2);
        for _ in 0..3 {
            balance.observe(100, &[Some(2.0), Some(1.0), Some(1.5)]);
        }
        assert_eq!(balance.optimised(), [true, false, true]);
    }

    #[test]
    fn a_view_without_validation_samples_is_never_lagging() {
        let mut balance = GapBalance::new(2, 0, 0.1, 0.2);
        for _ in 0..5 {
            balance.observe(100, &[None, Some(9.0)]);
        }
        assert!(balance.all_optimised());
    }
}
