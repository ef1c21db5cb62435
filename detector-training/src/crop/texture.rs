//! Random texture, as clouds have it: several octaves of noise, stretched in one direction.
//!
//! Input: ranges and a random number generator. Output: a square of numbers with mean 0 and root mean square 1. Every octave is value
//! noise (Perlin, 1985): random numbers on a grid, interpolated smoothly.

use std::ops::RangeInclusive;

use rand::{Rng, RngExt};

/// Side of the table of random numbers that a grid repeats.
const TABLE_SIDE: usize = 64;
/// Amplitude per octave relative to the next coarser one.
const PERSISTENCE: RangeInclusive<f32> = 0.3..=0.8;
/// Share of textures that lie within [`LEVEL_RAD`] of the horizontal, as most layered clouds do, and as wings do.
const LEVEL_SHARE: f64 = 0.5;
const LEVEL_RAD: f32 = 0.2;
const MAX_OCTAVES: usize = 5;

/// Texture shape.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Texture {
    /// Size of the coarsest features across the stretch, pixels.
    pub(crate) coarsest_px: f32,
    /// Size of the finest features, pixels.
    pub(crate) finest_px: f32,
    /// Amplitude per octave relative to the next coarser one.
    pub(crate) persistence: f32,
    /// Feature length relative to its width.
    pub(crate) stretch: f32,
    /// Direction of the stretch, clockwise from right.
    pub(crate) direction_rad: f32,
}

impl Texture {
    /// A random shape. Sizes and stretches are drawn by their logarithms.
    pub(crate) fn random(
        feature_px: &RangeInclusive<f32>,
        largest_stretch: f32,
        rng: &mut impl Rng,
    ) -> Self {
        let mut between = |low: f32, high: f32| low * (high / low).powf(rng.random::<f32>());
        let coarsest_px = between(*feature_px.start(), *feature_px.end());
        let finest_px = between(*feature_px.start(), coarsest_px);
        let stretch = between(1.0, largest_stretch);
        let direction_rad = if rng.random_bool(LEVEL_SHARE) {
            rng.random_range(-LEVEL_RAD..=LEVEL_RAD)
        } else {
            rng.random_range(0.0..std::f32::consts::PI)
        };
        Self {
            coarsest_px,
            finest_px,
            persistence: rng.random_range(PERSISTENCE),
            stretch,
            direction_rad,
        }
    }

    /// `side_px * side_px` numbers, row-major, with mean 0 and root mean square 1.
    pub(crate) fn field(&self, side_px: usize, rng: &mut impl Rng) -> Vec<f32> {
        let mut field = vec![0.0; side_px * side_px];
        let (mut feature_px, mut amplitude) = (self.coarsest_px, 1.0);
        for _ in 0..MAX_OCTAVES {
            self.add_octave(&mut field, side_px, feature_px, amplitude, rng);
            feature_px *= 0.5;
            amplitude *= self.persistence;
            if feature_px < self.finest_px {
                break;
            }
        }
        let count = field.len().max(1) as f32;
        let mean = field.iter().sum::<f32>() / count;
        let square = field.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / count;
        let scale = 1.0 / square.sqrt().max(f32::MIN_POSITIVE);
        for value in &mut field {
            *value = (*value - mean) * scale;
        }
        field
    }

