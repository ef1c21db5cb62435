//! Checks that a run answered for the flight in the corpus. A scenario's name only states time, weather and repeat, so a second corpus may
//! use the same name; the true distances beside the answers distinguish them.

use crate::tables::frames::TickRow;

/// Tolerance between a distance as written and as read, metres.
const SAME_M: f64 = 1e-3;

/// The first tick that shows a different flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum OtherFlight {
    /// The flight of the corpus is shorter.
    Longer {
        /// The first tick beyond it.
        tick: u32,
        /// Number of ticks in the corpus.
        ticks: usize,
    },
    /// The distances differ.
    Elsewhere {
        /// The first differing tick.
        tick: u32,
        /// Beside the answer.
        answered_m: f64,
        /// Distance in the corpus.
        flown_m: f64,
    },
}

impl OtherFlight {
    /// Compares ticks with answers, and the true distances beside them as far as they were known, with the flown distance.
    #[must_use]
    pub fn find(
        answered: impl IntoIterator<Item = (u32, Option<f64>)>,
        flown: &[TickRow],
    ) -> Option<Self> {
        answered.into_iter().find_map(|(tick, answered_m)| {
            let Some(row) = flown.get(tick as usize) else {
                let ticks = flown.len();
                return Some(Self::Longer { tick, ticks });
            };
            let (answered_m, flown_m) = (answered_m?, row.labels?.dtd_m);
            ((answered_m - flown_m).abs() > SAME_M).then_some(Self::Elsewhere {
                tick,
                answered_m,
                flown_m,
            })
        })
    }

    /// The message to the user, after the name of the run.
    #[must_use]
    pub fn words(&self, scenario: &str) -> String {
        let difference = match self {
            Self::Longer { tick, ticks } => {
                format!("has an answer at tick {tick}, this corpus's has only {ticks} ticks")
            }
            Self::Elsewhere {
                tick,
                answered_m,
                flown_m,
            } => {
                format!("has {answered_m:.3} m at tick {tick}, this corpus's has {flown_m:.3} m")
            }
        };
        format!(
            "was judged on another corpus: its scenario {scenario} {difference}; evaluate it on this corpus first"
        )
    }
}
