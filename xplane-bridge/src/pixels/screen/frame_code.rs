//! Frame numbers, read from the margins around images.
//!
//! The plugin draws the same code above and below the image, and the lowest bits of the number in a column beside it, over the whole
//! height. A grab that was taken while the screen changed has rows of two frames: then the strips differ, or a row of the column does not
//! belong to them. `docs/capture-link.md` specifies the code for other implementations.

use crate::link::MARGIN_PX;
use crate::pixels::check_pattern::checksum;
use crate::pixels::{Rectangle, RgbPicture};

const CELLS: u32 = 48;
const CHECKSUM_BITS: u32 = 16;
const COLUMN_BITS: u32 = 5;
const COLUMN_BARS: u32 = COLUMN_BITS + 3;
/// Numbers in a code are modulo this.
const NUMBERS: u64 = 1 << 24;
/// A cell is black below the first and white from the second on, grey levels.
const UNDECIDED: (u8, u8) = (96, 160);

/// A frame's own description.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct FrameCode {
    /// The lowest 24 bits of the frame's number.
    number: u32,
    /// Number of frames directly before this one whose numbers directly precede its own, up to 7.
    pub(crate) steady: u32,
    /// True if the aircraft was displaced when the frame was written.
    pub(crate) is_probe: bool,
    /// The lowest 4 bits of the view's number.
    pub(crate) view: u32,
}

impl FrameCode {
    fn of_bits(code: u32) -> Self {
        Self {
            number: code >> 8,
            steady: code >> 5 & 7,
            is_probe: code >> 4 & 1 == 1,
            view: code & 15,
        }
    }

    /// True if it is the number after another one.
    pub(crate) fn follows(self, other: Self) -> bool {
        u64::from(self.number) == (u64::from(other.number) + 1) % NUMBERS
    }

    /// The frame's whole number: the one nearest to a number of about the same time.
    pub(crate) fn number_near(self, other: u64) -> u64 {
        let base = other - other % NUMBERS;
        let candidates = [
            base.saturating_sub(NUMBERS),
            base,
            base.saturating_add(NUMBERS),
        ];
        candidates
            .map(|base| base + u64::from(self.number))
            .into_iter()
            .min_by_key(|number| number.abs_diff(other))
            .unwrap_or(other)
    }
}

/// Reads the code in a strip of cells over the whole width, from one row. `None` if there is none.
pub(crate) fn read_strip(picture: &RgbPicture, y_px: u32) -> Option<FrameCode> {
    let row = picture.pixels(0, picture.width_px, y_px);
    let mut bits = 0_u64;
    for cell in 0..CELLS {
        let x = picture.width_px * (2 * cell + 1) / (2 * CELLS);
        bits = bits << 1 | u64::from(is_white(row[x as usize])?);
    }
    let code = (bits >> CHECKSUM_BITS) as u32;
    let is_sound = bits & ((1 << CHECKSUM_BITS) - 1) == u64::from(checksum(code));
    is_sound.then(|| FrameCode::of_bits(code))
}

/// Reads the code of a grab with [`MARGIN_PX`] around the image. `None` if there is none, or if rows belong to different frames.
pub(crate) fn read(grab: &RgbPicture) -> Option<FrameCode> {
    let (width, height) = (grab.width_px, grab.height_px);
    if width < 2 * CELLS || height <= 2 * MARGIN_PX {
        return None;
    }
    let code = read_strip(grab, MARGIN_PX / 2)?;
    if read_strip(grab, height - MARGIN_PX / 2)? != code {
        return None;
    }
    let bars = 1 << (COLUMN_BARS - 1) | (code.number & ((1 << COLUMN_BITS) - 1)) << 1;
    let is_whole = (MARGIN_PX..height - MARGIN_PX).all(|y| {
        let row = grab.pixels(0, MARGIN_PX, y);
        (0..COLUMN_BARS).all(|bar| {
            let x = MARGIN_PX * (2 * bar + 1) / (2 * COLUMN_BARS);
            is_white(row[x as usize]) == Some(bars >> (COLUMN_BARS - 1 - bar) & 1 == 1)
        })
    });
    is_whole.then_some(code)
}

