//! The encoding of boxes in cells.
//!
//! Pixel (0, 0) is the centre of the top-left pixel, so cell `i` of 8 px covers -0.5 + 8 i to 7.5 + 8 i and has its centre at 8 i +
//! 3.5. This file and the graph that `export` writes implement the same formulas.

pub mod targets;

use dataset::tables::pixel_box::PixelBox;

/// Cell side, px.
pub(crate) const STRIDE_PX: usize = 8;
/// Numbers per cell: objectness logit, offset right, offset down (in cells), logarithm of width and of height (to the anchor).
pub(crate) const CELL_VALUES: usize = 5;
/// Reference size of the logarithms of width and height, pixels: a B737 at 5 NM through a lens of 10 degrees.
pub(crate) const ANCHOR_PX: [f64; 2] = [41.0, 14.0];
/// Radius in cells for averaging boxes and for peaks.
pub(crate) const NEIGHBOURHOOD: usize = 1;
/// Logarithms of size are clamped to this, so that an untrained network or a foreign image cannot cause an overflow.
pub(crate) const MAX_LOG_SIZE: f64 = 4.0;
/// Logits are clamped to this, so that no score is exactly 0: averaging boxes divides by scores.
pub(crate) const MAX_LOGIT: f64 = 16.0;

/// Cell centre along one axis, pixels.
pub(crate) fn cell_center_px(cell: usize) -> f64 {
    (cell * STRIDE_PX) as f64 + (STRIDE_PX as f64 - 1.0) / 2.0
}

/// The cell that holds a pixel coordinate; may lie outside the image.
pub(crate) fn cell_of_px(pixel: f64) -> i64 {
    ((pixel + 0.5) / STRIDE_PX as f64).floor() as i64
}

/// The four numbers that encode a box in the cell (column, row).
pub fn encode(pixel_box: &PixelBox, column: usize, row: usize) -> [f64; 4] {
    [
        (pixel_box.cx_px - cell_center_px(column)) / STRIDE_PX as f64,
        (pixel_box.cy_px - cell_center_px(row)) / STRIDE_PX as f64,
        (pixel_box.width_px / ANCHOR_PX[0]).ln(),
        (pixel_box.height_px / ANCHOR_PX[1]).ln(),
    ]
}

#[cfg(test)]
pub(crate) use tests::peaks;

#[cfg(test)]
mod tests {
    use super::*;

    /// The box that the cell (column, row) encodes.
    fn decode(numbers: [f64; 4], column: usize, row: usize) -> PixelBox {
        let size = |number: f64, anchor_px: f64| {
            anchor_px * number.clamp(-MAX_LOG_SIZE, MAX_LOG_SIZE).exp()
        };
        PixelBox {
            cx_px: cell_center_px(column) + numbers[0] * STRIDE_PX as f64,
            cy_px: cell_center_px(row) + numbers[1] * STRIDE_PX as f64,
            width_px: size(numbers[2], ANCHOR_PX[0]),
            height_px: size(numbers[3], ANCHOR_PX[1]),
        }
    }

