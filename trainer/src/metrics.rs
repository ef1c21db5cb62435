//! `metrics.json`: percentage errors on the test side.
//!
//! `PE = |predicted - true| / true * 100`; MAPE is its mean and SD its standard deviation (over all samples, not n - 1). *Dual* are
//! the samples that two or more views saw, *combination* those that at least one saw. Answers that are not finite are
//! no answers. Figures over no answer are `null`, all others are numbers.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::estimator::Estimator;

/// Mean and spread of the percentage error over some samples.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ErrorFigures {
    /// Mean absolute percentage error.
    pub mape_pct: Option<f64>,
    /// Standard deviation of the percentage error.
    pub sd_pct: Option<f64>,
    /// Number of samples for which there was a prediction.
    pub samples: usize,
}

/// Figures with and without the samples that only one view saw.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SplitFigures {
    /// All samples: the same as `combination`.
    #[serde(flatten)]
    pub all: ErrorFigures,
    /// Two or more views saw the aircraft.
    pub dual: ErrorFigures,
    /// At least one view saw the aircraft.
    pub combination: ErrorFigures,
}

/// Figures of a bin of distances.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DistanceBin {
    /// Smallest distance, nautical miles, included.
    pub from_nm: f64,
    /// Largest distance, nautical miles, excluded.
    pub to_nm: f64,
    /// The figures.
    #[serde(flatten)]
    pub figures: ErrorFigures,
}

/// All figures of one estimator.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EstimatorMetrics {
    /// Over everything.
    #[serde(flatten)]
    pub overall: SplitFigures,
    /// By name of the weather.
    pub by_weather: BTreeMap<String, SplitFigures>,
    /// By local time.
    pub by_time: BTreeMap<String, SplitFigures>,
    /// By distance, without gaps.
    pub by_distance_nm: Vec<DistanceBin>,
}

/// One side of the split in numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct SideCount {
    /// Scenarios.
    pub scenarios: usize,
    /// Trajectories.
    pub trajectories: usize,
    /// Ticks that at least one view saw, within the distances evaluated (test) or trained on (the others).
    pub samples: usize,
}

/// How the samples were split.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SplitSummary {
    /// The unit that is kept together: `trajectory`.
    pub by: String,
    /// For training.
    pub train: SideCount,
    /// For decisions during training.
    pub validation: SideCount,
    /// For all figures.
    pub test: SideCount,
    /// Smallest distance to touchdown that was evaluated, nautical miles.
    pub min_dtd_nm: f64,
    /// Largest distance to touchdown that was evaluated, nautical miles.
    pub max_dtd_nm: Option<f64>,
}

/// The whole file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Metrics {
    /// The split.
    pub split: SplitSummary,
    /// Boxes of the test side that were ignored because the training side has none at such a position or of such a size.
    #[serde(default)]
    pub disbelieved_boxes: usize,
    /// Figures by name of the estimator.
    pub estimators: BTreeMap<String, EstimatorMetrics>,
}

/// One prediction with what is needed to group it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Outcome<'a> {
    /// Truth, metres.
    pub dtd_m: f64,
    /// Prediction, metres, if there was one.
    pub predicted_m: Option<f64>,
    /// Number of views that saw the aircraft.
    pub detections: usize,
    /// Name of the weather.
    pub weather: &'a str,
    /// Local time.
    pub time_of_day: &'a str,
}

/// All predictions of one estimator, in the order of the evaluated samples.
pub(crate) struct EstimatorOutcomes<'a> {
    pub estimator: Estimator,
    pub outcomes: Vec<Outcome<'a>>,
}

impl Outcome<'_> {
    /// Signed percentage error: positive if the prediction is too far. None where it is not finite.
    pub(crate) fn signed_error_pct(&self) -> Option<f64> {
        let error_pct = (self.predicted_m? - self.dtd_m) / self.dtd_m * 100.0;
        Some(error_pct).filter(|error| error.is_finite())
    }
}

impl ErrorFigures {
    /// Figures of some outcomes.
    pub(crate) fn of<'a>(outcomes: impl IntoIterator<Item = &'a Outcome<'a>>) -> Self {
        let errors: Vec<f64> = outcomes
            .into_iter()
            .filter_map(|outcome| outcome.signed_error_pct().map(f64::abs))
            .collect();
        Self {
            mape_pct: mean(&errors),
            sd_pct: deviation(&errors),
            samples: errors.len(),
        }
    }
}

/// Mean of finite numbers: finite, because nothing is added before it is divided; `None` if there are none.
fn mean(numbers: &[f64]) -> Option<f64> {
    let count = numbers.len() as f64;
    let sum = numbers.iter().map(|number| number / count).sum();
    (!numbers.is_empty()).then_some(sum)
}

/// Their standard deviation, finite as well: only parts of the largest distance from the mean are squared.
fn deviation(numbers: &[f64]) -> Option<f64> {
    let mean = mean(numbers)?;
    let from_mean: Vec<f64> = numbers.iter().map(|number| (number - mean).abs()).collect();
    let largest = from_mean.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    let squares: Vec<f64> = from_mean.iter().map(|x| (x / largest).powi(2)).collect();
    Some(largest * self::mean(&squares)?.sqrt())
}

impl SplitFigures {
    fn of(outcomes: &[&Outcome]) -> Self {
        let combination = ErrorFigures::of(outcomes.iter().copied());
        let dual = ErrorFigures::of(
            outcomes
                .iter()
                .copied()
                .filter(|outcome| outcome.detections >= 2),
        );
        Self {
            all: combination,
            dual,
            combination,
        }
    }
}

