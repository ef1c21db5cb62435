//! `scenario.json`: all parameters of a scenario, and the versions that made it.

pub mod other_flight;
mod recorded;
pub(crate) mod traffic;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::conditions::{Conditions, Weather};
use crate::corpus::effective_weather::{EffectiveWeather, WeatherDifference};
use crate::error::{Error, Result};
use crate::files::file_name;
use crate::files::json_file::{parse_json, read_json, write_json};
use crate::geometry::geodesy::Geodetic;
use crate::geometry::runway::Runway;
use crate::numbers::frame_rate::FrameRate;
use crate::numbers::limits::{self, Check, FieldOutOfLimits};

pub use recorded::{CameraClock, DelayedTrack, Origin, Recorded, SourceFile};
pub use traffic::{MAX_TRAFFIC, OtherAircraft, Role};

/// Latest version of the file format. Readers reject a larger one.
pub const SCHEMA_VERSION: u32 = TRAFFIC_SCHEMA_VERSION;
/// The version of scenarios whose cameras are pinholes with straight light, which version 1 readers support.
/// [`crate::corpus::calibration::Calibration::schema_version`] returns a scenario's version.
pub const PINHOLE_SCHEMA_VERSION: u32 = 1;
/// The version of scenarios with lens distortion or refraction, which readers of version 1 would overlook.
pub(crate) const LENS_SCHEMA_VERSION: u32 = 2;
/// The version of scenarios that were drawn under a different weather than planned, which readers of version 2 would overlook.
pub const MARKED_SCHEMA_VERSION: u32 = 3;
/// The version of scenarios that no simulator made: images may be missing, and have their own times.
pub const RECORDED_SCHEMA_VERSION: u32 = 4;
/// The version of scenarios with several aircraft, whose other boxes readers of version 4 would take for the first one's.
pub const TRAFFIC_SCHEMA_VERSION: u32 = 5;

/// Word for a weather, a time of day or an aircraft type that a recording does not name.
pub const UNKNOWN: &str = "unknown";

/// Flight source.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "source", rename_all = "lowercase")]
pub enum Flight {
    /// The simulator's own flight model under its autopilot.
    Live,
    /// Our own flight model, ahead of the recording; the simulator shows the flight as it shows recorded ones.
    Computed {
        /// Version of the flight model.
        model: u32,
    },
    /// A recorded flight, replayed.
    Recorded {
        /// File name of the recording, without folders.
        file: String,
        /// BLAKE3 hash of the recording.
        blake3: String,
    },
}

impl Flight {
    /// A short name: `live`, `computed`, or the file name of the recording.
    pub fn name(&self) -> &str {
        match self {
            Self::Live => "live",
            Self::Computed { .. } => "computed",
            Self::Recorded { file, .. } => file,
        }
    }
}

/// A scenario's record.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ScenarioRecord {
    /// Version of the file format; see [`Self::required_version`].
    pub schema_version: u32,
    /// Identifier and folder name, e.g. `1700-foggy-r3`.
    pub id: String,
    /// Identifier of the trajectory. Scenarios that fly the same trajectory share it, and a split must not separate them.
    pub trajectory: String,
    /// Seed of everything random in this scenario; missing in a recorded one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    /// Hash of the plan that this scenario belongs to; missing in a recorded one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plan_hash: Option<String>,
    /// Hash of this scenario's own parameters: if it changes, the scenario must be recorded again.
    pub config_hash: String,
    /// Aircraft type; [`UNKNOWN`] if a recording does not name it.
    pub aircraft: String,
    /// Other aircraft, by number; missing if there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub traffic: Vec<OtherAircraft>,
    /// Rate of the ticks.
    pub frame_rate: FrameRate,
    /// Number of ticks, which is also the number of frames in each video.
    pub ticks: u32,
    /// The runway.
    pub runway: Runway,
    /// The touchdown target: distances are to this point.
    pub touchdown: Geodetic,
    /// Point where this flight's wheels first touched the ground, if within the recording.
    pub flight_touchdown: Option<Geodetic>,
    /// Name of the geoid that heights refer to; `null` if heights above mean sea level are taken as heights above the ellipsoid.
    pub geoid: Option<String>,
    /// Weather and time, as planned and written; missing in a recorded scenario.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub conditions: Option<Conditions>,
    /// The weather that the simulator reported at the aircraft; missing if the simulator reports none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub effective_weather: Option<EffectiveWeather>,
    /// Source of the flight.
    pub flight: Flight,
    /// Name of the camera rig.
    pub rig: String,
    /// Identifiers of the views, in the order of the tables.
    pub views: Vec<String>,
    /// The blocks of ticks for which the camera rested; missing if the camera was settled for each image separately.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub blocks: Option<Blocks>,
    /// Graphics of the images; missing if the simulator does not say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub graphics: Option<Graphics>,
    /// Origin of a scenario that no simulator made; missing in a simulated one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recorded: Option<Recorded>,
    /// Versions of the software that made it.
    pub versions: Versions,
}

