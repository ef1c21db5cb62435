//! The aircraft in sight, each with its own filter.

use super::answer::Withheld;
use super::phase::{Phase, PhaseJudge};
use crate::estimators::inverse_range::flight_filter::{Estimate, OnlineFilter};
use crate::run::trained::TrainedRun;
use crate::samples::Observation;
use crate::samples::paired_views::{AsideWatch, Follower, OfObject};

/// In views that cannot be paired, a box after so many seconds without any is of another aircraft.
const GIVEN_UP_S: f64 = 60.0;

/// The aircraft in sight after some ticks.
#[derive(Default)]
pub(crate) struct InSight {
    follower: Follower,
    aircraft: Vec<Aircraft>,
    unpaired: Unpaired,
}

/// An aircraft.
struct Aircraft {
    number: usize,
    filter: OnlineFilter,
    phase: PhaseJudge,
    /// Its views beside the paths of the training.
    aside: AsideWatch,
    /// Time of the last tick with a box of it, seconds.
    seen_s: f64,
}

/// The one aircraft of views that cannot be paired.
#[derive(Default)]
struct Unpaired {
    number: usize,
    seen_s: Option<f64>,
}

/// An aircraft at a tick.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Judged {
    /// Its number.
    pub number: u32,
    /// Of all of them, this one is followed.
    pub is_followed: bool,
    /// The tick with its boxes alone.
    pub observed: Observation,
    /// The filter's estimate.
    pub estimate: Option<Estimate>,
    pub phase: Phase,
    /// Time of the last tick with a box of it, seconds.
    pub seen_s: f64,
    /// Views that see it and are not used, with the cause.
    pub withheld: Option<Withheld>,
}

impl Judged {
    /// The filter's estimate, if it arrives.
    pub(crate) fn stated(&self) -> Option<&Estimate> {
        let estimate = self.estimate.as_ref();
        estimate.filter(|_| self.phase == Phase::Arrival)
    }
}

impl InSight {
    /// Takes the next tick. `other_cameras`: they are in other places than those of the training, so that the places of boxes say nothing.
    pub(crate) fn take(
        &mut self,
        run: &TrainedRun,
        other_cameras: bool,
        observed: &Observation,
    ) -> Vec<Judged> {
        let usual = run.normalisation.without_outliers(observed, other_cameras);
        let pairs = &run.baselines.paired_views;
        let objects = if other_cameras || pairs.is_empty() {
            vec![self.unpaired.of(usual)]
        } else {
            pairs.next(&mut self.follower, &usual)
        };
        self.aircraft
            .retain(|known| objects.iter().any(|of| of.number == known.number));
        objects
            .into_iter()
            .filter_map(|of| self.judge(run, other_cameras, of))
            .collect()
    }

    /// `None` of an object of which no box could be used yet.
    fn judge(&mut self, run: &TrainedRun, other_cameras: bool, of: OfObject) -> Option<Judged> {
        let is_seen = of.observed.detections() > 0;
        let known = (self.aircraft.iter()).position(|known| known.number == of.number);
        let index = match known {
            Some(index) => index,
            None if !is_seen => return None,
            None => {
                self.aircraft.push(Aircraft {
                    number: of.number,
                    filter: run.baselines.flight_filter.online(),
                    phase: PhaseJudge::default(),
                    aside: AsideWatch::default(),
                    seen_s: 0.0,
                });
                self.aircraft.len() - 1
            }
        };
        let aircraft = &mut self.aircraft[index];
        if is_seen {
            aircraft.seen_s = of.observed.time_ns as f64 * 1e-9;
        }
        let baselines = &run.baselines;
        let (filter, fits) = (&baselines.flight_filter, &baselines.inverse_range);
        let mut observed = of.observed;
        let aside = if other_cameras {
            None
        } else {
            (baselines.paired_views).aside_at(&mut aircraft.aside, &observed)
        };
        let aside = aside.filter(|aside| aside.is_hidden);
        if let Some(aside) = aside {
            observed = observed.without_images(|view| aside.views.contains(&view));
            if observed.detections() == 0 {
                // What it measured in the last minute was wrong as well.
                aircraft.filter = filter.online();
            }
        }
        Some(Judged {
            number: of.number as u32,
            is_followed: of.is_followed,
            estimate: filter.next(&mut aircraft.filter, fits, &observed),
            phase: aircraft.phase.take(run, &observed),
            seen_s: aircraft.seen_s,
            withheld: aside.map(|aside| Withheld {
                views: aside.views.clone(),
                off_px: aside.off_px,
                limit_px: aside.limit_px,
            }),
            observed,
        })
    }
}

impl Unpaired {
    fn of(&mut self, observed: Observation) -> OfObject {
        let now_s = observed.time_ns as f64 * 1e-9;
        if observed.detections() > 0 {
            let since_s = self.seen_s.map_or(0.0, |seen_s| now_s - seen_s);
            self.number += usize::from(since_s > GIVEN_UP_S);
            self.seen_s = Some(now_s);
        }
        OfObject {
            number: self.number,
            is_followed: true,
            observed,
        }
    }
}
