//! Average precision as COCO defines it.
//!
//! Boxes of all images are sorted by score. A box is right if it overlaps the true one by at least a threshold (intersection over
//! union) and no better-scored box of the image does; the AP of a threshold is the mean, over 101 recalls, of the best precision at
//! that recall or beyond. AP is the mean over the thresholds 0.50, 0.55, ... 0.95. Aircraft of which half or less is visible, or which the
//! air hides, are neither right nor wrong, as COCO's crowds, and so is everything of another size where figures are by size: areas of
//! boxes below 32 x 32 px, below 96 x 96 px, and above. `tests/detector_evaluation.rs` compares with pycocotools.
//!
//! The search drops boxes below its score, but for faint ones of confirmed tracks, so precision at recalls beyond the last box counts as 0.

use dataset::tables::pixel_box::PixelBox;
use serde::Serialize;

/// Number of thresholds, from 0.5 in steps of 0.05.
const THRESHOLDS: usize = 10;
/// COCO's sizes: all, small, medium, large; areas, square pixels, both ends included.
const AREAS_PX2: [[f64; 2]; 4] = [
    [0.0, 1e10],
    [0.0, 1_024.0],
    [1_024.0, 9_216.0],
    [9_216.0, 1e10],
];
/// Recalls with a precision: 0, 0.01, ... 1.
const RECALLS: usize = 101;
const RECALL_STEP: f64 = 0.01;
/// Maximum number of boxes per image, the best ones.
const MAX_BOXES: usize = 100;

/// Average precision; null where there is no aircraft of that size.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct AveragePrecision {
    /// Mean over the thresholds 0.50 to 0.95.
    pub ap: Option<f64>,
    /// AP at the threshold 0.50.
    pub ap50: Option<f64>,
    /// AP at the threshold 0.75.
    pub ap75: Option<f64>,
    /// AP of boxes below 32 x 32 px.
    pub ap_small: Option<f64>,
    /// AP of boxes from 32 x 32 to 96 x 96 px.
    pub ap_medium: Option<f64>,
    /// AP of boxes above 96 x 96 px.
    pub ap_large: Option<f64>,
}

/// Ground truth in an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrueAircraft {
    /// The box.
    pub pixel_box: PixelBox,
    /// True if finding the aircraft counts neither as right nor as wrong.
    pub is_ignored: bool,
}

/// A box that an image's truth judges: a bit for each threshold, by size.
#[derive(Debug, Clone, Copy)]
struct Judged {
    score: f64,
    right: [u16; AREAS_PX2.len()],
    ignored: [u16; AREAS_PX2.len()],
}

/// Boxes and aircraft of many images.
#[derive(Debug, Clone, Default)]
pub struct PrecisionTally {
    boxes: Vec<Judged>,
    aircraft: [u64; AREAS_PX2.len()],
}

impl PrecisionTally {
    /// Counts an image. `found` are its boxes with their scores, in the order that decides between equal scores.
    pub fn count(&mut self, truth: Option<TrueAircraft>, found: &[(PixelBox, f64)]) {
        let mut found = found.to_vec();
        found.sort_by(|a, b| b.1.total_cmp(&a.1));
        found.truncate(MAX_BOXES);
        let first = self.boxes.len();
        self.boxes.extend(found.iter().map(|(_, score)| Judged {
            score: *score,
            right: [0; 4],
            ignored: [0; 4],
        }));
        for (size, [least, most]) in AREAS_PX2.into_iter().enumerate() {
            let is_inside = |pixel_box: &PixelBox| (least..=most).contains(&pixel_box.area());
            let is_wanted =
                truth.is_some_and(|truth| !truth.is_ignored && is_inside(&truth.pixel_box));
            self.aircraft[size] += u64::from(is_wanted);
            for threshold in 0..THRESHOLDS {
                let bit = 1 << threshold;
                let mut is_taken = false;
                for (judged, (pixel_box, _)) in self.boxes[first..].iter_mut().zip(&found) {
                    let fits = truth.is_some_and(|truth| {
                        overlap(pixel_box, &truth) >= 0.5 + 0.05 * threshold as f64
                    });
                    // A crowd takes any number of boxes.
                    let is_crowd = truth.is_some_and(|truth| truth.is_ignored);
                    if fits && (!is_taken || is_crowd) {
                        is_taken = true;
                        if is_wanted {
                            judged.right[size] |= bit;
                        } else {
                            judged.ignored[size] |= bit;
                        }
                    } else if !is_inside(pixel_box) {
                        judged.ignored[size] |= bit;
                    }
                }
            }
        }
    }

