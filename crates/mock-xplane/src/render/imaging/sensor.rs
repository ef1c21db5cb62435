//! Sensor noise, added to a finished image.
//!
//! A pixel of display value 255 has a full well of electrons, others in proportion to their linear light. Variance is the number of
//! electrons (Poisson's, as a Gaussian) plus the variance of the read noise: `sqrt(electrons + read^2)` (the mean-variance model of EMVA
//! 1288). An exposure multiplies the light, and a full well holds no more. Each colour of each pixel has independent noise, from a hash of
//! seed, instant and position, so the number of threads has no effect.

use std::sync::LazyLock;

use dataset::geometry::imaging::Sensor;
use rayon::prelude::*;

use crate::render::imaging::tone::{linear_from_srgb, srgb_from_linear};

/// Steps of the normal distribution: a single 64-bit hash serves the three colours of each pixel.
const BELL_BITS: u32 = 14;
/// Steps of linear light in the table of display values: less than a quarter grey level each.
const LIGHT_STEPS: usize = 1 << 14;

/// Standard normal quantiles at the centres of equally likely steps.
static BELL: LazyLock<Vec<f32>> = LazyLock::new(|| {
    let steps = 1_u32 << BELL_BITS;
    (0..steps)
        .map(|step| normal_quantile((f64::from(step) + 0.5) / f64::from(steps)) as f32)
        .collect()
});
static DISPLAY: LazyLock<Vec<u8>> = LazyLock::new(|| {
    (0..LIGHT_STEPS)
        .map(|step| (255.0 * srgb_from_linear(step as f32 / (LIGHT_STEPS - 1) as f32) + 0.5) as u8)
        .collect()
});

/// A camera's noise.
pub(crate) struct SensorNoise {
    /// Linear light per display value, and the standard deviation of its noise, in steps of [`DISPLAY`].
    levels: [(f32, f32); 256],
    seed: u64,
}

impl SensorNoise {
    pub(crate) fn new(sensor: &Sensor, seed: u64) -> Self {
        let gain = sensor.exposure_ev.exp2();
        let levels = std::array::from_fn(|value| {
            let light = (f64::from(linear_from_srgb(value as f32 / 255.0)) * gain).min(1.0);
            let electrons = light * sensor.full_well_electrons;
            let sd = (electrons + sensor.read_noise_electrons.powi(2)).sqrt()
                / sensor.full_well_electrons;
            let steps = (LIGHT_STEPS - 1) as f64;
            ((light * steps) as f32, (sd * steps) as f32)
        });
        Self { levels, seed }
    }

    /// Adds the noise at an instant to rows of this width.
    pub(crate) fn add(&self, rgb: &mut [u8], width: usize, time_s: f64) {
        let instant = mixed(self.seed ^ mixed(time_s.to_bits()));
        let (bell, display) = (BELL.as_slice(), DISPLAY.as_slice());
        rgb.par_chunks_mut(width * 3)
            .with_min_len(16)
            .enumerate()
            .for_each(|(y, line)| {
                for (x, pixel) in line.as_chunks_mut::<3>().0.iter_mut().enumerate() {
                    let mut random = mixed(instant.wrapping_add((y * width + x) as u64));
                    for value in pixel {
                        let (light, sd) = self.levels[usize::from(*value)];
                        let draw = bell[(random & ((1 << BELL_BITS) - 1)) as usize];
                        random >>= BELL_BITS;
                        let noisy = (light + sd * draw).clamp(0.0, (LIGHT_STEPS - 1) as f32);
                        *value = display[(noisy + 0.5) as usize];
                    }
                }
            });
    }
}

