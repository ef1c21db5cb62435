//! Residuals of rows, and of views alone beside pairs; those that training flights kept.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use sight::sight::CONTRADICTS_SD;

use super::Evidence;
use super::history::{History, Residual};
use crate::estimators::inverse_range::{InverseRange, Measurement, Tick};

/// Limit relative to the largest residual that a training flight kept. Beside paths, flights in lights that the training left out keep 0.7
/// times as much, and flights with a camera that was turned by 20 px 2.2 to 3.2 times.
const TIMES_OF_TRAINING: f64 = 2.0;
/// Minimum number of flights that show what is usual.
const MIN_FLIGHTS: usize = 4;

/// Identity of a comparison: the evidence, the views of a fit, and for paths the single view.
pub(super) type Compared = (Evidence, Vec<usize>, usize);

/// Residuals of rows, and of views alone beside pairs, at a tick. `variance_m2`: of a measurement, with all errors.
pub(super) fn residuals(
    fits: &InverseRange,
    variance_m2: impl Fn(&Measurement) -> f64,
    tick: &Tick,
) -> Vec<(Compared, f64)> {
    let rows = tick.rows.iter();
    let rows = rows.map(|(views, row)| ((Evidence::Rows, views.to_vec(), 0), *row));
    let alone = || tick.measurements.iter().filter(|of| of.of_one_view);
    let mut pairs: Vec<&Measurement> = Vec::new();
    for of in &tick.measurements {
        let views = fits.views_of(of.fit);
        let is_known = pairs.iter().any(|pair| fits.views_of(pair.fit) == views);
        if views.len() == 2 && !is_known {
            pairs.push(of);
        }
    }
    let mut residuals: Vec<(Compared, f64)> = rows.collect();
    for pair in pairs {
        let views = fits.views_of(pair.fit);
        let of_pair = alone().filter(|of| views.contains(&fits.views_of(of.fit)[0]));
        residuals.extend(of_pair.map(|of| {
            let sd_m = (variance_m2(of) + variance_m2(pair)).sqrt();
            let compared = (Evidence::Paths, views.to_vec(), fits.views_of(of.fit)[0]);
            (compared, (of.distance_m - pair.distance_m) / sd_m)
        }));
    }
    residuals
}

/// Largest residuals that training flights kept, joint standard deviations; `None` with too few flights.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(crate) struct KeptInTraining {
    rows: Option<f64>,
    /// `None` as well at another airport, where other paths are usual.
    pub(crate) paths: Option<f64>,
}

impl KeptInTraining {
    /// `flights`: ticks of flights that were held out from the fits; `variance_m2` as in [`residuals`].
    pub(crate) fn of<'a>(
        fits: &InverseRange,
        variance_m2: impl Fn(&Measurement) -> f64,
        flights: impl Iterator<Item = &'a [Tick]>,
    ) -> Self {
        let mut kept: BTreeMap<Evidence, Vec<f64>> = BTreeMap::new();
        for flight in flights {
            let mut largest: BTreeMap<Evidence, f64> = BTreeMap::new();
            let mut histories: BTreeMap<Compared, History> = BTreeMap::new();
            for tick in flight {
                for (compared, deviations) in residuals(fits, &variance_m2, tick) {
                    let evidence = compared.0;
                    let history = histories.entry(compared).or_default();
                    let time_s = tick.time_s;
                    let next = Residual { time_s, deviations };
                    history.take(next, evidence.window(), f64::INFINITY);
                    if let Some(kept) = history.kept {
                        let of_all = largest.entry(evidence).or_default();
                        *of_all = of_all.max(kept.deviations);
                    }
                }
            }
            for (evidence, largest) in largest {
                kept.entry(evidence).or_default().push(largest);
            }
        }
        let largest = |evidence| {
            let kept = kept.get(&evidence)?;
            (kept.len() >= MIN_FLIGHTS).then(|| kept.iter().copied().fold(0.0, f64::max))
        };
        Self {
            rows: largest(Evidence::Rows),
            paths: largest(Evidence::Paths),
        }
    }

    /// Line for users if nothing will reveal some contradictions between views.
    pub(crate) fn unwatched(self, fits: &InverseRange) -> Option<String> {
        let has_pairs = fits.fits.iter().any(|fit| fit.set.views.len() == 2);
        let is_unwatched =
            self.paths.is_none() && has_pairs || self.rows.is_none() && !fits.rows.is_empty();
        is_unwatched.then(|| {
            format!(
                "views that contradict each other will not be noticed by their rows and paths: fewer than {MIN_FLIGHTS} flights show how \
                 much views usually differ"
            )
        })
    }

    /// False for numbers that no training gives.
    pub(crate) fn is_possible(self) -> bool {
        let kept = [self.rows, self.paths];
        kept.into_iter().flatten().all(|kept| kept >= 0.0)
    }

    pub(super) fn limit(self, evidence: Evidence) -> f64 {
        let kept = match evidence {
            Evidence::Rows => self.rows,
            Evidence::Paths => self.paths,
            Evidence::Closing => Some(0.0),
        };
        kept.map_or(f64::INFINITY, |kept| {
            (TIMES_OF_TRAINING * kept).max(CONTRADICTS_SD)
        })
    }
}

#[cfg(test)]
impl KeptInTraining {
    /// For flights whose rows kept residuals of this size.
    pub(super) fn of_rows(deviations: f64) -> Self {
        Self {
            rows: Some(deviations),
            paths: None,
        }
    }
}
