//! Convolutions over feature maps stored as rows (one row of channels per cell), for training on a CPU.
//!
//! Input: a map `[batch * height * width, channels]`, batch-major, then row-major. Output: the same layout. A 3x3 convolution
//! gathers the nine neighbouring rows with one `select` and multiplies once. This trains several times faster than the flex
//! backend's own `conv2d`, whose weight gradient is a convolution with a kernel as large as the image; the arithmetic is the
//! same.

use std::collections::HashMap;

use burn::module::{Module, Param};
use burn::tensor::{Device, Int, Tensor, TensorData, activation};
use rand::{Rng, RngExt};

/// Feature vectors on a grid.
#[derive(Clone, Debug)]
pub struct FeatureMap {
    /// `[batch * height * width, channels]`.
    pub rows: Tensor<2>,
    /// Number of images.
    pub batch: usize,
    /// Rows of cells.
    pub height: usize,
    /// Cells in a row.
    pub width: usize,
}

impl FeatureMap {
    fn with_rows(&self, rows: Tensor<2>) -> Self {
        Self { rows, ..*self }
    }

    /// Rectifies.
    pub(crate) fn relu(&self) -> Self {
        self.with_rows(activation::relu(self.rows.clone()))
    }

    /// Divides every cell by its channels' mean (all are >= 0) plus `floor`. The next layers then see a target's shape and not its
    /// contrast, which varies by a factor of fifty in fog.
    pub(crate) fn divide_by_mean(&self, floor: f32) -> Self {
        self.with_rows(self.rows.clone() / self.raised_mean(floor))
    }

    /// Contrast strength that [`FeatureMap::divide_by_mean`] divides out: logarithm of the mean of the channels over the floor (0 in flat
    /// areas). A ratio of contrasts thereby becomes a difference, which a convolution can use.
    pub(crate) fn strength(&self, floor: f32) -> Self {
        self.with_rows(self.raised_mean(floor).div_scalar(floor).log())
    }

    fn raised_mean(&self, floor: f32) -> Tensor<2> {
        self.rows.clone().mean_dim(1).add_scalar(floor)
    }

    /// The sum of two maps of the same size and channels.
    pub(crate) fn plus(&self, other: &Self) -> Self {
        self.with_rows(self.rows.clone() + other.rows.clone())
    }

    /// Upsamples by repeating cells, then adds a map of that size.
    pub(crate) fn upsample_onto(&self, finer: &Self, tables: &mut GatherTables) -> Self {
        let table = tables.upsample(self);
        finer.with_rows(self.rows.clone().select(0, table) + finer.rows.clone())
    }
}

/// Index tables of the gathers, made once per map size.
#[derive(Debug)]
pub struct GatherTables {
    device: Device,
    tables: HashMap<(usize, usize, usize, usize), Tensor<1, Int>>,
}

impl GatherTables {
    /// No tables yet.
    pub fn new(device: &Device) -> Self {
        Self {
            device: device.clone(),
            tables: HashMap::new(),
        }
    }

    /// Rows of the nine inputs for each output cell of a padded 3x3 convolution; cells outside are row `batch * height * width`, which the
    /// caller appends as zeros.
    fn neighbours(&mut self, map: &FeatureMap, stride: usize) -> Tensor<1, Int> {
        let &FeatureMap {
            batch,
            height,
            width,
            ..
        } = map;
        self.table((batch, height, width, stride), || {
            let mut indices = Vec::with_capacity(batch * (height / stride) * (width / stride) * 9);
            for b in 0..batch {
                for y in (0..height).step_by(stride) {
                    for x in (0..width).step_by(stride) {
                        for (dy, dx) in (0..9).map(|k| (k / 3, k % 3)) {
                            // One more than the coordinate, so that it cannot become negative.
                            let (ny, nx) = (y + dy, x + dx);
                            let inside = (1..=height).contains(&ny) && (1..=width).contains(&nx);
                            let row = (b * height + ny.wrapping_sub(1)) * width;
                            indices.push(if inside {
                                row + nx - 1
                            } else {
                                batch * height * width
                            } as i64);
                        }
                    }
                }
            }
            indices
        })
    }

    fn upsample(&mut self, map: &FeatureMap) -> Tensor<1, Int> {
        let &FeatureMap {
            batch,
            height,
            width,
            ..
        } = map;
        // Stride 0 marks the table of an upsampling.
        self.table((batch, height, width, 0), || {
            let mut indices = Vec::with_capacity(4 * batch * height * width);
            for b in 0..batch {
                for y in 0..2 * height {
                    indices.extend(
                        (0..2 * width).map(|x| ((b * height + y / 2) * width + x / 2) as i64),
                    );
                }
            }
            indices
        })
    }

    fn table(
        &mut self,
        key: (usize, usize, usize, usize),
        make: impl FnOnce() -> Vec<i64>,
    ) -> Tensor<1, Int> {
        let device = &self.device;
        self.tables
            .entry(key)
            .or_insert_with(|| {
                let indices = make();
                let length = indices.len();
                Tensor::from_data(TensorData::new(indices, [length]), device)
            })
            .clone()
    }
}

/// A convolution with a kernel of 1x1 (stride 1) or 3x3 (padding 1, stride 1 or 2).
#[derive(Module, Debug)]
pub struct Convolution {
    /// `[kernel * kernel * channels_in, channels_out]`; rows ordered by kernel row, kernel column, channel.
    pub weight: Param<Tensor<2>>,
    /// `[channels_out]`.
    pub bias: Param<Tensor<1>>,
    /// Side of the kernel: 1 or 3.
    pub kernel: usize,
    /// Cells of the input for one of the output: 1 or 2.
    pub stride: usize,
}

