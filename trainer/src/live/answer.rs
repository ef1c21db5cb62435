//! Answers about one aircraft at a tick.

use dataset::geometry::geodesy::Geodetic;

use super::{Judged, Phase};
use crate::estimators::inverse_range::flight_filter::Estimated;

/// State of one aircraft at a tick.
#[derive(Debug, Clone, PartialEq)]
pub struct Answer {
    /// Its number, which it keeps through gaps.
    pub aircraft: u32,
    /// Arrival or not.
    pub phase: Phase,
    /// Views whose boxes were used at this tick; empty: the answer is predicted.
    pub views: Vec<usize>,
    /// Time of the last tick at which there were any, seconds.
    pub seen_s: f64,
    /// Distance to touchdown, metres; `None` of what does not arrive, and where it is too uncertain.
    pub dtd_m: Option<Stated>,
    /// Speed over ground towards the target, m/s.
    pub ground_speed_mps: Option<Stated>,
    /// Time to touchdown, seconds.
    pub time_to_touchdown_s: Option<Stated>,
    /// Its place; `None` unless two views saw it whose cameras were fitted.
    pub position: Option<Position>,
    /// Views that see it and are not used, with the cause.
    pub withheld: Option<Withheld>,
}

/// Views whose cameras may have been turned without a sign: in fog they have seen the aircraft to the side of the training's paths for a
/// minute.
#[derive(Debug, Clone, PartialEq)]
pub struct Withheld {
    /// Their indices.
    pub views: Vec<usize>,
    /// Distance from the paths to the side, pixels.
    pub off_px: f64,
    /// Largest distance that counts as on the paths, pixels.
    pub limit_px: f64,
}

/// Place of the point of an aircraft that its boxes are centred on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Position {
    /// Latitude, degrees.
    pub latitude_deg: f64,
    /// Longitude, degrees.
    pub longitude_deg: f64,
    /// Height as in the poses of a corpus, metres.
    pub height_m: f64,
    /// Standard deviation, the root of the sum over the axes, metres.
    pub sd_m: f64,
}

/// A number, and how sure it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stated {
    /// The most likely one.
    pub value: f64,
    /// Standard deviation; `None` from an estimator that states none.
    pub sd: Option<f64>,
    /// Ends of the 90 % interval.
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
    /// The answer of the filter.
    pub(super) fn with_estimate(judged: &Judged) -> Self {
        let estimate = judged.stated();
        Self {
            dtd_m: estimate.map(|of| of.distance_m.into()),
            ground_speed_mps: estimate.map(|of| of.ground_speed_mps.into()),
            time_to_touchdown_s: estimate.and_then(|of| Some(of.time_to_touchdown_s?.into())),
            ..Self::without(judged)
        }
    }

    /// The answer of an estimator of single ticks.
    pub(super) fn with_distance(judged: &Judged, distance_m: Option<f64>) -> Self {
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

    /// With the place that fitted cameras see.
    pub(super) fn at(self, place: Option<(Geodetic, f64)>) -> Self {
        let position = place.map(|(place, sd_m)| Position {
            latitude_deg: place.latitude_deg,
            longitude_deg: place.longitude_deg,
            height_m: place.altitude_msl_m,
            sd_m,
        });
        Self { position, ..self }
    }

    fn without(judged: &Judged) -> Self {
        let seen = judged.observed.boxes.iter().enumerate();
        Self {
            aircraft: judged.number,
            phase: judged.phase,
            views: seen.filter_map(|(view, seen)| seen.map(|_| view)).collect(),
            seen_s: judged.seen_s,
            dtd_m: None,
            ground_speed_mps: None,
            time_to_touchdown_s: None,
            position: None,
            withheld: judged.withheld.clone(),
        }
    }
}
