//! `[[traffic]]`: other aircraft in the scenarios.

use std::collections::HashSet;

use dataset::corpus::scenario::{MAX_TRAFFIC, OtherAircraft, Role};
use dataset::numbers::limits;
use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;
use schemars::JsonSchema;
use serde::Deserialize;

use super::Sweep;
use super::aircraft::{AircraftTypes, TypeName};
use super::check::fault::{Checked, fault};
use super::check::limits::in_schema;
use super::grid::times::LocalDay;
use super::grid::{Combination, Selection};
use crate::seed;
use crate::spread::Spread;
use crate::trajectory::{Approach, TrafficFault, straight_in};

/// Step with which a sweep is checked on a straight approach, seconds. Every flight is checked again, at all its ticks, as it is flown.
const STEP_S: f64 = 1.0;

/// `[[traffic]]`: an aircraft in each scenario that matches every given list; without `times`, `weathers` and `repeats` in all scenarios.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Traffic")]
pub(super) struct TrafficTable {
    /// What the aircraft does.
    role: Role,
    /// Aircraft type by name or ICAO designator; by default drawn from `approach.aircraft`.
    #[serde(rename = "type")]
    aircraft: Option<TypeName>,
    /// Time by which it is behind the first aircraft, seconds; negative ahead. An arrival or missed approach flies the same path that much
    /// later; a departure begins to roll, and a taxiing aircraft passes the touchdown target, that long after the first aircraft's
    /// touchdown; a crossing one is, at half of the approach, over the place where the first aircraft was that long before.
    #[schemars(transform = in_schema(limits::TRAFFIC_AFTER_S))]
    after_s: Option<Spread>,
    /// The same as a distance, nautical miles, for arrivals and missed approaches (from the touchdown target when the one ahead touches
    /// down) and crossing aircraft (along the course). Either this or `after_s`.
    #[schemars(transform = in_schema(limits::TRAFFIC_SPACING_NM))]
    spacing_nm: Option<Spread>,
    /// Times of matching scenarios.
    #[serde(default)]
    times: Vec<String>,
    /// Weathers of matching scenarios.
    #[serde(default)]
    weathers: Vec<String>,
    /// Repeats of matching scenarios, counted from 1.
    #[serde(default)]
    repeats: Vec<u32>,
}

/// The rules of a sweep, each with the types of which a scenario draws one, and those that each of its combinations matches.
#[derive(Debug, Clone, Default)]
pub struct Traffic {
    rules: Vec<(TrafficTable, AircraftTypes)>,
    of_each: Vec<Vec<usize>>,
}

/// Checks the tables, and finds the scenarios of each. `types` are the ones of `approach.aircraft`.
pub(super) fn read(
    tables: &[TrafficTable],
    combinations: &[Combination],
    day: &LocalDay,
    types: &AircraftTypes,
) -> Checked<Traffic> {
    let mut of_each = vec![Vec::new(); combinations.len()];
    let mut rules = Vec::with_capacity(tables.len());
    for (index, table) in tables.iter().enumerate() {
        let key = |field: &str| format!("traffic.{index}.{field}");
        let scenarios = Selection {
            times: table.times.clone(),
            weathers: table.weathers.clone(),
            repeats: table.repeats.clone(),
        };
        let matches = scenarios.matcher(combinations, day, key)?;
        for (combination, found) in combinations.iter().zip(&mut of_each) {
            if matches(combination) {
                found.push(index);
            }
            if found.len() > MAX_TRAFFIC {
                return fault(
                    format!("traffic.{index}"),
                    format!(
                        "scenario {} has {} other aircraft with this one, expected at most {MAX_TRAFFIC}, which is what the bundled \
                         simulator draws",
                        combination.id(),
                        found.len()
                    ),
                );
            }
        }
        rules.push((table.clone(), table.checked(index, types)?));
    }
    Ok(Traffic { rules, of_each })
}

