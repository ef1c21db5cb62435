//! The scenery below the sky: airfield with runway and markings, sea, ships at anchor, islands on the horizon.
//!
//! Everything is evaluated per ray: what does it meet, and how bright is that through the air? Land extends from the airfield to a
//! coast some hundred metres before the threshold; beyond it there is sea, as at Changi.

use glam::{DVec2, DVec3, Vec3};

use crate::render::air::Air;
use crate::render::curves::smoothstep;
use crate::render::light::Light;
use crate::render::noise::NoiseTile;
use crate::render::ships::Ship;
use crate::render::view::View;

/// Length of the runway's pavement past the threshold, metres. A [`dataset::geometry::runway::Runway`] does not have it.
pub(crate) const RUNWAY_LENGTH_M: f64 = 4_000.0;
/// Half the width of the runway, metres.
pub(crate) const RUNWAY_HALF_WIDTH_M: f64 = 30.0;
/// Mean distance of the coast before the threshold, metres.
const COAST_BEFORE_THRESHOLD_M: f64 = 700.0;
/// Distance of the islands, metres.
pub(crate) const ISLANDS_M: f64 = 24_000.0;
/// No silhouette rises above this elevation, radians.
pub(crate) const HIGHEST_SILHOUETTE_RAD: f64 = 0.006;

/// The earth's surface of a scene.
pub(crate) struct Ground {
    view: View,
    air: Air,
    ground_lux: Vec3,
    to_sun: DVec3,
    sun_lux: Vec3,
    /// 0 dry to 1 wet.
    wetness: f32,
    pub(crate) ships: Vec<Ship>,
    tile: &'static NoiseTile,
}

impl Ground {
    pub(crate) fn new(view: &View, air: &Air, light: &Light, rain_ratio: f64) -> Self {
        Self {
            view: view.clone(),
            air: *air,
            ground_lux: light.ground_lux(),
            to_sun: light.to_sun,
            sun_lux: light.sun_lux,
            wetness: rain_ratio.clamp(0.0, 1.0) as f32,
            ships: Ship::at_anchor(view),
            tile: NoiseTile::shared(),
        }
    }

    /// Luminance of what a ray from the camera meets, seen through the air; `None` for the sky.
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
        if let Some([near_m, _]) = self.view.distances_to_height(ray, 0.0)
            && near_m > 0.0
        {
            let point = self.view.position_m + ray * near_m;
            return Some(self.air.through(self.sea(point, ray, near_m), ray, near_m));
        }
        (ray.z < self.island_elevation_rad(ray)).then(|| {
            let forest = Vec3::new(0.035, 0.055, 0.030) * self.ground_lux / std::f32::consts::PI;
            self.air.through(forest, ray, ISLANDS_M)
        })
    }

    /// Elevation of the islands' ridge in the direction of a ray, radians; below the horizon where there is only sea.
    pub(crate) fn island_elevation_rad(&self, ray: DVec3) -> f64 {
        let azimuth = ray.x.atan2(ray.y);
        let shape = f64::from(self.tile.at(azimuth / 2.2, 0.371));
        let height_m = 260.0 * (shape - 0.42);
        let foot = self.view.at_height(
            self.view.position_m.truncate() + ray.truncate().normalize() * ISLANDS_M,
            height_m,
        );
        ((foot.z - self.view.position_m.z) / ISLANDS_M).min(HIGHEST_SILHOUETTE_RAD)
    }

    /// Metres past the threshold and right of the centreline.
    fn on_runway(&self, point: DVec3) -> (f64, f64) {
        let (along_m, right_m) = self.view.along_and_right_m(point);
        (along_m + self.view.threshold_before_target_m, right_m)
    }

    fn is_land(&self, point: DVec3) -> bool {
        let (past_threshold_m, right_m) = self.on_runway(point);
        let coast = f64::from(self.tile.at(right_m / 9_000.0, 0.71)) - 0.5;
        past_threshold_m > -COAST_BEFORE_THRESHOLD_M + 500.0 * coast
    }

    fn land(&self, point: DVec3, ray: DVec3, distance_m: f64) -> Vec3 {
        let (past_threshold_m, right_m) = self.on_runway(point);
        let reflectance = if let Some(paint) = runway_paint(past_threshold_m, right_m) {
            paint
        } else if (right_m.abs() - 190.0).abs() < 12.0
            || (RUNWAY_HALF_WIDTH_M..38.0).contains(&right_m.abs())
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

/// Reflectance of the runway at a place, with its markings (ICAO Annex 14, precision approach, 60 m wide); `None` beside it.
fn runway_paint(past_threshold_m: f64, right_m: f64) -> Option<Vec3> {
    let across = right_m.abs();
    if !(0.0..RUNWAY_LENGTH_M).contains(&past_threshold_m) || across > RUNWAY_HALF_WIDTH_M {
        return None;
    }
    let along = past_threshold_m;
    let within = |from: f64, length: f64| (from..from + length).contains(&along);
    let side_stripe = (28.5..29.4).contains(&across);
    let centreline = across < 0.45 && along > 80.0 && (along - 80.0) % 50.0 < 30.0;
    let threshold =
        within(6.0, 30.0) && (3.0..27.0).contains(&across) && (across - 3.0) % 3.6 < 1.8;
    let aiming_point = within(400.0, 60.0) && (9.0..19.0).contains(&across);
    let touchdown_zone = [150.0, 300.0, 600.0, 750.0, 900.0]
        .iter()
        .any(|&from| within(from, 22.5))
        && (9.0..18.0).contains(&across);
    if side_stripe || centreline || threshold || aiming_point || touchdown_zone {
        return Some(Vec3::splat(0.62));
    }
    // Rubber where wheels touch down.
    let rubber =
        smoothstep(200.0, 350.0, along as f32) * (1.0 - smoothstep(700.0, 1_000.0, along as f32));
    let rubber = rubber * (1.0 - smoothstep(5.0, 10.0, across as f32));
    Some(Vec3::new(0.155, 0.155, 0.160) * (1.0 - 0.55 * rubber))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_runway_has_white_paint_where_the_annex_says() {
        let white = |along, right| runway_paint(along, right).is_some_and(|paint| paint.x > 0.5);
        assert!(white(430.0, 12.0) && white(430.0, -12.0), "aiming point");
        assert!(!white(430.0, 5.0), "between the aiming points");
        assert!(
            white(85.0, 0.0) && !white(120.0, 0.0),
            "centreline and its gap"
        );
        assert!(runway_paint(-1.0, 0.0).is_none() && runway_paint(100.0, 31.0).is_none());
    }
}
