//! Awkward behaviour of a live X-Plane that others measured or work around, and that a stand-in written from documents lacks.
//!
//! Input: a text such as `all,-late_clouds`. Output: a set that the parts of the stand-in query. Each quirk has a line in the table
//! below, with the source that reports it (and in `docs/reference/quirks.md`); it is implemented in the part of the world that it
//! concerns.

use std::fmt;
use std::str::FromStr;

use xplane_bridge::datarefs::Generation;

/// One awkward behaviour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs, reason = "the table describes each of them")]
pub enum Quirk {
    LateClouds,
    CloudBaseOff,
    SlidingTemperature,
    RegenerationFreeze,
    RegenerationRestoresPreset,
    PausedWeather,
    RealWeatherAtStart,
    CockpitView,
    LoadedC172,
    FarAway,
    SlowScenery,
    SettlingTerrain,
    MovingOrigin,
    DroppedStart,
    RestartingStart,
    CameraTaken,
    PopUps,
    AiAircraft,
    TwoCyclesPerLoop,
    CameraCallbackOrder,
    DrawBeforeIsOne,
    AltitudeHoldCaptures,
    ElectricMasterOff,
    ParticlesStopWhenPaused,
    StaleFrames,
    LateStartCrashes,
    WindInKnots,
    RegenerationNeeded,
    RegenerationNotNeeded,
    PauseKeepsPose,
    WaterMoves,
    WeatherMoves,
    SlowExposure,
    ScreenshotWithoutCamera,
}

/// Reliability of a report.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Grade {
    /// Measured on a running X-Plane of this version.
    Measured(&'static str),
    /// In Laminar's documents.
    Documented,
    /// Several clients work around it.
    Practised,
    /// One report.
    Single,
    /// No report.
    Unknown,
}

/// Description of a quirk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Facts {
    /// The quirk.
    pub quirk: Quirk,
    /// Its name on the command line.
    pub name: &'static str,
    /// Its effect, in a sentence.
    pub does: &'static str,
    /// Source of the report.
    pub source: &'static str,
    /// Reliability of the report.
    pub grade: Grade,
    /// True if clients that handle it take longer.
    pub costs_time: bool,
    /// True if X-Plane 11 has it as well as 12.
    pub in_11: bool,
}

