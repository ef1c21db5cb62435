//! Sweeps of a few short approaches to Changi 02L at noon.

/// What tests choose of a sweep.
#[derive(Debug, Clone, Copy)]
pub struct SmallSweep<'a> {
    /// Name of the corpus.
    pub name: &'a str,
    /// Its seed.
    pub seed: u32,
    /// Names of its weathers.
    pub weathers: &'a [&'a str],
    /// Scenarios of each weather.
    pub repeats: u32,
    /// Width and height of its pictures, pixels.
    pub size_px: (u32, u32),
    /// Its frame rate, as in TOML.
    pub frame_rate: &'a str,
    /// Its other tables: start, recordings, the weathers.
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
