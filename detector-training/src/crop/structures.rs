//! Things on the ground that are no aircraft: masts, signs on poles, buildings.
//!
//! Input: the side of a crop and a random number generator. Output: upright rectangles with a brightness. The stand-in has none of
//! them, and a detector that never saw one takes it for an aircraft.

use rand::{Rng, RngExt};

/// Rectangle edges, pixels in a crop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Rectangle {
    left: f32,
    top: f32,
    right: f32,
    bottom: f32,
    /// Colour, 0 to 1.
    pub colour: [f32; 3],
}

impl Rectangle {
    /// Part of the pixel that is inside, 0 to 1.
    pub(crate) fn cover(&self, x: usize, y: usize) -> f32 {
        let part = |at: f32, low: f32, high: f32| {
            ((at + 0.5).min(high) - (at - 0.5).max(low)).clamp(0.0, 1.0)
        };
        part(x as f32, self.left, self.right) * part(y as f32, self.top, self.bottom)
    }

    /// The rows and columns that it may touch in a crop.
    pub(crate) fn pixels(&self, side_px: usize) -> impl Iterator<Item = (usize, usize)> + use<> {
        let span = |low: f32, high: f32| {
            let edge = |at: f32| (at.max(0.0) as usize).min(side_px);
            edge((low - 0.5).floor())..edge((high + 0.5).ceil() + 1.0)
        };
        let (rows, columns) = (span(self.top, self.bottom), span(self.left, self.right));
        rows.flat_map(move |y| columns.clone().map(move |x| (x, y)))
    }
}

/// A random structure, farthest parts first.
pub(crate) fn random_structure(side_px: usize, rng: &mut impl Rng) -> Vec<Rectangle> {
    let side = side_px as f32;
    let foot = [
        rng.random_range(0.0..side),
        rng.random_range(0.3 * side..1.5 * side),
    ];
    match rng.random_range(0..3) {
        0 => mast(foot, side, rng),
        1 => sign(foot, rng),
        _ => building(foot, side, rng),
    }
}

/// A pole with up to three crossbars; some are banded red and white.
fn mast([x, foot]: [f32; 2], side: f32, rng: &mut impl Rng) -> Vec<Rectangle> {
    let half = rng.random_range(0.4..4.0);
    let top = foot - rng.random_range(0.2..1.4) * side;
    let colour = paint(rng);
    let pole = Rectangle {
        left: x - half,
        right: x + half,
        top,
        bottom: foot,
        colour,
    };
    let mut parts = vec![pole];
    if rng.random_bool(0.3) {
        let band = rng.random_range(4.0..20.0);
        let bands = ((foot - top) / band) as usize;
        parts.extend((0..bands).step_by(2).map(|k| Rectangle {
            top: top + k as f32 * band,
            bottom: top + (k + 1) as f32 * band,
            colour: [0.75, 0.2, 0.15],
            ..pole
        }));
    }
    for _ in 0..rng.random_range(0..=3) {
        let (reach, thick) = (rng.random_range(2.0..24.0), rng.random_range(0.5..2.0));
        let at = top + rng.random_range(0.0..0.5) * (foot - top);
        parts.push(Rectangle {
            left: x - reach,
            right: x + reach,
            top: at - thick,
            bottom: at + thick,
            colour,
        });
    }
    parts
}

/// A plate on one or two poles.
fn sign([x, foot]: [f32; 2], rng: &mut impl Rng) -> Vec<Rectangle> {
    let (half_width, height) = (rng.random_range(4.0..40.0), rng.random_range(3.0..24.0));
    let top = foot - height - rng.random_range(2.0..40.0);
    let (pole, plate) = (paint(rng), paint(rng));
    let thick = rng.random_range(0.4..2.0);
    let feet: &[f32] = if rng.random_bool(0.5) {
        &[0.0]
    } else {
        &[-0.7, 0.7]
    };
    let mut parts: Vec<Rectangle> = feet
        .iter()
        .map(|foot_at| Rectangle {
            left: x + foot_at * half_width - thick,
            right: x + foot_at * half_width + thick,
            top: top + height,
            bottom: foot,
            colour: pole,
        })
        .collect();
    parts.push(Rectangle {
        left: x - half_width,
        right: x + half_width,
        top,
        bottom: top + height,
        colour: plate,
    });
    parts
}

/// A block with rows of windows.
fn building([x, foot]: [f32; 2], side: f32, rng: &mut impl Rng) -> Vec<Rectangle> {
    let (half_width, height) = (
        rng.random_range(0.05..0.5) * side,
        rng.random_range(0.08..0.7) * side,
    );
    let wall = Rectangle {
        left: x - half_width,
        right: x + half_width,
        top: foot - height,
        bottom: foot,
        colour: paint(rng),
    };
    let mut parts = vec![wall];
    let (across, down) = (rng.random_range(4.0..16.0), rng.random_range(4.0..16.0));
    let (wide, tall) = (
        across * rng.random_range(0.3..0.9),
        down * rng.random_range(0.3..0.8),
    );
    let colour = paint(rng);
    if rng.random_bool(0.7) {
        let columns = (2.0 * half_width / across) as usize;
        let rows = (height / down) as usize;
        parts.extend((0..rows * columns).map(|k| {
            let left = wall.left + 0.2 * across + (k % columns) as f32 * across;
            let top = wall.top + 0.2 * down + (k / columns) as f32 * down;
            Rectangle {
                left,
                right: (left + wide).min(wall.right),
                top,
                bottom: (top + tall).min(wall.bottom),
                colour,
            }
        }));
    }
    parts
}

/// A grey of any brightness with a little colour.
fn paint(rng: &mut impl Rng) -> [f32; 3] {
    let grey = rng.random_range(0.05..0.95);
    std::array::from_fn(|_| (grey + rng.random_range(-0.08_f32..0.08)).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn a_rectangle_covers_whole_and_broken_pixels_by_its_area() {
        let rectangle = Rectangle {
            left: 1.5,
            right: 4.0,
            top: 0.5,
            bottom: 1.25,
            colour: [0.5; 3],
        };
        let area: f32 = rectangle
            .pixels(8)
            .map(|(x, y)| rectangle.cover(x, y))
            .sum();
        assert!((area - 2.5 * 0.75).abs() < 1e-5, "{area}");
        assert_eq!(rectangle.cover(2, 0), 0.0);
        assert_eq!(rectangle.cover(2, 1), 0.75);
    }

    #[test]
    fn structures_are_of_every_kind_and_mostly_reach_into_the_crop() {
        let mut rng = ChaCha8Rng::seed_from_u64(8);
        let reaching = (0..200)
            .filter(|_| {
                let parts = random_structure(128, &mut rng);
                parts
                    .iter()
                    .any(|part| part.pixels(128).any(|(x, y)| part.cover(x, y) > 0.5))
            })
            .count();
        assert!(reaching > 120, "{reaching}");
    }
}
