//! Training boxes that do not contain the aircraft: number, location and likely cause.

use std::collections::BTreeMap;
use std::fmt;

use serde::{Deserialize, Serialize};

use super::TrainingCameras;
use crate::samples::{Sample, Samples};

/// Usual share of false boxes in a view.
const USUAL_SHARE: f64 = 0.02;
const NAMED: usize = 3;

/// Dropped boxes in a view.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DroppedBoxes {
    /// Boxes that do not contain the aircraft.
    pub dropped: usize,
    /// All boxes of the training side.
    pub of: usize,
    /// Ratio of the two; `None` for a view without boxes.
    pub share: Option<f64>,
}

pub(crate) type DroppedByView = BTreeMap<String, DroppedBoxes>;

/// Dropped boxes in one scenario and view.
#[derive(Debug, Clone, PartialEq)]
struct ScenarioDrops {
    scenario: String,
    view: String,
    dropped: usize,
    of: usize,
}

#[derive(Debug, Clone)]
pub(super) struct TrainingDrops {
    pub(super) by_view: DroppedByView,
    /// Scenarios with dropped boxes, in descending order.
    scenarios: Vec<ScenarioDrops>,
}

impl TrainingDrops {
    /// Counts the boxes of the training side that do not contain the aircraft.
    pub(super) fn of(cameras: &TrainingCameras, samples: &Samples, training: &[&Sample]) -> Self {
        let mut by_view = DroppedByView::new();
        let mut scenarios = Vec::new();
        for (view, name) in samples.views.iter().enumerate() {
            let mut of_view = [0, 0];
            for flight in training.chunk_by(|a, b| a.scenario == b.scenario) {
                let seen = flight.iter().filter_map(|sample| {
                    let seen = sample.best(view)?;
                    Some(cameras.is_true(view, sample, seen))
                });
                let (kept, off): (Vec<bool>, Vec<bool>) = seen.partition(|is_true| *is_true);
                let (dropped, of) = (off.len(), kept.len() + off.len());
                of_view = [of_view[0] + dropped, of_view[1] + of];
                if dropped > 0 {
                    scenarios.push(ScenarioDrops {
                        scenario: samples.scenarios[flight[0].scenario].id.clone(),
                        view: name.clone(),
                        dropped,
                        of,
                    });
                }
            }
            let [dropped, of] = of_view;
            let share = (of > 0).then(|| dropped as f64 / of as f64);
            by_view.insert(name.clone(), DroppedBoxes { dropped, of, share });
        }
        scenarios.sort_by_key(|scenario| std::cmp::Reverse(scenario.dropped));
        Self { by_view, scenarios }
    }

    /// True if a view has an unusual share of false boxes.
    pub(super) fn are_unusual(&self) -> bool {
        let mut shares = self.by_view.values().filter_map(|view| view.share);
        shares.any(|share| share > USUAL_SHARE)
    }
}

impl fmt::Display for TrainingDrops {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let views = self.by_view.values();
        let [dropped, of] = views.fold([0, 0], |[dropped, of], view| {
            [dropped + view.dropped, of + view.of]
        });
        let of_view = |(view, boxes): (&String, &DroppedBoxes)| {
            format!("{view} {} of {}", boxes.dropped, boxes.of)
        };
        let by_view: Vec<String> = self.by_view.iter().map(of_view).collect();
        let named: Vec<String> = (self.scenarios.iter().take(NAMED))
            .map(|s| format!("{} ({} {} of {})", s.scenario, s.view, s.dropped, s.of))
            .collect();
        write!(
            f,
            "dropped {dropped} of {of} training boxes, which do not contain the aircraft ({}); most in {}. The detector reports other objects, \
             or a camera looked elsewhere and its background did not show it; `dtd view` shows its boxes",
            by_view.join(", "),
            named.join(", ")
        )
    }
}
