//! A path through noisy positions: a Kalman filter over place and speed, and Rauch, Tung and Striebel's smoother ("Maximum likelihood
//! estimates of linear dynamic systems", 1965). The aircraft's acceleration is white noise.

/// A measurement at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Measured {
    pub(super) time_s: f64,
    pub(super) place_m: f64,
    pub(super) speed_mps: Option<f64>,
    /// Turning acceleration: the noise is stronger there, m/s^2.
    pub(super) turns_mps2: f64,
}

/// Place and speed at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Smoothed {
    pub(super) time_s: f64,
    pub(super) place_m: f64,
    pub(super) speed_mps: f64,
}

/// Standard deviations of the measurements and the strength of the noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Noise {
    pub(super) place_m: f64,
    pub(super) speed_mps: f64,
    /// Spectral density of the acceleration, m^2/s^3.
    pub(super) acceleration: f64,
}

/// A place this many standard deviations away is an outlier.
const OUTLIER: f64 = 5.0;
/// Correlation time of turns, seconds: the spectral density of turning acceleration is its square times this.
const TURN_S: f64 = 0.3;
/// Maximum number of passes to find outliers.
const PASSES: usize = 3;

type Matrix = [[f64; 2]; 2];

#[derive(Debug, Clone, Copy)]
struct State {
    mean: [f64; 2],
    covariance: Matrix,
}

/// Smooths a path: states at the times of the measurements, and outlier flags. At least two measurements, in order of time.
pub(super) fn smooth(measured: &[Measured], noise: Noise) -> (Vec<Smoothed>, Vec<bool>) {
    let mut is_outlier = vec![false; measured.len()];
    let mut path = pass(measured, &is_outlier, noise);
    for _ in 1..PASSES {
        let next: Vec<bool> = (measured.iter().zip(&path))
            .map(|(seen, smoothed)| {
                (seen.place_m - smoothed.place_m).abs() > OUTLIER * noise.place_m
            })
            .collect();
        if next == is_outlier {
            break;
        }
        is_outlier = next;
        path = pass(measured, &is_outlier, noise);
    }
    (path, is_outlier)
}

/// State between those of a path, by a cubic; beyond the ends with constant speed.
pub(super) fn at(path: &[Smoothed], time_s: f64) -> Smoothed {
    let next = path.partition_point(|state| state.time_s <= time_s);
    let Some(before) = next.checked_sub(1).map(|before| path[before]) else {
        return ahead(path[0], time_s);
    };
    let Some(after) = path.get(next) else {
        return ahead(before, time_s);
    };
    let step_s = after.time_s - before.time_s;
    let u = (time_s - before.time_s) / step_s;
    let (a, b) = (before.speed_mps * step_s, after.speed_mps * step_s);
    let way_m = after.place_m - before.place_m;
    Smoothed {
        time_s,
        place_m: before.place_m
            + u * (a + u * (3.0 * way_m - 2.0 * a - b + u * (a + b - 2.0 * way_m))),
        speed_mps: (a + u * (2.0 * (3.0 * way_m - 2.0 * a - b) + 3.0 * u * (a + b - 2.0 * way_m)))
            / step_s,
    }
}

fn ahead(from: Smoothed, time_s: f64) -> Smoothed {
    Smoothed {
        time_s,
        place_m: from.place_m + from.speed_mps * (time_s - from.time_s),
        ..from
    }
}

fn pass(measured: &[Measured], is_outlier: &[bool], noise: Noise) -> Vec<Smoothed> {
    let first = measured[0];
    let mut state = State {
        mean: [first.place_m, first.speed_mps.unwrap_or(0.0)],
        covariance: [[1e8, 0.0], [0.0, 1e4]],
    };
    let mut time_s = first.time_s;
    // Each state before and after its measurement, and the step to it.
    let mut steps: Vec<(f64, State, State)> = Vec::with_capacity(measured.len());
    for (seen, is_outlier) in measured.iter().zip(is_outlier) {
        let step_s = seen.time_s - time_s;
        let acceleration = noise.acceleration + TURN_S * seen.turns_mps2 * seen.turns_mps2;
        let predicted = state.predicted(step_s, acceleration);
        state = predicted;
        if !is_outlier {
            state = state.updated(0, seen.place_m, noise.place_m);
        }
        if let Some(speed_mps) = seen.speed_mps {
            state = state.updated(1, speed_mps, noise.speed_mps);
        }
        steps.push((step_s, predicted, state));
        time_s = seen.time_s;
    }
    let mut smoothed = state;
    let mut means = vec![state.mean; measured.len()];
    for index in (0..measured.len() - 1).rev() {
        let (step_s, predicted, _) = steps[index + 1];
        let (_, _, filtered) = steps[index];
        smoothed = filtered.smoothed(step_s, &predicted, &smoothed);
        means[index] = smoothed.mean;
    }
    (measured.iter().zip(means))
        .map(|(seen, [place_m, speed_mps])| Smoothed {
            time_s: seen.time_s,
            place_m,
            speed_mps,
        })
        .collect()
}

