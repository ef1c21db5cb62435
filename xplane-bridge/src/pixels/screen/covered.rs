//! Locates covers over the simulator's window while its check pattern is shown.
//!
//! Input: grabs of the window with patterns whose codes are known, drawn under the windows of the simulator's user interface and over them.
//! Output: the rectangle where they do not look as they were drawn. If only the patterns under the windows are hidden, one of these windows
//! is the cover; otherwise it belongs to a foreign program.

use crate::pixels::cell_grid::Grid;
use crate::pixels::check_pattern::draw;
use crate::pixels::{PixelError, Rectangle, RgbPicture};

/// Change of a pattern's value, 0 or 255, by a half transparent window. Noise and colour scaling change less.
const HIDDEN_LEVEL: u8 = 64;
/// Share of hidden values that makes a cell hidden.
const HIDDEN_SHARE: f64 = 0.15;

/// Window cells that are hidden in any of several patterns.
#[derive(Debug)]
pub(super) struct Hidden {
    window: Rectangle,
    grid: Grid,
    cells: Vec<bool>,
}

impl Hidden {
    /// A window without any cover.
    pub(super) fn new(window: Rectangle) -> Self {
        let grid = Grid::new(window.width_px, window.height_px);
        Self {
            cells: vec![false; grid.cells()],
            grid,
            window,
        }
    }

    /// Adds the pattern's cells that are hidden in a grab.
    #[cfg(test)]
    pub(super) fn compare(&mut self, grabbed: &RgbPicture, code: u32) {
        let pattern = draw(code, self.window.width_px, self.window.height_px);
        let hidden = self.in_grab(grabbed, &pattern);
        self.add(&hidden);
    }

    /// Adds cells that [`Hidden::in_grab`] returned.
    pub(super) fn add(&mut self, hidden: &[bool]) {
        for (cell, hidden) in self.cells.iter_mut().zip(hidden) {
            *cell |= hidden;
        }
    }

    /// Cells of the drawn pattern that are hidden in a grab.
    pub(super) fn in_grab(&self, grabbed: &RgbPicture, drawn: &RgbPicture) -> Vec<bool> {
        if grabbed.rgb.len() != drawn.rgb.len() {
            return vec![true; self.cells.len()];
        }
        let [changed] = self.grid.changed(&grabbed.rgb, &drawn.rgb, [HIDDEN_LEVEL]);
        let is_hidden = |(at, changed): (usize, u32)| {
            f64::from(changed) > HIDDEN_SHARE * f64::from(self.grid.values(at))
        };
        changed.into_iter().enumerate().map(is_hidden).collect()
    }

    /// The hidden rectangle, the largest if there are several.
    pub(super) fn largest(self) -> Option<Rectangle> {
        self.grid.largest(self.cells)
    }

    /// Names the cover over all windows, which `self` is, or only `under` the simulator's.
    ///
    /// # Errors
    /// Something is.
    pub(super) fn verdict(self, under: Option<Self>) -> Result<(), PixelError> {
        let window = self.window.size();
        if let Some(cover) = self.largest() {
            return Err(PixelError::ProgramOverWindow { cover, window });
        }
        match under.and_then(Self::largest) {
            Some(cover) => Err(PixelError::WindowOverScene { cover, window }),
            None => Ok(()),
        }
    }
}

/// Names the cover over a pattern on a grabbed screen, if most of the pattern is visible.
pub(super) fn cover_on_screen(
    screen: &RgbPicture,
    window: Rectangle,
    code: u32,
) -> Option<PixelError> {
    let mut part = RgbPicture::black(window.width_px, window.height_px);
    for y in 0..window.height_px {
        let row = screen.pixels(window.x_px, window.right_px(), window.y_px + y);
        part.pixels_mut(0, window.width_px, y).copy_from_slice(row);
    }
    let mut hidden = Hidden::new(window);
    let in_grab = hidden.in_grab(&part, &draw(code, window.width_px, window.height_px));
    if share_of(&in_grab) > 0.5 {
        // A different pattern, or none.
        return None;
    }
    hidden.add(&in_grab);
    hidden.verdict(None).err()
}

