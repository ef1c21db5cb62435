//! A flight as states in time, and its states at ticks.
//!
//! [`dataset::geometry::flight`] interpolates between two states.

use dataset::geometry::flight::state_at;
use dataset::geometry::geodesy::Geodetic;
use dataset::geometry::pose::FlightState;
use dataset::geometry::runway::{Runway, RunwayCoordinates};
use dataset::numbers::frame_rate::FrameRate;
use dataset::numbers::limits::{Check, FieldOutOfLimits, MAX_APPROACH_S};

pub(crate) use inbound::{Approaches, Inbound, last_approach};
pub use separation::TrafficFault;
pub(crate) use straight_in::straight_in;
pub(crate) use traffic::{Approach, Placed};

mod ground_path;
mod inbound;
mod separation;
mod straight_in;
mod traffic;

/// States may be this far apart, seconds: over longer gaps an aircraft turns too much for a cubic.
pub(crate) const MAX_GAP_S: f64 = 2.0;
/// Maximum deviation of positions from the velocities on both sides, metres, plus a tenth of the displacement.
const VELOCITY_TOLERANCE_M: f64 = 1.0;

/// A flight that can be replayed.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    states: Vec<FlightState>,
}

/// Reasons why states do not form a trajectory, or a trajectory is not an approach. The text continues "the flight" or a file name.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BadFlight {
    /// There are too few states to interpolate.
    #[error("has {states} states, expected at least 2")]
    TooFewStates {
        /// Number of states.
        states: usize,
    },
    /// A number that no airliner has.
    #[error("has state {row} with {fault}")]
    OutOfLimits {
        /// Index of the state, from 0.
        row: usize,
        /// Field, value and range.
        fault: FieldOutOfLimits,
    },
    /// Time stands still, runs backwards or jumps.
    #[error(
        "has state {row} {step_s} s after the one before it, expected more than 0 and at most {MAX_GAP_S}"
    )]
    Gap {
        /// Index of the state, from 0.
        row: usize,
        /// Time since the one before.
        step_s: f64,
    },
    /// A position that the velocities do not lead to.
    #[error(
        "has state {row} (at {time_s:.3} s) {off_m:.2} m from where the velocities put it, expected at most {allowed_m:.2} m: \
         {way_m:.2} m from the state {step_s:.3} s before it, where the velocities of both make {expected_m:.2} m. Are velocities in m/s \
         over ground, and is each time that of its position?"
    )]
    Jump {
        /// Index of the state, from 0.
        row: usize,
        /// Time of the state.
        time_s: f64,
        /// Distance from the expected position.
        off_m: f64,
        /// Largest allowed deviation.
        allowed_m: f64,
        /// Time since the state before.
        step_s: f64,
        /// Distance from the state before.
        way_m: f64,
        /// Distance by the velocities.
        expected_m: f64,
    },
    /// It leads elsewhere.
    #[error(
        "is never between {start_dtd_m:.0} m and 0 m before the touchdown target of {runway}: its first state is {first_m:.0} m before it, \
         its last {last_m:.0} m"
    )]
    Elsewhere {
        /// Required start distance.
        start_dtd_m: f64,
        /// Airport and runway.
        runway: String,
        /// Remaining distance of the first state.
        first_m: f64,
        /// Remaining distance of the last state.
        last_m: f64,
    },
    /// An approach of hours.
    #[error(
        "takes {takes_s:.0} s from {start_dtd_m:.0} m to the touchdown target; expected at most {MAX_APPROACH_S} s"
    )]
    TooLong {
        /// Duration of the approach.
        takes_s: f64,
        /// Start distance.
        start_dtd_m: f64,
    },
}

impl BadFlight {
    /// Index of the state at fault, if it is one.
    pub(crate) fn state(&self) -> Option<usize> {
        match self {
            Self::OutOfLimits { row, .. } | Self::Gap { row, .. } | Self::Jump { row, .. } => {
                Some(*row)
            }
            Self::TooFewStates { .. } | Self::Elsewhere { .. } | Self::TooLong { .. } => None,
        }
    }
}

/// Part of a trajectory to show.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window {
    /// Time of tick 0 in the trajectory, seconds.
    pub start_s: f64,
    /// When the touchdown target is passed, if it is, seconds.
    pub passing_s: Option<f64>,
    /// The last state, seconds: no tick is later.
    pub last_s: f64,
}