/// All quirks, in the order of [`Quirk`].
pub const FACTS: [Facts; 34] = [
    Facts {
        quirk: Quirk::LateClouds,
        name: "late_clouds",
        does: "clouds read and show their old values in all slots for 55 s after the last of their writes, then all the new ones at once",
        source: "OIS",
        grade: Grade::Measured("12.4.3"),
        costs_time: true,
        in_11: false,
    },
    Facts {
        quirk: Quirk::CloudBaseOff,
        name: "cloud_base_off",
        does: "clouds settle 3.5 m above the base asked for",
        source: "EFB",
        grade: Grade::Single,
        costs_time: false,
        in_11: false,
    },
    Facts {
        quirk: Quirk::SlidingTemperature,
        name: "sliding_temperature",
        does: "for the first 150 s after the start, and after real weather, the temperature rises by 0.7 °C/s whatever is written",
        source: "OIS",
        grade: Grade::Measured("12.4.3"),
        costs_time: true,
        in_11: false,
    },
    Facts {
        quirk: Quirk::RegenerationFreeze,
        name: "regeneration_freeze",
        does: "`regen_weather` freezes the simulator for 3 s: no frame, no answer",
        source: "SF",
        grade: Grade::Measured("12.4"),
        costs_time: true,
        in_11: false,
    },
    Facts {
        quirk: Quirk::RegenerationRestoresPreset,
        name: "regeneration_restores_preset",
        does: "clouds and temperature that were written before `regen_weather` come back from the preset",
        source: "LARDON",
        grade: Grade::Measured("12.4.2"),
        costs_time: false,
        in_11: false,
    },
    Facts {
        quirk: Quirk::PausedWeather,
        name: "paused_weather",
        does: "in a pause the weather stands still: what was written comes into force when time runs again",
        source: "EFB",
        grade: Grade::Single,
        costs_time: false,
        in_11: false,
    },
    Facts {
        quirk: Quirk::RealWeatherAtStart,
        name: "real_weather_at_start",
        does: "real weather rules at the start and overwrites what is written until it is switched off",
        source: "OIS",
        grade: Grade::Measured("12.4.3"),
        costs_time: false,
        in_11: true,
    },
    Facts {
        quirk: Quirk::CockpitView,
        name: "cockpit_view",
        does: "the view begins in the cockpit, and a camera that is controlled from there shows its panel",
        source: "SDK, XPY, BP",
        grade: Grade::Documented,
        costs_time: false,
        in_11: true,
    },
    Facts {
        quirk: Quirk::LoadedC172,
        name: "loaded_c172",
        does: "the aircraft that happens to be loaded is a Cessna 172",
        source: "OIS, AFT",
        grade: Grade::Measured("12.4"),
        costs_time: false,
        in_11: true,
    },
    Facts {
        quirk: Quirk::FarAway,
        name: "far_away",
        does: "it stands 500 NM away from the airport",
        source: "OIS",
        grade: Grade::Measured("12.4.3"),
        costs_time: true,
        in_11: true,
    },
    Facts {
        quirk: Quirk::SlowScenery,
        name: "slow_scenery",
        does: "scenery of a new place loads for 20 s, without ground below until then",
        source: "SF",
        grade: Grade::Measured("12.4"),
        costs_time: true,
        in_11: true,
    },
    Facts {
        quirk: Quirk::SettlingTerrain,
        name: "settling_terrain",
        does: "the terrain settles by metres for 3 s after the loading flag has fallen",
        source: "SF",
        grade: Grade::Measured("12.4"),
        costs_time: true,
        in_11: true,
    },
    Facts {
        quirk: Quirk::MovingOrigin,
        name: "moving_origin",
        does: "the local origin moves while scenery loads, and `lat_ref`, `lon_ref` do not say where to",
        source: "OIS",
        grade: Grade::Measured("12.4.3"),
        costs_time: false,
        in_11: true,
    },
    Facts {
        quirk: Quirk::DroppedStart,
        name: "dropped_start",
        does: "the Web API closes the connection of a flight that it starts",
        source: "GL, AFT",
        grade: Grade::Measured("12.4"),
        costs_time: false,
        in_11: false,
    },
    Facts {
        quirk: Quirk::RestartingStart,
        name: "restarting_start",
        does: "a start that is repeated begins all over, scenery and all",
        source: "GL, AFT",
        grade: Grade::Measured("12.4"),
        costs_time: false,
        in_11: false,
    },
    Facts {
        quirk: Quirk::CameraTaken,
        name: "camera_taken",
        does: "the camera is taken from the plugin every 401 frames and by the screenshot command, and the view is the one from before",
        source: "CINE, BP",
        grade: Grade::Practised,
        costs_time: false,
        in_11: true,
    },
    Facts {
        quirk: Quirk::PopUps,
        name: "pop_ups",
        does: "a pop-up window lies over the picture at the start and after each start of a flight until it is closed",
        source: "LAAS, SISL, LC",
        grade: Grade::Practised,
        costs_time: false,
        in_11: true,
    },
    Facts {
        quirk: Quirk::AiAircraft,
        name: "ai_aircraft",
        does: "another aircraft flies beside the user's, again after each start of a flight, until a plugin has its number set to 1",
        source: "XPMP2, libxplanemp",
        grade: Grade::Practised,
        costs_time: false,
        in_11: true,
    },
    Facts {
        quirk: Quirk::TwoCyclesPerLoop,
        name: "two_cycles_per_loop",
        does: "`getCycleNumber` counts two for every flight loop, one of them before the camera callback",
        source: "XPY",
        grade: Grade::Single,
        costs_time: false,
        in_11: true,
    },
    Facts {
        quirk: Quirk::CameraCallbackOrder,
        name: "camera_callback_order",
        does: "the camera callback comes before the flight loops after the flight model in every other frame",
        source: "swift-project/pilotclient issue 67",
        grade: Grade::Single,
        costs_time: false,
        in_11: true,
    },
    Facts {
        quirk: Quirk::DrawBeforeIsOne,
        name: "draw_before_is_one",
        does: "a draw callback registered with 1 comes before its phase, one with 0 after it",
        source: "SDK",
        grade: Grade::Documented,
        costs_time: false,
        in_11: true,
    },
    Facts {
        quirk: Quirk::AltitudeHoldCaptures,
        name: "altitude_hold_captures",
        does: "`altitude_hold` dials the altitude of the moment, `vertical_speed` the vertical speed",
        source: "S76, AFT",
        grade: Grade::Measured("12"),
        costs_time: false,
        in_11: true,
    },
    Facts {
        quirk: Quirk::ElectricMasterOff,
        name: "electric_master_off",
        does: "the autopilot takes no command until its electric master is on",
        source: "S76",
        grade: Grade::Measured("12"),
        costs_time: false,
        in_11: true,
    },
    Facts {
        quirk: Quirk::ParticlesStopWhenPaused,
        name: "particles_stop_when_paused",
        does: "rain is not drawn in a pause",
        source: "LAAS, LARDON",
        grade: Grade::Measured("12"),
        costs_time: false,
        in_11: false,
    },
    Facts {
        quirk: Quirk::StaleFrames,
        name: "stale_frames",
        does: "the scene is 4 frames behind the pose and the camera that were written, or as many as `--scene-behind` says",
        source: "WPI, SISL, LXR, AFX",
        grade: Grade::Practised,
        costs_time: false,
        in_11: true,
    },
    Facts {
        quirk: Quirk::LateStartCrashes,
        name: "late_start_crashes",
        does: "a plugin that starts a flight outside a flight loop before the flight model crashes",
        source: "SDK, LC",
        grade: Grade::Documented,
        costs_time: false,
        in_11: true,
    },
    Facts {
        quirk: Quirk::WindInKnots,
        name: "wind_in_knots",
        does: "`wind_speed_msc` is in knots, whatever its name says",
        source: "SF against OIS, EFB",
        grade: Grade::Single,
        costs_time: false,
        in_11: false,
    },
    Facts {
        quirk: Quirk::RegenerationNeeded,
        name: "regeneration_needed",
        does: "without `regen_weather` written weather does not show, although the datarefs read back as written",
        source: "LARDON against SF",
        grade: Grade::Measured("12.4.2"),
        costs_time: false,
        in_11: false,
    },
    Facts {
        quirk: Quirk::RegenerationNotNeeded,
        name: "regeneration_not_needed",
        does: "clouds show as soon as they read back, without `regen_weather`",
        source: "OIS, EFB, LT against LARDON, LC",
        grade: Grade::Practised,
        costs_time: false,
        in_11: false,
    },
    Facts {
        quirk: Quirk::PauseKeepsPose,
        name: "pause_keeps_pose",
        does: "in a pause the picture keeps the pose and the camera that it had before",
        source: "EFB against WPI, LXR, AFX",
        grade: Grade::Single,
        costs_time: false,
        in_11: true,
    },
    Facts {
        quirk: Quirk::WaterMoves,
        name: "water_moves",
        does: "water in the foreground moves even in a pause",
        source: "no report",
        grade: Grade::Unknown,
        costs_time: false,
        in_11: true,
    },
    Facts {
        quirk: Quirk::WeatherMoves,
        name: "weather_moves",
        does: "while time runs clouds drift, and every frame has its own streaks of rain",
        source: "no report",
        grade: Grade::Unknown,
        costs_time: false,
        in_11: true,
    },
    Facts {
        quirk: Quirk::SlowExposure,
        name: "slow_exposure",
        does: "when the camera turns, the picture is too bright at first and settles within 30 frames",
        source: "no report",
        grade: Grade::Unknown,
        costs_time: false,
        in_11: true,
    },
    Facts {
        quirk: Quirk::ScreenshotWithoutCamera,
        name: "screenshot_without_camera",
        does: "the screenshot command takes the camera away before the frame that it keeps is drawn",
        source: "no report; CINE sees the camera go",
        grade: Grade::Unknown,
        costs_time: false,
        in_11: true,
    },
];

