//! Detects covers over the scene in images of a resting camera.
//!
//! Input: the images in a block, and in each the rectangles that may move (aircraft, shadow, lights). Output: the rectangle of a new cover
//! over the scene: a message, a window, a notification, a pointer. The image is divided into cells of 16 x 16 pixels. A cell that a moving
//! rectangle touches is not judged.
//!
//! In a pause the scene is watched first ([`PausedScene`]), and later images may show nothing else. Where time runs ([`RunningScene`]),
//! clouds drift slowly, so an image of some seconds ago is no reference: the first seven images in which no moving object touches a cell
//! give its noise, and from then on it is covered
//!
//! - if it differs from the image just before by more than its noise, and until it looks again like before the cover;
//! - if rain or clouds changed it again and again, and suddenly it and its neighbours stand still to the last bit
//!   ([`StandingStill`]): something opaque that came in too gradually to be noticed.
//!
//! An object that lay over the scene from the first image on counts as part of it; when it goes, the scene differs from the beginning and
//! is called covered. The two cases cannot be distinguished here, so the caller shows a check pattern: in a paused world after the scene
//! was watched; where time runs after the last image.

mod paused;
mod standing_still;
#[cfg(test)]
mod tests;
mod watch;

use standing_still::StandingStill;

use super::Rectangle;
use super::cell_grid::Grid;
pub(crate) use paused::PausedScene;
pub(crate) use watch::{CoverWatch, Covered};

/// Motion of the world between two images.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum WorldTime {
    Paused,
    /// Clouds drift and rain falls.
    Runs,
}

/// Something that covers the scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Cover {
    /// Covered rectangle, to the cell.
    pub(crate) rectangle: Rectangle,
    /// Number of images before this one that may show it as well, although they were accepted.
    pub(crate) pictures_before: u32,
}

/// Covered cells through which something moves cannot be judged. They count as covered until the others are seen to be free, or for some
/// time if there are no others.
#[derive(Debug, Clone, Copy, Default)]
struct HiddenCover {
    /// Number of images in which no part of the cover could be judged.
    looks: u32,
}

impl HiddenCover {
    /// True if the `hidden` ones among the `covered` cells no longer count. `released`: others were seen to be free.
    fn has_gone(&mut self, hidden: usize, covered: usize, released: bool) -> bool {
        let has_judged = hidden == 0 || covered > hidden;
        let looks = if has_judged { 0 } else { self.looks + 1 };
        let has_gone = !has_judged && (released || looks > MAX_HIDDEN_LOOKS);
        self.looks = if has_gone { 0 } else { looks };
        has_gone
    }
}

/// Comparisons from which a cell's noise is learnt: one less than images.
const LEARNT: usize = 6;
/// Rank of the comparison that counts, by size: an object that comes and goes meanwhile shows in two comparisons and must not pass for
/// noise.
const TYPICAL: usize = LEARNT - 3;

#[derive(Debug, Clone, Copy, Default)]
struct Cell {
    /// True if the kept images show the scene here, and not the aircraft.
    known: bool,
    /// The first comparisons with the image before: values that changed, and that changed at least half as much; and how much brighter
    /// or darker they are in the mean.
    changes: [(u32, u32); LEARNT],
    shifts: [f64; LEARNT],
    /// Number of comparisons.
    learnt: usize,
    /// Changed values, and shift of their mean, from image to image: as learnt, or recent where time runs.
    noise: f64,
    shift: f64,
    /// True if these, and the image before, date from before something moved through the cell.
    outdated: bool,
    covered: bool,
}

impl Cell {
    fn is_learning(&self) -> bool {
        self.learnt < LEARNT
    }

    /// Learns from a comparison with the image before: values that changed, and those that changed at least half as much.
    fn learn(&mut self, changed: (u32, u32), before: f64, now: f64) {
        self.changes[self.learnt] = changed;
        self.shifts[self.learnt] = (now - before).abs();
        self.learnt += 1;
    }

