//! The stand-in's datarefs: the names of X-Plane 11 and 12 that an approach, its weather and its replay use.

use xplane_bridge::datarefs::{self as names, Generation};

use super::Kind::{self, Byte, Double, Float, Int};
use super::{Complaint, Dataref};

pub(crate) const fn writable(name: &'static str, kind: Kind, initial: f64) -> Dataref {
    Dataref {
        name,
        kind,
        length: None,
        writable: true,
        initial,
        complaint: None,
    }
}

const fn float(name: &'static str) -> Dataref {
    writable(name, Float, 0.0)
}

const fn int(name: &'static str) -> Dataref {
    writable(name, Int, 0.0)
}

pub(crate) const fn read_only(name: &'static str, kind: Kind, initial: f64) -> Dataref {
    Dataref {
        writable: false,
        ..writable(name, kind, initial)
    }
}

pub(crate) const fn array(name: &'static str, kind: Kind, length: usize, initial: f64) -> Dataref {
    Dataref {
        length: Some(length),
        ..writable(name, kind, initial)
    }
}

const fn floats(name: &'static str, length: usize) -> Dataref {
    array(name, Float, length, 0.0)
}

const fn samples(name: &'static str, length: usize) -> Dataref {
    Dataref {
        writable: false,
        ..floats(name, length)
    }
}

const fn text(name: &'static str, length: usize) -> Dataref {
    Dataref {
        writable: false,
        ..array(name, Byte, length, 0.0)
    }
}

/// Names that were looked up and are not of this version.
pub(crate) const FOREIGN_NAMES: &str = "dtd/mock/foreign_names";
const CLOUDS: usize = names::CLOUD_LAYERS;
const WINDS: usize = names::WIND_LAYERS;

/// All datarefs of a generation. X-Plane 12 keeps the datarefs of 11 as deprecated.
pub(super) fn datarefs(generation: Generation) -> impl Iterator<Item = Dataref> {
    let (own, deprecated) = match generation {
        Generation::XPlane11 => (ELEVEN, [].as_slice()),
        Generation::XPlane12 => (TWELVE, ELEVEN),
    };
    let deprecated = deprecated.iter().filter_map(deprecated_in_12);
    BOTH.iter().chain(own).copied().chain(deprecated)
}

/// A dataref of X-Plane 11 in 12; `None` if it is gone. Datarefs of the weather are read-only.
fn deprecated_in_12(dataref: &Dataref) -> Option<Dataref> {
    let complaint = match dataref.name {
        names::VERSION | names::THUNDERSTORM_11 => return None,
        names::USE_REAL_WEATHER_11 => Complaint::Shown,
        _ => Complaint::Logged,
    };
    Some(Dataref {
        complaint: Some(complaint),
        writable: dataref.writable && !dataref.name.starts_with("sim/weather/"),
        ..*dataref
    })
}

