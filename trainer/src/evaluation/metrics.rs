//! `metrics.json`: evaluation rules, identity and figures.
//!
//! `PE = |predicted - true| / true * 100`; MAPE is its mean and SD its standard deviation (over all answers, not n - 1). *Dual* are the
//! ticks that two or more views saw, *combination* those that at least one view saw. Answers that are not finite count as missing. A tick
//! without an answer reduces coverage. Figures over no answer are `null`, all others are numbers.

mod bootstrap;
mod box_figures;
mod figures;
mod one_view;
mod stated_intervals;

use std::collections::BTreeMap;

use dataset::corpus::effective_weather::ReportedWeather;
use serde::{Deserialize, Serialize};

use crate::background::Alignment;
use crate::config::PaperDeviation;
use crate::evaluation::judged::Judged;
use crate::evaluation::rules::EvaluationRules;
use crate::networks::stage::StageSummary;
use crate::samples::ScenarioSummary;
use crate::samples::training_cameras::DroppedBoxes;

pub(crate) use bootstrap::Intervals;
pub(crate) use box_figures::BoxFigures;
pub use figures::ErrorFigures;
pub(crate) use figures::quantile;
pub(crate) use one_view::AgainstOneView;
pub(crate) use stated_intervals::StatedIntervals;

/// Figures with and without the ticks that only one view saw, or none.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SplitFigures {
    /// All ticks with the aircraft present.
    #[serde(flatten)]
    pub all: ErrorFigures,
    /// Two or more views saw the aircraft; missing if the number of views is unknown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dual: Option<ErrorFigures>,
    /// At least one view saw the aircraft; missing if the number of views is unknown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub combination: Option<ErrorFigures>,
}

/// Figures for a distance bin.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DistanceBin {
    /// Smallest distance, nautical miles, included.
    pub from_nm: f64,
    /// Largest distance, nautical miles, excluded.
    pub to_nm: f64,
    /// Signed errors for a box plot; `null` without an answer.
    pub signed: Option<BoxFigures>,
    /// The figures.
    #[serde(flatten)]
    pub figures: ErrorFigures,
}

/// Figures for one flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FlightFigures {
    /// Scenario.
    pub scenario: String,
    /// Trajectory name.
    pub trajectory: String,
    /// Coverage of the stated intervals, if the estimator states any.
    pub intervals_held: Option<f64>,
    /// The figures.
    #[serde(flatten)]
    pub figures: ErrorFigures,
}

/// Figures while views fail.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RemovedFigures {
    /// All ticks.
    #[serde(flatten)]
    pub all: ErrorFigures,
    /// Ticks with a removed view.
    pub removed: ErrorFigures,
    /// Intervals for the figures over all ticks.
    pub intervals: Option<Intervals>,
    /// Intervals that the estimator states, if any.
    pub stated_intervals: Option<StatedIntervals>,
}

/// All figures for one estimator.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EstimatorMetrics {
    /// Figures over everything.
    #[serde(flatten)]
    pub overall: SplitFigures,
    /// Intervals for the figures over everything.
    pub intervals: Option<Intervals>,
    /// Intervals that the estimator states, if any.
    pub stated_intervals: Option<StatedIntervals>,
    /// Figures over the ticks answered by every estimator with any answer.
    pub common: ErrorFigures,
    /// Figures by view removal.
    pub views_removed: BTreeMap<String, RemovedFigures>,
    /// Figures by weather name.
    pub by_weather: BTreeMap<String, SplitFigures>,
    /// Figures by local time.
    pub by_time: BTreeMap<String, SplitFigures>,
    /// Figures by weather name and local time, separated by a space.
    pub by_weather_and_time: BTreeMap<String, SplitFigures>,
    /// Figures by aircraft type; empty if all scenarios have the same.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub by_type: BTreeMap<String, SplitFigures>,
    /// Figures by distance, without gaps.
    pub by_distance_nm: Vec<DistanceBin>,
    /// Figures by scenario.
    pub by_flight: Vec<FlightFigures>,
}

/// Sizes on one side.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct SideCount {
    /// Number of scenarios.
    pub scenarios: usize,
    /// Number of trajectories.
    pub trajectories: usize,
    /// Number of ticks that at least one view saw, within the evaluated (test) or trained (other sides) distances.
    pub samples: usize,
}

/// Sizes of all sides.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SplitSummary {
    /// The unit that is kept together: `trajectory`, or `scenario` if sides share flights.
    pub by: String,
    /// Test scenarios with a flight that training saw in a different scenario; 0 if trajectories are kept together.
    pub test_scenarios_sharing_flights: usize,
    /// Training.
    pub train: SideCount,
    /// Validation.
    pub validation: SideCount,
    /// Test.
    pub test: SideCount,
}

