//! The datarefs of X-Plane that we use, and the only place where SI turns into X-Plane's units and back.
//!
//! In: conditions and runways in SI. Out: lists of dataref writes. Names and units differ between X-Plane 11 and 12 for the
//! weather alone. Weather outlives a run in the simulator, so every parameter is always written, never only those
//! that changed: unused cloud layers are written as empty, every wind layer carries the same wind.

use dataset::conditions::{Clock, CloudKind, CloudLayer, Conditions, Weather};
use dataset::runway::Runway;
use dataset::units::MPS_PER_KNOT;

use crate::error::BridgeError;

/// Metres in one statute mile (exact by definition). X-Plane 12 measures visibility in them.
pub const METERS_PER_STATUTE_MILE: f64 = 1_609.344;
/// Layers of cloud that X-Plane has.
pub const CLOUD_LAYERS: usize = 3;
/// Layers of wind that X-Plane 12 has.
pub const WIND_LAYERS: usize = 13;

/// Version of the simulator as one number, 120400 for 12.4.0.
pub const VERSION: &str = "sim/version/xplane_internal_version";
/// Ours: TCP port of the capture link, 0 while it does not listen. Published by the plugin and by the stand-in.
pub const CAPTURE_PORT: &str = "dtd/bridge/capture_port";
/// Ours: how long the weather takes to show after it was regenerated, seconds. Published with [`CAPTURE_PORT`].
pub const WEATHER_SETTLE_S: &str = "dtd/bridge/weather_settle_s";

/// Seconds since midnight UTC. Runs on while the simulator is not frozen.
pub const ZULU_TIME_S: &str = "sim/time/zulu_time_sec";
/// Days since 1 January, 0 to 364.
pub const DATE_DAYS: &str = "sim/time/local_date_days";
/// 1 makes the simulator's clock follow the computer's, and every write to it void.
pub const USE_SYSTEM_TIME: &str = "sim/time/use_system_time";

/// Seconds since the simulator was started: smaller than before means another run of it.
pub const RUNNING_TIME_S: &str = "sim/time/total_running_time_sec";
/// 1 while the simulator's time stands still. Read-only: [`COMMAND_PAUSE_ON`] and [`COMMAND_PAUSE_OFF`] change it.
pub const PAUSED: &str = "sim/time/paused";
/// Type designator of the user's aircraft, one character per element.
pub const AIRCRAFT_ICAO: &str = "sim/aircraft/view/acf_ICAO";
/// Indicated airspeed, knots. Reads zero for a while after a start in the air.
pub const INDICATED_AIRSPEED_KT: &str = "sim/flightmodel/position/indicated_airspeed";

/// Element 0 set to 1 stops the flight model of the user's aircraft.
pub const OVERRIDE_FLIGHT_MODEL: &str = "sim/operation/override/override_planepath[0]";

/// X-Plane 12: visibility, statute miles.
pub const VISIBILITY_SM: &str = "sim/weather/region/visibility_reported_sm";
/// X-Plane 12: rain, 0 to 1.
pub const RAIN: &str = "sim/weather/region/rain_percent";
/// X-Plane 12, per cloud layer: 0 cirrus, 1 stratus, 2 cumulus, 3 cumulonimbus.
pub const CLOUD_TYPE: &str = "sim/weather/region/cloud_type";
/// X-Plane 12, per cloud layer: cover, 0 to 1.
pub const CLOUD_COVER: &str = "sim/weather/region/cloud_coverage_percent";
/// X-Plane 12, per cloud layer: base above mean sea level, metres.
pub const CLOUD_BASE: &str = "sim/weather/region/cloud_base_msl_m";
/// X-Plane 12, per cloud layer: top above mean sea level, metres.
pub const CLOUD_TOP: &str = "sim/weather/region/cloud_tops_msl_m";
/// X-Plane 12, per wind layer: its height above mean sea level, metres.
pub const WIND_ALTITUDE: &str = "sim/weather/region/wind_altitude_msl_m";
/// X-Plane 12, per wind layer: speed, metres per second.
pub const WIND_SPEED: &str = "sim/weather/region/wind_speed_msc";
/// X-Plane 12, per wind layer: where it comes from, degrees true.
pub const WIND_DIRECTION: &str = "sim/weather/region/wind_direction_degt";
/// X-Plane 12, per wind layer: turbulence, 0 to 10.
pub const TURBULENCE: &str = "sim/weather/region/turbulence";
/// X-Plane 12, per wind layer: gust above the wind, metres per second.
pub const SHEAR_SPEED: &str = "sim/weather/region/shear_speed_msc";
/// X-Plane 12, per wind layer: change of direction in a gust, degrees.
pub const SHEAR_DIRECTION: &str = "sim/weather/region/shear_direction_degt";
/// X-Plane 12: how the weather changes; 3 is not at all.
pub const CHANGE_MODE: &str = "sim/weather/region/change_mode";
/// X-Plane 12: variation over the region, 0 to 1.
pub const VARIABILITY: &str = "sim/weather/region/variability_pct";
/// X-Plane 12: 1 applies everything but the clouds at once.
pub const UPDATE_IMMEDIATELY: &str = "sim/weather/region/update_immediately";
/// X-Plane 12: temperature at sea level, degrees Celsius.
pub const TEMPERATURE_C: &str = "sim/weather/region/sealevel_temperature_c";
/// X-Plane 12: pressure at sea level, pascal.
pub const PRESSURE_PA: &str = "sim/weather/region/sealevel_pressure_pas";
/// X-Plane 12: climb rate of thermals, metres per second.
pub const THERMALS: &str = "sim/weather/region/thermal_rate_ms";

