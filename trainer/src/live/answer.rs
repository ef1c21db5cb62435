//! Live answers.

use dataset::geometry::geodesy::Geodetic;

use super::{JudgedAircraft, Phase};
use crate::estimators::inverse_range::contradiction::Withheld;
use crate::estimators::inverse_range::flight_filter::Estimated;

/// Aircraft state at a tick.
#[derive(Debug, Clone, PartialEq)]
pub struct Answer {
    /// Track number, kept through gaps.
    pub aircraft: u32,
    /// Arrival or not.
    pub phase: Phase,
    /// Views used at this tick; empty for a prediction.
    pub views: Vec<usize>,
    /// Time of the last used box, seconds.
    pub seen_s: f64,
    /// Distance to touchdown, metres; `None` for anything but arrivals, and while too uncertain.
    pub dtd_m: Option<Stated>,
    /// Speed over ground towards the target, m/s.
    pub ground_speed_mps: Option<Stated>,
    /// Time to touchdown, seconds.
    pub time_to_touchdown_s: Option<Stated>,
    /// Position of the point at the centre of the boxes, and its standard deviation, root of the sum over the axes, metres; `None` unless
    /// two views with fitted cameras saw it.
    pub position: Option<(Geodetic, f64)>,
    /// Views with boxes that are not used, and the cause.
    pub withheld: Option<Withheld>,
}

/// A number with its uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stated {
    /// Most likely value.
    pub value: f64,
    /// Standard deviation; `None` if the estimator states none.
    pub sd: Option<f64>,
    /// 90 % interval.
    pub interval: Option<[f64; 2]>,
}

impl From<Estimated> for Stated {
    fn from(estimated: Estimated) -> Self {
        Self {
            value: estimated.value,
            sd: Some(estimated.sd),
            interval: Some(estimated.interval),
        }
    }
}

impl Answer {
    /// Answer from the filter.
    pub(super) fn with_estimate(judged: &JudgedAircraft) -> Self {
        let estimate = judged.stated();
        Self {
            dtd_m: estimate.map(|of| of.distance_m.into()),
            ground_speed_mps: estimate.map(|of| of.ground_speed_mps.into()),
            time_to_touchdown_s: estimate.and_then(|of| Some(of.time_to_touchdown_s?.into())),
            ..Self::without(judged)
        }
    }

    /// Answer from an estimator for single ticks.
    pub(super) fn with_distance(judged: &JudgedAircraft, distance_m: Option<f64>) -> Self {
        let arrives = judged.phase == Phase::Arrival;
        let dtd_m = distance_m.filter(|_| arrives).map(|value| Stated {
            value,
            sd: None,
            interval: None,
        });
        Self {
            dtd_m,
            ..Self::without(judged)
        }
    }

    fn without(judged: &JudgedAircraft) -> Self {
        Self {
            aircraft: judged.number,
            phase: judged.phase,
            views: judged.observed.seen().map(|(view, _)| view).collect(),
            seen_s: judged.seen_s,
            dtd_m: None,
            ground_speed_mps: None,
            time_to_touchdown_s: None,
            position: None,
            withheld: judged.contradiction.as_ref().map(|of| of.withheld.clone()),
        }
    }
}
