//! Filter output: numbers with standard deviations and intervals.

use serde::{Deserialize, Serialize};

use super::gaussian::{Gaussian, Step};
use super::motion::Motion;
use crate::estimators::inverse_range::scale_m;

/// Maximum relative standard deviation of the distance in an answer.
const MAX_DEVIATION: f64 = 0.2;
/// Minimum approach speed, m/s.
const MIN_SPEED_MPS: f64 = 5.0;
/// Maximum prediction step towards touchdown, seconds.
const LOOK_AHEAD_S: f64 = 10.0;
const ITERATIONS: usize = 10;
/// Normal quantile for a central 90 % interval.
const NORMAL_90: f64 = 1.644_853_626_951_472_7;

/// A number with standard deviation and 90 % interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Estimated {
    /// Most likely value.
    pub value: f64,
    pub sd: f64,
    pub interval: [f64; 2],
}

/// Estimate at a tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Estimate {
    /// Distance to touchdown, metres.
    pub distance_m: Estimated,
    /// Speed over ground towards the target, m/s.
    pub ground_speed_mps: Estimated,
    /// Time to touchdown, seconds; `None` if the aircraft does not approach.
    pub time_to_touchdown_s: Option<Estimated>,
}

/// 90 % interval half widths, in standard deviations.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct HalfWidths {
    pub(super) distance: f64,
    pub(super) ground_speed: f64,
    pub(super) time_to_touchdown: f64,
}

impl HalfWidths {
    /// Widths for normal distributions.
    pub(super) const NORMAL: Self = Self {
        distance: NORMAL_90,
        ground_speed: NORMAL_90,
        time_to_touchdown: NORMAL_90,
    };

    pub(super) fn to_array(self) -> [f64; 3] {
        [self.distance, self.ground_speed, self.time_to_touchdown]
    }

    /// Estimate from the motion; `None` if it is too uncertain or has no distance. `common_sd_per_m`: standard deviation of the inverse
    /// range due to common errors, which the filter cannot reduce, 1/m.
    pub(super) fn estimate(
        &self,
        motion: &Motion,
        known: &Gaussian,
        common_sd_per_m: f64,
    ) -> Option<Estimate> {
        let sd = |unknown: usize| known.covariance[(unknown, unknown)].sqrt();
        let distance_m = known.mean[0];
        let speed_mps = motion.mean_speed_mps + known.mean[1];
        let common_sd_m = common_sd_per_m * scale_m(distance_m).powi(2);
        // A common error grows with the square of the distance; the speed's error is its rate of change.
        let common_sd_mps = 2.0 * common_sd_m / scale_m(distance_m) * speed_mps;
        let estimate = Estimate {
            distance_m: estimated(distance_m, [sd(0), common_sd_m], self.distance),
            ground_speed_mps: estimated(speed_mps, [sd(1), common_sd_mps], self.ground_speed),
            time_to_touchdown_s: time_to_touchdown_s(motion, known, common_sd_m)
                .map(|(time_s, sds_s)| estimated(time_s, sds_s, self.time_to_touchdown)),
        };
        // NaN fails this test.
        let is_answer = distance_m > 0.0
            && sd(0).hypot(common_sd_m) <= MAX_DEVIATION * distance_m
            && sd(1).is_finite()
            && estimate.ground_speed_mps.value.is_finite();
        is_answer.then_some(estimate)
    }
}

/// `sds`: standard deviations of filter error and common error. `half_width` was fitted to filter errors; common errors are assumed normal.
fn estimated(value: f64, sds: [f64; 2], half_width: f64) -> Estimated {
    let [own, common] = sds;
    let half = (half_width * own).hypot(NORMAL_90 * common);
    Estimated {
        value,
        sd: own.hypot(common),
        interval: [value - half, value + half],
    }
}

/// Expected time until the distance is 0, with two standard deviations (filter error, common error): the deviation of the position at that
/// time, divided by the speed.
fn time_to_touchdown_s(
    motion: &Motion,
    known: &Gaussian,
    common_sd_m: f64,
) -> Option<(f64, [f64; 2])> {
    let mut moving = known.clone();
    let after = |seconds: f64| {
        let step = Step::of_block(&motion.step(seconds));
        let mean = step.moved(&moving.mean);
        let speed_mps = motion.mean_speed_mps + mean[1];
        (mean[0] - motion.mean_speed_mps * seconds, speed_mps)
    };
    let mut time_s = 0.0;
    for _ in 0..ITERATIONS {
        let (distance_m, speed_mps) = after(time_s);
        let next_s: f64 = time_s + distance_m / speed_mps;
        if !(speed_mps >= MIN_SPEED_MPS && (0.0..f64::INFINITY).contains(&next_s)) {
            return None;
        }
        time_s = next_s;
    }
    let (_, speed_mps) = after(time_s);
    let steps = (time_s / LOOK_AHEAD_S).ceil().max(1.0);
    let step = Step::of_block(&motion.step(time_s / steps));
    for _ in 0..steps as usize {
        moving = moving.advanced(&step);
    }
    let sds_s = [moving.covariance[(0, 0)].sqrt(), common_sd_m].map(|sd_m| sd_m / speed_mps);
    let is_known = sds_s.iter().all(|sd_s| sd_s.is_finite());
    is_known.then_some((time_s, sds_s))
}
