//! Selection of detected boxes for fits and measurements.
//!
//! A detector also reports other objects, and parts of aircraft that leave the image. A few such boxes in thousands ruin a
//! least-squares fit: they are wrong by hundreds of percent, correct ones by one percent. Two rules exclude them, and every consumer of
//! samples gets them from [`crate::samples`] (a third one is for scenarios with traffic):
//!
//! - **Whole** needs no ground truth and applies to all sides: a box at the image's edge is cut off there, so its centre and size are
//!   wrong.
//! - **Contains the aircraft** needs ground truth, so it applies to the training side only: to the formulas and the ranges of
//!   [`crate::networks::normalisation`], and to the networks only on request, because the paper's networks learn from all detections. The
//!   boxes of all training flights determine the aircraft's image position ([`crate::samples::training_cameras`]), not `calibration.json`.
//! - **Of the first aircraft** needs ground truth as well, and applies to the training side of scenarios with traffic: a box that is
//!   another aircraft's would be learned with the wrong distance. Other sides see what a live estimator sees.
//!
//! A tick without any remaining box has no estimate.

use std::collections::{HashMap, HashSet};

use dataset::corpus::detections::Detection;
use dataset::geometry::camera::Camera;
use dataset::tables::pixel_box::{PixelBox, TruthBox};
use glam::DVec2;

/// Distance from the image's edge within which a box counts as cut off, pixels: detectors place an invisible edge to within one or two
/// pixels.
const EDGE_PX: f64 = 2.0;

pub(crate) fn is_whole(seen: &PixelBox, camera: &Camera) -> bool {
    let [left, top, right, bottom] = seen.edges();
    // Pixel (0, 0) covers -0.5 to 0.5.
    left > EDGE_PX - 0.5
        && top > EDGE_PX - 0.5
        && right < f64::from(camera.width_px) - 0.5 - EDGE_PX
        && bottom < f64::from(camera.height_px) - 0.5 - EDGE_PX
}

/// Drops boxes that overlap another aircraft more than the first one.
///
/// Returns tick and view of the images that lost a box: what was registered there may be the other aircraft.
pub(crate) fn retain_first_aircraft(
    detections: &mut Vec<Detection>,
    truth: &[TruthBox],
) -> HashSet<(u32, String)> {
    let mut lost = HashSet::new();
    let mut of_image: HashMap<(u32, &str), Vec<&TruthBox>> = HashMap::new();
    for real in truth {
        let key = (real.tick, real.view.as_str());
        of_image.entry(key).or_default().push(real);
    }
    detections.retain(|found| {
        let here = of_image.get(&(found.tick, found.view.as_str()));
        let overlap = |of_first: bool| {
            let here = here.into_iter().flatten();
            here.filter(|real| real.is_of_first() == of_first)
                .map(|real| real.pixel_box.iou(&found.pixel_box))
                .fold(0.0, f64::max)
        };
        let is_first = overlap(true) >= overlap(false);
        if !is_first {
            lost.insert((found.tick, found.view.clone()));
        }
        is_first
    });
    lost
}

/// True if a box contains the aircraft: its centre is within its own size of `place_px`.
pub(crate) fn is_at(seen: &PixelBox, place_px: DVec2) -> bool {
    let (centre, size) = centre_and_size(seen);
    (place_px - centre).abs().cmple(size).all()
}

pub(crate) fn centre_and_size(seen: &PixelBox) -> (DVec2, DVec2) {
    (
        DVec2::new(seen.cx_px, seen.cy_px),
        DVec2::new(seen.width_px, seen.height_px),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Samples;
    use testkit::synthetic::SyntheticCorpus;

    fn tiny() -> Samples {
        Samples::synthetic(&SyntheticCorpus::tiny(), 0.05)
    }

    #[test]
    fn a_box_that_ends_at_the_picture_s_edge_is_not_whole() {
        let camera = tiny().scenarios[0].cameras[0];
        let [width_px, height_px] = [camera.width_px, camera.height_px].map(f64::from);
        let whole = |[left, top, right, bottom]: [f64; 4]| {
            is_whole(&PixelBox::from_edges(left, top, right, bottom), &camera)
        };
        assert!(whole([10.0, 10.0, 60.0, 30.0]));
        assert!(!whole([-0.4, 10.0, 60.0, 30.0]));
        assert!(!whole([10.0, -5.0, 60.0, 30.0]));
        assert!(!whole([width_px - 60.0, 10.0, width_px - 1.0, 30.0]));
        assert!(!whole([10.0, height_px - 20.0, 60.0, height_px]));
    }

    #[test]
    fn every_box_of_a_detector_without_false_boxes_holds_the_aircraft_and_none_does_when_moved_away()
     {
        let samples = tiny();
        for sample in &samples.samples {
            let cameras = &samples.scenarios[sample.scenario].cameras;
            for (view, seen) in sample.seen() {
                let place_px = cameras[view].project(sample.position.to_ecef()).unwrap();
                assert!(is_at(seen, place_px), "{seen:?}");
                let elsewhere = PixelBox {
                    cy_px: seen.cy_px + 1.5 * seen.height_px,
                    ..*seen
                };
                assert!(!is_at(&elsewhere, place_px));
            }
        }
    }

    #[test]
    fn a_box_of_another_aircraft_is_dropped_and_a_false_one_stays() {
        let real = |aircraft_number, cx_px| TruthBox {
            tick: 3,
            view: "left".into(),
            class: "aircraft".into(),
            pixel_box: at(cx_px),
            visible_fraction: 1.0,
            truncation: 0.0,
            transmission: 1.0,
            aircraft_number: Some(aircraft_number),
            occluded_fraction: Some(0.0),
        };
        let truth = [real(0, 100.0), real(1, 140.0)];
        let seen = |tick, cx_px| Detection::untracked(tick, "left", at(cx_px), 0.9, 0);
        let mut found = vec![
            seen(3, 104.0),
            seen(3, 137.0),
            seen(3, 300.0),
            seen(4, 140.0),
        ];
        let lost = retain_first_aircraft(&mut found, &truth);
        assert!(
            !lost.is_empty() && lost.iter().all(|(tick, _)| [3, 4].contains(tick)),
            "{lost:?}"
        );
        let kept: Vec<_> = found
            .iter()
            .map(|of| (of.tick, of.pixel_box.cx_px))
            .collect();
        assert_eq!(kept, [(3, 104.0), (3, 300.0), (4, 140.0)]);
    }

    fn at(cx_px: f64) -> PixelBox {
        PixelBox {
            cx_px,
            cy_px: 50.0,
            width_px: 30.0,
            height_px: 10.0,
        }
    }
}