/// Contradicted or never reported: `dtd doctor` finds out which is true. Part of no group, each is enabled only by name.
pub const OPEN: [Quirk; 8] = [
    Quirk::WindInKnots,
    Quirk::RegenerationNeeded,
    Quirk::RegenerationNotNeeded,
    Quirk::PauseKeepsPose,
    Quirk::WaterMoves,
    Quirk::WeatherMoves,
    Quirk::SlowExposure,
    Quirk::ScreenshotWithoutCamera,
];

impl Quirk {
    /// Its description.
    pub const fn facts(self) -> &'static Facts {
        &FACTS[self as usize]
    }

    const fn bit(self) -> u64 {
        1 << self as u64
    }
}

impl fmt::Display for Grade {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Measured(version) => write!(f, "measured, {version}"),
            Self::Documented => f.write_str("documented"),
            Self::Practised => f.write_str("practised"),
            Self::Single => f.write_str("one report"),
            Self::Unknown => f.write_str("unknown"),
        }
    }
}

/// A set of quirks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Quirks(u64);

impl Quirks {
    /// None of them: a well-behaved simulator.
    pub const NONE: Self = Self(0);

    /// All that are not contradicted ([`OPEN`]).
    pub fn all() -> Self {
        Self::those(|facts| !OPEN.contains(&facts.quirk))
    }

    /// Those that do not slow clients down.
    pub fn quick() -> Self {
        Self::those(|facts| !facts.costs_time && !OPEN.contains(&facts.quirk))
    }

    /// The quirks that an X-Plane generation has.
    #[must_use]
    pub fn of(self, generation: Generation) -> Self {
        let has = Self::those(|facts| facts.in_11 || generation == Generation::XPlane12);
        Self(self.0 & has.0)
    }