/// Frequency of the first navigation receiver, units of 10 kHz: 11090 is 110.90 MHz.
pub const NAV1_FREQUENCY: &str = "sim/cockpit/radios/nav1_freq_hz";
/// Course set on the first navigation receiver, degrees **magnetic**.
pub const NAV1_COURSE_MAGNETIC: &str = "sim/cockpit/radios/nav1_obs_degm";
/// 0 off, 1 flight director, 2 autopilot flies.
pub const AUTOPILOT_MODE: &str = "sim/cockpit/autopilot/autopilot_mode";

/// Rebuilds the weather from its datarefs.
pub const COMMAND_REGENERATE_WEATHER: &str = "sim/operation/regen_weather";
/// Lets the simulator's time run.
pub const COMMAND_PAUSE_OFF: &str = "sim/operation/pause_off";
/// Stops the simulator's time.
pub const COMMAND_PAUSE_ON: &str = "sim/operation/pause_on";
/// Engages the autopilot's servos.
pub const COMMAND_SERVOS_ON: &str = "sim/autopilot/servos_on";
/// Engages the autothrottle.
pub const COMMAND_AUTOTHROTTLE_ON: &str = "sim/autopilot/autothrottle_on";
/// The autopilot's button for a radio's course, the localizer's among them.
pub const COMMAND_NAV: &str = "sim/autopilot/NAV";
/// The autopilot's button for the glide slope.
pub const COMMAND_GLIDE_SLOPE: &str = "sim/autopilot/glide_slope";
/// The autopilot's button for localizer and glide slope together.
pub const COMMAND_APPROACH: &str = "sim/autopilot/approach";
/// Autothrottle: above zero while it works.
pub const AUTOTHROTTLE: &str = "sim/cockpit2/autopilot/autothrottle_enabled";
/// Radio's course: 0 off, 1 armed, 2 captured.
pub const NAV_STATUS: &str = "sim/cockpit2/autopilot/nav_status";
/// Glide slope: 0 off, 1 armed, 2 captured.
pub const GLIDE_SLOPE_STATUS: &str = "sim/cockpit2/autopilot/glideslope_status";
/// Localizer and glide slope together: 0 off, 1 armed, 2 captured.
pub const APPROACH_STATUS: &str = "sim/cockpit2/autopilot/approach_status";