/// Numbers of evaluated ticks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct TickCounts {
    /// Ticks with the aircraft present, the base of coverage.
    pub there: usize,
    /// Ticks with the aircraft hidden by fog in every image.
    pub hidden_by_fog: usize,
    /// Ticks with an accepted box in at least one view; missing if a table does not say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seen: Option<usize>,
    /// Ticks answered by every estimator with any answer.
    pub common: usize,
}

/// Training steps and duration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrainingFigures {
    /// Stages in order.
    pub stages: Vec<StageSummary>,
    /// Duration, seconds.
    pub training_s: f64,
}

/// The whole file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Metrics {
    /// Rules of the evaluation.
    pub rules: EvaluationRules,
    /// Identity of the evaluation.
    pub judged: Judged,
    /// The split.
    pub split: SplitSummary,
    /// Numbers of evaluated ticks.
    pub ticks: TickCounts,
    /// Boxes at these ticks, one per view, that were ignored because training has none at this position or with this size, or because they
    /// do not belong to the followed aircraft.
    pub disbelieved_boxes: usize,
    /// Training boxes that do not contain the aircraft, by view.
    pub dropped_training_boxes: BTreeMap<String, DroppedBoxes>,
    /// Images at these ticks with only boxes that the image's edge cuts off, which are ignored.
    pub cut_off_boxes: usize,
    /// Deviations of `paper_lstm` from the paper, by its settings.
    pub deviations_from_paper: Vec<PaperDeviation>,
    /// Comparison of the cameras' backgrounds with the training's.
    #[serde(default)]
    pub alignment: Alignment,
    /// Messages about views that are late in a flight; missing without any.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub late_views: Vec<String>,
    /// Weather that simulators reported at the aircraft, by name of the planned weather; missing without reports.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub weather_at_aircraft: BTreeMap<String, ReportedWeather>,
    /// The training.
    pub training: TrainingFigures,
    /// `paper_lstm` compared with networks for one view.
    pub against_one_view: Vec<AgainstOneView>,
    /// Figures by estimator name.
    pub estimators: BTreeMap<String, EstimatorMetrics>,
}

/// An estimator's answer at one tick, with its ground truth and grouping keys.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Outcome<'a> {
    /// Ground truth, metres.
    pub dtd_m: f64,
    /// Prediction, metres, if any.
    pub predicted_m: Option<f64>,
    /// 90 % interval, metres, if the estimator states one.
    pub interval_m: Option<[f64; 2]>,
    /// Number of views that saw the aircraft, if known.
    pub detections: Option<usize>,
    pub is_hidden: bool,
    pub is_removed: bool,
    pub of: &'a Group<'a>,
}

/// Grouping keys, common to a scenario.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Group<'a> {
    pub scenario: &'a str,
    pub trajectory: &'a str,
    /// Flight identity, independent of the trajectory's name.
    pub flight: &'a str,
    pub weather: &'a str,
    pub time_of_day: &'a str,
    pub aircraft: &'a str,
}

impl<'a> Group<'a> {
    pub(crate) fn of(scenario: &'a ScenarioSummary) -> Self {
        Self {
            scenario: &scenario.id,
            trajectory: &scenario.trajectory,
            flight: &scenario.flight,
            weather: &scenario.weather,
            time_of_day: &scenario.time_of_day,
            aircraft: &scenario.aircraft,
        }
    }

    /// For tests, whose outcomes only borrow.
    #[cfg(test)]
    pub(crate) fn leaked(self) -> &'a Self {
        Box::leak(Box::new(self))
    }
}

impl Outcome<'_> {
    /// Signed percentage error, positive if the prediction is too far; `None` if it is not finite.
    pub(crate) fn signed_error_pct(&self) -> Option<f64> {
        let error_pct = (self.predicted_m? - self.dtd_m) / self.dtd_m * 100.0;
        Some(error_pct).filter(|error| error.is_finite())
    }

    fn error_m(&self) -> Option<f64> {
        Some((self.predicted_m? - self.dtd_m).abs())
    }
}

impl SplitFigures {
    fn of(outcomes: &[&Outcome]) -> Self {
        let of = || outcomes.iter().copied();
        let is_known = of().all(|outcome| outcome.detections.is_some());
        let seen_by = |least: usize| {
            let seen = of().filter(|outcome| outcome.detections >= Some(least));
            is_known.then(|| ErrorFigures::of(seen))
        };
        Self {
            all: ErrorFigures::of(of()),
            dual: seen_by(2),
            combination: seen_by(1),
        }
    }
}

