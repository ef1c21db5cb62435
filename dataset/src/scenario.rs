//! `scenario.json`: everything that was decided about one scenario, and what made it.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::conditions::Conditions;
use crate::error::Result;
use crate::frame_rate::FrameRate;
use crate::geodesy::Geodetic;
use crate::json_file::{parse_json, read_json, write_json};
use crate::runway::Runway;

/// Latest version of the on-disk form. A reader refuses a larger one.
pub const SCHEMA_VERSION: u32 = 2;
/// The version of scenarios whose cameras are pinholes that see along straight lines: what readers of version 1 know.
/// [`crate::calibration::Calibration::schema_version`] says which one a scenario has.
pub const PINHOLE_SCHEMA_VERSION: u32 = 1;

/// Where a flight comes from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "source", rename_all = "lowercase")]
pub enum Flight {
    /// The simulator's own flight model under its autopilot.
    Live,
    /// A recorded flight, flown again.
    Recorded {
        /// File name of the recording, without folders.
        file: String,
        /// BLAKE3 hash of the recording.
        blake3: String,
    },
}

/// The record of one scenario.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ScenarioRecord {
    /// Version of the form: [`PINHOLE_SCHEMA_VERSION`], or [`SCHEMA_VERSION`] if a lens or the air bends light.
    pub schema_version: u32,
    /// Identifier and folder name, e.g. `1700-foggy-r3`.
    pub id: String,
    /// Identifier of the trajectory. Scenarios that fly the same trajectory share it, and no split may part them.
    pub trajectory: String,
    /// Seed of everything random in this scenario.
    pub seed: u64,
    /// Hash of the plan that this scenario belongs to.
    pub plan_hash: String,
    /// Hash of this scenario's own parameters: if it changes, the scenario has to be made again.
    pub config_hash: String,
    /// Aircraft type.
    pub aircraft: String,
    /// Rate of the ticks.
    pub frame_rate: FrameRate,
    /// Number of ticks, which is also the number of frames in each video.
    pub ticks: u32,
    /// The runway.
    pub runway: Runway,
    /// The touchdown target: distances are to this point.
    pub touchdown: Geodetic,
    /// Where this flight's wheels touched first, if they did within the recording.
    pub flight_touchdown: Option<Geodetic>,
    /// Name of the geoid that heights refer to; `null` if heights above mean sea level are taken as above the ellipsoid.
    pub geoid: Option<String>,
    /// Weather and time.
    pub conditions: Conditions,
    /// Source of the flight.
    pub flight: Flight,
    /// Name of the camera rig.
    pub rig: String,
    /// Identifiers of the views, in the order of the tables.
    pub views: Vec<String>,
    /// What made it.
    pub versions: Versions,
}

/// Versions of everything that had a part in a recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Versions {
    /// This software.
    pub dtd: String,
    /// Name and version of the simulator, as it reports itself.
    pub simulator: String,
    /// Version of the capture link that it spoke.
    pub capture_link: u32,
    /// Where the pixels came from: `link`, `gl` or `screen`; missing in records made before there was a choice.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pixels: Option<String>,
}

impl ScenarioRecord {
    /// Reads `scenario.json`.
    pub fn read(path: &Path) -> Result<Self> {
        Self::check(read_json(path, "scenario record")?, path)
    }

    /// Reads the content of `scenario.json`; messages name it as `path`.
    pub fn parse(content: &[u8], path: &Path) -> Result<Self> {
        Self::check(parse_json(content, path, "scenario record")?, path)
    }

    fn check(record: Self, path: &Path) -> Result<Self> {
        if record.schema_version > SCHEMA_VERSION {
            return Err(crate::Error::corpus(
                path,
                format!(
                    "has schema version {}, this program knows versions up to {SCHEMA_VERSION}; use a newer dtd",
                    record.schema_version
                ),
            ));
        }
        Ok(record)
    }

    /// Writes `scenario.json`.
    pub fn write(&self, path: &Path) -> Result<()> {
        write_json(path, self)
    }
}
