//! Reasons why aircraft cannot be in one scenario: they would collide, be on the runway together, or be below the ground.

use airframe::UnknownType;
use dataset::corpus::scenario::OtherAircraft;
use dataset::geometry::runway::{Runway, RunwayCoordinates};

use super::traffic::Placed;

/// Minimum distance of two aircraft of which one is in the air, metres: 500 ft, the smallest vertical separation of the rules of the air.
const MIN_IN_THE_AIR_M: f64 = 150.0;
/// Minimum distance of two aircraft on the ground, metres: the longest type is 74 m long.
const MIN_ON_THE_GROUND_M: f64 = 75.0;
/// An aircraft on the ground within this distance of the centreline is on the runway, metres: taxiways hold aircraft at 90 m.
const RUNWAY_M: f64 = 90.0;
/// Length of a runway whose length is not known, and how far before the threshold it counts, metres.
const LENGTH_M: f64 = 4_000.0;
const BEFORE_M: f64 = 60.0;
/// Allowance for heights below ground: landing gear gives way, metres.
const GROUND_M: f64 = 1.0;

/// An aircraft in messages.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Named {
    number: usize,
    words: String,
}

impl Named {
    fn of(number: usize, others: &[OtherAircraft]) -> Self {
        let other = number.checked_sub(1).and_then(|index| others.get(index));
        let words = match other {
            None => "aircraft 0 (the first)".into(),
            Some(OtherAircraft { role, aircraft, .. }) => {
                format!("aircraft {number} ({}, {aircraft})", role.word())
            }
        };
        Self { number, words }
    }
}

/// Reasons why aircraft cannot be in one scenario.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TrafficFault {
    /// Its shape is not known.
    #[error(transparent)]
    UnknownType(#[from] UnknownType),
    /// They come too near to each other.
    #[error(
        "{} and {} are {distance_m:.0} m from each other {time_s:.0} s after the start; expected at least {MIN_IN_THE_AIR_M} m in the air and \
         {MIN_ON_THE_GROUND_M} m on the ground: change after_s or spacing_nm of one of them in [[traffic]]",
        pair[0].words, pair[1].words
    )]
    TooClose {
        /// The two.
        pair: [Named; 2],
        /// Their distance.
        distance_m: f64,
        /// When.
        time_s: f64,
    },
    /// Both are on the runway.
    #[error(
        "{} and {} are both on the runway {time_s:.0} s after the start; expected one at a time: change after_s or spacing_nm of one of them \
         in [[traffic]]",
        pair[0].words, pair[1].words
    )]
    BothOnRunway {
        /// The two.
        pair: [Named; 2],
        /// When.
        time_s: f64,
    },
    /// It is below the ground.
    #[error(
        "{} is {below_m:.0} m below the runway {time_s:.0} s after the start; expected none below the ground: the first aircraft's flight, which \
         it follows, begins too low for its after_s or spacing_nm in [[traffic]]",
        aircraft.words
    )]
    BelowGround {
        /// The aircraft.
        aircraft: Named,
        /// Depth of its wheels.
        below_m: f64,
        /// When.
        time_s: f64,
    },
}

impl TrafficFault {
    /// Index of the aircraft at fault among the others.
    pub(crate) fn other(&self) -> usize {
        let named = match self {
            Self::TooClose { pair, .. } | Self::BothOnRunway { pair, .. } => &pair[1],
            Self::BelowGround { aircraft, .. } => aircraft,
            Self::UnknownType(_) => return 0,
        };
        named.number.saturating_sub(1)
    }
}

/// Checks aircraft at all times: the first one and behind it `others`. `wheels_m` are the heights of their centres of gravity over their
/// wheels.
pub(crate) fn check(
    all: &[Vec<Placed>],
    others: &[OtherAircraft],
    wheels_m: &[f64],
    times_s: &[f64],
    runway: &Runway,
) -> Result<(), TrafficFault> {
    let name = |number: usize| Named::of(number, others);
    let ground_m = runway.threshold.altitude_msl_m;
    let target = runway.touchdown_target();
    let to_end_m = runway.length_m.unwrap_or(LENGTH_M) - runway.touchdown_past_threshold_m;
    let is_on_runway = |here: &Placed| {
        if !here.on_ground {
            return false;
        }
        let at = RunwayCoordinates::of(here.pose.position(), target, runway.course_true_deg);
        let to_threshold_m = runway.touchdown_past_threshold_m + BEFORE_M;
        at.cross_track_m.abs() < RUNWAY_M && (-to_end_m..to_threshold_m).contains(&at.along_track_m)
    };
    for (index, &time_s) in times_s.iter().enumerate() {
        let here: Vec<&Placed> = all.iter().map(|places| &places[index]).collect();
        let places: Vec<_> = here
            .iter()
            .map(|one| one.pose.position().to_ecef())
            .collect();
        let on_runway: Vec<bool> = here.iter().map(|one| is_on_runway(one)).collect();
        for number in 1..here.len() {
            let below_m = ground_m + wheels_m[number] - here[number].pose.altitude_msl_m;
            if below_m > GROUND_M {
                return Err(TrafficFault::BelowGround {
                    aircraft: name(number),
                    below_m,
                    time_s,
                });
            }
            for earlier in 0..number {
                let pair = || [name(earlier), name(number)];
                let are_down = here[number].on_ground && here[earlier].on_ground;
                let least_m = if are_down {
                    MIN_ON_THE_GROUND_M
                } else {
                    MIN_IN_THE_AIR_M
                };
                let distance_m = places[number].distance(places[earlier]);
                if distance_m < least_m {
                    return Err(TrafficFault::TooClose {
                        pair: pair(),
                        distance_m,
                        time_s,
                    });
                }
                if on_runway[number] && on_runway[earlier] {
                    return Err(TrafficFault::BothOnRunway {
                        pair: pair(),
                        time_s,
                    });
                }
            }
        }
    }
    Ok(())
}