/// Something of the autopilot that an approach needs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AutopilotSwitch {
    /// The command that switches it on. Most are buttons, which switch off what is on.
    pub command: &'static str,
    /// On while each dataref of one of these has at least its value.
    pub on_while: &'static [&'static [(&'static str, f32)]],
}

impl AutopilotSwitch {
    /// Whether it is on, by what datarefs read; `None` if too few could be read to say.
    pub fn is_on(&self, read: impl Fn(&str) -> Option<f32>) -> Option<bool> {
        let mut all_known = true;
        for states in self.on_while {
            let mut holds = Some(true);
            for (name, least) in *states {
                match read(name) {
                    Some(value) if value >= *least => {}
                    Some(_) => holds = Some(false),
                    None => holds = holds.filter(|holds| !holds),
                }
            }
            match holds {
                Some(true) => return Some(true),
                Some(false) => {}
                None => all_known = false,
            }
        }
        all_known.then_some(false)
    }

    /// All datarefs that say whether it is on.
    pub fn datarefs(&self) -> impl Iterator<Item = &'static str> {
        self.on_while
            .iter()
            .flat_map(|states| states.iter().map(|(name, _)| *name))
    }
}

/// What engages an approach on the autopilot, in order: by the button for localizer and glide slope, and whichever of the two does
/// not show then by its own.
pub const APPROACH_SWITCHES: [AutopilotSwitch; 5] = [
    AutopilotSwitch {
        command: COMMAND_SERVOS_ON,
        on_while: &[&[(AUTOPILOT_MODE, 2.0)]],
    },
    AutopilotSwitch {
        command: COMMAND_AUTOTHROTTLE_ON,
        on_while: &[&[(AUTOTHROTTLE, 1.0)]],
    },
    AutopilotSwitch {
        command: COMMAND_APPROACH,
        on_while: &[
            &[(APPROACH_STATUS, 1.0)],
            &[(NAV_STATUS, 1.0), (GLIDE_SLOPE_STATUS, 1.0)],
        ],
    },
    AutopilotSwitch {
        command: COMMAND_NAV,
        on_while: &[&[(NAV_STATUS, 1.0)], &[(APPROACH_STATUS, 1.0)]],
    },
    AutopilotSwitch {
        command: COMMAND_GLIDE_SLOPE,
        on_while: &[&[(GLIDE_SLOPE_STATUS, 1.0)]],
    },
];

/// What we write without a source that we could call certain: taken from X-Plane's own list of datarefs, seen nowhere else.
/// All others are in Laminar's articles or in clients that work. Nothing here was tried on a running X-Plane.
pub const UNCONFIRMED: [&str; 14] = [
    TEMPERATURE_C,
    PRESSURE_PA,
    THERMALS,
    TURBULENCE,
    SHEAR_SPEED,
    SHEAR_DIRECTION,
    "sim/weather/thermal_percent",
    "sim/weather/thermal_rate_ms",
    "sim/weather/cloud_coverage",
    "sim/weather/temperature_sealevel_c",
    "sim/weather/barometer_sealevel_inhg",
    "sim/weather/turbulence",
    "sim/weather/shear_speed_kt",
    "sim/weather/shear_direction_degt",
];

/// Heights of the wind layers that we write, metres above mean sea level: dense where approaches are flown.
pub(crate) const WIND_ALTITUDES_MSL_M: [f64; WIND_LAYERS] = [
    0.0, 300.0, 600.0, 1_000.0, 1_500.0, 2_000.0, 3_000.0, 4_200.0, 5_600.0, 7_200.0, 9_200.0,
    10_400.0, 11_800.0,
];
/// International standard atmosphere at sea level. No figure of a scenario depends on it.
pub(crate) const STANDARD_TEMPERATURE_C: f64 = 15.0;
/// International standard atmosphere at sea level.
pub(crate) const STANDARD_PRESSURE_PA: f64 = 101_325.0;
/// X-Plane 11 measures pressure in inches of mercury.
const PASCAL_PER_INCH_OF_MERCURY: f64 = 3_386.389;
/// X-Plane 11's scale of cloud cover ends at 4.
const CLOUD_COVER_SCALE_11: f64 = 4.0;
/// X-Plane's scale of turbulence ends at 10, ours at 1.
const TURBULENCE_SCALE: f64 = 10.0;
/// A value that went through X-Plane's 32-bit floats, and for some datarefs through its own units, comes back within this.
const RELATIVE_TOLERANCE: f64 = 1e-4;
/// The clock runs on between writing and reading it back. Freezing stops it and writes it again, exactly.
const RUNNING_CLOCK_TOLERANCE_S: f64 = 20.0;
/// A clock that stands still has the time that was set: seconds of a day in 32 bits are rounded by 4 ms at most. More would let a write
/// that was lost pass for one that was late.
const STANDING_CLOCK_TOLERANCE_S: f32 = 0.02;

