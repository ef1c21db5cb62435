//! Autopilot: effects of its commands, and readiness for an approach.
//!
//! Its modes are toggle buttons, as in X-Plane. Two rules lack a source and are the stand-in's choice: the approach button presses the
//! buttons for localizer and glide slope at once, and the approach is on whenever both are.

use xplane_bridge::datarefs as names;
use xplane_bridge::fly::FlyRequest;

use super::World;
use crate::datarefs::Datarefs;

/// Power of the autopilot.
pub(super) const ELECTRIC_MASTER: &str = "sim/cockpit2/autopilot/autopilot_electric_master";
/// The altitude that is dialled: 0 off, 1 armed, 2 captured.
const ALTITUDE_HOLD_STATUS: &str = "sim/cockpit2/autopilot/altitude_hold_status";
/// The vertical speed that is dialled: 0 off, 1 armed, 2 captured.
const VERTICAL_SPEED_STATUS: &str = "sim/cockpit2/autopilot/vvi_status";

#[derive(Debug, Clone, Copy)]
enum Effect {
    /// Sets a dataref, always to the same value.
    Set(&'static str, f64),
    /// Switches a mode.
    Toggle(&'static str),
    /// Toggles a mode that excludes the second one.
    ToggleInsteadOf(&'static str, &'static str),
    /// Switches localizer and glide slope together.
    ToggleApproach,
}

const EFFECTS: &[(&str, Effect)] = &[
    (
        names::COMMAND_SERVOS_ON,
        Effect::Set(names::AUTOPILOT_MODE, 2.0),
    ),
    (
        "sim/autopilot/servos_off",
        Effect::Set(names::AUTOPILOT_MODE, 0.0),
    ),
    (
        names::COMMAND_AUTOTHROTTLE_ON,
        Effect::Set(names::AUTOTHROTTLE, 1.0),
    ),
    (names::COMMAND_NAV, Effect::Toggle(names::NAV_STATUS)),
    (
        names::COMMAND_GLIDE_SLOPE,
        Effect::Toggle(names::GLIDE_SLOPE_STATUS),
    ),
    (names::COMMAND_APPROACH, Effect::ToggleApproach),
    (
        "sim/autopilot/altitude_hold",
        Effect::ToggleInsteadOf(ALTITUDE_HOLD_STATUS, VERTICAL_SPEED_STATUS),
    ),
    (
        "sim/autopilot/vertical_speed",
        Effect::ToggleInsteadOf(VERTICAL_SPEED_STATUS, ALTITUDE_HOLD_STATUS),
    ),
];

/// All commands of the autopilot.
pub(super) fn commands() -> impl Iterator<Item = &'static str> {
    EFFECTS.iter().map(|&(path, _)| path)
}

/// Runs a command of the autopilot; returns whether it is one.
pub(super) fn command(datarefs: &mut Datarefs, path: &str) -> bool {
    let Some(&(_, effect)) = EFFECTS.iter().find(|(command, _)| *command == path) else {
        return false;
    };
    if datarefs.get(ELECTRIC_MASTER) == 0.0 {
        tracing::debug!(path, "ignored: the autopilot has no power");
        return true;
    }
    let number = |on: bool| if on { 1.0 } else { 0.0 };
    match effect {
        Effect::Set(dataref, value) => datarefs.set(dataref, value),
        Effect::Toggle(mode) => datarefs.set(mode, number(!is_on(datarefs, mode))),
        Effect::ToggleInsteadOf(mode, other) => {
            let on = !is_on(datarefs, mode);
            datarefs.set(mode, number(on));
            if on {
                datarefs.set(other, 0.0);
            }
        }
        Effect::ToggleApproach => {
            let on = number(!follows_landing_system(datarefs));
            datarefs.set(names::NAV_STATUS, on);
            datarefs.set(names::GLIDE_SLOPE_STATUS, on);
        }
    }
    let approach = number(follows_landing_system(datarefs));
    datarefs.set(names::APPROACH_STATUS, approach);
    true
}

fn is_on(datarefs: &Datarefs, mode: &str) -> bool {
    datarefs.get(mode) > 0.0
}

fn follows_landing_system(datarefs: &Datarefs) -> bool {
    is_on(datarefs, names::NAV_STATUS) && is_on(datarefs, names::GLIDE_SLOPE_STATUS)
}

impl World {
    /// True if the autopilot follows localizer and glide slope.
    pub(in crate::server) fn flies_approach(&self) -> bool {
        let datarefs = self.datarefs();
        datarefs.get(names::AUTOPILOT_MODE) == 2.0 && follows_landing_system(datarefs)
    }

    /// Engages the autopilot on the landing system, as the plugin does in an X-Plane. Rejects a flight that it could not fly: it must have
    /// power, and the receiver must be on the landing system.
    pub(in crate::server) fn engage_autopilot(
        &mut self,
        request: &FlyRequest,
    ) -> Result<(), String> {
        for path in [names::COMMAND_SERVOS_ON, names::COMMAND_AUTOTHROTTLE_ON] {
            self.command(path);
        }
        if !self.flies_approach() {
            self.command(names::COMMAND_APPROACH);
        }
        if !self.flies_approach() {
            return Err(format!(
                "the autopilot has no power ({ELECTRIC_MASTER} is 0, expected 1)"
            ));
        }
        let tuned = self.datarefs().get(names::NAV1_FREQUENCY);
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
