//! Other aircraft in a scenario: where each of them is at every tick.
//!
//! Input: the flight of the first aircraft, and the other aircraft as planned. Output: the places of all aircraft. An arrival or missed
//! approach follows the first aircraft's flight at a different time; all else is simple kinematics. Nothing is random here: what varies was
//! drawn with the plan.
//!
//! Times are seconds since tick 0. Figures are typical of jets: taxiing at 15 kt on a taxiway 190 m from the centreline (ICAO Annex 14 asks
//! for 182.5 m with code letter E), 2 m/s2 along the runway, 6 degrees of initial climb.

use airframe::AircraftType;
use dataset::corpus::scenario::{OtherAircraft, Role};
use dataset::geometry::pose::{Controls, FlightState, Pose};
use dataset::geometry::runway::{Runway, RunwayCoordinates};
use dataset::numbers::units::{Degrees, METERS_PER_NAUTICAL_MILE};

use super::ground_path::{GroundPath, GroundPlace, Leg};
use super::separation::{TrafficFault, check, named, past_end_m};
use super::{Trajectory, Window};

/// Taxiing speed.
const TAXI_MPS: f64 = 8.0;
/// The parallel taxiway, right of the centreline.
const TAXIWAY_M: f64 = 190.0;
/// The stands: right of the centreline, and from each other.
const APRON_M: f64 = 270.0;
const STANDS_M: f64 = 80.0;
/// Radius of turns from and to the runway, which suits the taxiing speed.
const TURN_M: f64 = 60.0;
/// Slowing down after a landing, and gathering speed for a take-off.
const ALONG_RUNWAY_MPS2: f64 = 2.0;
/// A departure lines up this far past the threshold.
const LINE_UP_M: f64 = 90.0;
/// Rotation begins at this multiple of the type's final speed.
const ROTATION_SPEED: f64 = 1.05;
/// Duration of the rotation, and the pitch at lift-off.
const ROTATION_S: f64 = 3.0;
const LIFT_OFF_PITCH_DEG: f64 = 9.0;
/// Angle of climb, and the time until it is reached.
const CLIMB_DEG: f64 = 6.0;
const INTO_CLIMB_S: f64 = 6.0;
/// A missed approach climbs from this height of the wheels: 200 ft, the decision height of a category I approach. A flight that ends higher
/// is no landing.
const DECISION_HEIGHT_M: f64 = 60.0;
/// A crossing aircraft is this far above the first one's path (1000 ft), with this speed (195 kt).
const CROSSING_ABOVE_M: f64 = 300.0;
const CROSSING_MPS: f64 = 100.0;
/// Flaps for a take-off.
const TAKE_OFF_FLAPS: f64 = 0.25;

/// An aircraft at an instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Placed {
    /// Pose of the centre of gravity.
    pub(crate) pose: Pose,
    /// Flaps and gear.
    pub(crate) controls: Controls,
    /// True if a wheel touches the ground.
    pub(crate) on_ground: bool,
}

impl Placed {
    /// As a state says.
    pub(crate) fn of(state: &FlightState) -> Self {
        Self {
            pose: state.pose,
            controls: state.controls,
            on_ground: state.on_ground,
        }
    }
}

/// The first aircraft's approach, continued in both directions: the way in before its first state, and a landing, the way off the runway
/// and along the taxiway after its last.
#[derive(Debug, Clone)]
pub(crate) struct Approach<'a> {
    trajectory: &'a Trajectory,
    runway: &'a Runway,
    aircraft: &'static AircraftType,
    start_s: f64,
    /// When it passes the touchdown target, seconds since tick 0.
    pub(crate) touchdown_s: f64,
    /// The way after its last state.
    roll_out: GroundPath,
}