/// One dataref to write, and how closely it must read back.
#[derive(Debug, Clone, PartialEq)]
pub struct DatarefWrite {
    /// Dataref, one element of an array as `name[3]`.
    pub name: String,
    /// In X-Plane's unit, rounded to X-Plane's 32 bits.
    pub value: f32,
    /// Largest difference that is still the same value, in the same unit.
    pub tolerance: f32,
}

impl DatarefWrite {
    /// A write that must read back to within rounding.
    pub fn new(name: impl Into<String>, value: f64) -> Self {
        Self {
            name: name.into(),
            value: value as f32,
            tolerance: (value.abs().max(1.0) * RELATIVE_TOLERANCE) as f32,
        }
    }

    /// Whether a value read back is the one that was written.
    pub fn is_met_by(&self, value: f32) -> bool {
        (value - self.value).abs() <= self.tolerance
    }
}

/// Which weather datarefs a simulator has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Generation {
    /// `sim/weather/`, up to 11.55.
    XPlane11,
    /// `sim/weather/region/`, since 12.0.
    XPlane12,
}

impl Generation {
    /// Of the value of [`VERSION`], e.g. 120400 for 12.4.0 and 115501 for 11.55.
    pub fn of_version(internal_version: f32) -> Self {
        if internal_version >= 120_000.0 {
            Self::XPlane12
        } else {
            Self::XPlane11
        }
    }
}

/// Everything that conditions set, clock first.
///
/// # Errors
/// [`BridgeError::BadConditions`] for more layers than X-Plane has, or a number that is none.
pub fn condition_writes(
    conditions: &Conditions,
    generation: Generation,
) -> Result<Vec<DatarefWrite>, BridgeError> {
    let mut writes = clock_writes(&conditions.clock);
    for write in &mut writes {
        if write.name == ZULU_TIME_S {
            write.tolerance = RUNNING_CLOCK_TOLERANCE_S as f32;
        }
    }
    writes.extend(weather_writes(&conditions.weather, generation)?);
    if let Some(bad) = writes.iter().find(|write| !write.value.is_finite()) {
        return Err(BridgeError::BadConditions {
            what: format!("{} would be set to {}", bad.name, bad.value),
        });
    }
    Ok(writes)
}

/// The clock, to be exact once it stands still. The order matters: the simulator's own time must be off first.
pub fn clock_writes(clock: &Clock) -> Vec<DatarefWrite> {
    vec![
        DatarefWrite::new(USE_SYSTEM_TIME, 0.0),
        DatarefWrite::new(DATE_DAYS, f64::from(clock.day_of_year) - 1.0),
        DatarefWrite {
            tolerance: STANDING_CLOCK_TOLERANCE_S,
            ..DatarefWrite::new(ZULU_TIME_S, clock.zulu_time_s)
        },
    ]
}

/// What [`COMMAND_REGENERATE_WEATHER`] does not take over and wants to be told again: clouds and temperature.
pub fn needs_repeating_after_regeneration(name: &str) -> bool {
    name.contains("/cloud_") || name == TEMPERATURE_C
}

fn weather_writes(
    weather: &Weather,
    generation: Generation,
) -> Result<Vec<DatarefWrite>, BridgeError> {
    if weather.clouds.len() > CLOUD_LAYERS {
        return Err(BridgeError::BadConditions {
            what: format!(
                "{} cloud layers, X-Plane has {CLOUD_LAYERS}",
                weather.clouds.len()
            ),
        });
    }
    Ok(match generation {
        Generation::XPlane11 => weather_writes_11(weather),
        Generation::XPlane12 => weather_writes_12(weather),
    })
}