/// Common to X-Plane 11 and 12, then ours.
const BOTH: &[Dataref] = &[
    // Time. A fresh simulator follows the computer's clock, which is why clients must switch that off first.
    writable(names::USE_SYSTEM_TIME, Int, 1.0),
    float(names::ZULU_TIME_S),
    int(names::DATE_DAYS),
    read_only("sim/time/local_time_sec", Float, 0.0),
    read_only("sim/time/total_running_time_sec", Float, 0.0),
    read_only("sim/time/total_flight_time_sec", Float, 0.0),
    read_only("sim/time/paused", Int, 0.0),
    read_only("sim/time/is_in_replay", Int, 0.0),
    writable("sim/operation/misc/frame_rate_period", Float, 1.0 / 60.0),
    array("sim/operation/override/override_planepath", Int, 20, 0.0),
    int("sim/operation/override/override_flightcontrol"),
    int("sim/operation/override/override_throttles"),
    int("sim/operation/override/override_joystick"),
    int("sim/joystick/mouse_is_yoke"),
    read_only(names::SCENERY_LOADING, Int, 0.0),
    // Position of the aircraft. Latitude and longitude belong to the simulator; local coordinates and attitude may be set.
    read_only("sim/flightmodel/position/latitude", Double, 0.0),
    read_only("sim/flightmodel/position/longitude", Double, 0.0),
    read_only("sim/flightmodel/position/elevation", Double, 0.0),
    read_only("sim/flightmodel/position/lat_ref", Float, 0.0),
    read_only("sim/flightmodel/position/lon_ref", Float, 0.0),
    writable("sim/flightmodel/position/local_x", Double, 0.0),
    writable("sim/flightmodel/position/local_y", Double, 0.0),
    writable("sim/flightmodel/position/local_z", Double, 0.0),
    read_only("sim/flightmodel/position/y_agl", Float, 0.0),
    float("sim/flightmodel/position/psi"),
    float("sim/flightmodel/position/theta"),
    float("sim/flightmodel/position/phi"),
    floats("sim/flightmodel/position/q", 4),
    float("sim/flightmodel/position/local_vx"),
    float("sim/flightmodel/position/local_vy"),
    float("sim/flightmodel/position/local_vz"),
    float("sim/flightmodel/position/P"),
    float("sim/flightmodel/position/Q"),
    float("sim/flightmodel/position/R"),
    read_only("sim/flightmodel/position/groundspeed", Float, 0.0),
    read_only("sim/flightmodel/position/true_airspeed", Float, 0.0),
    read_only("sim/flightmodel/position/indicated_airspeed", Float, 0.0),
    read_only("sim/flightmodel/failures/onground_any", Int, 0.0),
    text("sim/aircraft/view/acf_relative_path", 512),
    text(names::AIRCRAFT_ICAO, 40),
    text("sim/aircraft/view/acf_descrip", 500),
    read_only(names::AIRCRAFT_WIDTH_M, Float, 0.0),
    read_only(names::AIRCRAFT_LENGTH_M, Float, 0.0),
    // Flaps, gear and lights, by the names that pilots' tools use.
    floats("sim/cockpit2/switches/landing_lights_switch", 16),
    read_only("sim/flightmodel2/controls/flap1_deploy_ratio", Float, 0.0),
    int("sim/cockpit2/controls/gear_handle_down"),
    read_only("sim/flightmodel2/gear/deploy_ratio", Float, 0.0),
    // Levers of the engines.
    floats("sim/cockpit2/engine/actuators/throttle_ratio", 16),
    float("sim/cockpit2/engine/actuators/throttle_ratio_all"),
    float("sim/cockpit2/engine/actuators/throttle_jet_rev_ratio_all"),
    // Radios and autopilot.
    writable(names::NAV1_FREQUENCY, Int, 11_030.0),
    float(names::NAV1_COURSE_MAGNETIC),
    int(names::AUTOPILOT_MODE),
    float("sim/cockpit/autopilot/heading_mag"),
    int("sim/cockpit2/radios/actuators/HSI_source_select_pilot"),
    writable("sim/cockpit2/autopilot/autopilot_electric_master", Int, 1.0),
    int("sim/cockpit2/autopilot/airspeed_is_mach"),
    int(names::AUTOTHROTTLE),
    writable("sim/cockpit2/autopilot/airspeed_dial_kts", Float, 140.0),
    read_only(names::NAV_STATUS, Int, 0.0),
    read_only(names::GLIDE_SLOPE_STATUS, Int, 0.0),
    read_only(names::APPROACH_STATUS, Int, 0.0),
    read_only("sim/cockpit2/autopilot/altitude_hold_status", Int, 0.0),
    read_only("sim/cockpit2/autopilot/vvi_status", Int, 0.0),
    // The user's view.
    read_only("sim/graphics/view/view_x", Float, 0.0),
    read_only("sim/graphics/view/view_y", Float, 0.0),
    read_only("sim/graphics/view/view_z", Float, 0.0),
    read_only("sim/graphics/view/view_pitch", Float, 0.0),
    read_only("sim/graphics/view/view_heading", Float, 0.0),
    read_only("sim/graphics/view/view_roll", Float, 0.0),
    writable("sim/graphics/view/field_of_view_deg", Float, 60.0),
    writable("sim/graphics/view/vertical_field_of_view_deg", Float, 42.0),
    int("sim/graphics/settings/non_proportional_vertical_FOV"),
    read_only(names::VISIBILITY_EFFECTIVE_M, Float, 32_000.0),
    read_only("sim/cockpit2/gauges/indicators/wind_speed_kts", Float, 0.0),
    read_only("sim/graphics/view/view_is_external", Int, 1.0),
    writable("sim/graphics/view/view_type", Int, 1_028.0),
    array("sim/cockpit2/radios/indicators/show_popup", Int, 20, 0.0),
    read_only("sim/graphics/view/window_width", Int, 1_920.0),
    read_only("sim/graphics/view/window_height", Int, 1_080.0),
    // Published by the plugin.
    read_only(names::CAPTURE_PORT, Int, 0.0),
    read_only(names::WEATHER_SETTLE_S, Float, 0.0),
    // The stand-in's own: how many names were looked up that are deprecated in this version, or unknown to it.
    read_only(FOREIGN_NAMES, Int, 0.0),
];

