//! Interval widths that hold a given share of the errors on new flights.
//!
//! Errors within a flight are alike, so flights are exchangeable and ticks are not. Errors from all flights are pooled, each flight with
//! the same weight (Dunn, Wasserman and Ramdas, "Distribution-free prediction sets for two-layer hierarchical models", 2022), and the width
//! is a quantile of the pool. The quantile at the share itself covers less on a flight outside the pool, especially with few flights and
//! similar errors within a flight: with nine flights and one error each, the largest covers 90 % of others. Leaving each flight out in turn
//! measures the coverage, and the level is the lowest one that reaches the share (Beran, "Calibrating prediction regions", 1990).

/// Maximum number of errors per flight; more quantiles do not change the width.
const MAX_ERRORS: usize = 400;
const HALVINGS: usize = 12;
/// 95 % quantiles of Student's t with 1, 2, ... degrees of freedom, relative to the normal distribution.
const STUDENT_OVER_NORMAL: [f64; 10] = [
    3.838, 1.775, 1.431, 1.296, 1.225, 1.181, 1.152, 1.131, 1.114, 1.102,
];
/// Rounding error in sums of reciprocals.
const ROUNDING: f64 = 1e-9;

/// Width that holds this share of the errors on a new flight, on average. `flights`: absolute errors, in standard deviations. `None`
/// without any.
pub(super) fn width_that_holds(share: f64, flights: Vec<Vec<f64>>) -> Option<f64> {
    let pool = Pool::of(flights)?;
    let flights = pool.flights.len();
    if pool.held_of_others(1.0) < share {
        // With so few flights, even the largest error is too small. If flights differ by normal deviations, this is the missing factor.
        let [.., last] = STUDENT_OVER_NORMAL;
        let wider = STUDENT_OVER_NORMAL.get(flights - 1).unwrap_or(&last);
        return Some(wider * pool.quantile(1.0, None));
    }
    let (mut low, mut high) = (share, 1.0);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if pool.held_of_others(middle) < share {
            low = middle;
        } else {
            high = middle;
        }
    }
    Some(pool.quantile(high, None))
}

struct Pool {
    /// Per flight, ascending.
    flights: Vec<Vec<f64>>,
    /// All errors with their flights, ascending.
    errors: Vec<(f64, usize)>,
}

impl Pool {
    fn of(flights: Vec<Vec<f64>>) -> Option<Self> {
        let flights: Vec<Vec<f64>> = flights
            .into_iter()
            .map(sorted_and_thinned)
            .filter(|errors| !errors.is_empty())
            .collect();
        let numbered = flights.iter().enumerate();
        let mut errors: Vec<(f64, usize)> = numbered
            .flat_map(|(flight, errors)| errors.iter().map(move |&error| (error, flight)))
            .collect();
        errors.sort_by(|a, b| a.0.total_cmp(&b.0));
        (!flights.is_empty()).then_some(Self { flights, errors })
    }

    /// Smallest width that holds a share of the errors in all flights but one; 0 if there is no other.
    fn quantile(&self, share: f64, without: Option<usize>) -> f64 {
        let flights = self.flights.len() - usize::from(without.is_some());
        let enough = share * flights as f64 - ROUNDING;
        let mut held = 0.0;
        let mut largest = 0.0;
        for &(error, flight) in &self.errors {
            if Some(flight) == without {
                continue;
            }
            held += (self.flights[flight].len() as f64).recip();
            largest = error;
            if held >= enough {
                break;
            }
        }
        largest
    }

    /// Mean coverage on a left-out flight by the quantile at this level.
    fn held_of_others(&self, level: f64) -> f64 {
        let held = self.flights.iter().enumerate().map(|(number, errors)| {
            let width = self.quantile(level, Some(number));
            errors.partition_point(|&error| error <= width) as f64 / errors.len() as f64
        });
        held.sum::<f64>() / self.flights.len() as f64
    }
}

