//! Settings for a training that takes a second.

/// For `dtd train --config`: networks of a few neurons, and few steps.
pub const TINY_TRAINING: &str = "
[calibration]
hidden = [16]
features = 16
head_hidden = [16]
optimisation = { steps = 60, batch_size = 64, learning_rate = 0.003 }
[estimator]
lstm = [16]
head_hidden = [16]
optimisation = { steps = 60, batch_size = 64, learning_rate = 0.003 }
[mono]
optimisation = { steps = 60, batch_size = 64, learning_rate = 0.003 }
";
