//! The scene in a pause: the range of each value while nothing covered it, and the cells that leave it.
//!
//! Most scenes stand still in a pause, and their ranges have no width. Water has other values in every image. Trees, flags and lights may
//! swing in seconds; whoever watches them for longer than their period knows all that they will show.

use super::{Cover, HiddenCover};
use crate::pixels::Rectangle;
use crate::pixels::cell_grid::Grid;

/// A value leaves its range by more than this, levels: a screen repeats every bit.
const BEYOND_LEVELS: u8 = 2;
/// Minimum share of a cell's values that do, in a covered cell.
const COVERED_SHARE: f64 = 0.125;
/// A cell whose mean range is wider may hide a cover, levels.
const WIDE_LEVELS: f64 = 40.0;
/// Maximum share of such cells: a cover of two percent of the image, the smallest that is to be found, meets others as well.
const MAX_WIDE_SHARE: f64 = 0.1;

#[derive(Debug, Clone, Copy, Default)]
struct Cell {
    /// Images that were watched.
    watched: u32,
    covered: bool,
}

/// The scene before a resting camera in a pause.
#[derive(Debug)]
pub(crate) struct PausedScene {
    grid: Grid,
    /// The range of each value.
    low: Vec<u8>,
    high: Vec<u8>,
    cells: Vec<Cell>,
    /// The last image that was watched, and the cells that something moved through.
    latest: Vec<u8>,
    latest_touched: Vec<bool>,
    /// Images that a cell has to be watched in before it is judged.
    needed: u32,
    hidden: HiddenCover,
}

impl PausedScene {
    /// A scene of images of this size, before its first image.
    pub(crate) fn new(width_px: u32, height_px: u32) -> Self {
        let grid = Grid::new(width_px, height_px);
        Self {
            low: vec![0; grid.bytes()],
            high: vec![0; grid.bytes()],
            cells: vec![Cell::default(); grid.cells()],
            latest: Vec::new(),
            latest_touched: Vec::new(),
            needed: 1,
            hidden: HiddenCover::default(),
            grid,
        }
    }

    /// Forgets what was watched.
    pub(crate) fn forget(&mut self) {
        self.cells.fill(Cell::default());
        self.high.copy_from_slice(&self.low);
        (self.needed, self.hidden) = (1, HiddenCover::default());
    }

    /// Watches an image that is not judged.
    ///
    /// # Panics If the image size differs.
    pub(crate) fn watch(&mut self, rgb: &[u8], moving: &[Rectangle]) {
        assert_eq!(rgb.len(), self.grid.bytes(), "an image of another size");
        let touched = self.grid.touched(moving);
        for (at, is_touched) in touched.iter().enumerate() {
            if !is_touched {
                self.widen(at, rgb);
                self.needed = self.needed.max(self.cells[at].watched);
            }
        }
        self.latest.clear();
        self.latest.extend_from_slice(rgb);
        self.latest_touched = touched;
    }

    /// The scene is at rest: what was watched before the last image was its settling.
    pub(crate) fn keep_latest(&mut self) {
        self.forget();
        for at in 0..self.latest_touched.len() {
            if !self.latest_touched[at] {
                self.grid.copy_cell(at, &self.latest, &mut self.low);
                self.grid.copy_cell(at, &self.latest, &mut self.high);
                self.cells[at].watched = 1;
            }
        }
    }

    /// True if anything changed while it was watched.
    pub(crate) fn moves(&self) -> bool {
        self.low != self.high
    }

    /// True if many cells' values range so widely that a cover could hide there.
    pub(crate) fn moves_too_much(&self) -> bool {
        let is_wide = |at: &usize| {
            let width = self.grid.distance(*at, &self.high, &self.low);
            width as f64 > WIDE_LEVELS * f64::from(self.grid.values(*at))
        };
        let wide = (0..self.cells.len()).filter(is_wide).count();
        wide as f64 > MAX_WIDE_SHARE * self.cells.len() as f64
    }

    /// Checks the next image. `moving` are the rectangles that may differ from image to image; they may reach beyond the image.
    ///
    /// # Errors
    /// Something covers the scene, or it moves as it never did while it was watched.
    ///
    /// # Panics If the image size differs.
    pub(crate) fn look(&mut self, rgb: &[u8], moving: &[Rectangle]) -> Result<(), Cover> {
        assert_eq!(rgb.len(), self.grid.bytes(), "an image of another size");
        let touched = self.grid.touched(moving);
        let [beyond] = self
            .grid
            .beyond(rgb, (&self.low, &self.high), [BEYOND_LEVELS]);
        let was_covered = self.cells.iter().any(|cell| cell.covered);
        let (mut hidden, mut released) = (Vec::new(), false);
        for (at, is_touched) in touched.iter().enumerate() {
            let most = COVERED_SHARE * f64::from(self.grid.values(at));
            let cell = &mut self.cells[at];
            if cell.watched < self.needed {
                continue;
            }
            if *is_touched {
                // What was watched still holds when the aircraft has passed.
                if cell.covered {
                    hidden.push(at);
                }
                continue;
            }
            let covered = f64::from(beyond[at]) > most;
            released |= cell.covered && !covered;
            cell.covered = covered;
        }
        let covered = self.cells.iter().filter(|cell| cell.covered).count();
        if self.hidden.has_gone(hidden.len(), covered, released) {
            for at in hidden {
                self.cells[at].covered = false;
            }
        }
        let covered: Vec<bool> = self.cells.iter().map(|cell| cell.covered).collect();
        if let Some(rectangle) = self.grid.largest(covered) {
            return Err(Cover {
                rectangle,
                pictures_before: 0,
            });
        }
        if !was_covered {
            for (at, is_touched) in touched.into_iter().enumerate() {
                if !is_touched && self.cells[at].watched < self.needed {
                    self.widen(at, rgb);
                }
            }
        }
        Ok(())
    }

    fn widen(&mut self, at: usize, rgb: &[u8]) {
        let cell = &mut self.cells[at];
        if cell.watched == 0 {
            self.grid.copy_cell(at, rgb, &mut self.low);
            self.grid.copy_cell(at, rgb, &mut self.high);
        } else {
            self.grid.widen_cell(at, rgb, &mut self.low, &mut self.high);
        }
        cell.watched += 1;
    }
}
