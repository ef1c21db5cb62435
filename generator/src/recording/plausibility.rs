//! Is a recording what its columns say, and an approach to the runway of the sweep?
//!
//! A file with the right columns may hold feet, knots, radians or a pressure altitude, and a flight with the right units may pass over
//! the runway or land on another one. Everything would be drawn, labelled and sealed without an error. So units are compared with each
//! other (positions, velocities, times), and the path with the runway. Limits are wide: they reject mistakes, not unusual flights.

use std::fmt;

use dataset::geometry::geodesy::Geodetic;
use dataset::geometry::pose::FlightState;
use dataset::geometry::runway::{Runway, RunwayCoordinates};
use dataset::numbers::spread::median;
use dataset::numbers::units::Degrees;
use schemars::JsonSchema;
use serde::Deserialize;

use crate::trajectory::Inbound;

/// Ratios of two units, and what a number in the wrong one looks like.
const LENGTH_RATIOS: [(f64, &str); 1] = [(3.280_84, "feet")];
const SPEED_RATIOS: [(f64, &str); 3] = [
    (1.943_84, "knots"),
    (3.6, "kilometres per hour"),
    (196.85, "feet per minute"),
];
/// Agreement with such a ratio.
const RATIO_TOLERANCE: f64 = 0.12;
/// Altitude and the integral of the vertical speed may differ by this much, metres, plus a part of the change of altitude.
const CLIMB_TOLERANCE_M: f64 = 30.0;
const CLIMB_TOLERANCE: f64 = 0.25;
/// Airspeed over ground speed.
const AIRSPEED_RATIOS: std::ops::RangeInclusive<f64> = 0.5..=1.7;
/// Slower states have no heading that has to agree with the track.
const MOVING_MPS: f64 = 30.0;
/// Largest median angle between heading and track: more than any crosswind causes.
const LARGEST_CRAB_DEG: f64 = 40.0;
/// Largest pitch and roll, as numbers, that look like radians. No airliner flies a whole approach within 0.2 degrees.
const RADIANS: f64 = 0.2;
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
/// The corridor of an approach: distance from the centreline, and height as a multiple of the glide path's.
const CORRIDOR_M: f64 = 500.0;
const CORRIDOR: f64 = 0.6;
const LOWEST: (f64, f64) = (0.2, -30.0);
const HIGHEST: (f64, f64) = (3.0, 300.0);

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
}

impl Allowed {
    fn key(self) -> &'static str {
        match self {
            Self::Overflight => "overflight",
            Self::Offset => "offset",
            Self::Outside => "outside",
            Self::GoAround => "go-around",
        }
    }
}

/// Reasons why a recording is no approach in the units of its columns. The text continues the name of a file.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Implausible {
    /// A column in another unit, or with another sign.
    #[error("has {column} that look like {looks_like}: {why}; expected {expected}")]
    Unit {
        /// The column or columns.
        column: &'static str,
        /// Their likely unit.
        looks_like: &'static str,
        /// The evidence.
        why: String,
        /// Their unit by name.
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
    #[error("{how}; if this is meant, add `allow = [\"{}\"]` to its [[recorded]]", allowed.key())]
    NoApproach {
        /// Its course instead.
        how: String,
        /// The kind that accepts it.
        allowed: Allowed,
    },
}

/// The states of an approach in the frame of the runway.
pub(super) struct Seen<'a> {
    states: &'a [FlightState],
    runway: &'a Runway,
    places: Vec<RunwayCoordinates>,
    inbound: Inbound,
}

/// Coordinates of a position relative to the target of a runway.
pub(super) fn place(state: &FlightState, target: Geodetic, runway: &Runway) -> RunwayCoordinates {
    RunwayCoordinates::of(state.pose.position(), target, runway.course_true_deg)
}

impl<'a> Seen<'a> {
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

