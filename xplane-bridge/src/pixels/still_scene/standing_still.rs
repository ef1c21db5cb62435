//! Regions that stand still to the last bit while everything around them moves.
//!
//! Rain changes a cell in some share of the images. The longer it has not changed, the less likely is that by chance: with a share `r`, `m`
//! images have the probability `(1 - r)^m`. A group of cells that stopped at the same image is a cover if the product over its cells is so
//! small that no group anywhere in many thousand images would reach it. Clouds change a cell more often, but they pass: expectations follow
//! the calmer cells, which rain alone changes.

use super::Cover;
use crate::pixels::cell_grid::Grid;

/// For how many images a cell must stand still.
const MIN_STILL: u32 = 6;
/// Number of earlier images needed to know how often a cell changes.
const MIN_SEEN: u32 = 30;
/// A cover that comes gradually is complete within this many images.
const COMES_WITHIN: u32 = 30;
/// Evidence (minus the logarithm of a probability) beyond chance: for any group, and more per cell, since large groups are more numerous.
const BEYOND_CHANCE: (f64, f64) = (40.0, 2.5);
/// Share of the usual changes below which the world has stopped, and the image is no evidence.
const STOPPED: f64 = 0.25;

#[derive(Debug, Clone, Copy, Default)]
struct History {
    seen: u32,
    changed: u32,
    /// Images since the last change.
    still: u32,
}

impl History {
    /// The share of images that changed it before it stood still.
    fn share(self) -> f64 {
        let seen = f64::from(self.seen - self.still);
        f64::from(self.changed) / (seen + 2.0)
    }

    /// True if it is known how often it changes.
    fn is_known(self) -> bool {
        self.seen - self.still >= MIN_SEEN
    }

    /// Evidence against standing still by chance (minus the logarithm of its probability), given the share of images in which calmer cells
    /// change; zero while there is too little evidence.
    fn surprise(self, calm_share: f64) -> f64 {
        if self.still < MIN_STILL || !self.is_known() {
            return 0.0;
        }
        -f64::from(self.still) * (1.0 - self.share().min(calm_share)).ln()
    }
}

/// Change history per cell, and the cells that are part of a cover.
#[derive(Debug)]
pub(super) struct StandingStill {
    histories: Vec<History>,
    /// Cells of covers.
    covered: Vec<bool>,
}

impl StandingStill {
    pub(super) fn new(cells: usize) -> Self {
        Self {
            histories: vec![History::default(); cells],
            covered: vec![false; cells],
        }
    }

    /// True if a cell is part of a cover or beside one, and may be partly covered.
    pub(super) fn is_near_cover(&self, grid: &Grid, at: usize) -> bool {
        grid.around(at).any(|beside| self.covered[beside])
    }

    /// Notes the cells that differ from the image before, and names a region that is found or still stands.
    pub(super) fn look(
        &mut self,
        grid: &Grid,
        differs: &[bool],
        touched: &[bool],
    ) -> Option<Cover> {
        for (covered, (differs, touched)) in
            self.covered.iter_mut().zip(differs.iter().zip(touched))
        {
            *covered &= !differs && !touched;
        }
        let mut still = None;
        if !self.world_has_stopped(differs, touched) {
            self.count(differs, touched);
            still = self.find(grid);
        }
        Some(Cover {
            rectangle: grid.largest(self.covered.clone())?,
            pictures_before: still.map_or(0, |still| still - 1 + COMES_WITHIN),
        })
    }

    fn count(&mut self, differs: &[bool], touched: &[bool]) {
        let seen = differs.iter().zip(touched);
        for (history, (differs, touched)) in self.histories.iter_mut().zip(seen) {
            if *touched {
                history.still = 0;
                continue;
            }
            history.seen += 1;
            history.changed += u32::from(*differs);
            history.still = if *differs { 0 } else { history.still + 1 };
        }
    }

    fn world_has_stopped(&self, differs: &[bool], touched: &[bool]) -> bool {
        let (mut usual, mut found) = (0.0, 0.0);
        for (at, history) in self.histories.iter().enumerate() {
            if !touched[at] && !self.covered[at] {
                usual += history.share();
                found += f64::from(u8::from(differs[at]));
            }
        }
        found < STOPPED * usual
    }

    /// Marks the cells of covers; since how many images the oldest of the new ones stands.
    fn find(&mut self, grid: &Grid) -> Option<u32> {
        // Cells of the cover that happened to be still before it came.
        for at in 0..grid.cells() {
            if self.histories[at].still >= MIN_STILL && self.is_near_cover(grid, at) {
                self.covered[at] = true;
            }
        }
        let calm_share = self.calm_share();
        let mut left = self.squares(grid, calm_share);
        let mut oldest = None;
        for at in 0..left.len() {
            if !left[at] {
                continue;
            }
            let still = self.histories[at].still;
            let group = grid.connected(at, &mut left, |_, beside| {
                self.histories[beside].still == still
            });
            let surprises = group
                .iter()
                .map(|at| self.histories[*at].surprise(calm_share));
            let surprise: f64 = surprises.sum();
            let (any, each) = BEYOND_CHANCE;
            if surprise > any + each * group.len() as f64 {
                oldest = oldest.max(Some(still));
                for at in group {
                    self.covered[at] = true;
                }
            }
        }
        oldest
    }

    /// Lower quartile of the cells' shares of changed images.
    fn calm_share(&self) -> f64 {
        let known = self.histories.iter().filter(|history| history.is_known());
        let mut shares: Vec<f64> = known.map(|history| history.share()).collect();
        let calm = shares.len() / 4;
        if shares.is_empty() {
            return 0.0;
        }
        *shares.select_nth_unstable_by(calm, f64::total_cmp).1
    }

    /// Cells in squares of 2 x 2 that stopped together. A passing cloud's edge leaves single rows of cells.
    fn squares(&self, grid: &Grid, calm_share: f64) -> Vec<bool> {
        let mut squares = vec![false; grid.cells()];
        for row in 1..grid.rows {
            for column in 1..grid.columns {
                let last = row * grid.columns + column;
                let square = [last, last - 1, last - grid.columns, last - grid.columns - 1];
                let still = self.histories[last].still;
                let together = |at: &usize| {
                    let history = self.histories[*at];
                    !self.covered[*at]
                        && history.still == still
                        && history.surprise(calm_share) > 0.0
                };
                if still >= MIN_STILL && square.iter().all(together) {
                    for at in square {
                        squares[at] = true;
                    }
                }
            }
        }
        squares
    }
}