/// Settings and devices behind the images of a simulator, by its own files.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Graphics {
    /// Device, driver, desktop session, graphics settings and scenery, by the simulator's names for them.
    pub settings: BTreeMap<String, String>,
    /// The exposure of the last image, at ISO 100: it adapts to the scene.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exposure_ev100: Option<f64>,
}

impl Graphics {
    /// Settings that are not the same in all these scenarios, each with its values and their scenarios, in their order.
    pub fn changes<'a>(scenarios: impl IntoIterator<Item = (&'a str, &'a Self)>) -> Vec<String> {
        let known: Vec<(&str, &Self)> = scenarios.into_iter().collect();
        let names: BTreeSet<&String> = known
            .iter()
            .flat_map(|(_, it)| it.settings.keys())
            .collect();
        let change = |name: &String| {
            let mut values: Vec<(&str, Vec<&str>)> = Vec::new();
            for (id, graphics) in &known {
                let value = graphics
                    .settings
                    .get(name)
                    .map_or("missing", String::as_str);
                match values.iter_mut().find(|(known, _)| *known == value) {
                    Some((_, ids)) => ids.push(id),
                    None => values.push((value, vec![id])),
                }
            }
            let say = |(value, ids): &(&str, Vec<&str>)| match ids.as_slice() {
                [id] => format!("{value} in {id}"),
                ids => format!("{value} in {} and {} more", ids[0], ids.len() - 1),
            };
            let values: Vec<String> = values.iter().map(say).collect();
            (values.len() > 1).then(|| format!("{name} is {}", values.join(", ")))
        };
        names.into_iter().filter_map(change).collect()
    }
}

/// A recording in blocks: a view's camera rests for a block of ticks, while the aircraft moves from drawn frame to drawn frame; then the
/// next view shows the same ticks.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Blocks {
    /// Ticks in a block; the last one may be shorter.
    pub ticks: u32,
    /// Lag of the scene behind its frame number, in drawn frames: every value that occurred.
    pub frames_behind: Vec<u32>,
    /// Blocks of all views.
    pub count: u32,
    /// Blocks where a probe measured that. In the others the aircraft could not be seen, and the last value was kept.
    pub measured: u32,
    /// Ticks that were held until their image had settled, because no value was known.
    pub held_ticks: u32,
    /// Ticks that were shown again, because their frame was lost or in doubt.
    pub repeated_ticks: u32,
}

/// Versions of everything involved in a recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Versions {
    /// This software.
    pub dtd: String,
    /// Name and version of the simulator, as it reports itself; missing in a recorded scenario.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub simulator: Option<String>,
    /// Version of the capture link in use; missing in a recorded scenario.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub capture_link: Option<u32>,
    /// Source of the pixels: `link`, `gl` or `screen`; missing in a recorded scenario.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pixels: Option<String>,
    /// FFmpeg's name of the encoder that made the videos, e.g. `libx264` or `h264_nvenc`.
    pub encoder: Option<String>,
}

impl ScenarioRecord {
    /// Number of images of all views.
    pub fn pictures(&self) -> u64 {
        u64::from(self.ticks) * self.views.len() as u64
    }

    /// Number of aircraft: the first one and the others.
    pub fn aircraft_count(&self) -> u32 {
        1 + self.traffic.len() as u32
    }

    /// Maximum number of ground-truth boxes: one per image and aircraft.
    pub fn max_truth_boxes(&self) -> u64 {
        self.pictures() * u64::from(self.aircraft_count())
    }

