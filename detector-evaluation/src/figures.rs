//! `evaluation.json`: all figures of a detector on a corpus.
//!
//! Its keys `modes.*.max_range_nm`, `effective_range_nm`, `recall_by_nm`, `false_alarms_per_hour` and `cpu_ms_per_picture`, and
//! `registration.disparity_sd_px` and `by_nm`, are the summary; everything else is the detail behind it. Ranges refer to the clearest
//! weather, and recall to the kinds of weather that hide the aircraft nowhere; both are named.

use std::collections::BTreeMap;

use dataset::corpus::model_identity::ModelIdentity;
use dataset::corpus::open_scenario::OpenScenario;
use labeller::{CpuTime, Failure, Findings};
use serde::Serialize;

use crate::accuracy::{AccuracyTally, BoxErrors, DisparityErrors, WidthFigures};
use crate::average_precision::{AveragePrecision, PrecisionTally, TrueAircraft};
use crate::error::Result;
use crate::false_alarms::{AlarmTally, FalseAlarms};
use crate::outcome::Searched;
use crate::recall::{
    Condition, Counts, NotExpected, OVERALL_NM, Range, Recall, RecallBin, RecallTally,
};
use dataset::conditions::sight::Sight;

/// The whole file.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Evaluation {
    /// Version of this software.
    pub dtd: String,
    /// The detector.
    pub model: EvaluatedModel,
    /// Scenarios that were searched.
    pub scenarios: Vec<String>,
    /// Scenarios that could not be searched. They are in no figure.
    pub failed: Vec<Failure>,
    /// The weather that ranges are of: that with the longest visibility.
    pub range_weather: Option<String>,
    /// The weathers that `recall` and `recall_by_nm` are of: those that hide the aircraft nowhere; all, if each does.
    pub recall_weathers: Vec<String>,
    /// Figures by mode.
    pub modes: BTreeMap<String, ModeFigures>,
    /// Accuracy of the registration of two views, of the first mode; null with one view.
    pub registration: Option<RegistrationFigures>,
}

/// The detector that was evaluated.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct EvaluatedModel {
    /// File and hashes.
    #[serde(flatten)]
    pub identity: ModelIdentity,
    /// Device on which it ran.
    pub device: String,
}

/// A search mode's figures.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ModeFigures {
    /// Ranges in [`Evaluation::range_weather`].
    #[serde(flatten)]
    pub range: Range,
    /// Recall for aircraft in sight, in [`Evaluation::recall_weathers`].
    pub recall_by_nm: Vec<RecallBin>,
    /// Recall from 1 to 10 NM.
    pub recall: Recall,
    /// False confirmed tracks an hour and view.
    pub false_alarms_per_hour: Option<f64>,
    /// Processor time an image, decoding included.
    pub cpu_ms_per_picture: Option<f64>,
    /// Processor time by stage.
    pub cpu_ms_by_stage: Option<CpuTime>,
    /// All images, each counted once.
    pub pictures: PictureFigures,
    /// Figures by weather.
    pub by_weather: BTreeMap<String, ConditionFigures>,
    /// Figures by local time.
    pub by_time: BTreeMap<String, ConditionFigures>,
    /// All weathers.
    pub false_alarms: FalseAlarms,
    /// Errors of the boxes from 1 to 10 NM.
    pub boxes: BoxErrors,
    /// Mile by mile.
    pub boxes_by_nm: Vec<BoxErrors>,
    /// Figures by width of the ground-truth box.
    pub by_width: Vec<WidthFigures>,
    /// Errors of the disparity from 1 to 10 NM.
    pub disparity: DisparityErrors,
    /// Mile by mile.
    pub disparity_by_nm: Vec<DisparityErrors>,
    /// Average precision, COCO's way.
    pub average_precision: AveragePrecision,
}

/// All searched images: `total` is the sum of all other numbers but `found`, `confirmed` and `missed` in each part.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct PictureFigures {
    /// Images of all scenarios and views.
    pub total: u64,
    /// Images without an expected aircraft.
    pub not_expected: NotExpected,
    /// Images with the aircraft, by obstruction.
    #[serde(flatten)]
    pub expected: SightCounts,
}

/// Images with the aircraft in the frame, by obstruction.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct SightCounts {
    /// Unobstructed.
    pub in_sight: Counts,
    /// Haze or fog: less than 2 % of the contrast remains.
    pub hidden_by_haze: Counts,
    /// It flies in or above clouds, which may hide it.
    pub maybe_hidden_by_cloud: Counts,
}

/// Figures in a weather or at a time.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ConditionFigures {
    /// The aircraft in sight, from 1 to 10 NM.
    pub recall: Recall,
    /// Recall by distance.
    pub recall_by_nm: Vec<RecallBin>,
    /// Counts at all distances, by obstruction.
    #[serde(flatten)]
    pub expected: SightCounts,
    /// Ranges; only by weather.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub range: Option<Range>,
    /// False alarms; only by weather.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub false_alarms: Option<FalseAlarms>,
}

/// Accuracy of the registration of two views.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RegistrationFigures {
    /// Robust standard deviation of the error of the registered disparity from 1 to 10 NM.
    pub disparity_sd_px: Option<f64>,
    /// Disparity error between box centres, px.
    pub boxes_disparity_sd_px: Option<f64>,
    /// Mile by mile.
    pub by_nm: Vec<RegistrationBin>,
}

