//! The datarefs of X-Plane that we use, and the only conversion between SI and X-Plane's units.
//!
//! Input: conditions and runways in SI. Output: lists of dataref writes. Names and units differ between X-Plane 11 and 12 only for
//! the weather ([`weather`]): a name whose comment begins with a version is used in that version alone, because X-Plane 12 keeps the names
//! of 11 and complains when one is looked up. The tolerances for reading back are one table ([`tolerance`]).

mod effective_weather;
mod tolerance;
mod version;
mod weather;

use airframe::AircraftType;
use dataset::conditions::{Clock, Conditions};
use dataset::geometry::runway::Runway;

pub(crate) use effective_weather::{effective_weather_datarefs, effective_weather_of};
pub use tolerance::Tolerance;
pub use version::{Generation, Version};
pub use weather::weather_from_datarefs;
pub(crate) use weather::{check_cloud_layers, weather_writes};

/// Metres in one statute mile (exact by definition). X-Plane 12 measures visibility in them.
pub const METERS_PER_STATUTE_MILE: f64 = 1_609.344;
/// Layers of cloud that X-Plane has.
pub const CLOUD_LAYERS: usize = 3;
/// Layers of wind that X-Plane 12 has.
pub const WIND_LAYERS: usize = 13;

/// Version of the simulator as one number, 124009 for 12.4.0-r2: see [`Version::of_number`].
pub const VERSION: &str = "sim/version/xplane_internal_version";
/// Ours: TCP port of the capture link, 0 while not listening. Published by the plugin and by the stand-in.
pub const CAPTURE_PORT: &str = "dtd/bridge/capture_port";
/// Ours: how long regenerated weather takes to show, seconds. Published with [`CAPTURE_PORT`].
pub const WEATHER_SETTLE_S: &str = "dtd/bridge/weather_settle_s";

/// Seconds since midnight UTC. Keeps running unless the simulator is frozen.
pub const ZULU_TIME_S: &str = "sim/time/zulu_time_sec";
/// Days since 1 January, 0 to 364.
pub const DATE_DAYS: &str = "sim/time/local_date_days";
/// 1 makes the simulator's clock follow the computer's, and overrides every write to it.
pub const USE_SYSTEM_TIME: &str = "sim/time/use_system_time";

/// Seconds since the simulator was started: a smaller value means that it restarted.
pub const RUNNING_TIME_S: &str = "sim/time/total_running_time_sec";
/// Simulated seconds since the flight began: stands still in a pause, and in a menu.
pub const FLIGHT_TIME_S: &str = "sim/time/total_flight_time_sec";
/// 1 while the simulator's time stands still. Read-only: [`COMMAND_PAUSE_ON`] and [`COMMAND_PAUSE_OFF`] change it.
pub const PAUSED: &str = "sim/time/paused";
/// 1 while scenery loads; falls before fine terrain is there.
pub const SCENERY_LOADING: &str = "sim/graphics/scenery/async_scenery_load_in_progress";
/// Width of the user's aircraft, metres, which scales its shadow in X-Plane.
pub const AIRCRAFT_WIDTH_M: &str = "sim/aircraft/view/acf_size_x";
/// Length of the user's aircraft, metres, which scales its shadow in X-Plane.
pub const AIRCRAFT_LENGTH_M: &str = "sim/aircraft/view/acf_size_z";
/// Type designator of the user's aircraft, one character per element.
pub const AIRCRAFT_ICAO: &str = "sim/aircraft/view/acf_ICAO";

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
/// X-Plane 12, per wind layer: turbulence, 0 to 1. Its field holds up to 10, but above 1 it saturates, and at 0.2 aircraft are thrown off
/// their altitude.
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
/// X-Plane 12, per level: its height above mean sea level, metres.
pub const TEMPERATURE_ALTITUDE: &str = "sim/weather/region/temperature_altitude_msl_m";
/// X-Plane 12, per level: temperature, degrees Celsius. Below freezing, rain is snow.
pub const TEMPERATURE_ALOFT_C: &str = "sim/weather/region/temperatures_aloft_deg_c";
/// X-Plane 12, per level: dew point, degrees Celsius.
pub const DEW_POINT_C: &str = "sim/weather/region/dewpoint_deg_c";
/// X-Plane 12: 0 dry, 1 to 3 wet, 4 to 6 puddles, 7 to 9 snow, 10 to 12 ice. Stays until it is written.
pub const RUNWAY_FRICTION: &str = "sim/weather/region/runway_friction";
/// X-Plane 12: writing 0 sets the preset "clear", which takes clouds away that zeros may leave.
pub const WEATHER_PRESET: &str = "sim/weather/region/weather_preset";
/// X-Plane 12, read-only: who makes the weather, see [`WeatherSource`].
pub const WEATHER_SOURCE: &str = "sim/weather/region/weather_source";
/// Visibility as drawn, metres, which follows the setting.
pub const VISIBILITY_EFFECTIVE_M: &str = "sim/graphics/view/visibility_effective_m";
/// X-Plane 12, read-only, per cloud layer: cover around the aircraft, 0 to 1.
pub const CLOUD_COVER_AT_AIRCRAFT: &str = "sim/weather/aircraft/cloud_coverage_percent";
/// X-Plane 12, read-only: wind at the aircraft, metres per second.
pub const WIND_SPEED_AT_AIRCRAFT: &str = "sim/weather/aircraft/wind_now_speed_msc";
/// X-Plane 12, read-only: where it comes from, degrees true.
pub const WIND_DIRECTION_AT_AIRCRAFT: &str = "sim/weather/aircraft/wind_now_direction_degt";
/// X-Plane 12, read-only: rain or snow on the aircraft, 0 to 1.
pub const RAIN_AT_AIRCRAFT: &str = "sim/weather/aircraft/precipitation_on_aircraft_ratio";

