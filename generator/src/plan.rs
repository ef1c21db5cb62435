//! The plan: the scenarios that a sweep expands to, fully specified.
//!
//! Expansion is a pure function of a checked sweep. A scenario is determined by its parameters (time, weather, profile and repeat)
//! and the master seed, never by its position among the others: a sweep that grows adds scenarios and leaves the others as they
//! are. The plan is written into the corpus as `plan.json` and frozen there: a corpus can only be finished with the same plan, or
//! with one that only adds scenarios.

mod against;
mod check;
mod difference;
mod estimate;
mod expand;
mod split;
mod summary;

use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

use dataset::conditions::Conditions;
use dataset::imaging::Imaging;
use dataset::json_file::write_atomically;
use dataset::outside_file::{self, FileKind};
use dataset::rig::{Aim, Jitter};
use dataset::runway::Runway;
use dataset::scenario::Flight;
use dataset::video::VideoSettings;
use serde::{Deserialize, Serialize};
use xplane_bridge::fly::ApproachProfile;

use crate::seed;
use crate::sweep::{Camera, Picture};

pub use against::{Against, Standing};
pub use difference::{Change, Difference};
pub use estimate::{Estimate, MeasuredSize, PicturesPerSecond, room_bytes};
pub use expand::expand;
pub use split::assign_sides;
pub use summary::{PlanSummary, ScenarioSummary};

/// Version of the file format of `plan.json`. Version 1 numbered its scenarios.
pub const PLAN_VERSION: u32 = 2;

/// All scenarios of a corpus, fully specified.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// [`PLAN_VERSION`] when this was written.
    pub plan_version: u32,
    /// BLAKE3 over the identifiers and hashes of all scenarios.
    pub plan_hash: String,
    /// Name of the corpus.
    pub corpus: String,
    /// What all scenarios have in common.
    pub common: Common,
    /// The scenarios, in recording order.
    pub scenarios: Vec<PlannedScenario>,
}

/// What all scenarios of a plan have in common.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Common {
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
    /// Video settings.
    pub video: VideoSettings,
}

/// One scenario, fully specified.
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
    /// `live`, or the file name of the recording that is flown.
    pub flight: String,
    /// Identifier of the trajectory; scenarios that fly the same recording share it.
    pub trajectory: String,
    /// Expected number of ticks. Exact for recordings; a live flight determines the actual one.
    pub ticks: u32,
    /// BLAKE3 over identifier, seed, parameters and common values: a recorded scenario with another hash must be recorded again.
    pub config_hash: String,
    /// All other parameters.
    pub parameters: Parameters,
}

/// The parameters of a scenario, besides the common values.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Parameters {
    /// Weather and time.
    pub conditions: Conditions,
    /// Remaining distance along the course at tick 0, metres.
    pub start_dtd_m: f64,
    /// Source of the flight.
    pub flight: Flight,
    /// Start of a live flight; absent for recordings.
    pub live: Option<LiveStart>,
    /// Where the cameras are aimed; absent if as in the rig.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub aim: Option<Aim>,
    /// Placement error of each camera, by its identifier; absent if there is none.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub jitter: BTreeMap<String, Jitter>,
    /// Lens, air and sensor of the cameras, by their identifiers; cameras without an entry are ideal.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub imaging: BTreeMap<String, Imaging>,
}

/// Start of a live flight, as drawn from the sweep's spreads.
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

impl Plan {
    /// Reads a `plan.json`.
    pub fn read(path: &Path) -> dataset::Result<Self> {
        let text = outside_file::read(path, FileKind::PLAN.unlinked())?;
        Self::parse(&text, path)
    }

    /// Reads the text of a `plan.json`; messages name it as `path`.
    pub fn parse(text: &[u8], path: &Path) -> dataset::Result<Self> {
        let invalid = |source| dataset::Error::Json {
            what: "plan",
            path: path.to_owned(),
            source,
        };
        #[derive(Deserialize)]
        struct Form {
            #[serde(default = "first_version")]
            plan_version: u32,
        }
        fn first_version() -> u32 {
            1
        }
        let found = serde_json::from_slice::<Form>(text)
            .map_err(invalid)?
            .plan_version;
        if found != PLAN_VERSION {
            return Err(dataset::Error::corpus(
                path,
                format!(
                    "has plan version {found}, expected {PLAN_VERSION}: this corpus was made by another version of dtd, which alone can add to it; make a new corpus, or use that version"
                ),
            ));
        }
        let plan: Self = serde_json::from_slice(text).map_err(invalid)?;
        match check::fault(&plan) {
            None => Ok(plan),
            Some(fault) => Err(dataset::Error::corpus(path, fault)),
        }
    }

    /// Checks the plan against its hashes; the error says what differs.
    ///
    /// # Errors
    /// A scenario's parameters, or the list of scenarios, do not match their hashes.
    pub fn check_hashes(&self) -> Result<(), String> {
        expand::check_hashes(self)
    }

    /// Whether the seeds of all scenarios follow from this master seed.
    pub fn is_seeded_by(&self, master: u64) -> bool {
        let mut scenarios = self.scenarios.iter();
        scenarios.all(|scenario| scenario.seed == seed::of_scenario(master, &scenario.id))
    }

    /// Writes a `plan.json`, one line per scenario.
    pub fn write(&self, path: &Path) -> dataset::Result<()> {
        let text = self.to_json().map_err(|source| dataset::Error::Json {
            what: "plan",
            path: path.to_owned(),
            source,
        })?;
        write_atomically(path, &text)
    }

    fn to_json(&self) -> serde_json::Result<Vec<u8>> {
        let Self {
            plan_version,
            plan_hash,
            corpus,
            common,
            scenarios,
        } = self;
        let head = serde_json::json!({
            "plan_version": plan_version,
            "plan_hash": plan_hash,
            "corpus": corpus,
            "common": common,
        });
        let mut text = serde_json::to_vec_pretty(&head)?;
        text.truncate(text.len() - "\n}".len());
        text.extend_from_slice(b",\n  \"scenarios\": [");
        for (index, scenario) in scenarios.iter().enumerate() {
            text.extend_from_slice(if index == 0 { b"\n    " } else { b",\n    " });
            serde_json::to_writer(&mut text, scenario)?;
        }
        writeln!(text, "\n  ]\n}}").map_err(serde_json::Error::io)?;
        Ok(text)
    }

    /// How this plan differs from the corpus' original one.
    pub fn difference_from(&self, frozen: &Self) -> Difference {
        Difference::between(frozen, self)
    }

    /// Why this plan cannot replace `frozen`, as text; `None` if it is the same or only adds scenarios.
    pub fn conflict_with(&self, frozen: &Self) -> Option<String> {
        self.difference_from(frozen).conflict()
    }
}

#[cfg(test)]
pub(crate) mod tests;
