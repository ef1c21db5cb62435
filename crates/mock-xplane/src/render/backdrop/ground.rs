//! The scenery below the sky: airfield with runway and markings; sea, ships at anchor and islands on the horizon, or the country around.
//!
//! Everything is evaluated per ray: what does it meet, and how bright is that through the air? At Changi, land extends from the airfield to
//! a coast some hundred metres before the threshold; beyond it there is sea. Other airports are inland.

mod inland;

use dataset::geometry::runway::Runway;
use glam::{DVec2, DVec3, Vec3};

use self::inland::Inland;
use crate::render::air::Air;
use crate::render::backdrop::noise::NoiseTile;
use crate::render::backdrop::ships::Ship;
use crate::render::curves::smoothstep;
use crate::render::light::Light;
use crate::render::view::View;

/// Length of the runway's pavement past the threshold, and its width, metres, where they are not known.
const USUAL_LENGTH_M: f64 = 4_000.0;
const USUAL_WIDTH_M: f64 = 60.0;
/// Mown grass reaches as far beside and beyond the runway, metres.
const AIRFIELD_M: f64 = 450.0;
/// Mean distance of the coast before the threshold, metres.
const COAST_BEFORE_THRESHOLD_M: f64 = 700.0;
/// Distance of the islands, metres.
pub(crate) const ISLANDS_M: f64 = 24_000.0;
/// No silhouette rises above this elevation, radians.
pub(crate) const MAX_SILHOUETTE_RAD: f64 = 0.006;

/// Runway pavement past the landing threshold.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pavement {
    pub(crate) length_m: f64,
    pub(crate) half_width_m: f64,
}

/// The earth's surface.
pub(crate) struct Ground {
    view: View,
    air: Air,
    ground_lux: Vec3,
    to_sun: DVec3,
    sun_lux: Vec3,
    /// 0 dry to 1 wet.
    wetness: f32,
    pub(crate) ships: Vec<Ship>,
    pub(crate) pavement: Pavement,
    /// `None` at the coast.
    inland: Option<Inland>,
    tile: &'static NoiseTile,
}

impl Pavement {
    fn of(runway: &Runway) -> Self {
        Self {
            length_m: runway.length_m.unwrap_or(USUAL_LENGTH_M),
            half_width_m: runway.width_m.unwrap_or(USUAL_WIDTH_M) / 2.0,
        }
    }
}

impl Ground {
    pub(crate) fn new(
        view: &View,
        runway: &Runway,
        air: &Air,
        light: &Light,
        rain_ratio: f64,
    ) -> Self {
        let inland = Inland::around(&runway.airport);
        Self {
            view: view.clone(),
            air: *air,
            ground_lux: light.ground_lux(),
            to_sun: light.to_sun,
            sun_lux: light.sun_lux,
            wetness: rain_ratio.clamp(0.0, 1.0) as f32,
            ships: if inland.is_none() {
                Ship::at_anchor(view)
            } else {
                Vec::new()
            },
            pavement: Pavement::of(runway),
            inland,
            tile: NoiseTile::shared(),
        }
    }

    /// Luminance along a ray from the camera, seen through the air; `None` for the sky.
    pub(crate) fn seen(&self, ray: DVec3) -> Option<Vec3> {
        if let Some([near_m, _]) = self.view.distances_to_height(ray, self.view.ground_msl_m)
            && near_m > 0.0
        {
            let point = self.view.position_m + ray * near_m;
            if self.is_land(point) {
                return Some(self.air.through(self.land(point, ray, near_m), ray, near_m));
            }
        }
        if let Some((distance_m, reflectance)) = self.ships.iter().find_map(|ship| ship.hit(ray)) {
            let facade = reflectance * self.ground_lux * (0.6 / std::f32::consts::PI);
            return Some(self.air.through(facade, ray, distance_m));
        }
        if self.inland.is_none()
            && let Some([near_m, _]) = self.view.distances_to_height(ray, 0.0)
            && near_m > 0.0
        {
            let point = self.view.position_m + ray * near_m;
            return Some(self.air.through(self.sea(point, ray, near_m), ray, near_m));
        }
        (ray.z < self.island_elevation_rad(ray)).then(|| {
            let inland = self.inland.as_ref();
            let forest = inland.map_or(Vec3::new(0.035, 0.055, 0.030), Inland::hills);
            let forest = forest * self.ground_lux / std::f32::consts::PI;
            self.air.through(forest, ray, ISLANDS_M)
        })
    }