    /// Ends the learning. Returns true if something came, and perhaps went, meanwhile.
    fn has_learnt(&mut self, values: u32) -> bool {
        let mut changes = self.changes.map(|(_, at_least_half)| at_least_half);
        changes.sort_unstable();
        let mut shifts = self.shifts;
        shifts.sort_by(f64::total_cmp);
        (self.noise, self.shift) = (f64::from(changes[TYPICAL]), shifts[TYPICAL]);
        // In a cell that changes too much by itself, single comparisons are no evidence.
        let is_restless = self.noise > f64::from(values) * RESTLESS_SHARE;
        !is_restless && self.jumped_while_learning(values)
    }

    fn jumped_while_learning(&self, values: u32) -> bool {
        let mut noise = f64::from(self.changes[0].1.min(self.changes[1].1));
        self.changes.into_iter().any(|(changed, at_least_half)| {
            let jumped = f64::from(changed) > allowed(noise, values);
            noise = f64::from(at_least_half).max(FADING * noise);
            jumped
        })
    }

    /// The most that its mean may shift.
    fn allowed_shift(&self) -> f64 {
        2.0 * self.shift + SHIFT_LEVELS
    }

    /// Takes the noise from recent images, since clouds come and go.
    fn follow(&mut self, changed: f64, shift: f64) {
        self.noise = changed.max(FADING * self.noise);
        self.shift = shift.max(FADING * self.shift);
    }
}

/// Accepted shift of a cell's mean beyond the scene's own changes, levels.
const SHIFT_LEVELS: f64 = 6.0;
/// Share of the previous image's noise that still counts.
const FADING: f64 = 0.9;
/// Share of the cover threshold at which a covered cell's neighbour counts as partly covered.
const PARTLY: f64 = 0.3;
/// Images for which a cover counts that only the aircraft hides: two seconds of 60 frames.
const MAX_HIDDEN_LOOKS: u32 = 120;
/// Share of changed values below which the shift of the mean is not worth its computation.
const MIN_CHANGED_SHARE: f64 = 0.1;

/// A value (a pixel's byte) that differs by no more has not changed: streaks of rain change a few pixels per cell by up to a tenth of the
/// way to their own grey.
const LEVEL: u8 = 8;
/// Minimum share of changed values in a covered cell, beyond its noise.
const COVERED_SHARE: f64 = 0.33;
/// Maximum share of values that the scene itself changes in a calm cell.
const RESTLESS_SHARE: f64 = 0.25;

/// Maximum changed values in a cell with this noise that is not covered.
fn allowed(noise: f64, values: u32) -> f64 {
    1.5 * noise + f64::from(values) * COVERED_SHARE
}

/// The scene before a resting camera while time runs.
#[derive(Debug)]
pub(crate) struct RunningScene {
    grid: Grid,
    cells: Vec<Cell>,
    /// The scene uncovered: the last image before the cover.
    uncovered: Vec<u8>,
    /// The last image, where it is needed.
    latest: Vec<u8>,
    /// True until the first image has been examined.
    is_new: bool,
    hidden: HiddenCover,
    standing_still: StandingStill,
}

impl RunningScene {
    /// A scene of images of this size, before its first image.
    pub(crate) fn new(width_px: u32, height_px: u32) -> Self {
        let grid = Grid::new(width_px, height_px);
        Self {
            cells: vec![Cell::default(); grid.cells()],
            uncovered: vec![0; grid.bytes()],
            latest: vec![0; grid.bytes()],
            is_new: true,
            hidden: HiddenCover::default(),
            standing_still: StandingStill::new(grid.cells()),
            grid,
        }
    }

    /// Begins with an image, as if it were the first one.
    ///
    /// # Panics If the image size differs.
    pub(crate) fn begin_with(&mut self, rgb: &[u8], moving: &[Rectangle]) {
        assert_eq!(rgb.len(), self.grid.bytes(), "an image of another size");
        self.uncovered.copy_from_slice(rgb);
        self.latest.copy_from_slice(rgb);
        for (cell, touched) in self.cells.iter_mut().zip(self.grid.touched(moving)) {
            *cell = Cell {
                known: !touched,
                ..Cell::default()
            };
        }
        self.standing_still = StandingStill::new(self.cells.len());
        self.hidden = HiddenCover::default();
        self.is_new = false;
    }