/// X-Plane 11: 1 while real weather overwrites all settings.
pub const USE_REAL_WEATHER_11: &str = "sim/weather/use_real_weather_bool";
/// X-Plane 11: visibility, metres.
pub const VISIBILITY_M_11: &str = "sim/weather/visibility_reported_m";
/// X-Plane 11: rain, 0 to 1.
pub const RAIN_11: &str = "sim/weather/rain_percent";
/// X-Plane 11: thunderstorms, 0 to 1.
pub const THUNDERSTORM_11: &str = "sim/weather/thunderstorm_percent";
/// X-Plane 11: thermals, part of the area.
pub const THERMAL_PERCENT_11: &str = "sim/weather/thermal_percent";
/// X-Plane 11: climb rate of thermals.
pub const THERMAL_RATE_11: &str = "sim/weather/thermal_rate_ms";
/// X-Plane 11: temperature at sea level, degrees Celsius.
pub const TEMPERATURE_C_11: &str = "sim/weather/temperature_sealevel_c";
/// X-Plane 11: pressure at sea level, inches of mercury.
pub const PRESSURE_INHG_11: &str = "sim/weather/barometer_sealevel_inhg";
/// X-Plane 11, per cloud layer: 0 clear, 1 cirrus, 2 scattered, 3 broken, 4 overcast, 5 stratus. Layers are scalars whose names end
/// in `[0]` to `[2]`. It determines the sky; `cloud_coverage`, X-Plane 10's, is left alone.
pub const CLOUD_TYPE_11: &str = "sim/weather/cloud_type";
/// X-Plane 11, per cloud layer: base above mean sea level, metres.
pub const CLOUD_BASE_11: &str = "sim/weather/cloud_base_msl_m";
/// X-Plane 11, per cloud layer: top above mean sea level, metres.
pub const CLOUD_TOP_11: &str = "sim/weather/cloud_tops_msl_m";
/// X-Plane 11, per wind layer: its height above mean sea level, metres.
pub const WIND_ALTITUDE_11: &str = "sim/weather/wind_altitude_msl_m";
/// X-Plane 11, per wind layer: speed, knots.
pub const WIND_SPEED_KT_11: &str = "sim/weather/wind_speed_kt";
/// X-Plane 11, per wind layer: where it comes from, degrees true.
pub const WIND_DIRECTION_11: &str = "sim/weather/wind_direction_degt";
/// X-Plane 11, per wind layer: turbulence. Its scale is undocumented; 0 to 1 is the cautious reading.
pub const TURBULENCE_11: &str = "sim/weather/turbulence";
/// X-Plane 11, per wind layer: gust above the wind, knots.
pub const SHEAR_SPEED_KT_11: &str = "sim/weather/shear_speed_kt";
/// X-Plane 11, per wind layer: change of direction in a gust, degrees.
pub const SHEAR_DIRECTION_11: &str = "sim/weather/shear_direction_degt";

