//! Is a recording what its columns say, and an approach to the runway of the sweep?
//!
//! A file with the right columns may hold feet, knots, radians or a pressure altitude, and a flight with the right units may pass over the
//! runway or land on a different one. Everything would be drawn, labelled and sealed without an error. So units are compared with each
//! other (positions, velocities, times), and the path with the runway. Limits are wide: they reject mistakes, not unusual flights.

mod attitude;
mod units;

use std::fmt;

use dataset::geometry::geodesy::{Geodetic, LatLon};
use dataset::geometry::pose::FlightState;
use dataset::geometry::runway::{Runway, RunwayCoordinates};
use dataset::numbers::spread::median_of;
use schemars::JsonSchema;
use serde::Deserialize;

use crate::trajectory::Inbound;
pub(crate) use units::GRAVITY_MPS2;

/// Positions within this distance are near the runway, metres.
const NEAR_M: f64 = 100_000.0;
/// Height above the target where the aircraft passes it, metres.
const HEIGHTS_AT_TARGET_M: std::ops::RangeInclusive<f64> = -10.0..=50.0;
/// Within this distance of the target an aircraft on the ground is at most this much above or below it: runways slope by up to 2 %.
const ROLL_M: f64 = 1_000.0;
const ROLLING_HEIGHT_M: f64 = 20.0;
/// Distance from the centreline there.
const OFFSET_AT_TARGET_M: f64 = 100.0;
/// Height that ends a landing: the aircraft goes around.
pub(crate) const GO_AROUND_M: f64 = 150.0;
/// Approach corridor: distance from the centreline, and height as a multiple of the glide path's.
pub(crate) const CORRIDOR_M: f64 = 500.0;
const CORRIDOR: f64 = 0.6;
const LOWEST: (f64, f64) = (0.5, -60.0);
const HIGHEST: (f64, f64) = (2.2, 300.0);
/// Flaps may be retracted by this ratio on approach.
const MAX_RETRACTION: f64 = 0.15;

/// Minimum time before the target, seconds: a shorter recording is a partial approach.
const MIN_APPROACH_S: f64 = 10.0;

/// Kinds of flights that are no approach and may be flown nevertheless.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Allowed {
    /// Passes the touchdown target in the air.
    Overflight,
    /// Passes beside the runway.
    Offset,
    /// Comes from the side, or much lower or higher than an approach.
    Outside,
    /// Climbs again after it has passed the target.
    GoAround,
    /// Begins shortly before the target, or ends before it.
    Part,
}

impl fmt::Display for Allowed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Overflight => "overflight",
            Self::Offset => "offset",
            Self::Outside => "outside",
            Self::GoAround => "go-around",
            Self::Part => "part",
        })
    }
}

/// Reasons why a recording is no approach in the columns' units. The text continues a file name.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Implausible {
    /// A column has a wrong unit or sign.
    #[error("has {column} that look like {looks_like}: {why}; expected {expected}")]
    Unit {
        /// The column or columns.
        column: &'static str,
        /// Likely unit.
        looks_like: &'static str,
        /// The evidence.
        why: String,
        /// Unit by the column's name.
        expected: &'static str,
    },
    /// Columns that contradict each other.
    #[error("contradicts itself: {why}; expected {expected}")]
    Contradiction {
        /// The evidence.
        why: String,
        /// The agreement that was expected.
        expected: &'static str,
    },
    /// It does not land on this runway. `allow` of `[[recorded]]` accepts it.
    #[error("{how}; if this is meant, add `allow = [\"{allowed}\"]` to its [[recorded]]")]
    NoApproach {
        /// Actual course of the flight.
        how: String,
        /// The kind that accepts it.
        allowed: Allowed,
    },
}

/// States relative to the runway.
pub(super) struct ApproachPath<'a> {
    states: &'a [FlightState],
    runway: &'a Runway,
    places: Vec<RunwayCoordinates>,
    inbound: Inbound,
}

/// Coordinates relative to the touchdown target.
pub(super) fn place(state: &FlightState, target: Geodetic, runway: &Runway) -> RunwayCoordinates {
    RunwayCoordinates::of(state.pose.position(), target, runway.course_true_deg)
}

impl<'a> ApproachPath<'a> {
    pub(super) fn new(states: &'a [FlightState], runway: &'a Runway, inbound: Inbound) -> Self {
        let target = runway.touchdown_target();
        let places = states.iter().map(|state| place(state, target, runway));
        Self {
            states,
            runway,
            places: places.collect(),
            inbound,
        }
    }

