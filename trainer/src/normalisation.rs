//! Box features in the networks' form: centre and size, shifted and scaled per camera.
//!
//! Offsets and scales are mean and standard deviation over the training side only, so that nothing of validation or test leaks in.
//! Distances are in units of 10 NM.
//!
//! The training side also determines which boxes are outliers: far from any box of the training side, or of a very different size.
//! An estimator can ignore such a box without knowing the truth.

use dataset::pixel_box::PixelBox;
use dataset::units::METERS_PER_NAUTICAL_MILE;
use serde::{Deserialize, Serialize};

use crate::samples::Sample;

/// The networks' unit of distance, metres.
pub(crate) const TARGET_UNIT_M: f64 = 10.0 * METERS_PER_NAUTICAL_MILE;
/// Number of features of a box: centre x, centre y, width, height.
pub(crate) const BOX_FEATURES: usize = 4;

/// Offset and scale of each camera's features.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Normalisation {
    /// Identifiers of the views.
    pub views: Vec<String>,
    /// Per view, of centre x, centre y, width, height; pixels.
    pub offset_px: Vec<[f64; BOX_FEATURES]>,
    /// Per view, of centre x, centre y, width, height; pixels.
    pub scale_px: Vec<[f64; BOX_FEATURES]>,
    /// Per view, smallest and largest of centre x, centre y, width, height; pixels. A view without boxes has no range and rejects
    /// every box; in older runs all ranges are missing, and every box is accepted.
    #[serde(default)]
    pub range_px: Option<Vec<Option<[[f64; 2]; BOX_FEATURES]>>>,
}

/// How far outside the range of the training side a box's centre may be, in parts of the range's extent.
const BEYOND: f64 = 0.25;
/// How much smaller or larger than any box of the training side a box may be.
const OTHER_SIZE: f64 = 2.0;

impl Normalisation {
    /// Fits offsets and scales. A view that never saw anything keeps offset 0 and scale 1.
    pub(crate) fn fit(views: &[String], training: &[&Sample]) -> Self {
        let statistics = |view: usize| {
            let rows: Vec<_> = training
                .iter()
                .filter_map(|s| s.boxes[view].map(|b| features_px(&b)))
                .collect();
            let count = rows.len().max(1) as f64;
            let mut offset = [0.0; BOX_FEATURES];
            let mut scale = [1.0; BOX_FEATURES];
            for feature in 0..BOX_FEATURES {
                let mean = rows.iter().map(|row| row[feature]).sum::<f64>() / count;
                let variance = rows
                    .iter()
                    .map(|row| (row[feature] - mean).powi(2))
                    .sum::<f64>()
                    / count;
                offset[feature] = mean;
                if variance > 0.0 {
                    scale[feature] = variance.sqrt();
                }
            }
            (offset, scale)
        };
        let range = |view: usize| {
            let mut seen = training.iter().filter_map(|s| s.boxes[view]);
            let first = features_px(&seen.next()?).map(|value| [value; 2]);
            Some(seen.fold(first, |range, pixel_box| {
                let features = features_px(&pixel_box);
                std::array::from_fn(|i| {
                    [range[i][0].min(features[i]), range[i][1].max(features[i])]
                })
            }))
        };
        let (offset_px, scale_px) = (0..views.len()).map(statistics).unzip();
        Self {
            views: views.to_vec(),
            offset_px,
            scale_px,
            range_px: Some((0..views.len()).map(range).collect()),
        }
    }

    /// The sample without the boxes that are unlike any of the training side: in size, and also in position unless the cameras
    /// differ from those of the training side (`other_cameras`).
    pub(crate) fn without_outliers(&self, sample: &Sample, other_cameras: bool) -> Sample {
        let believed = |view: usize, seen: &PixelBox| match &self.range_px {
            None => true,
            Some(ranges) => {
                ranges[view].is_some_and(|range| is_inlier(&range, seen, other_cameras))
            }
        };
        let boxes = sample.boxes.iter().enumerate();
        sample.with_boxes(
            boxes
                .map(|(view, seen)| seen.filter(|seen| believed(view, seen)))
                .collect(),
        )
    }

