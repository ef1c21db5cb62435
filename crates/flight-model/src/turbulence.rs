//! Continuous turbulence: the air's deviations from its mean motion, as experienced by an aircraft that flies through it.
//!
//! Input: intensity (0 to 1), height above ground, airspeed, time step. Output: gust velocities along, right and down, and a
//! rolling gust. The spectra, scale lengths and intensities are the Dryden form of MIL-F-8785C (1980), section 3.7: its low
//! altitude model below 1,000 ft, its 1,750 ft scale length above 2,000 ft, linear in between. White noise drives the spectrum's
//! rational filters; first-order parts are stepped exactly, so the variance does not depend on the time step.

use dataset::numbers::units::{METERS_PER_FOOT, MPS_PER_KNOT};
use rand_chacha::ChaCha12Rng;

use super::random::{self, Stream, standard_normal};
use super::time_step::STEP_S;

/// Wind at 20 ft that MIL-F-8785C calls severe (light is 15 kt, moderate 30 kt): the meaning of intensity 1.
const SEVERE_WIND_AT_20_FT_MPS: f64 = 45.0 * MPS_PER_KNOT;

/// Standard deviation above 2,000 ft per metre per second of wind at 20 ft. The specification has curves of exceedance there
/// instead; this line goes through the recorded flights, whose airspeed fluctuates that much more at 2,500 ft.
const HIGH_SIGMA_PER_WIND_AT_20_FT: f64 = 0.22;

/// Minimum height for the low altitude model, metres: its vertical scale length would go to zero.
const MIN_HEIGHT_M: f64 = 5.0;

#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Gust {
    /// Velocity of the air along the flight path, metres per second.
    pub(crate) along_mps: f64,
    /// Velocity of the air to the right of the flight path, metres per second.
    pub(crate) right_mps: f64,
    /// Velocity of the air downwards, metres per second.
    pub(crate) down_mps: f64,
    /// Rotation of the air about the flight path, radians per second.
    pub(crate) roll_rad_per_s: f64,
}

/// Standard deviations and scale lengths at one height.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Scales {
    sigma_horizontal_mps: f64,
    sigma_vertical_mps: f64,
    length_horizontal_m: f64,
    length_vertical_m: f64,
}

#[derive(Debug)]
pub(crate) struct Turbulence {
    wind_at_20_ft_mps: f64,
    /// Span of the wing that takes the mean of the gusts, metres.
    span_m: f64,
    along: FirstOrder,
    right: SecondOrder,
    down: SecondOrder,
    roll: FirstOrder,
}

impl Turbulence {
    /// Turbulence of intensity `ratio` (0 none, 1/3 light, 2/3 moderate, 1 severe), already developed when the flight begins.
    pub(crate) fn new(ratio: f64, seed: u64, span_m: f64) -> Self {
        Self {
            wind_at_20_ft_mps: ratio * SEVERE_WIND_AT_20_FT_MPS,
            span_m,
            along: FirstOrder::new(random::generator(seed, Stream::TurbulenceAlong)),
            right: SecondOrder::new(random::generator(seed, Stream::TurbulenceRight)),
            down: SecondOrder::new(random::generator(seed, Stream::TurbulenceDown)),
            roll: FirstOrder::new(random::generator(seed, Stream::TurbulenceRoll)),
        }
    }

    /// The gusts one step later, at a height above ground, through air that comes at `airspeed_mps`.
    pub(crate) fn step(&mut self, height_m: f64, airspeed_mps: f64) -> Gust {
        let scales = Scales::at(self.wind_at_20_ft_mps, height_m);
        let airspeed_mps = airspeed_mps.max(10.0);
        let horizontal_s = scales.length_horizontal_m / airspeed_mps;
        let vertical_s = scales.length_vertical_m / airspeed_mps;
        // MIL-F-8785C 3.7.3 as later standards print it: sigma_p = 1.9 sigma_w / sqrt(L_w b), L_p = sqrt(L_w b) / 2.6.
        let roll_length_m = (scales.length_vertical_m * self.span_m).sqrt();
        let roll_s = roll_length_m / 2.6 / airspeed_mps;
        Gust {
            along_mps: scales.sigma_horizontal_mps * self.along.step(horizontal_s),
            right_mps: scales.sigma_horizontal_mps * self.right.step(horizontal_s),
            down_mps: scales.sigma_vertical_mps * self.down.step(vertical_s),
            roll_rad_per_s: 1.9 * scales.sigma_vertical_mps / roll_length_m
                * self.roll.step(roll_s),
        }
    }
}