fn weather_writes_12(weather: &Weather) -> Vec<DatarefWrite> {
    let mut writes = vec![
        DatarefWrite::new(CHANGE_MODE, 3.0),
        DatarefWrite::new(VARIABILITY, 0.0),
        DatarefWrite::new(
            VISIBILITY_SM,
            weather.visibility_m / METERS_PER_STATUTE_MILE,
        ),
        DatarefWrite::new(RAIN, weather.rain_ratio),
        DatarefWrite::new(TEMPERATURE_C, STANDARD_TEMPERATURE_C),
        DatarefWrite::new(PRESSURE_PA, STANDARD_PRESSURE_PA),
        DatarefWrite::new(THERMALS, 0.0),
    ];
    for layer in 0..CLOUD_LAYERS {
        let cloud = weather.clouds.get(layer).copied().unwrap_or(NO_CLOUD);
        writes.extend([
            element(CLOUD_TYPE, layer, cloud_type_12(cloud.kind)),
            element(CLOUD_COVER, layer, cloud.cover_ratio),
            element(CLOUD_BASE, layer, cloud.base_msl_m),
            element(CLOUD_TOP, layer, cloud.top_msl_m),
        ]);
    }
    for (layer, altitude_msl_m) in WIND_ALTITUDES_MSL_M.into_iter().enumerate() {
        writes.extend([
            element(WIND_ALTITUDE, layer, altitude_msl_m),
            element(WIND_SPEED, layer, weather.wind_speed_mps),
            element(WIND_DIRECTION, layer, weather.wind_from_true_deg),
            element(
                TURBULENCE,
                layer,
                weather.turbulence_ratio * TURBULENCE_SCALE,
            ),
            element(SHEAR_SPEED, layer, 0.0),
            element(SHEAR_DIRECTION, layer, 0.0),
        ]);
    }
    writes
}

fn weather_writes_11(weather: &Weather) -> Vec<DatarefWrite> {
    let has_storm = weather
        .clouds
        .iter()
        .any(|cloud| cloud.kind == CloudKind::Cumulonimbus);
    let thunderstorm = if has_storm { weather.rain_ratio } else { 0.0 };
    let mut writes = vec![
        DatarefWrite::new("sim/weather/use_real_weather_bool", 0.0),
        DatarefWrite::new("sim/weather/visibility_reported_m", weather.visibility_m),
        DatarefWrite::new("sim/weather/rain_percent", weather.rain_ratio),
        DatarefWrite::new("sim/weather/thunderstorm_percent", thunderstorm),
        DatarefWrite::new("sim/weather/thermal_percent", 0.0),
        DatarefWrite::new("sim/weather/thermal_rate_ms", 0.0),
        DatarefWrite::new("sim/weather/temperature_sealevel_c", STANDARD_TEMPERATURE_C),
        DatarefWrite::new(
            "sim/weather/barometer_sealevel_inhg",
            STANDARD_PRESSURE_PA / PASCAL_PER_INCH_OF_MERCURY,
        ),
    ];
    for layer in 0..CLOUD_LAYERS {
        let cloud = weather.clouds.get(layer).copied().unwrap_or(NO_CLOUD);
        writes.extend([
            element("sim/weather/cloud_type", layer, cloud_type_11(&cloud)),
            element(
                "sim/weather/cloud_coverage",
                layer,
                cloud.cover_ratio * CLOUD_COVER_SCALE_11,
            ),
            element("sim/weather/cloud_base_msl_m", layer, cloud.base_msl_m),
            element("sim/weather/cloud_tops_msl_m", layer, cloud.top_msl_m),
        ]);
    }
    for (layer, altitude_msl_m) in [300.0, 3_000.0, 9_000.0].into_iter().enumerate() {
        let (speed_kt, from) = (
            weather.wind_speed_mps / MPS_PER_KNOT,
            weather.wind_from_true_deg,
        );
        writes.extend([
            element("sim/weather/wind_altitude_msl_m", layer, altitude_msl_m),
            element("sim/weather/wind_speed_kt", layer, speed_kt),
            element("sim/weather/wind_direction_degt", layer, from),
            element(
                "sim/weather/turbulence",
                layer,
                weather.turbulence_ratio * TURBULENCE_SCALE,
            ),
            element("sim/weather/shear_speed_kt", layer, 0.0),
            element("sim/weather/shear_direction_degt", layer, 0.0),
        ]);
    }
    writes
}

const NO_CLOUD: CloudLayer = CloudLayer {
    kind: CloudKind::Cirrus,
    cover_ratio: 0.0,
    base_msl_m: 0.0,
    top_msl_m: 0.0,
};

fn element(name: &str, index: usize, value: f64) -> DatarefWrite {
    DatarefWrite::new(format!("{name}[{index}]"), value)
}

