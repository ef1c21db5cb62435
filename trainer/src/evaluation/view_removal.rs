//! Simulated failures of views: observations are removed from whole flights, by `evaluation-rules.toml`.
//!
//! Estimators for single ticks and for whole flights are thus evaluated with the same losses.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;

use crate::evaluation::rules::RemovedViewsRules;
use crate::samples::{Observation, ScenarioSummary};

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum ViewRemoval {
    /// All views but this one, always.
    AllBut(usize),
    /// A single view at random ticks.
    AtRandom,
    /// A single view for this long, repeatedly; seconds.
    Bursts(f64),
}

/// Flights after a removal.
pub(crate) struct Remaining {
    /// All ticks, with the remaining boxes.
    pub observations: Vec<Observation>,
    /// True at ticks with a removed view, even if it had not seen the aircraft.
    pub removed: Vec<bool>,
}

impl ViewRemoval {
    /// All removals in an evaluation; empty for a single view.
    pub(crate) fn all(views: usize, rules: &RemovedViewsRules) -> Vec<Self> {
        if views < 2 {
            return Vec::new();
        }
        let bursts = rules.burst_s.iter().map(|&burst_s| Self::Bursts(burst_s));
        let alone = (0..views).map(Self::AllBut);
        alone.chain([Self::AtRandom]).chain(bursts).collect()
    }

    /// Key in `metrics.json`.
    pub(crate) fn name(self, views: &[String], rules: &RemovedViewsRules) -> String {
        match self {
            Self::AllBut(view) => format!("only_{}", views[view]),
            Self::AtRandom => format!("random_{}_pct", 100.0 * rules.random_share),
            Self::Bursts(burst_s) => format!("bursts_{burst_s}_s"),
        }
    }

    /// Applies the removal to whole flights.
    pub(crate) fn apply(
        self,
        rules: &RemovedViewsRules,
        scenarios: &[ScenarioSummary],
        flights: &[Observation],
    ) -> Remaining {
        let mut remaining = Remaining {
            observations: Vec::with_capacity(flights.len()),
            removed: Vec::with_capacity(flights.len()),
        };
        for flight in flights.chunk_by(|a, b| a.scenario == b.scenario) {
            let id = &scenarios[flight[0].scenario].id;
            for (observed, lost) in flight.iter().zip(self.lost(rules, id, flight)) {
                let left = observed.without_images(|view| lost.has(view));
                remaining.observations.push(left);
                remaining.removed.push(lost != Lost::None);
            }
        }
        remaining
    }

    fn lost(self, rules: &RemovedViewsRules, id: &str, flight: &[Observation]) -> Vec<Lost> {
        let views = flight[0].views();
        let key = format!("{} {id} {self:?}", rules.seed);
        let mut random = ChaCha12Rng::from_seed(*blake3::hash(key.as_bytes()).as_bytes());
        match self {
            Self::AllBut(view) => vec![Lost::AllBut(view); flight.len()],
            Self::AtRandom => {
                let mut draw = || {
                    if random.random_bool(rules.random_share) {
                        Lost::One(random.random_range(0..views))
                    } else {
                        Lost::None
                    }
                };
                flight.iter().map(|_| draw()).collect()
            }
            Self::Bursts(burst_s) => {
                let period =
                    |observed: &Observation| (observed.time_s() / rules.burst_every_s).floor();
                let mut lost = Vec::with_capacity(flight.len());
                for ticks in flight.chunk_by(|a, b| period(a) == period(b)) {
                    let view = random.random_range(0..views);
                    let start_s = period(&ticks[0]) * rules.burst_every_s
                        + random.random_range(0.0..=rules.burst_every_s - burst_s);
                    lost.extend(ticks.iter().map(|observed| {
                        if (start_s..start_s + burst_s).contains(&observed.time_s()) {
                            Lost::One(view)
                        } else {
                            Lost::None
                        }
                    }));
                }
                lost
            }
        }
    }
}

/// Views lost at a tick.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Lost {
    None,
    One(usize),
    AllBut(usize),
}

