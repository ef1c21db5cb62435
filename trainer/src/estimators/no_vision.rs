//! Baseline without images: the mean distance of the training flights at the same time since the scenario's start.
//!
//! Flights of one sweep start at similar distances and fly at similar speeds, so a clock alone is right to a few percent, and a clock with
//! the weather, which has the wind, is better. An estimator that is not much better than this has learned little from the images.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::samples::{Observation, Sample, ScenarioSummary};

/// Length of the intervals over which times and distances are averaged, nanoseconds.
const INTERVAL_NS: i64 = 2_000_000_000;

/// Mean distances by time, of all training flights and of those in each weather.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(crate) struct MeanByTime {
    all: Curve,
    /// Curves by weather name.
    by_weather: BTreeMap<String, Curve>,
}

/// Mean times and distances, in the order of time; distances between and beyond them are on straight lines.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
struct Curve {
    time_s: Vec<f64>,
    dtd_m: Vec<f64>,
}

/// Sums over one interval.
#[derive(Default)]
struct Interval {
    count: f64,
    time_s: f64,
    dtd_m: f64,
}

impl MeanByTime {
    /// Averages all ticks, with or without detections.
    pub(crate) fn fit<'a>(
        scenarios: &[ScenarioSummary],
        ticks: impl Iterator<Item = &'a Sample>,
    ) -> Self {
        let mut all = BTreeMap::new();
        let mut by_weather: BTreeMap<&str, BTreeMap<i64, Interval>> = BTreeMap::new();
        for tick in ticks {
            let weather = scenarios[tick.scenario].weather.as_str();
            for intervals in [&mut all, by_weather.entry(weather).or_default()] {
                let interval: &mut Interval =
                    intervals.entry(tick.time_ns / INTERVAL_NS).or_default();
                interval.count += 1.0;
                interval.time_s += tick.time_ns as f64 / 1e9;
                interval.dtd_m += tick.dtd_m;
            }
        }
        let named = by_weather.into_iter();
        Self {
            all: Curve::of(&all),
            by_weather: named
                .map(|(weather, intervals)| (weather.to_owned(), Curve::of(&intervals)))
                .collect(),
        }
    }

    /// Mean over all flights at the tick's time, metres. `None` where no view saw the aircraft, so that the baseline is judged at the same
    /// ticks as estimators with images.
    pub(crate) fn at(&self, observed: &Observation) -> Option<f64> {
        Self::answer(&self.all, observed)
    }

    /// The mean of the flights in this weather; of all, if none flew in it.
    pub(crate) fn at_in(&self, observed: &Observation, weather: &str) -> Option<f64> {
        Self::answer(self.by_weather.get(weather).unwrap_or(&self.all), observed)
    }

    fn answer(curve: &Curve, observed: &Observation) -> Option<f64> {
        let is_seen = observed.detections() > 0;
        curve.at(observed.time_ns as f64 / 1e9).filter(|_| is_seen)
    }

    /// True if each time has a distance.
    pub(crate) fn is_whole(&self) -> bool {
        let curves = self.by_weather.values().chain([&self.all]);
        let mut lengths = curves.map(|curve| [curve.time_s.len(), curve.dtd_m.len()]);
        lengths.all(|[times, distances]| times == distances)
    }
}

impl Curve {
    fn of(intervals: &BTreeMap<i64, Interval>) -> Self {
        let mean = |of: fn(&Interval) -> f64| {
            let intervals = intervals.values();
            intervals
                .map(|interval| of(interval) / interval.count)
                .collect()
        };
        Self {
            time_s: mean(|interval| interval.time_s),
            dtd_m: mean(|interval| interval.dtd_m),
        }
    }

    fn at(&self, time_s: f64) -> Option<f64> {
        let (times, distances) = (&self.time_s, &self.dtd_m);
        let last = times.len().checked_sub(1)?;
        if last == 0 {
            return Some(distances[0]);
        }
        let after = times.partition_point(|&t| t <= time_s).clamp(1, last);
        let part = (time_s - times[after - 1]) / (times[after] - times[after - 1]);
        let distance_m = distances[after - 1] + part * (distances[after] - distances[after - 1]);
        Some(distance_m.max(0.0))
    }
}

#[cfg(test)]
mod tests {
    use testkit::synthetic::SyntheticCorpus;

    use super::*;
    use crate::samples::Samples;

    fn tick(time_s: f64, dtd_m: f64, is_seen: bool) -> Sample {
        let seen = dataset::tables::pixel_box::PixelBox {
            cx_px: 1.0,
            cy_px: 1.0,
            width_px: 1.0,
            height_px: 1.0,
        };
        let mut sample = Sample::of_boxes(dtd_m, vec![is_seen.then_some(seen)]);
        sample.observed.time_ns = (time_s * 1e9) as i64;
        sample
    }

    #[test]
    fn the_mean_of_two_flights_is_between_them_and_each_weather_has_its_own() {
        let samples = Samples::synthetic(&SyntheticCorpus::tiny(), 0.0);
        let mut scenarios = samples.scenarios;
        scenarios[0].weather = "clear".into();
        scenarios[1].weather = "stormy".into();
        // 70 m/s from 18 km, and 80 m/s from 19 km.
        let mut ticks = Vec::new();
        for second in 0..200 {
            let time_s = f64::from(second);
            ticks.push(tick(time_s, 18_000.0 - 70.0 * time_s, true));
            let mut other = tick(time_s, 19_000.0 - 80.0 * time_s, false);
            other.observed.scenario = 1;
            ticks.push(other);
        }
        let fitted = MeanByTime::fit(&scenarios, ticks.iter());
        assert!(fitted.is_whole());
        for time_s in [0.0, 0.25, 17.5, 100.0, 199.9] {
            let now = tick(time_s, 0.0, true);
            for (answer, expected) in [
                (fitted.at(&now), 18_500.0 - 75.0 * time_s),
                (fitted.at_in(&now, "clear"), 18_000.0 - 70.0 * time_s),
                (fitted.at_in(&now, "stormy"), 19_000.0 - 80.0 * time_s),
                (fitted.at_in(&now, "foggy"), 18_500.0 - 75.0 * time_s),
            ] {
                assert!(
                    (answer.unwrap() - expected).abs() < 1e-6,
                    "{time_s} {answer:?}"
                );
            }
        }
        assert_eq!(fitted.at(&tick(400.0, 0.0, true)), Some(0.0));
        assert_eq!(fitted.at(&tick(10.0, 0.0, false)), None, "nothing was seen");
        assert_eq!(MeanByTime::default().at(&tick(10.0, 0.0, true)), None);
    }
}
