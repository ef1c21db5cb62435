//! The one answer of several hypotheses on the motion.

use crate::estimators::inverse_range::flight_filter::gaussian::Gaussian;
use crate::estimators::inverse_range::flight_filter::motion::Motion;

/// Share of the weight that the answer's covariance covers.
const COVERED: f64 = 0.95;
/// Hypotheses nearer to the answer's than this many standard deviations share its mean.
const NEAR: f64 = 3.0;
/// Weight of hypotheses that take the last measurement with which they answer, although the heaviest one does not. If they are wrong, so is
/// the measurement; if they are right, only the filter is wrong.
const FOLLOWED: f64 = 0.2;

/// A hypothesis.
pub(crate) struct State<'a> {
    pub(crate) weight: f64,
    pub(crate) known: &'a Gaussian,
    /// Factor of its variances.
    pub(crate) inflation: f64,
    /// True if the last measurement is of something else.
    pub(crate) is_outlier: bool,
}

/// What is known of the motion by some hypotheses, the heaviest first; `None` without any. `is_measured`: this tick has a measurement.
///
/// The mean is taken over the hypotheses near one of them, the covariance over all around it: a mean of hypotheses that are far apart would
/// be where none of them is.
pub(crate) fn mixed(states: &[State], is_measured: bool) -> Option<Gaussian> {
    let answer = answer(states, is_measured)?;
    let size = Motion::UNKNOWNS;
    let mut covered = 0.0;
    let total: f64 = states.iter().map(|state| state.weight).sum();
    let needed = states.iter().take_while(|state| {
        let is_needed = covered < COVERED * total;
        covered += state.weight;
        is_needed
    });
    let mut used: Vec<&State> = needed.collect();
    if !used.iter().any(|state| std::ptr::eq(*state, answer)) {
        used.push(answer);
    }
    let total: f64 = used.iter().map(|state| state.weight).sum();
    let mut mixed = Gaussian::independent(vec![0.0; size], &[]);
    let is_near = |state: &&&State| {
        let apart = state.known.mean[0] - answer.known.mean[0];
        apart.powi(2) <= NEAR.powi(2) * (answer.variance() + state.variance())
    };
    let mut near = 0.0;
    for state in used.iter().filter(is_near) {
        near += state.weight;
        for (mean, of_state) in mixed.mean.iter_mut().zip(&state.known.mean) {
            *mean += state.weight * of_state;
        }
    }
    for mean in &mut mixed.mean {
        *mean /= near;
    }
    for state in used {
        let share = state.weight / total;
        let apart = |i: usize| state.known.mean[i] - mixed.mean[i];
        for i in 0..size {
            for j in 0..size {
                let within = state.inflation * state.known.covariance[(i, j)];
                mixed.covariance[(i, j)] += share * (within + apart(i) * apart(j));
            }
        }
    }
    Some(mixed)
}

/// The hypothesis that answers.
fn answer<'s, 'a>(states: &'s [State<'a>], is_measured: bool) -> Option<&'s State<'a>> {
    let heaviest = states.first()?;
    let taken = || states.iter().filter(|state| !state.is_outlier);
    let total: f64 = states.iter().map(|state| state.weight).sum();
    let of_taken: f64 = taken().map(|state| state.weight).sum();
    if is_measured && heaviest.is_outlier && of_taken >= FOLLOWED * total {
        return taken().next();
    }
    Some(heaviest)
}

impl State<'_> {
    fn variance(&self) -> f64 {
        self.inflation * self.known.covariance[(0, 0)]
    }
}
