//! The image in cells, and how much of each differs between two images.

use super::Rectangle;

/// Cell side, pixels.
pub(super) const CELL_PX: usize = 16;
const CHANNELS: usize = 3;

/// Equally large images, divided into cells row by row; cells at the right and lower edge may be smaller.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grid {
    width_px: usize,
    height_px: usize,
    pub(super) columns: usize,
    pub(super) rows: usize,
}

impl Grid {
    pub(super) fn new(width_px: u32, height_px: u32) -> Self {
        let (width_px, height_px) = (width_px as usize, height_px as usize);
        Self {
            width_px,
            height_px,
            columns: width_px.div_ceil(CELL_PX),
            rows: height_px.div_ceil(CELL_PX),
        }
    }

    pub(super) fn cells(&self) -> usize {
        self.columns * self.rows
    }

    pub(super) fn bytes(&self) -> usize {
        self.width_px * self.height_px * CHANNELS
    }

    fn row_bytes(&self) -> usize {
        self.width_px * CHANNELS
    }

    /// First column and row, and those after the last, pixels.
    fn edges(&self, at: usize) -> [usize; 4] {
        let (left, top) = (at % self.columns * CELL_PX, at / self.columns * CELL_PX);
        let right = (left + CELL_PX).min(self.width_px);
        [left, top, right, (top + CELL_PX).min(self.height_px)]
    }

    pub(super) fn values(&self, at: usize) -> u32 {
        let [left, top, right, bottom] = self.edges(at);
        ((right - left) * (bottom - top) * CHANNELS) as u32
    }

    /// Cells that some of the rectangles touch.
    pub(super) fn touched(&self, rectangles: &[Rectangle]) -> Vec<bool> {
        let mut touched = vec![false; self.cells()];
        for rectangle in rectangles {
            let span = |start: u32, length: u32, cells: usize| {
                let end = (start as usize + length as usize).div_ceil(CELL_PX);
                start as usize / CELL_PX..end.min(cells)
            };
            for row in span(rectangle.y_px, rectangle.height_px, self.rows) {
                for column in span(rectangle.x_px, rectangle.width_px, self.columns) {
                    touched[row * self.columns + column] = true;
                }
            }
        }
        touched
    }

    /// For each level, the number of values of each cell that differ by more.
    pub(super) fn changed<const N: usize>(
        &self,
        a: &[u8],
        b: &[u8],
        levels: [u8; N],
    ) -> [Vec<u32>; N] {
        self.beyond(a, (b, b), levels)
    }

    /// For each level, the number of values of each cell that are beyond a range of values, `low` to `high`, by more.
    pub(super) fn beyond<const N: usize>(
        &self,
        rgb: &[u8],
        (low, high): (&[u8], &[u8]),
        levels: [u8; N],
    ) -> [Vec<u32>; N] {
        let mut beyond = levels.map(|_| Vec::with_capacity(self.cells()));
        let mut columns = vec![0_u8; self.row_bytes()];
        let ranges = self.bands(low).zip(self.bands(high));
        for (rgb, (low, high)) in self.bands(rgb).zip(ranges) {
            for (beyond, level) in beyond.iter_mut().zip(levels) {
                columns.fill(0);
                let ranges = self.lines(low).zip(self.lines(high));
                for (rgb, (low, high)) in self.lines(rgb).zip(ranges) {
                    // The usual case in a paused world.
                    if rgb != low {
                        count_beyond(&mut columns, rgb, (low, high), level);
                    }
                }
                beyond.extend(sums(&columns));
            }
        }
        beyond
    }

    /// Widens the range of a cell's values to an image.
    pub(super) fn widen_cell(&self, at: usize, rgb: &[u8], low: &mut [u8], high: &mut [u8]) {
        for row in self.rows_of_cell(at) {
            let range = low[row.clone()].iter_mut().zip(&mut high[row.clone()]);
            for (value, (low, high)) in rgb[row].iter().zip(range) {
                *low = (*low).min(*value);
                *high = (*high).max(*value);
            }
        }
    }

