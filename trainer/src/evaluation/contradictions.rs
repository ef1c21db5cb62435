//! Warnings of flights whose boxes are not believed.

use std::collections::BTreeMap;

use dataset::work::watch::Watch;

use crate::estimators::inverse_range::contradiction::{Evidence, Withheld};
use crate::live::MIN_WITHHELD_S;
use crate::samples::camera_health::first_of;
use crate::samples::paired_views::STEP_S;
use crate::samples::{Observation, Samples};

/// Lines about flights, by evidence; `None`: no box of the flight is believed in the first place.
#[derive(Default)]
pub(crate) struct Contradictions(BTreeMap<Option<Evidence>, Vec<String>>);

impl Contradictions {
    /// Adds a flight: what was seen, what of it is believed, and the contradictions.
    pub(crate) fn add<'a>(
        &mut self,
        samples: &Samples,
        seen: impl Iterator<Item = &'a Observation>,
        (believed, found): (&[Observation], &[Withheld]),
    ) {
        let Some(scenario) = believed.first().map(|first| first.scenario) else {
            return;
        };
        let id = &samples.scenarios[scenario].id;
        for Withheld { views, cause } in found {
            let views: Vec<_> = views.iter().map(|view| &*samples.views[*view]).collect();
            let line = format!("{id}: no distances from {}: {cause}", views.join(" and "));
            self.0.entry(Some(cause.evidence)).or_default().push(line);
        }
        let seen_s = in_sight_s(seen);
        if found.is_empty() && seen_s >= MIN_WITHHELD_S && !believed.iter().any(has_box) {
            let line = format!(
                "{id}: no distances, although an aircraft was in sight for {seen_s:.0} s: its boxes in the views do not match each other, or \
                 none is where the training had any; were cameras turned or exchanged?"
            );
            self.0.entry(None).or_default().push(line);
        }
    }

    /// Warns of the first flight with each evidence, with the number of others.
    pub(crate) fn report(&self, watch: &dyn Watch) {
        for line in self.0.values().filter_map(|lines| first_of(lines)) {
            watch.warn(&line);
        }
    }
}

fn has_box(observed: &Observation) -> bool {
    observed.detections() > 0
}

/// Time with a box in any view, s: a box counts since the tick before, for at most [`STEP_S`].
fn in_sight_s<'a>(seen: impl Iterator<Item = &'a Observation>) -> f64 {
    let (mut total_s, mut last_s) = (0.0, f64::NEG_INFINITY);
    for observed in seen {
        if has_box(observed) {
            total_s += (observed.time_s() - last_s).min(STEP_S);
        }
        last_s = observed.time_s();
    }
    total_s
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_aircraft_is_in_sight_while_a_view_has_its_box() {
        let at = |tick: u32| {
            let observed = Observation::registered(tick, [500.0; 2]);
            match tick {
                1 | 8.. => observed,
                _ => observed.with_boxes_that(|_, _| false),
            }
        };
        let flight: Vec<_> = (0..20).map(at).collect();
        let step_s = flight[1].time_s().min(STEP_S);
        assert_eq!(in_sight_s(flight.iter()), 13.0 * step_s);
    }
}
