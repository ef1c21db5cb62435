//! Ships at anchor off the coast: dark boxes on the sea, which a detector may mistake for an aircraft.

use glam::{DVec3, Vec3};

use crate::render::backdrop::noise::unit_hash;
use crate::render::view::View;

const SHIPS: u32 = 14;

/// A ship as seen by the camera: two upright rectangles in azimuth and elevation.
pub(crate) struct Ship {
    /// Position of the mast's foot: east, north, up, metres.
    pub(crate) position_m: DVec3,
    distance_m: f64,
    azimuth_rad: f64,
    hull_half_rad: f64,
    house_from_rad: f64,
    house_to_rad: f64,
    water_slope: f64,
    deck_slope: f64,
    roof_slope: f64,
}

impl Ship {
    /// Ships at anchor, the same for every camera of a site.
    pub(crate) fn at_anchor(view: &View) -> Vec<Self> {
        (0..SHIPS)
            .map(|i| {
                let random = |what: u32| f64::from(unit_hash(i, what, 77));
                let before_m = 6_000.0 + 8_000.0 * random(0);
                let right_m = (random(1) - 0.5) * 0.55 * before_m;
                let position_m = view.at_height(view.on_runway(-before_m, right_m), 0.0);
                let to_ship = position_m - view.position_m;
                let distance_m = to_ship.truncate().length();
                let half_length_m = 45.0 + 80.0 * random(2);
                let house_at = if random(3) < 0.5 { -0.72 } else { 0.72 };
                let hull_half_rad = half_length_m / distance_m;
                Self {
                    position_m,
                    distance_m,
                    azimuth_rad: to_ship.x.atan2(to_ship.y),
                    hull_half_rad,
                    house_from_rad: hull_half_rad * (house_at - 0.13),
                    house_to_rad: hull_half_rad * (house_at + 0.13),
                    water_slope: to_ship.z / distance_m,
                    deck_slope: (to_ship.z + 6.0 + 6.0 * random(4)) / distance_m,
                    roof_slope: (to_ship.z + 20.0 + 12.0 * random(5)) / distance_m,
                }
            })
            .collect()
    }

    /// Distance and reflectance of the ship if a ray meets it.
    pub(crate) fn hit(&self, ray: DVec3) -> Option<(f64, Vec3)> {
        let slope = ray.z / ray.truncate().length();
        if !(self.water_slope..self.roof_slope).contains(&slope) {
            return None;
        }
        let aside = (ray.x.atan2(ray.y) - self.azimuth_rad + std::f64::consts::PI)
            .rem_euclid(std::f64::consts::TAU)
            - std::f64::consts::PI;
        if aside.abs() < self.hull_half_rad && slope < self.deck_slope {
            Some((self.distance_m, Vec3::new(0.10, 0.07, 0.07)))
        } else if (self.house_from_rad..self.house_to_rad).contains(&aside) {
            Some((self.distance_m, Vec3::new(0.55, 0.55, 0.52)))
        } else {
            None
        }
    }
}
