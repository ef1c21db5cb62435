//! Deviations from the paper, derived from settings and refits, so that no other method passes for the paper's. Some are in every
//! training.

use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{CalibrationConfig, EstimatorConfig, FeatureScale, Loss, StageEnd, TrainConfig};

/// A part of `paper_lstm` that differs from the paper. Numbers of steps and samples per batch do not count: the paper leaves them open,
/// except for the maximum number of calibration epochs.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum PaperDeviation {
    /// Calibration networks train in mini-batches, and Algorithm 1 decides after a pass of them; the paper's epochs are full batches.
    MiniBatches,
    /// `ends` is `plateau`: learning-rate cycles end a stage; in the paper, a number of epochs.
    StageEnd,
    /// Features are whitened before the LSTM.
    WhiteFeatures,
    /// `start_from`: the networks start from the weights of an earlier run.
    Start,
    /// `loss` is not `squared`.
    Loss,
    /// `only_true_boxes`: false boxes are removed from the training side by the labels.
    OnlyTrueBoxes,
    /// `calibration.min_steps`, or a threshold of Algorithm 1.
    AlgorithmThresholds,
    /// `estimator.together_first` or `.alone_weight`: views are not dropped in equal shares of equal weight.
    ViewDropout,
    /// `feature_scale` or `target_unit_nm` is not the authors'.
    Scales,
    /// Widths of the calibration networks, the LSTM or their heads.
    LayerWidths,
    /// `dtd refit`: a calibration network was trained again, with the estimator's error in its loss.
    RefittedView,
}

impl fmt::Display for PaperDeviation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::MiniBatches => "mini-batches in stage one",
            Self::StageEnd => "ends of the stages",
            Self::WhiteFeatures => "whitened features",
            Self::Start => "weights of another run as the start",
            Self::Loss => "loss",
            Self::OnlyTrueBoxes => "false training boxes removed by the labels",
            Self::AlgorithmThresholds => "thresholds of Algorithm 1",
            Self::ViewDropout => "view dropout in unequal shares",
            Self::Scales => "scales of features or distances",
            Self::LayerWidths => "layer widths",
            Self::RefittedView => "a view fitted again",
        })
    }
}

impl TrainConfig {
    /// Deviations of a training with these settings from the paper.
    pub fn deviations_from_paper(&self) -> Vec<PaperDeviation> {
        let (c, e) = (&self.calibration, &self.estimator);
        let (paper_c, paper_e) = (CalibrationConfig::default(), EstimatorConfig::default());
        let algorithm =
            |c: &CalibrationConfig| (c.min_steps, c.plateau_threshold_pct, c.gap_threshold_pct);
        let widths = |c: &CalibrationConfig, e: &EstimatorConfig| {
            let hidden = [&c.hidden, &c.head_hidden, &e.lstm, &e.head_hidden];
            (hidden.map(Vec::clone), c.features)
        };
        let ends_on_plateau = [c.ends, e.ends].contains(&StageEnd::Plateau);
        let found = [
            (PaperDeviation::MiniBatches, true),
            (PaperDeviation::StageEnd, ends_on_plateau),
            (PaperDeviation::WhiteFeatures, self.start_from.is_none()),
            (PaperDeviation::Start, self.start_from.is_some()),
            (PaperDeviation::Loss, self.loss != Loss::Squared),
            (PaperDeviation::OnlyTrueBoxes, self.only_true_boxes),
            (
                PaperDeviation::AlgorithmThresholds,
                algorithm(c) != algorithm(&paper_c),
            ),
            (
                PaperDeviation::ViewDropout,
                e.together_first > 0.0 || e.alone_weight != 1.0,
            ),
            (
                PaperDeviation::Scales,
                self.feature_scale != FeatureScale::Deviation
                    || self.target_unit_nm != Self::default().target_unit_nm,
            ),
            (
                PaperDeviation::LayerWidths,
                widths(c, e) != widths(&paper_c, &paper_e),
            ),
        ];
        let named = found.into_iter().filter(|(_, deviates)| *deviates);
        named.map(|(deviation, _)| deviation).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_are_the_paper_s_method_but_for_how_networks_are_fitted() {
        let config = TrainConfig::default();
        let fitting = [
            PaperDeviation::MiniBatches,
            PaperDeviation::StageEnd,
            PaperDeviation::WhiteFeatures,
        ];
        assert_eq!(config.deviations_from_paper(), fitting);
        let (c, e) = (&config.calibration, &config.estimator);
        assert_eq!(
            (
                config.loss,
                c.min_steps,
                c.plateau_threshold_pct,
                c.gap_threshold_pct,
                &e.lstm
            ),
            (Loss::Squared, 1_500, 0.01, 0.01, &vec![256, 256])
        );
    }

    #[test]
    fn every_setting_that_changes_the_method_is_named() {
        for (settings, expected) in [
            (r#"{"start_from": "run"}"#, PaperDeviation::Start),
            (r#"{"loss": "logarithmic"}"#, PaperDeviation::Loss),
            (
                r#"{"only_true_boxes": true}"#,
                PaperDeviation::OnlyTrueBoxes,
            ),
            (
                r#"{"calibration": {"gap_threshold_pct": 0.25}}"#,
                PaperDeviation::AlgorithmThresholds,
            ),
            (
                r#"{"calibration": {"min_steps": 300}}"#,
                PaperDeviation::AlgorithmThresholds,
            ),
            (
                r#"{"estimator": {"together_first": 0.5}}"#,
                PaperDeviation::ViewDropout,
            ),
            (
                r#"{"estimator": {"alone_weight": 0.02}}"#,
                PaperDeviation::ViewDropout,
            ),
            (
                r#"{"calibration": {"plateau_threshold_pct": 0.1}}"#,
                PaperDeviation::AlgorithmThresholds,
            ),
            (r#"{"feature_scale": "picture"}"#, PaperDeviation::Scales),
            (r#"{"target_unit_nm": 1}"#, PaperDeviation::Scales),
            (
                r#"{"estimator": {"lstm": [96, 96]}}"#,
                PaperDeviation::LayerWidths,
            ),
        ] {
            let config: TrainConfig = serde_json::from_str(settings).unwrap();
            let found = config.deviations_from_paper();
            let before = TrainConfig::default().deviations_from_paper();
            let added: Vec<_> = found.into_iter().filter(|d| !before.contains(d)).collect();
            assert_eq!(added, [expected], "{settings}");
        }
    }

    #[test]
    fn the_demo_s_settings_are_the_method_at_a_smaller_scale() {
        let deviations = TrainConfig::demo().deviations_from_paper();
        let scale = [
            PaperDeviation::MiniBatches,
            PaperDeviation::WhiteFeatures,
            PaperDeviation::AlgorithmThresholds,
            PaperDeviation::LayerWidths,
        ];
        assert_eq!(deviations, scale);
    }
}
