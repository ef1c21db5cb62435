//! Other aircraft in a scenario, besides the one that lands: as planned, and as listed in `scenario.json`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::numbers::limits::{self, Check, check_fields};

/// Maximum number of other aircraft in a scenario.
pub const MAX_TRAFFIC: usize = 7;

/// What an aircraft does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Role {
    /// It flies the approach of the first aircraft at a different time, lands, and taxies back.
    Arrival,
    /// It taxies to the threshold, takes off and climbs straight ahead.
    Departure,
    /// It flies the approach of the first aircraft at a different time, goes around at 60 m and climbs straight ahead.
    MissedApproach,
    /// It crosses the approach from left to right, 300 m above the first aircraft's path.
    Crossing,
    /// It taxies on the parallel taxiway towards the threshold, and stands at its ends.
    Taxi,
    /// It stands on the apron beside the taxiway.
    Parked,
}

impl Role {
    /// The role's word.
    pub fn word(self) -> &'static str {
        match self {
            Self::Arrival => "arrival",
            Self::Departure => "departure",
            Self::MissedApproach => "missed-approach",
            Self::Crossing => "crossing",
            Self::Taxi => "taxi",
            Self::Parked => "parked",
        }
    }
}

/// An aircraft besides the first one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OtherAircraft {
    /// Its number in the tables, from 1: the first aircraft has number 0.
    pub aircraft_number: u32,
    /// Aircraft type.
    pub aircraft: String,
    /// Its role.
    pub role: Role,
    /// Time by which it is behind the first aircraft, seconds; negative ahead.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub after_s: Option<f64>,
    /// Distance by which it is behind the first aircraft, nautical miles; negative ahead.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spacing_nm: Option<f64>,
}

impl OtherAircraft {
    /// Checks for numbers outside their limits.
    pub(crate) fn check(&self, check: &mut Check) {
        check_fields!(
            check,
            self,
            optional {
                after_s: limits::TRAFFIC_AFTER_S,
                spacing_nm: limits::TRAFFIC_SPACING_NM,
            }
        );
    }
}

/// The first fault of a scenario's other aircraft, besides numbers outside their limits, as text.
pub(crate) fn fault(traffic: &[OtherAircraft]) -> Option<String> {
    let count = traffic.len();
    if count > MAX_TRAFFIC {
        return Some(format!(
            "has {count} other aircraft, expected at most {MAX_TRAFFIC}"
        ));
    }
    let mut numbered = (1..).zip(traffic);
    let (expected, of) = numbered.find(|(number, of)| of.aircraft_number != *number)?;
    Some(format!(
        "has an other aircraft ({}) with number {}, expected {expected}",
        of.role.word(),
        of.aircraft_number
    ))
}
