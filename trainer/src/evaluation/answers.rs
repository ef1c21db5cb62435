//! Answers from all estimators at the evaluated ticks, in compact form: a full corpus has 770,000 ticks, each answered by every estimator
//! with all views and with some removed.

use crate::evaluation::metrics::{Group, Outcome, TickCounts};
use crate::evaluation::rules::EvaluationRules;
use crate::run::estimator::{Answered, Estimator};
use crate::samples::{Observation, Sample, Samples};
use dataset::corpus::splits::Side;

/// The evaluated ticks, flight by flight.
pub(crate) struct JudgedTicks<'a> {
    pub(super) samples: &'a Samples,
    pub(super) rules: &'a EvaluationRules,
    ticks: Vec<&'a Sample>,
    /// Per scenario.
    groups: Vec<Group<'a>>,
}

impl<'a> JudgedTicks<'a> {
    /// Ticks on the test side.
    pub(crate) fn of(samples: &'a Samples, rules: &'a EvaluationRules) -> Self {
        let tested = samples.ticks_of_side(Side::Test);
        Self {
            samples,
            rules,
            ticks: tested.filter(|sample| rules.is_there(sample)).collect(),
            groups: samples.scenarios.iter().map(Group::of).collect(),
        }
    }

    pub(crate) fn ticks(&self) -> &[&'a Sample] {
        &self.ticks
    }

    /// Numbers of ticks; `seen`: those that a view saw, if known.
    pub(crate) fn counts(&self, seen: Option<usize>, common: &[bool]) -> TickCounts {
        let is_hidden = |sample: &&&Sample| self.rules.is_hidden(sample);
        TickCounts {
            there: self.ticks.len(),
            hidden_by_fog: self.ticks.iter().filter(is_hidden).count(),
            seen,
            common: common.iter().filter(|&&common| common).count(),
        }
    }

    fn outcome(&self, tick: usize, answers: &Answers, estimator: usize) -> Outcome<'_> {
        let sample = self.ticks[tick];
        let of = &answers.by_estimator[estimator];
        let interval_m = of.intervals_m.get(tick).copied();
        Outcome {
            dtd_m: sample.dtd_m,
            predicted_m: Some(of.distances_m[tick]).filter(|distance_m| distance_m.is_finite()),
            interval_m: interval_m.filter(|[from_m, _]| from_m.is_finite()),
            detections: answers.detections.as_ref().map(|of| of[tick].into()),
            is_hidden: self.rules.is_hidden(sample),
            is_removed: answers.removed.get(tick) == Some(&true),
            of: &self.groups[sample.scenario],
        }
    }

    /// Outcomes for an estimator, tick by tick.
    pub(crate) fn outcomes(&self, answers: &Answers, estimator: usize) -> Vec<Outcome<'_>> {
        let ticks = 0..self.ticks.len();
        ticks
            .map(|tick| self.outcome(tick, answers, estimator))
            .collect()
    }

    /// Ticks in one scenario with an estimator's outcomes.
    pub(crate) fn outcomes_of_scenario(
        &self,
        scenario: usize,
        answers: &Answers,
        estimator: usize,
    ) -> Vec<(&'a Sample, Outcome<'_>)> {
        let ticks = self.ticks.iter().enumerate();
        ticks
            .filter(|(_, sample)| sample.scenario == scenario)
            .map(|(tick, sample)| (*sample, self.outcome(tick, answers, estimator)))
            .collect()
    }
}

/// Answers from several estimators.
#[derive(Default)]
pub(crate) struct Answers {
    /// Number of views with accepted boxes; `None` if it is unknown.
    pub(super) detections: Option<Vec<u8>>,
    /// True where a view was removed; empty without removals.
    pub(super) removed: Vec<bool>,
    pub(super) by_estimator: Vec<EstimatorAnswers>,
}