fn cloud_type_12(kind: CloudKind) -> f64 {
    match kind {
        CloudKind::Cirrus => 0.0,
        CloudKind::Stratus => 1.0,
        CloudKind::Cumulus => 2.0,
        CloudKind::Cumulonimbus => 3.0,
    }
}

/// X-Plane 11 has kind and cover in one number: 0 clear, 1 cirrus, 2 scattered, 3 broken, 4 overcast, 5 stratus.
fn cloud_type_11(cloud: &CloudLayer) -> f64 {
    match cloud.kind {
        _ if cloud.cover_ratio <= 0.0 => 0.0,
        CloudKind::Cirrus => 1.0,
        CloudKind::Stratus => 5.0,
        // Oktas of a weather report: scattered up to 4/8, broken up to 7/8, overcast above.
        CloudKind::Cumulus | CloudKind::Cumulonimbus => match cloud.cover_ratio {
            cover if cover <= 0.5 => 2.0,
            cover if cover <= 0.875 => 3.0,
            _ => 4.0,
        },
    }
}

/// The weather that a simulator with these datarefs has: the inverse of [`condition_writes`], for the stand-in. The wind is
/// that of the lowest layer. X-Plane 11 has no number for the cover of a cloud, and gives the middle of its kind's range.
pub fn weather_from_datarefs(generation: Generation, read: impl Fn(&str) -> f32) -> Weather {
    match generation {
        Generation::XPlane11 => weather_11(read),
        Generation::XPlane12 => weather_12(read),
    }
}

fn weather_11(read: impl Fn(&str) -> f32) -> Weather {
    let layer = |name: &str, layer: usize| f64::from(read(&format!("sim/weather/{name}[{layer}]")));
    let stormy = read("sim/weather/thunderstorm_percent") > 0.0;
    let heaps = if stormy {
        CloudKind::Cumulonimbus
    } else {
        CloudKind::Cumulus
    };
    let clouds = (0..CLOUD_LAYERS).filter_map(|i| {
        let (kind, cover_ratio) = match layer("cloud_type", i).round() as i64 {
            i64::MIN..=0 => return None,
            1 => (CloudKind::Cirrus, 0.25),
            2 => (heaps, 0.375),
            3 => (heaps, 0.75),
            4 => (heaps, 1.0),
            _ => (CloudKind::Stratus, 1.0),
        };
        Some(CloudLayer {
            kind,
            cover_ratio,
            base_msl_m: layer("cloud_base_msl_m", i),
            top_msl_m: layer("cloud_tops_msl_m", i),
        })
    });
    Weather {
        visibility_m: f64::from(read("sim/weather/visibility_reported_m")),
        clouds: clouds.collect(),
        rain_ratio: f64::from(read("sim/weather/rain_percent")),
        wind_speed_mps: layer("wind_speed_kt", 0) * MPS_PER_KNOT,
        wind_from_true_deg: layer("wind_direction_degt", 0),
        turbulence_ratio: layer("turbulence", 0) / TURBULENCE_SCALE,
    }
}

fn weather_12(read: impl Fn(&str) -> f32) -> Weather {
    let number = |name: &str| f64::from(read(name));
    let layer = |name: &str, layer: usize| f64::from(read(&format!("{name}[{layer}]")));
    let clouds = (0..CLOUD_LAYERS).map(|i| CloudLayer {
        kind: match layer(CLOUD_TYPE, i).round() as i64 {
            i64::MIN..=0 => CloudKind::Cirrus,
            1 => CloudKind::Stratus,
            2 => CloudKind::Cumulus,
            _ => CloudKind::Cumulonimbus,
        },
        cover_ratio: layer(CLOUD_COVER, i),
        base_msl_m: layer(CLOUD_BASE, i),
        top_msl_m: layer(CLOUD_TOP, i),
    });
    Weather {
        visibility_m: number(VISIBILITY_SM) * METERS_PER_STATUTE_MILE,
        clouds: clouds.filter(|cloud| cloud.cover_ratio > 0.0).collect(),
        rain_ratio: number(RAIN),
        wind_speed_mps: layer(WIND_SPEED, 0),
        wind_from_true_deg: layer(WIND_DIRECTION, 0),
        turbulence_ratio: layer(TURBULENCE, 0) / TURBULENCE_SCALE,
    }
}

