//! The effect of a pixel format alone: RGB to YUV and back in exact arithmetic, with only the rounding to its levels and the chroma
//! subsampling.

/// BT.709.
pub(crate) const LUMA: [f64; 3] = [0.2126, 0.7152, 0.0722];
/// Largest blue and red differences of BT.709, twice.
const BLUE: f64 = 1.8556;
const RED: f64 = 1.5748;

/// A pixel format.
#[derive(Clone, Copy)]
pub(crate) struct Levels {
    /// 255 in full range, 219 in limited range; four times that with 10 bits.
    pub(crate) luma: f64,
    /// 255 and 224.
    pub(crate) chroma: f64,
    /// Four pixels share one colour.
    pub(crate) shared: bool,
}

/// A piece of image with an even number of rows and columns, converted there and back.
pub(crate) fn there_and_back(rgb: &[[f64; 3]], width: usize, levels: Levels) -> Vec<[f64; 3]> {
    let round = |value: f64, levels: f64| (value * levels / 255.0).round() * 255.0 / levels;
    let bright = |[r, g, b]: [f64; 3]| LUMA[0] * r + LUMA[1] * g + LUMA[2] * b;
    let colour = |pixel: [f64; 3]| {
        let y = bright(pixel);
        [(pixel[2] - y) / BLUE, (pixel[0] - y) / RED]
    };
    let pixel = |(at, pixel): (usize, &[f64; 3])| {
        let y = round(bright(*pixel), levels.luma);
        let (row, column) = (at / width, at % width);
        let [blue, red] = if levels.shared {
            let (row, column) = (row / 2 * 2, column / 2 * 2);
            let four = [(0, 0), (0, 1), (1, 0), (1, 1)]
                .map(|(down, right)| colour(rgb[(row + down) * width + column + right]));
            [0, 1].map(|which| four.iter().map(|colour| colour[which]).sum::<f64>() / 4.0)
        } else {
            colour(*pixel)
        }
        .map(|difference| round(difference, levels.chroma));
        let (r, b) = (y + RED * red, y + BLUE * blue);
        let g = (y - LUMA[0] * r - LUMA[2] * b) / LUMA[1];
        [r, g, b].map(|value| value.round().clamp(0.0, 255.0))
    };
    rgb.iter().enumerate().map(pixel).collect()
}