/// Answers from one estimator; NaN where there is none.
pub(crate) struct EstimatorAnswers {
    pub(super) distances_m: Vec<f64>,
    /// Ends of 90 % intervals; empty for an estimator without intervals.
    pub(super) intervals_m: Vec<[f64; 2]>,
}

impl Answers {
    /// For all of [`Estimator::ALL`], in their order. Preallocates this many ticks: growing vectors take up to twice their content.
    pub(crate) fn with_room_for(ticks: usize) -> Self {
        let estimators = Estimator::ALL.iter();
        Self {
            detections: Some(Vec::with_capacity(ticks)),
            removed: Vec::with_capacity(ticks),
            by_estimator: estimators
                .map(|_| EstimatorAnswers {
                    distances_m: Vec::with_capacity(ticks),
                    intervals_m: Vec::new(),
                })
                .collect(),
        }
    }

    /// Adds the answers at a flight's evaluated ticks.
    pub(crate) fn add(
        &mut self,
        is_judged: &[bool],
        (observed, removed): (&[Observation], &[bool]),
        answered: &[Answered],
    ) {
        let judged = || (0..is_judged.len()).filter(|&tick| is_judged[tick]);
        let seen = |tick: usize| observed[tick].detections().try_into().unwrap_or(u8::MAX);
        self.detections
            .iter_mut()
            .for_each(|of| of.extend(judged().map(seen)));
        self.removed.extend(judged().map(|tick| removed[tick]));
        for (of, answered) in self.by_estimator.iter_mut().zip(answered) {
            let distances_m = judged().map(|tick| answered.distances_m[tick]);
            of.distances_m
                .extend(distances_m.map(|d| d.unwrap_or(f64::NAN)));
            if let Some(estimates) = &answered.estimates {
                let interval_m = |tick: usize| {
                    let estimate = estimates[tick].as_ref();
                    estimate.map_or([f64::NAN; 2], |estimate| estimate.distance_m.interval)
                };
                of.intervals_m
                    .reserve_exact(of.distances_m.capacity() - of.intervals_m.len());
                of.intervals_m.extend(judged().map(interval_m));
            }
        }
    }

    /// Number of boxes over all ticks.
    pub(crate) fn boxes(&self) -> usize {
        let detections = self.detections.iter().flatten();
        detections.copied().map(usize::from).sum()
    }

    /// Number of ticks that a view saw, if it is known.
    pub(crate) fn seen(&self) -> Option<usize> {
        let detections = self.detections.as_ref()?;
        Some(detections.iter().filter(|&&views| views > 0).count())
    }

    /// Ticks answered by every estimator that has any answer.
    pub(crate) fn common(&self) -> Vec<bool> {
        let distances_m = self.by_estimator.iter().map(|of| &of.distances_m);
        let is_answered = |distance_m: &f64| distance_m.is_finite();
        let answering: Vec<&Vec<f64>> = distances_m
            .clone()
            .filter(|of| of.iter().any(is_answered))
            .collect();
        let ticks = distances_m.map(Vec::len).max().unwrap_or_default();
        let is_common = |tick: usize| {
            !answering.is_empty() && answering.iter().all(|of| is_answered(&of[tick]))
        };
        (0..ticks).map(is_common).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn common_ticks_are_those_of_all_estimators_that_answer_at_all() {
        let answers = |of_estimators: [[Option<f64>; 3]; 3]| {
            let answered = of_estimators.map(|distances_m| Answered {
                distances_m: distances_m.to_vec(),
                estimates: None,
            });
            let observed = Sample::of_boxes(1_000.0, vec![None]).observed;
            let mut answers = Answers::with_room_for(3);
            answers.add(&[true; 3], (&vec![observed; 3], &[false; 3]), &answered);
            answers.common()
        };
        let [first, second] = [
            [Some(1_010.0), None, Some(1_020.0)],
            [None, Some(1.0), Some(1.0)],
        ];
        assert_eq!(answers([first, second, [None; 3]]), [false, false, true]);
        assert_eq!(answers([[None; 3]; 3]), [false; 3]);
    }
}