impl Window {
    /// Number of ticks up to the first one at or past the target, or to the last state if the target is not reached before. That
    /// one tick past the target determines the time of touchdown.
    pub fn ticks(&self, rate: FrameRate) -> u32 {
        let periods_until = |time_s: f64| {
            ((time_s - self.start_s) * f64::from(rate.numerator) / f64::from(rate.denominator))
                .max(0.0)
        };
        let in_record = periods_until(self.last_s).floor();
        let wanted = self
            .passing_s
            .map_or(in_record, |passing_s| periods_until(passing_s).ceil());
        wanted.min(in_record) as u32 + 1
    }
}

impl Trajectory {
    /// A trajectory from states in order of time.
    pub fn new(states: Vec<FlightState>) -> Result<Self, BadFlight> {
        if states.len() < 2 {
            return Err(BadFlight::TooFewStates {
                states: states.len(),
            });
        }
        for (row, state) in states.iter().enumerate() {
            let mut check = Check::default();
            state.check(&mut check);
            if let Some(fault) = check.first() {
                return Err(BadFlight::OutOfLimits { row, fault });
            }
        }
        for (row, pair) in states.windows(2).enumerate() {
            let [before, after] = pair else { continue };
            let step_s = after.time_s - before.time_s;
            if !(step_s > 0.0 && step_s <= MAX_GAP_S) {
                return Err(BadFlight::Gap {
                    row: row + 1,
                    step_s,
                });
            }
            let way = after.position_ecef() - before.position_ecef();
            let expected = (before.velocity_ecef() + after.velocity_ecef()) * (step_s / 2.0);
            let off_m = way.distance(expected);
            let allowed_m = VELOCITY_TOLERANCE_M + 0.1 * expected.length();
            if off_m > allowed_m {
                return Err(BadFlight::Jump {
                    row: row + 1,
                    time_s: after.time_s,
                    off_m,
                    allowed_m,
                    step_s,
                    way_m: way.length(),
                    expected_m: expected.length(),
                });
            }
        }
        Ok(Self { states })
    }

    /// The first state.
    pub(crate) fn first(&self) -> FlightState {
        self.states[0]
    }

    /// The last state.
    pub(crate) fn last(&self) -> FlightState {
        self.states[self.states.len() - 1]
    }

    /// The state at a time, seconds; before the first and after the last state that state is held.
    pub fn at(&self, time_s: f64) -> FlightState {
        state_at(&self.states, time_s)
            .unwrap_or_else(|| unreachable!("a trajectory has at least two states"))
    }

    /// The last approach of the flight: from `start_dtd_m` metres to go along the course (or from the furthest position, if it never is as
    /// far) until the touchdown target is passed (or the last state, if that is earlier).
    pub fn approach(&self, runway: &Runway, start_dtd_m: f64) -> Result<Window, BadFlight> {
        self.along_course(runway).approach(start_dtd_m)
    }

    pub(crate) fn along_course<'a>(&'a self, runway: &'a Runway) -> AlongCourse<'a> {
        let mut seen = AlongCourse {
            trajectory: self,
            runway,
            target: runway.touchdown_target(),
            to_go_m: Vec::new(),
        };
        let times = self.states.iter().map(|state| state.time_s);
        seen.to_go_m = times.map(|time_s| seen.to_go_m_at(time_s)).collect();
        seen
    }

    /// States at all ticks in the window; times count from tick 0.
    pub fn resample(&self, window: Window, rate: FrameRate) -> Vec<FlightState> {
        (0..window.ticks(rate))
            .map(|tick| {
                let since_start_s = rate.time_of_tick(tick).seconds();
                FlightState {
                    time_s: since_start_s,
                    ..self.at(window.start_s + since_start_s)
                }
            })
            .collect()
    }

    /// Point where the wheels first touched the ground after having been in the air, if they did.
    pub fn touchdown(&self) -> Option<Geodetic> {
        let landed = self
            .states
            .windows(2)
            .find(|pair| !pair[0].on_ground && pair[1].on_ground)?;
        Some(landed[1].pose.position())
    }
}

/// A trajectory with the remaining distance at each state: geodesics are expensive, and thousands of scenarios may fly one recording from
/// slightly different distances.
#[derive(Debug, Clone)]
pub struct AlongCourse<'a> {
    trajectory: &'a Trajectory,
    runway: &'a Runway,
    target: Geodetic,
    /// For each state, metres along the course to the touchdown target.
    to_go_m: Vec<f64>,
}

