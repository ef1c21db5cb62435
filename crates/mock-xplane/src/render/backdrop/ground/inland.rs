//! The country around an airport that is not by the sea: fields and woods to the horizon, and hills behind. Everything follows from the
//! airport's code, so that no two places look alike and each always looks the same.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3, Vec3};

use crate::render::backdrop::noise::{NoiseTile, hash, unit_hash};
use crate::render::curves::smoothstep;

/// The stand-in's own airport is on a coast.
const BY_THE_SEA: &str = "WSSS";
/// Hills above the airfield, metres: the highest stay below the sky's rows.
const MIN_HILLS_M: f64 = 70.0;
const MAX_HILLS_M: f64 = 190.0;
/// Plots are smaller than a pixel beyond the first distance, metres, and have their mean colour beyond the second.
const PLOTS_FADE_M: (f32, f32) = (3_500.0, 12_000.0);
/// Crops, meadows, bare soil, sand.
const PALETTE: [Vec3; 6] = [
    Vec3::new(0.050, 0.085, 0.030),
    Vec3::new(0.085, 0.115, 0.045),
    Vec3::new(0.130, 0.125, 0.060),
    Vec3::new(0.165, 0.135, 0.085),
    Vec3::new(0.110, 0.075, 0.050),
    Vec3::new(0.200, 0.175, 0.125),
];
const WOOD: Vec3 = Vec3::new(0.030, 0.048, 0.024);

pub(crate) struct Inland {
    seed: u32,
    /// Direction of the rows of plots.
    along_rows: DVec2,
    plot_m: DVec2,
    crops: [Vec3; 3],
    woods: f32,
    hills_m: f64,
    /// Azimuth over which the ridge repeats, radians.
    ridge_rad: f64,
}

impl Inland {
    /// The country around an airport; `None` on the coast.
    pub(crate) fn around(airport: &str) -> Option<Self> {
        if airport == BY_THE_SEA {
            return None;
        }
        let seed = airport
            .bytes()
            .fold(0, |seed, byte| hash(seed, u32::from(byte), 41));
        let random = |what: u32| unit_hash(seed, what, 43);
        let between = |what: u32, from: f64, to: f64| from + (to - from) * f64::from(random(what));
        // Neighbours in the palette: a place is green, dry or bare.
        let first = (random(0) * 4.0) as usize;
        Some(Self {
            seed,
            along_rows: DVec2::from_angle(between(1, 0.0, std::f64::consts::PI)),
            plot_m: DVec2::new(between(2, 180.0, 600.0), between(3, 120.0, 350.0)),
            crops: std::array::from_fn(|i| PALETTE[(first + i).min(PALETTE.len() - 1)]),
            woods: 0.05 + 0.3 * random(4),
            hills_m: between(5, MIN_HILLS_M, MAX_HILLS_M),
            // It fits around the horizon without a seam.
            ridge_rad: TAU / (TAU / between(6, 0.5, 1.6)).round(),
        })
    }

    /// Reflectance of the country at a point of the site (east, north), seen from a distance.
    pub(crate) fn reflectance(&self, point: DVec3, distance_m: f64, tile: &NoiseTile) -> Vec3 {
        let place = self
            .along_rows
            .rotate(point.truncate())
            .rem_euclid(DVec2::splat(4e6));
        let plot = (place / self.plot_m).floor();
        let (column, row) = (plot.x as u32, plot.y as u32);
        let random = unit_hash(column, row, self.seed);
        let wide = tile.at(point.x / 9_000.0, point.y / 9_000.0);
        let mean = self.crops[1].lerp(WOOD, self.woods) * (0.8 + 0.4 * wide);
        let crop = if random < self.woods {
            WOOD
        } else {
            self.crops[hash(column, row, self.seed ^ 7) as usize % self.crops.len()]
        };
        let fine = tile.at(point.x / 400.0, point.y / 400.0);
        let fade = smoothstep(PLOTS_FADE_M.0, PLOTS_FADE_M.1, distance_m as f32);
        (crop * (0.85 + 0.3 * fine)).lerp(mean, fade)
    }

    /// Height of the hills above the airfield in a direction, metres.
    pub(crate) fn ridge_m(&self, azimuth_rad: f64, tile: &NoiseTile) -> f64 {
        let row = f64::from(unit_hash(self.seed, 8, 43));
        let around = azimuth_rad / self.ridge_rad;
        let shape = 0.8 * tile.at(around, row) + 0.2 * tile.at(5.0 * around, row + 0.5);
        self.hills_m * f64::from(shape)
    }

    /// Reflectance of the hills.
    pub(crate) fn hills(&self) -> Vec3 {
        self.crops[0].lerp(WOOD, 0.6)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_places_differ_and_each_stays_as_it_is() {
        let tile = NoiseTile::shared();
        let ridge = |airport: &str| -> Vec<f64> {
            let inland = Inland::around(airport).unwrap();
            (0..20)
                .map(|i| inland.ridge_m(f64::from(i) * 0.05, tile))
                .collect()
        };
        assert_eq!(ridge("LSZH"), ridge("LSZH"));
        assert_ne!(ridge("LSZH"), ridge("SKBO"));
        assert!(Inland::around("WSSS").is_none());
    }
}
