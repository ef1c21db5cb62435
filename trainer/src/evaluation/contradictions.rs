//! Warnings of flights with contradictions.

use std::collections::BTreeMap;

use dataset::work::watch::Watch;

use crate::estimators::inverse_range::contradiction::{Evidence, Withheld};
use crate::samples::Samples;
use crate::samples::camera_health::first_of;

/// Lines about flights, by evidence.
#[derive(Default)]
pub(crate) struct Contradictions(BTreeMap<Evidence, Vec<String>>);

impl Contradictions {
    /// Adds the contradictions in a flight. `scenario`: its index.
    pub(crate) fn add(&mut self, samples: &Samples, scenario: usize, found: &[Withheld]) {
        let id = &samples.scenarios[scenario].id;
        for Withheld { views, cause } in found {
            let views: Vec<_> = views.iter().map(|view| &*samples.views[*view]).collect();
            let line = format!("{id}: no distances from {}: {cause}", views.join(" and "));
            self.0.entry(cause.evidence).or_default().push(line);
        }
    }

    /// Warns of the first flight with each evidence, with the number of others.
    pub(crate) fn report(&self, watch: &dyn Watch) {
        for line in self.0.values().filter_map(|lines| first_of(lines)) {
            watch.warn(&line);
        }
    }
}
