//! Coverage of the 90 % intervals that an estimator states.

use serde::{Deserialize, Serialize};

use super::Outcome;

/// Figures of stated distance intervals. Every flight has the same weight.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct StatedIntervals {
    /// Mean coverage over flights.
    pub held: f64,
    /// Minimum and maximum coverage over flights.
    pub held_by_flight: [f64; 2],
    /// Mean width over flights, percent of the true distance.
    pub width_pct: f64,
}

impl StatedIntervals {
    /// `None` without any interval.
    pub(super) fn of(outcomes: &[Outcome]) -> Option<Self> {
        let mut flights: Vec<[f64; 2]> = Vec::new();
        for flight in outcomes.chunk_by(|a, b| a.of.scenario == b.of.scenario) {
            let stated = || flight.iter().filter_map(|o| Some((o.dtd_m, o.interval_m?)));
            let count = stated().count() as f64;
            let holds = |(dtd_m, [from, to]): &(f64, [f64; 2])| (from..=to).contains(&dtd_m);
            let held = stated().filter(holds).count() as f64;
            let widths_pct = stated().map(|(dtd_m, [from, to])| 100.0 * (to - from) / dtd_m);
            if count > 0.0 {
                flights.push([held / count, widths_pct.sum::<f64>() / count]);
            }
        }
        let shares = || flights.iter().map(|[held, _]| *held);
        let mean = |sum: f64| sum / flights.len() as f64;
        Some(Self {
            held_by_flight: [shares().reduce(f64::min)?, shares().reduce(f64::max)?],
            held: mean(shares().sum()),
            width_pct: mean(flights.iter().map(|[_, width_pct]| width_pct).sum()),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluation::metrics::Group;

    #[test]
    fn every_flight_counts_the_same_and_ticks_without_an_interval_not_at_all() {
        let alike = Outcome::of_answer(1_000.0, Some(1_000.0));
        let tick = |scenario, interval_m| Outcome {
            of: Group {
                scenario,
                ..*alike.of
            }
            .leaked(),
            interval_m,
            ..alike
        };
        let (holds, misses) = (Some([990.0, 1_010.0]), Some([1_001.0, 1_011.0]));
        let outcomes = [
            tick("a", holds),
            tick("a", None),
            tick("b", misses),
            tick("b", holds),
            tick("b", holds),
            tick("b", misses),
        ];
        let figures = StatedIntervals::of(&outcomes).unwrap();
        assert_eq!((figures.held, figures.held_by_flight), (0.75, [0.5, 1.0]));
        assert!((figures.width_pct - 1.75).abs() < 1e-12);
        assert_eq!(StatedIntervals::of(&outcomes[1..2]), None);
    }
}
