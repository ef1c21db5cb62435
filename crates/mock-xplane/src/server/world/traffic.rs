//! Other aircraft while the simulator is frozen: the paths that a client sent.

use airframe::AircraftType;
use dataset::corpus::scenario::MAX_TRAFFIC;
use dataset::geometry::pose::{Controls, Pose};
use dataset::numbers::limits::MAX_TICKS;
use dataset::numbers::units::Degrees;
use xplane_bridge::link::{TrafficPart, TrafficState};

use crate::server::engine::OtherAircraft;

/// Maximum number of other aircraft that are drawn.
pub(in crate::server) const MAX_DRAWN: u32 = MAX_TRAFFIC as u32;

/// The other aircraft, by number.
#[derive(Debug, Default)]
pub(in crate::server) struct Traffic(Vec<Path>);

#[derive(Debug)]
struct Path {
    aircraft: &'static AircraftType,
    states: Vec<TrafficState>,
}

impl Traffic {
    /// Removes all of them.
    pub(in crate::server) fn clear(&mut self) {
        self.0.clear();
    }

    /// Adds a part of a path; an error is the reason why that is impossible.
    pub(in crate::server) fn add(&mut self, part: TrafficPart) -> Result<(), String> {
        let TrafficPart {
            number,
            aircraft,
            states,
        } = part;
        let aircraft = AircraftType::named(&aircraft).map_err(|unknown| unknown.to_string())?;
        let known = self.0.len() as u32;
        let most = (known + 1).min(MAX_DRAWN);
        if !(1..=most).contains(&number) {
            return Err(format!("number is {number}, expected 1 to {most}"));
        }
        let before = self.0.get(number as usize - 1);
        let rows = before.map_or(0, |path| path.states.len()) + states.len();
        if rows > MAX_TICKS as usize {
            return Err(format!(
                "aircraft {number} has {rows} states, expected at most {MAX_TICKS}"
            ));
        }
        if let Some(before) = before.filter(|before| before.aircraft != aircraft) {
            return Err(format!(
                "aircraft {number} is {} now, expected {} as before",
                aircraft.name, before.aircraft.name
            ));
        }
        let last = before.and_then(|path| path.states.last());
        let last_ns = last.map_or(-1, |state| state.time_ns);
        let times_ns = states.iter().map(|state| state.time_ns);
        if !std::iter::once(last_ns)
            .chain(times_ns)
            .is_sorted_by(|a, b| a < b)
        {
            return Err(format!(
                "the states of aircraft {number} are not in order of time, or before 0"
            ));
        }
        match self.0.get_mut(number as usize - 1) {
            Some(path) => path.states.extend(states),
            None => self.0.push(Path { aircraft, states }),
        }
        Ok(())
    }

    /// All of them at a time; before its first state an aircraft is not there, and after its last it stays.
    pub(in crate::server) fn at(&self, time_ns: i64) -> Vec<OtherAircraft> {
        let here = |path: &Path| {
            let (pose, controls) = path.at(time_ns)?;
            Some(OtherAircraft {
                aircraft: path.aircraft,
                pose,
                controls,
            })
        };
        self.0.iter().filter_map(here).collect()
    }
}

impl Path {
    fn at(&self, time_ns: i64) -> Option<(Pose, Controls)> {
        let after = self
            .states
            .partition_point(|state| state.time_ns <= time_ns);
        let from = self.states[..after].last()?;
        let Some(to) = self.states.get(after) else {
            return Some((from.pose, from.controls));
        };
        let part = (time_ns - from.time_ns) as f64 / (to.time_ns - from.time_ns) as f64;
        let mix = |a: f64, b: f64| a + (b - a) * part;
        let turn = |a: f64, b: f64| a + Degrees(b - a).wrapped_180().0 * part;
        let (a, b) = (&from.pose, &to.pose);
        let pose = Pose {
            latitude_deg: mix(a.latitude_deg, b.latitude_deg),
            longitude_deg: mix(a.longitude_deg, b.longitude_deg),
            altitude_msl_m: mix(a.altitude_msl_m, b.altitude_msl_m),
            heading_true_deg: turn(a.heading_true_deg, b.heading_true_deg),
            pitch_deg: mix(a.pitch_deg, b.pitch_deg),
            roll_deg: mix(a.roll_deg, b.roll_deg),
        };
        Some((pose, from.controls))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn part(number: u32, aircraft: &str, times_s: &[i64]) -> TrafficPart {
        let state = |time_s: &i64| TrafficState {
            time_ns: time_s * 1_000_000_000,
            pose: Pose {
                latitude_deg: 1.0 + 0.001 * *time_s as f64,
                longitude_deg: 104.0,
                altitude_msl_m: 10.0,
                heading_true_deg: (358.0 + *time_s as f64).rem_euclid(360.0),
                pitch_deg: 0.0,
                roll_deg: 0.0,
            },
            controls: Controls::default(),
        };
        TrafficPart {
            number,
            aircraft: aircraft.into(),
            states: times_s.iter().map(state).collect(),
        }
    }

    #[test]
    fn an_aircraft_is_exactly_at_its_states_and_between_them_on_the_way() {
        let mut traffic = Traffic::default();
        traffic.add(part(1, "A320neo", &[0, 2])).unwrap();
        traffic.add(part(1, "A320neo", &[4])).unwrap();
        traffic.add(part(2, "A359", &[3])).unwrap();
        assert!(traffic.at(-1).is_empty());
        let sent = part(1, "A320neo", &[2]).states[0].pose;
        let seen = traffic.at(2_000_000_000);
        assert_eq!((seen.len(), seen[0].pose), (1, sent));
        assert_eq!(seen[0].aircraft.name, "A320neo");
        let between = traffic.at(3_000_000_000);
        assert_eq!(between.len(), 2);
        assert!((between[0].pose.latitude_deg - 1.003).abs() < 1e-12);
        assert!((between[0].pose.heading_true_deg - 1.0).abs() < 1e-9);
        traffic.clear();
        assert!(traffic.at(2_000_000_000).is_empty());
    }

    #[test]
    fn a_path_that_cannot_be_drawn_is_refused_with_its_reason() {
        let mut traffic = Traffic::default();
        traffic.add(part(1, "A320neo", &[0, 2])).unwrap();
        for (wrong, words) in [
            (part(3, "A320neo", &[0]), "number is 3, expected 1 to 2"),
            (part(1, "A359", &[4]), "is A350-900 now, expected A320neo"),
            (part(1, "A320neo", &[2]), "not in order of time"),
            (part(1, "A32", &[4]), "the nearest is A320neo"),
        ] {
            let message = traffic.add(wrong).unwrap_err();
            assert!(message.contains(words), "{message}");
        }
        for number in 2..=MAX_DRAWN {
            traffic.add(part(number, "A320neo", &[0])).unwrap();
        }
        let message = traffic.add(part(MAX_DRAWN + 1, "A320neo", &[0]));
        assert!(message.unwrap_err().contains("expected 1 to 7"));
    }
}