    /// Height of the surface that ends at the horizon, above mean sea level, metres.
    pub(crate) fn horizon_msl_m(&self) -> f64 {
        match self.inland {
            Some(_) => self.view.ground_msl_m,
            None => 0.0,
        }
    }

    /// Elevation of the ridge of islands or hills along a ray, radians; below the horizon where there is none.
    pub(crate) fn island_elevation_rad(&self, ray: DVec3) -> f64 {
        let azimuth = ray.x.atan2(ray.y);
        let height_m = if let Some(inland) = &self.inland {
            self.view.ground_msl_m + inland.ridge_m(azimuth, self.tile)
        } else {
            let shape = f64::from(self.tile.at(azimuth / 2.2, 0.371));
            260.0 * (shape - 0.42)
        };
        let foot = self.view.at_height(
            self.view.position_m.truncate() + ray.truncate().normalize() * ISLANDS_M,
            height_m,
        );
        ((foot.z - self.view.position_m.z) / ISLANDS_M).min(MAX_SILHOUETTE_RAD)
    }

    /// Metres past the threshold and right of the centreline.
    fn on_runway(&self, point: DVec3) -> (f64, f64) {
        let (along_m, right_m) = self.view.along_and_right_m(point);
        (along_m + self.view.threshold_before_target_m, right_m)
    }

    fn is_land(&self, point: DVec3) -> bool {
        if self.inland.is_some() {
            return true;
        }
        let (past_threshold_m, right_m) = self.on_runway(point);
        let coast = f64::from(self.tile.at(right_m / 9_000.0, 0.71)) - 0.5;
        past_threshold_m > -COAST_BEFORE_THRESHOLD_M + 500.0 * coast
    }

    fn land(&self, point: DVec3, ray: DVec3, distance_m: f64) -> Vec3 {
        let (past_threshold_m, right_m) = self.on_runway(point);
        let Pavement {
            length_m,
            half_width_m,
        } = self.pavement;
        let beyond_m = (past_threshold_m - length_m)
            .max(-past_threshold_m)
            .max(0.0);
        let country = self
            .inland
            .as_ref()
            .filter(|_| right_m.abs() > AIRFIELD_M || beyond_m > AIRFIELD_M);
        // Away from the coast, shoulders and taxiway end with the runway.
        let is_paved = self.inland.is_none() || beyond_m == 0.0;
        let reflectance = if let Some(paint) = self.pavement.paint(past_threshold_m, right_m) {
            paint
        } else if let Some(country) = country {
            country.reflectance(point, distance_m, self.tile)
        } else if is_paved
            && ((right_m.abs() - 190.0).abs() < 12.0
                || (half_width_m..half_width_m + 8.0).contains(&right_m.abs()))
        {
            Vec3::new(0.13, 0.13, 0.13)
        } else {
            let mown = f64::from(self.tile.at(point.x / 300.0, point.y / 300.0));
            let wide = self.tile.at(point.x / 7_000.0, point.y / 7_000.0);
            let texture = 0.85
                + 0.3 * (mown as f32) * (1.0 - smoothstep(1_000.0, 4_000.0, distance_m as f32));
            Vec3::new(0.060, 0.095, 0.035).lerp(Vec3::new(0.105, 0.105, 0.050), wide) * texture
        };
        let matte = reflectance * self.ground_lux / std::f32::consts::PI;
        // Wet surfaces mirror the sky at grazing angles.
        let mirrored = self.air.airlight(DVec3::new(ray.x, ray.y, -ray.z));
        matte * (1.0 - 0.3 * self.wetness) + mirrored * (0.22 * self.wetness)
    }