    /// The features of a box in one view.
    pub(crate) fn features(&self, view: usize, pixel_box: &PixelBox) -> [f32; BOX_FEATURES] {
        let raw = features_px(pixel_box);
        std::array::from_fn(|i| {
            ((raw[i] - self.offset_px[view][i]) / self.scale_px[view][i]) as f32
        })
    }
}

fn is_inlier(range: &[[f64; 2]; BOX_FEATURES], seen: &PixelBox, anywhere: bool) -> bool {
    features_px(seen).iter().zip(range).enumerate().all(
        |(feature, (&value, &[smallest, largest]))| {
            let is_place = feature < 2;
            let allowed = if is_place && anywhere {
                return true;
            } else if is_place {
                let margin = BEYOND * (largest - smallest);
                smallest - margin..=largest + margin
            } else {
                smallest / OTHER_SIZE..=largest * OTHER_SIZE
            };
            allowed.contains(&value)
        },
    )
}

fn features_px(b: &PixelBox) -> [f64; BOX_FEATURES] {
    [b.cx_px, b.cy_px, b.width_px, b.height_px]
}

#[cfg(test)]
mod tests {
    use super::*;
    use dataset::geodesy::Geodetic;

    fn sample(cx_px: f64, width_px: f64) -> Sample {
        Sample {
            scenario: 0,
            tick: 0,
            time_ns: 0,
            dtd_m: 1.0,
            along_track_m: 1.0,
            cross_track_m: 0.0,
            position: Geodetic {
                latitude_deg: 0.0,
                longitude_deg: 0.0,
                altitude_msl_m: 0.0,
            },
            boxes: vec![
                Some(PixelBox {
                    cx_px,
                    cy_px: 7.0,
                    width_px,
                    height_px: 2.0,
                }),
                None,
            ],
            shifts: vec![None; 2],
        }
    }

    fn fitted(samples: &[Sample]) -> Normalisation {
        let views = ["left".to_owned(), "right".to_owned()];
        Normalisation::fit(&views, &samples.iter().collect::<Vec<_>>())
    }

    #[test]
    fn a_box_where_no_aircraft_was_or_of_a_size_that_none_had_is_not_believed() {
        let normalisation = fitted(&[sample(100.0, 10.0), sample(300.0, 30.0)]);
        let believed = |cx_px, width_px| {
            normalisation
                .without_outliers(&sample(cx_px, width_px), false)
                .detections()
                == 1
        };
        assert!(believed(100.0, 10.0) && believed(300.0, 30.0) && believed(340.0, 50.0));
        assert!(!believed(400.0, 20.0) && !believed(20.0, 20.0), "far off");
        assert!(
            !believed(200.0, 3.0) && !believed(200.0, 90.0),
            "another size"
        );
        let mut blind = sample(200.0, 20.0);
        blind.boxes.swap(0, 1);
        assert_eq!(
            normalisation.without_outliers(&blind, false).detections(),
            0,
            "a view that never saw"
        );
    }

    #[test]
    fn a_run_without_ranges_believes_every_box() {
        let old = Normalisation {
            range_px: None,
            ..fitted(&[sample(100.0, 10.0)])
        };
        let mut written = serde_json::to_value(&old).unwrap();
        written.as_object_mut().unwrap().remove("range_px");
        let read: Normalisation = serde_json::from_value(written).unwrap();
        assert_eq!(
            read.without_outliers(&sample(900.0, 1.0), false)
                .detections(),
            1
        );
    }

    #[test]
    fn training_features_have_mean_zero_and_deviation_one() {
        let samples = [sample(100.0, 10.0), sample(300.0, 30.0)];
        let normalisation = fitted(&samples);
        assert_eq!(
            normalisation.features(0, &samples[0].boxes[0].unwrap()),
            [-1.0, 0.0, -1.0, 0.0]
        );
        assert_eq!(
            normalisation.features(0, &samples[1].boxes[0].unwrap()),
            [1.0, 0.0, 1.0, 0.0]
        );
        assert_eq!(normalisation.scale_px[1], [1.0; 4], "a blind view");
    }
}