impl<'a> Approach<'a> {
    /// The approach of a type within a flight.
    ///
    /// # Errors
    /// The flight does not land.
    pub(crate) fn new(
        trajectory: &'a Trajectory,
        window: Window,
        runway: &'a Runway,
        aircraft: &'static AircraftType,
    ) -> Result<Self, TrafficFault> {
        let last = trajectory.last();
        let end = RunwayCoordinates::of(
            last.pose.position(),
            runway.touchdown_target(),
            runway.course_true_deg,
        );
        let height_m = end.height_over_target_m - aircraft.wheel_height_below_cg_m();
        let landing_s = window.passing_s.filter(|_| height_m < DECISION_HEIGHT_M);
        let passing_s = landing_s.ok_or_else(|| {
            let reason = format!(
                "the first aircraft does not land: its flight ends {:.0} m before the touchdown target and {height_m:.0} m above the runway; \
                 expected a landing, from which the places of [[traffic]] are counted: fly one that lands, or take [[traffic]] out of the \
                 sweep",
                end.along_track_m
            );
            TrafficFault::of(0, reason)
        })?;
        let start = GroundPlace {
            past_m: -end.along_track_m,
            right_m: end.cross_track_m,
            turned_deg: 0.0,
        };
        let speed_mps = ground_speed_mps(&last);
        let across_m = (TAXIWAY_M - start.right_m - 2.0 * TURN_M).max(0.0);
        Ok(Self {
            trajectory,
            runway,
            aircraft,
            start_s: window.start_s,
            touchdown_s: passing_s - window.start_s,
            roll_out: GroundPath {
                start,
                legs: vec![
                    Leg::Straight(slowing_m(speed_mps)),
                    Leg::RightTurn(TURN_M),
                    Leg::Straight(across_m),
                    Leg::RightTurn(TURN_M),
                ],
            },
        })
    }

    /// Flies other aircraft with the first one: the places of each of them at all these times.
    ///
    /// # Errors
    /// A type is unknown, or they cannot be in one scenario.
    pub(crate) fn fly(
        &self,
        others: &[OtherAircraft],
        times_s: &[f64],
    ) -> Result<Vec<Vec<Placed>>, TrafficFault> {
        let mut all = vec![times_s.iter().map(|time_s| self.first(*time_s)).collect()];
        let mut wheels_m = vec![self.aircraft.wheel_height_below_cg_m()];
        let mut stands = 0;
        let go_around_s = self.decision_s();
        for other in others {
            let number = other.aircraft_number as usize;
            let aircraft = AircraftType::named(&other.aircraft)
                .map_err(|unknown| TrafficFault::of(number, unknown))?;
            wheels_m.push(aircraft.wheel_height_below_cg_m());
            let after_s = self.after_s(other);
            if other.role == Role::Crossing && after_s <= -self.touchdown_s / 2.0 {
                let reason = format!(
                    "{} crosses beyond the touchdown target; expected a place on the approach: change its after_s or spacing_nm in [[traffic]]",
                    named(number, others)
                );
                return Err(TrafficFault::of(number, reason));
            }
            let stand = f64::from(stands);
            stands += u32::from(other.role == Role::Parked);
            let at = |time_s: &f64| match other.role {
                Role::Arrival => self.shifted(aircraft, time_s - after_s),
                Role::MissedApproach => self.missed(aircraft, go_around_s, time_s - after_s),
                Role::Departure => self.departure(aircraft, time_s - self.touchdown_s - after_s),
                Role::Crossing => self.crossing(after_s, *time_s),
                Role::Taxi => self.standing(
                    aircraft,
                    GroundPlace {
                        // At the ends of the taxiway it stands.
                        past_m: (TAXI_MPS * (self.touchdown_s + after_s - time_s)).clamp(
                            -self.runway.touchdown_past_threshold_m,
                            past_end_m(self.runway),
                        ),
                        right_m: TAXIWAY_M,
                        turned_deg: 180.0,
                    },
                ),
                Role::Parked => self.standing(
                    aircraft,
                    GroundPlace {
                        past_m: -STANDS_M * stand,
                        right_m: APRON_M,
                        turned_deg: 0.0,
                    },
                ),
            };
            all.push(times_s.iter().map(at).collect());
        }
        check(&all, others, &wheels_m, times_s, self.runway)?;
        all.remove(0);
        Ok(all)
    }

