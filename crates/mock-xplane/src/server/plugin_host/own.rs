//! Datarefs of a plugin's host: local coordinates, and those that only the plugin uses.

use crate::datarefs::Kind;

pub(super) const FLAPS: &str = "sim/flightmodel/controls/flaprat";
pub(super) const GEAR: &str = "sim/aircraft/parts/acf_gear_deploy";
pub(super) const TRUE_AIRSPEED: &str = "sim/flightmodel/position/true_airspeed";
pub(super) const INDICATED_AIRSPEED: &str = "sim/flightmodel/position/indicated_airspeed";
pub(super) const VERTICAL_SPEED_FPM: &str = "sim/cockpit/autopilot/vertical_velocity";
pub(super) const ON_GROUND: &str = "sim/flightmodel/failures/onground_any";
pub(super) const ALTITUDE_DIAL_FT: &str = "sim/cockpit/autopilot/altitude";
pub(super) const FLIGHT_TIME_S: &str = "sim/time/total_flight_time_sec";
pub(super) const ENGINES_RUNNING: &str = "sim/flightmodel/engine/ENGN_running";
pub(super) const LOCAL_XYZ: [&str; 3] = [
    "sim/flightmodel/position/local_x",
    "sim/flightmodel/position/local_y",
    "sim/flightmodel/position/local_z",
];
pub(super) const LOCAL_VELOCITY: [&str; 3] = [
    "sim/flightmodel/position/local_vx",
    "sim/flightmodel/position/local_vy",
    "sim/flightmodel/position/local_vz",
];

/// An [`OWN`] dataref: name, kind, length, whether the plugin may write it, first value.
pub(super) type Own = (&'static str, Kind, Option<usize>, bool, f64);

const fn own(name: &'static str, kind: Kind) -> Own {
    (name, kind, None, true, 0.0)
}

const fn array(name: &'static str, length: usize, first: f64) -> Own {
    (name, Kind::Float, Some(length), true, first)
}

const fn read_only(name: &'static str, kind: Kind) -> Own {
    (name, kind, None, false, 0.0)
}

/// Datarefs stored here: those in local coordinates, and those that only the plugin uses.
pub(super) const OWN: [Own; 25] = [
    own("sim/flightmodel/position/local_x", Kind::Double),
    own("sim/flightmodel/position/local_y", Kind::Double),
    own("sim/flightmodel/position/local_z", Kind::Double),
    own("sim/flightmodel/position/local_vx", Kind::Float),
    own("sim/flightmodel/position/local_vy", Kind::Float),
    own("sim/flightmodel/position/local_vz", Kind::Float),
    own("sim/flightmodel/position/psi", Kind::Float),
    own("sim/flightmodel/position/theta", Kind::Float),
    own("sim/flightmodel/position/phi", Kind::Float),
    array("sim/flightmodel/position/q", 4, 0.0),
    read_only(TRUE_AIRSPEED, Kind::Float),
    read_only(INDICATED_AIRSPEED, Kind::Float),
    read_only(ON_GROUND, Kind::Int),
    // The flight's own time: the world's follows real time, frames here follow their period.
    read_only(FLIGHT_TIME_S, Kind::Float),
    (
        "sim/aircraft/engine/acf_num_engines",
        Kind::Int,
        None,
        false,
        2.0,
    ),
    // Parked, cold and dark.
    (ENGINES_RUNNING, Kind::Int, Some(8), false, 0.0),
    read_only("sim/graphics/view/using_modern_driver", Kind::Int),
    read_only("sim/flightmodel2/misc/has_crashed", Kind::Int),
    read_only("sim/flightmodel2/controls/flap1_deploy_ratio", Kind::Float),
    array("sim/flightmodel2/gear/deploy_ratio", 10, 1.0),
    own(FLAPS, Kind::Float),
    own("sim/flightmodel/controls/flap2rat", Kind::Float),
    array(GEAR, 10, 1.0),
    own(ALTITUDE_DIAL_FT, Kind::Float),
    own(VERTICAL_SPEED_FPM, Kind::Float),
];
