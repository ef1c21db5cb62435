//! The plan: what a sweep expands to, scenario by scenario, with everything decided.
//!
//! Expansion is a pure function of a checked sweep. The plan is written into the corpus as `plan.json` and frozen there: a
//! corpus is finished with the plan with which it was begun, or with one that only adds scenarios.

mod difference;
mod expand;
mod split;

use std::path::Path;

use dataset::conditions::Conditions;
use dataset::json_file::{read_json, write_json};
use dataset::runway::Runway;
use dataset::scenario::Flight;
use dataset::video::VideoSettings;
use serde::{Deserialize, Serialize};
use xplane_bridge::fly::ApproachProfile;

use crate::sweep::{Camera, Picture};

pub use expand::expand;
pub use split::assign_sides;

/// All scenarios of a corpus, decided.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// BLAKE3 over the identifiers and hashes of all scenarios.
    pub plan_hash: String,
    /// Name of the corpus.
    pub corpus: String,
    /// The scenarios, in the order in which they are made.
    pub scenarios: Vec<PlannedScenario>,
}

/// One scenario, decided.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlannedScenario {
    /// Identifier and folder name: number, local time, weather, repeat; e.g. `0042-1700-foggy-r3`.
    pub id: String,
    /// Local time, `HH:MM`.
    pub time_of_day: String,
    /// Name of the weather.
    pub weather: String,
    /// Seed of everything random in the scenario, below 2^53.
    pub seed: u64,
    /// `live`, or the file name of the recording that is flown.
    pub flight: String,
    /// Identifier of the trajectory; scenarios that fly the same recording share it.
    pub trajectory: String,
    /// Expected number of ticks. Exact for recordings; a live flight decides in the end.
    pub ticks: u32,
    /// BLAKE3 over seed and parameters: a recorded scenario with another hash has to be made again.
    pub config_hash: String,
    /// Everything else that was decided.
    pub parameters: Parameters,
}

/// What a scenario is made from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Parameters {
    /// Aircraft type.
    pub aircraft: String,
    /// Where it lands.
    pub runway: Runway,
    /// Name of the camera rig.
    pub rig: String,
    /// Its cameras.
    pub cameras: Vec<Camera>,
    /// Size and rate of the pictures.
    pub picture: Picture,
    /// How videos are coded.
    pub video: VideoSettings,
    /// Weather and time.
    pub conditions: Conditions,
    /// Tick 0 is where so much is still to go along the course, metres.
    pub start_dtd_m: f64,
    /// Where the flight comes from.
    pub flight: Flight,
    /// How a live flight begins; absent for recordings.
    pub live: Option<LiveStart>,
}

/// How a live flight begins, as drawn from the sweep's spreads.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LiveStart {
    /// Offset right of the extended centreline, metres.
    pub cross_track_m: f64,
    /// Height above the altitude at which the profile begins, metres.
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

/// The plan as other programs read it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlanSummary<'a> {
    /// Hash of the plan.
    pub plan_hash: &'a str,
    /// A line per scenario.
    pub scenarios: Vec<ScenarioSummary<'a>>,
}

/// A scenario as other programs read it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ScenarioSummary<'a> {
    /// Identifier.
    pub id: &'a str,
    /// Local time, `HH:MM`.
    pub time_of_day: &'a str,
    /// Name of the weather.
    pub weather: &'a str,
    /// Seed.
    pub seed: u64,
    /// `live` or a file name.
    pub flight: &'a str,
    /// Expected number of ticks.
    pub ticks: u32,
}

impl Plan {
    /// What `dtd plan --json` prints.
    pub fn summary(&self) -> PlanSummary<'_> {
        let scenarios = self.scenarios.iter().map(|s| ScenarioSummary {
            id: &s.id,
            time_of_day: &s.time_of_day,
            weather: &s.weather,
            seed: s.seed,
            flight: &s.flight,
            ticks: s.ticks,
        });
        PlanSummary {
            plan_hash: &self.plan_hash,
            scenarios: scenarios.collect(),
        }
    }

    /// Reads a `plan.json`.
    pub fn read(path: &Path) -> dataset::Result<Self> {
        read_json(path, "plan")
    }

    /// Writes a `plan.json`.
    pub fn write(&self, path: &Path) -> dataset::Result<()> {
        write_json(path, self)
    }

    /// Why this plan cannot take the place of `frozen`, in words; `None` if it is the same or only adds scenarios.
    pub fn conflict_with(&self, frozen: &Self) -> Option<String> {
        difference::conflict(self, frozen)
    }
}

#[cfg(test)]
pub(crate) mod tests;
