//! Combination of several hypotheses into one estimate.

use sight::sight::CONTRADICTS_SD;

use super::gaussian::Gaussian;
use super::motion::Motion;

/// Share of the weight within the estimate's covariance.
const COVERED: f64 = 0.95;

/// A hypothesis.
pub(super) struct Component<'a> {
    pub(super) weight: f64,
    pub(super) known: &'a Gaussian,
    /// Variance factor.
    pub(super) inflation: f64,
}

/// Combined motion, from hypotheses sorted by weight; `None` without any.
///
/// The mean is taken over hypotheses near the heaviest one, the covariance over all around it: between distant hypotheses, a mean would
/// match none.
pub(super) fn mixed(states: &[Component]) -> Option<Gaussian> {
    let heaviest = states.first()?;
    let size = Motion::UNKNOWNS;
    let mut covered = 0.0;
    let total: f64 = states.iter().map(|state| state.weight).sum();
    let needed = states.iter().take_while(|state| {
        let is_needed = covered < COVERED * total;
        covered += state.weight;
        is_needed
    });
    let used: Vec<&Component> = needed.collect();
    let total: f64 = used.iter().map(|state| state.weight).sum();
    let mut mixed = Gaussian::independent(vec![0.0; size], &[]);
    let is_near = |state: &&&Component| {
        let apart = state.known.mean[0] - heaviest.known.mean[0];
        apart.powi(2) <= CONTRADICTS_SD.powi(2) * (heaviest.variance() + state.variance())
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

impl Component<'_> {
    fn variance(&self) -> f64 {
        self.inflation * self.known.covariance[(0, 0)]
    }
}
