//! Awkward behaviour of a live X-Plane that others measured or work around, and that a stand-in written from documents lacks.
//!
//! Input: a text such as `all,-late_clouds`. Output: a set that the parts of the stand-in query. Each quirk has a line in the table
//! below, with the source that reports it (and in `docs/reference/quirks.md`); it is implemented in the part of the world that it
//! concerns.

use std::fmt;
use std::str::FromStr;

use xplane_bridge::datarefs::Generation;

/// Reliability of a quirk's report.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Grade {
    /// Measured on a running X-Plane of this version.
    Measured(&'static str),
    /// Stated in Laminar's documents.
    Documented,
    /// Several clients work around it.
    Practised,
    /// Reported once.
    Single,
    /// No report.
    Unknown,
}

/// Description of a quirk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Facts {
    /// The quirk.
    pub quirk: Quirk,
    /// Name on the command line.
    pub name: &'static str,
    /// The effect, in a sentence.
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

/// Defines [`Quirk`] and [`FACTS`] by a row for each: variant, name, source, grade, properties, effect.
macro_rules! quirks {
    ($($quirk:ident $name:ident $source:literal $grade:ident $(($version:literal))? [$($is:ident)*] $does:literal;)*) => {
        /// Awkward behaviour of a live X-Plane.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        #[allow(missing_docs, reason = "the table describes each of them")]
        pub enum Quirk {
            $($quirk,)*
        }

        /// All quirks, in the order of [`Quirk`].
        #[allow(clippy::needless_update, reason = "a row with both properties sets every field")]
        pub const FACTS: [Facts; 34] = [$(Facts {
            quirk: Quirk::$quirk,
            name: stringify!($name),
            does: $does,
            source: $source,
            grade: Grade::$grade$(($version))?,
            $($is: true,)*
            ..PLAIN
        }),*];
    };
}

/// A quirk without properties.
const PLAIN: Facts = Facts {
    quirk: Quirk::LateClouds,
    name: "",
    does: "",
    source: "",
    grade: Grade::Unknown,
    costs_time: false,
    in_11: false,
};

quirks! {
    LateClouds late_clouds "OIS" Measured("12.4.3") [costs_time]
        "clouds read and show their old values in all slots for 55 s after the last of their writes, then all the new ones at once";
    CloudBaseOff cloud_base_off "EFB" Single []
        "clouds settle 3.5 m above the base asked for";
    SlidingTemperature sliding_temperature "OIS" Measured("12.4.3") [costs_time]
        "for the first 150 s after the start, and after real weather, the temperature rises by 0.7 °C/s whatever is written";
    RegenerationFreeze regeneration_freeze "SF" Measured("12.4") [costs_time]
        "`regen_weather` freezes the simulator for 3 s: no frame, no answer";
    RegenerationRestoresPreset regeneration_restores_preset "LARDON" Measured("12.4.2") []
        "clouds and temperature that were written before `regen_weather` come back from the preset";
    PausedWeather paused_weather "EFB" Single []
        "in a pause the weather stands still: what was written comes into force when time runs again";
    RealWeatherAtStart real_weather_at_start "OIS" Measured("12.4.3") [in_11]
        "real weather rules at the start and overwrites what is written until it is switched off";
    CockpitView cockpit_view "SDK, XPY, BP" Documented [in_11]
        "the view begins in the cockpit, and a camera that is controlled from there shows its panel";
    LoadedC172 loaded_c172 "OIS, AFT" Measured("12.4") [in_11]
        "the aircraft that happens to be loaded is a Cessna 172";
    FarAway far_away "OIS" Measured("12.4.3") [costs_time in_11]
        "it stands 500 NM away from the airport";
    SlowScenery slow_scenery "SF" Measured("12.4") [costs_time in_11]
        "scenery of a new place loads for 20 s, without ground below until then";
    SettlingTerrain settling_terrain "SF" Measured("12.4") [costs_time in_11]
        "the terrain settles by metres for 3 s after the loading flag has fallen";
    MovingOrigin moving_origin "OIS" Measured("12.4.3") [in_11]
        "the local origin moves while scenery loads, and `lat_ref`, `lon_ref` do not say where to";
    DroppedStart dropped_start "GL, AFT" Measured("12.4") []
        "the Web API closes the connection of a flight that it starts";
    RestartingStart restarting_start "GL, AFT" Measured("12.4") []
        "a start that is repeated begins all over, scenery and all";
    CameraTaken camera_taken "CINE, BP" Practised [in_11]
        "the camera is taken from the plugin every 401 frames, and the view is the one from before";
    PopUps pop_ups "LAAS, SISL, LC" Practised [in_11]
        "a pop-up window lies over the image at the start and after each start of a flight until it is closed";
    AiAircraft ai_aircraft "XPMP2, libxplanemp" Practised [in_11]
        "another aircraft flies beside the user's, again after each start of a flight, until a plugin has its number set to 1";
    TwoCyclesPerLoop two_cycles_per_loop "XPY" Single [in_11]
        "`getCycleNumber` counts two for every flight loop, one of them before the camera callback";
    CameraCallbackOrder camera_callback_order "swift-project/pilotclient issue 67" Single [in_11]
        "the camera callback comes before the flight loops after the flight model in every other frame";
    DrawBeforeIsOne draw_before_is_one "SDK" Documented [in_11]
        "a draw callback registered with 1 comes before its phase, one with 0 after it";
    AltitudeHoldCaptures altitude_hold_captures "S76, AFT" Measured("12") [in_11]
        "`altitude_hold` dials the altitude of the moment, `vertical_speed` the vertical speed";
    ElectricMasterOff electric_master_off "S76" Measured("12") [in_11]
        "the autopilot takes no command until its electric master is on";
    ParticlesStopWhenPaused particles_stop_when_paused "LAAS, LARDON" Measured("12") []
        "rain is not drawn in a pause";
    StaleFrames stale_frames "WPI, SISL, LXR, AFX" Practised [in_11]
        "the scene is 4 frames behind the pose and the camera that were written";
    LateStartCrashes late_start_crashes "SDK, LC" Documented [in_11]
        "a plugin that starts a flight outside a flight loop before the flight model crashes";
    WindInKnots wind_in_knots "SF against OIS, EFB" Single []
        "`wind_speed_msc` is in knots, whatever its name says";
    RegenerationNeeded regeneration_needed "LARDON against SF" Measured("12.4.2") []
        "without `regen_weather` written weather does not show, although the datarefs read back as written";
    PauseKeepsPose pause_keeps_pose "EFB against WPI, LXR, AFX" Single [in_11]
        "in a pause the image keeps the pose and the camera that it had before";
    WaterMoves water_moves "no report" Unknown [in_11]
        "water in the foreground moves even in a pause";
    WeatherMoves weather_moves "no report" Unknown [in_11]
        "while time runs clouds drift, and every frame has its own streaks of rain";
    SlowExposure slow_exposure "no report" Unknown [in_11]
        "when the camera turns, the image is too bright at first and settles within 30 frames";
    LaggingParts lagging_parts "no report" Unknown [in_11]
        "flaps, gear and its lamps are drawn as they were written for the frame before";
    FixedParts fixed_parts "XPlaneConnect issue 213" Single [in_11]
        "flaps and gear stay up, whatever is written";
}

