//! What the autopilot's commands set, and whether it could fly an approach.

use xplane_bridge::datarefs as names;
use xplane_bridge::fly::FlyRequest;

use super::World;
use crate::datarefs::Datarefs;

/// Commands, and the dataref that each sets.
pub(super) const COMMANDS: &[(&str, &str, f64)] = &[
    (names::COMMAND_SERVOS_ON, names::AUTOPILOT_MODE, 2.0),
    ("sim/autopilot/servos_off", names::AUTOPILOT_MODE, 0.0),
    (
        "sim/autopilot/autothrottle_on",
        "sim/cockpit/autopilot/autothrottle_enabled",
        1.0,
    ),
    (
        "sim/autopilot/NAV",
        "sim/cockpit2/autopilot/nav_status",
        1.0,
    ),
    (
        "sim/autopilot/glide_slope",
        "sim/cockpit2/autopilot/glideslope_status",
        1.0,
    ),
    (
        "sim/autopilot/approach",
        "sim/cockpit2/autopilot/approach_status",
        1.0,
    ),
];

/// Does a command of the autopilot; says whether it is one.
pub(super) fn command(datarefs: &mut Datarefs, path: &str) -> bool {
    let known = COMMANDS.iter().find(|(command, ..)| *command == path);
    if let Some(&(_, dataref, value)) = known {
        datarefs.set(dataref, value);
    }
    known.is_some()
}

impl World {
    /// Refuses a flight that X-Plane's autopilot could not fly: it must be engaged, with the receiver on the landing system.
    pub(in crate::server) fn check_autopilot(&self, request: &FlyRequest) -> Result<(), String> {
        let datarefs = self.datarefs();
        let mode = datarefs.get(names::AUTOPILOT_MODE);
        if mode != 2.0 {
            return Err(format!(
                "the autopilot is off ({} is {mode}, expected 2)",
                names::AUTOPILOT_MODE
            ));
        }
        let tuned = datarefs.get(names::NAV1_FREQUENCY);
        let runway = &request.runway;
        match runway.ils_frequency_mhz.map(names::nav_frequency_10khz) {
            Some(wanted) if wanted != tuned => Err(format!(
                "the landing system of {} {} is not tuned ({} is {tuned}, expected {wanted})",
                runway.airport,
                runway.name,
                names::NAV1_FREQUENCY
            )),
            _ => Ok(()),
        }
    }
}