/// Frequency of the first navigation receiver, units of 10 kHz: 11090 is 110.90 MHz.
pub const NAV1_FREQUENCY: &str = "sim/cockpit/radios/nav1_freq_hz";
/// Course set on the first navigation receiver, degrees **magnetic**.
pub const NAV1_COURSE_MAGNETIC: &str = "sim/cockpit/radios/nav1_obs_degm";
/// Source of the autopilot: 0 is the first navigation receiver.
pub(crate) const HSI_SOURCE: &str = "sim/cockpit2/radios/actuators/HSI_source_select_pilot";
/// 1 gives the autopilot power.
pub(crate) const AUTOPILOT_ELECTRIC_MASTER: &str =
    "sim/cockpit2/autopilot/autopilot_electric_master";
/// 0 off, 1 flight director, 2 autopilot flies.
pub const AUTOPILOT_MODE: &str = "sim/cockpit/autopilot/autopilot_mode";

/// Rebuilds the weather from its datarefs.
pub const COMMAND_REGENERATE_WEATHER: &str = "sim/operation/regen_weather";
/// Leaves a menu, or opens it.
pub const COMMAND_TOGGLE_MAIN_MENU: &str = "sim/operation/toggle_main_menu";
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

/// Heights of X-Plane 12's own 13 levels, metres above mean sea level, as a live client read them.
pub(crate) const WIND_ALTITUDES_MSL_M: [f64; WIND_LAYERS] = [
    0.0, 540.0, 988.0, 1_948.0, 3_011.0, 4_207.0, 5_572.0, 7_182.0, 9_160.0, 10_363.0, 11_887.0,
    13_594.0, 16_179.0,
];
/// Heights that we give X-Plane 11's three layers of wind: each is effective only near its own, and approaches are flown below a
/// kilometre.
const WIND_ALTITUDES_11_MSL_M: [f64; 3] = [300.0, 3_000.0, 9_000.0];
/// Temperature at sea level in the international standard atmosphere. No figure depends on it.
pub(crate) const STANDARD_TEMPERATURE_C: f64 = 15.0;
/// International standard atmosphere at sea level.
pub(crate) const STANDARD_PRESSURE_PA: f64 = 101_325.0;
/// X-Plane 11 measures pressure in inches of mercury.
const PASCAL_PER_INCH_OF_MERCURY: f64 = 3_386.389;
/// Dew point below temperature: dry air. Fog is set by the visibility, whatever the dew point.
const DEW_POINT_BELOW_C: f64 = 5.0;
/// [`RUNWAY_FRICTION`] when dry.
const DRY: f64 = 0.0;
/// The clock keeps running between writing and reading it back. Freezing stops it and writes it again, exactly.
const RUNNING_CLOCK_TOLERANCE_S: f32 = 20.0;
/// A stopped clock has the time that was set: 32-bit seconds within a day are rounded by 4 ms at most. A wider tolerance could mistake a
/// lost write for a late one.
const STANDING_CLOCK_TOLERANCE_S: f32 = 0.02;

/// A dataref to write, with the tolerance for reading it back.
#[derive(Debug, Clone, PartialEq)]
pub struct DatarefWrite {
    /// Dataref; array elements as `name[3]`.
    pub name: String,
    /// Value in X-Plane's unit, rounded to 32 bits.
    pub value: f32,
    /// Tolerance for the value read back.
    pub tolerance: Tolerance,
}

impl DatarefWrite {
    /// A write that must read back to within rounding.
    pub fn new(name: impl Into<String>, value: f64) -> Self {
        Self {
            name: name.into(),
            value: value as f32,
            tolerance: Tolerance::rounding(value),
        }
    }

    /// The same write, but any value read back is accepted.
    fn unread(self) -> Self {
        Self {
            tolerance: Tolerance::Unread,
            ..self
        }
    }

    /// True if the written value is read back.
    pub(crate) fn is_read_back(&self) -> bool {
        self.tolerance != Tolerance::Unread
    }

