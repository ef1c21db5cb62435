//! Rate of timestamps. Some cameras count 25 images per second and send 21, so that all seem later and later: a slope that lasts is no
//! lateness.

use std::collections::VecDeque;

use super::JUMP_S;

/// Images over this time show the rate of timestamps, s, and at least so many do.
const RATE_S: f64 = 5.0;
const MIN_RATE_IMAGES: usize = 20;
/// Minimum change of a rate: a camera that sends 24 images of 25 differs by 0.04, a network whose delay grows by 0.1 s meanwhile by 0.02.
const MIN_RATE_CHANGE: f64 = 0.03;
/// Maximum part of a change that a straight line leaves over: a single stall leaves 0.58.
const MAX_BEND: f64 = 0.25;

/// The rate, by images whose arrivals are the true ones.
#[derive(Debug)]
pub(super) struct Rate {
    /// Seconds for a second of timestamps.
    pub(super) seconds: f64,
    /// Timestamps and arrivals of recent images.
    recent: VecDeque<[f64; 2]>,
}

impl Default for Rate {
    fn default() -> Self {
        Self {
            seconds: 1.0,
            recent: VecDeque::new(),
        }
    }
}

impl Rate {
    /// Takes the true arrival of an image. True if the rate is different from now on.
    pub(super) fn has_changed(&mut self, arrival_s: f64, timestamp_s: f64) -> bool {
        let jumps = |[last_s, _]: &[f64; 2]| !(0.0..=JUMP_S).contains(&(timestamp_s - last_s));
        if self.recent.back().is_some_and(jumps) {
            self.recent.clear();
        }
        self.recent.push_back([timestamp_s, arrival_s]);
        let is_old = |[_, came_s]: &[f64; 2]| arrival_s - came_s >= RATE_S;
        if !self.recent.front().is_some_and(is_old) || self.recent.len() < MIN_RATE_IMAGES {
            return false;
        }
        self.recent.retain(|image| !is_old(image));
        let count = self.recent.len() as f64;
        let mean = |of: &dyn Fn(&[f64; 2]) -> f64| self.recent.iter().map(of).sum::<f64>() / count;
        let [mean_s, mean_arrival_s] = [0, 1].map(|part| mean(&|image| image[part]));
        let spread = mean(&|[at_s, _]| (at_s - mean_s).powi(2));
        let seconds = mean(&|[at_s, came_s]| (at_s - mean_s) * (came_s - mean_arrival_s)) / spread;
        let left =
            mean(&|[at_s, came_s]| (came_s - mean_arrival_s - seconds * (at_s - mean_s)).powi(2));
        let change = (seconds - self.seconds).abs();
        let is_straight = left.sqrt() <= MAX_BEND * change * spread.sqrt();
        let has_changed = change > MIN_RATE_CHANGE && is_straight;
        if has_changed {
            self.seconds = seconds;
        }
        has_changed
    }
}
