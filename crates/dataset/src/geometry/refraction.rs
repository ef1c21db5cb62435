//! Terrestrial refraction: air density falls with height, so light follows an arc and distant objects appear higher than they are.
//!
//! A near-horizontal ray's arc has a curvature of `k / R`, with the earth's radius `R` and the coefficient of refraction `k` (Torge and
//! Müller, "Geodesy", 4th edition, de Gruyter 2012: k = 0.13 after Gauss for rays well above the ground by day; negative over hot ground,
//! near 1 over cold water). A point at the horizontal distance `d` appears lifted by `k d^2 / (2 R)`: at k = 0.13 by 3.5 m at 10 nautical
//! miles. This is equivalent to an earth of radius `R / (1 - k)`.

use glam::DVec3;

use crate::geometry::geodesy::Geodetic;

/// Mean radius of the earth (IUGG), metres.
pub const EARTH_RADIUS_M: f64 = 6_371_008.8;

/// Refraction around a camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Refraction {
    /// The coefficient k: curvature of rays over curvature of the earth.
    pub coefficient: f64,
    /// Away from the earth at the camera: a unit vector in ECEF.
    up: DVec3,
}

impl Refraction {
    /// For a camera at this place; `None` if light travels straight.
    pub fn new(coefficient: f64, camera_ecef_m: DVec3) -> Option<Self> {
        (coefficient != 0.0).then(|| Self {
            coefficient,
            up: -Geodetic::from_ecef(camera_ecef_m).ecef_from_ned().z_axis,
        })
    }

    /// The displacement from a point's true to its apparent position, for a point at `seen_m` from the camera (ECEF).
    pub fn lift(&self, seen_m: DVec3) -> DVec3 {
        self.up
            * lift_m(
                self.coefficient,
                seen_m.reject_from_normalized(self.up).length(),
            )
    }
}

/// Apparent rise of objects at a horizontal distance, metres.
pub fn lift_m(coefficient: f64, distance_m: f64) -> f64 {
    coefficient * distance_m * distance_m / (2.0 * EARTH_RADIUS_M)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gauss_lifts_by_three_and_a_half_metres_at_ten_nautical_miles() {
        assert!((lift_m(0.13, 18_520.0) - 3.5).abs() < 0.01);
        assert_eq!(lift_m(0.0, 18_520.0), 0.0);
    }

    #[test]
    fn the_lift_is_that_of_an_arc_of_the_curvature_of_light() {
        // A ray of curvature k/R that arrives horizontally has fallen by the arc's sagitta.
        let radius_m = EARTH_RADIUS_M / 0.13;
        let d: f64 = 20_000.0;
        let sagitta_m = radius_m - (radius_m * radius_m - d * d).sqrt();
        assert!((lift_m(0.13, d) - sagitta_m).abs() < 1e-4);
    }
}
