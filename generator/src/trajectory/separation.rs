//! Reasons why aircraft cannot be in one scenario: they would collide, be on the runway together, or be below the ground.

use dataset::corpus::scenario::OtherAircraft;
use dataset::geometry::runway::{Runway, RunwayCoordinates};

use super::traffic::Placed;

/// Minimum distance of two aircraft of which one is in the air, metres: 500 ft, the smallest vertical separation of the rules of the air.
const MIN_IN_THE_AIR_M: f64 = 150.0;
/// Minimum distance of two aircraft on the ground, metres: the longest type is 74 m long.
const MIN_ON_THE_GROUND_M: f64 = 75.0;
/// An aircraft within this distance of the centreline is on the runway, metres: taxiways hold aircraft at 90 m.
const RUNWAY_M: f64 = 90.0;
/// The runway is in use by an aircraft whose wheels are lower, metres: 50 ft, the height at which landings pass the threshold.
const IN_USE_M: f64 = 15.0;
/// Length of a runway whose length is not known, and how far before the threshold it counts, metres.
const LENGTH_M: f64 = 4_000.0;
const BEFORE_M: f64 = 60.0;
/// Allowance for heights below ground: landing gear gives way, metres.
const GROUND_M: f64 = 1.0;

/// Reason why aircraft cannot be in one scenario.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{reason}")]
pub struct TrafficFault {
    /// Number of the aircraft at fault; 0 is the first.
    pub(crate) number: usize,
    reason: String,
}

impl TrafficFault {
    pub(crate) fn of(number: usize, reason: impl ToString) -> Self {
        let reason = reason.to_string();
        Self { number, reason }
    }
}

/// Distance from the touchdown target to the end of the runway, metres.
pub(super) fn past_end_m(runway: &Runway) -> f64 {
    runway.length_m.unwrap_or(LENGTH_M) - runway.touchdown_past_threshold_m
}

/// An aircraft in messages.
pub(super) fn named(number: usize, others: &[OtherAircraft]) -> String {
    let other = number.checked_sub(1).and_then(|index| others.get(index));
    other.map_or("aircraft 0 (the first)".into(), |of| {
        format!("aircraft {number} ({}, {})", of.role.word(), of.aircraft)
    })
}

/// Checks the places of all aircraft, the first one's first, at these times. `wheels_m`: heights of their centres of gravity over their
/// wheels.
pub(crate) fn check(
    all: &[Vec<Placed>],
    others: &[OtherAircraft],
    wheels_m: &[f64],
    times_s: &[f64],
    runway: &Runway,
) -> Result<(), TrafficFault> {
    let target = runway.touchdown_target();
    let runway_m = -past_end_m(runway)..runway.touchdown_past_threshold_m + BEFORE_M;
    for (index, &time_s) in times_s.iter().enumerate() {
        let here: Vec<&Placed> = all.iter().map(|places| &places[index]).collect();
        let positions = here.iter().map(|one| one.pose.position().to_ecef());
        let positions: Vec<_> = positions.collect();
        let height_m = |of: usize| {
            here[of].pose.altitude_msl_m - wheels_m[of] - runway.threshold.altitude_msl_m
        };
        let uses_runway = |of: usize| {
            if height_m(of) > IN_USE_M {
                return false;
            }
            let at = here[of].pose.position();
            let at = RunwayCoordinates::of(at, target, runway.course_true_deg);
            at.cross_track_m.abs() < RUNWAY_M && runway_m.contains(&at.along_track_m)
        };
        let use_runway: Vec<bool> = (0..here.len()).map(uses_runway).collect();
        for number in 1..here.len() {
            let fault = |what: String| {
                let reason = format!(
                    "{time_s:.0} s after the start, {what}: change after_s or spacing_nm in [[traffic]]"
                );
                Err(TrafficFault::of(number, reason))
            };
            let name = named(number, others);
            if height_m(number) < -GROUND_M {
                return fault(format!(
                    "{name} is {:.0} m below the runway; expected none below the ground, but the first aircraft's flight, which it follows, \
                     begins too low",
                    -height_m(number)
                ));
            }
            for earlier in 0..number {
                let are_down = here[number].on_ground && here[earlier].on_ground;
                let least_m = if are_down {
                    MIN_ON_THE_GROUND_M
                } else {
                    MIN_IN_THE_AIR_M
                };
                let distance_m = positions[number].distance(positions[earlier]);
                let what = if distance_m < least_m {
                    format!(
                        "{distance_m:.0} m from each other; expected at least {MIN_IN_THE_AIR_M} m in the air and {MIN_ON_THE_GROUND_M} m on \
                         the ground"
                    )
                } else if use_runway[number] && use_runway[earlier] {
                    format!(
                        "both on the runway, or less than {IN_USE_M} m above it; expected one at a time"
                    )
                } else {
                    continue;
                };
                return fault(format!("{} and {name} are {what}", named(earlier, others)));
            }
        }
    }
    Ok(())
}