    /// True if the aircraft with this number lands, so that it has a distance to touchdown.
    pub fn lands(&self, aircraft_number: u32) -> bool {
        let mut traffic = self.traffic.iter();
        aircraft_number == 0
            || traffic.any(|of| of.aircraft_number == aircraft_number && of.role == Role::Arrival)
    }

    /// Planned weather; `None` in a recorded scenario.
    pub fn weather(&self) -> Option<&Weather> {
        self.conditions.as_ref().map(|planned| &planned.weather)
    }

    /// Name of the planned weather, or [`UNKNOWN`].
    pub fn weather_name(&self) -> &str {
        let conditions = self.conditions.as_ref();
        conditions.map_or(UNKNOWN, |planned| &planned.weather_name)
    }

    /// Planned local time, or [`UNKNOWN`].
    pub fn time_of_day(&self) -> &str {
        let conditions = self.conditions.as_ref();
        conditions.map_or(UNKNOWN, |planned| &planned.time_of_day)
    }

    /// Differences between the weather at the aircraft and the planned one; empty unless the scenario is marked.
    pub fn weather_marks(&self) -> Vec<WeatherDifference> {
        let effective = self.effective_weather.as_ref().zip(self.weather());
        effective.map_or_else(Vec::new, |(effective, planned)| effective.marks(planned))
    }

    /// True if the weather at the aircraft differs from the planned one.
    pub fn is_marked(&self) -> bool {
        let effective = self.effective_weather.as_ref();
        effective.is_some_and(EffectiveWeather::is_marked)
    }

    /// The version of the file format that this record needs: `of_cameras` is what its cameras need.
    pub fn required_version(&self, of_cameras: u32) -> u32 {
        if !self.traffic.is_empty() {
            TRAFFIC_SCHEMA_VERSION
        } else if self.recorded.is_some() {
            RECORDED_SCHEMA_VERSION
        } else if self.is_marked() {
            MARKED_SCHEMA_VERSION
        } else {
            of_cameras
        }
    }

    /// Reads `scenario.json`. A number outside its limits is an error, and so is everything that [`Self::read_with_faults`] rejects.
    pub fn read(path: &Path) -> Result<Self> {
        let read = read_json(path, "scenario record");
        Self::sound(
            Self::unless_newer(read, path, || read_json(path, "scenario record"))?,
            path,
        )
    }

    /// Reads the content of `scenario.json`; messages name it as `path`.
    pub fn parse(content: &[u8], path: &Path) -> Result<Self> {
        let parsed = parse_json(content, path, "scenario record");
        let version = || parse_json(content, path, "scenario record");
        Self::sound(Self::unless_newer(parsed, path, version)?, path)
    }

    /// The record, or the error: of its version, if that is newer than this program, else of its fields.
    fn unless_newer(
        read: Result<Self>,
        path: &Path,
        version: impl FnOnce() -> Result<VersionOnly>,
    ) -> Result<Self> {
        read.map_err(|error| match version() {
            Ok(found) if found.schema_version > SCHEMA_VERSION => {
                Error::corpus(path, newer(found.schema_version))
            }
            _ => error,
        })
    }

    fn sound(self, path: &Path) -> Result<Self> {
        let (record, faults) = self.readable(path)?;
        Error::refuse_first(path, faults)?;
        Ok(record)
    }

    /// Reads `scenario.json` and collects numbers outside their limits. An unknown version, an impossible number of ticks, and a view whose
    /// name is not a file name are errors, because they prevent all other checks.
    pub fn read_with_faults(path: &Path) -> Result<(Self, Vec<FieldOutOfLimits>)> {
        let read = read_json(path, "scenario record");
        Self::unless_newer(read, path, || read_json(path, "scenario record"))?.readable(path)
    }

    fn readable(self, path: &Path) -> Result<(Self, Vec<FieldOutOfLimits>)> {
        match self.unreadable() {
            Some(message) => Err(Error::corpus(path, message)),
            None => {
                let faults = self.out_of_limits();
                Ok((self, faults))
            }
        }
    }

    /// Writes `scenario.json` if all its numbers are within their limits.
    pub fn write(&self, path: &Path) -> Result<()> {
        let faults = [
            self.unreadable(),
            self.out_of_limits().first().map(ToString::to_string),
        ];
        match faults.into_iter().flatten().next() {
            None => write_json(path, self),
            Some(fault) => Err(Error::corpus(path, format!("is not written: {fault}"))),
        }
    }