impl AlongCourse<'_> {
    /// See [`Trajectory::approach`].
    pub fn approach(&self, start_dtd_m: f64) -> Result<Window, BadFlight> {
        let last_index = self.to_go_m.len() - 1;
        let last = self.time_of(last_index);
        let states = &self.trajectory.states;
        let inbound = last_approach(&self.to_go_m, |index| !states[index].on_ground, start_dtd_m);
        let start_s = inbound.map(|inbound| self.crossing_at(inbound.first, start_dtd_m));
        let (Some(inbound), Some(start_s)) = (inbound, start_s.filter(|start_s| *start_s < last))
        else {
            let runway = self.runway;
            return Err(BadFlight::Elsewhere {
                start_dtd_m,
                runway: format!("{} {}", runway.airport, runway.name),
                first_m: self.to_go_m[0],
                last_m: self.to_go_m[last_index],
            });
        };
        let passing_s = inbound.passing.map(|index| self.crossing_at(index, 0.0));
        let takes_s = passing_s.unwrap_or(last) - start_s;
        if takes_s > MAX_APPROACH_S {
            return Err(BadFlight::TooLong {
                takes_s,
                start_dtd_m,
            });
        }
        Ok(Window {
            start_s,
            passing_s,
            last_s: last,
        })
    }

    fn time_of(&self, index: usize) -> f64 {
        self.trajectory.states[index].time_s
    }

    fn to_go_m_at(&self, time_s: f64) -> f64 {
        let position = self.trajectory.at(time_s).pose.position();
        RunwayCoordinates::of(position, self.target, self.runway.course_true_deg).along_track_m
    }

    /// The time when `level_m` metres remain, between the state before `index` and this one; the state's own time if not even the state
    /// before is further away.
    fn crossing_at(&self, index: usize, level_m: f64) -> f64 {
        let mut high = self.time_of(index);
        if index == 0 || self.to_go_m[index - 1] <= level_m {
            return high;
        }
        let mut low = self.time_of(index - 1);
        while high - low > 1e-9 {
            let middle = (low + high) / 2.0;
            if middle <= low || middle >= high {
                break;
            }
            if self.to_go_m_at(middle) <= level_m {
                high = middle;
            } else {
                low = middle;
            }
        }
        high
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use dataset::geometry::pose::{Controls, Pose};
    use dataset::numbers::units::Degrees;

    use super::*;
    use crate::airports;

    const SPEED_MPS: f64 = 75.0;

    fn runway() -> Runway {
        airports::bundled("WSSS", "02L").unwrap()
    }

    /// A flight along the course with a gentle weave, known exactly at every moment: from `from_m` before the target, landing at 0.
    fn exact(time_s: f64, from_m: f64) -> FlightState {
        let runway = runway();
        let place = |t: f64| {
            let along = from_m - SPEED_MPS * t;
            let height = 6.71 + along.max(0.0) * 3.0_f64.to_radians().tan();
            runway
                .point_on_approach(along, 30.0 * (t / 9.0).sin())
                .at_altitude_m(height)
        };
        let here = place(time_s);
        let step = 1e-3;
        let velocity_ecef =
            (place(time_s + step).to_ecef() - place(time_s - step).to_ecef()) / (2.0 * step);
        let ned = here.ecef_from_ned().transpose() * velocity_ecef;
        FlightState {
            time_s,
            pose: Pose {
                latitude_deg: here.latitude_deg,
                longitude_deg: here.longitude_deg,
                altitude_msl_m: here.altitude_msl_m,
                heading_true_deg: Degrees(357.0 + time_s).wrapped_360().0,
                pitch_deg: 2.0 + 0.1 * time_s,
                roll_deg: (time_s / 9.0).sin(),
            },
            velocity_north_mps: ned.x,
            velocity_east_mps: ned.y,
            velocity_down_mps: ned.z,
            true_airspeed_mps: SPEED_MPS,
            controls: Controls {
                flap_ratio: 0.5,
                gear_ratio: 1.0,
            },
            on_ground: time_s > from_m / SPEED_MPS,
        }
    }

    /// The flight of [`exact`], sampled at `rate_hz` until five seconds after the target.
    pub(crate) fn flight(from_m: f64, rate_hz: f64) -> Trajectory {
        let count = ((from_m / SPEED_MPS + 5.0) * rate_hz) as u32;
        Trajectory::new(
            (0..count)
                .map(|i| exact(f64::from(i) / rate_hz, from_m))
                .collect(),
        )
        .unwrap()
    }

    #[test]
    fn between_states_of_a_slow_recording_positions_are_right_to_a_millimetre_and_speeds_too() {
        let slow = flight(2_000.0, 5.0);
        for i in 1..100 {
            let time_s = 0.137 * f64::from(i);
            let (found, truth) = (slow.at(time_s), exact(time_s, 2_000.0));
            let off_m = found.position_ecef().distance(truth.position_ecef());
            assert!(off_m < 1e-3, "{off_m} m at {time_s} s");
            assert!(
                found.velocity_ecef().distance(truth.velocity_ecef()) < 0.02,
                "at {time_s} s"
            );
        }
    }

    #[test]
    fn headings_are_interpolated_through_north() {
        let found = flight(2_000.0, 1.0).at(2.5);
        let off_deg = Degrees(found.pose.heading_true_deg - 359.5).wrapped_180().0;
        assert!(off_deg.abs() < 1e-9, "{}", found.pose.heading_true_deg);
    }

    #[test]
    fn the_window_reaches_from_the_asked_distance_to_the_first_tick_past_the_target() {
        let flown = flight(3_000.0, 10.0);
        let window = flown.approach(&runway(), 2_230.0).unwrap();
        // 770 m at 75 m/s. The weave shifts places along the course by far less than a metre.
        assert!(
            (window.start_s - 770.0 / SPEED_MPS).abs() < 0.01,
            "{window:?}"
        );
        assert!(
            (window.passing_s.unwrap() - 40.0).abs() < 0.01,
            "{window:?}"
        );
        let states = flown.resample(window, FrameRate::new(1, 1).unwrap());
        assert_eq!(states.len(), 31);
        assert_eq!(states[30].time_s, 30.0);
        let target = runway().touchdown_target();
        let along =
            |s: &FlightState| RunwayCoordinates::of(s.pose.position(), target, 23.02).along_track_m;
        assert!((along(&states[0]) - 2_230.0).abs() < 0.01);
        assert!(along(&states[29]) > 0.0);
        assert!(along(&states[30]) <= 0.0 && along(&states[30]) > -SPEED_MPS);
    }

    #[test]
    fn a_recording_that_starts_late_or_ends_early_is_used_as_far_as_it_goes() {
        let whole = flight(3_000.0, 10.0);
        let short = Trajectory::new(whole.states[..200].to_vec()).unwrap();
        let window = short.approach(&runway(), 18_520.0).unwrap();
        assert_eq!(
            window,
            Window {
                start_s: 0.0,
                passing_s: None,
                last_s: 19.9
            }
        );
        assert_eq!(window.ticks(FrameRate::new(1, 1).unwrap()), 20);
        assert_eq!(short.touchdown(), None);
        assert!(whole.touchdown().is_some());
    }

    #[test]
    fn a_flight_that_never_comes_near_is_refused() {
        let mut gone: Vec<FlightState> = flight(1_000.0, 10.0).states;
        gone.retain(|state| state.time_s > 14.0);
        let message = Trajectory::new(gone)
            .unwrap()
            .approach(&runway(), 18_520.0)
            .unwrap_err()
            .to_string();
        assert!(message.contains("WSSS 02L"), "{message}");
    }

    #[test]
    fn broken_states_are_refused_with_their_number() {
        let good = flight(1_000.0, 10.0).states;
        let broken = |change: &dyn Fn(&mut Vec<FlightState>)| {
            let mut states = good.clone();
            change(&mut states);
            Trajectory::new(states).unwrap_err().to_string()
        };
        assert!(broken(&|s| s[5].pose.pitch_deg = f64::NAN).contains("state 5"));
        assert!(broken(&|s| s.swap(3, 4)).contains("state 4"));
        assert!(broken(&|s| s[7].pose.latitude_deg += 0.001).contains("state 7"));
        let hitch = broken(&|s| {
            for state in &mut s[50..] {
                state.time_s -= 0.08;
            }
        });
        // 7.5 m in a stated 0.02 s, where 75 m/s make 1.5 m.
        for part in [
            "has state 50 (at 4.920 s) 6.0",
            "at most 1.15 m",
            "7.5",
            "1.50 m",
        ] {
            assert!(hitch.contains(part), "{part}: {hitch}");
        }
        assert!(broken(&|s| s.truncate(1)).contains("at least 2"));
        assert!(
            broken(&|s| {
                s.drain(10..40);
            })
            .contains("state 10")
        );
    }

    #[test]
    fn ticks_are_counted_with_both_ends() {
        let rate = |numerator, denominator| FrameRate::new(numerator, denominator).unwrap();
        let window = Window {
            start_s: 4.0,
            passing_s: Some(14.0),
            last_s: 15.0,
        };
        assert_eq!(window.ticks(rate(1, 1)), 11);
        assert_eq!(window.ticks(rate(30, 1)), 301);
        // Ticks at 0, 3, 6 and 9 s: the next one, past the target, would also be past the recording.
        assert_eq!(window.ticks(rate(1, 3)), 4);
        assert_eq!(
            Window {
                last_s: 16.0,
                ..window
            }
            .ticks(rate(1, 3)),
            5
        );
    }
}