    /// Compares the units of the columns with each other, over the approach.
    pub(super) fn units(&self) -> Result<(), Implausible> {
        let approach = &self.states[self.range()];
        if approach.len() < 2 {
            return Ok(());
        }
        speeds(approach)?;
        climb(approach)?;
        airspeed(approach)?;
        attitude(approach)
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

    /// Median height of the states on the ground near the target, if no runway is as high or as low.
    fn rolling_height_m(&self) -> Option<f64> {
        let near = self.states.iter().zip(&self.places);
        let rolling = near.filter(|(state, place)| state.on_ground && place.dtd_m < ROLL_M);
        let mut heights: Vec<f64> = rolling
            .map(|(_, place)| place.height_over_target_m)
            .collect();
        if heights.is_empty() {
            return None;
        }
        Some(median(&mut heights)).filter(|height_m| height_m.abs() > ROLLING_HEIGHT_M)
    }

    /// Indices of the approach.
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

/// The form of its coordinates in which a flight without an approach would be near the runway.
pub(super) fn elsewhere(states: &[FlightState], runway: &Runway) -> Option<Implausible> {
    let target = runway.touchdown_target();
    let nearest_m = |change: &dyn Fn(f64, f64) -> (f64, f64)| {
        let distances = states.iter().filter_map(|state| {
            let Geodetic {
                latitude_deg,
                longitude_deg,
                altitude_msl_m,
            } = state.pose.position();
            let (latitude_deg, longitude_deg) = change(latitude_deg, longitude_deg);
            let is_place = latitude_deg.abs() <= 90.0 && longitude_deg.abs() <= 180.0;
            let there = Geodetic {
                latitude_deg,
                longitude_deg,
                altitude_msl_m,
            };
            is_place.then(|| target.lat_lon().distance_m(there.lat_lon()))
        });
        distances.min_by(f64::total_cmp).unwrap_or(f64::INFINITY)
    };
    let here_m = nearest_m(&|latitude, longitude| (latitude, longitude));
    if here_m < NEAR_M {
        return None;
    }
    type Change = fn(f64, f64) -> (f64, f64);
    let forms: [(&str, Change); 4] = [
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
    let (looks_like, _) = forms.iter().find(|(_, form)| nearest_m(form) < NEAR_M)?;
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

/// The name of the unit in which a quantity has this many times its number.
fn unit_of(ratio: f64, units: &[(f64, &'static str)]) -> Option<&'static str> {
    let fits = |(factor, _): &&(f64, &str)| (ratio / factor - 1.0).abs() < RATIO_TOLERANCE;
    units.iter().find(fits).map(|(_, name)| *name)
}

fn ground_speed_mps(state: &FlightState) -> f64 {
    state.velocity_north_mps.hypot(state.velocity_east_mps)
}

/// Way over ground by positions against velocities and times.
fn speeds(approach: &[FlightState]) -> Result<(), Implausible> {
    let (mut way_m, mut flown_m, mut steps_s) = (0.0, 0.0, Vec::new());
    for pair in approach.windows(2) {
        let [before, after] = pair else { continue };
        let step_s = after.time_s - before.time_s;
        let (from, to) = (before.pose.position(), after.pose.position());
        way_m += from.lat_lon().distance_m(to.lat_lon());
        flown_m += step_s * (ground_speed_mps(before) + ground_speed_mps(after)) / 2.0;
        steps_s.push(step_s);
    }
    if way_m < 100.0 || flown_m <= 0.0 {
        return Ok(());
    }
    let why =
        format!("positions are {way_m:.0} m apart where velocities and times make {flown_m:.0} m");
    let ratio = flown_m / way_m;
    if let Some(looks_like) = unit_of(ratio, &SPEED_RATIOS) {
        return Err(Implausible::Unit {
            column: "v_north_mps and v_east_mps",
            looks_like,
            why,
            expected: "metres per second over ground",
        });
    }
    for (looks_like, factor) in [
        ("milliseconds", 1e3),
        ("microseconds", 1e6),
        ("minutes", 1.0 / 60.0),
    ] {
        if (ratio / factor - 1.0).abs() < RATIO_TOLERANCE {
            return Err(Implausible::Unit {
                column: "t_s",
                looks_like,
                why,
                expected: "seconds",
            });
        }
    }
    Ok(())
}

/// Altitude against vertical speed.
fn climb(approach: &[FlightState]) -> Result<(), Implausible> {
    let integral = approach.windows(2).map(|pair| {
        let step_s = pair[1].time_s - pair[0].time_s;
        step_s * (pair[0].velocity_down_mps + pair[1].velocity_down_mps) / 2.0
    });
    let sinks_m: f64 = integral.sum();
    let altitude_m = |state: &FlightState| state.pose.altitude_msl_m;
    let falls_m = altitude_m(&approach[0]) - altitude_m(&approach[approach.len() - 1]);
    let allowed_m = CLIMB_TOLERANCE_M + CLIMB_TOLERANCE * falls_m.abs();
    if (falls_m - sinks_m).abs() <= allowed_m {
        return Ok(());
    }
    let why =
        format!("altitude_msl_m falls by {falls_m:.0} m where v_down_mps makes {sinks_m:.0} m");
    let ratio = falls_m / sinks_m;
    if let Some(looks_like) = unit_of(ratio, &LENGTH_RATIOS) {
        return Err(Implausible::Unit {
            column: "altitude_msl_m",
            looks_like,
            why,
            expected: "metres above mean sea level",
        });
    }
    let upwards = (falls_m + sinks_m).abs() <= allowed_m;
    let feet_per_minute = unit_of(ratio.recip().abs(), &SPEED_RATIOS[2..]);
    let feet_per_second = unit_of(ratio.recip().abs(), &LENGTH_RATIOS).map(|_| "feet per second");
    let looks_like = if upwards {
        Some("velocities upwards")
    } else {
        feet_per_minute.or(feet_per_second)
    };
    match looks_like {
        Some(looks_like) => Err(Implausible::Unit {
            column: "v_down_mps",
            looks_like,
            why,
            expected: "metres per second, downwards positive",
        }),
        None => Err(Implausible::Contradiction {
            why,
            expected: "both to agree",
        }),
    }
}

/// Airspeed against ground speed.
fn airspeed(approach: &[FlightState]) -> Result<(), Implausible> {
    let moving = approach
        .iter()
        .filter(|state| ground_speed_mps(state) > MOVING_MPS);
    let mut ratios: Vec<f64> = moving
        .map(|state| state.true_airspeed_mps / ground_speed_mps(state))
        .collect();
    if ratios.is_empty() {
        return Ok(());
    }
    let ratio = median(&mut ratios);
    if AIRSPEED_RATIOS.contains(&ratio) {
        return Ok(());
    }
    let why = format!("tas_mps is {ratio:.2} times the ground speed");
    match unit_of(ratio, &SPEED_RATIOS) {
        Some(looks_like) => Err(Implausible::Unit {
            column: "tas_mps",
            looks_like,
            why,
            expected: "metres per second",
        }),
        None => Err(Implausible::Contradiction {
            why,
            expected: "0.5 to 1.7 times",
        }),
    }
}

/// Heading against track, and the size of pitch and roll.
fn attitude(approach: &[FlightState]) -> Result<(), Implausible> {
    let moving: Vec<&FlightState> = approach
        .iter()
        .filter(|state| ground_speed_mps(state) > MOVING_MPS)
        .collect();
    if moving.is_empty() {
        return Ok(());
    }
    let crab_deg = |heading: &dyn Fn(&FlightState) -> f64| {
        let mut angles: Vec<f64> = moving
            .iter()
            .map(|state| {
                let track_deg = state
                    .velocity_east_mps
                    .atan2(state.velocity_north_mps)
                    .to_degrees();
                Degrees(heading(state) - track_deg).wrapped_180().0.abs()
            })
            .collect();
        median(&mut angles)
    };
    let heading_deg = |state: &FlightState| state.pose.heading_true_deg;
    let as_it_is_deg = crab_deg(&heading_deg);
    let is_small = |state: &&FlightState| heading_deg(state).abs() <= std::f64::consts::TAU;
    let as_radians_deg = crab_deg(&|state| heading_deg(state).to_degrees());
    let unit = |column, looks_like, why, expected| {
        Err(Implausible::Unit {
            column,
            looks_like,
            why,
            expected,
        })
    };
    let why = format!("heading and track differ by {as_it_is_deg:.0} degrees (median)");
    if moving.iter().all(is_small) && as_radians_deg + 5.0 < as_it_is_deg {
        return unit("heading_true_deg", "radians", why, "degrees, 0 to 360");
    }
    if as_it_is_deg > 180.0 - LARGEST_CRAB_DEG {
        return unit(
            "heading_true_deg",
            "headings of an aircraft that flies backwards",
            why,
            "where the nose points",
        );
    }
    if as_it_is_deg > LARGEST_CRAB_DEG {
        return Err(Implausible::Contradiction {
            why,
            expected: "at most 40 degrees",
        });
    }
    let largest = |angle: &dyn Fn(&FlightState) -> f64| {
        approach
            .iter()
            .map(|state| angle(state).abs())
            .fold(0.0, f64::max)
    };
    let pitch = largest(&|state| state.pose.pitch_deg);
    let roll = largest(&|state| state.pose.roll_deg);
    let lasts_s = approach[approach.len() - 1].time_s - approach[0].time_s;
    if pitch > 0.0 && pitch.max(roll) < RADIANS && lasts_s > 60.0 {
        let why =
            format!("no pitch is above {pitch:.3} and no roll above {roll:.3} in {lasts_s:.0} s");
        return unit("pitch_deg and roll_deg", "radians", why, "degrees");
    }
    Ok(())
}

impl fmt::Display for Allowed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.key())
    }
}