    /// A box with its score.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub(crate) struct ScoredBox {
        /// The box, pixels of the network's input.
        pub(crate) pixel_box: PixelBox,
        /// Objectness, 0 to 1.
        pub(crate) score: f64,
    }

    /// All peaks of a map with a score of at least `threshold`, best first. `cells` holds [`CELL_VALUES`] numbers per cell, row-major.
    ///
    /// A peak is a cell that none of its eight neighbours exceeds. Its box is the mean of the boxes of the nine cells weighted by their
    /// scores: each of them saw the target at another phase of the grid, so their errors partly cancel.
    pub(crate) fn peaks(
        cells: &[f32],
        width: usize,
        height: usize,
        threshold: f64,
    ) -> Vec<ScoredBox> {
        let score = |column: usize, row: usize| {
            sigmoid(f64::from(cells[(row * width + column) * CELL_VALUES]))
        };
        let mut found = Vec::new();
        for row in 0..height {
            for column in 0..width {
                let peak = score(column, row);
                let around = || {
                    let rows =
                        row.saturating_sub(NEIGHBOURHOOD)..=(row + NEIGHBOURHOOD).min(height - 1);
                    rows.flat_map(move |r| {
                        (column.saturating_sub(NEIGHBOURHOOD)
                            ..=(column + NEIGHBOURHOOD).min(width - 1))
                            .map(move |c| (c, r))
                    })
                };
                if peak < threshold || around().any(|(c, r)| score(c, r) > peak) {
                    continue;
                }
                let mut sum = [0.0; 5];
                for (c, r) in around() {
                    let numbers = &cells[(r * width + c) * CELL_VALUES + 1..][..4];
                    let one = decode([0, 1, 2, 3].map(|i| f64::from(numbers[i])), c, r);
                    let weight = score(c, r);
                    let terms = [one.cx_px, one.cy_px, one.width_px, one.height_px, 1.0];
                    sum = [0, 1, 2, 3, 4].map(|i| sum[i] + weight * terms[i]);
                }
                let [cx_px, cy_px, width_px, height_px] = [0, 1, 2, 3].map(|i| sum[i] / sum[4]);
                found.push(ScoredBox {
                    pixel_box: PixelBox {
                        cx_px,
                        cy_px,
                        width_px,
                        height_px,
                    },
                    score: peak,
                });
            }
        }
        found.sort_by(|a, b| b.score.total_cmp(&a.score));
        found
    }

    fn sigmoid(logit: f64) -> f64 {
        1.0 / (1.0 + (-logit.clamp(-MAX_LOGIT, MAX_LOGIT)).exp())
    }

    fn sample() -> PixelBox {
        PixelBox {
            cx_px: 61.3,
            cy_px: 42.7,
            width_px: 33.0,
            height_px: 11.5,
        }
    }

    #[test]
    fn a_box_is_read_back_from_any_cell_as_it_was_written() {
        for (column, row) in [(7, 5), (8, 4), (0, 0)] {
            let back = decode(encode(&sample(), column, row), column, row);
            assert!(
                (back.cx_px - sample().cx_px).abs() < 1e-9
                    && (back.height_px - sample().height_px).abs() < 1e-9
            );
        }
    }

    #[test]
    fn the_first_cell_reaches_half_a_pixel_beyond_the_first_pixels_centre() {
        assert_eq!(cell_center_px(0), 3.5);
        assert_eq!([-0.6, -0.4, 7.4, 7.6].map(cell_of_px), [-1, 0, 0, 1]);
    }

    #[test]
    fn a_peak_is_the_weighted_mean_of_its_neighbourhood_and_neighbours_are_no_peaks() {
        let (width, height) = (10, 8);
        let mut cells = vec![0.0_f32; width * height * CELL_VALUES];
        for row in 0..height {
            for column in 0..width {
                let cell = &mut cells[(row * width + column) * CELL_VALUES..][..CELL_VALUES];
                let near = column.abs_diff(7) <= 1 && row.abs_diff(5) <= 1;
                cell[0] = if (column, row) == (7, 5) {
                    3.0
                } else if near {
                    1.0
                } else {
                    -9.0
                };
                let truth = encode(&sample(), column, row);
                for i in 0..4 {
                    // Errors of the left and the right neighbours are opposite.
                    cell[i + 1] = (truth[i]
                        + if i == 0 {
                            0.1 * (column as f64 - 7.0)
                        } else {
                            0.0
                        }) as f32;
                }
            }
        }
        let found = peaks(&cells, width, height, 0.3);
        assert_eq!(found.len(), 1);
        assert!(
            (found[0].pixel_box.cx_px - sample().cx_px).abs() < 1e-4,
            "{found:?}"
        );
        assert!((found[0].score - sigmoid(3.0)).abs() < 1e-12);
    }
}