impl RemovedFigures {
    /// Figures over all ticks, in their order.
    pub(crate) fn of(outcomes: &[Outcome], rules: &EvaluationRules) -> Self {
        Self {
            all: ErrorFigures::of(outcomes),
            removed: ErrorFigures::of(outcomes.iter().filter(|outcome| outcome.is_removed)),
            intervals: Intervals::of(outcomes, &rules.bootstrap),
            stated_intervals: StatedIntervals::of(outcomes),
        }
    }
}

impl EstimatorMetrics {
    /// All figures for one estimator; `common` marks the ticks that all have answered. Distance bins cover the range between the nearest
    /// and the farthest outcome.
    pub(crate) fn of(
        outcomes: &[Outcome],
        common: &[bool],
        views_removed: BTreeMap<String, RemovedFigures>,
        rules: &EvaluationRules,
    ) -> Self {
        let by = |key: fn(&Outcome) -> String| -> BTreeMap<String, SplitFigures> {
            let mut groups: BTreeMap<String, Vec<&Outcome>> = BTreeMap::new();
            for outcome in outcomes {
                groups.entry(key(outcome)).or_default().push(outcome);
            }
            let groups = groups.into_iter();
            groups
                .map(|(name, group)| (name, SplitFigures::of(&group)))
                .collect()
        };
        let by_type = by(|outcome| outcome.of.aircraft.to_owned());
        let shared = outcomes.iter().zip(common).filter(|(_, common)| **common);
        Self {
            overall: SplitFigures::of(&outcomes.iter().collect::<Vec<_>>()),
            intervals: Intervals::of(outcomes, &rules.bootstrap),
            stated_intervals: StatedIntervals::of(outcomes),
            common: ErrorFigures::of(shared.map(|(outcome, _)| outcome)),
            views_removed,
            by_weather_and_time: by(|outcome| {
                format!("{} {}", outcome.of.weather, outcome.of.time_of_day)
            }),
            by_weather: by(|outcome| outcome.of.weather.to_owned()),
            by_time: by(|outcome| outcome.of.time_of_day.to_owned()),
            by_type: if by_type.len() > 1 {
                by_type
            } else {
                BTreeMap::new()
            },
            by_distance_nm: distance_bins(outcomes, rules.distance_bin_nm)
                .into_iter()
                .map(|([from_nm, to_nm], inside)| DistanceBin {
                    from_nm,
                    to_nm,
                    signed: BoxFigures::of(
                        (inside.iter())
                            .filter_map(|outcome| outcome.signed_error_pct())
                            .collect(),
                    ),
                    figures: ErrorFigures::of(inside),
                })
                .collect(),
            by_flight: outcomes
                .chunk_by(|a, b| a.of.scenario == b.of.scenario)
                .map(|flight| FlightFigures {
                    scenario: flight[0].of.scenario.to_owned(),
                    trajectory: flight[0].of.trajectory.to_owned(),
                    intervals_held: StatedIntervals::of(flight).map(|stated| stated.held),
                    figures: ErrorFigures::of(flight),
                })
                .collect(),
        }
    }
}

/// Maximum number of bins; beyond it, bins are an integer number of times as wide.
const MAX_BINS: usize = 200;

/// Outcomes by bins `[from, to)` of distance in nautical miles, from the nearest to the farthest outcome.
pub(crate) fn distance_bins<'a>(
    outcomes: &'a [Outcome<'a>],
    bin_nm: f64,
) -> Vec<([f64; 2], Vec<&'a Outcome<'a>>)> {
    let distance_nm =
        |outcome: &Outcome| outcome.dtd_m / dataset::numbers::units::METERS_PER_NAUTICAL_MILE;
    let distances = || outcomes.iter().map(distance_nm);
    let (Some(nearest), Some(farthest)) =
        (distances().reduce(f64::min), distances().reduce(f64::max))
    else {
        return Vec::new();
    };
    let wanted = (farthest / bin_nm).floor() - (nearest / bin_nm).floor() + 1.0;
    let width_nm = bin_nm * (wanted / MAX_BINS as f64).ceil().max(1.0);
    let bin_of = |outcome: &Outcome| (distance_nm(outcome) / width_nm) as usize;
    let first = (nearest / width_nm) as usize;
    let count = (farthest / width_nm) as usize - first + 1;
    let mut bins: Vec<_> = (first..first + count)
        .map(|bin| {
            let bounds = [bin as f64 * width_nm, (bin + 1) as f64 * width_nm];
            (bounds, Vec::new())
        })
        .collect();
    for outcome in outcomes {
        bins[bin_of(outcome) - first].1.push(outcome);
    }
    bins
}

