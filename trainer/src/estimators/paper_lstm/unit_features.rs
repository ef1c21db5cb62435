//! Standardised features: mean 0 and deviation 1, as inputs of the LSTM.
//!
//! Trained with the shared head alone, features have deviations below a tenth, and from such small inputs an LSTM with PyTorch's initial
//! weights learns far more slowly. The last layers of the networks and the first layer of the head change against each other, so that stage
//! one predicts the same distances.

use burn::tensor::Device;

use crate::estimators::paper_lstm::calibration_training::CalibrationNetworks;
use crate::networks::encoded::{Encoded, numbers};

/// Samples per batch.
const CHUNK: usize = 2_048;
/// Minimum divisor relative to the largest deviation: features that vary less are noise.
const MIN_DEVIATION_SHARE: f64 = 1e-3;

/// Equivalent networks whose features have mean 0 and deviation 1 over all boxes in `samples`: in all views together, because the head is
/// shared. Networks and device must be without autodiff.
pub(crate) fn with_unit_features(
    networks: CalibrationNetworks,
    samples: &Encoded,
    device: &Device,
) -> CalibrationNetworks {
    let (mut count, mut sums) = (0.0, Vec::<[f64; 2]>::new());
    for view in 0..samples.views() {
        for batch in samples.seen_by(view).chunks(CHUNK) {
            let features = networks.features(view, samples.inputs(batch, view, device));
            let [rows, width] = features.dims();
            sums.resize(width, [0.0; 2]);
            count += rows as f64;
            for row in numbers(features).chunks_exact(width) {
                for ([sum, squares], feature) in sums.iter_mut().zip(row) {
                    let feature = f64::from(*feature);
                    *sum += feature;
                    *squares += feature * feature;
                }
            }
        }
    }
    let deviations: Vec<f64> = (sums.iter())
        .map(|[sum, squares]| (squares / count - (sum / count).powi(2)).max(0.0).sqrt())
        .collect();
    let least = MIN_DEVIATION_SHARE * deviations.iter().copied().fold(0.0, f64::max);
    if least <= 0.0 {
        return networks;
    }
    let means: Vec<f32> = (sums.iter()).map(|[sum, _]| (sum / count) as f32).collect();
    let deviations: Vec<f32> = (deviations.iter())
        .map(|deviation| deviation.max(least) as f32)
        .collect();
    networks.with_scaled_features(&means, &deviations)
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;

    use super::*;
    use crate::networks::encoded::boxes_of_two_views;

    #[test]
    fn features_have_mean_0_and_deviation_1_and_predictions_stay() {
        let samples = boxes_of_two_views();
        let device = Device::flex();
        let before = CalibrationNetworks::narrow(&device);
        let after = with_unit_features(before.clone(), &samples, &device);
        let mut columns = vec![Vec::new(); 7];
        for view in 0..2 {
            let boxes = samples.inputs(&samples.seen_by(view), view, &device);
            let predicted =
                |networks: &CalibrationNetworks| numbers(networks.predict(view, boxes.clone()));
            let pairs = predicted(&before).into_iter().zip(predicted(&after));
            pairs.for_each(|(before, after)| assert!((before - after).abs() < 1e-5));
            for row in numbers(after.features(view, boxes.clone())).chunks_exact(7) {
                (columns.iter_mut().zip(row)).for_each(|(column, feature)| column.push(*feature));
            }
        }
        for column in columns {
            let count = column.len() as f32;
            let mean = column.iter().sum::<f32>() / count;
            let square = column.iter().map(|feature| feature * feature).sum::<f32>() / count;
            assert!(
                mean.abs() < 1e-3 && (square - 1.0).abs() < 1e-2,
                "{mean} {square}"
            );
        }
    }
}
