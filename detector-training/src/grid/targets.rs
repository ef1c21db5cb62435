//! The desired output of every cell of a crop.
//!
//! Input: the ground-truth box in a crop and whether it is visible. Output: per cell a heat (1 at the cell that contains the centre,
//! falling off around it), weights of both parts of the loss, and the box numbers. CenterNet's assignment (Zhou et al., 2019), with
//! the box regressed in the whole neighbourhood that decoding averages over.

use dataset::tables::pixel_box::PixelBox;

use crate::grid::{NEIGHBOURHOOD, STRIDE_PX, cell_center_px, cell_of_px, encode};

/// Fall-off of the heat around the centre, cells.
const HEAT_DEVIATION_CELLS: f64 = 0.8;
/// Error of the centre that counts as one unit of loss: a constant part and a part proportional to the width. The distance estimate
/// depends on the centre, and parallax is measured in pixels for distant (small) targets, where most of the error arises.
const UNIT_ERROR_PX: f64 = 0.25;
const UNIT_ERROR_PER_WIDTH: f64 = 0.01;
/// Weight of errors of the size relative to errors of the centre.
const SIZE_IMPORTANCE: f64 = 0.4;

/// The aircraft in a crop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CropTruth {
    /// The whole box, crop pixels; may extend over the crop's edges.
    pub pixel_box: PixelBox,
    /// True if the aircraft is visible to the eye. If not, its cells have no target: neither a hit nor a miss is wrong.
    pub visible: bool,
}

/// Targets for a batch of equally sized crops, cells in the order of the network's output rows.
#[derive(Debug, Clone)]
pub struct Targets {
    /// Cells per row.
    pub cells_across: usize,
    /// Rows per crop.
    pub cells_down: usize,
    /// Desired heat, 0 to 1.
    pub heat: Vec<f32>,
    /// Weight of the objectness.
    pub heat_weight: Vec<f32>,
    /// Desired box numbers, four a cell.
    pub numbers: Vec<f32>,
    /// Weights that convert errors into units of loss, four per cell; 0 without a target box.
    pub number_weight: Vec<f32>,
    /// Number of target boxes.
    pub positives: usize,
}

impl Targets {
    /// Targets of `batch` crops without any aircraft.
    pub fn new(batch: usize, height_px: usize, width_px: usize) -> Self {
        let (cells_across, cells_down) = (width_px / STRIDE_PX, height_px / STRIDE_PX);
        let cells = batch * cells_across * cells_down;
        Self {
            cells_across,
            cells_down,
            heat: vec![0.0; cells],
            heat_weight: vec![1.0; cells],
            numbers: vec![0.0; 4 * cells],
            number_weight: vec![0.0; 4 * cells],
            positives: 0,
        }
    }

    /// Puts an aircraft into crop `index`.
    pub fn add(&mut self, index: usize, truth: &CropTruth) {
        let pixel_box = &truth.pixel_box;
        let center = [cell_of_px(pixel_box.cx_px), cell_of_px(pixel_box.cy_px)];
        let inside = |cell: i64, count: usize| (0..count as i64).contains(&cell);
        let center_inside =
            inside(center[0], self.cells_across) && inside(center[1], self.cells_down);
        if !truth.visible || !center_inside {
            self.ask_nothing(index, pixel_box);
            return;
        }
        self.positives += 1;
        let inner = self.inner_part(pixel_box);
        let unit_px = UNIT_ERROR_PX + UNIT_ERROR_PER_WIDTH * pixel_box.width_px;
        let scales = [
            STRIDE_PX as f64,
            STRIDE_PX as f64,
            SIZE_IMPORTANCE * pixel_box.width_px,
            SIZE_IMPORTANCE * pixel_box.height_px,
        ];
        let reach = 2 * NEIGHBOURHOOD as i64;
        for row in center[1] - reach..=center[1] + reach {
            for column in center[0] - reach..=center[0] + reach {
                if !inside(column, self.cells_across) || !inside(row, self.cells_down) {
                    continue;
                }
                let (c, r) = (column as usize, row as usize);
                let offset = [
                    cell_center_px(c) - pixel_box.cx_px,
                    cell_center_px(r) - pixel_box.cy_px,
                ];
                let distance_cells = offset[0].hypot(offset[1]) / STRIDE_PX as f64;
                let heat = (-0.5 * (distance_cells / HEAT_DEVIATION_CELLS).powi(2)).exp();
                let cell = self.cell(index, c, r);
                self.heat[cell] = if [column, row] == center {
                    1.0
                } else {
                    heat as f32
                };
                let near =
                    (column - center[0]).abs().max((row - center[1]).abs()) <= NEIGHBOURHOOD as i64;
                if near {
                    let numbers = encode(pixel_box, c, r);
                    for i in 0..4 {
                        self.numbers[4 * cell + i] = numbers[i] as f32;
                        self.number_weight[4 * cell + i] =
                            (heat * inner * scales[i] / unit_px) as f32;
                    }
                }
            }
        }
    }