impl Convolution {
    /// A convolution with normally distributed weights that keep the variance behind a rectifier (He et al., 2015).
    pub fn new(
        [channels_in, channels_out]: [usize; 2],
        kernel: usize,
        stride: usize,
        device: &Device,
        rng: &mut impl Rng,
    ) -> Self {
        let fan_in = kernel * kernel * channels_in;
        Self {
            weight: normal_weights(
                [fan_in, channels_out],
                (2.0 / fan_in as f32).sqrt(),
                device,
                rng,
            ),
            bias: Param::from_data(TensorData::zeros::<f32, _>([channels_out]), device),
            kernel,
            stride,
        }
    }

    /// A 3x3 convolution that gives 0 for everything.
    pub(crate) fn zeros([channels_in, channels_out]: [usize; 2], device: &Device) -> Self {
        let weight = TensorData::zeros::<f32, _>([9 * channels_in, channels_out]);
        let bias = TensorData::zeros::<f32, _>([channels_out]);
        Self {
            weight: Param::from_data(weight, device),
            bias: Param::from_data(bias, device),
            kernel: 3,
            stride: 1,
        }
    }

    /// The convolved map.
    pub fn forward(&self, map: &FeatureMap, tables: &mut GatherTables) -> FeatureMap {
        let [cells, channels] = map.rows.dims();
        let (rows, stride) = match self.kernel {
            1 => (map.rows.clone(), 1),
            _ => {
                let zeros = Tensor::zeros([1, channels], &map.rows.device());
                let padded = Tensor::cat(vec![map.rows.clone(), zeros], 0);
                let gathered = padded.select(0, tables.neighbours(map, self.stride));
                let cells_out = cells / (self.stride * self.stride);
                (gathered.reshape([cells_out, 9 * channels]), self.stride)
            }
        };
        let rows = rows.matmul(self.weight.val()) + self.bias.val().unsqueeze();
        FeatureMap {
            rows,
            batch: map.batch,
            height: map.height / stride,
            width: map.width / stride,
        }
    }
}

/// Normally distributed weights.
pub(crate) fn normal_weights(
    shape: [usize; 2],
    deviation: f32,
    device: &Device,
    rng: &mut impl Rng,
) -> Param<Tensor<2>> {
    let values: Vec<f32> = (0..shape[0] * shape[1])
        .map(|_| deviation * standard_normal(rng))
        .collect();
    Param::from_data(TensorData::new(values, shape), device)
}

/// A standard normal number (Box and Muller).
pub fn standard_normal(rng: &mut impl Rng) -> f32 {
    let radius = (-2.0 * (1.0 - rng.random::<f32>()).ln()).sqrt();
    radius * (std::f32::consts::TAU * rng.random::<f32>()).cos()
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::module::conv2d;
    use burn::tensor::ops::ConvOptions;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn gathering_and_multiplying_is_the_convolution_that_the_backend_computes() {
        let device = Device::flex();
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for stride in [1, 2] {
            let layer = Convolution::new([3, 5], 3, stride, &device, &mut rng);
            let (batch, height, width) = (2, 4, 6);
            let rows = normal_weights([batch * height * width, 3], 1.0, &device, &mut rng).val();
            let map = FeatureMap {
                rows: rows.clone(),
                batch,
                height,
                width,
            };
            let ours = layer.forward(&map, &mut GatherTables::new(&device));
            let picture = rows
                .reshape([batch, height, width, 3])
                .permute([0, 3, 1, 2]);
            let weight = layer
                .weight
                .val()
                .reshape([3, 3, 3, 5])
                .permute([3, 2, 0, 1]);
            let options = ConvOptions::new([stride, stride], [1, 1], [1, 1], 1);
            let theirs = conv2d(picture, weight, None, options).permute([0, 2, 3, 1]);
            let theirs = theirs.reshape([ours.batch * ours.height * ours.width, 5]);
            let difference: f32 = (ours.rows - theirs).abs().max().into_scalar();
            assert!(difference < 1e-5, "stride {stride}: {difference}");
        }
    }

    #[test]
    fn upsampling_repeats_every_cell_four_times() {
        let device = Device::flex();
        let map = FeatureMap {
            rows: Tensor::from_data([[1.0_f32], [2.0]], &device),
            batch: 1,
            height: 1,
            width: 2,
        };
        let finer = FeatureMap {
            rows: Tensor::zeros([8, 1], &device),
            batch: 1,
            height: 2,
            width: 4,
        };
        let up = map.upsample_onto(&finer, &mut GatherTables::new(&device));
        let values: Vec<f32> = up.rows.into_data().try_into_vec().unwrap();
        assert_eq!(values, [1.0, 1.0, 2.0, 2.0, 1.0, 1.0, 2.0, 2.0]);
    }

    #[test]
    fn dividing_by_the_mean_forgets_contrast_above_the_floor() {
        let device = Device::flex();
        let map = |scale: f32| FeatureMap {
            rows: Tensor::from_data([[scale, 3.0 * scale]], &device),
            batch: 1,
            height: 1,
            width: 1,
        };
        let values = |scale| -> Vec<f32> {
            map(scale)
                .divide_by_mean(0.01)
                .rows
                .into_data()
                .try_into_vec()
                .unwrap()
        };
        assert!((values(10.0)[1] - values(1.0)[1]).abs() < 0.02);
        assert!(values(1e-4)[1] < 0.05);
    }
}
