//! The part of a flight that is the approach: a recording may begin with a departure, a circuit or another approach.

/// Indices of states.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Inbound {
    /// The first state of the approach: at or within the distance at which it should begin.
    pub(crate) first: usize,
    /// The first state at or past the touchdown target, if the flight gets there.
    pub(crate) passing: Option<usize>,
}

/// The last approach of a flight: it ends where the aircraft last passes the target coming from the air, and begins at the last
/// crossing of `start_dtd_m` before, or where the aircraft was furthest out if it never was as far. `to_go_m` are the remaining
/// distances along the course; a state whose distance is NaN is taken for far away.
///
/// `None`: no state is before the target.
pub(crate) fn last_approach(
    to_go_m: &[f64],
    is_airborne: impl Fn(usize) -> bool,
    start_dtd_m: f64,
) -> Option<Inbound> {
    let before = |index: usize| to_go_m[index] > 0.0 || to_go_m[index].is_nan();
    let passes = |index: &usize| before(index - 1) && !before(*index);
    // A take-off run passes the target as well, but begins on the ground.
    let comes_from_the_air = |passing: &usize| {
        (0..*passing)
            .rev()
            .take_while(|index| before(*index))
            .any(&is_airborne)
    };
    let crossings = (1..to_go_m.len()).rev().filter(passes);
    let passing = crossings.clone().find(comes_from_the_air);
    let end = passing.unwrap_or(to_go_m.len());
    let since = (0..end).rev().take_while(|index| before(*index)).last()?;
    let is_far = |index: usize| to_go_m[index].is_nan() || to_go_m[index] > start_dtd_m;
    let first = match (since..end).rev().find(|index| is_far(*index)) {
        Some(far) => far + 1,
        None => (since..end).max_by(|a, b| to_go_m[*a].total_cmp(&to_go_m[*b]))?,
    };
    (first < to_go_m.len()).then_some(Inbound { first, passing })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_straight_approach_begins_at_the_asked_distance_and_ends_at_the_target() {
        let to_go_m = [400.0, 300.0, 200.0, 100.0, 0.0, -100.0];
        let found = last_approach(&to_go_m, |_| true, 250.0);
        assert_eq!(
            found,
            Some(Inbound {
                first: 2,
                passing: Some(4)
            })
        );
    }

    #[test]
    fn the_run_of_a_take_off_is_no_approach() {
        // Takes off past the target, flies a circuit and lands.
        let to_go_m = [
            300.0, 100.0, -100.0, -500.0, 200.0, 900.0, 600.0, 200.0, -100.0,
        ];
        let found = last_approach(&to_go_m, |index| (3..8).contains(&index), 5_000.0);
        assert_eq!(
            found,
            Some(Inbound {
                first: 5,
                passing: Some(8)
            })
        );
        let departure = last_approach(&to_go_m[..4], |index| index == 3, 5_000.0);
        assert_eq!(departure, None);
    }

    #[test]
    fn the_last_crossing_counts_where_an_aircraft_holds() {
        let to_go_m = [900.0, 700.0, 800.0, 950.0, 700.0, 300.0, -1.0, 50.0, -1.0];
        let on_ground_from = 6;
        let found = last_approach(&to_go_m, |index| index < on_ground_from, 850.0);
        assert_eq!(
            found,
            Some(Inbound {
                first: 4,
                passing: Some(6)
            })
        );
    }

    #[test]
    fn a_flight_that_ends_before_the_target_has_no_passing() {
        let found = last_approach(&[900.0, 700.0, 500.0], |_| true, 1e9);
        assert_eq!(
            found,
            Some(Inbound {
                first: 0,
                passing: None
            })
        );
        assert_eq!(last_approach(&[-1.0, -200.0], |_| true, 1e9), None);
    }
}