    /// True if a value read back matches the written one.
    pub fn is_met_by(&self, value: f32) -> bool {
        self.tolerance.allows(self.value, value)
    }
}

/// Conditions that X-Plane cannot have, with the reason.
#[derive(Debug, thiserror::Error)]
#[error("conditions that X-Plane cannot have: {0}")]
pub struct BadConditions(pub String);

/// All settings of conditions, clock first.
///
/// # Errors
/// For more layers than X-Plane has, or a NaN.
pub fn condition_writes(
    conditions: &Conditions,
    generation: Generation,
) -> Result<Vec<DatarefWrite>, BadConditions> {
    let mut writes = running_clock_writes(&conditions.clock);
    writes.extend(weather_writes(&conditions.weather, generation)?);
    if let Some(bad) = writes.iter().find(|write| !write.value.is_finite()) {
        let what = format!("{} would be set to {}", bad.name, bad.value);
        return Err(BadConditions(what));
    }
    Ok(writes)
}

/// The clock while it runs.
pub(crate) fn running_clock_writes(clock: &Clock) -> Vec<DatarefWrite> {
    let mut writes = clock_writes(clock);
    for write in &mut writes {
        if write.name == ZULU_TIME_S {
            write.tolerance = Tolerance::Absolute(RUNNING_CLOCK_TOLERANCE_S);
        }
    }
    writes
}

/// The clock, for an exact time once it stands still. The order matters: following the system time must be off first.
pub(crate) fn clock_writes(clock: &Clock) -> Vec<DatarefWrite> {
    vec![
        DatarefWrite::new(USE_SYSTEM_TIME, 0.0),
        DatarefWrite::new(DATE_DAYS, f64::from(clock.day_of_year) - 1.0),
        DatarefWrite {
            tolerance: Tolerance::Absolute(STANDING_CLOCK_TOLERANCE_S),
            ..DatarefWrite::new(ZULU_TIME_S, clock.zulu_time_s)
        },
    ]
}

/// True if [`COMMAND_REGENERATE_WEATHER`] resets a dataref, so that it must be written again: clouds and temperature.
pub fn needs_repeating_after_regeneration(name: &str) -> bool {
    name.contains("/cloud_")
        || name == TEMPERATURE_C
        || [TEMPERATURE_ALTITUDE, TEMPERATURE_ALOFT_C, DEW_POINT_C]
            .iter()
            .any(|array| name.starts_with(array))
}

/// The source of X-Plane 12's weather, from [`WEATHER_SOURCE`]. Read-only.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WeatherSource {
    /// A preset, or values that were written: ours.
    Preset,
    /// Real weather.
    Real,
    /// An instructor's control pad.
    ControlPad,
    /// A different plugin.
    Plugin,
}

impl WeatherSource {
    /// Decodes the dataref's value; `None` if it is unknown.
    pub fn of_value(value: f32) -> Option<Self> {
        match value {
            0.0 => Some(Self::Preset),
            1.0 => Some(Self::Real),
            2.0 => Some(Self::ControlPad),
            3.0 => Some(Self::Plugin),
            _ => None,
        }
    }
}

/// The clock that a simulator with these datarefs shows.
pub fn clock_from_datarefs(read: impl Fn(&str) -> f32) -> Clock {
    Clock {
        day_of_year: read(DATE_DAYS) as u32 + 1,
        zulu_time_s: f64::from(read(ZULU_TIME_S)),
    }
}

/// Writes that prepare an autopilot for an instrument approach: power, the first receiver as its source, and the radio settings of the
/// runway, if it has any.
///
/// The course knob is magnetic. For a runway without a magnetic course the knob is left alone: on a localizer frequency it only
/// turns a needle's card, and a true course there would be wrong.
pub(crate) fn approach_writes(runway: &Runway) -> Vec<DatarefWrite> {
    let frequency = runway
        .ils_frequency_mhz
        .map(|mhz| DatarefWrite::new(NAV1_FREQUENCY, nav_frequency_10khz(mhz)));
    let course = runway
        .course_magnetic_deg
        .map(|course| DatarefWrite::new(NAV1_COURSE_MAGNETIC, course));
    // Not every aircraft has them.
    let power = DatarefWrite::new(AUTOPILOT_ELECTRIC_MASTER, 1.0).unread();
    let source = DatarefWrite::new(HSI_SOURCE, 0.0).unread();
    let radios = frequency.into_iter().chain(course);
    [power, source].into_iter().chain(radios).collect()
}