    /// The next image comes later than its neighbours usually do, and clouds have drifted by an unknown amount: each cell is compared anew,
    /// and a cover that came meanwhile is noticed when it goes.
    pub(crate) fn after_gap(&mut self) {
        for cell in &mut self.cells {
            cell.outdated = true;
        }
    }

    /// Checks the next image. `moving` are the rectangles that may differ from image to image; they may reach beyond the image.
    ///
    /// # Errors
    /// Something covers the scene. The image must not be used, nor [`Cover::pictures_before`] images before it.
    ///
    /// # Panics If the image size differs.
    pub(crate) fn look(&mut self, rgb: &[u8], moving: &[Rectangle]) -> Result<(), Cover> {
        assert_eq!(rgb.len(), self.grid.bytes(), "an image of another size");
        if self.is_new {
            self.begin_with(rgb, moving);
            return Ok(());
        }
        let touched = self.grid.touched(moving);
        let [beyond_level, beyond_half, differing] =
            (self.grid).changed(rgb, &self.latest, [LEVEL, LEVEL / 2, 0]);
        let differs: Vec<bool> = differing.iter().map(|values| *values > 0).collect();
        let standing = self.standing_still.look(&self.grid, &differs, &touched);
        if !differs.contains(&true) {
            // The same frame once more: it adds no information.
            return self.verdict(&[], standing);
        }
        let (mut came_while_learning, mut still_covered) = (Vec::new(), Vec::new());
        let (mut learning, mut renewed) = (Vec::new(), Vec::new());
        let (was_covered, mut jumped_again) = (self.is_covered(), 0);
        let (mut hidden, mut newly_covered, mut released) = (Vec::new(), Vec::new(), false);
        for (at, is_touched) in touched.iter().enumerate() {
            if *is_touched && self.cells[at].covered {
                hidden.push(at);
                continue;
            }
            if *is_touched || self.standing_still.is_near_cover(&self.grid, at) {
                self.set_aside(at);
                continue;
            }
            if !self.cells[at].known {
                continue;
            }
            let before = self.cells[at];
            let changed = (beyond_level[at], beyond_half[at]);
            let jumped = self.jumps(at, rgb, changed);
            if before.is_learning() {
                learning.push(at);
                if jumped {
                    came_while_learning.push(at);
                }
            } else if before.outdated {
                renewed.push(at);
            } else if before.covered && self.cells[at].covered {
                still_covered.push(at);
                jumped_again += usize::from(jumped);
            } else if self.cells[at].covered {
                newly_covered.push(at);
            }
            released |= before.covered && !self.cells[at].covered;
        }
        self.grow(newly_covered, &beyond_level);
        if 2 * jumped_again > still_covered.len() && self.is_as_before(rgb, &still_covered) {
            for at in still_covered {
                self.set_aside(at);
            }
            released = true;
        }
        let covered = self.cells.iter().filter(|cell| cell.covered).count();
        if self.hidden.has_gone(hidden.len(), covered, released) {
            for at in hidden {
                self.set_aside(at);
            }
        }
        if was_covered || self.is_covered() {
            self.learn_nothing(&learning, &renewed);
        } else {
            for (at, is_touched) in touched.iter().enumerate() {
                if !is_touched && !self.cells[at].known {
                    self.grid.copy_cell(at, rgb, &mut self.uncovered);
                    self.cells[at].known = true;
                }
            }
        }
        self.latest.copy_from_slice(rgb);
        self.verdict(&came_while_learning, standing)
    }

