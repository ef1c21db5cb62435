//! A tile of fractal noise that repeats without a seam, flattened so that its values are uniform between 0 and 1: "above
//! 1 - cover" then holds on exactly `cover` of the area.

use std::sync::OnceLock;

pub(crate) use dataset::numbers::noise_hash::{hash, unit_hash};

/// Texels along a side; a power of two.
const SIDE: usize = 1024;
/// Cells of the coarsest octave along a side.
const COARSEST_CELLS: usize = 16;
const OCTAVES: u32 = 5;

/// Coarser copies of the tile, each half as wide as the previous one.
const LEVELS: usize = 6;

/// Uniform fractal noise over a repeating unit square.
pub(crate) struct NoiseTile {
    /// The tile and its averages over 2 x 2, 4 x 4 ... texels.
    levels: Vec<Vec<f32>>,
}

impl NoiseTile {
    /// The only tile of this program; created on first use.
    pub(crate) fn shared() -> &'static Self {
        static TILE: OnceLock<NoiseTile> = OnceLock::new();
        TILE.get_or_init(Self::new)
    }

    fn new() -> Self {
        let raw: Vec<f32> = (0..SIDE * SIDE)
            .map(|i| {
                fractal(
                    (i % SIDE) as f32 / SIDE as f32,
                    (i / SIDE) as f32 / SIDE as f32,
                )
            })
            .collect();
        // Replace every value by its rank: the histogram becomes flat.
        let mut order: Vec<u32> = (0..raw.len() as u32).collect();
        order
            .sort_unstable_by(|&a, &b| raw[a as usize].total_cmp(&raw[b as usize]).then(a.cmp(&b)));
        let mut texels = vec![0.0; raw.len()];
        for (rank, &index) in order.iter().enumerate() {
            texels[index as usize] = (rank as f32 + 0.5) / raw.len() as f32;
        }
        let mut levels = vec![texels];
        for level in 1..LEVELS {
            let (finer, side) = (&levels[level - 1], SIDE >> level);
            let average = |i: usize| {
                let corner = (i / side * 2) * (side * 2) + i % side * 2;
                let sum = finer[corner]
                    + finer[corner + 1]
                    + finer[corner + side * 2]
                    + finer[corner + side * 2 + 1];
                sum / 4.0
            };
            levels.push((0..side * side).map(average).collect());
        }
        Self { levels }
    }

    /// Mean over about `footprint` (in units of the tile's side) around a position, for coarse sampling.
    pub(crate) fn blurred(&self, x: f64, y: f64, footprint: f64) -> f32 {
        let wanted = ((footprint * SIDE as f64) as f32)
            .max(1.0)
            .log2()
            .min((LEVELS - 1) as f32);
        let finer = (wanted as usize).min(LEVELS - 2);
        let (a, b) = (self.in_level(finer, x, y), self.in_level(finer + 1, x, y));
        a + (b - a) * (wanted - finer as f32)
    }

    /// The value at a place, in units of the tile's side; repeats with period 1.
    pub(crate) fn at(&self, x: f64, y: f64) -> f32 {
        self.in_level(0, x, y)
    }

    fn in_level(&self, level: usize, x: f64, y: f64) -> f32 {
        let (texels, side) = (&self.levels[level], SIDE >> level);
        // Texels of all levels have their centres half a texel inside.
        let (u, v) = (x * side as f64 - 0.5, y * side as f64 - 0.5);
        let (u0, v0) = (floor(u), floor(v));
        let (fu, fv) = ((u - u0 as f64) as f32, (v - v0 as f64) as f32);
        let wrap = |i: i64| i as usize & (side - 1);
        let (x0, x1) = (wrap(u0), wrap(u0 + 1));
        let (y0, y1) = (wrap(v0) * side, wrap(v0 + 1) * side);
        let top = texels[y0 + x0] + (texels[y0 + x1] - texels[y0 + x0]) * fu;
        let bottom = texels[y1 + x0] + (texels[y1 + x1] - texels[y1 + x0]) * fu;
        top + (bottom - top) * fv
    }
}

fn floor(x: f64) -> i64 {
    let towards_zero = x as i64;
    towards_zero - i64::from(towards_zero as f64 > x)
}

fn fractal(x: f32, y: f32) -> f32 {
    (0..OCTAVES)
        .map(|octave| {
            let cells = COARSEST_CELLS << octave;
            gradient_noise(x * cells as f32, y * cells as f32, cells as u32, octave)
                * 0.5_f32.powi(octave as i32)
        })
        .sum()
}

/// Perlin's gradient noise with a period of `cells`.
fn gradient_noise(x: f32, y: f32, cells: u32, seed: u32) -> f32 {
    let (x0, y0) = (x.floor(), y.floor());
    let (fx, fy) = (x - x0, y - y0);
    let corner = |dx: u32, dy: u32| {
        let angle = std::f32::consts::TAU
            * unit_hash((x0 as u32 + dx) % cells, (y0 as u32 + dy) % cells, seed);
        angle.cos() * (fx - dx as f32) + angle.sin() * (fy - dy as f32)
    };
    let fade = |t: f32| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
    let (u, v) = (fade(fx), fade(fy));
    let top = corner(0, 0) + (corner(1, 0) - corner(0, 0)) * u;
    let bottom = corner(0, 1) + (corner(1, 1) - corner(0, 1)) * u;
    top + (bottom - top) * v
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_threshold_covers_exactly_its_share_of_the_tile() {
        let tile = NoiseTile::shared();
        let texels = &tile.levels[0];
        let above =
            texels.iter().filter(|&&value| value > 0.4).count() as f64 / texels.len() as f64;
        assert!((above - 0.6).abs() < 1e-4, "{above}");
    }

    #[test]
    fn a_wide_footprint_calms_the_tile_and_keeps_its_place() {
        let tile = NoiseTile::shared();
        let places = || (0..400).map(|i| (f64::from(i) * 0.0713, f64::from(i) * 0.0291));
        let spread = |footprint: f64| {
            places()
                .map(|(x, y)| (tile.blurred(x, y, footprint) - 0.5).powi(2))
                .sum::<f32>()
        };
        assert!(
            spread(0.03) < 0.8 * spread(0.0),
            "{} {}",
            spread(0.03),
            spread(0.0)
        );
        let moved = places()
            .map(|(x, y)| (tile.blurred(x, y, 0.004) - tile.at(x, y)).abs())
            .sum::<f32>()
            / 400.0;
        assert!(moved < 0.05, "{moved}");
    }

    #[test]
    fn the_tile_repeats_without_a_seam() {
        let tile = NoiseTile::shared();
        for i in 0..100 {
            let y = f64::from(i) * 0.0137;
            assert!((tile.at(0.3, y) - tile.at(-0.7, y + 2.0)).abs() < 1e-5);
            let step = (tile.at(1.0 - 1e-4, y) - tile.at(1.0 + 1e-4, y)).abs();
            assert!(step < 0.05, "a step of {step} over the seam");
        }
    }
}