/// An aircraft that X-Plane brings along.
#[derive(Debug, Clone, PartialEq)]
pub struct AircraftFile {
    /// Value of [`AIRCRAFT_ICAO`] while it is loaded.
    pub icao: &'static str,
    /// The `.acf` file below X-Plane's folder.
    pub path: String,
    /// Wing span and length of the type, metres.
    pub size_m: (f64, f64),
}

/// The aircraft file for a name in sweeps. `None` if this X-Plane brings none along. The stand-in has all types.
pub(crate) fn aircraft_file(
    name: &str,
    generation: Generation,
    is_stand_in: bool,
) -> Option<AircraftFile> {
    let of = AircraftType::named(name).ok()?;
    let own = match generation {
        Generation::XPlane11 => &of.x_plane.in_11,
        Generation::XPlane12 => &of.x_plane.in_12,
    };
    let path = match own {
        Some(path) => path.clone(),
        None if is_stand_in => of.stand_in_file(),
        None => return None,
    };
    Some(AircraftFile {
        icao: &of.designator,
        path,
        size_m: (of.published.span_m, of.published.length_m),
    })
}

/// The type of an aircraft from the elements of [`AIRCRAFT_ICAO`] that could be read; empty if the simulator does not report it.
pub(crate) fn icao_of(values: &[Option<f32>]) -> String {
    let characters = values.iter().flatten().map(|value| *value as u8);
    let known = characters.filter(u8::is_ascii_alphanumeric);
    known.map(char::from).collect()
}

/// A frequency in the unit of [`NAV1_FREQUENCY`]: tens of kilohertz.
pub fn nav_frequency_10khz(frequency_mhz: f64) -> f64 {
    (frequency_mhz * 100.0).round()
}

#[cfg(test)]
mod tests {
    use std::collections::{HashMap, HashSet};

    use dataset::conditions::{CloudKind, CloudLayer, Weather};

    use super::*;

    #[test]
    fn x_plane_has_some_types_and_the_stand_in_has_all() {
        let has = |name: &str, generation, is_stand_in| {
            aircraft_file(name, generation, is_stand_in).is_some()
        };
        for of in AircraftType::all() {
            assert!(has(&of.name, Generation::XPlane12, true), "{}", of.name);
        }
        assert!(has("A330-300", Generation::XPlane12, false));
        assert!(!has("A330-300", Generation::XPlane11, false));
        assert!(!has("A350-900", Generation::XPlane12, false));
        let own = aircraft_file("B737-800", Generation::XPlane12, true).unwrap();
        assert_eq!(
            own.path,
            "Aircraft/Laminar Research/Boeing 737-800/b738.acf"
        );
        assert_eq!((own.icao, own.size_m), ("B738", (35.8, 39.5)));
    }

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
        assert_eq!(eleven["sim/weather/cloud_type[1]"], 0.0);
        let coverage = eleven.keys().find(|name| name.contains("cloud_coverage"));
        assert_eq!(coverage, None, "the sky of 11 is chosen by its types");
    }

    #[test]
    fn turbulence_is_a_ratio() {
        let turbulence = |generation| {
            let values = table(generation);
            let of = |(name, value): (&String, &f32)| name.contains("turbulence").then_some(*value);
            values.iter().filter_map(of).collect::<Vec<f32>>()
        };
        assert_eq!(turbulence(Generation::XPlane11), [0.5; 3]);
        assert_eq!(turbulence(Generation::XPlane12), [0.5; WIND_LAYERS]);
    }

    #[test]
    fn of_an_empty_layer_only_its_cover_must_read_back() {
        let writes = condition_writes(&stormy(), Generation::XPlane12).unwrap();
        let of_slot = |slot: usize| {
            let clouds = writes.iter().filter(move |write| {
                write.name.contains("/cloud_") && write.name.ends_with(&format!("[{slot}]"))
            });
            let (all, read) = (
                clouds.clone().count(),
                clouds.filter(|w| w.is_read_back()).count(),
            );
            (all, read)
        };
        assert_eq!([0, 1, 2].map(of_slot), [(4, 4), (4, 1), (4, 1)]);
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
