//! Approach motion model: its acceleration decays, and its speed slowly returns to the usual one.
//!
//! Acceleration is a first-order Gauss-Markov process (Singer 1970), and pulls the speed away from the mean of the training flights. In
//! continuous time, so that ticks may be any time apart.

use serde::{Deserialize, Serialize};

use super::gaussian::{Block, Gaussian, Step, log_likelihood};

/// Nodes and weights of Gauss-Legendre quadrature on -1 to 1.
const QUADRATURE: [(f64, f64); 5] = [
    (0.0, 0.568_888_888_888_888_9),
    (0.538_469_310_105_683_1, 0.478_628_670_499_366_5),
    (-0.538_469_310_105_683_1, 0.478_628_670_499_366_5),
    (0.906_179_845_938_664, 0.236_926_885_056_189_1),
    (-0.906_179_845_938_664, 0.236_926_885_056_189_1),
];
/// Spacing of labels for the fit, seconds: closer ones add no information about the motion.
const LABEL_STEP_S: f64 = 1.0;
/// Label standard deviation, metres: recordings are resampled.
const LABEL_SD_M: f64 = 0.05;
/// Speed standard deviation for an unknown flight, m/s: a few training flights do not determine the speed of the next one. On the demo's
/// training and validation flights, each left out in turn, a filter with a single view is off by 1.50 % with the flights' spread of 6 m/s,
/// by 1.45 % with this, and by 1.90 % with 40 m/s, which takes errors in the first seconds for speed.
const SPEED_SD_MPS: f64 = 20.0;
/// Candidates.
const ACCELERATION_TIMES_S: [f64; 5] = [4.0, 8.0, 16.0, 32.0, 64.0];
const ACCELERATION_SDS_MPS2: [f64; 12] = [
    0.025, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 0.8, 1.2, 1.6, 2.4,
];

/// Usual motion in training.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Motion {
    pub(super) mean_speed_mps: f64,
    pub(super) speed_sd_mps: f64,
    pub(super) acceleration_sd_mps2: f64,
    /// Time constant of the acceleration, seconds.
    pub(super) acceleration_time_s: f64,
}

/// Distance to touchdown over time, seconds and metres.
pub(super) type Labels = Vec<(f64, f64)>;

impl Motion {
    /// Number of unknowns: distance to touchdown (m), speed above the mean (m/s), acceleration (m/s^2).
    pub(super) const UNKNOWNS: usize = 3;

    /// Maximum-likelihood fit to labels; defaults with too few.
    pub(super) fn fit(flights: &[Labels]) -> Self {
        let flights: Vec<Labels> = flights.iter().map(thinned).collect();
        let speeds: Vec<f64> = flights
            .iter()
            .flat_map(|flight| flight.windows(2))
            .map(|pair| (pair[0].1 - pair[1].1) / (pair[1].0 - pair[0].0))
            .collect();
        let mut best = Self {
            mean_speed_mps: 70.0,
            speed_sd_mps: SPEED_SD_MPS,
            acceleration_sd_mps2: 0.4,
            acceleration_time_s: 16.0,
        };
        if speeds.is_empty() {
            return best;
        }
        let count = speeds.len() as f64;
        best.mean_speed_mps = speeds.iter().sum::<f64>() / count;
        let mut highest = f64::NEG_INFINITY;
        for acceleration_time_s in ACCELERATION_TIMES_S {
            for acceleration_sd_mps2 in ACCELERATION_SDS_MPS2 {
                let candidate = Self {
                    acceleration_sd_mps2,
                    acceleration_time_s,
                    ..best
                };
                let likelihood = flights
                    .iter()
                    .map(|flight| candidate.log_likelihood(flight));
                let likelihood = likelihood.sum();
                if likelihood > highest {
                    highest = likelihood;
                    best = candidate;
                }
            }
        }
        best
    }

    fn log_likelihood(&self, flight: &Labels) -> f64 {
        let Some(&(_, distance_m)) = flight.first() else {
            return 0.0;
        };
        let mut variances = self.variances();
        variances[0] = LABEL_SD_M.powi(2);
        let start = Gaussian::independent(vec![distance_m, 0.0, 0.0], &variances);
        let mut known: Option<(f64, Step)> = None;
        let drift_m = |time_s: f64| self.mean_speed_mps * (time_s - flight[0].0);
        let above_mean: Labels = flight
            .iter()
            .map(|&(time_s, distance_m)| (time_s, distance_m + drift_m(time_s)))
            .collect();
        log_likelihood(&start, &above_mean, LABEL_SD_M.powi(2), |seconds| {
            // Ticks are equally far apart, except for rounding.
            match &known {
                Some((of_s, step)) if (of_s - seconds).abs() < 1e-6 => step.clone(),
                _ => {
                    let step = Step::of_block(&self.step(seconds));
                    known = Some((seconds, step.clone()));
                    step
                }
            }
        })
    }

    /// Speed and acceleration variances for an unknown flight; the distance has variance 0.
    pub(super) fn variances(&self) -> [f64; Self::UNKNOWNS] {
        [
            0.0,
            self.speed_sd_mps.powi(2),
            self.acceleration_sd_mps2.powi(2),
        ]
    }

    /// Transition over `seconds`, without the distance flown at mean speed.
    pub(super) fn step(&self, seconds: f64) -> Block<{ Self::UNKNOWNS }> {
        let noise_per_s = 2.0 * self.acceleration_sd_mps2.powi(2) / self.acceleration_time_s;
        let mut noise = [[0.0; Self::UNKNOWNS]; Self::UNKNOWNS];
        for (place, weight) in QUADRATURE {
            // Present effect from an earlier acceleration impulse.
            let transition = self.transition(0.5 * seconds * (1.0 + place));
            let effect = transition.map(|row| row[2]);
            for (row, a) in noise.iter_mut().zip(effect) {
                for (value, b) in row.iter_mut().zip(effect) {
                    *value += 0.5 * seconds * weight * noise_per_s * a * b;
                }
            }
        }
        (self.transition(seconds), noise)
    }

    fn transition(&self, seconds: f64) -> [[f64; Self::UNKNOWNS]; Self::UNKNOWNS] {
        let fading = self.acceleration_time_s.recip();
        let returning = self.returning_per_s(fading);
        let flown = |rate: f64| -(-rate * seconds).exp_m1() / rate;
        let [kept, faded] = [returning, fading].map(|rate| (-rate * seconds).exp());
        let gained = (faded - kept) / (returning - fading);
        let flown_faster = (flown(fading) - flown(returning)) / (returning - fading);
        [
            [1.0, -flown(returning), -flown_faster],
            [0.0, kept, gained],
            [0.0, 0.0, faded],
        ]
    }

    /// Decay rate towards the mean speed, consistent with its standard deviation.
    fn returning_per_s(&self, fading_per_s: f64) -> f64 {
        let ratio = self.acceleration_sd_mps2 / self.speed_sd_mps;
        let root = (fading_per_s.powi(2) + 4.0 * ratio.powi(2)).sqrt();
        let rate = 0.5 * (root - fading_per_s);
        // Equal rates have different formulas, which these approach.
        if (rate / fading_per_s - 1.0).abs() < 1e-4 {
            return fading_per_s * (1.0 + 1e-4);
        }
        rate
    }
}

fn thinned(flight: &Labels) -> Labels {
    let mut kept: Labels = Vec::new();
    for &(time_s, distance_m) in flight {
        if kept
            .last()
            .is_none_or(|&(last_s, _)| time_s - last_s >= LABEL_STEP_S - 1e-6)
        {
            kept.push((time_s, distance_m));
        }
    }
    kept
}