    /// Duration of one second of a client's waiting if the simulator's clock runs this much faster: zero if none of the quirks makes
    /// clients wait.
    pub(crate) fn pace(self, clock_rate: f64) -> f64 {
        if self.iter().any(|quirk| quirk.facts().costs_time) {
            1.0 / clock_rate
        } else {
            0.0
        }
    }

    /// True if the quirk is in the set.
    pub const fn has(self, quirk: Quirk) -> bool {
        self.0 & quirk.bit() != 0
    }

    /// The set plus one.
    #[must_use]
    pub const fn with(self, quirk: Quirk) -> Self {
        Self(self.0 | quirk.bit())
    }

    /// The set minus one.
    #[must_use]
    pub const fn without(self, quirk: Quirk) -> Self {
        Self(self.0 & !quirk.bit())
    }

    /// Those in the set.
    pub fn iter(self) -> impl Iterator<Item = Quirk> {
        FACTS
            .iter()
            .map(|facts| facts.quirk)
            .filter(move |&quirk| self.has(quirk))
    }

    fn those(of: impl Fn(&Facts) -> bool) -> Self {
        FACTS
            .iter()
            .filter(|facts| of(facts))
            .fold(Self::NONE, |set, facts| set.with(facts.quirk))
    }
}

impl fmt::Display for Quirks {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if *self == Self::NONE {
            return f.write_str("none");
        }
        let names: Vec<&str> = self.iter().map(|quirk| quirk.facts().name).collect();
        f.write_str(&names.join(","))
    }
}

/// A text that names no quirks.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "unknown quirk {found:?}; expected all, none, quick, or names separated by commas, each with a - before it to exclude it: {}",
    names()
)]
pub struct UnknownQuirk {
    found: String,
}

fn names() -> String {
    FACTS.map(|facts| facts.name).join(", ")
}

impl FromStr for Quirks {
    type Err = UnknownQuirk;

    /// Reads `all`, `none`, `quick` (those that do not slow clients down), `late_clouds,far_away` or `all,-late_clouds`, from left
    /// to right.
    fn from_str(text: &str) -> Result<Self, UnknownQuirk> {
        text.split(',')
            .map(str::trim)
            .try_fold(Self::NONE, |set, word| {
                let (name, out) = match word.strip_prefix('-') {
                    Some(name) => (name, true),
                    None => (word, false),
                };
                let named = match name {
                    "all" => Self::all(),
                    "none" => Self::NONE,
                    "quick" => Self::quick(),
                    name => FACTS
                        .iter()
                        .find(|facts| facts.name == name)
                        .map(|facts| Self::NONE.with(facts.quirk))
                        .ok_or_else(|| UnknownQuirk { found: word.into() })?,
                };
                Ok(if out {
                    Self(set.0 & !named.0)
                } else {
                    Self(set.0 | named.0)
                })
            })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_has_each_quirk_at_its_place_and_once() {
        for (at, facts) in FACTS.iter().enumerate() {
            assert_eq!(facts.quirk as usize, at, "{}", facts.name);
            let alike = FACTS.iter().filter(|other| other.name == facts.name);
            assert_eq!(alike.count(), 1, "{}", facts.name);
        }
    }

    #[test]
    fn a_set_is_named_from_left_to_right_and_says_its_names() {
        let parse = |text: &str| text.parse::<Quirks>().unwrap();
        assert_eq!(parse("none"), Quirks::NONE);
        assert_eq!(parse("all").iter().count(), FACTS.len() - OPEN.len());
        assert!(parse("all,water_moves").has(Quirk::WaterMoves));
        let but_clouds = parse("all, -late_clouds");
        assert_eq!(but_clouds, Quirks::all().without(Quirk::LateClouds));
        let two = parse("far_away,late_clouds");
        assert_eq!(two.to_string(), "late_clouds,far_away");
        assert_eq!(parse(&two.to_string()), two);
        assert!(!parse("quick").has(Quirk::SlowScenery));
        assert!(parse("quick").has(Quirk::CockpitView));
        let error = "all,-late_cloud".parse::<Quirks>().unwrap_err().to_string();
        assert!(
            error.contains("\"-late_cloud\"") && error.contains("stale_frames"),
            "{error}"
        );
    }

    #[test]
    fn eleven_has_a_subset() {
        let eleven = Quirks::all().of(Generation::XPlane11);
        assert!(eleven.has(Quirk::CockpitView) && !eleven.has(Quirk::LateClouds));
        assert_eq!(Quirks::all().of(Generation::XPlane12), Quirks::all());
    }
}
