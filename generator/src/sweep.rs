//! A sweep: the TOML file that describes which scenarios a corpus contains.
//!
//! Input: the file. Output: a [`Sweep`] whose every value has been checked, or one message with file, line, column and the line itself.
//! [`crate::plan`] expands it.

mod aircraft;
mod check;
mod document;
mod grid;
mod imaging;
mod picture;
mod rigs;
mod runways;
mod schema;
mod start;
mod traffic;
mod weather;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use check::fault::Fault;
use dataset::files::outside_file::{self, FileKind};
use dataset::files::toml_file::{TomlError, TomlFile};
use dataset::geometry::approach_profile::ApproachProfile;
use dataset::geometry::runway::Runway;
use dataset::plan::{Picture, PlannedCamera};
use dataset::video::VideoSettings;

use crate::recording::Recording;

pub use aircraft::AircraftTypes;
pub use document::Corpus;
pub use grid::Combination;
pub use grid::split::SplitFractions;
pub use imaging::{ImagingTable, Preset, SeeingTable, SensorTable, StreamTable, SwayTable};
pub use rigs::aim::AimTable;
pub use rigs::jitter::JitterTable;
pub(crate) use runways::AirportTable;
pub use schema::schema;
pub use start::recorded::{RecordedFlights, RecordedRule};
pub use start::{Fly, Start};
pub use traffic::Traffic;
pub use weather::{CloudTable, WeatherTable};

/// Reasons why a sweep cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SweepError {
    /// The file cannot be read.
    #[error(transparent)]
    Unreadable(dataset::Error),
    /// The file has a mistake.
    #[error(transparent)]
    Invalid(#[from] TomlError),
}

/// A checked sweep, with the recordings that it names already read.
#[derive(Debug, Clone)]
pub struct Sweep {
    /// Name of the corpus and its master seed.
    pub corpus: Corpus,
    /// Runway on which the aircraft land.
    pub runway: Runway,
    /// Aircraft types.
    pub aircraft: AircraftTypes,
    /// Name of the camera rig.
    pub rig_name: String,
    /// Cameras of the rig.
    pub cameras: Vec<PlannedCamera>,
    /// Aim of each scenario's cameras, if not as in the rig.
    pub aim: Option<AimTable>,
    /// Placement errors of each scenario's cameras.
    pub jitter: Option<JitterTable>,
    /// Air, mast, sensor and stream of the images, completed by their preset.
    pub imaging: Option<ImagingTable>,
    /// The combinations, in recording order; never empty, all different.
    pub combinations: Vec<Combination>,
    /// Day of the year, 1 to 365.
    pub day_of_year: u32,
    /// Local time minus UTC, hours.
    pub utc_offset_h: f64,
    /// Offset by the airport's time zone, if it is known, hours.
    pub zone_offset_h: Option<f64>,
    /// Size and rate of the images.
    pub picture: Picture,
    /// Video settings.
    pub video: VideoSettings,
    /// Start of live flights.
    pub start: Start,
    /// Profiles for scenarios whose combination names none.
    start_profiles: Vec<String>,
    /// Sizes of the sides of the split.
    pub split: SplitFractions,
    /// All weathers that the file defines.
    pub weathers: BTreeMap<String, WeatherTable>,
    /// All flight profiles, built-in ones too.
    pub profiles: BTreeMap<String, ApproachProfile>,
    /// Other aircraft.
    pub traffic: Traffic,
    /// Rules for the scenarios that fly recordings.
    pub recorded: Vec<RecordedFlights>,
    /// For each combination the rule of [`Sweep::recorded`] that applies, if one matches.
    rule_of: Vec<Option<usize>>,
    /// The text of the file.
    pub text: String,
}

impl Sweep {
    /// Reads and checks a sweep. Paths in it are relative to its own folder.
    pub fn read(path: &Path) -> Result<Self, SweepError> {
        let text =
            outside_file::read_text(path, FileKind::SWEEP).map_err(SweepError::Unreadable)?;
        let folder = path.parent().map(PathBuf::from).unwrap_or_default();
        Ok(Self::parse(path, &folder, text)?)
    }

    /// Parses and checks a sweep; `path` is its name in messages, paths in it are relative to `folder`.
    pub fn parse(path: &Path, folder: &Path, text: String) -> Result<Self, TomlError> {
        let file = TomlFile::new(path, &text);
        let rejected = |fault: Fault| file.rejected(&fault.key, &fault.message);
        let tables: toml::Table = toml::from_str(&text).unwrap_or_default();
        let document = file
            .parse()
            .map_err(|error| weather::unsupported(&tables).map_or(error, rejected))?;
        check::check(document, tables, folder, &text).map_err(rejected)
    }

    /// The recording that each combination flies, if a rule matches: indices into [`Sweep::recorded`] and into its recordings.
    pub(crate) fn recording_of_each(&self) -> Vec<Option<(usize, usize)>> {
        let mut orders: BTreeMap<(usize, String), Vec<usize>> = BTreeMap::new();
        let pairs = self.combinations.iter().zip(&self.rule_of);
        pairs
            .map(|(combination, rule)| {
                let rule = (*rule)?;
                let order = orders
                    .entry((rule, combination.condition()))
                    .or_insert_with_key(|(rule, condition)| {
                        self.recorded[*rule].order_for(condition, self.corpus.seed)
                    });
                let turn = (combination.repeat as usize - 1) % order.len();
                Some((rule, order[turn]))
            })
            .collect()
    }

    /// The recording with this hash.
    pub(crate) fn recording(&self, blake3: &str) -> Option<&Recording> {
        let recordings = self.recorded.iter().flat_map(|flights| &flights.recordings);
        recordings
            .into_iter()
            .find(|recording| recording.blake3 == blake3)
    }

    /// A combination's profile: its own, or one drawn from `[start]`. A profile that is added to `[start]` is drawn by some scenarios and
    /// changes no other.
    pub(crate) fn profile_of<'a>(
        &'a self,
        combination: &'a Combination,
        scenario_seed: u64,
    ) -> &'a str {
        let drawn = || {
            self.start_profiles
                .iter()
                .max_by_key(|name| crate::seed::shuffle_key(scenario_seed, "profile", name))
        };
        combination
            .profile
            .as_ref()
            .or_else(drawn)
            .map_or("", String::as_str)
    }
}

#[cfg(test)]
pub(crate) mod tests;