/// X-Plane 12 only. Weather: fair, as in a fresh simulator.
const TWELVE: &[Dataref] = &[
    read_only(names::VERSION, Int, 124_009.0),
    // Of a sunny day.
    read_only("sim/private/controls/photometric/ev100", Float, 14.0),
    float("sim/cockpit2/controls/flap_handle_request_ratio"),
    writable(names::CHANGE_MODE, Int, 3.0),
    writable(names::VARIABILITY, Float, 0.25),
    int(names::UPDATE_IMMEDIATELY),
    writable(names::VISIBILITY_SM, Float, 20.0),
    float(names::RAIN),
    writable(names::TEMPERATURE_C, Float, 28.0),
    writable(names::PRESSURE_PA, Float, 101_325.0),
    float(names::THERMALS),
    floats(names::TEMPERATURE_ALTITUDE, WINDS),
    array(names::TEMPERATURE_ALOFT_C, Float, WINDS, 28.0),
    array(names::DEW_POINT_C, Float, WINDS, 23.0),
    float(names::RUNWAY_FRICTION),
    int(names::WEATHER_PRESET),
    read_only(names::WEATHER_SOURCE, Int, 0.0),
    array(names::CLOUD_TYPE, Float, CLOUDS, 2.0),
    floats(names::CLOUD_COVER, CLOUDS),
    floats(names::CLOUD_BASE, CLOUDS),
    floats(names::CLOUD_TOP, CLOUDS),
    floats(names::WIND_ALTITUDE, WINDS),
    floats(names::WIND_SPEED, WINDS),
    floats(names::WIND_DIRECTION, WINDS),
    floats(names::TURBULENCE, WINDS),
    floats(names::SHEAR_SPEED, WINDS),
    floats(names::SHEAR_DIRECTION, WINDS),
    // The same weather as seen by instruments and the image.
    samples("sim/weather/aircraft/cloud_type", CLOUDS),
    samples("sim/weather/aircraft/cloud_coverage_percent", CLOUDS),
    samples("sim/weather/aircraft/cloud_base_msl_m", CLOUDS),
    samples("sim/weather/aircraft/cloud_tops_msl_m", CLOUDS),
    read_only("sim/weather/aircraft/visibility_reported_sm", Float, 0.0),
    read_only(names::WIND_SPEED_AT_AIRCRAFT, Float, 0.0),
    read_only(names::WIND_DIRECTION_AT_AIRCRAFT, Float, 0.0),
    read_only(names::RAIN_AT_AIRCRAFT, Float, 0.0),
    read_only("sim/weather/aircraft/qnh_pas", Float, 0.0),
    read_only("sim/weather/aircraft/temperature_ambient_deg_c", Float, 0.0),
    read_only("sim/weather/view/rain_ratio", Float, 0.0),
    read_only("sim/weather/view/snow_ratio", Float, 0.0),
    read_only("sim/weather/view/temperature_C", Float, 0.0),
];

/// X-Plane 11 only. Its weather has three layers of wind, and kind and cover of a cloud in one number.
const ELEVEN: &[Dataref] = &[
    read_only(names::VERSION, Int, 115_501.0),
    float("sim/cockpit2/controls/flap_ratio"),
    writable("sim/cockpit/switches/gear_handle_status", Int, 1.0),
    int("sim/cockpit/electrical/landing_lights_on"),
    int(names::USE_REAL_WEATHER_11),
    writable(names::VISIBILITY_M_11, Float, 32_000.0),
    read_only("sim/weather/visibility_effective_m", Float, 32_000.0),
    float(names::RAIN_11),
    float(names::THUNDERSTORM_11),
    float(names::THERMAL_PERCENT_11),
    float(names::THERMAL_RATE_11),
    writable(names::TEMPERATURE_C_11, Float, 28.0),
    writable(names::PRESSURE_INHG_11, Float, 29.92),
    floats(names::CLOUD_TYPE_11, CLOUDS),
    floats("sim/weather/cloud_coverage", CLOUDS),
    floats(names::CLOUD_BASE_11, CLOUDS),
    floats(names::CLOUD_TOP_11, CLOUDS),
    floats(names::WIND_ALTITUDE_11, 3),
    floats(names::WIND_SPEED_KT_11, 3),
    floats(names::WIND_DIRECTION_11, 3),
    floats(names::TURBULENCE_11, 3),
    floats(names::SHEAR_SPEED_KT_11, 3),
    floats(names::SHEAR_DIRECTION_11, 3),
];
