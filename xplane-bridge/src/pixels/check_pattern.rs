//! The check pattern: an image with a code that identifies a grabbed window.
//!
//! During registration the simulator covers its window with a code's pattern; the client grabs the screen until it reads that very code,
//! and learns the window's position, whether it is scaled, and how long a drawn frame takes to be visible. It is never drawn during a
//! recording. A border in magenta, which no scenery has, marks the position; a grid of black and white cells carries the code and a
//! checksum, so that an image torn between two codes is invalid. `docs/capture-link.md` specifies it for other implementations.

use super::rgb_picture::{Rectangle, RgbPicture};

/// Smallest window that can show the pattern, pixels.
pub(crate) const MIN_WINDOW_PX: (u32, u32) = (64, 48);

const COLUMNS: u32 = 8;
const ROWS: u32 = 6;
/// Bits in code and checksum, one per cell.
const BITS: u32 = COLUMNS * ROWS;
const CHECKSUM_BITS: u32 = BITS - u32::BITS;

/// Changes every bit of the checksum, which is linear.
const OPPOSITE_CHECKSUM: u32 = 0x0000_84cf;

type Rgb = [u8; 3];
const MAGENTA: Rgb = [255, 0, 255];
const BLACK: Rgb = [0, 0, 0];
const WHITE: Rgb = [255, 255, 255];

/// Minimum of red and blue in magenta.
const BRIGHT: u8 = 160;
/// Maximum of green in magenta.
const DARK: u8 = 96;
/// Share of the border's area that must be magenta; with less, something covers the window.
const BORDER_SEEN: f64 = 0.9;
/// Minimum difference between white and black, grey levels.
const MIN_CONTRAST: f64 = 64.0;
/// A cell is black below the first and white above the second, as a share of the way from black to white.
const UNDECIDED: (f64, f64) = (0.35, 0.65);

/// A pattern that was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sighting {
    /// The code that it carries.
    pub code: u32,
    /// Position in the image: the window.
    pub rectangle: Rectangle,
}

/// Reason why no code could be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Unreadable {
    /// No border anywhere.
    #[error("no check pattern")]
    Absent,
    /// A candidate for the border, but incomplete.
    #[error("a check pattern that is partly covered or not whole, around {0}")]
    Covered(Rectangle),
    /// The border is complete, the code is not: between two codes, or drawn differently than specified.
    #[error("a check pattern without a valid code, at {0}")]
    Damaged(Rectangle),
}

/// The pattern of `code` as an image. A window smaller than [`MIN_WINDOW_PX`] is too small for it.
pub fn draw(code: u32, width_px: u32, height_px: u32) -> RgbPicture {
    let mut picture = RgbPicture::black(width_px, height_px);
    for (rectangle, colour) in rectangles(code, width_px, height_px) {
        for y in rectangle.y_px..rectangle.bottom_px() {
            for pixel in picture.pixels_mut(rectangle.x_px, rectangle.right_px(), y) {
                *pixel = colour;
            }
        }
    }
    picture
}

/// Finds the pattern in an image of the window or of the whole screen, and reads its code. Tolerates noise, lower contrast and scaling;
/// without scaling the rectangle is exact.
///
/// # Errors
/// There is none, or an incomplete one.
pub fn read(picture: &RgbPicture) -> Result<Sighting, Unreadable> {
    let rectangle = border_box(picture).ok_or(Unreadable::Absent)?;
    let smallest = MIN_WINDOW_PX;
    if rectangle.width_px < smallest.0 / 2 || rectangle.height_px < smallest.1 / 2 {
        return Err(Unreadable::Absent);
    }
    let (white, black) = border_levels(picture, rectangle).ok_or(Unreadable::Covered(rectangle))?;
    let mut bits = 0_u64;
    for cell in cells(rectangle) {
        let level = (mean_level(picture, middle_of(cell)) - black) / (white - black);
        let (dark_below, bright_above) = UNDECIDED;
        if (dark_below..=bright_above).contains(&level) {
            return Err(Unreadable::Damaged(rectangle));
        }
        bits = bits << 1 | u64::from(level > bright_above);
    }
    let code = (bits >> CHECKSUM_BITS) as u32;
    if bits == bits_of(code) {
        Ok(Sighting { code, rectangle })
    } else {
        Err(Unreadable::Damaged(rectangle))
    }
}

/// True if an image of just the window may show the pattern: checks its corners, cheap enough for every image. Only the pattern has four
/// magenta corners.
pub fn covers(picture: &RgbPicture) -> bool {
    let (width, height) = (picture.width_px, picture.height_px);
    width > 0
        && height > 0
        && [
            (0, 0),
            (width - 1, 0),
            (0, height - 1),
            (width - 1, height - 1),
        ]
        .into_iter()
        .all(|(x, y)| picture.pixels(x, x + 1, y).iter().all(is_magenta))
}

/// A code and two more, among which every cell of the pattern is black at least once, and white at least once: the opposite code, and one
/// with the opposite checksum.
pub(crate) fn both_colours(code: u32) -> [u32; 3] {
    [code, !code, code ^ OPPOSITE_CHECKSUM]
}

/// The code and its checksum, the first cell's bit highest.
fn bits_of(code: u32) -> u64 {
    u64::from(code) << CHECKSUM_BITS | u64::from(checksum(code))
}

/// CRC-16 with polynomial 0x1021 and start 0xffff over the code's bytes, the highest first; Python's `binascii.crc_hqx`.
pub(crate) fn checksum(code: u32) -> u16 {
    code.to_be_bytes().iter().fold(0xffff, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte) << 8, |crc: u16, _| {
            let carry = crc & 0x8000 != 0;
            crc << 1 ^ if carry { 0x1021 } else { 0 }
        })
    })
}

