//! Structure of sweep files, table by table. Unknown keys are rejected everywhere.

use std::collections::BTreeMap;

use dataset::video::VideoSettings;
use schemars::{JsonSchema, Schema};
use serde::{Deserialize, Serialize};

use super::aircraft::AircraftTable;
use super::check::fault::NAME_PATTERN;
use super::grid::split::SplitFractions;
use super::grid::{Grid, Include, Selection};
use super::imaging::ImagingTable;
use super::picture::PictureTable;
use super::rigs::Rig;
use super::rigs::aim::AimTable;
use super::rigs::jitter::JitterTable;
use super::runways::AirportTable;
use super::start::Start;
use super::start::profiles::ProfileTable;
use super::start::recorded::RecordedRule;
use super::traffic::TrafficTable;
use super::weather::WeatherTable;

/// A sweep: which scenarios a corpus contains. `docs/reference/sweep-settings.md` lists every key.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Document {
    pub(super) corpus: Corpus,
    pub(super) approach: Approach,
    pub(super) grid: Grid,
    #[serde(default)]
    pub(super) exclude: Vec<Selection>,
    #[serde(default)]
    pub(super) include: Vec<Include>,
    pub(super) picture: PictureTable,
    #[serde(default)]
    pub(super) video: VideoSettings,
    #[serde(default)]
    #[schemars(default)]
    pub(super) start: Start,
    #[serde(default)]
    #[schemars(default)]
    pub(super) split: SplitFractions,
    /// Weathers by name.
    #[schemars(transform = legal_names, extend("minProperties" = 1))]
    pub(super) weather: BTreeMap<String, WeatherTable>,
    /// Camera rigs by name; `wide-baseline` and `seed` need no definition.
    #[serde(default)]
    #[schemars(transform = legal_names)]
    pub(super) rig: BTreeMap<String, Rig>,
    /// Flight profiles by name; `level-then-glide-path`, `step-down` and `continuous` need no definition.
    #[serde(default)]
    #[schemars(transform = legal_names)]
    pub(super) profile: BTreeMap<String, ProfileTable>,
    /// Airports by ICAO code; the ones in `generator/src/airports.toml` need no definition.
    #[serde(default)]
    pub(super) airport: BTreeMap<String, AirportTable>,
    #[serde(default)]
    pub(super) recorded: Vec<RecordedRule>,
    #[serde(default)]
    pub(super) traffic: Vec<TrafficTable>,
    #[serde(default)]
    pub(super) aim: Option<AimTable>,
    #[serde(default)]
    pub(super) jitter: Option<JitterTable>,
    #[serde(default)]
    pub(super) imaging: Option<ImagingTable>,
}

/// `[corpus]`
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Corpus {
    /// Name of the corpus.
    #[schemars(length(min = 1))]
    pub name: String,
    /// Master seed: every scenario's seed follows from this and the scenario's identifier. 0 is an ordinary seed.
    pub seed: u64,
}

/// `[approach]`: one runway and one rig for the whole corpus, since distances refer to its touchdown target and networks belong to
/// its cameras. A rig may have any number of cameras.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Approach {
    /// ICAO code of the airport.
    pub(super) airport: String,
    /// Designator of the runway, e.g. `02L`.
    pub(super) runway: String,
    /// Aircraft type by name or ICAO designator, or `{ one_of = [..] }`: types of which each scenario draws one. `dtd aircraft` lists
    /// them.
    pub(super) aircraft: AircraftTable,
    /// Name of the rig: one that the file defines, or a built-in one.
    #[schemars(regex(pattern = NAME_PATTERN))]
    pub(super) rig: String,
}

fn legal_names(schema: &mut Schema) {
    schema.insert(
        "propertyNames".into(),
        serde_json::json!({ "pattern": NAME_PATTERN }),
    );
}
