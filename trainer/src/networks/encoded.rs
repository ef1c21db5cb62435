//! Samples as network inputs, and batches as tensors.

use burn::tensor::{Device, Tensor, TensorData};
use rand::RngExt;
use rand_chacha::ChaCha12Rng;

use crate::config::{TARGET_UNIT_M, Target};
use crate::networks::normalisation::{BOX_FEATURES, Normalisation};
use crate::samples::{Observation, Sample};

/// Training and validation side.
pub(crate) struct EncodedSides {
    pub(crate) training: Encoded,
    pub(crate) validation: Encoded,
}

/// Normalised features and true distances.
pub(crate) struct Encoded {
    views: usize,
    /// Sample-major, view-minor; zeros for an empty view.
    features: Vec<[f32; BOX_FEATURES]>,
    seen: Vec<bool>,
    /// True distances; empty for observations.
    distances: Vec<f32>,
}

impl Encoded {
    pub(crate) fn new<'a>(
        samples: impl IntoIterator<Item = &'a Sample>,
        normalisation: &Normalisation,
    ) -> Self {
        let mut encoded = Self::empty(normalisation);
        for sample in samples {
            encoded.push(sample, normalisation);
            encoded
                .distances
                .push((sample.dtd_m / TARGET_UNIT_M) as f32);
        }
        encoded
    }

    /// Encodes observations, without distances.
    pub(crate) fn of_observations(
        observations: &[Observation],
        normalisation: &Normalisation,
    ) -> Self {
        let mut encoded = Self::empty(normalisation);
        for observed in observations {
            encoded.push(observed, normalisation);
        }
        encoded
    }

    fn empty(normalisation: &Normalisation) -> Self {
        Self {
            views: normalisation.views.len(),
            features: Vec::new(),
            seen: Vec::new(),
            distances: Vec::new(),
        }
    }

    fn push(&mut self, observed: &Observation, normalisation: &Normalisation) {
        for view in 0..observed.views() {
            let best = observed.best(view);
            self.seen.push(best.is_some());
            self.features
                .push(best.map_or([0.0; BOX_FEATURES], |b| normalisation.features(view, b)));
        }
    }

    pub(crate) fn len(&self) -> usize {
        self.seen.len() / self.views
    }

    pub(crate) fn views(&self) -> usize {
        self.views
    }

    /// True if a view saw the aircraft.
    pub(crate) fn seen(&self, sample: usize, view: usize) -> bool {
        self.seen[sample * self.views + view]
    }

    /// Number of views that saw the aircraft.
    pub(crate) fn detections(&self, sample: usize) -> usize {
        (0..self.views)
            .filter(|&view| self.seen(sample, view))
            .count()
    }

    /// Distance to touchdown in units of 10 NM.
    pub(crate) fn distance(&self, sample: usize) -> f32 {
        self.distances[sample]
    }

    /// The samples that a view saw.
    pub(crate) fn seen_by(&self, view: usize) -> Vec<usize> {
        (0..self.len())
            .filter(|&sample| self.seen(sample, view))
            .collect()
    }

    /// Features per view, `[batch, 4]`.
    pub(crate) fn inputs(&self, batch: &[usize], view: usize, device: &Device) -> Tensor<2> {
        let rows: Vec<f32> = batch
            .iter()
            .flat_map(|&sample| self.features[sample * self.views + view])
            .collect();
        Tensor::from_data(TensorData::new(rows, [batch.len(), BOX_FEATURES]), device)
    }

    /// 1 where the view saw the aircraft and 0 elsewhere.
    pub(crate) fn mask(&self, batch: &[usize], view: usize) -> Vec<f32> {
        batch
            .iter()
            .map(|&sample| f32::from(u8::from(self.seen(sample, view))))
            .collect()
    }

    /// Network targets under `loss`, `[batch, 1]`.
    pub(crate) fn target_column(
        &self,
        batch: &[usize],
        loss: Target,
        device: &Device,
    ) -> Tensor<2> {
        column(
            batch
                .iter()
                .map(|&sample| loss.target(self.distances[sample]))
                .collect(),
            device,
        )
    }

    /// Sum of squared errors, weighted by `loss` and divided by `size`.
    pub(crate) fn squared_error(
        &self,
        predicted: Tensor<2>,
        batch: &[usize],
        size: f32,
        loss: Target,
        device: &Device,
    ) -> Tensor<1> {
        let weights = batch
            .iter()
            .map(|&sample| loss.weight(self.distances[sample]) / size)
            .collect();
        let apart = predicted - self.target_column(batch, loss, device);
        (apart.square() * column(weights, device)).sum()
    }

    /// Error of a single view's predictions, percent; `None` if the view never saw the aircraft. `predict` maps features to network
    /// outputs.
    pub(crate) fn view_error_pct(
        &self,
        view: usize,
        loss: Target,
        device: &Device,
        predict: impl FnOnce(Tensor<2>) -> Tensor<2>,
    ) -> Option<f64> {
        let seen = self.seen_by(view);
        if seen.is_empty() {
            return None;
        }
        let predicted = numbers(predict(self.inputs(&seen, view, device)));
        let pairs = predicted.into_iter().zip(seen);
        mape_pct(pairs.map(|(p, sample)| (loss.distance(p), self.distance(sample))))
    }
}

/// Tensor `[count, 1]`.
pub(crate) fn column(values: Vec<f32>, device: &Device) -> Tensor<2> {
    let count = values.len();
    Tensor::from_data(TensorData::new(values, [count, 1]), device)
}

/// Tensor elements, row by row.
pub(crate) fn numbers(tensor: Tensor<2>) -> Vec<f32> {
    tensor
        .into_data()
        .try_into_vec()
        .expect("networks compute in f32")
}

/// Draws a batch with replacement from `from`, which must not be empty.
pub(crate) fn draw(from: &[usize], size: usize, random: &mut ChaCha12Rng) -> Vec<usize> {
    (0..size)
        .map(|_| from[random.random_range(0..from.len())])
        .collect()
}

/// Mean absolute percentage error over pairs of prediction and truth; `None` without pairs.
pub(crate) fn mape_pct(pairs: impl Iterator<Item = (f32, f32)>) -> Option<f64> {
    let errors: Vec<f64> = pairs
        .map(|(predicted, truth)| f64::from((predicted - truth).abs() / truth))
        .collect();
    (!errors.is_empty()).then(|| errors.iter().sum::<f64>() / errors.len() as f64 * 100.0)
}

/// Boxes in two views; 30 % are missing.
#[cfg(test)]
pub(crate) fn boxes_of_two_views() -> Encoded {
    use testkit::synthetic::SyntheticCorpus;

    use crate::samples::Samples;

    let samples = Samples::synthetic(
        &SyntheticCorpus {
            miss_ratio: 0.3,
            ..SyntheticCorpus::tiny()
        },
        0.0,
    );
    let all: Vec<_> = samples.samples.iter().collect();
    let normalisation = Normalisation::fit(&samples.views, &all, &all);
    Encoded::new(all, &normalisation)
}
