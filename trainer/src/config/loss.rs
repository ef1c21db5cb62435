//! Regression loss, and the unit of network outputs.

use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Regression loss. The figure of merit is a percentage, whereas the paper's squared error treats 18 m alike everywhere, which is 0.1 % at
/// 10 NM but 1 % at 1 NM.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Loss {
    /// Networks predict distances in units of 10 NM; mean squared error, as in equation (1) of the paper.
    Squared,
    /// Mean squared error, each sample divided by its squared distance.
    Relative,
    /// Networks predict the natural logarithm of the distance in units of 10 NM; mean squared error of that, which for small errors
    /// is the relative error.
    Logarithmic,
}

/// Unit of the networks' distances, metres.
pub(crate) const TARGET_UNIT_M: f64 = 10.0 * METERS_PER_NAUTICAL_MILE;

/// Loss with the output unit of networks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Target {
    /// Loss.
    pub(crate) loss: Loss,
    /// Predicted number for 10 NM.
    pub(crate) per_10_nm: f32,
}

impl Target {
    /// Distances below this (in units of 10 NM; 0.5 NM) are treated as this one: percentages explode at touchdown.
    const MIN_DISTANCE: f32 = 0.05;

    /// Sample weight at `distance` (units of 10 NM).
    pub(crate) fn weight(self, distance: f32) -> f32 {
        match self.loss {
            Loss::Squared => 1.0,
            Loss::Relative => distance.max(Self::MIN_DISTANCE).powi(-2),
            // The logarithm weighs every percent equally already; nearer than that its slope is limited.
            Loss::Logarithmic => (distance / Self::MIN_DISTANCE).min(1.0).powi(2),
        }
    }

    /// Ideal network output at `distance` (units of 10 NM).
    pub(crate) fn target(self, distance: f32) -> f32 {
        match self.loss {
            Loss::Squared | Loss::Relative => distance * self.per_10_nm,
            Loss::Logarithmic => distance.ln(),
        }
    }

    /// Distance (units of 10 NM) for a network output.
    pub(crate) fn distance(self, predicted: f32) -> f32 {
        match self.loss {
            Loss::Squared | Loss::Relative => predicted / self.per_10_nm,
            Loss::Logarithmic => predicted.exp(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::TrainConfig;

    #[test]
    fn what_networks_predict_is_in_the_unit_of_the_settings_but_for_logarithms() {
        for (loss, expected) in [(Loss::Squared, 5.0), (Loss::Logarithmic, 0.5_f32.ln())] {
            let config = TrainConfig {
                loss,
                target_unit_nm: 1.0,
                ..TrainConfig::default()
            };
            let target = config.target();
            assert!((target.target(0.5) - expected).abs() < 1e-6);
            assert!((target.distance(expected) - 0.5).abs() < 1e-6);
        }
        assert_eq!(TrainConfig::default().target().target(0.5), 0.5);
    }

    #[test]
    fn one_percent_costs_the_same_at_every_distance_but_under_the_squared_loss() {
        let target = |loss| Target {
            loss,
            per_10_nm: 1.0,
        };
        let cost = |loss: Loss, distance: f32| {
            let loss = target(loss);
            loss.weight(distance) * (loss.target(1.01 * distance) - loss.target(distance)).powi(2)
        };
        for loss in [Loss::Relative, Loss::Logarithmic] {
            assert!((cost(loss, 0.1) / cost(loss, 1.0) - 1.0).abs() < 1e-3);
            assert!(
                cost(loss, 0.01) < 0.1 * cost(loss, 0.1),
                "the last 0.5 NM must not rule"
            );
            let loss = target(loss);
            assert!((loss.distance(loss.target(0.3)) - 0.3).abs() < 1e-6);
        }
        assert!((cost(Loss::Squared, 0.1) / cost(Loss::Squared, 1.0) - 0.01).abs() < 1e-4);
    }
}
