//! The detector's network: fully convolutional, one top-down path, one output map at stride 8.
//!
//! Input: RGB images whose sides are multiples of 32, values 0 to 1. Output: per cell of 8x8 px five numbers (objectness logit, offset of
//! the centre, logarithms of the size; see `grid`). The idea is CenterNet's (Zhou et al., 2019: a peak per object, the box regressed at the
//! peak) on a small pyramid. Two things are specific to this task: the first layer ignores constant colours, and divisive normalisation
//! removes the scale of contrast, since an aircraft in haze has the same shape at a fiftieth of the contrast. Normalisation alone would
//! amplify the texture of a cloud to the strength of the aircraft in front of it, so the strength that is divided out is a separate input
//! of the next layer.

pub mod convolution;
pub mod patches;

use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor, TensorData, activation};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::grid::{CELL_VALUES, STRIDE_PX};
use convolution::{Convolution, FeatureMap, GatherTables, normal_weights};
use patches::{PATCH_SIDE_PX, PATCH_VALUES, PatchBatch};

/// Divisive normalisation floor, in units of [`INPUT_GAIN`] times the image's range: near the noise of decoded video.
pub(crate) const NORMALISATION_FLOOR: f32 = 0.05;
/// Factor on pixel values ahead of the first layer: contrasts of interest are hundredths of the range.
pub(crate) const INPUT_GAIN: f32 = 8.0;

/// Channels of the stages at strides 4, 8, 16 and 32.
pub const CHANNELS: [usize; 4] = [32, 32, 48, 64];

/// Logit of a peak's prior probability, so that the first steps are not spent on learning that most cells are empty.
const PRIOR_LOGIT: f32 = -4.6;

/// The network.
#[derive(Module, Debug)]
pub struct Network {
    /// First layer `[patch values, channels]`, applied to disjoint patches; see [`Network::stem_weight`].
    pub stem: Param<Tensor<2>>,
    /// Bias of the first layer.
    pub stem_bias: Param<Tensor<1>>,
    /// Stride 4 to 8.
    pub down_8: Convolution,
    /// Stride 8, before the pyramid.
    pub at_8: Convolution,
    /// The strength that the normalisation at stride 8 divides out, added to `at_8`.
    pub strength_8: Convolution,
    /// Stride 8 to 16.
    pub down_16: Convolution,
    /// Stride 16.
    pub at_16: Convolution,
    /// Strength input for stride 16.
    pub strength_16: Convolution,
    /// Stride 16 to 32.
    pub down_32: Convolution,
    /// Stride 32: two layers, so that the widest aircraft fits into the receptive field.
    pub at_32: Vec<Convolution>,
    /// Strength input for stride 32, added to the first of `at_32`.
    pub strength_32: Convolution,
    /// Stride 32 onto stride 16.
    pub lateral_16: Convolution,
    /// Stride 16, after the sum.
    pub neck_16: Convolution,
    /// Stride 16 onto stride 8.
    pub lateral_8: Convolution,
    /// Stride 8, after the sum.
    pub neck_8: Convolution,
    /// The five numbers per cell.
    pub head: Convolution,
}

impl Network {
    /// A network with random weights; the same seed gives the same weights.
    pub fn new(device: &Device, seed: u64) -> Self {
        let rng = &mut ChaCha8Rng::seed_from_u64(seed);
        let [c4, c8, c16, c32] = CHANNELS;
        let mut head = Convolution::new([c8, CELL_VALUES], 1, 1, device, rng);
        let mut head_bias = vec![0.0_f32; CELL_VALUES];
        head_bias[0] = PRIOR_LOGIT;
        head.bias = Param::from_data(TensorData::new(head_bias, [CELL_VALUES]), device);
        head.weight = normal_weights([c8, CELL_VALUES], 0.01, device, rng);
        let strength = |channels| Convolution::zeros([1, channels], device);
        Self {
            stem: normal_weights(
                [PATCH_VALUES, c4],
                (2.0 / PATCH_VALUES as f32).sqrt(),
                device,
                rng,
            ),
            stem_bias: Param::from_data(TensorData::zeros::<f32, _>([c4]), device),
            down_8: Convolution::new([c4, c8], 3, 2, device, rng),
            at_8: Convolution::new([c8, c8], 3, 1, device, rng),
            strength_8: strength(c8),
            down_16: Convolution::new([c8, c16], 3, 2, device, rng),
            at_16: Convolution::new([c16, c16], 3, 1, device, rng),
            strength_16: strength(c16),
            down_32: Convolution::new([c16, c32], 3, 2, device, rng),
            at_32: (0..2)
                .map(|_| Convolution::new([c32, c32], 3, 1, device, rng))
                .collect(),
            strength_32: strength(c32),
            lateral_16: Convolution::new([c32, c16], 1, 1, device, rng),
            neck_16: Convolution::new([c16, c16], 3, 1, device, rng),
            lateral_8: Convolution::new([c16, c8], 1, 1, device, rng),
            neck_8: Convolution::new([c8, c8], 3, 1, device, rng),
            head,
        }
    }

