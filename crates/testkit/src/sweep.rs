//! Small sweeps: a few short approaches to Changi 02L at noon.

use crate::repository;

/// The parts of a sweep that tests choose.
#[derive(Debug, Clone, Copy)]
pub struct SmallSweep<'a> {
    /// Name of the corpus.
    pub name: &'a str,
    /// Random seed.
    pub seed: u32,
    /// Weather names.
    pub weathers: &'a [&'a str],
    /// Scenarios of each weather.
    pub repeats: u32,
    /// Image width and height, pixels.
    pub size_px: (u32, u32),
    /// Frame rate, as in TOML.
    pub frame_rate: &'a str,
    /// All other tables: start, recordings, the weathers.
    pub tables: &'a str,
}

/// The start of live flights from 2 NM.
pub const FROM_2_NM: &str = r#"
[start]
dtd_nm = { min = 1.9, max = 2.1 }
cross_track_m = { mean = 0, sd = 20 }
speed_mps = 72
profiles = ["short"]

[profile.short]
kind = "glide_path"
level_altitude_msl_m = 200
"#;

/// [`FROM_2_NM`] with a different range of distances, nautical miles, and height, metres.
pub fn starting_from(least_nm: f64, most_nm: f64, altitude_msl_m: u32) -> String {
    FROM_2_NM
        .replace(
            "min = 1.9, max = 2.1",
            &format!("min = {least_nm}, max = {most_nm}"),
        )
        .replace(
            "level_altitude_msl_m = 200",
            &format!("level_altitude_msl_m = {altitude_msl_m}"),
        )
}

/// Four weathers; the last has rain.
pub const FOUR_WEATHERS: &str = r#"
[weather.clear]
visibility_m = 80000
wind_speed_mps = 4
wind_from_true_deg = 60

[weather.cloudy]
visibility_m = 50000
clouds = [{ kind = "cumulus", cover_ratio = 0.5, base_msl_m = 900, top_msl_m = 2000 }]

[weather.foggy]
visibility_m = 9260

[weather.stormy]
visibility_m = 35000
clouds = [{ kind = "cumulonimbus", cover_ratio = 0.9, base_msl_m = 600, top_msl_m = 5000 }]
rain_ratio = 0.6
wind_speed_mps = 9
wind_from_true_deg = 340
"#;
/// Names of the weathers.
pub const WEATHER_NAMES: [&str; 4] = ["clear", "cloudy", "foggy", "stormy"];

/// Two short approaches in front of three views, one of them with a lens, in refracting air, at 30000/1001 images per second.
pub const THREE_VIEWS: &str = r#"
[corpus]
name = "three-views"
seed = 3

[approach]
airport = "WSSS"
runway = "02L"
aircraft = "B737-800"
rig = "three"

[[rig.three.cameras]]
id = "lens"
beyond_touchdown_m = 1200
right_m = 300
height_m = 40
inward_deg = 3
pitch_deg = 1.5
hfov_deg = 60
distortion = { k1 = -0.25, k2 = 0.06, p1 = 0.001, p2 = -0.0005 }

[[rig.three.cameras]]
id = "mast"
beyond_touchdown_m = 1200
right_m = -300
height_m = 10
inward_deg = 0
pitch_deg = 1.6
hfov_deg = 20

[[rig.three.cameras]]
id = "tower_2"
beyond_touchdown_m = 900
right_m = 500
height_m = 60
inward_deg = 20
pitch_deg = 0
hfov_deg = 40

[grid]
times = ["12:00"]
weathers = ["clear"]
repeats = 2
day_of_year = 172
utc_offset_h = 8

[imaging]
refraction_coefficient = 0.13

[picture]
width_px = 160
height_px = 96
frame_rate = "30000/1001"

[start]
dtd_nm = 0.5
speed_mps = 72
profiles = ["short"]

[profile.short]
kind = "glide_path"
level_altitude_msl_m = 200

[weather.clear]
visibility_m = 80000
wind_speed_mps = 2
wind_from_true_deg = 20
"#;

/// The sweep file for four weathers over a recorded flight, in tiny images: `1200-clear-r1`, and so on.
pub fn four_weathers() -> String {
    let flight = repository().join("tests/data/flights/01_calm_ils.csv");
    let tables = format!(
        r#"
[[recorded]]
files = "{}"
weathers = {WEATHER_NAMES:?}

[start]
dtd_nm = 0.6
{FOUR_WEATHERS}"#,
        flight.display()
    );
    let sweep = SmallSweep {
        name: "weathers",
        seed: 5,
        weathers: &WEATHER_NAMES,
        repeats: 1,
        size_px: (96, 64),
        frame_rate: "1/2",
        tables: &tables,
    };
    sweep.toml()
}

impl SmallSweep<'_> {
    /// The sweep's file.
    pub fn toml(&self) -> String {
        let Self {
            name,
            seed,
            weathers,
            repeats,
            size_px: (width_px, height_px),
            frame_rate,
            tables,
        } = self;
        format!(
            r#"
[corpus]
name = "{name}"
seed = {seed}

[approach]
airport = "WSSS"
runway = "02L"
aircraft = "B737-800"
rig = "wide-baseline"

[grid]
times = ["12:00"]
weathers = {weathers:?}
repeats = {repeats}
day_of_year = 172
utc_offset_h = 8

[picture]
width_px = {width_px}
height_px = {height_px}
frame_rate = "{frame_rate}"
{tables}"#
        )
    }
}
