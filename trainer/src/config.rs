//! Training settings. The defaults are the paper's method; [`PaperDeviation`] lists deviations. Saved as `config.json` next to the results.

pub(crate) mod backend;
mod check;
mod loss;
mod paper_deviation;
mod stage_end;

use std::path::PathBuf;

use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;
use schemars::JsonSchema;
use schemars::generate::SchemaSettings;
use serde::{Deserialize, Serialize};

use crate::config::backend::TrainingBackend;
pub use crate::samples::sides::scenario_split::ScenarioSplitConfig;
pub use loss::Loss;
pub(crate) use loss::{TARGET_UNIT_M, Target};
pub use paper_deviation::PaperDeviation;
pub(crate) use stage_end::Plateau;
pub use stage_end::StageEnd;

/// Training settings. Unknown keys are rejected.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct TrainConfig {
    /// Seed of all random choices: initial weights and batches. 0 is an ordinary seed. `--seed` overrides it.
    pub seed: u64,
    /// Device that networks train on.
    pub backend: TrainingBackend,
    /// File name or hash of the detection model whose boxes are used, if the corpus has detections of several. `--detections` overrides it.
    pub model_hash: Option<String>,
    /// Shortest distance to the touchdown target that is used for training, nautical miles.
    pub min_dtd_nm: f64,
    /// Longest distance to the touchdown target that is used for training, nautical miles.
    pub max_dtd_nm: Option<f64>,
    /// `weather=NAME`, `time=HH:MM`, `type=NAME` or `graphics=SETTING=VALUE`: scenarios of this weather, time, aircraft type or graphics
    /// setting are the test side, whatever the split, and train nothing. `--leave-out` overrides it.
    pub leave_out: Option<String>,
    /// Split by scenario, as in the paper, whatever the corpus's split: both sides share flights. `--split-by-scenario` sets its
    /// `test_share`.
    pub scenario_split: Option<ScenarioSplitConfig>,
    /// Use scenarios that were recorded in a different weather than planned (marked by `dtd generate`). `--accept-weather` switches it on.
    pub accept_weather: bool,
    /// Run folder whose networks this training starts from, instead of random ones. They must have the same layers and views.
    /// `--start-from` overrides it.
    pub start_from: Option<PathBuf>,
    /// Loss that the networks minimise; the mean squared error of the distance in the paper.
    pub loss: Loss,
    /// Unit of the distance that networks predict, nautical miles; 10 in the authors' software. The logarithm has no unit.
    pub target_unit_nm: f64,
    /// Divisor of the features of boxes.
    pub feature_scale: FeatureScale,
    /// Train networks only on boxes that contain the aircraft according to the labels. The paper's networks train on all detections.
    /// Formulas are always fitted to boxes that contain the aircraft.
    pub only_true_boxes: bool,
    /// Standard deviation of a camera's direction between flights, seconds of arc, beside what the training's flights show. It counts where
    /// fog or night hides the background. The default is what a steel mast of 10 m height and 0.3 m diameter bends by if one side is a
    /// quarter of a kelvin warmer.
    pub camera_stability_arcsec: f64,
    /// Stage one: calibration networks and their shared head.
    pub calibration: CalibrationConfig,
    /// Stage two: the distance estimator.
    pub estimator: EstimatorConfig,
    /// The monoscopic baseline networks.
    pub mono: MonoConfig,
    /// Prior of `self_calibrated`.
    pub self_calibration: SelfCalibrationConfig,
}

impl Default for TrainConfig {
    fn default() -> Self {
        Self {
            seed: 0,
            backend: TrainingBackend::Cpu,
            model_hash: None,
            min_dtd_nm: 0.05,
            max_dtd_nm: None,
            leave_out: None,
            scenario_split: None,
            accept_weather: false,
            start_from: None,
            loss: Loss::Squared,
            target_unit_nm: TARGET_UNIT_M / METERS_PER_NAUTICAL_MILE,
            feature_scale: FeatureScale::Deviation,
            only_true_boxes: false,
            camera_stability_arcsec: 20.0,
            calibration: CalibrationConfig::default(),
            estimator: EstimatorConfig::default(),
            mono: MonoConfig::default(),
            self_calibration: SelfCalibrationConfig::default(),
        }
    }
}