    /// Compares the units of the columns with each other, over the approach. `has_attitude`: it was measured.
    pub(super) fn units(&self, has_attitude: bool) -> Result<(), Implausible> {
        let approach = &self.states[self.range()];
        if approach.len() < 2 {
            return Ok(());
        }
        units::times(approach)?;
        units::speeds(approach)?;
        units::directions(approach)?;
        units::climb(approach)?;
        units::airspeed(approach)?;
        if has_attitude {
            attitude::attitude(approach)?;
        }
        self.controls()
    }

    /// Gear and flaps where it lands.
    fn controls(&self) -> Result<(), Implausible> {
        let Some(passing) = self.inbound.passing else {
            return Ok(());
        };
        let [first, last] = [self.inbound.first, passing].map(|at| self.states[at].controls);
        let lands = HEIGHTS_AT_TARGET_M.contains(&self.places[passing].height_over_target_m);
        let why = if lands && last.gear_ratio < 0.5 {
            format!("gear_norm is {} at the touchdown target", last.gear_ratio)
        } else if lands && last.flap_ratio < first.flap_ratio - MAX_RETRACTION {
            format!(
                "flap_norm falls from {} to {} on approach",
                first.flap_ratio, last.flap_ratio
            )
        } else {
            return Ok(());
        };
        units::contradiction(
            why,
            "1 with the gear down, and with the flaps fully extended",
        )
    }

    /// Compares the path with the runway.
    pub(super) fn path(&self, allow: &[Allowed]) -> Result<(), Implausible> {
        let refuse = |allowed: Allowed, how: String| {
            if allow.contains(&allowed) {
                Ok(())
            } else {
                Err(Implausible::NoApproach { how, allowed })
            }
        };
        let Runway { airport, name, .. } = self.runway;
        if let Some(how) = self.is_part() {
            refuse(Allowed::Part, how)?;
        }
        if let Some(passing) = self.inbound.passing {
            let at = &self.places[passing];
            let side = if at.cross_track_m > 0.0 {
                "right"
            } else {
                "left"
            };
            let (height_m, offset_m) = (at.height_over_target_m, at.cross_track_m.abs());
            if offset_m > OFFSET_AT_TARGET_M {
                refuse(
                    Allowed::Offset,
                    format!(
                        "passes the touchdown target of {airport} {name} {offset_m:.0} m {side} of the centreline, expected at most \
                         {OFFSET_AT_TARGET_M} m: is it a landing on another runway?"
                    ),
                )?;
            }
            if height_m < *HEIGHTS_AT_TARGET_M.start() {
                return Err(Implausible::Contradiction {
                    why: format!(
                        "it passes the touchdown target of {airport} {name} {:.0} m below the runway; is altitude_msl_m a pressure altitude?",
                        -height_m
                    ),
                    expected: "heights above mean sea level",
                });
            }
            if let Some(rolls_m) = self.rolling_height_m() {
                return Err(Implausible::Contradiction {
                    why: format!(
                        "it rolls on {airport} {name} at a height of {rolls_m:.0} m; is altitude_msl_m a pressure altitude?"
                    ),
                    expected: "heights above mean sea level, and on_ground on the runway",
                });
            }
            if height_m > *HEIGHTS_AT_TARGET_M.end() {
                refuse(
                    Allowed::Overflight,
                    format!(
                        "passes the touchdown target of {airport} {name} at a height of {height_m:.0} m, expected at most {} m: an \
                         overflight, or a pressure altitude?",
                        HEIGHTS_AT_TARGET_M.end()
                    ),
                )?;
            } else if let Some(highest_m) = self.climbs_after(passing) {
                refuse(
                    Allowed::GoAround,
                    format!(
                        "goes around: after the touchdown target of {airport} {name} it climbs to {highest_m:.0} m without having touched \
                         down"
                    ),
                )?;
            }
        }
        let aside_m = match self.inbound.passing {
            Some(passing) if allow.contains(&Allowed::Offset) => self.places[passing].cross_track_m,
            _ => 0.0,
        };
        let leaves = |index| self.leaves_corridor(index, aside_m);
        match self.range().find_map(leaves) {
            Some(how) => refuse(Allowed::Outside, how),
            None => Ok(()),
        }
    }

    /// Description of a partial approach's missing end.
    fn is_part(&self) -> Option<String> {
        let Runway { airport, name, .. } = self.runway;
        let first = self.inbound.first;
        let Some(passing) = self.inbound.passing else {
            let last_m = self.places.last()?.along_track_m;
            return Some(format!(
                "ends {last_m:.0} m before the touchdown target of {airport} {name}"
            ));
        };
        let lasts_s = self.states[passing].time_s - self.states[first].time_s;
        // Otherwise it was cut where the sweep begins.
        let begins_here = first == 0;
        (begins_here && lasts_s < MIN_APPROACH_S).then(|| {
            format!(
                "begins {:.0} m before the touchdown target of {airport} {name}, {lasts_s:.1} s before it passes it; expected at least \
                 {MIN_APPROACH_S} s",
                self.places[first].along_track_m
            )
        })
    }

