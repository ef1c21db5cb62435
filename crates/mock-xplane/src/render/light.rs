//! Position of the sun, and the light of sun and sky.
//!
//! Photometric units: illuminances in lux, luminances in cd/m2, per colour channel (linear, BT.709 primaries). Illuminances by
//! solar elevation follow the usual tables (Seidelmann, Explanatory Supplement, table of illumination); a city's glow is the
//! minimum at night. Part of the sunlight that clouds absorb returns as a grey sky.

use dataset::conditions::{Clock, CloudKind, Weather};
use dataset::geometry::geodesy::Geodetic;
use dataset::geometry::sun::Sun;
use glam::{DVec3, Vec3};

use crate::render::curves::{geometric_lookup, luminance};

/// Solar elevation in degrees, and diffuse horizontal illuminance under a clear sky, lux per channel.
const SKY_LUX: [(f32, Vec3); 11] = [
    (-18.0, Vec3::new(0.070, 0.068, 0.082)),
    (-14.0, Vec3::new(0.080, 0.092, 0.140)),
    (-10.0, Vec3::new(0.35, 0.42, 0.70)),
    (-6.0, Vec3::new(3.0, 3.6, 6.0)),
    (-3.0, Vec3::new(50.0, 56.0, 80.0)),
    (0.0, Vec3::new(540.0, 520.0, 600.0)),
    (4.0, Vec3::new(2_700.0, 2_600.0, 2_650.0)),
    (10.0, Vec3::new(5_900.0, 6_000.0, 6_400.0)),
    (20.0, Vec3::new(10_200.0, 11_000.0, 12_300.0)),
    (40.0, Vec3::new(13_800.0, 15_500.0, 18_000.0)),
    (90.0, Vec3::new(17_000.0, 19_500.0, 23_000.0)),
];

/// Illuminance by the sun outside the atmosphere, lux.
const SUN_LUX: f32 = 128_000.0;
/// Vertical optical depth of clean air for red, green and blue.
const AIR_DEPTH: Vec3 = Vec3::new(0.12, 0.19, 0.32);
#[derive(Debug, Clone, Copy)]
pub(crate) struct Light {
    /// Unit vector to the sun: east, north, up.
    pub(crate) to_sun: DVec3,
    /// Sunlight on a plane across its rays above the clouds, lux.
    pub(crate) sun_above_lux: Vec3,
    /// Diffuse light on a horizontal plane above the clouds, lux.
    pub(crate) sky_above_lux: Vec3,
    /// Sunlight below the clouds, on average over gaps and shadows, lux.
    pub(crate) sun_lux: Vec3,
    /// Diffuse light on a horizontal plane below the clouds, lux.
    pub(crate) sky_lux: Vec3,
    /// Part of the sky's light that clouds have turned grey, 0 to 1.
    pub(crate) overcast: f32,
}

impl Light {
    pub(crate) fn new(place: Geodetic, clock: &Clock, weather: &Weather, beta_per_m: f64) -> Self {
        let Sun {
            azimuth_deg,
            elevation_deg,
        } = Sun::apparent_at(place, clock);
        let (sin_az, cos_az) = azimuth_deg.to_radians().sin_cos();
        let (sin_el, cos_el) = elevation_deg.to_radians().sin_cos();
        let elevation = elevation_deg as f32;

        let haze_depth = 0.5 * (beta_per_m * 1_500.0) as f32;
        let depth = (AIR_DEPTH + Vec3::splat(haze_depth)) * air_mass(elevation.max(-0.5));
        // The disc takes half a degree to rise.
        let risen = ((elevation + 0.3) / 0.6).clamp(0.0, 1.0);
        let sun_above_lux = (-depth).map(f32::exp) * (SUN_LUX * risen);
        let sky_above_lux = geometric_lookup(&SKY_LUX, elevation);

        let (overcast, transmission) = overcast(weather);
        let horizontal_sun = sun_above_lux * (sin_el as f32).max(0.0);
        let grey = luminance(horizontal_sun + sky_above_lux) * transmission;
        Self {
            to_sun: DVec3::new(cos_el * sin_az, cos_el * cos_az, sin_el),
            sun_above_lux,
            sky_above_lux,
            sun_lux: sun_above_lux * (1.0 - overcast),
            sky_lux: sky_above_lux * (1.0 - overcast)
                + Vec3::new(0.97, 1.0, 1.04) * (grey * overcast),
            overcast,
        }
    }

    pub(crate) fn ground_lux(&self) -> Vec3 {
        self.sky_lux + self.sun_lux * (self.to_sun.z as f32).max(0.0)
    }
}

/// Share of the sun that the layers block (0 none to 1 all), and share of the incoming light that leaves them below.
fn overcast(weather: &Weather) -> (f32, f32) {
    let mut open = 1.0;
    let mut transmission = 1.0_f64;
    for layer in &weather.clouds {
        // Share of the sun that cloud of this kind blocks, and share of all light that it transmits as grey.
        let (taken, let_through) = match layer.kind {
            CloudKind::Cirrus => (0.25, 0.80),
            CloudKind::Stratus => (1.0, 0.22),
            CloudKind::Cumulus => (1.0, 0.28),
            CloudKind::Cumulonimbus => (1.0, 0.09),
        };
        open *= 1.0 - taken * layer.cover_ratio.clamp(0.0, 1.0);
        transmission = transmission.min(let_through);
    }
    (1.0 - open as f32, transmission as f32)
}

/// Relative optical air mass (Kasten and Young 1989).
fn air_mass(elevation_deg: f32) -> f32 {
    1.0 / (elevation_deg.to_radians().sin() + 0.505_72 * (elevation_deg + 6.079_95).powf(-1.636_4))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::tests::{clear, clock_at_local};

    fn sun_position(place: Geodetic, clock: &Clock) -> (f64, f64) {
        let sun = Sun::apparent_at(place, clock);
        (sun.azimuth_deg, sun.elevation_deg)
    }

    const CHANGI: Geodetic = Geodetic {
        latitude_deg: 1.35,
        longitude_deg: 103.98,
        altitude_msl_m: 7.0,
    };

    #[test]
    fn the_sun_of_singapore_is_below_the_horizon_at_six_and_high_at_noon() {
        let (_, at_six) = sun_position(CHANGI, &clock_at_local(6.0));
        assert!((-20.0..-10.0).contains(&at_six), "{at_six}");
        let (_, at_noon) = sun_position(CHANGI, &clock_at_local(12.0));
        assert!(at_noon > 60.0, "{at_noon}");
        let (azimuth, at_six_pm) = sun_position(CHANGI, &clock_at_local(18.0));
        assert!(
            (5.0..20.0).contains(&at_six_pm) && (240.0..300.0).contains(&azimuth),
            "{azimuth} {at_six_pm}"
        );
    }

    #[test]
    fn noon_gives_about_a_hundred_thousand_lux_and_dusk_less_than_one_before_sunrise() {
        let noon = Light::new(CHANGI, &clock_at_local(12.0), &clear(), 1e-4);
        assert!(
            (70_000.0..140_000.0).contains(&luminance(noon.ground_lux())),
            "{}",
            noon.ground_lux()
        );
        let dawn = Light::new(CHANGI, &clock_at_local(6.0), &clear(), 1e-4);
        assert!(luminance(dawn.ground_lux()) < 1.0, "{}", dawn.ground_lux());
    }
}
