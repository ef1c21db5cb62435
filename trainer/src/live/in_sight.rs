//! The aircraft in sight, each with its own filter.

use super::phase::{Phase, PhaseJudge};
use crate::estimators::inverse_range::Tick;
use crate::estimators::inverse_range::contradiction::{Contradiction, ContradictionWatch};
use crate::estimators::inverse_range::flight_filter::{Estimate, OnlineFilter};
use crate::run::trained::TrainedRun;
use crate::samples::Observation;
use crate::samples::paired_views::{Follower, MEMORY_S, ObjectTick};

#[derive(Default)]
pub(crate) struct InSight {
    follower: Follower,
    aircraft: Vec<Aircraft>,
    unpaired: Unpaired,
}

struct Aircraft {
    number: usize,
    filter: OnlineFilter,
    phase: PhaseJudge,
    contradictions: ContradictionWatch,
    /// Time of the last box, seconds.
    seen_s: f64,
}

/// The aircraft in views without relations: a box after a long gap belongs to the next aircraft.
#[derive(Default)]
struct Unpaired {
    number: usize,
    seen_s: Option<f64>,
}

/// An aircraft at a tick.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct JudgedAircraft {
    pub number: u32,
    /// True for the followed aircraft.
    pub is_followed: bool,
    /// The tick with only this aircraft's boxes.
    pub observed: Observation,
    pub estimate: Option<Estimate>,
    pub phase: Phase,
    /// Time of the last box, seconds.
    pub seen_s: f64,
    /// The contradiction because of which boxes are not used.
    pub contradiction: Option<Contradiction>,
}

impl JudgedAircraft {
    /// The filter's estimate for an arrival.
    pub(crate) fn stated(&self) -> Option<&Estimate> {
        let estimate = self.estimate.as_ref();
        estimate.filter(|_| self.phase == Phase::Arrival)
    }
}

impl InSight {
    /// Takes the next tick. `other_cameras`: the cameras differ from the training's, so image positions carry no information.
    pub(crate) fn take(
        &mut self,
        run: &TrainedRun,
        other_cameras: bool,
        observed: &Observation,
    ) -> Vec<JudgedAircraft> {
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

    /// `None` for an object that never had a usable box.
    fn judge(
        &mut self,
        run: &TrainedRun,
        other_cameras: bool,
        of: ObjectTick,
    ) -> Option<JudgedAircraft> {
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
                    contradictions: ContradictionWatch::default(),
                    seen_s: 0.0,
                });
                self.aircraft.len() - 1
            }
        };
        let aircraft = &mut self.aircraft[index];
        if is_seen {
            aircraft.seen_s = of.observed.time_s();
        }
        let baselines = &run.baselines;
        let (filter, fits) = (&baselines.flight_filter, &baselines.inverse_range);
        let mut observed = of.observed;
        let mut tick = Tick::of(fits, &observed);
        let found = if other_cameras {
            None
        } else {
            filter.contradiction(&mut aircraft.contradictions, fits, (&observed, &tick))
        };
        if let Some(found) = &found {
            observed = observed.withheld(&found.withheld.views, found.begins);
            tick = Tick::of(fits, &observed);
            if found.begins {
                // Earlier measurements were wrong as well.
                aircraft.filter = filter.online();
            }
        }
        Some(JudgedAircraft {
            number: of.number as u32,
            is_followed: of.is_followed,
            estimate: filter.next(&mut aircraft.filter, &tick),
            phase: aircraft.phase.take(run, &observed, &tick),
            seen_s: aircraft.seen_s,
            contradiction: found,
            observed,
        })
    }
}

impl Unpaired {
    fn of(&mut self, observed: Observation) -> ObjectTick {
        let now_s = observed.time_s();
        if observed.detections() > 0 {
            let since_s = self.seen_s.map_or(0.0, |seen_s| now_s - seen_s);
            self.number += usize::from(since_s > MEMORY_S);
            self.seen_s = Some(now_s);
        }
        ObjectTick {
            number: self.number,
            is_followed: true,
            observed,
        }
    }
}
