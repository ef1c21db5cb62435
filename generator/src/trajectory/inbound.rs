//! The approach within a flight: a recording may begin with a departure, a circuit or an earlier approach.

/// Indices of states.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Inbound {
    /// First state of the approach: at or within the required start distance.
    pub(crate) first: usize,
    /// The first state at or past the touchdown target, if the flight gets there.
    pub(crate) passing: Option<usize>,
}

/// The last approach: it ends where the aircraft last passes the target coming from the air, and begins at the last crossing of
/// `start_dtd_m` before, or where the aircraft was furthest out if it never was as far. `to_go_m` are the remaining distances along the
/// course; a state whose distance is NaN is taken for far away.
///
/// `None`: no state is before the target.
pub(crate) fn last_approach(
    to_go_m: &[f64],
    is_airborne: impl Fn(usize) -> bool,
    start_dtd_m: f64,
) -> Option<Inbound> {
    let mut approaches = Approaches::new(start_dtd_m);
    for (index, to_go_m) in to_go_m.iter().enumerate() {
        approaches.add(*to_go_m, is_airborne(index));
    }
    approaches.last()
}

/// Incremental [`last_approach`], for flights of any length.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Approaches {
    start_dtd_m: f64,
    states: usize,
    /// The states before the target since it was passed.
    run: Option<Run>,
    /// The last approach that passes the target.
    passing: Option<Inbound>,
}

/// States before the target, one after the other.
#[derive(Debug, Clone, Copy)]
struct Run {
    /// The one after the last that is further away than the approach begins.
    after_far: Option<usize>,
    /// The last of those that are furthest away, and its distance.
    furthest: (usize, f64),
    comes_from_the_air: bool,
}

impl Approaches {
    pub(crate) fn new(start_dtd_m: f64) -> Self {
        Self {
            start_dtd_m,
            states: 0,
            run: None,
            passing: None,
        }
    }

    pub(crate) fn add(&mut self, to_go_m: f64, is_airborne: bool) {
        let index = self.states;
        self.states += 1;
        if to_go_m > 0.0 || to_go_m.is_nan() {
            let run = self.run.get_or_insert(Run {
                after_far: None,
                furthest: (index, to_go_m),
                comes_from_the_air: false,
            });
            if to_go_m.is_nan() || to_go_m > self.start_dtd_m {
                run.after_far = Some(index + 1);
            }
            if to_go_m.total_cmp(&run.furthest.1).is_ge() {
                run.furthest = (index, to_go_m);
            }
            run.comes_from_the_air |= is_airborne;
            return;
        }
        // A take-off run passes the target as well, but begins on the ground.
        if let Some(run) = self.run.take().filter(|run| run.comes_from_the_air) {
            self.passing = Some(Inbound {
                first: run.first(),
                passing: Some(index),
            });
        }
    }

    /// The last approach up to now.
    pub(crate) fn last(&self) -> Option<Inbound> {
        let ends_before = || {
            let first = self.run?.first();
            (first < self.states).then_some(Inbound {
                first,
                passing: None,
            })
        };
        self.passing.or_else(ends_before)
    }
}

impl Run {
    fn first(&self) -> usize {
        self.after_far.unwrap_or(self.furthest.0)
    }
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