/// Contradicted or never reported: `dtd doctor` finds out which is true, or `dtd generate` works with both. Part of no
/// group, each is enabled only by name.
pub const OPEN: [Quirk; 8] = [
    Quirk::WindInKnots,
    Quirk::RegenerationNeeded,
    Quirk::PauseKeepsPose,
    Quirk::WaterMoves,
    Quirk::WeatherMoves,
    Quirk::SlowExposure,
    Quirk::LaggingParts,
    Quirk::FixedParts,
];

impl Quirk {
    /// The quirk's description.
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
    /// No quirks: a well-behaved simulator.
    pub const NONE: Self = Self(0);

    /// All that are not contradicted ([`OPEN`]).
    pub fn all() -> Self {
        Self::those(|facts| !OPEN.contains(&facts.quirk))
    }

    /// Quirks that do not slow clients down.
    pub fn quick() -> Self {
        Self::those(|facts| !facts.costs_time && !OPEN.contains(&facts.quirk))
    }

    /// The quirks that an X-Plane generation has.
    #[must_use]
    pub fn of(self, generation: Generation) -> Self {
        let has = Self::those(|facts| facts.in_11 || generation == Generation::XPlane12);
        Self(self.0 & has.0)
    }

    /// Real duration of a client's second of waiting if the simulator's clock runs this much faster; zero if no quirk makes clients wait.
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

    /// The quirks in the set.
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
    "unknown quirk {found:?}{nearest}; expected all, none, quick, or names from docs/reference/quirks.md separated by commas, each with a \
     - before it to exclude it"
)]
pub struct UnknownQuirk {
    found: String,
    /// Words for the nearest name, if one is near.
    nearest: String,
}

/// Minimum likeness (Jaro and Winkler, 0 to 1) at which a name is suggested for an unknown one.
const MIN_LIKENESS: f64 = 0.7;

impl UnknownQuirk {
    fn new(word: &str, name: &str) -> Self {
        let likeness = |quirk: &str| strsim::jaro_winkler(quirk, name);
        let names = FACTS.iter().map(|facts| facts.name);
        let nearest = (names.filter(|quirk| likeness(quirk) > MIN_LIKENESS))
            .max_by(|a, b| likeness(a).total_cmp(&likeness(b)));
        Self {
            found: word.into(),
            nearest: nearest.map_or_else(String::new, |quirk| format!(", the nearest is {quirk}")),
        }
    }
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
                        .ok_or_else(|| UnknownQuirk::new(word, name))?,
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
            error.contains("\"-late_cloud\", the nearest is late_clouds;"),
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