impl State {
    fn predicted(self, step_s: f64, acceleration: f64) -> Self {
        let [[p, c], [_, v]] = self.covariance;
        let t = step_s;
        let q = acceleration;
        let place = p + t * (2.0 * c + t * v) + q * t.powi(3) / 3.0;
        let both = c + t * v + q * t * t / 2.0;
        Self {
            mean: [self.mean[0] + t * self.mean[1], self.mean[1]],
            covariance: [[place, both], [both, v + q * t]],
        }
    }

    /// Update with a measurement of place (0) or speed (1).
    fn updated(self, which: usize, value: f64, sd: f64) -> Self {
        let p = self.covariance;
        let innovation = value - self.mean[which];
        let variance = p[which][which] + sd * sd;
        let gain = [p[0][which] / variance, p[1][which] / variance];
        let mean = [
            self.mean[0] + gain[0] * innovation,
            self.mean[1] + gain[1] * innovation,
        ];
        let mut covariance = p;
        for row in 0..2 {
            for column in 0..2 {
                covariance[row][column] -= gain[row] * p[which][column];
            }
        }
        Self { mean, covariance }
    }

    /// Smooths this filtered state with the next one: `predicted` before its measurement, and smoothed.
    fn smoothed(self, step_s: f64, predicted: &Self, next: &Self) -> Self {
        let [[p, c], [_, v]] = self.covariance;
        // Covariance of this state and the next one.
        let cross = [[p + step_s * c, c], [c + step_s * v, v]];
        let [[a, b], [_, d]] = predicted.covariance;
        let determinant = a * d - b * b;
        let inverse = [
            [d / determinant, -b / determinant],
            [-b / determinant, a / determinant],
        ];
        let mut gain = [[0.0; 2]; 2];
        for (row, of_row) in gain.iter_mut().enumerate() {
            for (column, element) in of_row.iter_mut().enumerate() {
                *element = cross[row][0] * inverse[0][column] + cross[row][1] * inverse[1][column];
            }
        }
        let off = [
            next.mean[0] - predicted.mean[0],
            next.mean[1] - predicted.mean[1],
        ];
        let mean = [
            self.mean[0] + gain[0][0] * off[0] + gain[0][1] * off[1],
            self.mean[1] + gain[1][0] * off[0] + gain[1][1] * off[1],
        ];
        Self {
            mean,
            covariance: self.covariance,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOISE: Noise = Noise {
        place_m: 10.0,
        speed_mps: 1.0,
        acceleration: 0.1,
    };

    /// Slows down from 80 m/s by 0.1 m/s per second; every third position is missing, and one is 500 m off.
    fn measured() -> Vec<Measured> {
        (0..200)
            .filter(|second| second % 3 != 0)
            .map(|second| {
                let time_s = f64::from(second);
                let wobble_m = 10.0 * (12.9898 * time_s).sin();
                Measured {
                    time_s,
                    place_m: truth_m(time_s) + wobble_m + if second == 100 { 500.0 } else { 0.0 },
                    speed_mps: Some(80.0 - 0.1 * time_s),
                    turns_mps2: 0.0,
                }
            })
            .collect()
    }

    fn truth_m(time_s: f64) -> f64 {
        80.0 * time_s - 0.05 * time_s * time_s
    }

    #[test]
    fn the_smoothed_path_is_nearer_to_the_truth_than_its_measurements_and_outliers_are_named() {
        let (path, is_outlier) = smooth(&measured(), NOISE);
        assert_eq!(is_outlier.iter().filter(|outlier| **outlier).count(), 1);
        for second in 5..195 {
            let time_s = f64::from(second) + 0.4;
            let found = at(&path, time_s);
            assert!((found.place_m - truth_m(time_s)).abs() < 5.0, "{found:?}");
            assert!(
                (found.speed_mps - 80.0 + 0.1 * time_s).abs() < 0.5,
                "{found:?}"
            );
        }
    }

    #[test]
    fn beyond_the_ends_speed_is_constant() {
        let (path, _) = smooth(&measured(), NOISE);
        let last = path[path.len() - 1];
        let later = at(&path, last.time_s + 10.0);
        assert!((later.place_m - last.place_m - 10.0 * last.speed_mps).abs() < 1e-9);
        let first = path[0];
        let earlier = at(&path, first.time_s - 1.0);
        assert!((first.place_m - earlier.place_m - first.speed_mps).abs() < 1e-9);
    }
}
