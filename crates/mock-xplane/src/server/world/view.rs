//! Everything between the scene and the eye: the selected view, pop-up windows, other aircraft.
//!
//! The view belongs to the user until a plugin or a tool changes it, and a new flight resets it.

use crate::datarefs::Datarefs;
use crate::quirks::{Quirk, Quirks};

/// Dataref that is 1 if the view is from outside.
pub(super) const IS_EXTERNAL: &str = "sim/graphics/view/view_is_external";
/// Number of the view.
const TYPE: &str = "sim/graphics/view/view_type";
/// Numbers of pop-up windows that are open.
const POP_UPS: &str = "sim/cockpit2/radios/indicators/show_popup";
/// The cockpit in three dimensions.
const COCKPIT: f64 = 1_026.0;
/// The pop-up that opens automatically.
const POP_UP: usize = 1;

/// Commands that select a view, its number, and whether it is from outside.
const VIEWS: &[(&str, f64, bool)] = &[
    ("sim/view/free_camera", 1_028.0, true),
    ("sim/view/circle", 1_018.0, true),
    ("sim/view/chase", 1_017.0, true),
    ("sim/view/default_view", COCKPIT, false),
    ("sim/view/3d_cockpit_cmnd_look", COCKPIT, false),
    ("sim/view/forward_with_panel", 1_000.0, false),
    ("sim/view/forward_with_nothing", 1_024.0, false),
];
/// Commands that close a pop-up, and which.
const CLOSE: &[(&str, usize)] = &[
    ("sim/instruments/map_close", 0),
    ("sim/instruments/popup_1_close", 1),
    ("sim/instruments/popup_2_close", 2),
    ("sim/instruments/popup_3_close", 3),
    ("sim/GPS/g1000n1_popup_close", 4),
];

/// State after a new flight.
pub(super) fn begin_flight(quirks: Quirks, datarefs: &mut Datarefs) {
    if quirks.has(Quirk::CockpitView) {
        select(datarefs, COCKPIT, false);
    } else {
        select(datarefs, VIEWS[0].1, true);
    }
    let pop_up = f64::from(u8::from(quirks.has(Quirk::PopUps)));
    datarefs.set(&format!("{POP_UPS}[{POP_UP}]"), pop_up);
}

/// All commands of view and windows.
pub(super) fn commands() -> impl Iterator<Item = &'static str> {
    let views = VIEWS.iter().map(|(path, ..)| *path);
    views.chain(CLOSE.iter().map(|(path, _)| *path))
}

/// Runs a command of view or windows; returns whether it is one.
pub(super) fn command(datarefs: &mut Datarefs, path: &str) -> bool {
    if let Some(&(_, number, external)) = VIEWS.iter().find(|view| view.0 == path) {
        select(datarefs, number, external);
        return true;
    }
    let Some(&(_, at)) = CLOSE.iter().find(|close| close.0 == path) else {
        return false;
    };
    datarefs.set(&format!("{POP_UPS}[{at}]"), 0.0);
    true
}

/// Handles a client's write of a view's number.
pub(super) fn written(path: &str, datarefs: &mut Datarefs) {
    if path == TYPE {
        let number = datarefs.get(TYPE);
        let known = VIEWS.iter().find(|view| view.1 == number);
        let external = known.is_some_and(|view| view.2);
        select(datarefs, number, external);
    }
}

/// The view that a plugin's camera leaves when it is taken away.
pub(super) fn lose_camera(quirks: Quirks, datarefs: &mut Datarefs) {
    if quirks.has(Quirk::CockpitView) {
        select(datarefs, COCKPIT, false);
    }
}

/// True if the view is from inside an aircraft that has a panel.
pub(super) fn shows_panel(datarefs: &Datarefs) -> bool {
    datarefs.get(IS_EXTERNAL) == 0.0
}

/// True if a pop-up covers the image.
pub(super) fn shows_pop_up(datarefs: &Datarefs) -> bool {
    let open = datarefs.find(POP_UPS);
    open.is_some_and(|(_, numbers)| numbers.iter().any(|&open| open != 0.0))
}

fn select(datarefs: &mut Datarefs, number: f64, external: bool) {
    datarefs.set(TYPE, number);
    datarefs.set(IS_EXTERNAL, f64::from(u8::from(external)));
}
