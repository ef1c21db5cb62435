//! Box features as the networks see them: centre and size, shifted and scaled per camera.
//!
//! Offsets and scales are mean and standard deviation over the training side only, so that nothing of validation or test leaks in.
//! Distances are in units of 10 NM.

use dataset::pixel_box::PixelBox;
use dataset::units::METERS_PER_NAUTICAL_MILE;
use serde::{Deserialize, Serialize};

use crate::samples::Sample;

/// Distance that the networks call 1, metres.
pub const TARGET_UNIT_M: f64 = 10.0 * METERS_PER_NAUTICAL_MILE;
/// Number of features of a box: centre x, centre y, width, height.
pub const BOX_FEATURES: usize = 4;

/// Offset and scale of each camera's features.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Normalisation {
    /// Identifiers of the views.
    pub views: Vec<String>,
    /// Per view, of centre x, centre y, width, height; pixels.
    pub offset_px: Vec<[f64; BOX_FEATURES]>,
    /// Per view, of centre x, centre y, width, height; pixels.
    pub scale_px: Vec<[f64; BOX_FEATURES]>,
}

impl Normalisation {
    /// Fits offsets and scales. A view that never saw anything keeps offset 0 and scale 1.
    pub fn fit(views: &[String], training: &[&Sample]) -> Self {
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
        let (offset_px, scale_px) = (0..views.len()).map(statistics).unzip();
        Self {
            views: views.to_vec(),
            offset_px,
            scale_px,
        }
    }

    /// The features of a box in one view.
    pub fn features(&self, view: usize, pixel_box: &PixelBox) -> [f32; BOX_FEATURES] {
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
    use dataset::geodesy::Geodetic;

    #[test]
    fn training_features_have_mean_zero_and_deviation_one() {
        let sample = |cx_px: f64, width_px: f64| Sample {
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
        };
        let samples = [sample(100.0, 10.0), sample(300.0, 30.0)];
        let views = ["left".to_owned(), "right".to_owned()];
        let normalisation = Normalisation::fit(&views, &samples.iter().collect::<Vec<_>>());
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