    /// Time by which another aircraft is behind.
    fn after_s(&self, other: &OtherAircraft) -> f64 {
        let spacing_m = other.spacing_nm.unwrap_or(0.0) * METERS_PER_NAUTICAL_MILE;
        match (other.after_s, other.role) {
            (Some(after_s), _) => after_s,
            // The one behind is this far from the target when the one ahead touches down.
            (None, Role::Arrival | Role::MissedApproach) => {
                let takes_s = self.touchdown_s - self.time_s_at(spacing_m.abs());
                takes_s * spacing_m.signum()
            }
            (None, Role::Crossing) => {
                let half_s = self.touchdown_s / 2.0;
                half_s - self.time_s_at(self.to_go_m(half_s) + spacing_m)
            }
            (None, Role::Departure | Role::Taxi | Role::Parked) => 0.0,
        }
    }

    /// When the first aircraft is this far from the touchdown target along the course.
    fn time_s_at(&self, to_go_m: f64) -> f64 {
        let (mut early_s, mut late_s) = (self.touchdown_s - 3_600.0, self.touchdown_s);
        while late_s - early_s > 1e-6 {
            let middle_s = (early_s + late_s) / 2.0;
            if self.to_go_m(middle_s) > to_go_m {
                early_s = middle_s;
            } else {
                late_s = middle_s;
            }
        }
        late_s
    }

    fn to_go_m(&self, time_s: f64) -> f64 {
        let position = self.first(time_s).pose.position();
        let target = self.runway.touchdown_target();
        RunwayCoordinates::of(position, target, self.runway.course_true_deg).along_track_m
    }

    /// The first aircraft.
    fn first(&self, time_s: f64) -> Placed {
        let (first, last) = (self.trajectory.first(), self.trajectory.last());
        let at_s = self.start_s + time_s;
        if at_s < first.time_s {
            // It comes straight in, level.
            let back_m = ground_speed_mps(&first) * (first.time_s - at_s);
            let from = first.pose.position();
            let at = from
                .lat_lon()
                .destination(track_deg(&first) + 180.0, back_m)
                .at_altitude_m(from.altitude_msl_m);
            Placed {
                pose: first.pose.moved_to(at),
                ..Placed::of(&first)
            }
        } else if at_s <= last.time_s {
            Placed::of(&self.trajectory.at(at_s))
        } else {
            self.rolled_out(&last, at_s - last.time_s)
        }
    }

    /// The first aircraft, this time after its last state.
    fn rolled_out(&self, last: &FlightState, since_s: f64) -> Placed {
        let speed_mps = ground_speed_mps(last);
        let slowing_s = ((speed_mps - TAXI_MPS) / ALONG_RUNWAY_MPS2).max(0.0);
        let way_m = if since_s < slowing_s {
            speed_mps * since_s - ALONG_RUNWAY_MPS2 / 2.0 * since_s.powi(2)
        } else {
            slowing_m(speed_mps) + TAXI_MPS * (since_s - slowing_s)
        };
        let legs_m = self.roll_out.length_m();
        let taxiway_m = self.roll_out.at(legs_m).past_m + self.runway.touchdown_past_threshold_m;
        let way_m = way_m.min(legs_m + taxiway_m.max(0.0));
        let ground_m = self.wheels_on_ground_msl_m(self.aircraft);
        let sinking_m = last.velocity_down_mps.max(0.0) * since_s;
        let altitude_msl_m = (last.pose.altitude_msl_m - sinking_m).max(ground_m);
        let lowered = (1.0 - since_s / 4.0).max(0.0);
        let rolling = self.standing(self.aircraft, self.roll_out.at(way_m));
        Placed {
            pose: Pose {
                altitude_msl_m,
                pitch_deg: last.pose.pitch_deg * lowered,
                ..rolling.pose
            },
            controls: last.controls,
            on_ground: last.on_ground || altitude_msl_m == ground_m,
        }
    }

    /// The first aircraft's flight with another type, whose wheels follow the same path.
    fn shifted(&self, aircraft: &AircraftType, time_s: f64) -> Placed {
        let mut here = self.first(time_s);
        let [own_m, first_m] = [aircraft, self.aircraft].map(|of| of.wheel_height_below_cg_m());
        here.pose.altitude_msl_m += own_m - first_m;
        here
    }

    /// When the first aircraft's wheels are at the decision height.
    fn decision_s(&self) -> f64 {
        let low_m = self.wheels_on_ground_msl_m(self.aircraft) + DECISION_HEIGHT_M;
        let mut time_s = self.touchdown_s;
        while self.first(time_s).pose.altitude_msl_m < low_m && time_s > 0.0 {
            time_s -= 0.25;
        }
        time_s
    }