    fn sea(&self, point: DVec3, ray: DVec3, distance_m: f64) -> Vec3 {
        // Waves tilt the mirror: the sea shows the sky some ten to twenty degrees up, and some colour of the water.
        let mirrored = DVec3::new(ray.x, ray.y, 0.25).normalize();
        let water = Vec3::new(0.010, 0.028, 0.032) * self.ground_lux / std::f32::consts::PI;
        let swell = self.tile.at(point.x / 1_300.0, point.y / 1_300.0) - 0.5;
        let swell = 1.0 + 0.25 * swell * (1.0 - smoothstep(2_000.0, 9_000.0, distance_m as f32));
        let flat_sun = DVec2::new(self.to_sun.x, self.to_sun.y).normalize_or_zero();
        let towards_sun = ray.truncate().normalize_or_zero().dot(flat_sun).max(0.0) as f32;
        let low = (1.0 - self.to_sun.z.max(0.0)) as f32;
        let glint = self.sun_lux * (0.05 * towards_sun.powi(40) * low);
        (self.air.airlight(mirrored) * 0.52 + water + glint) * swell
    }
}

impl Pavement {
    /// Reflectance of the runway at a place, with its markings (ICAO Annex 14, precision approach); `None` beside it.
    fn paint(&self, past_threshold_m: f64, right_m: f64) -> Option<Vec3> {
        let half_m = self.half_width_m;
        let across = right_m.abs();
        if !(0.0..self.length_m).contains(&past_threshold_m) || across > half_m {
            return None;
        }
        let along = past_threshold_m;
        let within = |from: f64, length: f64| (from..from + length).contains(&along);
        let side_stripe = (half_m - 1.5..half_m - 0.6).contains(&across);
        let centreline = across < 0.45 && along > 80.0 && (along - 80.0) % 50.0 < 30.0;
        let threshold = within(6.0, 30.0)
            && (3.0..half_m - 3.0).contains(&across)
            && (across - 3.0) % 3.6 < 1.8;
        let aiming_point = within(400.0, 60.0) && (9.0..19.0).contains(&across);
        let touchdown_zone = [150.0, 300.0, 600.0, 750.0, 900.0]
            .iter()
            .any(|&from| within(from, 22.5))
            && (9.0..18.0).contains(&across);
        if side_stripe || centreline || threshold || aiming_point || touchdown_zone {
            return Some(Vec3::splat(0.62));
        }
        // Rubber where wheels touch down.
        let rubber = smoothstep(200.0, 350.0, along as f32)
            * (1.0 - smoothstep(700.0, 1_000.0, along as f32));
        let rubber = rubber * (1.0 - smoothstep(5.0, 10.0, across as f32));
        Some(Vec3::new(0.155, 0.155, 0.160) * (1.0 - 0.55 * rubber))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_runway_has_white_paint_where_the_annex_says() {
        let wide = Pavement {
            length_m: 4_000.0,
            half_width_m: 30.0,
        };
        let white = |along, right| wide.paint(along, right).is_some_and(|paint| paint.x > 0.5);
        assert!(white(430.0, 12.0) && white(430.0, -12.0), "aiming point");
        assert!(!white(430.0, 5.0), "between the aiming points");
        assert!(
            white(85.0, 0.0) && !white(120.0, 0.0),
            "centreline and its gap"
        );
        assert!(wide.paint(-1.0, 0.0).is_none() && wide.paint(100.0, 31.0).is_none());
        let narrow = Pavement {
            length_m: 1_900.0,
            half_width_m: 22.5,
        };
        assert!(narrow.paint(100.0, 23.0).is_none() && narrow.paint(1_901.0, 0.0).is_none());
        assert!(narrow.paint(100.0, 21.5).is_some_and(|paint| paint.x > 0.5));
    }
}
