//! Training boxes that do not contain the aircraft: number, location and likely cause.

use std::collections::BTreeMap;
use std::fmt;

use dataset::numbers::spread::median_of;
use dataset::tables::pixel_box::PixelBox;
use glam::DVec2;
use serde::{Deserialize, Serialize};

use super::TrainingCameras;
use crate::samples::trusted_boxes::centre_and_size;
use crate::samples::{Sample, Samples};

/// Usual share of false boxes in a view.
const USUAL_SHARE: f64 = 0.02;
const NAMED: usize = 3;
/// A camera looked elsewhere in a scenario if at least this share of its boxes is dropped, and this share of them is off alike.
const MOVED_SHARE: f64 = 0.3;
const ALIKE_SHARE: f64 = 0.7;

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
    /// Offset shared by most dropped boxes, pixels.
    alike_px: Option<DVec2>,
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
                let mut off = Vec::new();
                let mut of = 0;
                for sample in flight {
                    let Some(seen) = &sample.boxes[view] else {
                        continue;
                    };
                    of += 1;
                    if !cameras.is_true(view, sample, seen) {
                        off.push((cameras.place_px(view, sample), *seen));
                    }
                }
                of_view = [of_view[0] + off.len(), of_view[1] + of];
                if !off.is_empty() {
                    scenarios.push(ScenarioDrops {
                        scenario: samples.scenarios[flight[0].scenario].id.clone(),
                        view: name.clone(),
                        dropped: off.len(),
                        of,
                        alike_px: alike_px(&off, of),
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

/// Offset from the aircraft that most dropped boxes share, if they are many.
fn alike_px(dropped: &[(Option<DVec2>, PixelBox)], of: usize) -> Option<DVec2> {
    if (dropped.len() as f64) < MOVED_SHARE * of as f64 {
        return None;
    }
    let off = dropped.iter().filter_map(|(place_px, seen)| {
        let (centre, size) = centre_and_size(seen);
        Some((centre - (*place_px)?, size))
    });
    let off: Vec<(DVec2, DVec2)> = off.collect();
    let middle = |axis: usize| median_of(off.iter().map(|(off, _)| off[axis]));
    let middle = DVec2::new(middle(0)?, middle(1)?);
    let is_alike = |(off, size): &&(DVec2, DVec2)| (*off - middle).abs().cmple(*size).all();
    let alike = off.iter().filter(is_alike).count();
    (alike as f64 >= ALIKE_SHARE * dropped.len() as f64).then_some(middle)
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
        let scenarios = || self.scenarios.iter();
        let named: Vec<String> = (scenarios().take(NAMED))
            .map(|s| format!("{} ({} {} of {})", s.scenario, s.view, s.dropped, s.of))
            .collect();
        write!(
            f,
            "dropped {dropped} of {of} training boxes, which do not contain the aircraft ({}); most in {}",
            by_view.join(", "),
            named.join(", ")
        )?;
        let moved: Vec<String> = scenarios()
            .filter_map(|s| {
                let DVec2 { x, y } = s.alike_px?;
                let [right, down] = [x, y].map(|off_px| off_px.round() as i64);
                Some(format!("{} ({} {right} px, {down} px)", s.scenario, s.view))
            })
            .take(NAMED)
            .collect();
        if moved.is_empty() {
            write!(
                f,
                ". They are off in different ways: the detector probably reports other objects; `dtd view` shows its boxes"
            )
        } else {
            write!(
                f,
                ". The same offset (right, down) of most of them in {} probably means that the camera looked elsewhere there, and that \
                 its background did not show it",
                moved.join(", ")
            )
        }
    }
}
