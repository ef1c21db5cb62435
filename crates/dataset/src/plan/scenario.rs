//! One planned scenario, fully specified.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::{Aim, Common, Jitter, PlannedCamera};
use crate::conditions::Conditions;
use crate::corpus::calibration::CameraEntry;
use crate::corpus::scenario::{Flight, OtherAircraft};
use crate::geometry::approach_profile::ApproachProfile;
use crate::geometry::imaging::Imaging;
use crate::numbers::limits::{self, Check, check_fields};

/// A fully specified scenario.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlannedScenario {
    /// Identifier and folder name: local time, weather, profile if the grid lists profiles, repeat; e.g. `1700-foggy-r3`.
    pub id: String,
    /// Local time, `HH:MM`.
    pub time_of_day: String,
    /// Name of the weather.
    pub weather: String,
    /// Seed of everything random in the scenario, below 2^53.
    pub seed: u64,
    /// `live`, `computed`, or the file name of the recording that is flown.
    pub flight: String,
    /// Identifier of the trajectory; scenarios that fly the same recording share it.
    pub trajectory: String,
    /// Expected number of ticks. Exact for recordings; a flight that is yet to be flown determines the actual one.
    pub ticks: u32,
    /// BLAKE3 over identifier, seed, parameters and common values: a recorded scenario with a different hash must be recorded again.
    pub config_hash: String,
    /// All other parameters.
    pub parameters: Parameters,
}

/// A scenario's parameters, besides the common values.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Parameters {
    /// Weather and time.
    pub conditions: Conditions,
    /// Remaining distance along the course at tick 0, metres.
    pub start_dtd_m: f64,
    /// Source of the flight.
    pub flight: Flight,
    /// Start of the live or computed flight; absent for recordings.
    pub live: Option<LiveStart>,
    /// Aircraft type; absent if all scenarios have the same one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub aircraft: Option<String>,
    /// Other aircraft, by number; absent if there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub traffic: Vec<OtherAircraft>,
    /// Aim of the cameras; absent if as in the rig.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub aim: Option<Aim>,
    /// Placement error of each camera, by its identifier; absent if there is none.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub jitter: BTreeMap<String, Jitter>,
    /// Lens, air and sensor of the cameras, by their identifiers; cameras without an entry are ideal.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub imaging: BTreeMap<String, Imaging>,
}

/// Start of the live or computed flight, as drawn from the sweep's spreads.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LiveStart {
    /// Offset right of the extended centreline, metres.
    pub cross_track_m: f64,
    /// Height above the profile's first altitude, metres.
    pub above_profile_m: f64,
    /// Heading right of the course, degrees.
    pub heading_offset_deg: f64,
    /// True airspeed, metres per second.
    pub speed_mps: f64,
    /// Name of the profile.
    pub profile_name: String,
    /// The profile.
    pub profile: ApproachProfile,
}

impl PlannedScenario {
    /// True if the name starts with the time and the weather, as all names of scenarios do.
    pub(super) fn is_named_after_its_conditions(&self) -> bool {
        let digits = self.time_of_day.replace(':', "");
        let rest = self.id.strip_prefix(&digits);
        let rest = rest.and_then(|rest| rest.strip_prefix('-'));
        let rest = rest.and_then(|rest| rest.strip_prefix(&self.weather));
        rest.is_some_and(|rest| rest.starts_with('-'))
    }

    /// Checks for numbers outside their limits.
    pub(super) fn check(&self, check: &mut Check) {
        check.number("ticks", self.ticks, limits::TICKS);
        self.parameters.check(check);
    }
}

impl Parameters {
    /// The type of the scenario's aircraft; empty if the plan names none.
    pub fn aircraft<'a>(&'a self, common: &'a Common) -> &'a str {
        let own = self.aircraft.as_ref();
        own.or(common.aircraft.as_ref()).map_or("", String::as_str)
    }

    /// The calibrated cameras of the scenario with their identifiers, in the order of the rig.
    pub fn cameras(&self, common: &Common) -> Vec<(String, CameraEntry)> {
        let Common {
            runway,
            cameras,
            picture,
            ..
        } = common;
        let camera = |camera: &PlannedCamera| {
            let jitter = self.jitter.get(&camera.id).copied().unwrap_or_default();
            let imaging = self.imaging.get(&camera.id).copied().unwrap_or_default();
            let calibrated = camera.calibrated(runway, *picture, self.aim, &jitter, &imaging);
            (camera.id.clone(), calibrated)
        };
        cameras.iter().map(camera).collect()
    }

    fn check(&self, check: &mut Check) {
        check.part("conditions", |check| self.conditions.check(check));
        check.number("start_dtd_m", self.start_dtd_m, limits::START_DTD_M);
        if let Some(live) = &self.live {
            check.part("live", |check| live.check(check));
        }
        for other in &self.traffic {
            check.part(format_args!("traffic.{}", other.aircraft_number), |check| {
                other.check(check);
            });
        }
        for (camera, imaging) in &self.imaging {
            check.part(format_args!("imaging.{camera}"), |check| {
                imaging.check(check);
            });
        }
        for (camera, jitter) in &self.jitter {
            check.part(format_args!("jitter.{camera}"), |check| jitter.check(check));
        }
    }
}

impl LiveStart {
    fn check(&self, check: &mut Check) {
        check_fields!(check, self, {
            cross_track_m: limits::START_CROSS_TRACK_M,
            above_profile_m: limits::START_ABOVE_PROFILE_M,
            heading_offset_deg: limits::START_HEADING_OFFSET_DEG,
            speed_mps: limits::START_SPEED_MPS,
        });
        let altitude_m = self.profile.start_altitude_msl_m();
        check.number(
            "profile.start_altitude_msl_m",
            altitude_m,
            limits::ALTITUDE_MSL_M,
        );
    }
}