    /// True if a cell changed suddenly: in this image, or while its noise was learnt.
    fn jumps(&mut self, at: usize, rgb: &[u8], (changed, at_least_half): (u32, u32)) -> bool {
        let values = self.grid.values(at);
        let is_learning = self.cells[at].is_learning();
        let (mut before, mut now) = (0.0, 0.0);
        if is_learning || f64::from(at_least_half) > MIN_CHANGED_SHARE * f64::from(values) {
            before = self.grid.mean(at, &self.latest);
            now = self.grid.mean(at, rgb);
        }
        let since_uncovered =
            || f64::from(self.grid.changed_in_cell(at, rgb, &self.uncovered, LEVEL));
        let cell = &mut self.cells[at];
        if is_learning {
            if std::mem::take(&mut cell.outdated) {
                return false;
            }
            cell.learn((changed, at_least_half), before, now);
            let came = !cell.is_learning() && cell.has_learnt(values);
            // The cover that came may have gone again.
            cell.covered = came && since_uncovered() > allowed(cell.noise, values);
            return came;
        }
        let shift = (now - before).abs();
        if std::mem::take(&mut cell.outdated) {
            (cell.noise, cell.shift) = (f64::from(at_least_half), shift);
            return false;
        }
        let allowed = allowed(cell.noise, values);
        let jumped = f64::from(changed) > allowed || shift > cell.allowed_shift();
        if cell.covered {
            let shift = (self.grid.mean(at, rgb) - self.grid.mean(at, &self.uncovered)).abs();
            cell.covered = since_uncovered() > allowed || shift > cell.allowed_shift();
        } else if jumped {
            cell.covered = true;
        } else {
            // Half the level: a gentle slope that grows steeper must not pass the level in a whole cell at once.
            cell.follow(f64::from(at_least_half), shift);
        }
        jumped
    }

    /// Remembers how newly covered cells looked before, and covers those beside them that changed less: they would be taken for a new
    /// cover when this one goes.
    fn grow(&mut self, newly_covered: Vec<usize>, changed: &[u32]) {
        let mut cells = newly_covered.clone();
        for at in newly_covered {
            for beside in self.grid.around(at) {
                let values = self.grid.values(beside);
                let cell = &mut self.cells[beside];
                let allowed = allowed(cell.noise, values);
                let may_be = cell.known && !cell.covered && !cell.is_learning();
                if may_be && f64::from(changed[beside]) > PARTLY * allowed {
                    cell.covered = true;
                    cells.push(beside);
                }
            }
        }
        for at in cells {
            self.grid.copy_cell(at, &self.latest, &mut self.uncovered);
        }
    }

    /// True if cells look more like before the cover than like in the last image, although clouds may have drifted meanwhile.
    fn is_as_before(&self, rgb: &[u8], cells: &[usize]) -> bool {
        let distance = |other: &[u8]| -> u64 {
            let cells = cells.iter();
            cells.map(|at| self.grid.distance(*at, rgb, other)).sum()
        };
        distance(&self.uncovered) < distance(&self.latest)
    }

    /// Discards noise learnt from images with a cover, or from the first one without it: they are no evidence for cells that were learning
    /// or renewing their noise.
    fn learn_nothing(&mut self, learning: &[usize], renewed: &[usize]) {
        for at in learning {
            let cell = &mut self.cells[*at];
            if cell.is_learning() {
                cell.learnt = cell.learnt.saturating_sub(1);
            }
        }
        for at in renewed {
            self.set_aside(*at);
        }
    }

    /// Marks a cell as not judged: the kept images do not show the scene there any more.
    fn set_aside(&mut self, at: usize) {
        let cell = &mut self.cells[at];
        cell.covered = false;
        cell.known = false;
        cell.outdated = true;
    }

    fn is_covered(&self) -> bool {
        self.cells.iter().any(|cell| cell.covered)
    }

    /// Names what covers the scene now, or did while the noise of some cells was learnt.
    fn verdict(&self, came_while_learning: &[usize], standing: Option<Cover>) -> Result<(), Cover> {
        let mut cells: Vec<bool> = self.cells.iter().map(|cell| cell.covered).collect();
        for at in came_while_learning {
            cells[*at] = true;
        }
        let appeared = self.grid.largest(cells).map(|rectangle| Cover {
            rectangle,
            pictures_before: if came_while_learning.is_empty() {
                0
            } else {
                LEARNT as u32
            },
        });
        standing.or(appeared).map_or(Ok(()), Err)
    }
}
