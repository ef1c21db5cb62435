//! The one answer of several hypotheses on the motion.

use super::gaussian::Gaussian;
use super::motion::Motion;

/// Share of the weight that the answer covers.
const COVERED: f64 = 0.95;
/// Hypotheses nearer to the heaviest than this many standard deviations share the answer's mean.
const NEAR: f64 = 3.0;

/// Hypotheses that together have most of the weight, the heaviest first.
pub(super) struct Mixture<'a> {
    states: Vec<State<'a>>,
}

struct State<'a> {
    weight: f64,
    known: &'a Gaussian,
    /// Factor of its variances.
    inflation: f64,
}

impl<'a> Mixture<'a> {
    /// Of weights, states and factors of their variances, the heaviest first; `None` without any.
    pub(super) fn of(
        states: impl Iterator<Item = (f64, &'a Gaussian, f64)> + Clone,
    ) -> Option<Self> {
        let total: f64 = states.clone().map(|(weight, ..)| weight).sum();
        let mut covered = 0.0;
        let states: Vec<State> = states
            .take_while(|(weight, ..)| {
                let is_needed = covered < COVERED * total;
                covered += weight;
                is_needed
            })
            .map(|(weight, known, inflation)| State {
                weight,
                known,
                inflation,
            })
            .collect();
        (!states.is_empty()).then_some(Self { states })
    }

    /// Motion: the mean of the hypotheses near the heaviest, and the covariance of all around it. A mean of hypotheses that are far apart
    /// would be where none of them is.
    pub(super) fn gaussian(&self) -> Gaussian {
        let size = Motion::UNKNOWNS;
        let heaviest = &self.states[0];
        let is_near = |state: &&State| {
            let apart = state.known.mean[0] - heaviest.known.mean[0];
            let variance = heaviest.variance() + state.variance();
            apart.powi(2) <= NEAR.powi(2) * variance
        };
        let mut mixed = Gaussian::independent(vec![0.0; size], &[]);
        let mut weight = 0.0;
        for state in self.states.iter().filter(is_near) {
            weight += state.weight;
            for (mean, of_state) in mixed.mean.iter_mut().zip(&state.known.mean) {
                *mean += state.weight * of_state;
            }
        }
        for mean in &mut mixed.mean {
            *mean /= weight;
        }
        let total: f64 = self.states.iter().map(|state| state.weight).sum();
        for state in &self.states {
            let share = state.weight / total;
            let apart = |i: usize| state.known.mean[i] - mixed.mean[i];
            for i in 0..size {
                for j in 0..size {
                    let within = state.inflation * state.known.covariance[(i, j)];
                    mixed.covariance[(i, j)] += share * (within + apart(i) * apart(j));
                }
            }
        }
        mixed
    }
}

impl State<'_> {
    fn variance(&self) -> f64 {
        self.inflation * self.known.covariance[(0, 0)]
    }
}