    fn add_octave(
        &self,
        field: &mut [f32],
        side_px: usize,
        feature_px: f32,
        amplitude: f32,
        rng: &mut impl Rng,
    ) {
        let table: Vec<f32> = (0..TABLE_SIDE * TABLE_SIDE)
            .map(|_| amplitude * rng.random_range(-1.0..1.0))
            .collect();
        let (sin, cos) = self.direction_rad.sin_cos();
        let (along, across) = (1.0 / (feature_px * self.stretch), 1.0 / feature_px);
        // Positive everywhere in the square, so that truncation rounds down.
        let far = 2.0 * side_px as f32;
        let start = [far * along, far * across].map(|least| least.ceil() + rng.random::<f32>());
        let smooth = |t: f32| t * t * (3.0 - 2.0 * t);
        for (y, line) in field.chunks_exact_mut(side_px).enumerate() {
            for (x, value) in line.iter_mut().enumerate() {
                let (x, y) = (x as f32, y as f32);
                let u = start[0] + (x * cos + y * sin) * along;
                let v = start[1] + (y * cos - x * sin) * across;
                let (column, row) = (u as usize, v as usize);
                let (right, down) = (smooth(u - column as f32), smooth(v - row as f32));
                let at = |c: usize, r: usize| table[(r % TABLE_SIDE) * TABLE_SIDE + c % TABLE_SIDE];
                let upper = at(column, row) + right * (at(column + 1, row) - at(column, row));
                let lower =
                    at(column, row + 1) + right * (at(column + 1, row + 1) - at(column, row + 1));
                *value += upper + down * (lower - upper);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    const SIDE: usize = 256;

    /// Mean product of values `(dx, dy)` pixels apart.
    fn correlation(field: &[f32], dx: usize, dy: usize) -> f32 {
        let (mut sum, mut count) = (0.0, 0.0);
        for y in 0..SIDE - dy {
            for x in 0..SIDE - dx {
                sum += field[y * SIDE + x] * field[(y + dy) * SIDE + x + dx];
                count += 1.0;
            }
        }
        sum / count
    }

    fn texture(stretch: f32, direction_rad: f32) -> Texture {
        Texture {
            coarsest_px: 6.0,
            finest_px: 2.0,
            persistence: 0.5,
            stretch,
            direction_rad,
        }
    }

    #[test]
    fn a_texture_has_mean_zero_and_root_mean_square_one() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        for _ in 0..20 {
            let field = Texture::random(&(2.0..=60.0), 15.0, &mut rng).field(128, &mut rng);
            let count = field.len() as f32;
            let mean = field.iter().sum::<f32>() / count;
            let square = field.iter().map(|v| v * v).sum::<f32>() / count;
            assert!(
                mean.abs() < 1e-3 && (square - 1.0).abs() < 1e-3,
                "{mean} {square}"
            );
        }
    }

    #[test]
    fn a_stretched_texture_is_alike_along_its_direction_and_not_across() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let level = texture(10.0, 0.0).field(SIDE, &mut rng);
        assert!(
            correlation(&level, 12, 0) > 0.6,
            "{}",
            correlation(&level, 12, 0)
        );
        assert!(
            correlation(&level, 0, 12).abs() < 0.2,
            "{}",
            correlation(&level, 0, 12)
        );
        let upright = texture(10.0, std::f32::consts::FRAC_PI_2).field(SIDE, &mut rng);
        assert!(correlation(&upright, 0, 12) > 0.6);
        assert!(correlation(&upright, 12, 0).abs() < 0.2);
        let round = texture(1.0, 0.7).field(SIDE, &mut rng);
        assert!((correlation(&round, 3, 0) - correlation(&round, 0, 3)).abs() < 0.15);
    }

    #[test]
    fn features_are_as_large_as_asked_for() {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let fine = Texture {
            coarsest_px: 2.0,
            ..texture(1.0, 0.0)
        }
        .field(SIDE, &mut rng);
        let coarse = Texture {
            coarsest_px: 40.0,
            finest_px: 40.0,
            ..texture(1.0, 0.0)
        }
        .field(SIDE, &mut rng);
        assert!(
            correlation(&fine, 4, 0).abs() < 0.1,
            "{}",
            correlation(&fine, 4, 0)
        );
        assert!(
            correlation(&coarse, 4, 0) > 0.9,
            "{}",
            correlation(&coarse, 4, 0)
        );
    }

    #[test]
    fn random_shapes_stay_in_their_ranges_and_the_same_seed_gives_the_same_texture() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        for _ in 0..500 {
            let texture = Texture::random(&(2.0..=60.0), 15.0, &mut rng);
            assert!((2.0..=60.01).contains(&texture.coarsest_px), "{texture:?}");
            assert!(
                texture.finest_px <= texture.coarsest_px * 1.001,
                "{texture:?}"
            );
            assert!((1.0..=15.01).contains(&texture.stretch), "{texture:?}");
        }
        let field = || {
            let mut rng = ChaCha8Rng::seed_from_u64(6);
            Texture::random(&(2.0..=60.0), 15.0, &mut rng).field(64, &mut rng)
        };
        assert_eq!(field(), field());
    }
}