/// A mile of [`RegistrationFigures`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RegistrationBin {
    /// Smallest distance to touchdown, nautical miles, included.
    pub from_nm: f64,
    /// Largest distance, excluded.
    pub to_nm: f64,
    /// Ticks with detections in both views.
    pub pairs: u64,
    /// Pairs with a registered shift.
    pub registered: u64,
    /// Robust standard deviation of the error of the registered disparity.
    pub disparity_sd_px: Option<f64>,
    /// Disparity error between box centres, px.
    pub boxes_disparity_sd_px: Option<f64>,
}

/// Counters for one mode.
#[derive(Debug, Clone, Default)]
pub(crate) struct Tally {
    recall: RecallTally,
    alarms: AlarmTally,
    accuracy: AccuracyTally,
    precision: PrecisionTally,
    cpu_s: CpuTime,
}

impl Tally {
    pub(crate) fn count(
        &mut self,
        scenario: &OpenScenario,
        searched: &[Searched<'_>],
        findings: &Findings,
    ) -> Result<()> {
        let record = scenario.record()?;
        let (weather, time_of_day) = (record.weather_name(), record.time_of_day());
        self.recall.count(weather, time_of_day, searched);
        self.alarms
            .count(weather, record.frame_rate.period_s(), searched);
        self.accuracy
            .count(scenario, searched, &findings.registrations)?;
        for searched in searched {
            let picture = searched.picture;
            let truth = picture.truth.as_ref().map(|truth| TrueAircraft {
                pixel_box: truth.pixel_box,
                is_ignored: picture.expected().is_none() || picture.sight != Sight::Open,
            });
            let boxes: Vec<_> = searched
                .boxes
                .iter()
                .map(|found| (found.pixel_box, found.score))
                .collect();
            self.precision.count(truth, &boxes);
        }
        self.cpu_s += findings.cpu_s;
        Ok(())
    }

    /// Weathers that never hide the aircraft.
    pub(crate) fn open_weathers(&self) -> Vec<String> {
        self.recall.open_weathers()
    }

    /// All figures.
    pub(crate) fn figures(
        self,
        range_weather: Option<&String>,
        recall_weathers: &[String],
    ) -> ModeFigures {
        let recall = &self.recall;
        let is_open = |at: &Condition<'_>| recall_weathers.iter().any(|name| name == at.weather);
        let pictures = recall.pictures();
        let per_picture_ms = |seconds: f64| 1e3 * seconds / pictures as f64;
        let cost = (pictures > 0).then(|| self.cpu_s.map(per_picture_ms));
        let false_alarms = self.alarms.of(|_| true);
        let by_weather = recall.weathers().map(|name| {
            let mut figures = condition(recall, |at| at.weather == name);
            figures.range = Some(recall.range(std::slice::from_ref(name)));
            figures.false_alarms = Some(self.alarms.of(|weather| weather == name));
            (name.clone(), figures)
        });
        let by_time = recall.times().into_iter().map(|time| {
            let figures = condition(recall, |at| at.time_of_day == time);
            (time, figures)
        });
        let range_weather: Vec<String> = range_weather.into_iter().cloned().collect();
        ModeFigures {
            range: recall.range(&range_weather),
            recall_by_nm: recall.by_distance(is_open),
            recall: recall.overall(is_open),
            false_alarms_per_hour: false_alarms.confirmed_tracks_per_hour,
            cpu_ms_per_picture: cost.map(|cost| cost.total()),
            cpu_ms_by_stage: cost,
            pictures: PictureFigures {
                total: pictures,
                not_expected: recall.not_expected(),
                expected: SightCounts::of(recall.by_sight(|_| true)),
            },
            by_weather: by_weather.collect(),
            by_time: by_time.collect(),
            false_alarms,
            boxes: self.accuracy.boxes_in(OVERALL_NM),
            boxes_by_nm: self.accuracy.boxes_by_nm(),
            by_width: self.accuracy.by_width(),
            disparity: self.accuracy.disparity_in(OVERALL_NM),
            disparity_by_nm: self.accuracy.disparity_by_nm(),
            average_precision: self.precision.figures(),
        }
    }
}

fn condition(
    recall: &RecallTally,
    wanted: impl Fn(&Condition<'_>) -> bool + Copy,
) -> ConditionFigures {
    ConditionFigures {
        recall: recall.overall(wanted),
        recall_by_nm: recall.by_distance(wanted),
        expected: SightCounts::of(recall.by_sight(wanted)),
        range: None,
        false_alarms: None,
    }
}

impl SightCounts {
    fn of(mut counts: BTreeMap<Sight, Counts>) -> Self {
        let mut of = |sight: Sight| counts.remove(&sight).unwrap_or_default();
        Self {
            in_sight: of(Sight::Open),
            hidden_by_haze: of(Sight::Haze),
            maybe_hidden_by_cloud: of(Sight::Cloud),
        }
    }
}

impl RegistrationFigures {
    /// `None` without pairs of views.
    pub(crate) fn of(mode: &ModeFigures) -> Option<Self> {
        let deviation = |spread: Option<dataset::numbers::spread::Spread>| {
            spread.map(|spread| spread.deviation)
        };
        let bin = |errors: &DisparityErrors| RegistrationBin {
            from_nm: errors.from_nm,
            to_nm: errors.to_nm,
            pairs: errors.pairs,
            registered: errors.registered,
            disparity_sd_px: deviation(errors.registered_px),
            boxes_disparity_sd_px: deviation(errors.boxes_px),
        };
        let overall = bin(&mode.disparity);
        (!mode.disparity_by_nm.is_empty()).then(|| Self {
            disparity_sd_px: overall.disparity_sd_px,
            boxes_disparity_sd_px: overall.boxes_disparity_sd_px,
            by_nm: mode.disparity_by_nm.iter().map(bin).collect(),
        })
    }
}
