//! From luminance to bytes: automatic exposure, a film-like shoulder, sRGB.
//!
//! `byte = 255 sRGB(1 - exp(-exposure luminance))`. The shoulder never clips hard and can be inverted, which lets the aircraft be
//! composited in linear light over a cached, already encoded background.

use std::sync::OnceLock;

use glam::Vec3;

/// Luminance at which a scene counts as full daylight, cd/m2.
const DAYLIGHT_CD_M2: f32 = 6_000.0;
/// Exposed value of the reference luminance by day.
const DAY_KEY: f32 = 0.62;
/// Degree to which exposure follows the light: 0 fully (night looks like day), 1 not at all.
const DARKENING: f32 = 0.18;

/// A scene's exposure.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tone {
    exposure: f32,
}

impl Tone {
    /// Exposes for a scene whose horizon has this luminance. Twilight becomes dark, but not as dark as it is.
    pub(crate) fn for_horizon(luminance_cd_m2: f32) -> Self {
        let key = DAY_KEY * (luminance_cd_m2 / DAYLIGHT_CD_M2).powf(DARKENING).min(1.1);
        Self {
            exposure: key / luminance_cd_m2,
        }
    }

    /// Exposed linear light for a luminance: the input of [`encode`].
    pub(crate) fn expose(&self, luminance_cd_m2: Vec3) -> Vec3 {
        luminance_cd_m2 * self.exposure
    }
}

/// Intervals of the table of [`encode`].
const TABLE: usize = 1 << 16;

/// Converts exposed light to display values, 0 to 255, not yet rounded. Looked up in a table, which is within a thousandth of a grey level.
pub(crate) fn encode(exposed: Vec3) -> Vec3 {
    static VALUES: OnceLock<Vec<f32>> = OnceLock::new();
    let values = VALUES.get_or_init(|| {
        // Even steps of x / (1 + x), which is between 0 and 1 for all light.
        let exposed = |i: usize| i as f32 / (TABLE - i) as f32;
        (0..=TABLE + 1)
            .map(|i| display(exposed(i.min(TABLE))))
            .collect()
    });
    exposed.map(|x| {
        let place = x.max(0.0) / (1.0 + x.max(0.0)) * TABLE as f32;
        let before = place as usize;
        values[before] + (values[before + 1] - values[before]) * (place - before as f32)
    })
}

/// Function that [`encode`] tabulates.
fn display(exposed: f32) -> f32 {
    255.0 * srgb_from_linear(1.0 - (-exposed).exp())
}

/// The inverse of [`encode`]. 255 would be infinitely bright; it is taken as 254.9.
pub(crate) fn decode(display: Vec3) -> Vec3 {
    display.map(|v| -(1.0 - linear_from_srgb(v.clamp(0.0, 254.9) / 255.0)).ln())
}

/// Rounds a display value to a byte.
pub(crate) fn to_bytes(display: Vec3) -> [u8; 3] {
    display.to_array().map(|v| (v + 0.5) as u8)
}

/// The display value, 0 to 1, of linear light from 0 to 1.
pub(crate) fn srgb_from_linear(x: f32) -> f32 {
    if x <= 0.003_130_8 {
        12.92 * x
    } else {
        1.055 * x.powf(1.0 / 2.4) - 0.055
    }
}

/// The inverse of [`srgb_from_linear`].
pub(crate) fn linear_from_srgb(x: f32) -> f32 {
    if x <= 0.040_45 {
        x / 12.92
    } else {
        ((x + 0.055) / 1.055).powf(2.4)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decoding_undoes_encoding() {
        for x in [0.0, 0.001, 0.05, 0.6, 2.0, 5.0] {
            let back = decode(encode(Vec3::splat(x))).x;
            assert!(
                (back - x).abs() <= 2e-4 * (1.0 + x.exp()),
                "{x} came back as {back}"
            );
        }
    }

    #[test]
    fn the_table_is_within_a_thousandth_of_a_grey_level_of_its_formula() {
        for i in 0..200_000_u32 {
            let exposed = (i as f32 * 1e-4).powi(3) * 1e-2;
            let error = encode(Vec3::splat(exposed)).x - display(exposed);
            assert!(error.abs() < 0.001, "{error} at {exposed}");
        }
        let ends = encode(Vec3::new(-1.0, 0.0, 1e30));
        assert!(ends.abs_diff_eq(Vec3::new(0.0, 0.0, 255.0), 1e-3), "{ends}");
    }

    #[test]
    fn a_bright_horizon_is_light_grey_and_a_dark_one_dark_grey() {
        let shown =
            |luminance| encode(Tone::for_horizon(luminance).expose(Vec3::splat(luminance))).x;
        assert!(
            (165.0..215.0).contains(&shown(8_000.0)),
            "{}",
            shown(8_000.0)
        );
        assert!((50.0..110.0).contains(&shown(0.05)), "{}", shown(0.05));
    }
}