    /// Number of values in a cell that differ by more than `level`.
    pub(super) fn changed_in_cell(&self, at: usize, a: &[u8], b: &[u8], level: u8) -> u32 {
        self.rows_of_cell(at)
            .map(|row| {
                let values = a[row.clone()].iter().zip(&b[row]);
                values.filter(|(a, b)| a.abs_diff(**b) > level).count() as u32
            })
            .sum()
    }

    /// Mean of a cell's values, levels.
    pub(super) fn mean(&self, at: usize, rgb: &[u8]) -> f64 {
        let values = self.rows_of_cell(at).flat_map(|row| &rgb[row]);
        let sum: u32 = values.map(|value| u32::from(*value)).sum();
        f64::from(sum) / f64::from(self.values(at))
    }

    /// Sum of a cell's differences.
    pub(super) fn distance(&self, at: usize, a: &[u8], b: &[u8]) -> u64 {
        let rows = self.rows_of_cell(at);
        rows.map(|row| {
            let values = a[row.clone()].iter().zip(&b[row]);
            values.map(|(a, b)| u64::from(a.abs_diff(*b))).sum::<u64>()
        })
        .sum()
    }

    pub(super) fn copy_cell(&self, at: usize, from: &[u8], to: &mut [u8]) {
        for row in self.rows_of_cell(at) {
            to[row.clone()].copy_from_slice(&from[row]);
        }
    }

    fn rows_of_cell(&self, at: usize) -> impl Iterator<Item = std::ops::Range<usize>> {
        let ([left, top, right, bottom], row_bytes) = (self.edges(at), self.row_bytes());
        (top..bottom)
            .map(move |row| row * row_bytes + left * CHANNELS..row * row_bytes + right * CHANNELS)
    }

    /// Rows of cells.
    fn bands<'a>(&self, rgb: &'a [u8]) -> impl Iterator<Item = &'a [u8]> {
        rgb.chunks(CELL_PX * self.row_bytes())
    }

    fn lines<'a>(&self, band: &'a [u8]) -> impl Iterator<Item = &'a [u8]> {
        band.chunks_exact(self.row_bytes())
    }

    /// The cells around a cell, its own among them.
    pub(super) fn around(&self, at: usize) -> impl Iterator<Item = usize> {
        let (column, row) = (at % self.columns, at / self.columns);
        let columns = column.saturating_sub(1)..=(column + 1).min(self.columns - 1);
        let of_row = self.columns;
        (row.saturating_sub(1)..=(row + 1).min(self.rows - 1))
            .flat_map(move |row| columns.clone().map(move |column| row * of_row + column))
    }

    /// Removes from `left`, and returns, the cells that are connected to a cell, edges and corners alike, in the order of reaching them.
    /// `connects` decides for two neighbouring cells.
    pub(super) fn connected(
        &self,
        start: usize,
        left: &mut [bool],
        connects: impl Fn(usize, usize) -> bool,
    ) -> Vec<usize> {
        let mut found = vec![start];
        left[start] = false;
        let mut next = 0;
        while let Some(&at) = found.get(next) {
            next += 1;
            for beside in self.around(at) {
                if left[beside] && connects(at, beside) {
                    left[beside] = false;
                    found.push(beside);
                }
            }
        }
        found
    }

    /// The rectangle around the largest connected group of the given cells, if there are any.
    pub(super) fn largest(&self, mut cells: Vec<bool>) -> Option<Rectangle> {
        let mut largest = Vec::new();
        for at in 0..cells.len() {
            if cells[at] {
                let group = self.connected(at, &mut cells, |_, _| true);
                if group.len() > largest.len() {
                    largest = group;
                }
            }
        }
        self.around_all(&largest)
    }

    pub(super) fn around_all(&self, cells: &[usize]) -> Option<Rectangle> {
        let edges = cells.iter().map(|at| self.edges(*at));
        let [left, top, right, bottom] = edges.reduce(|a, b| {
            [
                a[0].min(b[0]),
                a[1].min(b[1]),
                a[2].max(b[2]),
                a[3].max(b[3]),
            ]
        })?;
        let [left, top, right, bottom] = [left, top, right, bottom].map(|edge| edge as u32);
        Some(Rectangle::between(left, top, right, bottom))
    }
}