/// The share of cells that are hidden.
pub(super) fn share_of(hidden: &[bool]) -> f64 {
    hidden.iter().filter(|hidden| **hidden).count() as f64 / hidden.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pixels::check_pattern::both_colours;

    const WINDOW: Rectangle = Rectangle {
        x_px: 7,
        y_px: 9,
        width_px: 160,
        height_px: 96,
    };

    /// The pattern with a single-coloured rectangle over it.
    fn covered(code: u32, cover: Rectangle, colour: [u8; 3]) -> RgbPicture {
        let mut picture = draw(code, WINDOW.width_px, WINDOW.height_px);
        for y in cover.y_px..cover.bottom_px() {
            picture
                .pixels_mut(cover.x_px, cover.right_px(), y)
                .fill(colour);
        }
        picture
    }

    #[test]
    fn a_cover_of_any_colour_is_named_anywhere_in_the_window() {
        for (left, top) in [(40, 30), (60, 70), (100, 50)] {
            let cover = Rectangle::between(left, top, left + 40, top + 20);
            for colour in [[0, 0, 0], [255, 255, 255], [255, 0, 255], [128, 128, 128]] {
                let mut hidden = Hidden::new(WINDOW);
                for code in both_colours(0x1234_5678) {
                    hidden.compare(&covered(code, cover, colour), code);
                }
                let error = hidden.verdict(None).unwrap_err();
                let PixelError::ProgramOverWindow { cover: named, .. } = error else {
                    panic!("{error}");
                };
                for (edge, at) in [
                    (named.x_px, left),
                    (named.y_px, top),
                    (named.right_px(), left + 40),
                    (named.bottom_px(), top + 20),
                ] {
                    assert!(edge.abs_diff(at) <= 16, "{cover} in {colour:?}: {named}");
                }
            }
        }
    }

    #[test]
    fn what_is_hidden_only_under_the_windows_is_one_of_them() {
        let cover = Rectangle::between(40, 30, 80, 50);
        let (mut under, mut over) = (Hidden::new(WINDOW), Hidden::new(WINDOW));
        under.compare(&covered(3, cover, [90, 90, 90]), 3);
        over.compare(&draw(3, WINDOW.width_px, WINDOW.height_px), 3);
        let text = over.verdict(Some(under)).unwrap_err().to_string();
        assert!(
            text.contains("one of its plugins") && text.contains("Close it"),
            "{text}"
        );
        let whole = || {
            let mut hidden = Hidden::new(WINDOW);
            hidden.compare(&draw(3, WINDOW.width_px, WINDOW.height_px), 3);
            hidden
        };
        assert!(whole().verdict(Some(whole())).is_ok());
    }

    #[test]
    fn noise_and_weaker_contrast_hide_nothing() {
        let mut picture = draw(5, WINDOW.width_px, WINDOW.height_px);
        for (at, level) in picture.rgb.iter_mut().enumerate() {
            *level = 20 + (u32::from(*level) * 200 / 255) as u8 + (at * 7 % 13) as u8;
        }
        let mut hidden = Hidden::new(WINDOW);
        hidden.compare(&picture, 5);
        assert!(hidden.verdict(None).is_ok());
    }

    #[test]
    fn a_cover_on_the_whole_screen_is_named_unless_there_is_another_pattern() {
        let cover = Rectangle::between(40, 30, 80, 50);
        let part = covered(5, cover, [90, 90, 90]);
        let mut screen = RgbPicture::black(200, 150);
        for y in 0..WINDOW.height_px {
            screen
                .pixels_mut(WINDOW.x_px, WINDOW.right_px(), WINDOW.y_px + y)
                .copy_from_slice(part.pixels(0, WINDOW.width_px, y));
        }
        assert!(cover_on_screen(&screen, WINDOW, 5).is_some());
        assert!(cover_on_screen(&screen, WINDOW, !5).is_none());
    }
}