/// The finaliser of SplitMix64 (Steele, Lea and Flood, "Fast Splittable Pseudorandom Number Generators", OOPSLA 2014).
fn mixed(value: u64) -> u64 {
    let mut z = value.wrapping_add(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// The value that a standard normal variable stays below with a probability between 0 and 1 (M. J. Wichura, "Algorithm AS 241", Applied
/// Statistics 37, 1988, the short form: seven digits).
fn normal_quantile(probability: f64) -> f64 {
    let polynomial = |x: f64, c: &[f64]| c.iter().rev().fold(0.0, |sum, c| sum * x + c);
    let off = probability - 0.5;
    if off.abs() <= 0.425 {
        let r = 0.180_625 - off * off;
        return off
            * polynomial(
                r,
                &[
                    3.387_132_717_9,
                    50.434_271_938,
                    159.291_132_02,
                    59.109_374_720,
                ],
            )
            / polynomial(r, &[1.0, 17.895_169_469, 78.757_757_664, 67.187_563_600]);
    }
    let tail = probability.min(1.0 - probability);
    let r = (-tail.ln()).sqrt();
    let far = if r <= 5.0 {
        let r = r - 1.6;
        polynomial(
            r,
            &[
                1.423_437_277_7,
                2.756_815_390_0,
                1.306_728_481_6,
                0.170_238_211_03,
            ],
        ) / polynomial(r, &[1.0, 0.737_001_642_50, 0.120_211_329_75])
    } else {
        let r = r - 5.0;
        polynomial(
            r,
            &[
                6.657_905_115_0,
                3.081_226_386_0,
                0.428_682_943_37,
                0.017_337_203_997,
            ],
        ) / polynomial(r, &[1.0, 0.241_978_942_25, 0.012_258_202_635])
    };
    far.copysign(off)
}

#[cfg(test)]
mod tests {
    use dataset::numbers::spread::mean_and_deviation;

    use super::*;

    #[test]
    fn quantiles_are_those_of_the_tables() {
        for (probability, expected) in [
            (0.5, 0.0),
            (0.841_344_746_1, 1.0),
            (0.975, 1.959_963_985),
            (0.001, -3.090_232_306),
            (0.999_968_328_758, 4.0),
        ] {
            let found = normal_quantile(probability);
            assert!((found - expected).abs() < 1e-6, "{found} for {expected}");
        }
    }

    #[test]
    fn the_noise_of_every_grey_has_the_variance_of_its_electrons_and_of_reading_out() {
        let sensor = Sensor {
            full_well_electrons: 10_000.0,
            read_noise_electrons: 20.0,
            exposure_ev: 0.0,
        };
        for grey in [20_u8, 60, 128, 200] {
            const SIDE: usize = 300;
            let mut rgb = vec![grey; SIDE * SIDE * 3];
            SensorNoise::new(&sensor, 5).add(&mut rgb, SIDE, 0.1);
            let light =
                |value: u8| f64::from(linear_from_srgb(f32::from(value) / 255.0)) * 10_000.0;
            let [mean, deviation] = mean_and_deviation(rgb.iter().map(|value| light(*value)));
            let expected = light(grey) + 400.0;
            // Rounding to whole display values adds the variance of a uniform distribution over one.
            let step = (light(grey + 1) - light(grey - 1)) / 2.0;
            let rounding = step * step / 12.0;
            let ratio = deviation.powi(2) / (expected + rounding);
            assert!((ratio - 1.0).abs() < 0.03, "{ratio} at {grey}");
            assert!(
                (mean - light(grey)).abs() < 0.02 * expected.sqrt(),
                "{mean} at {grey}"
            );
        }
    }

    #[test]
    fn a_stop_doubles_the_light_and_a_full_well_is_white() {
        let mean_of = |grey: u8, exposure_ev: f64| {
            let sensor = Sensor {
                full_well_electrons: 10_000.0,
                read_noise_electrons: 5.0,
                exposure_ev,
            };
            let mut rgb = vec![grey; 200 * 200 * 3];
            SensorNoise::new(&sensor, 5).add(&mut rgb, 200, 0.1);
            let light = |value: &u8| f64::from(linear_from_srgb(f32::from(*value) / 255.0));
            rgb.iter().map(light).sum::<f64>() / rgb.len() as f64
        };
        let ratio = mean_of(120, 1.0) / mean_of(120, 0.0);
        assert!((ratio - 2.0).abs() < 0.01, "{ratio}");
        assert!(mean_of(230, 1.0) > 0.99);
        let third = mean_of(120, -1.0 / 3.0) / mean_of(120, 0.0);
        assert!((third - 0.794).abs() < 0.005, "{third}");
    }

    #[test]
    fn every_instant_every_seed_and_every_colour_has_its_own_noise() {
        let sensor = Sensor {
            full_well_electrons: 500.0,
            read_noise_electrons: 5.0,
            exposure_ev: 0.0,
        };
        let draw = |seed: u64, time_s: f64| {
            let mut rgb = vec![120; 64 * 48 * 3];
            SensorNoise::new(&sensor, seed).add(&mut rgb, 64, time_s);
            rgb
        };
        let first = draw(1, 0.0);
        assert_eq!(first, draw(1, 0.0));
        let correlation = |a: &[u8], b: &[u8]| {
            let off = |v: u8| f64::from(v) - 120.0;
            let sum = |f: &dyn Fn(usize) -> f64| (0..a.len().min(b.len())).map(f).sum::<f64>();
            sum(&|i| off(a[i]) * off(b[i])) / sum(&|i| off(a[i]).powi(2))
        };
        for other in [draw(2, 0.0), draw(1, 1.0 / 30.0)] {
            assert!(correlation(&first, &other).abs() < 0.05);
        }
        for lag in [1, 3, 64 * 3] {
            assert!(correlation(&first, &first[lag..]).abs() < 0.05, "lag {lag}");
        }
    }
}