/// The clock that a simulator with these datarefs shows.
pub fn clock_from_datarefs(read: impl Fn(&str) -> f32) -> Clock {
    Clock {
        day_of_year: read(DATE_DAYS) as u32 + 1,
        zulu_time_s: f64::from(read(ZULU_TIME_S)),
    }
}

/// The radio settings of an instrument approach; empty for a runway without one.
///
/// The course knob is magnetic. A runway that does not know its magnetic course leaves the knob alone: on a localizer
/// frequency it turns a needle's card only, and a true course there would be wrong.
pub fn approach_writes(runway: &Runway) -> Vec<DatarefWrite> {
    let frequency = runway
        .ils_frequency_mhz
        .map(|mhz| DatarefWrite::new(NAV1_FREQUENCY, nav_frequency_10khz(mhz)));
    let course = runway
        .course_magnetic_deg
        .map(|course| DatarefWrite::new(NAV1_COURSE_MAGNETIC, course));
    frequency.into_iter().chain(course).collect()
}

/// An aircraft that X-Plane brings along.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AircraftFile {
    /// What [`AIRCRAFT_ICAO`] reads while it is loaded.
    pub icao: &'static str,
    /// Its `.acf` file below X-Plane's folder.
    pub path: &'static str,
}

/// The file of an aircraft as sweeps name it; `None` for one that we do not know, which a person has to load.
pub fn aircraft_file(name: &str, generation: Generation) -> Option<AircraftFile> {
    let path = match (name, generation) {
        ("B737-800", Generation::XPlane11) => "Aircraft/Laminar Research/Boeing B737-800/b738.acf",
        ("B737-800", Generation::XPlane12) => "Aircraft/Laminar Research/Boeing 737-800/b738.acf",
        _ => return None,
    };
    Some(AircraftFile { icao: "B738", path })
}

/// A frequency as [`NAV1_FREQUENCY`] counts it: whole tens of kilohertz.
pub fn nav_frequency_10khz(frequency_mhz: f64) -> f64 {
    (frequency_mhz * 100.0).round()
}

#[cfg(test)]
mod tests {
    use std::collections::{HashMap, HashSet};

    use super::*;

    fn stormy() -> Conditions {
        Conditions {
            time_of_day: "06:00".into(),
            clock: Clock {
                day_of_year: 80,
                zulu_time_s: 79_200.0,
            },
            weather_name: "stormy".into(),
            weather: Weather {
                visibility_m: 8_046.72,
                clouds: vec![CloudLayer {
                    kind: CloudKind::Cumulonimbus,
                    cover_ratio: 0.75,
                    base_msl_m: 600.0,
                    top_msl_m: 9_000.0,
                }],
                rain_ratio: 0.5,
                wind_speed_mps: 10.0,
                wind_from_true_deg: 340.0,
                turbulence_ratio: 0.5,
            },
        }
    }

    fn table(generation: Generation) -> HashMap<String, f32> {
        let writes = condition_writes(&stormy(), generation).unwrap();
        writes
            .into_iter()
            .map(|write| (write.name, write.value))
            .collect()
    }

    #[test]
    fn visibility_is_statute_miles_in_12_and_metres_in_11() {
        assert_eq!(table(Generation::XPlane12)[VISIBILITY_SM], 5.0);
        let eleven = table(Generation::XPlane11);
        assert_eq!(eleven["sim/weather/visibility_reported_m"], 8_046.72);
        assert!((eleven["sim/weather/wind_speed_kt[2]"] - 19.438).abs() < 1e-3);
        assert_eq!(eleven["sim/weather/cloud_type[0]"], 3.0);
    }

    #[test]
    fn the_system_clock_is_switched_off_before_the_time_is_set_and_days_count_from_zero() {
        let names: Vec<_> = clock_writes(&stormy().clock)
            .into_iter()
            .map(|w| (w.name, w.value))
            .collect();
        assert_eq!(names[0], (USE_SYSTEM_TIME.into(), 0.0));
        assert_eq!(names[1], (DATE_DAYS.into(), 79.0));
        assert_eq!(names[2], (ZULU_TIME_S.into(), 79_200.0));
    }