#[cfg(test)]
impl Outcome<'_> {
    /// An answer at a tick that two views saw.
    pub(crate) fn of_answer(dtd_m: f64, predicted_m: Option<f64>) -> Self {
        Self {
            dtd_m,
            predicted_m,
            interval_m: None,
            detections: Some(2),
            is_hidden: false,
            is_removed: false,
            of: &Group {
                scenario: "0000",
                trajectory: "a",
                flight: "a",
                weather: "clear",
                time_of_day: "08:00",
                aircraft: "B737-800",
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outcome(
        dtd_m: f64,
        predicted_m: Option<f64>,
        detections: usize,
        weather: &'static str,
    ) -> Outcome<'static> {
        let alike = Outcome::of_answer(dtd_m, predicted_m);
        Outcome {
            detections: Some(detections),
            of: Group {
                weather,
                ..*alike.of
            }
            .leaked(),
            ..alike
        }
    }

    fn judged(outcomes: &[Outcome<'static>]) -> EstimatorMetrics {
        let is_answered = |outcome: &Outcome| outcome.signed_error_pct().is_some();
        let common: Vec<bool> = outcomes.iter().map(is_answered).collect();
        let rules = EvaluationRules::current();
        EstimatorMetrics::of(outcomes, &common, BTreeMap::new(), &rules)
    }

    #[test]
    fn types_have_figures_of_their_own_if_there_are_several() {
        let of_type = |aircraft: &'static str, predicted_m| {
            let alike = Outcome::of_answer(1_000.0, Some(predicted_m));
            Outcome {
                of: Group {
                    aircraft,
                    ..*alike.of
                }
                .leaked(),
                ..alike
            }
        };
        let (small, large) = (of_type("A320neo", 1_010.0), of_type("A350-900", 970.0));
        assert!(judged(&[small, small]).by_type.is_empty());
        let by_type = judged(&[small, small, large]).by_type;
        let mape_pct = |name: &str| by_type[name].all.mape_pct.unwrap();
        assert!((mape_pct("A320neo") - 1.0).abs() < 1e-9);
        assert!((mape_pct("A350-900") - 3.0).abs() < 1e-9);
    }

    #[test]
    fn mape_and_sd_of_a_case_computed_by_hand() {
        // Errors of 1 %, 3 % and 2 %: mean 2 %, variance (1 + 1 + 0) / 3.
        let outcomes = [
            outcome(1_000.0, Some(1_010.0), 2, "clear"),
            outcome(2_000.0, Some(1_940.0), 1, "clear"),
            outcome(10_000.0, Some(9_800.0), 2, "foggy"),
            outcome(10_000.0, None, 1, "foggy"),
        ];
        let metrics = judged(&outcomes);
        let all = metrics.overall.combination.unwrap();
        assert_eq!(all.samples, 3);
        assert!((all.mape_pct.unwrap() - 2.0).abs() < 1e-9);
        assert!((all.sd_pct.unwrap() - (2.0_f64 / 3.0).sqrt()).abs() < 1e-9);
        let dual = metrics.overall.dual.unwrap();
        assert_eq!(dual.samples, 2);
        assert!((dual.mape_pct.unwrap() - 1.5).abs() < 1e-9);
        assert!(
            (metrics.by_weather["clear"]
                .combination
                .unwrap()
                .mape_pct
                .unwrap()
                - 2.0)
                .abs()
                < 1e-9
        );
        assert_eq!(metrics.by_weather["clear"].dual.unwrap().samples, 1);
        assert_eq!(metrics.by_time["08:00"].combination.unwrap().samples, 3);
        assert_eq!((all.ticks, all.coverage), (4, Some(0.75)));
        assert!((all.median_pct.unwrap() - 2.0).abs() < 1e-9);
        assert!((all.p95_pct.unwrap() - 3.0).abs() < 1e-9);
        // Off by 10, 60 and 200 m.
        assert!((all.mae_m.unwrap() - 90.0).abs() < 1e-9);
        assert!((all.p95_m.unwrap() - 200.0).abs() < 1e-9);
    }

    #[test]
    fn distance_bins_leave_no_gap_and_an_empty_bin_has_no_figures() {
        let outcomes = [
            outcome(1_000.0, Some(1_000.0), 2, "clear"),
            outcome(4_000.0, Some(4_040.0), 2, "clear"),
        ];
        let bins = judged(&outcomes).by_distance_nm;
        let bounds: Vec<_> = bins
            .iter()
            .map(|bin| (bin.from_nm, bin.to_nm, bin.figures.samples))
            .collect();
        assert_eq!(bounds, [(0.0, 1.0, 1), (1.0, 2.0, 0), (2.0, 3.0, 1)]);
        assert_eq!(bins[1].figures.mape_pct, None);
        assert!((bins[2].figures.mape_pct.unwrap() - 1.0).abs() < 1e-9);
    }

    #[test]
    fn a_far_reach_has_wider_bins_and_never_more_than_a_page_can_show() {
        let half_around_the_world_m = 2.0e7;
        let outcomes = [
            outcome(1_000.0, Some(1_000.0), 2, "clear"),
            outcome(half_around_the_world_m, Some(1.0), 2, "clear"),
        ];
        for bin_nm in [0.01, 1.0] {
            let bins = distance_bins(&outcomes, bin_nm);
            assert!(bins.len() <= MAX_BINS + 1, "{}", bins.len());
            let held: usize = bins.iter().map(|(_, inside)| inside.len()).sum();
            assert_eq!(held, 2);
            let ([from_nm, to_nm], inside) = bins.last().unwrap();
            let distance_nm = inside[0].dtd_m / dataset::numbers::units::METERS_PER_NAUTICAL_MILE;
            assert!((*from_nm..*to_nm).contains(&distance_nm));
        }
    }

    #[test]
    fn answers_beyond_all_measure_are_no_numbers_and_end_nothing() {
        let answers = [f64::INFINITY, f64::NAN, 3e307, -3e307, 1e300];
        let outcomes = answers.map(|answer| outcome(20.0, Some(answer), 2, "clear"));
        let metrics = judged(&outcomes);
        let json = serde_json::to_string(&metrics).unwrap();
        let read: EstimatorMetrics = serde_json::from_str(&json).unwrap();
        assert_eq!(read, metrics);
        let ErrorFigures {
            mape_pct,
            sd_pct,
            samples,
            ..
        } = metrics.overall.all;
        assert_eq!(samples, 3, "those that are numbers");
        assert!(
            mape_pct.unwrap().is_finite() && sd_pct.unwrap().is_finite(),
            "samples without figures: {json}"
        );
    }

    #[test]
    fn what_is_missing_is_null_in_json_and_never_zero() {
        let metrics = judged(&[outcome(1_000.0, None, 1, "clear")]);
        let json = serde_json::to_value(&metrics).unwrap();
        assert!(
            json["mape_pct"].is_null() && json["dual"]["sd_pct"].is_null(),
            "{json}"
        );
        assert_eq!(json["samples"], 0);
        assert_eq!(json["by_distance_nm"][0]["to_nm"], 1.0);
        assert_eq!(
            serde_json::from_value::<EstimatorMetrics>(json).unwrap(),
            metrics
        );
    }

    #[test]
    fn a_tick_without_an_answer_counts_against_coverage_and_fog_is_told_apart() {
        let hidden = Outcome {
            is_hidden: true,
            ..outcome(2_000.0, None, 0, "foggy")
        };
        let outcomes = [
            outcome(2_000.0, Some(2_020.0), 2, "foggy"),
            outcome(2_000.0, None, 0, "foggy"),
            outcome(2_000.0, Some(f64::NAN), 1, "foggy"),
            hidden,
        ];
        let SplitFigures {
            all,
            dual,
            combination,
        } = judged(&outcomes).overall;
        let (dual, combination) = (dual.unwrap(), combination.unwrap());
        assert_eq!((all.samples, all.ticks, all.coverage), (1, 4, Some(0.25)));
        assert_eq!(all.coverage_in_sight, Some(1.0 / 3.0));
        assert!((all.mape_pct.unwrap() - 1.0).abs() < 1e-9);
        assert_eq!((dual.ticks, dual.coverage), (1, Some(1.0)));
        assert_eq!((combination.ticks, combination.coverage), (2, Some(0.5)));
    }

    #[test]
    fn figures_of_the_common_ticks_are_of_these_alone() {
        let outcomes =
            [Some(1_010.0), Some(1_030.0), None].map(|a| outcome(1_000.0, a, 2, "clear"));
        let common = [true, false, false];
        let rules = EvaluationRules::current();
        let figures = EstimatorMetrics::of(&outcomes, &common, BTreeMap::new(), &rules).common;
        assert_eq!((figures.samples, figures.ticks), (1, 1));
        assert!((figures.mape_pct.unwrap() - 1.0).abs() < 1e-9);
    }
}
