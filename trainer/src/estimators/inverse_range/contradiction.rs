//! Contradictions that last: while there is one, an aircraft gets no distance.
//!
//! Exchanged cameras, one file for two views, views of two flights, or a camera that was turned in fog give distances that look as certain
//! as others. Three residuals in joint standard deviations reveal them ([`Evidence`]): rows that do not fit each other, a view whose own
//! distance on the training's paths is another one ([`residuals`]), and a distance that does not shrink while the boxes grow ([`closing`]).
//! A residual counts if it stays for a whole window ([`history`]), because gusts, intercepts and wrong boxes pass. Its limit is a multiple
//! of what training flights kept that long, measured by fits that did not see them.

mod closing;
mod history;
mod residuals;

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use sight::references::MAX_SD_PX;

use super::{InverseRange, Measurement, Tick};
use crate::samples::paired_views::MAX_GAP_S;
use crate::samples::trusted_boxes::centre_and_size;
use crate::samples::{Look, Observation};

pub(crate) use closing::MIN_CLOSING_MPS;
use closing::{Closing, SizedTick};
use history::{History, Residual, Window};
pub(crate) use residuals::KeptInTraining;
use residuals::{Compared, residuals};

/// Duration of a contradiction, s.
const WINDOW_S: f64 = 20.0;
/// Duration of a contradiction with the training's paths, s: gusts keep views of the bundled simulator's flights 4 standard deviations
/// beside them for 20 s, but 1.8 for a minute; a camera that was turned by 20 px is 4 to 6 off.
const PATHS_WINDOW_S: f64 = 60.0;

/// Evidence for a contradiction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Evidence {
    /// Registered rows of two views do not fit each other, whatever the path.
    Rows,
    /// A view alone measures another distance than the pair, and no background shows that its camera was not turned.
    Paths,
    /// Boxes grow, and the distance does not shrink as fast as in any arrival.
    Closing,
}

impl Evidence {
    /// Rows may be off to both sides: each of two flights has its own gusts, while those of one aircraft move the rows of both views alike.
    fn window(self) -> Window {
        Window {
            duration_s: match self {
                Self::Paths => PATHS_WINDOW_S,
                Self::Rows | Self::Closing => WINDOW_S,
            },
            is_one_sided: self != Self::Rows,
        }
    }
}

/// Views whose boxes are not used, and the cause.
#[derive(Debug, Clone, PartialEq)]
pub struct Withheld {
    /// View indices.
    pub views: Vec<usize>,
    /// The cause.
    pub cause: Cause,
}

/// Evidence with its size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cause {
    /// Kind of contradiction.
    pub evidence: Evidence,
    /// Residual that the views kept, joint standard deviations.
    pub deviations: f64,
    /// Limit of that residual.
    pub limit: f64,
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            evidence,
            deviations,
            limit,
        } = self;
        let (seen, ask) = match evidence {
            Evidence::Rows => (
                "for 20 s the rows of the aircraft have not fitted each other",
                "do they show the same aircraft at the same time?",
            ),
            Evidence::Paths => (
                "for a minute a view alone has measured another distance on the training's paths than both together",
                "too little background is visible to exclude that a camera was turned",
            ),
            Evidence::Closing => (
                "for 20 s the boxes have grown, but the measured distance has not shrunk with them",
                "are the views exchanged, or do they show the same images?",
            ),
        };
        write!(
            f,
            "{seen} ({deviations:.1} joint standard deviations, limit {limit:.1}): {ask}"
        )
    }
}

/// A contradiction at a tick.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Contradiction {
    pub withheld: Withheld,
    /// True if it begins for one of the views: earlier measurements are doubtful.
    pub begins: bool,
    /// Start, seconds; negative infinity if the views may never have agreed.
    pub since_s: f64,
}

/// Watch for contradictions about one aircraft.
#[derive(Debug, Clone, Default)]
pub(crate) struct ContradictionWatch {
    histories: BTreeMap<Compared, History>,
    closing: Closing,
    /// Views in a contradiction at the last tick.
    views: Vec<usize>,
}

impl ContradictionWatch {
    /// Takes the next tick of an aircraft. A contradiction lasts until a window agrees, or a view has not seen the aircraft for a while.
    /// `variance_m2`: of a measurement, with all errors.
    pub(super) fn take(
        &mut self,
        (fits, training): (&InverseRange, KeptInTraining),
        variance_m2: impl Fn(&Measurement) -> f64,
        (observed, tick): (&Observation, &Tick),
    ) -> Option<Contradiction> {
        let time_s = tick.time_s;
        for (compared, deviations) in residuals(fits, &variance_m2, tick) {
            let evidence = compared.0;
            let may_be_turned = || (compared.1.iter()).any(|&view| may_be_turned(view, observed));
            if evidence == Evidence::Paths && !may_be_turned() {
                continue;
            }
            let history = self.histories.entry(compared).or_default();
            let next = Residual { time_s, deviations };
            history.take(next, evidence.window(), training.limit(evidence));
        }
        if let Some(best) = tick.best() {
            let views = fits.views_of(best.fit);
            let seen = views.iter().filter_map(|&view| observed.best(view));
            let log_widths: f64 = seen.clone().map(|seen| seen.width_px.ln()).sum();
            let place_px = seen.map(|seen| centre_and_size(seen).0).next();
            let next = SizedTick {
                time_s,
                distance_m: best.distance_m,
                variance_m2: variance_m2(best),
                log_range: (best.distance_m + fits.setback_m(best.fit)).ln(),
                log_width: log_widths / views.len() as f64,
                place_px: place_px.unwrap_or_default(),
            };
            let kept = self.closing.next(views, next);
            let compared = (Evidence::Closing, views.to_vec(), 0);
            let history = self.histories.entry(compared).or_default();
            history.judge(time_s, kept, training.limit(Evidence::Closing));
        }
        for history in self.histories.values_mut() {
            // Without one of the views, there is nothing left that contradicts.
            if time_s - history.last_s > MAX_GAP_S {
                history.kept = None;
            }
        }
        self.judge(training)
    }

