//! The air between objects and the camera, and the clear sky behind them.
//!
//! Koschmieder: an object of luminance `L` at distance `r` appears as `L t + A (1 - t)` with `t = exp(-beta r)` and `beta = 3.912 /
//! visibility`. The airlight `A` in a direction is the clear sky's own luminance there, so contrast against the sky falls exactly as `t`,
//! equally for every colour.

use dataset::conditions::extinction_per_m;
use glam::{DVec3, Vec3};

use crate::render::curves::luminance;
use crate::render::light::Light;

/// Scale height of haze, metres. Only shapes the sky; objects see the same haze at all heights.
const HAZE_HEIGHT_M: f64 = 1_500.0;
/// Radius of the solar disc, radians.
const SUN_RADIUS_RAD: f64 = 0.004_65;

#[derive(Debug, Clone, Copy)]
pub(crate) struct Air {
    /// Extinction, 1/m.
    pub(crate) beta_per_m: f64,
    light: Light,
    horizon: Vec3,
    zenith: Vec3,
}

/// Extinction coefficient (1/m) for a meteorological visibility.
pub(crate) fn beta_per_m(visibility_m: f64) -> f64 {
    // A visibility of zero would make the world a wall; one metre is opaque enough.
    extinction_per_m(visibility_m.max(1.0))
}

impl Air {
    pub(crate) fn new(beta_per_m: f64, light: Light) -> Self {
        let mean = light.sky_lux / std::f32::consts::PI;
        // Haze and fog scatter all colours alike: the worse the visibility, the whiter the horizon.
        let colour = 1.0 / (1.0 + 4_000.0 * beta_per_m) as f32;
        let horizon =
            Vec3::splat(luminance(mean)).lerp(mean * Vec3::new(0.90, 0.99, 1.12), colour) * 1.30;
        let zenith_tint = Vec3::new(0.35, 0.62, 1.05).lerp(Vec3::splat(0.8), light.overcast);
        Self {
            beta_per_m,
            light,
            horizon,
            zenith: mean * zenith_tint,
        }
    }

    /// Transmittance over a distance.
    pub(crate) fn transmittance(&self, distance_m: f64) -> f32 {
        (-self.beta_per_m * distance_m).exp() as f32
    }

    /// An object's luminance as it arrives over a distance in a direction.
    pub(crate) fn through(&self, object: Vec3, ray: DVec3, distance_m: f64) -> Vec3 {
        let t = self.transmittance(distance_m);
        object * t + self.airlight(ray) * (1.0 - t)
    }

    /// Luminance of the clear sky without the sun's disc; of the horizon for rays below it.
    pub(crate) fn airlight(&self, ray: DVec3) -> Vec3 {
        let up = ray.z.max(0.0);
        let haze = (1.0 - (-self.beta_per_m * HAZE_HEIGHT_M / (up + 0.02)).exp()) as f32;
        let clear = self
            .horizon
            .lerp(self.zenith, (1.0 - (-up / 0.22).exp()) as f32);
        let towards_sun = ray.dot(self.light.to_sun).max(0.0) as f32;
        // Sunlight scattered into the ray: a little to all sides, more forward, in a broad and a narrow lobe.
        let lobes = 0.012 + 0.010 * towards_sun.powi(6) + 0.035 * towards_sun.powi(60);
        clear.lerp(self.horizon, haze) + self.light.sun_lux * (lobes * (0.4 + 0.6 * haze))
    }

    /// Luminance of the cloudless sky.
    pub(crate) fn sky(&self, ray: DVec3) -> Vec3 {
        let angle = ray.dot(self.light.to_sun).clamp(-1.0, 1.0).acos();
        let mut sky = self.airlight(ray);
        if angle < 1.1 * SUN_RADIUS_RAD && ray.z > 0.0 {
            let edge = ((1.1 * SUN_RADIUS_RAD - angle) / (0.1 * SUN_RADIUS_RAD)).min(1.0) as f32;
            let solid_angle = (std::f64::consts::PI * SUN_RADIUS_RAD * SUN_RADIUS_RAD) as f32;
            sky += self.light.sun_above_lux * (edge / solid_angle);
        }
        sky
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_black_object_at_the_visibility_keeps_two_percent_of_contrast() {
        assert!(((-beta_per_m(9_260.0) * 9_260.0).exp() - 0.02).abs() < 1e-4);
    }
}
