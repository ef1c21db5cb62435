//! Settings for trainings of seconds.
#![allow(dead_code, reason = "each test file uses a part of it")]

use trainer::TrainConfig;
use trainer::config::Optimisation;

/// Formulas are fully fitted, networks are not.
pub(crate) fn hardly_trained() -> TrainConfig {
    narrow(8, 20, 16, 1e-3)
}

/// Networks with a single layer, all trained for the same number of steps.
pub(crate) fn narrow(
    width: usize,
    steps: usize,
    batch_size: usize,
    learning_rate: f64,
) -> TrainConfig {
    let optimisation = Optimisation {
        steps,
        batch_size,
        learning_rate,
    };
    let mut config = TrainConfig::default();
    config.calibration.hidden = vec![width];
    config.calibration.features = width;
    config.calibration.head_hidden = vec![width];
    config.calibration.optimisation = optimisation.clone();
    config.estimator.lstm = vec![width];
    config.estimator.head_hidden = vec![width];
    config.estimator.optimisation = optimisation.clone();
    config.mono.hidden = vec![width];
    config.mono.optimisation = optimisation;
    config
}