/// Adds one to the count of each column of values that is beyond its range; at most [`CELL_PX`] times.
fn count_beyond(columns: &mut [u8], rgb: &[u8], (low, high): (&[u8], &[u8]), level: u8) {
    let values = rgb.iter().zip(low.iter().zip(high));
    for (count, (value, (low, high))) in columns.iter_mut().zip(values) {
        let beyond = low.saturating_sub(*value).max(value.saturating_sub(*high));
        *count += u8::from(beyond > level);
    }
}

/// Sums over the columns of each cell.
fn sums(columns: &[u8]) -> impl Iterator<Item = u32> {
    columns
        .chunks(CELL_PX * CHANNELS)
        .map(|cell| cell.iter().map(|count| u32::from(*count)).sum())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 40 x 20 pixels: the last column of cells has half the width, the last row a quarter of the height.
    fn uneven() -> (Grid, Vec<u8>, Vec<u8>) {
        let grid = Grid::new(40, 20);
        let before = vec![100; grid.bytes()];
        let mut after = before.clone();
        // One pixel by 10 in the first cell, one value by 1 in the last.
        after[..3].fill(110);
        *after.last_mut().unwrap() = 101;
        (grid, before, after)
    }

    #[test]
    fn changes_are_counted_in_their_cells_beyond_a_level() {
        let (grid, before, after) = uneven();
        assert_eq!((grid.columns, grid.rows), (3, 2));
        let [far, half, all] = grid.changed(&after, &before, [12, 6, 0]);
        assert_eq!(far, [0; 6]);
        assert_eq!(half, [3, 0, 0, 0, 0, 0]);
        assert_eq!(all, [3, 0, 0, 0, 0, 1]);
        assert_eq!(grid.changed_in_cell(5, &after, &before, 0), 1);
        let values: Vec<u32> = (0..6).map(|at| grid.values(at)).collect();
        assert_eq!(values, [768, 768, 384, 192, 192, 96]);
        assert_eq!(values.iter().sum::<u32>() as usize, grid.bytes());
    }

    #[test]
    fn a_cell_is_copied_alone() {
        let (grid, before, after) = uneven();
        let mut mended = after.clone();
        grid.copy_cell(5, &before, &mut mended);
        assert_eq!(grid.changed(&mended, &before, [0]), [[3, 0, 0, 0, 0, 0]]);
        grid.copy_cell(0, &before, &mut mended);
        assert_eq!(mended, before);
    }

    #[test]
    fn rectangles_touch_cells_also_beyond_the_picture() {
        let (grid, ..) = uneven();
        let touched = |x, y, right, bottom| {
            let cells = grid.touched(&[Rectangle::between(x, y, right, bottom)]);
            (0..6).filter(|at| cells[*at]).collect::<Vec<_>>()
        };
        assert_eq!(touched(15, 0, 17, 16), [0, 1]);
        assert_eq!(touched(16, 15, 32, 17), [1, 4]);
        assert_eq!(touched(33, 17, 900, 900), [5]);
        assert!(touched(500, 500, 900, 900).is_empty());
    }

    #[test]
    fn the_largest_group_is_named() {
        let grid = Grid::new(80, 48);
        let mut cells = vec![false; grid.cells()];
        // One alone, and two at a corner.
        for at in [0, 8, 12] {
            cells[at] = true;
        }
        let found = grid.largest(cells);
        assert_eq!(found, Some(Rectangle::between(32, 16, 64, 48)));
        assert_eq!(grid.largest(vec![false; grid.cells()]), None);
    }
}
