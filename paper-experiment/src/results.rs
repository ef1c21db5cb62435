//! `results/paper.json`: the figures behind the page.

use serde::{Deserialize, Serialize};
use trainer::Metrics;

use crate::single_views::SingleViews;

/// The paper's estimator.
pub(crate) const PAPER: &str = "paper_lstm";

/// The whole file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Results {
    /// Version of this software.
    pub dtd: String,
    /// The command, with `paper` as its folder.
    pub command: String,
    /// The corpus.
    pub corpus: CorpusFigures,
    /// The detector that misses aircraft, whose boxes train and judge.
    pub weaker: WeakerDetector,
    /// Ranges of detectors.
    pub ranges: Vec<Range>,
    /// Name of the recommended estimator.
    pub recommended: String,
    /// Standard deviation of the training flights to the side, metres.
    pub lateral_spread_m: Option<f64>,
    /// Figures of estimators on flights that the training has not seen, without those of each flight.
    pub by_trajectory: Metrics,
    /// Figures with the paper's split: scenarios are drawn, so test scenarios share flights with the training.
    pub by_scenario: Metrics,
    /// Time of each stage, in their order.
    pub stages: Vec<StageTime>,
}

/// The recorded corpus.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct CorpusFigures {
    /// `small` or `full`.
    pub scale: String,
    /// Simulators that recorded it.
    pub simulators: Vec<String>,
    /// The runway.
    pub runway: String,
    /// The type of aircraft.
    pub aircraft: String,
    /// The cameras.
    pub rig: String,
    /// Names of the weathers.
    pub weathers: Vec<String>,
    /// Local times.
    pub times: Vec<String>,
    /// Scenarios.
    pub scenarios: usize,
    /// Different flights among them.
    pub flights: usize,
    /// Width of the images, pixels.
    pub width_px: u32,
    /// Height of the images, pixels.
    pub height_px: u32,
    /// Images per second and view, as a sweep writes it.
    pub frame_rate: String,
    /// Images of all views.
    pub pictures: u64,
}

/// The detector with settings that make it miss aircraft.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WeakerDetector {
    /// Shrink factor for the first pass.
    pub first_pass_shrink: u32,
    /// Minimum score that it reports.
    pub least_score: f64,
    /// Ticks of the whole corpus that it sees in one view alone.
    pub single_views: SingleViews,
    /// Ticks that the detector itself sees in one view alone.
    pub of_detector: SingleViews,
}

/// Search mode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Search {
    /// Tiles of 640 pixels, and a second pass around each hit: the paper's Auto Segmentation.
    Tiles,
    /// The whole image shrunk to the model's size: the paper's conventional scaling.
    Scaled,
    /// Small windows around known aircraft.
    Tracked,
}

/// Detector range and cost, in one weather, on flights that start beyond its range.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Range {
    /// File name of the model.
    pub model: String,
    /// Hash of the model and its settings.
    pub model_blake3: String,
    /// Weather of the ranges.
    pub weather: Option<String>,
    /// True for one that was trained on photographs by others, and is used as it is.
    pub is_pretrained: bool,
    /// The search.
    pub search: Search,
    /// Farthest detection, nautical miles.
    pub max_range_nm: Option<f64>,
    /// Distance up to which more than 99 % are found.
    pub effective_range_nm: Option<f64>,
    /// The farthest image that shows the aircraft.
    pub farthest_expected_nm: Option<f64>,
    /// Share of the aircraft from 1 to 10 NM that was found.
    pub recall: Option<f64>,
    /// Processor time per image, decoding included, milliseconds.
    pub cpu_ms_per_picture: Option<f64>,
}

/// Time that a stage took in all calls of the command, without those that were killed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StageTime {
    /// Name of the stage.
    pub stage: String,
    /// Seconds.
    pub seconds: f64,
}

impl Results {
    /// Removes figures that the page does not compare with the paper: flights, and pairs of weather and time except for the paper's
    /// estimator.
    #[must_use]
    pub fn compared(mut self) -> Self {
        for metrics in [&mut self.by_trajectory, &mut self.by_scenario] {
            for (name, estimator) in &mut metrics.estimators {
                estimator.by_flight.clear();
                if name != PAPER {
                    estimator.by_weather_and_time.clear();
                }
            }
        }
        self
    }
}