impl EstimatorMetrics {
    /// All figures of one estimator; distance bins of `bin_nm` cover everything between the nearest and the farthest outcome.
    pub(crate) fn of(outcomes: &[Outcome], bin_nm: f64) -> Self {
        let by = |name: fn(&Outcome) -> String| {
            let mut groups: BTreeMap<String, Vec<&Outcome>> = BTreeMap::new();
            for outcome in outcomes {
                groups.entry(name(outcome)).or_default().push(outcome);
            }
            groups
                .into_iter()
                .map(|(name, group)| (name, SplitFigures::of(&group)))
                .collect()
        };
        Self {
            overall: SplitFigures::of(&outcomes.iter().collect::<Vec<_>>()),
            by_weather: by(|outcome| outcome.weather.to_owned()),
            by_time: by(|outcome| outcome.time_of_day.to_owned()),
            by_distance_nm: distance_bins(outcomes, bin_nm)
                .into_iter()
                .map(|([from_nm, to_nm], inside)| DistanceBin {
                    from_nm,
                    to_nm,
                    figures: ErrorFigures::of(inside),
                })
                .collect(),
        }
    }
}

/// Maximum number of bins. If `bin_nm` would give more, bins are an integer number of times as wide.
const MOST_BINS: f64 = 200.0;

/// Outcomes by bins `[from, to)` of distance in nautical miles, from the bin of the nearest to that of the farthest.
pub(crate) fn distance_bins<'a>(
    outcomes: &'a [Outcome<'a>],
    bin_nm: f64,
) -> Vec<([f64; 2], Vec<&'a Outcome<'a>>)> {
    let distance_nm = |outcome: &Outcome| outcome.dtd_m / dataset::units::METERS_PER_NAUTICAL_MILE;
    let distances = || outcomes.iter().map(distance_nm);
    let (Some(nearest), Some(farthest)) =
        (distances().reduce(f64::min), distances().reduce(f64::max))
    else {
        return Vec::new();
    };
    let wanted = (farthest / bin_nm).floor() - (nearest / bin_nm).floor() + 1.0;
    let width_nm = bin_nm * (wanted / MOST_BINS).ceil().max(1.0);
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
mod tests {
    use super::*;

    fn outcome(
        dtd_m: f64,
        predicted_m: Option<f64>,
        detections: usize,
        weather: &str,
    ) -> Outcome<'_> {
        Outcome {
            dtd_m,
            predicted_m,
            detections,
            weather,
            time_of_day: "08:00",
        }
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
        let metrics = EstimatorMetrics::of(&outcomes, 1.0);
        let all = metrics.overall.combination;
        assert_eq!(all.samples, 3);
        assert!((all.mape_pct.unwrap() - 2.0).abs() < 1e-9);
        assert!((all.sd_pct.unwrap() - (2.0_f64 / 3.0).sqrt()).abs() < 1e-9);
        let dual = metrics.overall.dual;
        assert_eq!(dual.samples, 2);
        assert!((dual.mape_pct.unwrap() - 1.5).abs() < 1e-9);
        assert!((metrics.by_weather["clear"].combination.mape_pct.unwrap() - 2.0).abs() < 1e-9);
        assert_eq!(metrics.by_weather["clear"].dual.samples, 1);
        assert_eq!(metrics.by_time["08:00"].combination.samples, 3);
    }

    #[test]
    fn distance_bins_leave_no_gap_and_an_empty_bin_has_no_figures() {
        let outcomes = [
            outcome(1_000.0, Some(1_000.0), 2, "clear"),
            outcome(4_000.0, Some(4_040.0), 2, "clear"),
        ];
        let bins = EstimatorMetrics::of(&outcomes, 1.0).by_distance_nm;
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
            assert!(bins.len() <= MOST_BINS as usize + 1, "{}", bins.len());
            let held: usize = bins.iter().map(|(_, inside)| inside.len()).sum();
            assert_eq!(held, 2);
            let ([from_nm, to_nm], inside) = bins.last().unwrap();
            let distance_nm = inside[0].dtd_m / dataset::units::METERS_PER_NAUTICAL_MILE;
            assert!((*from_nm..*to_nm).contains(&distance_nm));
        }
    }

    #[test]
    fn answers_beyond_all_measure_are_no_numbers_and_end_nothing() {
        let answers = [f64::INFINITY, f64::NAN, 3e307, -3e307, 1e300];
        let outcomes = answers.map(|answer| outcome(20.0, Some(answer), 2, "clear"));
        let metrics = EstimatorMetrics::of(&outcomes, 1.0);
        let json = serde_json::to_string(&metrics).unwrap();
        let read: EstimatorMetrics = serde_json::from_str(&json).unwrap();
        assert_eq!(read, metrics);
        let ErrorFigures {
            mape_pct,
            sd_pct,
            samples,
        } = metrics.overall.all;
        assert_eq!(samples, 3, "those that are numbers");
        assert!(
            mape_pct.unwrap().is_finite() && sd_pct.unwrap().is_finite(),
            "samples without figures: {json}"
        );
    }

    #[test]
    fn what_is_missing_is_null_in_json_and_never_zero() {
        let metrics = EstimatorMetrics::of(&[outcome(1_000.0, None, 1, "clear")], 1.0);
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
}
