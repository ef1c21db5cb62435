//! Smoother: states from all ticks, along the decisions of the most likely final hypothesis.

use super::forward::{fits_of, tick_count};
use super::gaussian::{Gaussian, Step};
use super::hypothesis::{Decision, Hypothesis, Model, step};
use super::motion::Motion;
use crate::estimators::inverse_range::Tick;

#[derive(Debug, Clone)]
struct TickState {
    /// Transition since the previous tick; `None` where the filter starts.
    step: Option<Step>,
    /// Prediction from the previous ticks.
    expected: Gaussian,
    /// State including this tick: motion first, then the fits' smooth errors.
    known: Gaussian,
    /// Factor for all variances.
    inflation: f64,
}

/// Motion at each tick; `None` before the first measurement.
pub(super) fn smooth(
    model: Model,
    ticks: &[Tick],
    decisions: &[Decision],
) -> Vec<Option<Gaussian>> {
    let mut moments = along(model, ticks, decisions);
    for next in (1..moments.len()).rev() {
        let (before, after) = moments.split_at_mut(next);
        if let (Some(Some(before)), Some(after)) = (before.last_mut(), &after[0])
            && let Some(step) = &after.step
            && let Some(known) = before.known.smoothed(step, &after.expected, &after.known)
        {
            before.known = known;
        }
    }
    let motion = |moment: TickState| moment.known.first(Motion::UNKNOWNS, moment.inflation);
    moments
        .into_iter()
        .map(|moment| moment.map(motion))
        .collect()
}

/// The filter's states along these decisions, with variance factors from all ticks.
fn along(model: Model, ticks: &[Tick], decisions: &[Decision]) -> Vec<Option<TickState>> {
    let fits = fits_of(ticks);
    let mut last: Option<(f64, Hypothesis)> = None;
    let mut counts = Vec::with_capacity(ticks.len());
    let mut moments: Vec<Option<TickState>> = Vec::with_capacity(ticks.len());
    for (tick, &decision) in ticks.iter().zip(decisions) {
        let mut count = 1.0;
        let mut advanced = None;
        if let Some((time_s, before)) = &last {
            let seconds = (tick.time_s - time_s).max(0.0);
            count = tick_count(model, seconds);
            let step = step(model, &fits, seconds);
            let mut next = before.clone();
            next.advance(model, &step, seconds);
            advanced = Some((step, next));
        }
        let begun = match (decision, tick.best()) {
            (Decision::Begun { level }, Some(best)) => {
                Some(Hypothesis::begun(model, &fits, best, level))
            }
            _ => None,
        };
        let moment = match (begun, advanced) {
            (Some(begun), _) => Some((None, begun.known.clone(), begun)),
            (None, Some((step, mut next))) => {
                let expected = next.known.clone();
                if let (Decision::Taken { level }, Some(best)) = (decision, tick.best())
                    && let Some(reading) = next.reading(model, &fits, best)
                {
                    next.take(&reading, level, count);
                }
                Some((Some(step), expected, next))
            }
            (None, None) => None,
        };
        counts.push((
            count,
            matches!(decision, Decision::Taken { .. } | Decision::Begun { .. }),
        ));
        moments.push(moment.map(|(step, expected, next)| {
            last = Some((tick.time_s, next.clone()));
            TickState {
                step,
                expected,
                known: next.known,
                inflation: 1.0,
            }
        }));
    }
    if let Some((_, last)) = last {
        for (moment, (count, is_measured)) in moments.iter_mut().zip(counts) {
            if let Some(moment) = moment {
                moment.inflation = last.inflation(is_measured, count);
            }
        }
    }
    moments
}