    fn missed(&self, aircraft: &AircraftType, decision_s: f64, time_s: f64) -> Placed {
        let since_s = time_s - decision_s;
        if since_s <= 0.0 {
            return self.shifted(aircraft, time_s);
        }
        let here = self.shifted(aircraft, decision_s);
        let state = self.trajectory.at(self.start_s + decision_s);
        let speed_mps = ground_speed_mps(&state);
        let sinks_deg = state.velocity_down_mps.atan2(speed_mps).to_degrees();
        let (climb_deg, climbed_m) = into_climb(speed_mps, -sinks_deg, since_s);
        let at = here.pose.position();
        let at = at
            .lat_lon()
            .destination(track_deg(&state), speed_mps * since_s)
            .at_altitude_m(at.altitude_msl_m + climbed_m);
        Placed {
            pose: Pose {
                pitch_deg: here.pose.pitch_deg + climb_deg + sinks_deg,
                ..here.pose.moved_to(at)
            },
            controls: Controls {
                flap_ratio: here.controls.flap_ratio * (1.0 - 0.5 * ramp(since_s, 3.0, 13.0)),
                gear_ratio: here.controls.gear_ratio * (1.0 - ramp(since_s, 5.0, 12.0)),
            },
            on_ground: false,
        }
    }

    /// A departure, this time after it has lined up, which is also when it begins to roll.
    fn departure(&self, aircraft: &AircraftType, since_s: f64) -> Placed {
        let path = GroundPath {
            start: GroundPlace {
                past_m: LINE_UP_M - self.runway.touchdown_past_threshold_m,
                right_m: TAXIWAY_M,
                turned_deg: 180.0,
            },
            legs: vec![
                Leg::RightTurn(TURN_M),
                Leg::Straight(TAXIWAY_M - 2.0 * TURN_M),
                Leg::RightTurn(TURN_M),
            ],
        };
        let rotation_mps = ROTATION_SPEED * aircraft.approach_speed_mps;
        let rotation_s = (rotation_mps - TAXI_MPS) / ALONG_RUNWAY_MPS2;
        let lift_off_s = rotation_s + ROTATION_S;
        let rolling_s = since_s.clamp(0.0, lift_off_s);
        let flown_s = (since_s - lift_off_s).max(0.0);
        let speed_mps = TAXI_MPS + ALONG_RUNWAY_MPS2 * rolling_s;
        let way_m = path.length_m()
            + TAXI_MPS * since_s.min(lift_off_s)
            + ALONG_RUNWAY_MPS2 / 2.0 * rolling_s.powi(2)
            + speed_mps * flown_s;
        // It comes from the end of the taxiway.
        let way_m = way_m.max(path.start.past_m - past_end_m(self.runway));
        let here = self.standing(aircraft, path.at(way_m));
        let (climb_deg, climbed_m) = into_climb(speed_mps, 0.0, flown_s);
        Placed {
            pose: Pose {
                altitude_msl_m: here.pose.altitude_msl_m + climbed_m,
                pitch_deg: LIFT_OFF_PITCH_DEG * ramp(since_s, rotation_s, lift_off_s) + climb_deg,
                ..here.pose
            },
            controls: Controls {
                flap_ratio: TAKE_OFF_FLAPS * (1.0 - ramp(flown_s, 20.0, 40.0)),
                gear_ratio: 1.0 - ramp(flown_s, 4.0, 11.0),
            },
            on_ground: flown_s == 0.0,
        }
    }

    /// At half of the first aircraft's approach, it is above the place where that one was `after_s` before.
    fn crossing(&self, after_s: f64, time_s: f64) -> Placed {
        let half_s = self.touchdown_s / 2.0;
        let below = self.first(half_s - after_s).pose;
        let course_deg = self.runway.course_true_deg + 90.0;
        let at = below
            .position()
            .lat_lon()
            .destination(course_deg, CROSSING_MPS * (time_s - half_s))
            .at_altitude_m(below.altitude_msl_m + CROSSING_ABOVE_M);
        Placed {
            pose: Pose {
                heading_true_deg: Degrees(course_deg).wrapped_360().0,
                pitch_deg: 2.0,
                roll_deg: 0.0,
                ..below.moved_to(at)
            },
            controls: Controls::default(),
            on_ground: false,
        }
    }

