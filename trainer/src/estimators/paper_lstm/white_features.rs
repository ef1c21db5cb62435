//! Whitened features: uncorrelated, with mean 0 and deviation 1, as inputs of the LSTM.
//!
//! Trained with the shared head alone, features mostly repeat the distance that their view predicts. Differences between the views, and so
//! the distance by both together, are small beside it, and an LSTM finds them late. The last layers of the networks and the first layer of
//! the head change against each other, so that stage one predicts the same distances.

use burn::tensor::{Device, Tensor};
use dataset::numbers::least_squares::CholeskyFactor;

use crate::estimators::paper_lstm::calibration_training::CalibrationNetworks;
use crate::networks::encoded::{Encoded, numbers};

/// Samples per batch.
const CHUNK: usize = 2_048;
/// Share of the features' total variance that is added to the variance of each, so that noise is not whitened.
const NOISE_SHARE: f64 = 1e-3;

/// Equivalent networks whose features are white over all boxes in `samples`: in all views together, because the head is shared. Networks
/// and device must be without autodiff.
pub(crate) fn with_white_features(
    networks: CalibrationNetworks,
    samples: &Encoded,
    device: &Device,
) -> CalibrationNetworks {
    let doubles = |tensor| -> Vec<f64> { numbers(tensor).into_iter().map(f64::from).collect() };
    // Sums over the features less a first batch's mean: they are small, so that single precision suffices within a batch.
    let mut origin: Option<Tensor<2>> = None;
    let (mut count, mut sums, mut products) = (0.0, Vec::new(), Vec::new());
    for view in 0..samples.views() {
        for batch in samples.seen_by(view).chunks(CHUNK) {
            let features = networks.features(view, samples.inputs(batch, view, device));
            let origin = origin.get_or_insert_with(|| features.clone().mean_dim(0));
            let moved = features - origin.clone();
            count += batch.len() as f64;
            add(&mut sums, &doubles(moved.clone().sum_dim(0)));
            add(
                &mut products,
                &doubles(moved.clone().transpose().matmul(moved)),
            );
        }
    }
    let Some(origin) = origin else {
        return networks;
    };
    let width = sums.len();
    let mut means: Vec<f64> = sums.iter().map(|sum| sum / count).collect();
    let mut covariance: Vec<f64> = (products.iter().enumerate())
        .map(|(at, product)| product / count - means[at / width] * means[at % width])
        .collect();
    add(&mut means, &doubles(origin));
    let total: f64 = covariance.iter().step_by(width + 1).sum();
    for variance in covariance.iter_mut().step_by(width + 1) {
        *variance += NOISE_SHARE * total;
    }
    match CholeskyFactor::of(covariance, width) {
        Some(factor) => networks.with_white_features(&means, &factor),
        None => networks,
    }
}

/// Adds to sums, which are empty at first.
fn add(sums: &mut Vec<f64>, terms: &[f64]) {
    sums.resize(terms.len(), 0.0);
    sums.iter_mut()
        .zip(terms)
        .for_each(|(sum, term)| *sum += term);
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;

    use super::*;
    use crate::networks::encoded::boxes_of_two_views;

    #[test]
    fn features_have_no_mean_and_are_uncorrelated_and_predictions_stay() {
        let samples = boxes_of_two_views();
        let device = Device::flex();
        let before = CalibrationNetworks::narrow(&device);
        let after = with_white_features(before.clone(), &samples, &device);
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
        let mean = |a: &[f32]| a.iter().sum::<f32>() / a.len() as f32;
        for (at, column) in columns.iter().enumerate() {
            assert!(mean(column).abs() < 1e-3);
            for (other_at, other) in columns.iter().enumerate() {
                let products: Vec<_> = column.iter().zip(other).map(|(a, b)| a * b).collect();
                let covariance = mean(&products);
                let expected = if at == other_at { 0.5..1.01 } else { -0.3..0.3 };
                assert!(
                    expected.contains(&covariance),
                    "{at} {other_at} {covariance}"
                );
            }
        }
    }
}