impl Scales {
    fn at(wind_at_20_ft_mps: f64, height_m: f64) -> Self {
        let height_ft = height_m.max(MIN_HEIGHT_M) / METERS_PER_FOOT;
        if height_ft <= 1_000.0 {
            return Self::low(wind_at_20_ft_mps, height_ft);
        }
        let low = Self::low(wind_at_20_ft_mps, 1_000.0);
        let high = Self::high(wind_at_20_ft_mps);
        let part = ((height_ft - 1_000.0) / 1_000.0).min(1.0);
        let between = |low: f64, high: f64| low + (high - low) * part;
        Self {
            sigma_horizontal_mps: between(low.sigma_horizontal_mps, high.sigma_horizontal_mps),
            sigma_vertical_mps: between(low.sigma_vertical_mps, high.sigma_vertical_mps),
            length_horizontal_m: between(low.length_horizontal_m, high.length_horizontal_m),
            length_vertical_m: between(low.length_vertical_m, high.length_vertical_m),
        }
    }

    /// MIL-F-8785C figures 10 and 11, for heights up to 1,000 ft.
    fn low(wind_at_20_ft_mps: f64, height_ft: f64) -> Self {
        let shape = 0.177 + 0.000_823 * height_ft;
        let sigma_vertical_mps = 0.1 * wind_at_20_ft_mps;
        Self {
            sigma_horizontal_mps: sigma_vertical_mps / shape.powf(0.4),
            sigma_vertical_mps,
            length_horizontal_m: height_ft / shape.powf(1.2) * METERS_PER_FOOT,
            length_vertical_m: height_ft * METERS_PER_FOOT,
        }
    }

    /// Isotropic scales above 2,000 ft.
    fn high(wind_at_20_ft_mps: f64) -> Self {
        let sigma_mps = HIGH_SIGMA_PER_WIND_AT_20_FT * wind_at_20_ft_mps;
        let length_m = 1_750.0 * METERS_PER_FOOT;
        Self {
            sigma_horizontal_mps: sigma_mps,
            sigma_vertical_mps: sigma_mps,
            length_horizontal_m: length_m,
            length_vertical_m: length_m,
        }
    }
}

/// Noise of variance 1 with the longitudinal Dryden spectrum, 1 / (1 + T s).
#[derive(Debug)]
struct FirstOrder {
    noise: ChaCha12Rng,
    value: f64,
}

impl FirstOrder {
    fn new(mut noise: ChaCha12Rng) -> Self {
        let value = standard_normal(&mut noise);
        Self { noise, value }
    }

    fn step(&mut self, time_constant_s: f64) -> f64 {
        let keep = (-STEP_S / time_constant_s).exp();
        self.value =
            keep * self.value + (1.0 - keep * keep).sqrt() * standard_normal(&mut self.noise);
        self.value
    }
}

/// Noise of variance 1 with the lateral and vertical Dryden spectrum, (1 + sqrt(3) T s) / (1 + T s)^2.
#[derive(Debug)]
struct SecondOrder {
    first: FirstOrder,
    second: f64,
}

impl SecondOrder {
    fn new(noise: ChaCha12Rng) -> Self {
        let mut first = FirstOrder::new(noise);
        // Start in the steady state: the second state has variance 1/2 and covariance 1/2 with the first.
        let second = 0.5 * first.value + 0.5 * standard_normal(&mut first.noise);
        Self { first, second }
    }

    fn step(&mut self, time_constant_s: f64) -> f64 {
        let keep = (-STEP_S / time_constant_s).exp();
        let drive = self.first.step(time_constant_s);
        self.second = keep * self.second + (1.0 - keep) * drive;
        // 1 + sqrt(3) T s on the second lag's output; 1/sqrt(2) makes the variance 1.
        let root_3 = 3.0_f64.sqrt();
        (root_3 * drive + (1.0 - root_3) * self.second) / 2.0_f64.sqrt()
    }
}

