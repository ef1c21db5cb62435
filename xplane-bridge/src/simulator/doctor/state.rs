//! State of X-Plane as the user sees it: a menu, a replay, pop-ups, an aircraft.

use super::Check;
use super::talk::Talk;
use crate::datarefs::{AIRCRAFT_ICAO, AIRCRAFT_LENGTH_M, FLIGHT_TIME_S, icao_of};

const IS_IN_REPLAY: &str = "sim/time/is_in_replay";
const POP_UPS: &str = "sim/cockpit2/radios/indicators/show_popup";
/// Pop-ups to check.
const POP_UPS_COUNT: usize = 20;
/// Names of the checks, for reporting them as skipped.
pub(super) const NAMES: [&str; 4] = ["menus", "replay", "pop-ups", "aircraft"];

pub(super) async fn checks(talk: &mut Talk) -> Vec<Check> {
    vec![
        menus(talk).await,
        replay(talk).await,
        pop_ups(talk).await,
        aircraft(talk).await,
    ]
}

/// Behind a menu or a dialog X-Plane answers, but its time stands still.
async fn menus(talk: &mut Talk) -> Check {
    const NAME: &str = NAMES[0];
    let running = talk.while_running(async |talk: &mut Talk| {
        let before_s = talk.read(&[FLIGHT_TIME_S]).await[0]?;
        let moves = |now_s: f32| now_s > before_s;
        let now_s = talk.read_expecting(FLIGHT_TIME_S, moves).await?;
        Some((before_s, moves(now_s)))
    });
    match running.await {
        None => Check::skipped(NAME, format!("{FLIGHT_TIME_S} could not be read")),
        Some((_, true)) => Check::ok(NAME, "simulated time runs: none is open"),
        Some((before_s, false)) => Check::failed(
            NAME,
            format!(
                "{FLIGHT_TIME_S} stays at {before_s}: a menu or a dialog is open, or no flight is loaded"
            ),
            "Close it in X-Plane (Escape), or start a flight",
        ),
    }
}

async fn replay(talk: &mut Talk) -> Check {
    const NAME: &str = NAMES[1];
    match talk.read(&[IS_IN_REPLAY]).await[0] {
        None => Check::skipped(NAME, format!("{IS_IN_REPLAY} could not be read")),
        Some(0.0) => Check::ok(NAME, "X-Plane shows no replay"),
        Some(_) => Check::failed(
            NAME,
            "X-Plane shows a replay, which overwrites every pose",
            "Leave it: the command sim/replay/replay_off, or the button in X-Plane",
        ),
    }
}

async fn pop_ups(talk: &mut Talk) -> Check {
    const NAME: &str = NAMES[2];
    let names: Vec<String> = (0..POP_UPS_COUNT)
        .map(|at| format!("{POP_UPS}[{at}]"))
        .collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let values = talk.read(&names).await;
    let open: Vec<String> = values
        .iter()
        .enumerate()
        .filter(|(_, value)| value.is_some_and(|value| value != 0.0))
        .map(|(at, _)| at.to_string())
        .collect();
    if open.is_empty() {
        return Check::ok(NAME, "none is open");
    }
    Check::warning(
        NAME,
        format!("open: {} ({POP_UPS})", open.join(", ")),
        "They are closed before images are taken, as far as X-Plane has commands for it. Close them, and look that none comes back",
    )
}

async fn aircraft(talk: &mut Talk) -> Check {
    const NAME: &str = NAMES[3];
    let names: Vec<String> = (0..4).map(|at| format!("{AIRCRAFT_ICAO}[{at}]")).collect();
    let mut names: Vec<&str> = names.iter().map(String::as_str).collect();
    names.push(AIRCRAFT_LENGTH_M);
    let values = talk.read(&names).await;
    let type_name = icao_of(&values[..4]);
    if type_name.is_empty() {
        return Check::warning(
            NAME,
            format!("its type cannot be read ({AIRCRAFT_ICAO})"),
            "Load the aircraft that the sweep names: its type cannot be checked while recording either",
        );
    }
    let size = match values[4] {
        Some(length_m) if length_m > 0.0 => format!(", {length_m:.0} m long"),
        _ => String::new(),
    };
    Check::ok(
        NAME,
        format!("a {type_name}{size}; another one is loaded if the sweep names it"),
    )
}
