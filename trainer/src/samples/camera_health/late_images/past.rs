//! Late images live: the lags by the images up to now.

use std::collections::VecDeque;

use dataset::geometry::rays::LAG_STEP_S;
use dataset::numbers::motion::MAX_DISTANCE_S;
use sight::lag::Lag;

use super::{Pair, in_time, is_corrected, lags_by, named};
use crate::samples::Observation;
use crate::samples::camera_health::Corrections;

/// Number of ticks, about one a second, after which lags are measured again, and maximum number of them.
const STEP_TICKS: usize = 5;
const MAX_TICKS: usize = 300;

/// Lags of the views up to now, with bounded memory.
#[derive(Debug, Default)]
pub(crate) struct PastLags {
    /// Ticks with registered views, about one a second, the oldest first.
    seen: VecDeque<Observation>,
    /// Number of ticks since the last measurement.
    new_ticks: usize,
    lags: Vec<Vec<Lag>>,
    /// Effects on boxes.
    pub(crate) counts: Corrections,
}

impl PastLags {
    /// Takes the next tick, and moves the boxes of late views to its time.
    pub(crate) fn corrected(&mut self, pairs: &[Pair], observed: Observation) -> Observation {
        let now_s = observed.time_s();
        let is_next = |last: &Observation| now_s >= last.time_s() + LAG_STEP_S;
        if (0..observed.views()).any(|view| observed.shift(view).is_some())
            && self.seen.back().is_none_or(is_next)
        {
            self.seen.push_back(observed.clone());
            if self.seen.len() > MAX_TICKS {
                self.seen.pop_front();
            }
            self.new_ticks += 1;
        }
        if self.new_ticks == STEP_TICKS {
            self.new_ticks = 0;
            let seen: Vec<&Observation> = self.seen.iter().collect();
            // Otherwise nothing new is known.
            if let Some(lags) = lags_by(pairs, &[], &seen) {
                self.lags = lags;
            }
        }
        if !self.lags.iter().flatten().any(is_corrected) {
            return observed;
        }
        let recent = self.seen.iter().filter(|of| {
            let since_s = now_s - of.time_s();
            since_s > 0.0 && since_s <= MAX_DISTANCE_S
        });
        let mut flight: Vec<Observation> = recent.cloned().collect();
        flight.push(observed.clone());
        let mut of_flight: Vec<&mut Observation> = flight.iter_mut().collect();
        in_time(&mut of_flight, &self.lags, &mut Corrections::default());
        let corrected = flight.swap_remove(flight.len() - 1);
        let late = self.lags.iter().enumerate();
        for (view, _) in late.filter(|(_, lags)| lags.iter().any(is_corrected)) {
            match (observed.best(view), corrected.best(view)) {
                (Some(_), Some(_)) => self.counts.late += 1,
                (Some(_), None) => self.counts.late_withheld += 1,
                (None, _) => {}
            }
        }
        corrected
    }

    /// Lines for users about the views that are late.
    pub(crate) fn named(&self, scenario: &str, views: &[String]) -> Vec<String> {
        named(scenario, views, &self.lags)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{pair, place_px, tick_of_views};
    use super::*;

    #[test]
    fn a_late_view_is_corrected_once_its_lag_is_certain_and_one_in_time_never() {
        for late_s in [0.0, 0.4] {
            let mut lags = PastLags::default();
            let mut off_px = Vec::new();
            for tick in 0..120 {
                let time_s = f64::from(tick);
                let observed = tick_of_views(tick, [time_s, time_s - late_s]);
                let expected = tick_of_views(tick, [time_s; 2]);
                let corrected = lags.corrected(&[pair()], observed.clone());
                if late_s == 0.0 {
                    assert_eq!(corrected, observed);
                }
                let shift_px = |of: &Observation| of.shift(1).unwrap().shift_px;
                off_px.push((shift_px(&corrected) - shift_px(&expected)).length());
            }
            assert!(
                off_px[100..].iter().all(|off_px| *off_px < 0.3),
                "{off_px:?}"
            );
            let moves_px = (place_px(110.0) - place_px(110.0 - late_s)).length();
            assert!(late_s == 0.0 || moves_px > 1.0, "{moves_px}");
            let named = lags.named("0001", &["left".into(), "right".into()]);
            match &named[..] {
                [] => assert_eq!(late_s, 0.0),
                [line] => assert!(line.contains("view right is 0.4"), "{line}"),
                _ => panic!("{named:?}"),
            }
        }
    }
}