#[cfg(test)]
mod tests {
    use dataset::numbers::spread::mean_and_deviation;

    use super::*;

    fn series(height_m: f64, seconds: f64) -> Vec<Gust> {
        let mut turbulence = Turbulence::new(2.0 / 3.0, 11, 35.8);
        let steps = (seconds / STEP_S) as usize;
        (0..steps)
            .map(|_| turbulence.step(height_m, 72.0))
            .collect()
    }

    fn sigma(values: impl Iterator<Item = f64> + Clone) -> f64 {
        mean_and_deviation(values)[1]
    }

    #[test]
    fn moderate_turbulence_at_200_ft_has_the_intensities_of_the_specification() {
        // Moderate: 30 kt at 20 ft. sigma_w = 0.1 * 15.43 m/s; sigma_u = sigma_w / (0.177 + 0.000823 * 200)^0.4.
        let gusts = series(200.0 * METERS_PER_FOOT, 4_000.0);
        let vertical = sigma(gusts.iter().map(|gust| gust.down_mps));
        let along = sigma(gusts.iter().map(|gust| gust.along_mps));
        let right = sigma(gusts.iter().map(|gust| gust.right_mps));
        assert!((vertical / 1.543 - 1.0).abs() < 0.05, "vertical {vertical}");
        assert!((along / 2.367 - 1.0).abs() < 0.08, "along {along}");
        assert!((right / 2.367 - 1.0).abs() < 0.08, "right {right}");
    }

    /// Variance of the differences over `lag_s`, which the spectrum predicts through the autocorrelation.
    fn structure(values: &[f64], lag_s: f64) -> f64 {
        let lag = (lag_s / STEP_S).round() as usize;
        let pairs = values.len() - lag;
        (0..pairs)
            .map(|i| (values[i + lag] - values[i]).powi(2))
            .sum::<f64>()
            / pairs as f64
    }

    #[test]
    fn correlation_in_time_is_that_of_the_dryden_spectra() {
        let gusts = series(60.96, 8_000.0);
        let scales = Scales::at(2.0 / 3.0 * SEVERE_WIND_AT_20_FT_MPS, 60.96);
        let along: Vec<f64> = gusts.iter().map(|gust| gust.along_mps).collect();
        let down: Vec<f64> = gusts.iter().map(|gust| gust.down_mps).collect();
        for lag_s in [0.25, 0.5, 1.0, 2.0] {
            // Autocorrelations: exp(-x) along, exp(-x) (1 - x/2) across, x = V lag / L.
            let x = 72.0 * lag_s / scales.length_horizontal_m;
            let expected = 2.0 * scales.sigma_horizontal_mps.powi(2) * (1.0 - (-x).exp());
            let found = structure(&along, lag_s);
            assert!(
                (found / expected - 1.0).abs() < 0.1,
                "along {lag_s}: {found} {expected}"
            );
            let x = 72.0 * lag_s / scales.length_vertical_m;
            let expected =
                2.0 * scales.sigma_vertical_mps.powi(2) * (1.0 - (-x).exp() * (1.0 - x / 2.0));
            let found = structure(&down, lag_s);
            assert!(
                (found / expected - 1.0).abs() < 0.1,
                "down {lag_s}: {found} {expected}"
            );
        }
    }

    #[test]
    fn no_intensity_means_no_gust_at_all() {
        let mut turbulence = Turbulence::new(0.0, 3, 35.8);
        let still = (0..1_000).all(|_| {
            let gust = turbulence.step(300.0, 72.0);
            gust.along_mps == 0.0 && gust.right_mps == 0.0 && gust.down_mps == 0.0
        });
        assert!(still);
    }

    #[test]
    fn scales_have_no_jump_between_the_low_and_the_high_model() {
        for edge_ft in [1_000.0, 2_000.0] {
            let below = Scales::at(10.0, (edge_ft - 0.01) * METERS_PER_FOOT);
            let above = Scales::at(10.0, (edge_ft + 0.01) * METERS_PER_FOOT);
            assert!((below.sigma_vertical_mps - above.sigma_vertical_mps).abs() < 1e-3);
            assert!((below.length_horizontal_m - above.length_horizontal_m).abs() < 0.1);
        }
    }
}
