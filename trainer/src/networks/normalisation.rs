//! Box features as network inputs: centre and size, shifted and scaled per camera.
//!
//! Offsets and scales are the mean and standard deviation over the samples that the networks learn from, without any information from
//! validation or test. Distances are in units of 10 NM.
//!
//! The training side also determines outliers: boxes far from its ground-truth boxes, or with a very different size. Estimators can ignore
//! such boxes without ground truth.

use dataset::geometry::camera::Camera;
use dataset::numbers::spread::mean_and_deviation;
use dataset::tables::pixel_box::PixelBox;
use glam::DVec2;
use serde::{Deserialize, Serialize};

use crate::samples::{Observation, Sample};

/// Number of box features: centre x, centre y, width, height.
pub(crate) const BOX_FEATURES: usize = 4;

/// Offset and scale of each camera's features.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Normalisation {
    pub views: Vec<String>,
    /// Per view, of centre x, centre y, width, height; pixels.
    pub offset_px: Vec<[f64; BOX_FEATURES]>,
    /// Per view, of centre x, centre y, width, height; pixels.
    pub scale_px: Vec<[f64; BOX_FEATURES]>,
    /// Range of centre x, centre y, width, height per view; pixels. A view without boxes has no range and rejects every box.
    pub range_px: Vec<Option<[[f64; 2]; BOX_FEATURES]>>,
}

/// Typical distance, metres.
const TYPICAL_DISTANCE_M: f64 = 10_000.0;
/// Maximum distance between box centre and training range, in parts of the range's extent.
const MAX_PLACE_EXCESS: f64 = 0.25;
/// Maximum ratio between a box size and the training range.
const MAX_SIZE_RATIO: f64 = 2.0;

