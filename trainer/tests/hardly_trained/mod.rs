//! Settings with which a training takes a second: formulas are as good as ever, networks are not.

use trainer::TrainConfig;
use trainer::config::Optimisation;

pub(crate) fn hardly_trained() -> TrainConfig {
    let steps = Optimisation {
        steps: 20,
        batch_size: 16,
        learning_rate: 1e-3,
    };
    let mut config = TrainConfig::default();
    config.calibration.hidden = vec![8];
    config.calibration.features = 8;
    config.calibration.head_hidden = vec![8];
    config.calibration.optimisation = steps.clone();
    config.estimator.lstm = vec![8];
    config.estimator.head_hidden = vec![8];
    config.estimator.optimisation = steps.clone();
    config.mono.hidden = vec![8];
    config.mono.optimisation = steps;
    config
}