/// JSON Schema of the settings file, with a final newline. Draft 7: the newest that editors and `taplo` read.
pub fn schema() -> String {
    let mut schema = SchemaSettings::draft07()
        .into_generator()
        .into_root_schema_for::<TrainConfig>();
    schema.insert("title".into(), "Settings of a training of dtd".into());
    format!("{:#}\n", schema.to_value())
}

/// The scale of the features of boxes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum FeatureScale {
    /// Mean and standard deviation per view and feature, over the training boxes.
    Deviation,
    /// Width and height of the image, without an offset.
    Picture,
}

/// Mini-batches and learning rate; all three keys are required. Adam's rate rises linearly over the first 2 % of a cycle's steps, then
/// falls along half a cosine to a thousandth.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Optimisation {
    /// Number of mini-batches, or its maximum if a plateau ends the training.
    pub steps: usize,
    /// Samples in a mini-batch.
    pub batch_size: usize,
    /// Highest learning rate.
    pub learning_rate: f64,
}

/// Settings of stage one. The paper trains at most 225 000 epochs; here a step is a mini-batch.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct CalibrationConfig {
    /// Hidden layers of the calibration networks.
    pub hidden: Vec<usize>,
    /// Length of the feature vectors.
    pub features: usize,
    /// Hidden layers of the shared auxiliary head.
    pub head_hidden: Vec<usize>,
    /// Mini-batches and learning rate.
    pub optimisation: Optimisation,
    /// End of the stage.
    pub ends: StageEnd,
    /// Steps of the first cycle, if a plateau ends the stage.
    pub first_cycle: usize,
    /// Steps between two entries of the convergence log, at least a pass over the training side; each evaluates on the validation side.
    pub log_every: usize,
    /// `Min` of Algorithm 1: steps before the set of optimised views may change (again); 1500 in the paper.
    pub min_steps: usize,
    /// Plateau threshold of Algorithm 1: spread of the last logged errors per view, and, in all stages, the minimum fall of the errors over
    /// a cycle. Percentage points of MAPE; 0.01 in the paper.
    pub plateau_threshold_pct: f64,
    /// Threshold of Algorithm 1 for the gap to the best view, percentage points of MAPE; 0.01 in the paper.
    pub gap_threshold_pct: f64,
}

impl Default for CalibrationConfig {
    fn default() -> Self {
        Self {
            hidden: vec![128, 128],
            features: 256,
            head_hidden: vec![128],
            optimisation: Optimisation {
                steps: 225_000,
                batch_size: 256,
                learning_rate: 2e-3,
            },
            ends: StageEnd::Plateau,
            first_cycle: 10_000,
            log_every: 50,
            min_steps: 1_500,
            plateau_threshold_pct: 0.01,
            gap_threshold_pct: 0.01,
        }
    }
}

/// Settings of stage two.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct EstimatorConfig {
    /// Width of each LSTM layer; two layers in the paper.
    pub lstm: Vec<usize>,
    /// Hidden layers of the regression after the LSTM layers.
    pub head_hidden: Vec<usize>,
    /// Mini-batches and learning rate.
    pub optimisation: Optimisation,
    /// End of the stage.
    pub ends: StageEnd,
    /// Steps of the first cycle, if a plateau ends the stage.
    pub first_cycle: usize,
    /// Steps between two entries of the convergence log; each evaluates on the validation side.
    pub log_every: usize,
    /// Initial share of the first cycle's steps during which all batches use all views; afterwards, views are dropped at random.
    /// Single-view batches can keep the network on a plateau where it averages the views' separate answers; with this setting it first
    /// learns to combine views. 0, as in the paper, drops views from the first step on.
    pub together_first: f64,
    /// Loss weight of single-view batches, relative to batches with all views; 1 in the paper. The error floor of single views, which
    /// training cannot lower, is ten times the floor of two views; at equal weights it dominates the loss.
    pub alone_weight: f64,
}

