//! Discrete gusts: the wind freshens for some seconds and drops again.
//!
//! Input: mean wind, intensity of turbulence, time. Output: the relative increase in mean wind. Each gust has the "1 - cosine" shape of
//! MIL-F-8785C 3.7.2; strength, duration and waiting time are drawn. Continuous turbulence alone is Gaussian and lacks these.

use rand_chacha::ChaCha12Rng;

use super::random::{self, Stream, uniform};

/// Mean pause between two gusts, seconds.
const MEAN_PAUSE_S: f64 = 12.0;
/// Shortest and longest gust, seconds.
const DURATION_S: (f64, f64) = (5.0, 14.0);
/// Gusts begin with moderate turbulence: below this intensity airports report none.
const FIRST_RATIO: f64 = 1.0 / 3.0;
/// Strongest gust, as a part of the mean wind: airports report 22 kt gusting 33 kt.
const STRONGEST_FACTOR: f64 = 0.5;

#[derive(Debug)]
pub(crate) struct Gusts {
    generator: ChaCha12Rng,
    strongest_factor: f64,
    begins_s: f64,
    duration_s: f64,
    factor: f64,
}

impl Gusts {
    /// Gusts that come with turbulence of intensity `ratio`.
    pub(crate) fn new(ratio: f64, seed: u64) -> Self {
        let mut gusts = Self {
            generator: random::generator(seed, Stream::Gusts),
            strongest_factor: (3.0 * (ratio - FIRST_RATIO)).clamp(0.0, STRONGEST_FACTOR),
            begins_s: 0.0,
            duration_s: 0.0,
            factor: 0.0,
        };
        gusts.draw_next(0.0);
        gusts
    }

    /// Relative increase in mean wind at `time_s` (seconds, never decreasing).
    pub(crate) fn factor_at(&mut self, time_s: f64) -> f64 {
        while time_s > self.begins_s + self.duration_s {
            self.draw_next(self.begins_s + self.duration_s);
        }
        let phase = (time_s - self.begins_s) / self.duration_s;
        if phase <= 0.0 {
            return 0.0;
        }
        self.factor * 0.5 * (1.0 - (std::f64::consts::TAU * phase).cos())
    }

    fn draw_next(&mut self, from_s: f64) {
        let pause_s = -MEAN_PAUSE_S * (1.0 - uniform(&mut self.generator, 0.0, 1.0)).ln();
        self.begins_s = from_s + pause_s;
        self.duration_s = uniform(&mut self.generator, DURATION_S.0, DURATION_S.1);
        self.factor = self.strongest_factor * uniform(&mut self.generator, 0.4, 1.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gusts_of_a_storm_freshen_the_wind_by_at_most_a_half_and_often_by_none() {
        let mut gusts = Gusts::new(0.9, 4);
        let factors: Vec<f64> = (0..6_000)
            .map(|i| gusts.factor_at(f64::from(i) * 0.1))
            .collect();
        assert!(factors.iter().all(|factor| (0.0..=0.5).contains(factor)));
        assert!(factors.iter().any(|factor| *factor > 0.3));
        assert!(factors.iter().filter(|factor| **factor == 0.0).count() > 1_000);
        let steps = factors.windows(2).map(|pair| (pair[1] - pair[0]).abs());
        assert!(steps.fold(0.0, f64::max) < 0.04, "a gust jumps");
    }

    #[test]
    fn light_turbulence_brings_no_gusts() {
        let mut gusts = Gusts::new(0.3, 4);
        assert!((0..6_000).all(|i| gusts.factor_at(f64::from(i) * 0.1) == 0.0));
    }
}
