//! Checks that a run answered for the flight in the corpus. A scenario's name only states time, weather and repeat, so a second corpus may
//! use the same name; the true distances beside the answers distinguish them.

use crate::tables::frames::TickRow;

/// Tolerance between a distance as written and as read, metres.
const SAME_M: f64 = 1e-3;

/// Compares ticks with answers, and the true distances beside them as far as they were known, with the flown distance. Returns the message
/// about a different flight, after the name of the run, if there is one.
pub fn other_flight(
    scenario: &str,
    answered: impl IntoIterator<Item = (u32, Option<f64>)>,
    flown: &[TickRow],
) -> Option<String> {
    let difference = answered.into_iter().find_map(|(tick, answered_m)| {
        let Some(row) = flown.get(tick as usize) else {
            let ticks = flown.len();
            return Some(format!(
                "has an answer at tick {tick}, this corpus's has only {ticks} ticks"
            ));
        };
        let (answered_m, flown_m) = (answered_m?, row.labels?.dtd_m);
        ((answered_m - flown_m).abs() > SAME_M).then(|| {
            format!("has {answered_m:.3} m at tick {tick}, this corpus's has {flown_m:.3} m")
        })
    })?;
    Some(format!(
        "was judged on another corpus: its scenario {scenario} {difference}; evaluate it on this corpus first"
    ))
}
