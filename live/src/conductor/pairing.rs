//! Pairs the images of several views: each with the nearest images of the others, at most about half a frame away.
//!
//! The earliest image decides. It waits for views that may still deliver a nearer image, until that image is overdue by [`MAX_WAIT_S`].
//! Clocks may differ by seconds (`--offset`), so paired images may arrive far apart, and each view's lag is followed.

use std::collections::VecDeque;

use crate::clock::{LEARNED_PART, UsualInterval};
use crate::output::MAX_COASTING_S;
use crate::views::search::MAX_WAIT_S;

/// Images belong together if they are not further apart than this part of the usual time between images.
const PART_OF_PERIOD: f64 = 0.55;
/// Images that wait in a lane, at most.
const MAX_WAITING: usize = 256;

/// Paired images.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Joined<T> {
    /// The time of the first view's image, else of the earliest.
    pub(crate) time_s: f64,
    /// Time and content, by view.
    pub(crate) images: Vec<Option<(f64, T)>>,
}

/// Joins images.
#[derive(Debug)]
pub(crate) struct Pairing<T> {
    lanes: Vec<Lane<T>>,
    waits_forever: bool,
    last_s: Option<f64>,
}

#[derive(Debug)]
struct Lane<T> {
    waiting: VecDeque<Waiting<T>>,
    is_live: bool,
    last_s: Option<f64>,
    period_s: UsualInterval,
    /// Delay from an image's time to its arrival, s: grows at once, and shrinks slowly.
    lag_s: Option<f64>,
}

#[derive(Debug)]
struct Waiting<T> {
    time_s: f64,
    came_s: f64,
    content: T,
}

impl<T> Pairing<T> {
    pub(crate) fn new(views: usize, waits_forever: bool) -> Self {
        let lane = |_| Lane {
            waiting: VecDeque::new(),
            is_live: true,
            last_s: None,
            period_s: UsualInterval::default(),
            lag_s: None,
        };
        Self {
            lanes: (0..views).map(lane).collect(),
            waits_forever,
            last_s: None,
        }
    }

    /// Sets if a view will deliver more.
    pub(crate) fn set_live(&mut self, view: usize, is_live: bool) {
        self.lanes[view].is_live = is_live;
    }

    /// Takes an image that arrived at `now_s`.
    pub(crate) fn put(&mut self, view: usize, time_s: f64, now_s: f64, content: T) {
        let lane = &mut self.lanes[view];
        let between_s = lane.last_s.replace(time_s).map(|last_s| time_s - last_s);
        if let Some(between_s) = between_s.filter(|between_s| *between_s > 0.0) {
            lane.period_s.learn(between_s, 2.0);
        }
        let lag_s = now_s - time_s;
        lane.lag_s = Some(match lane.lag_s {
            Some(known_s) if known_s > lag_s => known_s + LEARNED_PART * (lag_s - known_s),
            _ => lag_s,
        });
        lane.waiting.push_back(Waiting {
            time_s,
            came_s: now_s,
            content,
        });
        if lane.waiting.len() > MAX_WAITING {
            lane.waiting.pop_front();
        }
    }

    /// The next images that belong together, once that is decided.
    pub(crate) fn next(&mut self, now_s: f64) -> Option<Joined<T>> {
        loop {
            let heads = self.lanes.iter().enumerate();
            let heads = heads.filter_map(|(view, lane)| Some((view, lane.waiting.front()?)));
            let (first, head) = heads.min_by(|a, b| a.1.time_s.total_cmp(&b.1.time_s))?;
            let (time_s, came_s) = (head.time_s, head.came_s);
            let live = self.lanes.iter().filter(|lane| lane.is_live);
            let lag_s = live
                .filter_map(|lane| lane.lag_s)
                .fold(came_s - time_s, f64::max);
            let due_s = (time_s + lag_s + MAX_WAIT_S).min(came_s + MAX_COASTING_S);
            let is_due = !self.waits_forever && now_s >= due_s;
            let must_wait = |lane: &Lane<T>| lane.is_live && lane.waiting.is_empty();
            if !is_due && self.lanes.iter().any(must_wait) {
                return None;
            }
            let tolerance_s = self.tolerance_s();
            let images: Vec<_> = (self.lanes.iter_mut().enumerate())
                .map(|(view, lane)| {
                    let belongs = |head: &Waiting<T>| head.time_s - time_s <= tolerance_s;
                    let is_part = view == first || lane.waiting.front().is_some_and(belongs);
                    let taken = is_part.then(|| lane.waiting.pop_front()).flatten()?;
                    Some((taken.time_s, taken.content))
                })
                .collect();
            let of_first_view = images[0].as_ref().map(|(time_s, _)| *time_s);
            let time_s = of_first_view.unwrap_or(time_s);
            // What came too late is of the past.
            if self.last_s.is_none_or(|last_s| time_s > last_s) {
                self.last_s = Some(time_s);
                return Some(Joined { time_s, images });
            }
        }
    }