    /// An aircraft on its wheels.
    fn standing(&self, aircraft: &AircraftType, place: GroundPlace) -> Placed {
        let at = self.runway.point_on_approach(-place.past_m, place.right_m);
        let heading_deg = Degrees(self.runway.course_true_deg + place.turned_deg);
        Placed {
            pose: Pose {
                latitude_deg: at.latitude_deg,
                longitude_deg: at.longitude_deg,
                altitude_msl_m: self.wheels_on_ground_msl_m(aircraft),
                heading_true_deg: heading_deg.wrapped_360().0,
                pitch_deg: 0.0,
                roll_deg: 0.0,
            },
            controls: Controls {
                flap_ratio: 0.0,
                gear_ratio: 1.0,
            },
            on_ground: true,
        }
    }

    /// Height of a type's centre of gravity while its wheels are on the runway.
    fn wheels_on_ground_msl_m(&self, aircraft: &AircraftType) -> f64 {
        self.runway.threshold.altitude_msl_m + aircraft.wheel_height_below_cg_m()
    }
}

/// Angle of climb, degrees, and height gained, metres, this time after an aircraft with an angle of `from_deg` begins to climb. The angle
/// changes evenly; it is small enough for its sine.
fn into_climb(speed_mps: f64, from_deg: f64, since_s: f64) -> (f64, f64) {
    let turning_s = since_s.min(INTO_CLIMB_S);
    let angle_deg = from_deg + (CLIMB_DEG - from_deg) * turning_s / INTO_CLIMB_S;
    let while_turning = (from_deg + angle_deg) / 2.0 * turning_s;
    let steady = CLIMB_DEG * (since_s - turning_s);
    (angle_deg, speed_mps * (while_turning + steady).to_radians())
}

/// Way along the runway until the taxiing speed is reached, metres.
fn slowing_m(speed_mps: f64) -> f64 {
    ((speed_mps.powi(2) - TAXI_MPS.powi(2)) / (2.0 * ALONG_RUNWAY_MPS2)).max(0.0)
}

/// 0 before `from`, 1 after `to`, even between.
fn ramp(time_s: f64, from_s: f64, to_s: f64) -> f64 {
    ((time_s - from_s) / (to_s - from_s)).clamp(0.0, 1.0)
}

fn ground_speed_mps(state: &FlightState) -> f64 {
    state.velocity_north_mps.hypot(state.velocity_east_mps)
}