    /// Median height of the states on the ground near the target, if no runway is as high or as low.
    fn rolling_height_m(&self) -> Option<f64> {
        let near = self.states.iter().zip(&self.places);
        let rolling = near.filter(|(state, place)| state.on_ground && place.dtd_m < ROLL_M);
        let height_m = median_of(rolling.map(|(_, place)| place.height_over_target_m));
        height_m.filter(|height_m| height_m.abs() > ROLLING_HEIGHT_M)
    }

    fn range(&self) -> std::ops::Range<usize> {
        self.inbound.first..self.inbound.passing.unwrap_or(self.states.len())
    }

    /// The greatest height after the target, if the aircraft climbs away.
    fn climbs_after(&self, passing: usize) -> Option<f64> {
        let later = self.states[passing..].iter().zip(&self.places[passing..]);
        let airborne = later.take_while(|(state, _)| !state.on_ground);
        let heights = airborne.map(|(_, place)| place.height_over_target_m);
        heights
            .max_by(f64::total_cmp)
            .filter(|height_m| *height_m > GO_AROUND_M)
    }

    /// `aside_m`: offset of the corridor to the right.
    fn leaves_corridor(&self, index: usize, aside_m: f64) -> Option<String> {
        let at = &self.places[index];
        let to_go_m = at.along_track_m;
        let path_m = to_go_m * self.runway.glide_path_deg.to_radians().tan();
        let time_s = self.states[index].time_s;
        let widest_m = CORRIDOR_M + CORRIDOR * to_go_m;
        let offset_m = (at.cross_track_m - aside_m).abs();
        if offset_m > widest_m {
            return Some(format!(
                "is {offset_m:.0} m beside the extended centreline {to_go_m:.0} m before the target (at {time_s} s), expected at most \
                 {widest_m:.0} m"
            ));
        }
        let height_m = at.height_over_target_m;
        let limits = [LOWEST, HIGHEST].map(|(factor, more_m)| factor * path_m + more_m);
        (!(limits[0]..=limits[1]).contains(&height_m)).then(|| {
            format!(
                "is {height_m:.0} m above the runway {to_go_m:.0} m before the target (at {time_s} s), expected {:.0} to {:.0} m",
                limits[0], limits[1]
            )
        })
    }
}

/// Misinterpretation of the coordinates that would put a flight without an approach near the runway.
pub(super) fn elsewhere(
    states: impl Iterator<Item = FlightState>,
    runway: &Runway,
) -> Option<Implausible> {
    type Change = fn(f64, f64) -> (f64, f64);
    const FORMS: [(&str, Change); 5] = [
        ("what they are", |latitude, longitude| (latitude, longitude)),
        ("swapped coordinates", |latitude, longitude| {
            (longitude, latitude)
        }),
        ("radians", |latitude, longitude| {
            (latitude.to_degrees(), longitude.to_degrees())
        }),
        (
            "western longitudes without their sign",
            |latitude, longitude| (latitude, -longitude),
        ),
        (
            "southern latitudes without their sign",
            |latitude, longitude| (-latitude, longitude),
        ),
    ];
    let target = runway.touchdown_target().lat_lon();
    let mut nearest_m = [f64::INFINITY; FORMS.len()];
    for state in states {
        let here = state.pose.position();
        for (nearest_m, (_, form)) in nearest_m.iter_mut().zip(FORMS) {
            let (latitude_deg, longitude_deg) = form(here.latitude_deg, here.longitude_deg);
            if latitude_deg.abs() <= 90.0 && longitude_deg.abs() <= 180.0 {
                let there = LatLon {
                    latitude_deg,
                    longitude_deg,
                };
                *nearest_m = nearest_m.min(target.distance_m(there));
            }
        }
    }
    let here_m = nearest_m[0];
    if here_m < NEAR_M {
        return None;
    }
    let mut others = FORMS.iter().zip(nearest_m).skip(1);
    let ((looks_like, _), _) = others.find(|(_, nearest_m)| *nearest_m < NEAR_M)?;
    Some(Implausible::Unit {
        column: "latitude_deg and longitude_deg",
        looks_like,
        why: if here_m.is_finite() {
            format!(
                "they are never within {:.0} km of {} {}, and would be then",
                here_m / 1e3,
                runway.airport,
                runway.name
            )
        } else {
            format!(
                "they are no places on earth, and near {} {} then",
                runway.airport, runway.name
            )
        },
        expected: "degrees on WGS-84, north and east positive",
    })
}