    /// The contradiction by all windows. Views that agree with others are not concerned.
    fn judge(&mut self, training: KeptInTraining) -> Option<Contradiction> {
        let kept = self.histories.iter();
        let kept: Vec<_> = kept
            .filter_map(|(of, history)| Some((of, history, history.kept?)))
            .collect();
        let share = |of: &Compared, kept: &Residual| kept.deviations / training.limit(of.0);
        let over = kept.iter().filter(|(of, _, kept)| share(of, kept) > 1.0);
        let are_over = |of: &Compared| {
            over.clone()
                .any(|(other, ..)| (other.0, &other.1) == (of.0, &of.1))
        };
        let agrees = |evidence: Evidence, view: usize| {
            let mut with = kept
                .iter()
                .filter(|(of, ..)| of.0 == evidence && of.1.contains(&view));
            with.any(|(of, ..)| !are_over(of))
        };
        let suspects = |of: &Compared| -> Vec<usize> {
            of.1.iter()
                .copied()
                .filter(|&view| !agrees(of.0, view))
                .collect()
        };
        let views: BTreeSet<usize> = over.clone().flat_map(|(of, ..)| suspects(of)).collect();
        let views: Vec<usize> = views.into_iter().collect();
        let worst = over.clone().filter(|(of, ..)| !suspects(of).is_empty());
        let worst = worst.max_by(|a, b| share(a.0, &a.2).total_cmp(&share(b.0, &b.2)));
        let contradiction = worst.map(|(of, history, kept)| Contradiction {
            begins: views.iter().any(|view| !self.views.contains(view)),
            // Far away, a turned camera agrees with the paths.
            since_s: if of.0 != Evidence::Paths && history.has_agreed {
                kept.time_s
            } else {
                f64::NEG_INFINITY
            },
            withheld: Withheld {
                views: views.clone(),
                cause: Cause {
                    evidence: of.0,
                    deviations: kept.deviations,
                    limit: training.limit(of.0),
                },
            },
        });
        self.views = views;
        contradiction
    }
}

/// True if neither a background that is compared nor a stable mast shows where the camera looks.
fn may_be_turned(view: usize, observed: &Observation) -> bool {
    let errors = observed.common_errors.iter().filter(|of| of.view == view);
    let variance_px2: f64 = errors.map(|of| of.sd_px.length_squared()).sum();
    observed.looks[view] == Look::Unplaced || variance_px2 > MAX_SD_PX.powi(2)
}

/// A flight without the boxes of views that contradict each other, and the contradictions. `followed`: the number of the aircraft and the
/// tick with its boxes; `next`: the contradiction at a tick, by the watch of its aircraft.
pub(super) fn without_contradictions(
    followed: Vec<(Option<usize>, Observation)>,
    next: impl Fn(&mut ContradictionWatch, &Observation) -> Option<Contradiction>,
) -> (Vec<Observation>, Vec<Withheld>) {
    let mut watches: BTreeMap<usize, ContradictionWatch> = BTreeMap::new();
    // Views, and true at the tick from which on they are withheld.
    let mut withheld: Vec<(Vec<usize>, bool)> = Vec::with_capacity(followed.len());
    let mut said = Vec::new();
    for (index, (number, observed)) in followed.iter().enumerate() {
        let found = number.and_then(|number| next(watches.entry(number).or_default(), observed));
        let views = found
            .as_ref()
            .map_or(Vec::new(), |of| of.withheld.views.clone());
        withheld.push((views.clone(), false));
        let Some(found) = found.filter(|found| found.begins) else {
            continue;
        };
        let mut first = index;
        for earlier in (0..index).rev() {
            let (of, tick) = &followed[earlier];
            if tick.time_s() < found.since_s {
                break;
            }
            if of == number && withheld[earlier].0.is_empty() {
                withheld[earlier].0.clone_from(&views);
                first = earlier;
            }
        }
        withheld[first].1 = true;
        said.push(found.withheld);
    }
    let kept = followed.into_iter().zip(withheld);
    let kept = kept.map(|((_, observed), (views, is_new))| observed.withheld(&views, is_new));
    (kept.collect(), said)
}

#[cfg(test)]
mod tests {
    use sight::sight::CONTRADICTS_SD;

    use super::*;

    #[test]
    fn a_view_that_never_agreed_was_wrong_from_the_beginning_although_others_agree() {
        let mut watch = ContradictionWatch::default();
        let mut judged = |views: [usize; 2], deviations: f64| {
            let history = watch.histories.entry((Evidence::Rows, views.to_vec(), 0));
            let history = history.or_default();
            for tick in 0..=10 {
                let time_s = 2.0 * f64::from(tick);
                let next = Residual { time_s, deviations };
                history.take(next, Evidence::Rows.window(), CONTRADICTS_SD);
            }
            watch.judge(KeptInTraining::of_rows(1.0))
        };
        assert_eq!(judged([0, 1], 0.5), None);
        judged([0, 2], 57.0);
        let found = judged([1, 2], 57.0).unwrap();
        assert_eq!(found.withheld.views, [2]);
        assert_eq!(found.since_s, f64::NEG_INFINITY);
    }
}