/// Direction of the velocity over ground, degrees true.
fn track_deg(state: &FlightState) -> f64 {
    let track_rad = state.velocity_east_mps.atan2(state.velocity_north_mps);
    track_rad.to_degrees()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::airports;
    use crate::trajectory::straight_in::{SPEED_MPS, straight_in};

    /// Distance to go at the start, metres; the flight takes 125 s.
    const FROM_M: f64 = 9_000.0;
    const TOUCHDOWN_S: f64 = FROM_M / SPEED_MPS;

    fn runway() -> Runway {
        airports::bundled("WSSS", "02L").unwrap()
    }

    fn other(role: Role, after_s: f64) -> OtherAircraft {
        OtherAircraft {
            aircraft_number: 1,
            aircraft: "A350-900".into(),
            role,
            after_s: (role != Role::Parked).then_some(after_s),
            spacing_nm: None,
        }
    }

    /// Flies one aircraft beside a straight approach, five times a second.
    fn flown(other: OtherAircraft) -> Result<Vec<(f64, Placed)>, TrafficFault> {
        let (runway, first) = (runway(), AircraftType::boeing_737_800());
        let trajectory = straight_in(first, FROM_M, &runway).unwrap();
        let window = trajectory.approach(&runway, FROM_M).unwrap();
        let approach = Approach::new(&trajectory, window, &runway, first)?;
        let times_s = times_s();
        let flown = approach.fly(&[other], &times_s)?;
        Ok(times_s.into_iter().zip(flown[0].iter().copied()).collect())
    }

    fn times_s() -> Vec<f64> {
        (0..=650).map(|i| f64::from(i) * 0.2).collect()
    }

    fn at(path: &[(f64, Placed)], time_s: f64) -> Placed {
        path[(time_s / 0.2).round() as usize].1
    }

    fn place(of: &Placed) -> RunwayCoordinates {
        let runway = runway();
        let target = runway.touchdown_target();
        RunwayCoordinates::of(of.pose.position(), target, runway.course_true_deg)
    }

    #[test]
    fn no_role_jumps_and_wheels_are_never_below_the_ground() {
        let wheels_m = AircraftType::named("A359")
            .unwrap()
            .wheel_height_below_cg_m();
        for (role, after_s) in [
            (Role::Arrival, 90.0),
            (Role::Arrival, -60.0),
            (Role::MissedApproach, -60.0),
            (Role::Departure, -70.0),
            (Role::Crossing, 20.0),
            (Role::Taxi, -20.0),
            (Role::Parked, 0.0),
        ] {
            let path = flown(other(role, after_s)).unwrap();
            for pair in path.windows(2) {
                let [(_, a), (time_s, b)] = pair else {
                    continue;
                };
                let [from, to] = [a, b].map(|at| at.pose.position().to_ecef());
                let way_m = from.distance(to);
                assert!(way_m < 0.2 * 110.0, "{role:?} at {time_s}: {way_m} m");
                let turned = b.pose.heading_true_deg - a.pose.heading_true_deg;
                let turned_deg = Degrees(turned).wrapped_180().0.abs();
                assert!(turned_deg < 3.0, "{role:?} at {time_s}: {turned_deg}");
                assert!((b.pose.pitch_deg - a.pose.pitch_deg).abs() < 4.0);
                let height_m = place(b).height_over_target_m - wheels_m;
                assert!(height_m > -1.0, "{role:?} at {time_s}: {height_m}");
            }
        }
    }

    #[test]
    fn an_arrival_is_where_the_first_one_was_and_clears_the_runway_after_its_landing() {
        let path = flown(other(Role::Arrival, 90.0)).unwrap();
        let to_go_m = |time_s: f64| place(&at(&path, time_s)).along_track_m;
        assert!((to_go_m(100.0) - (FROM_M - 10.0 * SPEED_MPS)).abs() < 0.1);
        // Before the first one's start, it comes straight in.
        assert!((to_go_m(0.0) - (FROM_M + 90.0 * SPEED_MPS)).abs() < 5.0);

        let path = flown(other(Role::Arrival, -80.0)).unwrap();
        let end = at(&path, 130.0);
        let off_m = place(&end).cross_track_m - TAXIWAY_M;
        assert!(end.on_ground && off_m.abs() < 1.0, "{off_m}");
    }

    #[test]
    fn a_spacing_is_the_distance_to_go_when_the_one_ahead_touches_down() {
        let spaced = OtherAircraft {
            after_s: None,
            spacing_nm: Some(2.0),
            ..other(Role::Arrival, 0.0)
        };
        let path = flown(spaced).unwrap();
        let to_go_m = place(&at(&path, TOUCHDOWN_S)).along_track_m;
        assert!((to_go_m - 3_704.0).abs() < 1.0, "{to_go_m}");
    }

    #[test]
    fn a_missed_approach_does_not_land_and_a_departure_and_a_crossing_fly_as_stated() {
        let path = flown(other(Role::MissedApproach, -60.0)).unwrap();
        let lowest_m = path
            .iter()
            .map(|(_, at)| place(at).height_over_target_m)
            .fold(f64::INFINITY, f64::min);
        assert!((55.0..70.0).contains(&lowest_m), "{lowest_m}");
        let end = at(&path, 130.0);
        assert!(place(&end).height_over_target_m > 200.0 && end.controls.gear_ratio == 0.0);

        let path = flown(other(Role::Departure, -70.0)).unwrap();
        let lined_up = at(&path, TOUCHDOWN_S - 70.0);
        assert!(place(&lined_up).cross_track_m.abs() < 0.1 && lined_up.on_ground);
        let end = at(&path, 130.0);
        assert!(!end.on_ground && place(&end).height_over_target_m > 100.0);

        let path = flown(other(Role::Crossing, 20.0)).unwrap();
        let there = at(&path, TOUCHDOWN_S / 2.0);
        let first_there_m = FROM_M - (TOUCHDOWN_S / 2.0 - 20.0) * SPEED_MPS;
        assert!((place(&there).along_track_m - first_there_m).abs() < 1.0);
        let wheels_m = AircraftType::boeing_737_800().wheel_height_below_cg_m();
        let below_m = wheels_m + first_there_m * 3.0_f64.to_radians().tan();
        let above_m = place(&there).height_over_target_m - below_m;
        assert!((above_m - CROSSING_ABOVE_M).abs() < 0.5, "{above_m}");
    }

    #[test]
    fn aircraft_on_the_ground_stay_between_the_ends_of_the_taxiway() {
        let runway = runway();
        let ends_m = -past_end_m(&runway) - 1.0..runway.touchdown_past_threshold_m + 1.0;
        for (role, after_s) in [
            (Role::Taxi, 700.0),
            (Role::Taxi, -800.0),
            (Role::Departure, 700.0),
            (Role::Arrival, -900.0),
        ] {
            let path = flown(other(role, after_s)).unwrap();
            for (time_s, placed) in &path {
                let at = place(placed);
                assert!(
                    ends_m.contains(&at.along_track_m),
                    "{role:?}, {time_s}: {at:?}"
                );
                assert!((at.cross_track_m - TAXIWAY_M).abs() < 1.0, "{role:?}");
            }
        }
    }

    #[test]
    fn a_first_aircraft_that_ends_in_the_air_is_no_place_for_others() {
        let (runway, first) = (runway(), AircraftType::boeing_737_800());
        let landing = straight_in(first, FROM_M, &runway).unwrap();
        let states = |to_s: f64, up_mps: f64| {
            let of = (0..=131).map(|second| landing.at(f64::from(second)));
            let mut states: Vec<_> = of.take_while(|state| state.time_s <= to_s).collect();
            for state in &mut states {
                let since_s = (state.time_s - 100.0).max(0.0);
                state.pose.altitude_msl_m += up_mps * since_s;
                state.velocity_down_mps -= if since_s > 0.0 { up_mps } else { 0.0 };
            }
            Trajectory::new(states).unwrap()
        };
        // One is recorded down to some height, one goes around.
        for (flight, words) in [
            (states(110.0, 0.0), "1152 m before the touchdown target"),
            (states(131.0, 8.0), "248 m above the runway"),
        ] {
            let window = flight.approach(&runway, FROM_M).unwrap();
            let fault = Approach::new(&flight, window, &runway, first).unwrap_err();
            assert!(fault.to_string().contains(words), "{fault}");
        }
    }

    #[test]
    fn aircraft_that_would_collide_meet_on_the_runway_or_sink_are_refused() {
        let refused = |role, after_s| flown(other(role, after_s)).unwrap_err().to_string();
        let near = refused(Role::Arrival, 1.0);
        for words in [
            "aircraft 0 (the first) and aircraft 1 (arrival, A350-900)",
            "expected at least 150 m in the air and 75 m on the ground",
        ] {
            assert!(near.contains(words), "{near}");
        }
        // It rolls while the first one rolls, or lifts off while that one flares.
        for after_s in [-25.0, -38.0] {
            let runway = refused(Role::Departure, after_s);
            assert!(runway.contains("both on the runway"), "{runway}");
        }
        assert!(flown(other(Role::Departure, -50.0)).is_ok());
        let beyond = refused(Role::Crossing, -TOUCHDOWN_S / 2.0);
        assert!(
            beyond.contains("(crossing, A350-900) crosses beyond the touchdown target"),
            "{beyond}"
        );

        let mut below = flown(other(Role::Parked, 0.0)).unwrap();
        below[3].1.pose.altitude_msl_m -= 20.0;
        let first = flown(other(Role::Taxi, -20.0)).unwrap();
        let [places, first] = [below, first].map(|path| {
            let places = path.into_iter().map(|(_, placed)| placed);
            places.collect::<Vec<_>>()
        });
        let others = [other(Role::Parked, 0.0)];
        let fault = check(
            &[first, places],
            &others,
            &[3.0, 3.0],
            &times_s(),
            &self::runway(),
        );
        let fault = fault.unwrap_err().to_string();
        assert!(
            fault.starts_with("1 s after") && fault.contains("m below the runway"),
            "{fault}"
        );
    }
}