    /// Multiplies the weight of the box of crop `index`.
    pub(crate) fn weigh_boxes(&mut self, index: usize, factor: f32) {
        let values = 4 * self.cells_across * self.cells_down;
        for weight in &mut self.number_weight[index * values..][..values] {
            *weight *= factor;
        }
    }

    /// Part of the box inside the crop, squared: from a cut target the whole box can only be guessed.
    fn inner_part(&self, pixel_box: &PixelBox) -> f64 {
        let size = [self.cells_across, self.cells_down].map(|cells| (cells * STRIDE_PX) as u32);
        let inner = pixel_box
            .clipped_to(size[0], size[1])
            .map_or(0.0, |inner| inner.area());
        (inner / pixel_box.area()).powi(2)
    }

    fn ask_nothing(&mut self, index: usize, pixel_box: &PixelBox) {
        let [left, top, right, bottom] = pixel_box.edges();
        let margin = STRIDE_PX as f64;
        for row in 0..self.cells_down {
            for column in 0..self.cells_across {
                let (x, y) = (cell_center_px(column), cell_center_px(row));
                let near_x = (left - margin..=right + margin).contains(&x);
                if near_x && (top - margin..=bottom + margin).contains(&y) {
                    let cell = self.cell(index, column, row);
                    self.heat_weight[cell] = 0.0;
                }
            }
        }
    }

    fn cell(&self, index: usize, column: usize, row: usize) -> usize {
        (index * self.cells_down + row) * self.cells_across + column
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SEEN: CropTruth = CropTruth {
        pixel_box: PixelBox {
            cx_px: 61.3,
            cy_px: 42.7,
            width_px: 33.0,
            height_px: 11.5,
        },
        visible: true,
    };

    #[test]
    fn one_cell_holds_the_centre_and_nine_state_the_box() {
        let mut targets = Targets::new(2, 64, 128);
        targets.add(1, &SEEN);
        let ones: Vec<usize> = (0..targets.heat.len())
            .filter(|&i| targets.heat[i] == 1.0)
            .collect();
        assert_eq!(ones, [8 * 16 + 5 * 16 + 7]);
        assert_eq!(
            targets
                .number_weight
                .chunks(4)
                .filter(|w| w[0] > 0.0)
                .count(),
            9
        );
        assert!(
            targets.heat[..8 * 16].iter().all(|&heat| heat == 0.0),
            "the other crop stays empty"
        );
        assert_eq!(targets.positives, 1);
    }

    #[test]
    fn boxes_of_one_crop_are_weighed_without_those_of_its_neighbours() {
        let mut targets = Targets::new(2, 64, 128);
        targets.add(0, &SEEN);
        targets.add(1, &SEEN);
        let before = targets.number_weight.clone();
        targets.weigh_boxes(1, 0.25);
        let half = before.len() / 2;
        assert_eq!(targets.number_weight[..half], before[..half]);
        let weighed: Vec<f32> = before[half..].iter().map(|weight| 0.25 * weight).collect();
        assert_eq!(targets.number_weight[half..], weighed);
    }

    #[test]
    fn an_aircraft_that_cannot_be_seen_is_asked_nothing() {
        let mut targets = Targets::new(1, 64, 128);
        targets.add(
            0,
            &CropTruth {
                visible: false,
                ..SEEN
            },
        );
        assert_eq!(targets.positives, 0);
        assert!(
            targets
                .heat
                .iter()
                .chain(&targets.number_weight)
                .all(|&value| value == 0.0)
        );
        assert_eq!(targets.heat_weight[5 * 16 + 7], 0.0);
        assert_eq!(targets.heat_weight[0], 1.0);
    }

    #[test]
    fn the_part_of_an_aircraft_whose_centre_is_outside_is_asked_nothing() {
        let mut targets = Targets::new(1, 64, 128);
        targets.add(
            0,
            &CropTruth {
                pixel_box: PixelBox {
                    cx_px: -5.0,
                    ..SEEN.pixel_box
                },
                visible: true,
            },
        );
        assert_eq!(targets.heat_weight[5 * 16], 0.0);
        assert_eq!(targets.positives, 0);
    }

    #[test]
    fn a_cut_aircraft_weighs_less_than_a_whole_one() {
        let weight = |cx_px: f64| {
            let mut targets = Targets::new(1, 64, 128);
            targets.add(
                0,
                &CropTruth {
                    pixel_box: PixelBox {
                        cx_px,
                        ..SEEN.pixel_box
                    },
                    visible: true,
                },
            );
            targets.number_weight.iter().copied().fold(0.0, f32::max)
        };
        assert!(
            weight(3.5) < 0.5 * weight(67.5),
            "{} {}",
            weight(3.5),
            weight(67.5)
        );
    }
}
