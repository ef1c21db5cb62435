//! State of X-Plane that makes recording impossible: a menu, a replay.

use super::Check;
use super::talk::Talk;
use crate::datarefs::FLIGHT_TIME_S;

const IS_IN_REPLAY: &str = "sim/time/is_in_replay";
/// Names of the checks, for reporting them as skipped.
pub(super) const NAMES: [&str; 2] = ["menus", "replay"];

pub(super) async fn checks(talk: &mut Talk) -> Vec<Check> {
    vec![menus(talk).await, replay(talk).await]
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