    /// The figures.
    pub fn figures(mut self) -> AveragePrecision {
        self.boxes.sort_by(|a, b| b.score.total_cmp(&a.score));
        let mean = |size: usize| {
            let all = (0..THRESHOLDS).map(|threshold| self.at(size, threshold));
            Some(all.sum::<Option<f64>>()? / THRESHOLDS as f64)
        };
        AveragePrecision {
            ap: mean(0),
            ap50: self.at(0, 0),
            ap75: self.at(0, 5),
            ap_small: mean(1),
            ap_medium: mean(2),
            ap_large: mean(3),
        }
    }

    /// AP for a size at a threshold; the boxes are sorted.
    fn at(&self, size: usize, threshold: usize) -> Option<f64> {
        let aircraft = self.aircraft[size];
        if aircraft == 0 {
            return None;
        }
        let (mut right, mut wrong) = (0_u64, 0_u64);
        let mut curve = Vec::new();
        for judged in &self.boxes {
            let bit = 1 << threshold;
            if judged.ignored[size] & bit != 0 {
                continue;
            }
            if judged.right[size] & bit != 0 {
                right += 1;
            } else {
                wrong += 1;
            }
            let recall = right as f64 / aircraft as f64;
            curve.push((recall, right as f64 / (right + wrong) as f64));
        }
        // The best precision at each recall or beyond.
        let mut best: f64 = 0.0;
        for (_, precision) in curve.iter_mut().rev() {
            best = best.max(*precision);
            *precision = best;
        }
        let precision_at = |step: usize| {
            let wanted = step as f64 * RECALL_STEP;
            let place = curve.partition_point(|(recall, _)| *recall < wanted);
            curve.get(place).map_or(0.0, |(_, precision)| *precision)
        };
        Some((0..RECALLS).map(precision_at).sum::<f64>() / RECALLS as f64)
    }
}

/// Intersection over union; for a crowd, the part of the found box that is inside it.
fn overlap(found: &PixelBox, truth: &TrueAircraft) -> f64 {
    if !truth.is_ignored {
        found.iou(&truth.pixel_box)
    } else if found.area() > 0.0 {
        found.intersection(&truth.pixel_box) / found.area()
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(left: f64, side: f64) -> PixelBox {
        PixelBox::from_edges(left, 0.0, left + side, side)
    }

    fn truth(side: f64) -> Option<TrueAircraft> {
        Some(TrueAircraft {
            pixel_box: square(0.0, side),
            is_ignored: false,
        })
    }

    #[test]
    fn perfect_boxes_have_an_ap_of_one_and_no_aircraft_none() {
        let mut tally = PrecisionTally::default();
        for side in [10.0, 50.0] {
            tally.count(truth(side), &[(square(0.0, side), 0.9)]);
        }
        let figures = tally.figures();
        assert!((figures.ap.unwrap() - 1.0).abs() < 1e-12);
        assert!(figures.ap_small.is_some() && figures.ap_medium.is_some());
        assert_eq!(figures.ap_large, None);
        let mut empty = PrecisionTally::default();
        empty.count(None, &[(square(0.0, 10.0), 0.9)]);
        assert_eq!(empty.figures().ap, None);
    }

    #[test]
    fn a_false_box_before_the_true_one_halves_precision_and_one_after_it_costs_nothing() {
        let at = |score: f64| {
            let mut tally = PrecisionTally::default();
            tally.count(truth(10.0), &[(square(0.0, 10.0), 0.5)]);
            tally.count(None, &[(square(300.0, 10.0), score)]);
            tally.figures().ap50.unwrap()
        };
        assert_eq!((at(0.9), at(0.1)), (0.5, 1.0));
    }

    #[test]
    fn a_second_box_on_the_aircraft_is_wrong_but_not_on_one_that_is_ignored() {
        let ap50 = |is_ignored: bool| {
            let mut tally = PrecisionTally::default();
            let doubled = truth(10.0).map(|truth| TrueAircraft {
                is_ignored,
                ..truth
            });
            tally.count(
                doubled,
                &[(square(0.0, 10.0), 0.9), (square(1.0, 10.0), 0.8)],
            );
            tally.count(truth(10.0), &[(square(0.0, 10.0), 0.7)]);
            tally.figures().ap50.unwrap()
        };
        assert_eq!(ap50(true), 1.0);
        assert!((ap50(false) - (51.0 + 50.0 * 2.0 / 3.0) / 101.0).abs() < 1e-12);
    }
}
