//! Ticks that one view alone sees, and the score from which on a detector must report its boxes for a given share of them.
//!
//! In the paper 15 % of the data points miss one of two views. A detector misses aircraft where it is least sure: far away and before
//! clouds. So boxes are dropped by their score, and never at random.

use std::collections::BTreeMap;

use dataset::corpus::Corpus;
use dataset::corpus::splits::Side;
use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;
use serde::{Deserialize, Serialize};

use crate::error::Result;

/// Distances that count, nautical miles.
const RANGE_NM: [f64; 2] = [1.0, 10.0];
/// Score steps from 0 to 1.
const STEPS: u32 = 200;

/// The ticks of some scenarios from 1 to 10 NM, with the best score of each view.
#[derive(Debug, Clone, Default)]
pub struct SeenTicks {
    ticks: Vec<SeenTick>,
}

#[derive(Debug, Clone)]
struct SeenTick {
    dtd_nm: f64,
    weather: String,
    /// Scores of the views that see the aircraft.
    scores: Vec<f64>,
}

/// Counts of ticks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Share {
    /// All ticks.
    pub ticks: usize,
    /// Seen by at least one view.
    pub seen: usize,
    /// Ticks seen by one view alone.
    pub by_one_view: usize,
}

/// Ticks that one view alone sees.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct SingleViews {
    /// All ticks from 1 to 10 NM.
    pub all: Share,
    /// Shares by nautical mile: `6` is from 6 to 7 NM.
    pub by_nm: BTreeMap<u32, Share>,
    /// Shares by weather.
    pub by_weather: BTreeMap<String, Share>,
}

impl Share {
    /// Share of the seen ticks that one view alone sees; `None` without any.
    pub fn of_seen(self) -> Option<f64> {
        (self.seen > 0).then(|| self.by_one_view as f64 / self.seen as f64)
    }

    /// Share of the ticks that a view sees; `None` without any.
    pub(crate) fn seen_of_all(self) -> Option<f64> {
        (self.ticks > 0).then(|| self.seen as f64 / self.ticks as f64)
    }

    fn count(&mut self, views: usize) {
        self.ticks += 1;
        self.seen += usize::from(views > 0);
        self.by_one_view += usize::from(views == 1);
    }
}

impl SeenTicks {
    /// Reads a model's confirmed boxes in the scenarios of one side, or in all.
    ///
    /// # Errors
    /// A scenario cannot be read, or has no labels or no detections of this model.
    pub fn read(corpus: &Corpus, model_hash: &str, side: Option<Side>) -> Result<Self> {
        let splits = corpus.splits()?;
        let mut ticks = Vec::new();
        for folder in corpus.scenarios()? {
            let of = splits.scenarios.get(&folder.id());
            if side.is_some_and(|side| of.is_none_or(|of| of.side != side)) {
                continue;
            }
            let scenario = folder.open()?;
            let weather = scenario.record()?.weather_name().to_owned();
            let mut best: BTreeMap<u32, BTreeMap<String, f64>> = BTreeMap::new();
            for found in scenario.detections(model_hash)?.boxes {
                if found.confirmed {
                    let views = best.entry(found.tick).or_default();
                    let score = views.entry(found.view).or_insert(found.score);
                    *score = score.max(found.score);
                }
            }
            for row in scenario.frames()?.rows {
                let Some(labels) = row.labels else { continue };
                let dtd_nm = labels.dtd_m / METERS_PER_NAUTICAL_MILE;
                let is_before = labels.along_track_m > 0.0;
                if is_before && (RANGE_NM[0]..=RANGE_NM[1]).contains(&dtd_nm) {
                    let scores = best.remove(&row.tick).unwrap_or_default();
                    ticks.push(SeenTick {
                        dtd_nm,
                        weather: weather.clone(),
                        scores: scores.into_values().collect(),
                    });
                }
            }
        }
        Ok(Self { ticks })
    }

    /// The ticks that one view alone sees, of boxes with at least this score.
    pub fn single_views(&self, least_score: f64) -> SingleViews {
        let mut counted = SingleViews::default();
        for tick in &self.ticks {
            let views = tick.scores.iter().filter(|&&score| score >= least_score);
            let views = views.count();
            counted.all.count(views);
            let nm = tick.dtd_nm.min(RANGE_NM[1] - 1.0) as u32;
            counted.by_nm.entry(nm).or_default().count(views);
            let weather = counted.by_weather.entry(tick.weather.clone()).or_default();
            weather.count(views);
        }
        counted
    }

    /// Minimum score at which one view alone sees this share of the ticks; if no score reaches it, the nearest one.
    pub fn least_score(&self, wanted_share: f64) -> f64 {
        let scores = (0..STEPS).map(|step| f64::from(step) / f64::from(STEPS));
        let mut nearest = (0.0, f64::INFINITY);
        for score in scores {
            let share = self.single_views(score).all.of_seen().unwrap_or(0.0);
            if share >= wanted_share {
                return score;
            }
            if wanted_share - share < nearest.1 {
                nearest = (score, wanted_share - share);
            }
        }
        nearest.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten ticks that two views see, the farther the less surely: the second view by one step less than the first.
    fn seen() -> SeenTicks {
        let tick = |number: u32| SeenTick {
            dtd_nm: 1.0 + f64::from(number),
            weather: "clear".into(),
            scores: vec![
                0.9 - 0.05 * f64::from(number),
                0.85 - 0.05 * f64::from(number),
            ],
        };
        SeenTicks {
            ticks: (0..10).map(tick).collect(),
        }
    }

    #[test]
    fn the_least_score_leaves_one_view_at_the_wanted_share_of_the_ticks_far_away_first() {
        let seen = seen();
        assert_eq!(seen.single_views(0.0).all.by_one_view, 0);
        let score = seen.least_score(0.1);
        let single = seen.single_views(score);
        assert_eq!((single.all.seen, single.all.by_one_view), (10, 1));
        assert_eq!(single.by_nm[&9].by_one_view, 1, "{single:?}");
        let none = seen.single_views(1.0).all;
        assert_eq!((none.ticks, none.seen_of_all()), (10, Some(0.0)));
        assert_eq!(single.by_weather["clear"], single.all);
    }

    #[test]
    fn a_share_that_no_score_reaches_is_approached() {
        let seen = seen();
        let single = seen.single_views(seen.least_score(2.0)).all;
        let most = (0..STEPS).map(|step| seen.single_views(f64::from(step) / 200.0).all);
        let most = most.filter_map(Share::of_seen).fold(0.0, f64::max);
        assert_eq!(single.of_seen(), Some(most));
    }

    #[test]
    fn a_tick_that_no_view_sees_is_in_no_share() {
        let nothing = SeenTicks::default();
        assert_eq!(nothing.single_views(0.5).all.of_seen(), None);
        assert_eq!(nothing.least_score(0.15), 0.0);
    }
}
