//! Shift between two images by some hundred pixels, found in shrunk images: all shifts in the smallest one, then near the best.

use dataset::video::Luma;
use glam::{DVec2, IVec2};

/// Shrink factors.
const SHRINKS: [usize; 4] = [16, 8, 4, 2];
/// Maximum shift in the smallest image, in its pixels.
const REACH: i32 = 20;
/// Search around the best shift of the smaller image.
const NEAR: i32 = 2;
/// Minimum correlation of images that show the same scene.
const MIN_CORRELATION: f64 = 0.15;

/// Edges of the ground in shrunk images, from the smallest on.
#[derive(Debug, Clone)]
pub(crate) struct Coarse {
    levels: Vec<Level>,
}

#[derive(Debug, Clone)]
struct Level {
    width: usize,
    edges: Vec<i16>,
    /// Root of the sum of their squares.
    power: f64,
}

impl Coarse {
    pub(super) fn of(image: &Luma<'_>, top: usize) -> Self {
        let levels = SHRINKS.map(|shrink| Level::of(image, top, shrink));
        Self {
            levels: levels.into(),
        }
    }

    /// Shift to the other image, to about a pixel. `near_px` decides where all shifts fit equally badly; `None` if no shift fits.
    pub(super) fn shift_to(&self, other: &Self, near_px: DVec2) -> Option<DVec2> {
        let (shift_px, correlation) = self.best_shift(other, near_px)?;
        (correlation >= MIN_CORRELATION).then_some(shift_px)
    }

    /// The shift that fits best, and the correlation of edges with it.
    pub(super) fn best_shift(&self, other: &Self, near_px: DVec2) -> Option<(DVec2, f64)> {
        let mut best = (near_px / SHRINKS[0] as f64).round().as_ivec2();
        let mut correlation = 0.0;
        for (index, (from, to)) in self.levels.iter().zip(&other.levels).enumerate() {
            let (middle, reach) = match index {
                0 => (IVec2::ZERO, REACH),
                _ => (best * 2, NEAR),
            };
            let shifts = (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| (x, y)));
            let found = shifts
                .map(|(x, y)| middle + IVec2::new(x, y))
                .map(|shift| (shift, from.correlation(to, shift)))
                .max_by(|a, b| a.1.total_cmp(&b.1))?;
            (best, correlation) = found;
        }
        let shift_px = best.as_dvec2() * SHRINKS[SHRINKS.len() - 1] as f64;
        Some((shift_px, correlation))
    }
}

impl Level {
    fn of(image: &Luma<'_>, top: usize, shrink: usize) -> Self {
        let top = top.min(image.height_px);
        let (width, height) = (image.width_px / shrink, (image.height_px - top) / shrink);
        let mut light = vec![0.0_f32; width * height];
        for row in 0..height * shrink {
            let line = image.row(top + row);
            let to = &mut light[row / shrink * width..][..width];
            for (to, pixels) in to.iter_mut().zip(line.chunks_exact(shrink)) {
                *to += pixels.iter().map(|pixel| f32::from(*pixel)).sum::<f32>();
            }
        }
        let count = (shrink * shrink) as f32;
        let mut edges = vec![0.0; width * height];
        for row in 1..height.saturating_sub(1) {
            for column in 1..width.saturating_sub(1) {
                let at = row * width + column;
                let around = light[at - 1] + light[at + 1] + light[at - width] + light[at + width];
                edges[at] = (light[at] - around / 4.0) / count;
            }
        }
        // A few bright lamps must not decide alone.
        let mean = edges.iter().map(|edge| edge.abs()).sum::<f32>() / edges.len().max(1) as f32;
        let scale = 32.0 / mean.max(1e-3);
        let edges: Vec<i16> = (edges.into_iter())
            .map(|edge| (scale * edge).clamp(-127.0, 127.0) as i16)
            .collect();
        let squares: i64 = edges.iter().map(|edge| i64::from(*edge).pow(2)).sum();
        Self {
            width,
            power: (squares as f64).sqrt(),
            edges,
        }
    }

    /// Correlation with shifted edges.
    fn correlation<'a>(&'a self, to: &'a Self, shift: IVec2) -> f64 {
        let height = (self.edges.len() / self.width.max(1)) as i32;
        let width = self.width as i32;
        let mut sum = 0_i64;
        let columns = shift.x.max(0)..(width + shift.x).min(width);
        if columns.is_empty() {
            return -1.0;
        }
        for row in shift.y.max(0)..(height + shift.y).min(height) {
            let line = |edges: &'a [i16], row: i32, column: i32| {
                &edges[(row * width + column) as usize..][..columns.len()]
            };
            let here = line(&self.edges, row - shift.y, columns.start - shift.x);
            let there = line(&to.edges, row, columns.start);
            let products = here.iter().zip(there);
            let of_row: i32 = products.map(|(a, b)| i32::from(*a) * i32::from(*b)).sum();
            sum += i64::from(of_row);
        }
        sum as f64 / (self.power * to.power).max(1.0)
    }
}