impl Default for EstimatorConfig {
    fn default() -> Self {
        Self {
            lstm: vec![256, 256],
            head_hidden: vec![128],
            optimisation: Optimisation {
                steps: 225_000,
                batch_size: 256,
                learning_rate: 1e-3,
            },
            ends: StageEnd::Plateau,
            first_cycle: 20_000,
            log_every: 250,
            together_first: 0.0,
            alone_weight: 1.0,
        }
    }
}

/// Settings of the monoscopic baseline networks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct MonoConfig {
    /// Hidden layers.
    pub hidden: Vec<usize>,
    /// Mini-batches and learning rate, of each view's network.
    pub optimisation: Optimisation,
    /// End of each network's training.
    pub ends: StageEnd,
    /// Steps of the first cycle, if a plateau ends it.
    pub first_cycle: usize,
}

impl Default for MonoConfig {
    fn default() -> Self {
        Self {
            hidden: vec![64, 64],
            optimisation: Optimisation {
                steps: 32_000,
                batch_size: 256,
                learning_rate: 3e-3,
            },
            ends: StageEnd::Plateau,
            first_cycle: 2_000,
        }
    }
}

/// Prior of `self_calibrated` (docs/estimators.md): deviations of the cameras from the planned rig.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SelfCalibrationConfig {
    /// Standard deviation of the position along each axis, metres.
    pub position_sd_m: f64,
    /// Standard deviation of pan, tilt and roll, degrees.
    pub turn_sd_deg: f64,
    /// Standard deviation of the focal length, percent.
    pub focal_sd_pct: f64,
}

impl Default for SelfCalibrationConfig {
    fn default() -> Self {
        Self {
            position_sd_m: 2.0,
            turn_sd_deg: 5.0,
            focal_sd_pct: 20.0,
        }
    }
}

impl TrainConfig {
    pub(crate) fn target(&self) -> Target {
        Target {
            loss: self.loss,
            per_10_nm: (Self::default().target_unit_nm / self.target_unit_nm) as f32,
        }
    }

    /// Settings of `--quick`: narrower layers and fewer steps; about a minute on two cores, for a dozen scenarios.
    pub fn demo() -> Self {
        let narrow = |steps, learning_rate| Optimisation {
            steps,
            batch_size: 128,
            learning_rate,
        };
        Self {
            calibration: CalibrationConfig {
                hidden: vec![64, 64],
                features: 64,
                head_hidden: vec![64],
                optimisation: narrow(1_500, 3e-3),
                ends: StageEnd::Steps,
                min_steps: 300,
                ..CalibrationConfig::default()
            },
            estimator: EstimatorConfig {
                lstm: vec![96, 96],
                head_hidden: vec![96],
                optimisation: narrow(3_000, 4e-3),
                ends: StageEnd::Steps,
                ..EstimatorConfig::default()
            },
            mono: MonoConfig {
                optimisation: narrow(1_500, 3e-3),
                ends: StageEnd::Steps,
                ..MonoConfig::default()
            },
            ..Self::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_pass_their_own_check_and_survive_json() {
        let config = TrainConfig::default();
        config.check().unwrap();
        TrainConfig::demo().check().unwrap();
        let text = serde_json::to_string(&config).unwrap();
        assert_eq!(serde_json::from_str::<TrainConfig>(&text).unwrap(), config);
    }

    #[test]
    fn an_unknown_key_is_refused_by_name() {
        let message = serde_json::from_str::<TrainConfig>(r#"{"estimator": {"dropout": 0.5}}"#)
            .unwrap_err()
            .to_string();
        assert!(message.contains("dropout"), "{message}");
    }

    #[test]
    fn a_learning_rate_of_zero_and_an_empty_layer_are_refused() {
        let mut config = TrainConfig::default();
        config.estimator.optimisation.learning_rate = 0.0;
        assert!(
            config
                .check()
                .unwrap_err()
                .to_string()
                .contains("estimator.optimisation.learning_rate is 0")
        );
        let mut config = TrainConfig::default();
        config.calibration.hidden = vec![128, 0];
        assert!(
            config
                .check()
                .unwrap_err()
                .to_string()
                .contains("calibration.hidden")
        );
    }
}