    #[test]
    fn a_clock_that_stands_must_be_exact_and_one_that_runs_need_not() {
        let conditions = stormy();
        let zulu = |writes: Vec<DatarefWrite>| {
            let zulu = writes.into_iter().find(|write| write.name == ZULU_TIME_S);
            zulu.unwrap()
        };
        let standing = zulu(clock_writes(&conditions.clock));
        let late = conditions.clock.zulu_time_s as f32 + 0.6;
        assert!(standing.is_met_by(standing.value) && !standing.is_met_by(late));
        let running = condition_writes(&conditions, Generation::XPlane12).unwrap();
        assert!(zulu(running).is_met_by(late));
    }

    #[test]
    fn every_parameter_is_written_whatever_the_weather() {
        let names = |conditions: &Conditions, generation| -> HashSet<String> {
            let writes = condition_writes(conditions, generation).unwrap();
            let names: HashSet<_> = writes.iter().map(|write| write.name.clone()).collect();
            assert_eq!(names.len(), writes.len(), "a dataref is written twice");
            names
        };
        let mut clear = stormy();
        clear.weather.clouds.clear();
        clear.weather.wind_speed_mps = 0.0;
        for generation in [Generation::XPlane11, Generation::XPlane12] {
            assert_eq!(names(&clear, generation), names(&stormy(), generation));
        }
    }

    #[test]
    fn weather_and_clock_come_back_from_their_datarefs() {
        let values = table(Generation::XPlane12);
        let found = weather_from_datarefs(Generation::XPlane12, |name| values[name]);
        let wanted = stormy().weather;
        assert!((found.visibility_m - wanted.visibility_m).abs() < 1e-3);
        assert_eq!(
            Weather {
                visibility_m: wanted.visibility_m,
                ..found
            },
            wanted
        );
        assert_eq!(clock_from_datarefs(|name| values[name]), stormy().clock);
    }

    #[test]
    fn what_x_plane_cannot_show_is_refused_with_its_reason() {
        let mut conditions = stormy();
        conditions.weather.clouds = vec![conditions.weather.clouds[0]; 4];
        let error = condition_writes(&conditions, Generation::XPlane12).unwrap_err();
        assert!(error.to_string().contains("4 cloud layers"), "{error}");
        let mut conditions = stormy();
        conditions.weather.visibility_m = f64::NAN;
        let error = condition_writes(&conditions, Generation::XPlane12).unwrap_err();
        assert!(error.to_string().contains(VISIBILITY_SM), "{error}");
    }

    #[test]
    fn everything_that_is_called_unconfirmed_is_written() {
        let written: HashSet<String> = [Generation::XPlane11, Generation::XPlane12]
            .into_iter()
            .flat_map(|generation| condition_writes(&stormy(), generation).unwrap())
            .map(|write| write.name.split('[').next().unwrap_or_default().to_owned())
            .collect();
        for name in UNCONFIRMED {
            assert!(written.contains(name), "{name}");
        }
    }

    #[test]
    fn an_approach_is_on_by_its_own_status_or_by_both_of_its_parts_and_unknown_without_them() {
        let [_, _, approach, ..] = APPROACH_SWITCHES;
        let with = |values: &[(&str, f32)]| {
            let values = values.to_vec();
            approach.is_on(|name| values.iter().find(|v| v.0 == name).map(|v| v.1))
        };
        let (own, nav, slope) = (APPROACH_STATUS, NAV_STATUS, GLIDE_SLOPE_STATUS);
        assert_eq!(with(&[(own, 2.0)]), Some(true));
        assert_eq!(with(&[(own, 0.0), (nav, 1.0), (slope, 1.0)]), Some(true));
        assert_eq!(with(&[(own, 0.0), (nav, 1.0), (slope, 0.0)]), Some(false));
        // One part is off: the other need not be known.
        assert_eq!(with(&[(own, 0.0), (slope, 0.0)]), Some(false));
        assert_eq!(with(&[(own, 0.0), (nav, 1.0)]), None);
        assert_eq!(with(&[]), None);
    }

    #[test]
    fn the_ils_of_110_90_megahertz_is_11090() {
        assert_eq!(nav_frequency_10khz(110.9), 11_090.0);
    }

    #[test]
    fn a_read_back_value_may_differ_by_rounding_only() {
        let write = DatarefWrite::new("a", 1_500.0);
        assert!(write.is_met_by(1_500.1));
        assert!(!write.is_met_by(1_501.0));
        assert!(!write.is_met_by(f32::NAN));
    }
}
