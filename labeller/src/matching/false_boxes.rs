//! Confirmed boxes that are no aircraft, by scenario and view, for a warning after the search of a labelled corpus.

use std::collections::{BTreeMap, HashMap};

use dataset::corpus::detections::Detection;
use dataset::numbers::spread::median_of;
use dataset::tables::pixel_box::PixelBox;
use serde::Serialize;

use crate::matching::Match;
use crate::matching::statistics::TruthInSight;

/// A view's confirmed boxes that do not touch a ground-truth box of the image.
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
    /// First tick of the largest track.
    pub tick: u32,
    /// Middle of the boxes of this track, pixels to the right...
    pub cx_px: f64,
    /// ... and down.
    pub cy_px: f64,
}

impl FalseBoxes {
    /// False boxes by view; none if all confirmed boxes touch the aircraft.
    pub(crate) fn of(
        scenario: &str,
        detections: &[Detection],
        truth: &[TruthInSight],
    ) -> Vec<Self> {
        let mut of_image: HashMap<(u32, &str), Vec<&PixelBox>> = HashMap::new();
        for TruthInSight { truth, .. } in truth {
            let key = (truth.tick, truth.view.as_str());
            of_image.entry(key).or_default().push(&truth.pixel_box);
        }
        let is_false = |found: &&Detection| {
            let real = of_image.get(&(found.tick, found.view.as_str()));
            let mut real = real.into_iter().flatten();
            real.all(|real| Match::of(&found.pixel_box, real) == Match::Elsewhere)
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
                median_of(largest.iter().map(|found| centre(&found.pixel_box)))
            };
            Some(Self {
                scenario: scenario.to_owned(),
                view: view.to_owned(),
                boxes: tracks.values().map(|boxes| boxes.len() as u64).sum(),
                tracks: tracks.len(),
                tick: largest.iter().map(|found| found.tick).min()?,
                cx_px: middle_px(|seen| seen.cx_px)?,
                cy_px: middle_px(|seen| seen.cy_px)?,
            })
        };
        views.into_iter().filter_map(of_view).collect()
    }
}
