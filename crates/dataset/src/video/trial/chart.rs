//! A trial's image: patches of known colours above, its number in black and white below.

use super::super::BYTES_PER_PIXEL;

/// Digits of the number, least significant first, and then each bit inverted: a grey or misplaced image shows no number.
const DIGITS: u32 = 7;
const CELLS: usize = 2 * DIGITS as usize;

/// Greys show the range, the others the matrix.
const PATCHES: [(&str, [u8; 3]); 8] = [
    ("black", [0, 0, 0]),
    ("white", [255, 255, 255]),
    ("grey", [128, 128, 128]),
    ("red", [200, 40, 40]),
    ("green", [40, 180, 60]),
    ("blue", [40, 60, 200]),
    ("yellow", [210, 200, 50]),
    ("sky", [120, 160, 210]),
];

/// A chart with a fixed size.
pub(super) struct Chart {
    width: usize,
    height: usize,
}

impl Chart {
    pub(super) fn new(width_px: u32, height_px: u32) -> Self {
        Self {
            width: width_px as usize,
            height: height_px as usize,
        }
    }

    /// Draws the image with this number.
    pub(super) fn draw(&self, number: u32, rgb: &mut Vec<u8>) {
        rgb.clear();
        rgb.reserve(self.width * self.height * BYTES_PER_PIXEL);
        for row in 0..self.height {
            for column in 0..self.width {
                let colour = if row < self.height / 2 {
                    PATCHES[column * PATCHES.len() / self.width].1
                } else {
                    [255 * u8::from(is_white(number, column * CELLS / self.width)); 3]
                };
                rgb.extend_from_slice(&colour);
            }
        }
    }

    /// An image's number, if it shows one.
    pub(super) fn number(&self, rgb: &[u8]) -> Option<u32> {
        let lower = (self.height / 2, self.height);
        let bright = |cell: usize| self.mean(rgb, (cell, CELLS), lower)[1] > 128.0;
        let number = (0..DIGITS).fold(0, |number, digit| {
            number | u32::from(bright(digit as usize)) << digit
        });
        (0..CELLS)
            .all(|cell| bright(cell) == is_white(number, cell))
            .then_some(number)
    }

    /// The patches: name, mean colour, drawn colour.
    pub(super) fn patches<'a>(
        &'a self,
        rgb: &'a [u8],
    ) -> impl Iterator<Item = (&'static str, [f64; 3], [f64; 3])> + 'a {
        let upper = (0, self.height / 2);
        let patches = PATCHES.into_iter().enumerate();
        patches.map(move |(patch, (name, colour))| {
            let found = self.mean(rgb, (patch, PATCHES.len()), upper);
            (name, found, colour.map(f64::from))
        })
    }

    /// Mean colour of the cell's middle: the edges mix with its neighbours.
    fn mean(
        &self,
        rgb: &[u8],
        (cell, cells): (usize, usize),
        (top, bottom): (usize, usize),
    ) -> [f64; 3] {
        let middle = |from: usize, to: usize| {
            let edge = (to - from) / 4;
            from + edge..(to - edge).max(from + edge + 1)
        };
        let (left, right) = (
            (cell * self.width).div_ceil(cells),
            ((cell + 1) * self.width).div_ceil(cells),
        );
        let (rows, columns) = (middle(top, bottom), middle(left, right));
        let count = (rows.len() * columns.len()) as f64;
        let mut sums = [0.0; 3];
        for row in rows {
            for column in columns.clone() {
                let at = (row * self.width + column) * BYTES_PER_PIXEL;
                for (sum, value) in sums.iter_mut().zip(&rgb[at..at + BYTES_PER_PIXEL]) {
                    *sum += f64::from(*value);
                }
            }
        }
        sums.map(|sum| sum / count)
    }
}

fn is_white(number: u32, cell: usize) -> bool {
    let digit = cell as u32 % DIGITS;
    (number >> digit & 1 == 1) == (cell < DIGITS as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_shows_its_number_and_its_colours_at_any_size() {
        for (width, height) in [(64, 64), (96, 64), (1_920, 1_280)] {
            let chart = Chart::new(width, height);
            let mut rgb = Vec::new();
            for number in [0, 1, 42, 99, 127] {
                chart.draw(number, &mut rgb);
                assert_eq!(chart.number(&rgb), Some(number), "{width}x{height}");
                assert!(chart.patches(&rgb).all(|(_, found, drawn)| found == drawn));
            }
            let grey = vec![130; rgb.len()];
            assert_eq!(chart.number(&grey), None);
        }
    }
}