fn sorted_and_thinned(mut errors: Vec<f64>) -> Vec<f64> {
    errors.retain(|error| error.is_finite());
    errors.sort_by(f64::total_cmp);
    let kept = errors.len().min(MAX_ERRORS);
    let middle_of = |part: usize| (2 * part + 1) * errors.len() / (2 * kept);
    (0..kept).map(|part| errors[middle_of(part)]).collect()
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha12Rng;

    use super::*;
    use crate::estimators::inverse_range::flight_filter::tests::normal;

    const SHARE: f64 = 0.9;

    /// Kind of errors within a flight, and variation between flights.
    #[derive(Clone, Copy)]
    struct Kind {
        /// Correlation between successive errors.
        correlation: f64,
        /// Share of the variance that is constant during a flight.
        constant_share: f64,
        /// Standard deviation of the logarithm of error sizes between flights.
        size_spread: f64,
    }

    fn flight(kind: Kind, random: &mut ChaCha12Rng) -> Vec<f64> {
        let constant = kind.constant_share.sqrt() * normal(random);
        let size = (kind.size_spread * normal(random)).exp();
        let mut error = normal(random);
        (0..120)
            .map(|_| {
                let new = (1.0 - kind.correlation.powi(2)).sqrt() * normal(random);
                error = kind.correlation * error + new;
                size * ((1.0 - kind.constant_share).sqrt() * error + constant).abs()
            })
            .collect()
    }

    /// Coverage of other flights by the width that `width` derives from some flights, mean over many draws.
    fn held(kind: Kind, flights: usize, width: impl Fn(Vec<Vec<f64>>) -> Option<f64>) -> f64 {
        const DRAWS: u64 = 200;
        const OTHERS: usize = 20;
        let held = (0..DRAWS).map(|seed| {
            let random = &mut ChaCha12Rng::seed_from_u64(seed);
            let known = (0..flights).map(|_| flight(kind, random)).collect();
            let width = width(known).unwrap();
            let others = (0..OTHERS).flat_map(|_| flight(kind, random));
            let inside = others.filter(|&error| error <= width).count();
            inside as f64 / (OTHERS * 120) as f64
        });
        held.sum::<f64>() / DRAWS as f64
    }

    #[test]
    fn nine_tenths_of_other_flights_are_held_however_few_flights_are_known_and_however_alike_errors_are()
     {
        let kinds = [
            (0.0, 0.0, 0.0),
            (0.9, 0.0, 0.3),
            (0.97, 0.5, 0.5),
            (0.99, 0.8, 0.3),
        ];
        for (correlation, constant_share, size_spread) in kinds {
            let kind = Kind {
                correlation,
                constant_share,
                size_spread,
            };
            for flights in [3, 5, 9, 20] {
                let held = held(kind, flights, |known| width_that_holds(SHARE, known));
                println!(
                    "{correlation} {constant_share} {size_spread}, {flights} flights: {held:.3}"
                );
                assert!((0.87..0.93).contains(&held), "{flights} flights: {held}");
            }
        }
    }

    #[test]
    fn of_flights_with_one_error_each_the_rank_is_that_of_exchangeability() {
        // One more flight is as likely to come in any of 20 places; the 18th of 19 is in 90 % of cases not exceeded.
        let flights = (1..=19).map(|error| vec![f64::from(error)]).collect();
        assert_eq!(width_that_holds(SHARE, flights), Some(18.0));
    }

    #[test]
    fn every_flight_counts_the_same_however_many_ticks_it_has() {
        let mut flights: Vec<Vec<f64>> = (1..=19).map(|error| vec![f64::from(error)]).collect();
        flights[0] = vec![1.0; 10_000];
        assert_eq!(width_that_holds(SHARE, flights), Some(18.0));
    }

    #[test]
    fn one_flight_gives_a_cautious_width_and_none_gives_none() {
        assert_eq!(width_that_holds(SHARE, vec![vec![2.0, 1.0]]), Some(7.676));
        assert_eq!(width_that_holds(SHARE, vec![vec![], vec![f64::NAN]]), None);
    }
}