impl TrafficTable {
    /// Checks the keys; the types of the rule.
    fn checked(&self, index: usize, types: &AircraftTypes) -> Checked<AircraftTypes> {
        let given = [self.after_s.is_some(), self.spacing_nm.is_some()];
        let (is_right, expected) = match self.role {
            Role::Arrival | Role::MissedApproach | Role::Crossing => {
                (given[0] != given[1], "either after_s or spacing_nm")
            }
            Role::Departure | Role::Taxi => (given == [true, false], "after_s alone"),
            Role::Parked => (given == [false, false], "neither after_s nor spacing_nm"),
        };
        if !is_right {
            let found = match given {
                [true, true] => "after_s and spacing_nm",
                [true, false] => "after_s",
                [false, true] => "spacing_nm",
                [false, false] => "neither",
            };
            let role = self.role.word();
            return fault(
                format!("traffic.{index}.role"),
                format!("an aircraft with role {role} has {found}, expected {expected}"),
            );
        }
        match &self.aircraft {
            Some(name) => name.only(format!("traffic.{index}.type")),
            None => Ok(types.clone()),
        }
    }
}

impl Traffic {
    /// The other aircraft of a combination, by its place in the sweep. Each value has a generator of its own.
    pub(crate) fn drawn(&self, combination: usize, scenario_seed: u64) -> Vec<OtherAircraft> {
        let matching = self.of_each.get(combination).into_iter().flatten();
        let drawn = |(aircraft_number, index): (u32, &usize)| {
            let (rule, types) = &self.rules[*index];
            let value = |name: &str, spread: &Option<Spread>| {
                let name = format!("traffic.{index}.{name}");
                Some(spread.as_ref()?.value(scenario_seed, &name))
            };
            let of = types.drawn_as(&format!("traffic.{index}.type"), scenario_seed);
            OtherAircraft {
                aircraft_number,
                aircraft: of.name.clone(),
                role: rule.role,
                after_s: value("after_s", &rule.after_s),
                spacing_nm: value("spacing_nm", &rule.spacing_nm),
            }
        };
        (1..).zip(matching).map(drawn).collect()
    }
}

/// Rejects traffic that would collide, meet on the runway or be below the ground, on a straight approach.
pub(super) fn check_separations(sweep: &Sweep) -> Checked<()> {
    if sweep.traffic.rules.is_empty() {
        return Ok(());
    }
    let mut seen = HashSet::new();
    for (index, combination) in sweep.combinations.iter().enumerate() {
        let id = combination.id();
        let seed = seed::of_scenario(sweep.corpus.seed, &id);
        let others = sweep.traffic.drawn(index, seed);
        let start_dtd_m = sweep.start.dtd_nm.value(seed, "start.dtd_nm") * METERS_PER_NAUTICAL_MILE;
        if others.is_empty() || !seen.insert(format!("{start_dtd_m} {others:?}")) {
            continue;
        }
        let bad = match fly_straight_in(sweep, &others, seed, start_dtd_m) {
            Ok(()) => continue,
            Err(bad) => bad,
        };
        let rule = sweep.traffic.of_each[index][bad.number.saturating_sub(1)];
        return fault(
            format!("traffic.{rule}"),
            format!("scenario {id}, on a straight approach: {bad}"),
        );
    }
    Ok(())
}

fn fly_straight_in(
    sweep: &Sweep,
    others: &[OtherAircraft],
    seed: u64,
    start_dtd_m: f64,
) -> Result<(), TrafficFault> {
    let (runway, aircraft) = (&sweep.runway, sweep.aircraft.drawn(seed));
    let straight = straight_in(aircraft, start_dtd_m, runway);
    let window = straight
        .as_ref()
        .map(|flight| flight.approach(runway, start_dtd_m));
    let (Ok(flight), Ok(Ok(window))) = (&straight, window) else {
        // Too steep for a flight in a straight line: the real ones are checked as they are flown.
        return Ok(());
    };
    let approach = Approach::new(flight, window, runway, aircraft)?;
    let steps = (approach.touchdown_s / STEP_S).ceil() as u32;
    let times_s: Vec<f64> = (0..=steps).map(|step| f64::from(step) * STEP_S).collect();
    approach.fly(others, &times_s).map(drop)
}
