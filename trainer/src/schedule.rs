//! The learning rate over a training, and the optimiser that it drives.

use burn::optim::{AdamConfig, ModuleOptimizer};

use crate::config::Optimisation;

/// Share of the steps over which the rate rises.
const WARM_UP: f64 = 0.02;
/// Share of the highest rate that remains at the end.
const FINAL: f64 = 1e-3;

/// Learning rate of a step: a linear rise, then half a cosine.
pub(crate) fn learning_rate(settings: &Optimisation, step: usize) -> f64 {
    let part = (step as f64 + 0.5) / settings.steps as f64;
    let factor = if part < WARM_UP {
        part / WARM_UP
    } else {
        let fallen = (part - WARM_UP) / (1.0 - WARM_UP);
        FINAL + (1.0 - FINAL) * 0.5 * (1.0 + (std::f64::consts::PI * fallen).cos())
    };
    settings.learning_rate * factor
}

/// Adam with PyTorch's epsilon (burn's default of 1e-5 is as large as gradients get here towards the end).
pub(crate) fn adam() -> ModuleOptimizer {
    AdamConfig::new().with_epsilon(1e-8).init()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rate_rises_to_its_highest_and_falls_to_almost_nothing() {
        let settings = Optimisation {
            steps: 1_000,
            batch_size: 1,
            learning_rate: 0.01,
        };
        let rates: Vec<_> = (0..1_000)
            .map(|step| learning_rate(&settings, step))
            .collect();
        assert!(
            rates[0] < 0.001 && rates[999] < 2e-5,
            "{} {}",
            rates[0],
            rates[999]
        );
        let highest = rates.iter().copied().fold(0.0, f64::max);
        assert!((highest - 0.01).abs() < 1e-4, "{highest}");
        assert!(rates[25..].windows(2).all(|pair| pair[1] <= pair[0]));
    }
}