impl Lost {
    fn has(self, view: usize) -> bool {
        match self {
            Self::None => false,
            Self::One(lost) => lost == view,
            Self::AllBut(kept) => kept != view,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluation::rules::EvaluationRules;
    use crate::samples::Samples;
    use dataset::numbers::frame_rate::FrameRate;
    use testkit::synthetic::SyntheticCorpus;

    /// Flights with two ticks per second that both views see almost throughout.
    fn flights() -> Samples {
        Samples::synthetic(
            &SyntheticCorpus {
                miss_ratio: 0.0,
                shift_noise_px: Some(0.05),
                frame_rate: FrameRate {
                    numerator: 2,
                    denominator: 1,
                },
                ..SyntheticCorpus::tiny()
            },
            0.0,
        )
    }

    /// Ticks with the aircraft in both views.
    fn observations(samples: &Samples) -> Vec<Observation> {
        let all = samples.samples.iter().map(|sample| &sample.observed);
        let seen = all.filter(|observed| observed.detections() == 2);
        seen.cloned().collect()
    }

    #[test]
    fn what_is_removed_is_the_same_every_time_and_in_any_company() {
        let samples = flights();
        let rules = EvaluationRules::current().removed_views;
        let all = observations(&samples);
        for removal in ViewRemoval::all(2, &rules) {
            let apply = |flights: &[Observation]| {
                removal
                    .apply(&rules, &samples.scenarios, flights)
                    .observations
            };
            let together = apply(&all);
            assert_eq!(together.len(), all.len());
            assert!(together == apply(&all));
            let last: Vec<_> = all.iter().filter(|o| o.scenario == 3).cloned().collect();
            let of_last = together.iter().filter(|o| o.scenario == 3);
            assert!(apply(&last).iter().eq(of_last), "{removal:?}");
        }
    }

    #[test]
    fn one_view_of_two_is_removed_in_the_share_and_for_the_time_that_the_rules_say() {
        let samples = flights();
        let rules = EvaluationRules::current().removed_views;
        let all = observations(&samples);
        for removal in ViewRemoval::all(2, &rules) {
            let Remaining {
                observations,
                removed,
            } = removal.apply(&rules, &samples.scenarios, &all);
            for (observed, &removed) in observations.iter().zip(&removed) {
                assert_eq!(observed.detections(), if removed { 1 } else { 2 });
                assert_eq!(
                    observed.shift(1).is_none(),
                    removed,
                    "a shift goes with its box"
                );
            }
            let share = removed.iter().filter(|&&r| r).count() as f64 / all.len() as f64;
            let name = removal.name(&samples.views, &rules);
            println!("{name}: {share:.3}");
            match removal {
                ViewRemoval::AllBut(view) => {
                    assert_eq!(share, 1.0);
                    assert!(observations.iter().all(|o| o.best(view).is_some()));
                }
                ViewRemoval::AtRandom => assert!((share - 0.15).abs() < 0.03, "{share}"),
                ViewRemoval::Bursts(burst_s) => {
                    // Two ticks per second. A burst may begin where the flight's last period has ended.
                    let mut lengths = Vec::new();
                    let ticks: Vec<_> = removed.iter().zip(&observations).collect();
                    for run in ticks.chunk_by(|a, b| {
                        (a.0, a.1.scenario, a.1.best(0).is_some())
                            == (b.0, b.1.scenario, b.1.best(0).is_some())
                    }) {
                        if *run[0].0 {
                            lengths.push(run.len() as f64 / 2.0);
                        }
                    }
                    let whole = lengths.iter().filter(|&&s| (s - burst_s).abs() <= 0.5);
                    assert!(whole.count() * 2 > lengths.len(), "{name}: {lengths:?}");
                    assert!(
                        lengths.iter().all(|&s| s <= 2.0 * burst_s + 1.0),
                        "{lengths:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn the_only_view_is_not_removed() {
        let rules = EvaluationRules::current().removed_views;
        assert!(ViewRemoval::all(1, &rules).is_empty());
        let names: Vec<_> = ViewRemoval::all(2, &rules)
            .into_iter()
            .map(|removal| removal.name(&["left".into(), "right".into()], &rules))
            .collect();
        let expected = "only_left only_right random_15_pct bursts_5_s bursts_20_s bursts_60_s";
        assert_eq!(names.join(" "), expected);
    }
}
