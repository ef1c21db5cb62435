//! Loss gradients by autodiff, with batches divided among the cores by rows.
//!
//! The division depends on the batch alone, so that the same seed gives the same weights on any number of cores.

use std::ops::Range;

use burn::module::Module;
use burn::optim::{GradientsAccumulator, GradientsParams};
use burn::tensor::{Device, Tensor};
use rayon::prelude::*;

/// Maximum rows per part: its intermediate results stay in a core's cache.
const MAX_ROWS: usize = 256;
/// Minimum number of parts per batch, for two cores.
const MIN_PARTS: usize = 2;

/// Batch loss, the sum over the parts.
pub(crate) struct BatchLoss<P> {
    pub(crate) value: f32,
    pub(crate) gradients: GradientsParams,
    /// Predictions by part.
    pub(crate) predictions: Vec<P>,
}

/// Loss and gradients of `network` for a batch of `rows`; `part` returns loss and predictions for some rows. On a GPU all rows form a
/// single part.
pub(crate) fn loss_of_parts<N: Module, P: Send>(
    network: &N,
    rows: usize,
    device: &Device,
    part: impl Fn(&N, Range<usize>) -> (Tensor<1>, P) + Sync,
) -> BatchLoss<P> {
    let work = |(network, rows): (N, Range<usize>)| {
        let (loss, predictions) = part(&network, rows);
        let value: f32 = loss.clone().into_scalar();
        let gradients = GradientsParams::from_grads(loss.backward(), &network);
        (value, gradients, predictions)
    };
    let parts: Vec<_> = if *device == Device::flex() {
        // A copy of the weights for each part: autodiff locks everything that depends on the same tensors.
        let parts = row_parts(rows).into_iter();
        let parts: Vec<_> = parts
            .map(|rows| (network.clone().fork(device), rows))
            .collect();
        parts.into_par_iter().map(work).collect()
    } else {
        vec![work((network.clone(), 0..rows))]
    };
    let mut sum = GradientsAccumulator::new();
    let mut loss = BatchLoss {
        value: 0.0,
        gradients: GradientsParams::new(),
        predictions: Vec::with_capacity(parts.len()),
    };
    // In the order of the rows: sums of floats depend on it.
    for (value, gradients, predictions) in parts {
        sum.accumulate(network, gradients);
        loss.value += value;
        loss.predictions.push(predictions);
    }
    loss.gradients = sum.grads();
    loss
}

/// Two parts, or more above 512 rows.
fn row_parts(rows: usize) -> Vec<Range<usize>> {
    let parts = rows.div_ceil(MAX_ROWS).max(MIN_PARTS).min(rows);
    (0..parts)
        .map(|part| rows * part / parts..rows * (part + 1) / parts)
        .collect()
}
