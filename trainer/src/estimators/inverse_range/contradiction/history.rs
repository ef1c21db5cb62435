//! Residuals of one comparison over a window.

use std::collections::VecDeque;

use dataset::numbers::spread::median_of;

use crate::samples::paired_views::{MAX_GAP_S, STEP_S};

/// Minimum number of ticks in a window.
pub(super) const MIN_TICKS: usize = 5;
/// Share of outliers on either side: single wrong boxes. Of 1,682 windows of rows in 16 unseen flights (the untouched ones of
/// scripts/moved_cameras.py), 4 had residuals that were five deviations off their median, at most 2 of 11.
const OUTLIERS: f64 = 0.1;

/// Duration of a contradiction, and the statistic of its residuals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Window {
    pub(super) duration_s: f64,
    /// True if it has to stay on one side; else its median size counts.
    pub(super) is_one_sided: bool,
}

/// A residual.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Residual {
    pub(super) time_s: f64,
    /// Joint standard deviations.
    pub(super) deviations: f64,
}

/// Recent residuals.
#[derive(Debug, Clone, Default)]
pub(super) struct History {
    /// The oldest first.
    recent: VecDeque<Residual>,
    /// Residual that was kept for the last complete window, with the window's start; 0 if it has to stay on one side and did not.
    pub(super) kept: Option<Residual>,
    /// True after a whole window in which the views agreed.
    pub(super) has_agreed: bool,
    /// Time of the last tick that shows it, seconds.
    pub(super) last_s: f64,
}

impl History {
    /// Takes the next residual. After a window over the limit a new one begins: agreeing again takes a whole window as well.
    pub(super) fn take(&mut self, next: Residual, window: Window, limit: f64) {
        remember(&mut self.recent, next, |of| of.time_s, window.duration_s);
        let kept = self.kept_for(next.time_s, window);
        if kept.is_some_and(|kept| kept.deviations > limit) {
            self.recent.clear();
        }
        self.judge(next.time_s, kept, limit);
    }

    /// Takes the verdict of the next tick, if there is one.
    pub(super) fn judge(&mut self, time_s: f64, kept: Option<Residual>, limit: f64) {
        self.last_s = time_s;
        self.has_agreed |= kept.is_some_and(|kept| kept.deviations <= limit);
        self.kept = kept.or(self.kept);
    }

    fn kept_for(&self, time_s: f64, window: Window) -> Option<Residual> {
        let since_s = self.recent[0].time_s;
        if time_s - since_s < window.duration_s || self.recent.len() < MIN_TICKS {
            return None;
        }
        let residuals = self.recent.iter().map(|of| of.deviations);
        let deviations = if window.is_one_sided {
            let mut sorted: Vec<f64> = residuals.collect();
            sorted.sort_by(f64::total_cmp);
            let outliers = (OUTLIERS * sorted.len() as f64) as usize;
            let [least, most] = [sorted[outliers], sorted[sorted.len() - 1 - outliers]];
            least.max(-most).max(0.0)
        } else {
            median_of(residuals.map(f64::abs))?
        };
        Some(Residual {
            time_s: since_s,
            deviations,
        })
    }
}

/// Adds a tick to a window of that duration, or of the ticks since a gap. The oldest tick is as old as the window, or older if ticks are
/// rare.
pub(super) fn remember<T>(
    recent: &mut VecDeque<T>,
    next: T,
    time_s: impl Fn(&T) -> f64,
    window_s: f64,
) {
    let now_s = time_s(&next);
    let since_s = recent.back().map(|last| now_s - time_s(last));
    if since_s.is_some_and(|since_s| since_s > MAX_GAP_S) {
        recent.clear();
    }
    if since_s.is_none_or(|since_s| since_s >= STEP_S) {
        recent.push_back(next);
    }
    while recent
        .get(1)
        .is_some_and(|second| now_s - time_s(second) >= window_s)
    {
        recent.pop_front();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MINUTE: Window = Window {
        duration_s: 60.0,
        is_one_sided: true,
    };

    fn kept(times_s: impl Iterator<Item = f64>, deviations: impl Fn(f64) -> f64) -> Option<f64> {
        let mut history = History::default();
        for time_s in times_s {
            let deviations = deviations(time_s);
            let next = Residual { time_s, deviations };
            history.take(next, MINUTE, f64::INFINITY);
        }
        Some(history.kept?.deviations)
    }

    #[test]
    fn a_residual_that_stays_for_a_window_is_kept_at_any_image_rate_and_a_passing_one_is_not() {
        for step_s in [1.0 / 30.0, 0.5, 2.0, 4.0, 15.0] {
            let times = |seconds: f64| {
                let count = (seconds / step_s).ceil() as u32;
                (0..=count).map(move |tick| f64::from(tick) * step_s)
            };
            assert_eq!(kept(times(75.0), |_| -57.0), Some(57.0));
            assert_eq!(kept(times(44.0), |_| 57.0), None);
            let gust = |time_s: f64| (100.0 - 3.0 * time_s).max(-1.0);
            assert_eq!(kept(times(75.0), gust), Some(0.0));
            let begins = |time_s: f64| if time_s < 40.0 { 2.0 } else { 57.0 };
            assert_eq!(kept(times(75.0), begins), Some(2.0));
        }
        let wrong_now_and_then = |time_s: f64| match time_s as u32 % 12 {
            3 => 900.0,
            _ => -57.0,
        };
        assert_eq!(kept((0..75).map(f64::from), wrong_now_and_then), Some(57.0));
        let with_gap = (0..50).chain(90..120).map(f64::from);
        assert_eq!(kept(with_gap, |_| 57.0), None);
        let rare = (0..20).map(|tick| f64::from(tick) * 40.0);
        assert_eq!(kept(rare, |_| 57.0), None);
    }
}
