//! Smoother of a flight: what is known at each tick from all ticks, along the decisions of the likeliest hypothesis at the end.

use super::forward::{Tick, fits_of};
use super::gaussian::{Gaussian, Step};
use super::hypothesis::{Decision, Hypothesis, Known, Model, step};
use super::motion::Motion;

/// State after a tick.
#[derive(Debug, Clone)]
struct Moment {
    /// Transition since the previous tick; `None` where the filter began.
    step: Option<Step>,
    /// State predicted from the previous ticks.
    expected: Gaussian,
    /// What is known with this tick: motion first, then the smooth errors of the fits.
    known: Gaussian,
    /// Factor of all variances.
    inflation: f64,
    level: f64,
}

/// What is known of the motion at each tick; `None` before the first measurement.
pub(super) fn smooth(model: Model, ticks: &[Tick], decisions: &[Decision]) -> Vec<Option<Known>> {
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
    let motion = |moment: Moment| Known {
        motion: moment.known.first(Motion::UNKNOWNS, moment.inflation),
        level: moment.level,
    };
    moments
        .into_iter()
        .map(|moment| moment.map(motion))
        .collect()
}

/// The filter's states along these decisions, with the factors of variances from all ticks.
fn along(model: Model, ticks: &[Tick], decisions: &[Decision]) -> Vec<Option<Moment>> {
    let fits = fits_of(ticks);
    let mut last: Option<(f64, Hypothesis)> = None;
    let mut counts = Vec::with_capacity(ticks.len());
    let mut moments: Vec<Option<Moment>> = Vec::with_capacity(ticks.len());
    for (tick, &decision) in ticks.iter().zip(decisions) {
        let mut count = 1.0;
        let mut advanced = None;
        if let Some((time_s, before)) = &last {
            let seconds = (tick.time_s - time_s).max(0.0);
            count = Tick::count(model, seconds);
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
        moments.push(moment.map(|(step, expected, mut next)| {
            for measurement in tick.others() {
                next.learn(model, &fits, measurement, count);
            }
            last = Some((tick.time_s, next.clone()));
            Moment {
                step,
                expected,
                known: next.known,
                inflation: 1.0,
                level: f64::from(next.level),
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
