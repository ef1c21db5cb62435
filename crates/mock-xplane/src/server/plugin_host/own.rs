//! Datarefs of a plugin's host: local coordinates, and those that only the plugin uses.

use crate::datarefs::Dataref;
use crate::datarefs::Kind::{Double, Float, Int};
use crate::datarefs::known::{array, read_only, writable};

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

/// Datarefs stored here: those in local coordinates, and those that only the plugin uses.
pub(super) const OWN: [Dataref; 25] = [
    writable("sim/flightmodel/position/local_x", Double, 0.0),
    writable("sim/flightmodel/position/local_y", Double, 0.0),
    writable("sim/flightmodel/position/local_z", Double, 0.0),
    writable("sim/flightmodel/position/local_vx", Float, 0.0),
    writable("sim/flightmodel/position/local_vy", Float, 0.0),
    writable("sim/flightmodel/position/local_vz", Float, 0.0),
    writable("sim/flightmodel/position/psi", Float, 0.0),
    writable("sim/flightmodel/position/theta", Float, 0.0),
    writable("sim/flightmodel/position/phi", Float, 0.0),
    array("sim/flightmodel/position/q", Float, 4, 0.0),
    read_only(TRUE_AIRSPEED, Float, 0.0),
    read_only(INDICATED_AIRSPEED, Float, 0.0),
    read_only(ON_GROUND, Int, 0.0),
    // The flight's own time: the world's follows real time, frames here follow their period.
    read_only(FLIGHT_TIME_S, Float, 0.0),
    read_only("sim/aircraft/engine/acf_num_engines", Int, 2.0),
    // Parked, cold and dark.
    Dataref {
        writable: false,
        ..array(ENGINES_RUNNING, Int, 8, 0.0)
    },
    read_only("sim/graphics/view/using_modern_driver", Int, 0.0),
    read_only("sim/flightmodel2/misc/has_crashed", Int, 0.0),
    read_only("sim/flightmodel2/controls/flap1_deploy_ratio", Float, 0.0),
    array("sim/flightmodel2/gear/deploy_ratio", Float, 10, 1.0),
    writable(FLAPS, Float, 0.0),
    writable("sim/flightmodel/controls/flap2rat", Float, 0.0),
    array(GEAR, Float, 10, 1.0),
    writable(ALTITUDE_DIAL_FT, Float, 0.0),
    writable(VERTICAL_SPEED_FPM, Float, 0.0),
];
