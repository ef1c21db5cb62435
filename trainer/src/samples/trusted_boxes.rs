//! Selection of a detector's boxes: which ones formulas are fitted to, and which ones do not count as measurements.
//!
//! A detector also reports boxes of other objects, and of parts of an aircraft that leaves the image. A few of them in thousands ruin a
//! least-squares fit: such a box is wrong by hundreds of percent, a correct one by one percent. Two rules keep them out, and every consumer
//! of samples gets them from [`crate::samples`]:
//!
//! - **Whole** needs no truth and applies to all sides: a box that touches the image's edge is cut off there, so neither its
//!   centre nor its size is the aircraft's.
//! - **Contains the aircraft** needs the truth, so it applies to the training side only, and there to the formulas and to the ranges of
//!   [`crate::networks::normalisation`]; to the networks only if the settings ask for it, because the paper's networks learn from all
//!   detections. The boxes of all training flights decide where the aircraft is in an image ([`crate::samples::training_cameras`]), not
//!   `calibration.json`.
//!
//! A tick without any box left gets no answer.

pub(crate) mod other_boxes;

use dataset::geometry::camera::Camera;
use dataset::tables::pixel_box::PixelBox;
use glam::DVec2;

/// A box that ends this near the image's edge touches it, pixels: a detector places an invisible edge within a pixel or two.
const EDGE_PX: f64 = 2.0;

/// True if a box is completely within the image.
pub(crate) fn is_whole(seen: &PixelBox, camera: &Camera) -> bool {
    let [left, top, right, bottom] = seen.edges();
    // Pixel (0, 0) covers -0.5 to 0.5.
    left > EDGE_PX - 0.5
        && top > EDGE_PX - 0.5
        && right < f64::from(camera.width_px) - 0.5 - EDGE_PX
        && bottom < f64::from(camera.height_px) - 0.5 - EDGE_PX
}

/// True if a box contains the aircraft, which is at `place_px` in the image: its centre is within its own size of that place.
pub(crate) fn is_at(seen: &PixelBox, place_px: DVec2) -> bool {
    let (centre, size) = centre_and_size(seen);
    (place_px - centre).abs().cmple(size).all()
}

/// Centre and size of a box, pixels.
pub(crate) fn centre_and_size(seen: &PixelBox) -> (DVec2, DVec2) {
    (
        DVec2::new(seen.cx_px, seen.cy_px),
        DVec2::new(seen.width_px, seen.height_px),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::{DistanceRange, Samples};
    use testkit::synthetic::SyntheticCorpus;

    fn tiny() -> Samples {
        let folder = tempfile::tempdir().unwrap();
        let corpus = SyntheticCorpus::tiny().write(folder.path()).unwrap();
        let range = DistanceRange {
            min_nm: 0.05,
            max_nm: None,
        };
        Samples::read(&corpus, None, range).unwrap()
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
            for (seen, camera) in sample.boxes.iter().zip(cameras) {
                let Some(seen) = seen else { continue };
                let place_px = camera.project(sample.position.to_ecef()).unwrap();
                assert!(is_at(seen, place_px), "{seen:?}");
                let elsewhere = PixelBox {
                    cy_px: seen.cy_px + 1.5 * seen.height_px,
                    ..*seen
                };
                assert!(!is_at(&elsewhere, place_px));
            }
        }
    }
}