impl Normalisation {
    /// Fits offsets and scales to the networks' training samples, and ranges to the ground-truth boxes. A view without boxes gets offset 0
    /// and scale 1.
    pub(crate) fn fit(views: &[String], learned: &[&Sample], true_boxes: &[&Sample]) -> Self {
        let statistics = |view: usize| {
            let rows: Vec<_> = learned
                .iter()
                .filter_map(|s| s.best(view).map(features_px))
                .collect();
            let mut offset = [0.0; BOX_FEATURES];
            let mut scale = [1.0; BOX_FEATURES];
            for feature in 0..BOX_FEATURES {
                let [mean, deviation] = mean_and_deviation(rows.iter().map(|row| row[feature]));
                offset[feature] = mean;
                if deviation > 0.0 {
                    scale[feature] = deviation;
                }
            }
            (offset, scale)
        };
        let range = |view: usize| {
            let mut seen = true_boxes.iter().filter_map(|s| s.best(view));
            let first = features_px(seen.next()?).map(|value| [value; 2]);
            Some(seen.fold(first, |range, pixel_box| {
                let features = features_px(pixel_box);
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
            range_px: (0..views.len()).map(range).collect(),
        }
    }

    /// Features as parts of the image; `sizes_px` has width and height per view.
    pub(crate) fn in_parts_of_pictures(mut self, sizes_px: &[[f64; 2]]) -> Self {
        for (view, &[width, height]) in sizes_px.iter().enumerate() {
            self.offset_px[view] = [0.0; BOX_FEATURES];
            self.scale_px[view] = [width, height, width, height];
        }
        self
    }

    /// Removes boxes that differ from all training boxes: in size, and also in position unless the cameras differ from the training's
    /// (`other_cameras`).
    pub(crate) fn without_outliers(
        &self,
        observed: &Observation,
        other_cameras: bool,
    ) -> Observation {
        let believed = |view: usize, seen: &PixelBox| {
            let ranges = self.believed_px(view).into_iter().enumerate();
            ranges
                .zip(features_px(seen))
                .all(|((feature, [least, most]), value)| {
                    let is_place = feature < 2;
                    (is_place && other_cameras && least <= most) || (least..=most).contains(&value)
                })
        };
        observed.with_boxes_that(believed)
    }

    /// Accepted range of centre x, centre y, width and height, pixels. In a view that never saw the aircraft, the lower bound is above the
    /// upper.
    pub(crate) fn believed_px(&self, view: usize) -> [[f64; 2]; BOX_FEATURES] {
        let Some(range) = self.range_px[view] else {
            return [[f64::INFINITY, f64::NEG_INFINITY]; BOX_FEATURES];
        };
        std::array::from_fn(|feature| {
            let [smallest, largest] = range[feature];
            let is_place = feature < 2;
            if is_place {
                let margin = MAX_PLACE_EXCESS * (largest - smallest);
                [smallest - margin, largest + margin]
            } else {
                [smallest / MAX_SIZE_RATIO, largest * MAX_SIZE_RATIO]
            }
        })
    }

    /// Replaces a view's camera `old` by `new`: a box in the new image gets the features that the old camera would have given it, apart
    /// from perspective. `None` if the new camera looks elsewhere.
    pub(crate) fn moved(&self, view: usize, old: &Camera, new: &Camera) -> Option<Self> {
        let place = |px: [f64; 2]| {
            let far_m = old.center_ecef_m + old.ray(DVec2::from_array(px)) * TYPICAL_DISTANCE_M;
            new.project(far_m).map(|place| place.to_array())
        };
        let zoom = new.focal_px / old.focal_px;
        let [x, y, width, height] = self.offset_px[view];
        let [new_x, new_y] = place([x, y])?;
        let mut moved = self.clone();
        moved.offset_px[view] = [new_x, new_y, zoom * width, zoom * height];
        moved.scale_px[view] = self.scale_px[view].map(|scale| zoom * scale);
        if let Some(range) = &mut moved.range_px[view] {
            let [[left, right], [top, bottom], width, height] = *range;
            let corners = [[left, top], [left, bottom], [right, top], [right, bottom]];
            let corners: Vec<[f64; 2]> = corners.into_iter().map(place).collect::<Option<_>>()?;
            let [horizontal, vertical] = [0, 1].map(|axis| {
                let values = || corners.iter().map(|corner| corner[axis]);
                [
                    values().fold(f64::INFINITY, f64::min),
                    values().fold(f64::NEG_INFINITY, f64::max),
                ]
            });
            *range = [
                horizontal,
                vertical,
                width.map(|px| zoom * px),
                height.map(|px| zoom * px),
            ];
        }
        Some(moved)
    }

    /// Takes a view's numbers from `other`.
    pub(crate) fn with_view_of(&self, view: usize, other: &Self) -> Self {
        let mut changed = self.clone();
        changed.offset_px[view] = other.offset_px[view];
        changed.scale_px[view] = other.scale_px[view];
        changed.range_px[view] = other.range_px[view];
        changed
    }

    /// Box features.
    pub(crate) fn features(&self, view: usize, pixel_box: &PixelBox) -> [f32; BOX_FEATURES] {
        let raw = features_px(pixel_box);
        std::array::from_fn(|i| {
            ((raw[i] - self.offset_px[view][i]) / self.scale_px[view][i]) as f32
        })
    }
}

fn features_px(b: &PixelBox) -> [f64; BOX_FEATURES] {
    [b.cx_px, b.cy_px, b.width_px, b.height_px]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(cx_px: f64, width_px: f64) -> Sample {
        let seen = PixelBox {
            cx_px,
            cy_px: 7.0,
            width_px,
            height_px: 2.0,
        };
        Sample::of_boxes(1.0, vec![Some(seen), None])
    }

    fn fitted(samples: &[Sample]) -> Normalisation {
        let views = ["left".to_owned(), "right".to_owned()];
        let all: Vec<_> = samples.iter().collect();
        Normalisation::fit(&views, &all, &all)
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
        blind.observed.candidates.swap(0, 1);
        assert_eq!(
            normalisation.without_outliers(&blind, false).detections(),
            0,
            "a view that never saw"
        );
    }

    #[test]
    fn training_features_have_mean_zero_and_deviation_one() {
        let samples = [sample(100.0, 10.0), sample(300.0, 30.0)];
        let normalisation = fitted(&samples);
        assert_eq!(
            normalisation.features(0, samples[0].best(0).unwrap()),
            [-1.0, 0.0, -1.0, 0.0]
        );
        assert_eq!(
            normalisation.features(0, samples[1].best(0).unwrap()),
            [1.0, 0.0, 1.0, 0.0]
        );
        assert_eq!(normalisation.scale_px[1], [1.0; 4], "a blind view");
        let of_picture = normalisation.in_parts_of_pictures(&[[200.0, 100.0]; 2]);
        assert_eq!(
            of_picture.features(0, samples[0].best(0).unwrap()),
            [0.5, 0.07, 0.05, 0.02]
        );
    }

    #[test]
    fn a_moved_camera_gives_the_features_that_the_old_one_gave() {
        let mut placed = testkit::rig::placed("left");
        let old = Camera::from_pose(&placed, 1920, 1280);
        placed.pose.heading_true_deg += 2.0;
        placed.hfov_deg /= 1.1;
        let new = Camera::from_pose(&placed, 1920, 1280);
        let normalisation = Normalisation {
            views: vec!["left".into()],
            offset_px: vec![[1_400.0, 600.0, 60.0, 20.0]],
            scale_px: vec![[250.0, 40.0, 30.0, 10.0]],
            range_px: vec![Some([
                [900.0, 1_850.0],
                [400.0, 700.0],
                [30.0, 300.0],
                [9.0, 90.0],
            ])],
        };
        let moved = normalisation.moved(0, &old, &new).unwrap();
        for (x_px, y_px) in [(1_750.0, 560.0), (1_400.0, 600.0), (1_000.0, 650.0)] {
            let at_m = old.center_ecef_m + old.ray(DVec2::new(x_px, y_px)) * 9_000.0;
            let seen = |camera: &Camera, zoom: f64| {
                let place = camera.project(at_m).unwrap();
                PixelBox {
                    cx_px: place.x,
                    cy_px: place.y,
                    width_px: 50.0 * zoom,
                    height_px: 15.0 * zoom,
                }
            };
            let zoom = new.focal_px / old.focal_px;
            let before = normalisation.features(0, &seen(&old, 1.0));
            let after = moved.features(0, &seen(&new, zoom));
            for (before, after) in before.iter().zip(after) {
                assert!((before - after).abs() < 0.03, "{before} {after}");
            }
            let believed = |seen: PixelBox| {
                let sample = Sample::of_boxes(9_000.0, vec![Some(seen)]);
                moved.without_outliers(&sample, false).detections()
            };
            assert_eq!(believed(seen(&new, zoom)), 1);
            assert_eq!(believed(seen(&new, 20.0 * zoom)), 0);
        }
        let mut back = placed;
        back.pose.heading_true_deg += 180.0;
        let back = Camera::from_pose(&back, 1920, 1280);
        assert_eq!(normalisation.moved(0, &old, &back), None);
    }
}