    fn tolerance_s(&self) -> f64 {
        let periods = self.lanes.iter().filter_map(|lane| lane.period_s.get());
        PART_OF_PERIOD * periods.min_by(f64::total_cmp).unwrap_or(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_S: f64 = 1.0 / 30.0;

    /// Feeds two views at 30 images per second, the second one late by this much; returns the numbers of the images that were joined.
    fn joined(offset_s: f64) -> Vec<[Option<u32>; 2]> {
        let mut pairing = Pairing::new(2, false);
        let mut arrivals = Vec::new();
        for number in 0..40_u32 {
            let time_s = f64::from(number) * PERIOD_S;
            arrivals.push((time_s, 0, number));
            arrivals.push((time_s + offset_s, 1, number));
        }
        arrivals.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut all = Vec::new();
        for (time_s, view, number) in arrivals {
            pairing.put(view, time_s, time_s + 0.02, number);
            while let Some(found) = pairing.next(time_s + 0.02) {
                let numbers = found.images.iter().map(|image| Some(image.as_ref()?.1));
                all.push([0, 1].map(|view| numbers.clone().nth(view).flatten()));
            }
        }
        all
    }

    #[test]
    fn each_image_is_joined_with_the_nearest() {
        for (offset_s, difference) in [(0.0, 0), (0.012, 0), (0.025, -1), (-0.01, 0), (0.09, -3)] {
            let all = joined(offset_s);
            let usual = &all[8..];
            for images in usual {
                let [Some(left), Some(right)] = *images else {
                    panic!("{offset_s}: {all:?}")
                };
                let found = i64::from(right) - i64::from(left);
                assert_eq!(found, difference, "{offset_s}");
            }
        }
    }

    #[test]
    fn clocks_that_differ_are_joined_by_their_times() {
        for offset_s in [0.12, -0.12, 0.5, -0.5] {
            let mut pairing = Pairing::new(2, false);
            let mut joined = 0;
            for number in 0..90_u32 {
                // Both come at once.
                let now_s = f64::from(number) * PERIOD_S + 0.02;
                pairing.put(0, now_s - 0.02, now_s, number);
                pairing.put(1, now_s - 0.02 + offset_s, now_s, number);
                while let Some(found) = pairing.next(now_s) {
                    if let [Some((left_s, _)), Some((right_s, _))] = found.images[..] {
                        assert!((left_s - right_s).abs() <= 0.5 * PERIOD_S + 1e-9);
                        joined += 1;
                    }
                }
            }
            assert!(joined >= 60, "{offset_s}: {joined}");
        }
    }

    #[test]
    fn a_view_that_is_silent_delays_the_other_by_a_tenth_of_a_second_and_one_that_is_down_by_nothing()
     {
        let mut pairing = Pairing::new(2, false);
        pairing.put(0, 1.0, 1.02, "a");
        assert!(pairing.next(1.1).is_none());
        assert_eq!(pairing.next(1.13).unwrap().images, [Some((1.0, "a")), None]);
        pairing.set_live(1, false);
        pairing.put(0, 2.0, 2.02, "b");
        assert!(pairing.next(2.02).is_some());
    }

    #[test]
    fn a_recording_waits_for_the_other_until_that_ends() {
        let mut pairing = Pairing::new(2, true);
        pairing.put(1, 0.0, 0.0, "a");
        assert!(pairing.next(100.0).is_none());
        pairing.put(0, 0.0, 100.0, "b");
        let both = pairing.next(100.0).unwrap();
        assert_eq!(both.images, [Some((0.0, "b")), Some((0.0, "a"))]);
        pairing.put(1, 1.0, 100.0, "c");
        assert!(pairing.next(200.0).is_none());
        pairing.set_live(0, false);
        assert_eq!(
            pairing.next(200.0).unwrap().images,
            [None, Some((1.0, "c"))]
        );
    }

    #[test]
    fn times_never_go_back() {
        let mut pairing = Pairing::new(2, false);
        pairing.set_live(1, false);
        pairing.put(0, 5.0, 5.0, "a");
        assert!(pairing.next(5.0).is_some());
        pairing.put(1, 4.0, 5.1, "late");
        assert!(pairing.next(6.0).is_none());
    }
}
