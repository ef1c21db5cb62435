//! Random numbers: one stream per varying part, all from the flight's seed.
//!
//! Input: the seed of the request. Output: generators that never share a number, so that a change in one part of the model (one
//! gust more, one pilot habit more) leaves the numbers of all other parts unchanged. ChaCha has streams built in and its output is
//! fixed; `rand`'s standard generator may change with its version.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;

/// Parts that draw numbers. Discriminants are stream numbers: append, never renumber.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Stream {
    /// Habits of the crew: speeds, distances, flare.
    Technique = 1,
    /// Turbulence along the flight path.
    TurbulenceAlong = 2,
    TurbulenceRight = 3,
    TurbulenceDown = 4,
    TurbulenceRoll = 5,
    /// Discrete gusts of the wind.
    Gusts = 6,
}

pub(crate) fn generator(seed: u64, stream: Stream) -> ChaCha12Rng {
    let mut generator = ChaCha12Rng::seed_from_u64(seed);
    generator.set_stream(stream as u64);
    generator
}

/// A number from the normal distribution with mean 0 and variance 1 (Box and Muller 1958; always two draws, so that the
/// position in the stream does not depend on the values).
pub(crate) fn standard_normal(generator: &mut ChaCha12Rng) -> f64 {
    let radius = (-2.0 * (1.0 - generator.random::<f64>()).ln()).sqrt();
    radius * (std::f64::consts::TAU * generator.random::<f64>()).cos()
}

/// A number from `low` to `high`, all equally likely.
pub(crate) fn uniform(generator: &mut ChaCha12Rng, low: f64, high: f64) -> f64 {
    low + (high - low) * generator.random::<f64>()
}

#[cfg(test)]
mod tests {
    use dataset::numbers::spread::mean_and_deviation;

    use super::*;

    #[test]
    fn normal_numbers_have_mean_zero_and_variance_one() {
        let mut generator = generator(0, Stream::Gusts);
        let draws: Vec<f64> = (0..20_000)
            .map(|_| standard_normal(&mut generator))
            .collect();
        let [mean, deviation] = mean_and_deviation(draws.into_iter());
        assert!(mean.abs() < 0.03, "mean {mean}");
        assert!(
            (deviation.powi(2) - 1.0).abs() < 0.04,
            "deviation {deviation}"
        );
    }

    #[test]
    fn streams_and_seeds_give_different_numbers() {
        let first = |seed, stream| generator(seed, stream).random::<u64>();
        assert_eq!(first(7, Stream::Gusts), first(7, Stream::Gusts));
        assert_ne!(first(7, Stream::Gusts), first(7, Stream::Technique));
        assert_ne!(first(7, Stream::Gusts), first(8, Stream::Gusts));
    }
}