fn is_white(pixel: [u8; 3]) -> Option<bool> {
    let (black_below, white_from) = UNDECIDED;
    if pixel.iter().all(|level| *level >= white_from) {
        Some(true)
    } else if pixel.iter().all(|level| *level < black_below) {
        Some(false)
    } else {
        None
    }
}

/// The rectangle of image and code in the window, for margins of at least [`MARGIN_PX`].
pub(crate) fn coded_region(window: Rectangle, [margin_x, margin_y]: [u32; 2]) -> Rectangle {
    Rectangle {
        x_px: window.x_px + margin_x - MARGIN_PX,
        y_px: window.y_px + margin_y - MARGIN_PX,
        width_px: window.width_px - 2 * (margin_x - MARGIN_PX),
        height_px: window.height_px - 2 * (margin_y - MARGIN_PX),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE_PX: (u32, u32) = (128, 96);

    /// A grey image with a frame's code, as `plugin/dtd_bridge/frame_code.py` draws it.
    fn coded(number: u32, steady: u32) -> RgbPicture {
        let code = number << 8 | steady << 5 | 3;
        let bits = u64::from(code) << CHECKSUM_BITS | u64::from(checksum(code));
        let (width, height) = SIDE_PX;
        let mut picture = RgbPicture::black(width, height);
        picture.rgb.fill(128);
        let paint = |white: bool| [if white { 255 } else { 0 }; 3];
        for y in (0..MARGIN_PX).chain(height - MARGIN_PX..height) {
            for (x, pixel) in picture.pixels_mut(0, width, y).iter_mut().enumerate() {
                let cell = (0..CELLS)
                    .rposition(|cell| width * cell / CELLS <= x as u32)
                    .unwrap();
                *pixel = paint(bits >> (CELLS as usize - 1 - cell) & 1 == 1);
            }
        }
        let bars = 1 << (COLUMN_BARS - 1) | (number & 31) << 1;
        for y in MARGIN_PX..height - MARGIN_PX {
            for (x, pixel) in picture.pixels_mut(0, MARGIN_PX, y).iter_mut().enumerate() {
                let bar = x as u32 * COLUMN_BARS / MARGIN_PX;
                *pixel = paint(bars >> (COLUMN_BARS - 1 - bar) & 1 == 1);
            }
        }
        picture
    }

    #[test]
    fn a_code_is_read_with_everything_that_it_says() {
        let code = read(&coded(4_712, 5)).unwrap();
        let FrameCode {
            number,
            steady,
            is_probe,
            view,
        } = code;
        assert_eq!((number, steady, is_probe, view), (4_712, 5, false, 3));
    }

    #[test]
    fn a_grab_that_is_torn_at_any_row_has_no_code() {
        let (before, after) = (coded(70_000, 7), coded(70_001, 7));
        let row_bytes = SIDE_PX.0 as usize * 3;
        for row in 1..SIDE_PX.1 as usize {
            let mut torn = before.clone();
            torn.rgb[row * row_bytes..].copy_from_slice(&after.rgb[row * row_bytes..]);
            let read = read(&torn);
            // A tear within a strip leaves the image whole.
            let picture_is_whole =
                !(MARGIN_PX as usize + 1..(SIDE_PX.1 - MARGIN_PX) as usize).contains(&row);
            assert!(read.is_none() || picture_is_whole, "row {row}: {read:?}");
        }
    }

    #[test]
    fn a_band_of_another_frame_anywhere_in_the_picture_is_seen() {
        let (frame, other) = (coded(9, 7), coded(8, 7));
        let row_bytes = SIDE_PX.0 as usize * 3;
        for row in MARGIN_PX as usize..(SIDE_PX.1 - MARGIN_PX) as usize {
            let mut mixed = frame.clone();
            let band = row * row_bytes..(row + 1) * row_bytes;
            mixed.rgb[band.clone()].copy_from_slice(&other.rgb[band]);
            assert!(read(&mixed).is_none(), "row {row}");
        }
    }

    #[test]
    fn numbers_beyond_the_code_continue() {
        let code = |number: u64| FrameCode::of_bits(((number % NUMBERS) as u32) << 8);
        for number in [5, NUMBERS - 1, NUMBERS, NUMBERS + 3, 7 * NUMBERS + 12] {
            for near in [number.saturating_sub(9), number, number + 9] {
                assert_eq!(code(number).number_near(near), number, "near {near}");
            }
        }
    }
}