    /// The first layer's weights as they act on pixel values 0 to 1: each colour's mean is subtracted, so that a constant colour yields 0,
    /// and the gain is multiplied in.
    pub(crate) fn stem_weight(&self) -> Tensor<2> {
        let [values, channels] = self.stem.val().dims();
        let weight = self.stem.val().reshape([values / 3, 3, channels]);
        let mean = weight.clone().mean_dim(0);
        (weight - mean)
            .reshape([values, channels])
            .mul_scalar(INPUT_GAIN)
    }

    /// The raw output map: rows of [`CELL_VALUES`] numbers, cells of [`STRIDE_PX`] px.
    pub fn forward(&self, pictures: &PatchBatch, tables: &mut GatherTables) -> FeatureMap {
        let device = self.stem.val().device();
        let (height, width) = (
            pictures.height_px / PATCH_SIDE_PX,
            pictures.width_px / PATCH_SIDE_PX,
        );
        let patches = TensorData::new(
            pictures.values.clone(),
            [pictures.batch * height * width, PATCH_VALUES],
        );
        let patches: Tensor<2> = Tensor::from_data(patches, &device);
        let stem =
            activation::relu(patches.matmul(self.stem_weight()) + self.stem_bias.val().unsqueeze());
        let map = FeatureMap {
            rows: stem,
            batch: pictures.batch,
            height,
            width,
        };

        let map = self.down_8.forward(&map, tables).relu();
        let fine = normalised(&self.at_8, &self.strength_8, &map, tables);
        let map = self.down_16.forward(&fine, tables).relu();
        let middle = normalised(&self.at_16, &self.strength_16, &map, tables);
        let map = self.down_32.forward(&middle, tables).relu();
        let mut coarse = normalised(&self.at_32[0], &self.strength_32, &map, tables);
        for layer in &self.at_32[1..] {
            coarse = layer.forward(&coarse, tables).relu();
        }

        let middle = self
            .lateral_16
            .forward(&coarse, tables)
            .relu()
            .upsample_onto(&middle, tables);
        let middle = self.neck_16.forward(&middle, tables).relu();
        let fine = self
            .lateral_8
            .forward(&middle, tables)
            .relu()
            .upsample_onto(&fine, tables);
        let fine = self.neck_8.forward(&fine, tables).relu();
        let output = self.head.forward(&fine, tables);
        debug_assert_eq!(output.height * STRIDE_PX, pictures.height_px);
        output
    }
}

/// A layer over a normalised map and the strength that the normalisation divides out.
fn normalised(
    layer: &Convolution,
    of_strength: &Convolution,
    map: &FeatureMap,
    tables: &mut GatherTables,
) -> FeatureMap {
    let shape = layer.forward(&map.divide_by_mean(NORMALISATION_FLOOR), tables);
    let strength = of_strength.forward(&map.strength(NORMALISATION_FLOOR), tables);
    shape.plus(&strength).relu()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::patches::PatchBatch;

    fn output_of(network: &Network, device: &Device, picture: &[f32]) -> Vec<f32> {
        let mut batch = PatchBatch::new(1, 64, 64);
        batch.fill(0, picture);
        network
            .forward(&batch, &mut GatherTables::new(device))
            .rows
            .into_data()
            .try_into_vec()
            .unwrap()
    }

    #[test]
    fn brightness_and_tint_of_the_background_change_nothing() {
        let device = Device::flex();
        let network = Network::new(&device, 3);
        let spot = |background: [f32; 3]| -> Vec<f32> {
            let lift = |i: usize| {
                if (20..30).contains(&(i % 64)) && (30..34).contains(&(i / 64)) {
                    0.1
                } else {
                    0.0
                }
            };
            (0..64 * 64)
                .flat_map(|i| background.map(|c| c + lift(i)))
                .collect()
        };
        let day = output_of(&network, &device, &spot([0.7, 0.8, 0.9]));
        let dusk = output_of(&network, &device, &spot([0.2, 0.1, 0.1]));
        let largest = day
            .iter()
            .zip(&dusk)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f32::max);
        assert!(largest < 1e-4, "{largest}");
    }

    #[test]
    fn the_map_has_one_cell_for_eight_pixels_and_no_more_parameters_than_a_megabyte_holds() {
        let device = Device::flex();
        let network = Network::new(&device, 3);
        assert_eq!(
            output_of(&network, &device, &vec![0.5; 64 * 64 * 3]).len(),
            8 * 8 * CELL_VALUES
        );
        assert!(
            network.num_params() * 4 < 1_000_000,
            "{}",
            network.num_params()
        );
    }
}