fn border_px(width_px: u32, height_px: u32) -> u32 {
    (width_px.min(height_px) / 32).max(2)
}

/// The rectangles to fill, in this order: all magenta, the inside black, the cells of set bits white.
fn rectangles(code: u32, width_px: u32, height_px: u32) -> Vec<(Rectangle, Rgb)> {
    let window = Rectangle {
        x_px: 0,
        y_px: 0,
        width_px,
        height_px,
    };
    let border = border_px(width_px, height_px);
    let mut all = vec![(window, MAGENTA), (window.inside(border), BLACK)];
    let bits = bits_of(code);
    let white = cells(window)
        .enumerate()
        .filter(|(at, _)| bits >> (BITS - 1 - *at as u32) & 1 == 1)
        .map(|(_, cell)| (cell, WHITE));
    all.extend(white);
    all
}

/// Cells of a pattern at this position, row by row.
fn cells(window: Rectangle) -> impl Iterator<Item = Rectangle> {
    let grid = window.inside(2 * border_px(window.width_px, window.height_px));
    let edge = |start: u32, length: u32, at: u32, of: u32| start + length * at / of;
    (0..ROWS).flat_map(move |row| {
        (0..COLUMNS).map(move |column| {
            Rectangle::between(
                edge(grid.x_px, grid.width_px, column, COLUMNS),
                edge(grid.y_px, grid.height_px, row, ROWS),
                edge(grid.x_px, grid.width_px, column + 1, COLUMNS),
                edge(grid.y_px, grid.height_px, row + 1, ROWS),
            )
        })
    })
}

fn is_magenta(pixel: &Rgb) -> bool {
    pixel[0] >= BRIGHT && pixel[2] >= BRIGHT && pixel[1] <= DARK
}

/// The window that the border frames: its upper and lower edge are the longest runs of magenta, one above the other.
fn border_box(picture: &RgbPicture) -> Option<Rectangle> {
    let run_of_row = |y_px| longest_run(picture.pixels(0, picture.width_px, y_px));
    let runs: Vec<(u32, u32)> = (0..picture.height_px).map(run_of_row).collect();
    let longest = *runs.iter().max_by_key(|(left, right)| right - left)?;
    let (left, right) = longest;
    let is_edge = |run: &(u32, u32)| run.0.abs_diff(left) <= 1 && run.1.abs_diff(right) <= 1;
    let top = runs.iter().position(is_edge)? as u32;
    let bottom = runs.iter().rposition(is_edge)? as u32;
    Some(Rectangle::between(left, top, right, bottom + 1))
}

/// The longest run of magenta in a row: its first column, and the one after its last.
fn longest_run(row: &[Rgb]) -> (u32, u32) {
    let (mut longest, mut start) = ((0, 0), 0);
    for (x, pixel) in row.iter().enumerate() {
        let next = x as u32 + 1;
        if !is_magenta(pixel) {
            start = next;
        } else if next - start > longest.1 - longest.0 {
            longest = (start, next);
        }
    }
    longest
}

/// White and black as the border shows them, if it is complete.
fn border_levels(picture: &RgbPicture, window: Rectangle) -> Option<(f64, f64)> {
    // Outermost and innermost lines of scaled borders are blended with their surroundings.
    let border = border_px(window.width_px, window.height_px);
    let mixed = if border < 3 { 0 } else { 1.max(border / 4) };
    let (outer, inner) = (window.inside(mixed), window.inside(border - mixed));
    let (mut pixels, mut magenta) = (0_u64, 0_u64);
    let (mut bright, mut dark) = (0_u64, 0_u64);
    let mut look = |part: Rectangle| {
        for y in part.y_px..part.bottom_px() {
            for pixel in picture.pixels(part.x_px, part.right_px(), y) {
                pixels += 1;
                if is_magenta(pixel) {
                    magenta += 1;
                    bright += u64::from(pixel[0]) + u64::from(pixel[2]);
                    dark += u64::from(pixel[1]);
                }
            }
        }
    };
    let (left, top, right, bottom) = (outer.x_px, outer.y_px, outer.right_px(), outer.bottom_px());
    look(Rectangle::between(left, top, right, inner.y_px));
    look(Rectangle::between(left, inner.bottom_px(), right, bottom));
    look(Rectangle::between(left, top, inner.x_px, bottom));
    look(Rectangle::between(inner.right_px(), top, right, bottom));
    let whole = magenta > 0 && magenta as f64 >= BORDER_SEEN * pixels as f64;
    let white = bright as f64 / (2 * magenta) as f64;
    let black = dark as f64 / magenta as f64;
    (whole && white - black >= MIN_CONTRAST).then_some((white, black))
}

/// The cell's middle half in both directions, away from its neighbours.
fn middle_of(cell: Rectangle) -> Rectangle {
    let (x, y) = (cell.width_px / 4, cell.height_px / 4);
    Rectangle::between(
        cell.x_px + x,
        cell.y_px + y,
        (cell.right_px() - x).max(cell.x_px + x + 1),
        (cell.bottom_px() - y).max(cell.y_px + y + 1),
    )
}

/// Mean of the three colours over a rectangle, grey levels.
fn mean_level(picture: &RgbPicture, area: Rectangle) -> f64 {
    let mut sum = 0_u64;
    for y in area.y_px..area.bottom_px() {
        for pixel in picture.pixels(area.x_px, area.right_px(), y) {
            sum += pixel.iter().map(|level| u64::from(*level)).sum::<u64>();
        }
    }
    sum as f64 / (3 * u64::from(area.width_px) * u64::from(area.height_px)) as f64
}

#[cfg(test)]
mod tests;
