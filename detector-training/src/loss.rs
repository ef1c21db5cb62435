//! The loss of an output map.
//!
//! Input: the network's output rows and the targets. Output: one number. Objectness: CenterNet's penalty-reduced focal loss (Zhou
//! et al., 2019, after Lin et al., 2017). Box: smooth L1 in units of the error that matters (see `targets`), so that a tenth of a
//! pixel on a distant aircraft weighs more than on a near one.

use burn::tensor::{Device, Tensor, TensorData, activation};

use super::grid::targets::Targets;
use super::network::convolution::FeatureMap;

/// Loss parts, tensors with one element each.
#[derive(Debug, Clone)]
pub struct Loss {
    /// Focal loss of the peaks, a visible aircraft.
    pub objectness: Tensor<1>,
    /// Smooth L1 of the box numbers, in units of the error that matters.
    pub boxes: Tensor<1>,
}

impl Loss {
    /// Total loss, which training minimises.
    pub fn total(&self) -> Tensor<1> {
        self.objectness.clone() + self.boxes.clone()
    }
}

/// An output map's loss, divided by `positives` (the number of aircraft in the whole batch, which may be larger).
pub fn loss(output: &FeatureMap, targets: &Targets, positives: usize, device: &Device) -> Loss {
    let cells = targets.heat.len();
    let column = |values: &[f32], wide: usize| -> Tensor<2> {
        Tensor::from_data(TensorData::new(values.to_vec(), [cells, wide]), device)
    };
    let heat = column(&targets.heat, 1);
    let heat_weight = column(&targets.heat_weight, 1);
    let logit = output.rows.clone().narrow(1, 0, 1);
    let numbers = output.rows.clone().narrow(1, 1, 4);

    let chance = activation::sigmoid(logit.clone());
    let missed = softplus(logit.clone().neg()); // -log(p)
    let raised = softplus(logit); // -log(1 - p)
    let peak = heat.clone().equal_elem(1.0).float();
    let hit_loss = peak.clone() * chance.clone().neg().add_scalar(1.0).powi_scalar(2) * missed;
    let reduced = heat.neg().add_scalar(1.0).powi_scalar(4);
    let miss_loss = reduced * chance.powi_scalar(2) * raised;
    let objectness = ((hit_loss + miss_loss) * heat_weight).sum();

    let error = (numbers - column(&targets.numbers, 4)) * column(&targets.number_weight, 4);
    // sqrt(1 + e^2) - 1: quadratic below one unit, linear above.
    let boxes = error
        .powi_scalar(2)
        .add_scalar(1.0)
        .sqrt()
        .sub_scalar(1.0)
        .sum();
    let share = 1.0 / positives.max(1) as f32;
    Loss {
        objectness: objectness.mul_scalar(share),
        boxes: boxes.mul_scalar(share * 0.25),
    }
}

/// log(1 + e^x) without overflow.
fn softplus(x: Tensor<2>) -> Tensor<2> {
    activation::relu(x.clone()) + x.abs().neg().exp().add_scalar(1.0).log()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::CELL_VALUES;
    use crate::grid::targets::CropTruth;
    use dataset::tables::pixel_box::PixelBox;

    fn loss_of(shift_cells: f32, logit: f32) -> (f32, f32) {
        let device = Device::flex();
        let mut targets = Targets::new(1, 64, 64);
        let pixel_box = PixelBox {
            cx_px: 30.0,
            cy_px: 31.0,
            width_px: 25.0,
            height_px: 9.0,
        };
        targets.add(
            0,
            &CropTruth {
                pixel_box,
                visible: true,
            },
        );
        let rows: Vec<f32> = (0..64)
            .flat_map(|cell| {
                let n = &targets.numbers[4 * cell..][..4];
                let logit = if targets.heat[cell] == 1.0 {
                    logit
                } else {
                    -12.0
                };
                [logit, n[0] + shift_cells, n[1], n[2], n[3]]
            })
            .collect();
        let rows = Tensor::from_data(TensorData::new(rows, [64, CELL_VALUES]), &device);
        let map = FeatureMap {
            rows,
            batch: 1,
            height: 8,
            width: 8,
        };
        let loss = loss(&map, &targets, targets.positives, &device);
        (loss.objectness.into_scalar(), loss.boxes.into_scalar())
    }

    #[test]
    fn the_truth_itself_costs_nothing() {
        let (objectness, boxes) = loss_of(0.0, 12.0);
        assert!(objectness < 1e-3 && boxes < 1e-6, "{objectness} {boxes}");
    }

    #[test]
    fn a_missed_peak_and_a_shifted_box_each_cost_in_their_own_part() {
        let (missed, _) = loss_of(0.0, -12.0);
        let (objectness, shifted) = loss_of(0.1, 12.0);
        assert!(
            missed > 10.0 && objectness < 1e-3 && shifted > 0.1,
            "{missed} {objectness} {shifted}"
        );
        assert!(loss_of(0.2, 12.0).1 > 1.5 * shifted);
    }
}
