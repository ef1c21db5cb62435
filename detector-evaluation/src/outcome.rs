//! Outcome of each image: found, or missed for a reason.

pub(crate) mod picture;

use std::collections::HashMap;

use dataset::corpus::detections::{Detection, Detections, MissReason};
use labeller::matching::Match;

use picture::Picture;

/// An image with its detections.
#[derive(Debug)]
pub(crate) struct Searched<'a> {
    pub(crate) picture: &'a Picture,
    /// Best first: the confirmed ones, then by score.
    pub(crate) boxes: Vec<&'a Detection>,
    /// Reason why the search found no box, if it states one.
    reason: Option<MissReason>,
}

/// Result for an image that should show the aircraft.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Outcome<'a> {
    /// The best of the boxes that are the aircraft.
    Found(&'a Detection),
    /// The reason, in words.
    Missed(&'static str),
}

impl<'a> Searched<'a> {
    /// Every image with its boxes. `views` are the identifiers of the views.
    pub(crate) fn all(
        pictures: &'a [Picture],
        views: &[String],
        detections: &'a Detections,
    ) -> Vec<Self> {
        let mut boxes: HashMap<(u32, &str), Vec<&Detection>> = HashMap::new();
        for found in &detections.boxes {
            boxes
                .entry((found.tick, &found.view))
                .or_default()
                .push(found);
        }
        let mut reasons: HashMap<(u32, &str), MissReason> = detections
            .misses
            .iter()
            .map(|miss| ((miss.tick, miss.view.as_str()), miss.reason))
            .collect();
        let searched = |picture: &'a Picture| {
            let key = (picture.tick, views[picture.view].as_str());
            let mut boxes = boxes.remove(&key).unwrap_or_default();
            boxes.retain(|found| !picture.is_of_others(&found.pixel_box));
            boxes.sort_by(|a, b| {
                let confirmed = b.confirmed.cmp(&a.confirmed);
                confirmed.then(b.score.total_cmp(&a.score))
            });
            Self {
                picture,
                boxes,
                reason: reasons.remove(&key),
            }
        };
        pictures.iter().map(searched).collect()
    }

    /// Outcome of the image; `None` if no aircraft is expected in it.
    pub(crate) fn outcome(&self) -> Option<Outcome<'a>> {
        let truth = self.picture.expected()?.pixel_box;
        let matches = |found: &&&Detection| Match::of(&found.pixel_box, &truth);
        if let Some(hit) = self.boxes.iter().find(|found| matches(found) == Match::Hit) {
            return Some(Outcome::Found(hit));
        }
        let is_loose = self
            .boxes
            .iter()
            .any(|found| matches(&found) == Match::Loose);
        Some(Outcome::Missed(match (is_loose, self.boxes.is_empty()) {
            (true, _) => LOOSE,
            (false, false) => ELSEWHERE,
            (false, true) => self.reason.unwrap_or(MissReason::Nothing).word(),
        }))
    }

    /// Boxes that do not touch the aircraft.
    pub(crate) fn false_boxes(&self) -> impl Iterator<Item = &'a Detection> {
        let truth = self.picture.truth.as_ref().map(|truth| truth.pixel_box);
        let is_false = move |found: &&Detection| {
            truth.is_none_or(|truth| Match::of(&found.pixel_box, &truth) == Match::Elsewhere)
        };
        self.boxes.iter().copied().filter(is_false)
    }
}

/// A box touches the aircraft, but is too far off.
const LOOSE: &str = "loose";
/// Boxes, but none at the aircraft.
const ELSEWHERE: &str = "elsewhere";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::{picture, seen};
    use dataset::corpus::detections::{Miss, SearchMode};

    fn views() -> Vec<String> {
        vec!["left".into(), "right".into()]
    }

    #[test]
    fn every_picture_is_found_missed_for_a_reason_or_not_expected() {
        let pictures = [0, 1, 2, 3, 4].map(|tick| picture(tick, 0, 5.0));
        let mut pictures = pictures.to_vec();
        pictures[4].truth = None;
        let boxes = vec![
            seen(0, "left", 101.0, 0.5),
            seen(0, "left", 900.0, 0.9), // better, but somewhere else: the aircraft is found nevertheless
            seen(1, "left", 900.0, 0.9),
            seen(2, "left", 118.0, 0.9),
            seen(3, "right", 100.0, 0.9), // the other view
        ];
        let misses = vec![Miss {
            tick: 3,
            view: "left".into(),
            mode: SearchMode::Tracked,
            reason: MissReason::Lost,
        }];
        let detections = Detections { boxes, misses };
        let outcomes: Vec<_> = Searched::all(&pictures, &views(), &detections)
            .iter()
            .map(|searched| match searched.outcome() {
                Some(Outcome::Found(found)) => found.pixel_box.cx_px.to_string(),
                Some(Outcome::Missed(reason)) => reason.into(),
                None => "not expected".into(),
            })
            .collect();
        assert_eq!(
            outcomes,
            ["101", "elsewhere", "loose", "lost", "not expected"]
        );
    }

    #[test]
    fn a_box_of_another_aircraft_is_neither_found_nor_false() {
        let mut busy = picture(0, 0, 5.0);
        busy.others = vec![picture(0, 0, 5.0).truth.unwrap().pixel_box];
        busy.others[0].cx_px = 300.0;
        let pictures = [busy];
        let boxes = vec![seen(0, "left", 301.0, 0.9), seen(0, "left", 700.0, 0.8)];
        let detections = boxes.into();
        let searched = Searched::all(&pictures, &views(), &detections);
        assert_eq!(searched[0].outcome(), Some(Outcome::Missed(ELSEWHERE)));
        let false_boxes: Vec<_> = searched[0].false_boxes().map(|of| of.score).collect();
        assert_eq!(false_boxes, [0.8]);
    }

    #[test]
    fn a_box_is_false_only_if_it_does_not_touch_the_aircraft_however_little_of_it_is_visible() {
        let mut barely = picture(0, 0, 5.0);
        barely.truth.as_mut().unwrap().visible_fraction = 0.1;
        let mut empty = picture(1, 0, 5.0);
        empty.truth = None;
        let pictures = [barely, empty];
        let boxes = vec![
            seen(0, "left", 100.0, 0.9),
            seen(0, "left", 118.0, 0.8),
            seen(0, "left", 500.0, 0.7),
            seen(1, "left", 100.0, 0.6),
        ];
        let detections = boxes.into();
        let searched = Searched::all(&pictures, &views(), &detections);
        let scores: Vec<_> = searched
            .iter()
            .flat_map(Searched::false_boxes)
            .map(|found| found.score)
            .collect();
        assert_eq!(scores, [0.7, 0.6]);
        assert_eq!(searched[0].outcome(), None);
    }
}
