//! Confirmed boxes that are not the aircraft, by scenario and view, for the warning of a search of a labelled corpus.

use std::collections::{BTreeMap, HashMap};

use dataset::corpus::detections::Detection;
use dataset::numbers::spread::median;
use dataset::tables::pixel_box::PixelBox;
use serde::Serialize;

use crate::matching::Match;
use crate::matching::statistics::TruthInSight;

/// The confirmed boxes of a view that do not touch the ground-truth box of their image.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FalseBoxes {
    /// The scenario.
    pub scenario: String,
    /// The view.
    pub view: String,
    /// Number of boxes, at least 1.
    pub boxes: u64,
    /// Number of tracks that they belong to.
    pub tracks: usize,
    /// Tick of the first box of the track with the most of them.
    pub tick: u32,
    /// Middle of the boxes of this track, pixels to the right...
    pub cx_px: f64,
    /// ... and down.
    pub cy_px: f64,
}

impl FalseBoxes {
    /// The false boxes of a scenario, by view; none if all confirmed boxes touch the aircraft.
    pub(crate) fn of(
        scenario: &str,
        detections: &[Detection],
        truth: &[TruthInSight],
    ) -> Vec<Self> {
        let truth: HashMap<(u32, &str), &PixelBox> = truth
            .iter()
            .map(|TruthInSight { truth, .. }| ((truth.tick, truth.view.as_str()), &truth.pixel_box))
            .collect();
        let is_false = |found: &&Detection| {
            let real = truth.get(&(found.tick, found.view.as_str()));
            real.is_none_or(|real| Match::of(&found.pixel_box, real) == Match::Elsewhere)
        };
        let mut views: BTreeMap<&str, BTreeMap<Option<u32>, Vec<&Detection>>> = BTreeMap::new();
        for found in detections.iter().filter(|found| found.confirmed) {
            if is_false(&found) {
                let tracks = views.entry(&found.view).or_default();
                tracks.entry(found.track).or_default().push(found);
            }
        }
        let of_view = |(view, tracks): (&str, BTreeMap<_, Vec<&Detection>>)| {
            let largest = tracks.values().max_by_key(|boxes| boxes.len())?;
            let middle_px = |centre: fn(&PixelBox) -> f64| {
                let mut centres: Vec<_> = largest
                    .iter()
                    .map(|found| centre(&found.pixel_box))
                    .collect();
                median(&mut centres)
            };
            Some(Self {
                scenario: scenario.to_owned(),
                view: view.to_owned(),
                boxes: tracks.values().map(|boxes| boxes.len() as u64).sum(),
                tracks: tracks.len(),
                tick: largest.iter().map(|found| found.tick).min()?,
                cx_px: middle_px(|seen| seen.cx_px),
                cy_px: middle_px(|seen| seen.cy_px),
            })
        };
        views.into_iter().filter_map(of_view).collect()
    }
}

#[cfg(test)]
mod tests {
    use dataset::conditions::sight::Sight;
    use dataset::tables::pixel_box::TruthBox;

    use super::*;

    fn at(cx_px: f64) -> PixelBox {
        PixelBox {
            cx_px,
            cy_px: 100.0,
            width_px: 20.0,
            height_px: 8.0,
        }
    }

    fn seen(tick: u32, view: &str, cx_px: f64, track: u32) -> Detection {
        Detection {
            track: Some(track),
            ..Detection::untracked(tick, view, at(cx_px), 0.9, 0)
        }
    }

    #[test]
    fn confirmed_boxes_beside_the_aircraft_are_told_by_view_with_the_place_of_the_largest_track() {
        let truth = |tick: u32| TruthInSight {
            truth: TruthBox {
                tick,
                view: "left".into(),
                class: "aircraft".into(),
                pixel_box: at(100.0),
                visible_fraction: 1.0,
                truncation: 0.0,
                transmission: 1.0,
            },
            sight: Sight::Open,
        };
        let truth = [truth(0), truth(1), truth(2)];
        let detections = [
            seen(0, "left", 105.0, 0),
            seen(0, "left", 700.0, 1),
            seen(1, "left", 500.0, 2),
            seen(1, "right", 100.0, 0), // no truth there
            seen(2, "left", 501.0, 2),
            Detection {
                confirmed: false,
                ..seen(2, "left", 800.0, 3)
            },
        ];
        let found = FalseBoxes::of("0001-a", &detections, &truth);
        let told: Vec<_> = found
            .iter()
            .map(|of| (of.view.as_str(), of.boxes, of.tracks, of.tick, of.cx_px))
            .collect();
        assert_eq!(told, [("left", 3, 2, 1, 501.0), ("right", 1, 1, 1, 100.0)]);
        assert_eq!(FalseBoxes::of("0001-a", &detections[..1], &truth), []);
    }
}