    fn out_of_limits(&self) -> Vec<FieldOutOfLimits> {
        let mut check = Check::default();
        check.part("runway", |check| self.runway.check(check));
        check.part("touchdown", |check| {
            self.touchdown.check(limits::ELEVATION_MSL_M, check);
        });
        if let Some(touchdown) = self.flight_touchdown {
            check.part("flight_touchdown", |check| {
                touchdown.check(limits::ALTITUDE_MSL_M, check);
            });
        }
        if let Some(conditions) = &self.conditions {
            check.part("conditions", |check| conditions.check(check));
        }
        if let Some(effective) = &self.effective_weather {
            check.part("effective_weather", |check| effective.check(check));
        }
        for other in &self.traffic {
            check.part(format_args!("traffic.{}", other.aircraft_number), |check| {
                other.check(check);
            });
        }
        check.into_found()
    }

    /// The reason why this record cannot be used, as text: its meaning is unknown, or file names are invalid.
    fn unreadable(&self) -> Option<String> {
        if self.schema_version < RECORDED_SCHEMA_VERSION
            && (self.seed.is_none() || self.conditions.is_none())
        {
            return Some(format!(
                "has schema version {} and no seed or conditions, which only recorded scenarios (version {RECORDED_SCHEMA_VERSION}) lack; \
                 generate the scenario again",
                self.schema_version
            ));
        }
        if self.schema_version > SCHEMA_VERSION {
            return Some(newer(self.schema_version));
        }
        if let Err(found) = limits::TICKS.check(self.ticks.into()) {
            return Some(format!("ticks {found}"));
        }
        let views = self.views.len();
        if !(1..=limits::MAX_VIEWS).contains(&views) {
            return Some(format!(
                "has {views} views, expected 1 to {}",
                limits::MAX_VIEWS
            ));
        }
        if let Some(fault) = traffic::fault(&self.traffic) {
            return Some(fault);
        }
        let bad = self
            .views
            .iter()
            .find_map(|view| file_name::check(view).err());
        bad.map(|bad| format!("view {bad}"))
    }
}

/// Version of a record whose fields may be unknown.
#[derive(Deserialize)]
struct VersionOnly {
    schema_version: u32,
}

fn newer(version: u32) -> String {
    format!(
        "has schema version {version}, this program knows versions up to {SCHEMA_VERSION}; use a newer dtd"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_newer_record_is_named_by_its_version_though_its_fields_are_unknown() {
        let newer = format!("{{\"schema_version\": {}}}", SCHEMA_VERSION + 1);
        let said = |text: &str| {
            let read = ScenarioRecord::parse(text.as_bytes(), Path::new("scenario.json"));
            read.unwrap_err().to_string()
        };
        assert!(said(&newer).contains("use a newer dtd"), "{}", said(&newer));
        let known = format!("{{\"schema_version\": {SCHEMA_VERSION}}}");
        assert!(said(&known).contains("missing field"), "{}", said(&known));
    }

    #[test]
    fn a_setting_that_changes_is_named_with_its_values_and_an_exposure_may_change() {
        let drawn = |exposure_ev100, settings: &[(&str, &str)]| Graphics {
            settings: (settings.iter())
                .map(|(name, value)| ((*name).to_owned(), (*value).to_owned()))
                .collect(),
            exposure_ev100: Some(exposure_ev100),
        };
        let first = drawn(12.0, &[("renopt_MSAA", "0"), ("Vulkan Driver", "596.21.0")]);
        let again = drawn(4.0, &[("renopt_MSAA", "0"), ("Vulkan Driver", "596.21.0")]);
        let other = drawn(12.0, &[("renopt_MSAA", "2")]);
        assert_eq!(Graphics::changes([("a", &first), ("b", &again)]), [""; 0]);
        let changes = Graphics::changes([("a", &first), ("b", &again), ("c", &other)]);
        assert_eq!(
            changes,
            [
                "Vulkan Driver is 596.21.0 in a and 1 more, missing in c",
                "renopt_MSAA is 0 in a and 1 more, 2 in c"
            ]
        );
    }
}
