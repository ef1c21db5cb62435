//! The form of a sweep file, table by table. Unknown keys are refused everywhere.

use std::collections::BTreeMap;

use dataset::conditions::Weather;
use dataset::frame_rate::FrameRate;
use dataset::geodesy::Geodetic;
use dataset::video::VideoSettings;
use serde::{Deserialize, Serialize};
use xplane_bridge::fly::ApproachProfile;

use super::frame_rate_text;
use crate::spread::Spread;

/// The whole file.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Document {
    pub(super) corpus: Corpus,
    pub(super) approach: Approach,
    pub(super) grid: Grid,
    pub(super) picture: Picture,
    #[serde(default)]
    pub(super) video: VideoSettings,
    #[serde(default)]
    pub(super) start: Start,
    #[serde(default)]
    pub(super) split: SplitFractions,
    pub(super) weather: BTreeMap<String, Weather>,
    pub(super) rig: BTreeMap<String, Rig>,
    #[serde(default)]
    pub(super) profile: BTreeMap<String, ApproachProfile>,
    #[serde(default)]
    pub(super) airport: BTreeMap<String, AirportTable>,
    #[serde(default)]
    pub(super) recorded: Vec<RecordedRule>,
}

/// `[corpus]`
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Corpus {
    /// What people call it.
    pub name: String,
    /// Master seed: every scenario's seed follows from this and the scenario's identifier. 0 is a seed like any other.
    pub seed: u64,
}

/// `[approach]`
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Approach {
    pub(super) airport: String,
    pub(super) runway: String,
    pub(super) aircraft: String,
    pub(super) rig: String,
}

/// `[grid]`: every time is combined with every weather, `repeats` times.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Grid {
    /// Local times, `HH:MM`.
    pub times: Vec<String>,
    /// Names of weathers that the file defines.
    pub weathers: Vec<String>,
    /// How often each combination is flown, each time with another seed.
    pub repeats: u32,
    /// Day of the year, 1 to 365; it sets the sun's path.
    pub day_of_year: u32,
    /// Local time minus UTC, hours.
    pub utc_offset_h: f64,
}

/// `[picture]`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Picture {
    /// Width, pixels.
    pub width_px: u32,
    /// Height, pixels.
    pub height_px: u32,
    /// Pictures per second of flight.
    #[serde(with = "frame_rate_text")]
    pub frame_rate: FrameRate,
}

/// `[start]`: where and how live flights begin. Each value is a number or a spread to draw from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Start {
    /// Distance to the touchdown target along the course, nautical miles. Recorded flights are cut there too.
    pub dtd_nm: Spread,
    /// Offset right of the extended centreline, metres.
    pub cross_track_m: Spread,
    /// Height above the altitude at which the profile begins, metres.
    pub above_profile_m: Spread,
    /// Heading right of the course, degrees.
    pub heading_offset_deg: Spread,
    /// True airspeed, metres per second.
    pub speed_mps: Spread,
    /// Names of the profiles to draw from, all equally likely.
    pub profiles: Vec<String>,
}

/// Name of the profile that is always defined: level at 2500 ft, then down the glide path.
pub(super) const DEFAULT_PROFILE: &str = "level-then-glide-path";

impl Default for Start {
    fn default() -> Self {
        Self {
            dtd_nm: Spread::Fixed(10.0),
            cross_track_m: Spread::Fixed(0.0),
            above_profile_m: Spread::Fixed(0.0),
            heading_offset_deg: Spread::Fixed(0.0),
            speed_mps: Spread::Fixed(82.0),
            profiles: vec![DEFAULT_PROFILE.into()],
        }
    }
}

/// `[split]`: parts of the scenarios on each side; they add up to 1. Scenarios with the same trajectory stay together.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SplitFractions {
    /// What networks learn from.
    pub train: f64,
    /// What decisions during training look at.
    pub validation: f64,
    /// What only evaluation looks at.
    pub test: f64,
}

impl Default for SplitFractions {
    fn default() -> Self {
        Self {
            train: 0.6,
            validation: 0.1,
            test: 0.3,
        }
    }
}

/// `[rig.NAME]`
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Rig {
    pub(super) cameras: Vec<Camera>,
}

/// `[[rig.NAME.cameras]]`: a camera on a mast beside the runway.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// Identifier of the view: names its video and its columns.
    pub id: String,
    /// Distance past the touchdown target along the landing course, metres. Either this or `beyond_threshold_m`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub beyond_touchdown_m: Option<f64>,
    /// Distance past the threshold along the landing course, metres: stays where it is if the touchdown target is moved.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub beyond_threshold_m: Option<f64>,
    /// Offset right of the landing course, metres; negative is left.
    pub right_m: f64,
    /// Height above the touchdown target, metres.
    pub height_m: f64,
    /// Turn of the optical axis from the reciprocal of the course towards the runway's axis, degrees. Either this or `heading_true_deg`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub inward_deg: Option<f64>,
    /// Direction of the optical axis, degrees true.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub heading_true_deg: Option<f64>,
    /// Elevation of the optical axis, degrees, up positive.
    pub pitch_deg: f64,
    /// Horizontal field of view, degrees.
    pub hfov_deg: f64,
}

/// `[airport.ICAO]`
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct AirportTable {
    pub(super) runway: BTreeMap<String, RunwayTable>,
}

/// `[airport.ICAO.runway.NAME]`: a runway, or what differs from the one that the program knows under this name.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RunwayTable {
    pub(super) threshold: Option<Geodetic>,
    pub(super) course_true_deg: Option<f64>,
    pub(super) glide_path_deg: Option<f64>,
    pub(super) touchdown_past_threshold_m: Option<f64>,
    pub(super) ils_frequency_mhz: Option<f64>,
    pub(super) course_magnetic_deg: Option<f64>,
}

/// `[[recorded]]`: scenarios that fly recordings instead of the simulator's own flight model. The first rule that fits a scenario
/// decides; a rule without `times`, `weathers` and `repeats` fits all.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordedRule {
    /// A CSV file, or several with `*` in the file name; relative to the sweep. They are flown in turn.
    pub files: String,
    /// Only scenarios at these times.
    #[serde(default)]
    pub times: Vec<String>,
    /// Only scenarios in these weathers.
    #[serde(default)]
    pub weathers: Vec<String>,
    /// Only these repeats, counted from 1.
    #[serde(default)]
    pub repeats: Vec<u32>,
}
