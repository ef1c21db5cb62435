//! Contradictions that last: while there is one, an aircraft gets no distance.
//!
//! Exchanged cameras, one file for two views, views of two flights, or a camera that was turned in fog give distances that look as certain
//! as others. Three residuals in joint standard deviations reveal them ([`Evidence`]): rows that do not fit each other, a view whose own
//! distance on the training's paths is another one, and a distance that does not shrink while the boxes grow. A residual counts if it
//! stays on one side for a whole window, because gusts, intercepts and wrong boxes pass. Its limit is a multiple of what training flights
//! kept that long, measured by fits that did not see them.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::fmt;

use serde::{Deserialize, Serialize};

use super::FlightFilter;
use super::forward::Tick;
use super::gaussian::NEAR_DEVIATIONS;
use super::labelled_flight::LabelledFlight;
use crate::estimators::inverse_range::{InverseRange, Measurement};
use crate::samples::paired_views::{MAX_GAP_S, STEP_S, STILL_GROWTH};
use crate::samples::{Look, Observation};

/// Duration of a contradiction, s.
const WINDOW_S: f64 = 20.0;
/// Duration of a contradiction with the training's paths, s: gusts keep views of the bundled simulator's flights 4 standard deviations
/// beside them for 20 s, but 1.8 for a minute; a camera that was turned by 20 px is 4 to 6 off.
const PATHS_WINDOW_S: f64 = 60.0;
/// Minimum number of ticks in a window.
const MIN_TICKS: usize = 5;
/// Share of outliers on either side: single wrong boxes.
const OUTLIERS: f64 = 0.1;
/// Limit relative to the largest residual that a training flight kept. Beside paths, flights in lights that the training left out keep 0.7
/// times as much, and flights with a camera that was turned by 20 px 2.2 to 3.2 times.
const TIMES_OF_TRAINING: f64 = 2.0;
/// Minimum number of flights that show what is usual.
const MIN_FLIGHTS: usize = 4;
/// Standard deviation of a direction below which a camera counts as not turned, pixels: the largest of a background that is compared.
const MAX_PLACED_SD_PX: f64 = 0.5;
/// Minimum closing speed of an arrival, m/s: a light aircraft against the wind.
pub(crate) const MIN_CLOSING_MPS: f64 = 25.0;
/// Share of the boxes' growth that the distances have to explain, unless they shrink as fast as in an arrival: an aircraft that comes out
/// of fog grows ten times as fast as it approaches.
const MIN_EXPLAINED: f64 = 0.5;

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
    /// What contradicts.
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

/// What a residual compares: the evidence, the views of a fit, and for paths the view alone.
type Compared = (Evidence, Vec<usize>, usize);

/// Largest residuals that training flights kept, joint standard deviations; `None` with too few flights.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct KeptInTraining {
    rows: Option<f64>,
    /// `None` as well at another airport, where other paths are usual.
    pub(super) paths: Option<f64>,
}

impl KeptInTraining {
    /// `flights`: held out from the fits.
    pub(super) fn of(
        filter: &FlightFilter,
        fits: &InverseRange,
        flights: &[LabelledFlight],
    ) -> Self {
        let of_flight = |flight: &LabelledFlight| {
            let mut largest: BTreeMap<Evidence, f64> = BTreeMap::new();
            let mut histories: BTreeMap<Compared, History> = BTreeMap::new();
            for tick in &flight.ticks {
                for (compared, deviations) in filter.residuals(fits, tick) {
                    let evidence = compared.0;
                    let history = histories.entry(compared).or_default();
                    history.take(evidence, (tick.time_s, deviations, true), f64::INFINITY);
                    if let Some(kept) = history.kept {
                        let of_all = largest.entry(evidence).or_default();
                        *of_all = of_all.max(kept.deviations);
                    }
                }
            }
            largest
        };
        let of_flights: Vec<_> = flights.iter().map(of_flight).collect();
        let largest = |evidence| {
            let kept: Vec<f64> = (of_flights.iter())
                .filter_map(|of| of.get(&evidence).copied())
                .collect();
            (kept.len() >= MIN_FLIGHTS).then(|| kept.into_iter().fold(0.0, f64::max))
        };
        Self {
            rows: largest(Evidence::Rows),
            paths: largest(Evidence::Paths),
        }
    }

    /// False for numbers that no training gives.
    pub(super) fn is_possible(self) -> bool {
        let kept = [self.rows, self.paths];
        kept.into_iter().flatten().all(|kept| kept >= 0.0)
    }

    fn limit(self, evidence: Evidence) -> f64 {
        let kept = match evidence {
            Evidence::Rows => self.rows,
            Evidence::Paths => self.paths,
            Evidence::Closing => Some(0.0),
        };
        kept.map_or(f64::INFINITY, |kept| {
            (TIMES_OF_TRAINING * kept).max(NEAR_DEVIATIONS)
        })
    }
}

/// Smallest residual to one side during a window, 0 if there are residuals of both signs.
#[derive(Debug, Clone, Copy)]
struct Kept {
    /// Start of the window, seconds.
    since_s: f64,
    deviations: f64,
    /// True if most of its ticks count as evidence.
    counts: bool,
}

/// Recent residuals.
#[derive(Debug, Clone, Default)]
struct History {
    /// Time, residual, and true if it counts as evidence; the oldest first.
    recent: VecDeque<(f64, f64, bool)>,
    /// The last complete window.
    kept: Option<Kept>,
    /// Time of the last residual, seconds.
    last_s: f64,
}

impl History {
    /// Takes the next residual. After a window over the limit a new one begins: agreeing again takes a whole window as well.
    fn take(&mut self, evidence: Evidence, next: (f64, f64, bool), limit: f64) {
        let time_s = next.0;
        self.last_s = time_s;
        remember(&mut self.recent, next, |of| of.0, window_s(evidence));
        let since_s = self.recent[0].0;
        if time_s - since_s < window_s(evidence) || self.recent.len() < MIN_TICKS {
            return;
        }
        let mut sorted: Vec<f64> = self.recent.iter().map(|of| of.1).collect();
        sorted.sort_by(f64::total_cmp);
        let outliers = (OUTLIERS * sorted.len() as f64) as usize;
        let [least, most] = [sorted[outliers], sorted[sorted.len() - 1 - outliers]];
        let counting = self.recent.iter().filter(|of| of.2).count();
        let kept = Kept {
            since_s,
            deviations: least.max(-most).max(0.0),
            counts: 2 * counting > self.recent.len(),
        };
        if kept.deviations > limit {
            self.recent.clear();
        }
        self.kept = Some(kept);
    }
}

fn window_s(evidence: Evidence) -> f64 {
    match evidence {
        Evidence::Paths => PATHS_WINDOW_S,
        Evidence::Rows | Evidence::Closing => WINDOW_S,
    }
}

/// Adds a tick to a window of that duration, or of the ticks since a gap. The oldest tick is as old as the window, or older if ticks are
/// rare.
fn remember<T>(recent: &mut VecDeque<T>, next: T, time_s: impl Fn(&T) -> f64, window_s: f64) {
    let now_s = time_s(&next);
    let since_s = recent.back().map(|last| now_s - time_s(last));
    if since_s.is_some_and(|since_s| since_s > MAX_GAP_S) {
        recent.clear();
    }
    if since_s.is_none_or(|since_s| since_s >= STEP_S) {
        recent.push_back(next);
    }
    while recent
        .get(1)
        .is_some_and(|second| now_s - time_s(second) >= window_s)
    {
        recent.pop_front();
    }
}

/// A measured distance next to the size of the boxes.
#[derive(Debug, Clone, Copy)]
struct SizedTick {
    time_s: f64,
    distance_m: f64,
    variance_m2: f64,
    /// Logarithms of the distance from the cameras, and of the width of the boxes in their mean.
    log_range: f64,
    log_width: f64,
}

/// Recent distances and sizes by one fit's views.
#[derive(Debug, Clone, Default)]
struct Closing {
    views: Vec<usize>,
    recent: VecDeque<SizedTick>,
}

impl Closing {
    /// Takes the best measurement of the next tick. Returns the residual; `None` without a verdict.
    fn next(&mut self, views: &[usize], next: SizedTick) -> Option<Kept> {
        if self.views != views {
            *self = Self {
                views: views.to_vec(),
                recent: VecDeque::new(),
            };
        }
        remember(&mut self.recent, next, |of| of.time_s, WINDOW_S);
        let since_s = self.recent[0].time_s;
        if next.time_s - since_s < WINDOW_S || self.recent.len() < MIN_TICKS {
            return None;
        }
        let middle = self.recent.len() / 2;
        let mean = |of: &dyn Fn(&SizedTick) -> f64| {
            let half = |from, to| {
                let values = self.recent.range(from..to).map(of);
                values.sum::<f64>() / (to - from) as f64
            };
            [half(0, middle), half(middle, self.recent.len())]
        };
        let [from_s, to_s] = mean(&|of| of.time_s);
        let change = |of: &dyn Fn(&SizedTick) -> f64| {
            let [from, to] = mean(of);
            to - from
        };
        let speed_mps = -change(&|of| of.distance_m) / (to_s - from_s);
        let sd_mps = mean(&|of| of.variance_m2).iter().sum::<f64>().sqrt() / (to_s - from_s);
        let (grown, explained) = (change(&|of| of.log_width), -change(&|of| of.log_range));
        let deviations = (MIN_CLOSING_MPS - speed_mps) / sd_mps;
        let is_open = deviations.abs() <= NEAR_DEVIATIONS;
        let grows = grown > STILL_GROWTH && explained < MIN_EXPLAINED * grown;
        (!is_open && (deviations < 0.0 || grows)).then_some(Kept {
            since_s,
            deviations,
            counts: true,
        })
    }
}

/// A contradiction at a tick.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Contradiction {
    pub withheld: Withheld,
    /// True if it begins for one of the views: earlier measurements are doubtful.
    pub begins: bool,
    /// Start, seconds; negative infinity if views may never have agreed.
    since_s: f64,
}

/// Watch for contradictions about one aircraft.
#[derive(Debug, Clone, Default)]
pub(crate) struct ContradictionWatch {
    histories: BTreeMap<Compared, History>,
    closing: Closing,
    /// Evidence of a whole window in which views agreed.
    agreed: BTreeSet<Evidence>,
    /// Views in a contradiction at the last tick.
    views: Vec<usize>,
}

impl FlightFilter {
    /// Takes the next tick of an aircraft. A contradiction lasts until a window agrees, or a view has not seen the aircraft for a while.
    pub(crate) fn contradiction(
        &self,
        watch: &mut ContradictionWatch,
        fits: &InverseRange,
        observed: &Observation,
    ) -> Option<Contradiction> {
        let tick = Tick::of(fits, observed);
        for (compared, deviations) in self.residuals(fits, &tick) {
            let evidence = compared.0;
            let counts = evidence != Evidence::Paths
                || compared.1.iter().any(|&view| may_be_turned(view, observed));
            let history = watch.histories.entry(compared).or_default();
            let next = (tick.time_s, deviations, counts);
            history.take(evidence, next, self.kept.limit(evidence));
        }
        if let Some(best) = tick.best() {
            let views = fits.views_of(best.fit);
            let widths = views
                .iter()
                .filter_map(|&view| observed.boxes[view].as_ref());
            let log_widths: f64 = widths.map(|seen| seen.width_px.ln()).sum();
            let kept = watch.closing.next(
                views,
                SizedTick {
                    time_s: tick.time_s,
                    distance_m: best.distance_m,
                    variance_m2: self.variance_m2(best),
                    log_range: (best.distance_m + fits.setback_m(best.fit)).ln(),
                    log_width: log_widths / views.len() as f64,
                },
            );
            let compared = (Evidence::Closing, views.to_vec(), 0);
            let history = watch.histories.entry(compared).or_default();
            history.last_s = tick.time_s;
            history.kept = kept.or(history.kept);
        }
        // Without one of the views, there is nothing left that contradicts.
        let histories = &mut watch.histories;
        histories.retain(|_, history| tick.time_s - history.last_s <= MAX_GAP_S);
        watch.judge(self.kept)
    }

    /// Residuals of rows, and of views alone beside pairs, at a tick.
    fn residuals(&self, fits: &InverseRange, tick: &Tick) -> Vec<(Compared, f64)> {
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
        let paths = pairs.into_iter().flat_map(|pair| {
            let views = fits.views_of(pair.fit);
            let of_pair = alone().filter(|of| views.contains(&fits.views_of(of.fit)[0]));
            of_pair.map(|of| {
                let sd_m = (self.variance_m2(of) + self.variance_m2(pair)).sqrt();
                let compared = (Evidence::Paths, views.to_vec(), fits.views_of(of.fit)[0]);
                (compared, (of.distance_m - pair.distance_m) / sd_m)
            })
        });
        rows.chain(paths.collect::<Vec<_>>()).collect()
    }

    /// Variance of a measurement with all errors.
    fn variance_m2(&self, of: &Measurement) -> f64 {
        let (slow_m, _, new_m) = self.deviations_m(of);
        slow_m.powi(2) + new_m.powi(2) + of.common_sd_m.powi(2)
    }

    /// A flight without the boxes of views that contradict each other, and the contradictions by aircraft. `followed`: the number of the
    /// aircraft and the tick with its boxes.
    pub(crate) fn without_contradictions(
        &self,
        fits: &InverseRange,
        followed: Vec<(Option<usize>, Observation)>,
    ) -> (Vec<Observation>, Vec<Withheld>) {
        let mut watches: BTreeMap<usize, ContradictionWatch> = BTreeMap::new();
        let mut found: Vec<Option<Contradiction>> = Vec::with_capacity(followed.len());
        let mut said = Vec::new();
        for (number, observed) in &followed {
            let next = number.and_then(|number| {
                self.contradiction(watches.entry(number).or_default(), fits, observed)
            });
            if let Some(next) = next.as_ref().filter(|next| next.begins) {
                let earlier = followed.iter().zip(&mut found).rev();
                let earlier = earlier.take_while(|((_, of), _)| of.time_s() >= next.since_s);
                for (_, found) in earlier.filter(|((of, _), found)| of == number && found.is_none())
                {
                    *found = Some(next.clone());
                }
                said.push(next.withheld.clone());
            }
            found.push(next);
        }
        let mut last: Vec<usize> = Vec::new();
        let kept = followed
            .into_iter()
            .zip(found)
            .map(|((_, observed), found)| {
                let views = found.map_or(Vec::new(), |found| found.withheld.views);
                let is_new = views.iter().any(|view| !last.contains(view));
                last.clone_from(&views);
                observed.withheld(&views, is_new)
            });
        (kept.collect(), said)
    }
}

/// True if neither a background nor a stable mast shows where the camera looks.
fn may_be_turned(view: usize, observed: &Observation) -> bool {
    let errors = observed.common_errors.iter().filter(|of| of.view == view);
    let variance_px2: f64 = errors.map(|of| of.sd_px.length_squared()).sum();
    observed.looks[view] == Look::Unplaced || variance_px2 > MAX_PLACED_SD_PX.powi(2)
}

/// What a window shows.
struct Verdict<'a> {
    evidence: Evidence,
    views: &'a [usize],
    kept: Kept,
    limit: f64,
    is_over: bool,
}

impl ContradictionWatch {
    /// The contradiction by all windows. Views that agree with others are not concerned.
    fn judge(&mut self, training: KeptInTraining) -> Option<Contradiction> {
        let verdicts = self.histories.iter();
        let verdicts = verdicts.filter_map(|((evidence, views, _), history)| {
            let (kept, limit) = (history.kept?, training.limit(*evidence));
            Some(Verdict {
                evidence: *evidence,
                views,
                kept,
                limit,
                is_over: kept.counts && kept.deviations > limit,
            })
        });
        let verdicts: Vec<Verdict> = verdicts.collect();
        let is_over = |of: &Verdict| {
            let mut same = verdicts.iter();
            same.any(|other| {
                other.is_over && (other.evidence, other.views) == (of.evidence, of.views)
            })
        };
        let agrees = |evidence: Evidence, view: usize| {
            let mut with = verdicts.iter();
            with.any(|of| of.evidence == evidence && of.views.contains(&view) && !is_over(of))
        };
        let suspects = |of: &Verdict| {
            let views = of.views.iter().copied();
            let suspects = views.filter(|&view| !agrees(of.evidence, view));
            suspects.collect::<Vec<usize>>()
        };
        let over: Vec<(&Verdict, Vec<usize>)> = (verdicts.iter())
            .filter(|of| of.is_over)
            .map(|of| (of, suspects(of)))
            .filter(|(_, suspects)| !suspects.is_empty())
            .collect();
        let mut views: Vec<usize> = over.iter().flat_map(|(_, of)| of).copied().collect();
        views.sort_unstable();
        views.dedup();
        let share = |of: &Verdict| of.kept.deviations / of.limit;
        let worst = over.iter().map(|(of, _)| of);
        let worst = worst.max_by(|a, b| share(a).total_cmp(&share(b)));
        let contradiction = worst.map(|of| Contradiction {
            begins: views.iter().any(|view| !self.views.contains(view)),
            // Far away, a turned camera agrees with the paths.
            since_s: if of.evidence != Evidence::Paths && self.agreed.contains(&of.evidence) {
                of.kept.since_s
            } else {
                f64::NEG_INFINITY
            },
            withheld: Withheld {
                views: views.clone(),
                cause: Cause {
                    evidence: of.evidence,
                    deviations: of.kept.deviations,
                    limit: of.limit,
                },
            },
        });
        let agreeing = verdicts.iter().filter(|of| !of.is_over);
        self.agreed.extend(agreeing.map(|of| of.evidence));
        self.views = views;
        contradiction
    }
}

#[cfg(test)]
mod tests {
    use dataset::corpus::splits::Side;
    use dataset::numbers::frame_rate::FrameRate;
    use glam::DVec2;
    use testkit::synthetic::SyntheticCorpus;

    use super::*;
    use crate::estimators::inverse_range::CrossFitted;
    use crate::estimators::inverse_range::flight_filter::Knowing;
    use crate::samples::tests::fixtures::{registered_corpus, shift_of};
    use crate::samples::trusted_boxes::centre_and_size;
    use crate::samples::view_shift::ViewShift;
    use crate::samples::{Sample, Samples};

    fn kept(times_s: impl Iterator<Item = f64>, deviations: impl Fn(f64) -> f64) -> Option<f64> {
        let mut history = History::default();
        for time_s in times_s {
            let next = (time_s, deviations(time_s), true);
            history.take(Evidence::Paths, next, f64::INFINITY);
        }
        Some(history.kept?.deviations)
    }

    #[test]
    fn a_residual_that_stays_for_a_window_is_kept_at_any_image_rate_and_a_passing_one_is_not() {
        for step_s in [1.0 / 30.0, 0.5, 2.0, 4.0, 15.0] {
            let times = |seconds: f64| {
                let count = (seconds / step_s).ceil() as u32;
                (0..=count).map(move |tick| f64::from(tick) * step_s)
            };
            assert_eq!(kept(times(75.0), |_| -57.0), Some(57.0));
            assert_eq!(kept(times(44.0), |_| 57.0), None);
            let gust = |time_s: f64| (100.0 - 3.0 * time_s).max(-1.0);
            assert_eq!(kept(times(75.0), gust), Some(0.0));
            let begins = |time_s: f64| if time_s < 40.0 { 2.0 } else { 57.0 };
            assert_eq!(kept(times(75.0), begins), Some(2.0));
        }
        let wrong_now_and_then = |time_s: f64| match time_s as u32 % 12 {
            3 => 900.0,
            _ => -57.0,
        };
        assert_eq!(kept((0..75).map(f64::from), wrong_now_and_then), Some(57.0));
        let with_gap = (0..50).chain(90..120).map(f64::from);
        assert_eq!(kept(with_gap, |_| 57.0), None);
        let rare = (0..20).map(|tick| f64::from(tick) * 40.0);
        assert_eq!(kept(rare, |_| 57.0), None);
    }

    /// Fits and filter of seven flights, and two other flights in fog, with a tick every two seconds.
    fn trained() -> (InverseRange, FlightFilter, Vec<Vec<Observation>>) {
        let corpus = SyntheticCorpus {
            train: 6,
            frame_rate: FrameRate {
                numerator: 1,
                denominator: 2,
            },
            miss_ratio: 0.0,
            ..registered_corpus(0.05)
        };
        let samples = Samples::synthetic(&corpus, 1.0);
        let true_boxes = samples.with_true_boxes();
        let fits = CrossFitted::fit(&samples, &true_boxes.iter().collect::<Vec<_>>());
        let flights = LabelledFlight::held_out(&fits, &samples, Clone::clone);
        let mut filter = FlightFilter::fit_to(&flights, fits.all.deviations());
        filter.kept = KeptInTraining::of(&filter, &fits.all, &flights);
        let in_fog = |sample: &Sample| {
            let mut observed = sample.observed.clone();
            observed.looks.fill(Look::Unplaced);
            observed
        };
        let tested = samples.flights_of_side(Side::Test);
        let tested = tested.map(|flight| flight.iter().map(in_fog).collect());
        (fits.all, filter, tested.collect())
    }

    /// A flight whose views show these views of flights, from the tick on at which both see an aircraft.
    fn joined(sources: [(&[Observation], usize); 2]) -> Vec<Observation> {
        let [(first, _), (second, _)] = sources;
        let ticks = first.iter().zip(second).filter_map(|(one, other)| {
            let boxes = [one.boxes[sources[0].1]?, other.boxes[sources[1].1]?];
            let [from_px, to_px] = [0, 1].map(|view| centre_and_size(&boxes[view]).0);
            let shift = shift_of(from_px.to_array(), (to_px - from_px).to_array());
            let mut observed = one.with_boxes(boxes.map(Some).to_vec());
            observed.shifts = vec![None, ViewShift::between((0, &boxes[0]), &boxes[1], &shift)];
            Some(observed)
        });
        ticks.collect()
    }

    /// Contradictions in a flight, with the number of ticks that have boxes before the first one and after it.
    fn judged(
        (fits, filter, _): &(InverseRange, FlightFilter, Vec<Vec<Observation>>),
        flight: &[Observation],
    ) -> (Option<(Evidence, usize)>, usize) {
        let mut watch = ContradictionWatch::default();
        let found = flight.iter().enumerate().find_map(|(tick, observed)| {
            let found = filter.contradiction(&mut watch, fits, observed)?;
            assert_eq!(found.withheld.views, [0, 1]);
            Some((found.withheld.cause.evidence, tick))
        });
        let followed = flight.iter().map(|observed| (Some(3), observed.clone()));
        let (kept, said) = filter.without_contradictions(fits, followed.collect());
        assert_eq!(
            said.first().map(|of| of.cause.evidence),
            found.map(|of| of.0)
        );
        (found, kept.iter().filter(|of| of.detections() > 0).count())
    }

    #[test]
    fn views_that_do_not_show_what_the_training_saw_give_no_distance_within_twenty_seconds() {
        let trained = trained();
        let [one, other] = trained.2.as_slice() else {
            panic!()
        };
        for flight in [one, other] {
            let usual = joined([(flight, 0), (flight, 1)]);
            assert_eq!(judged(&trained, &usual), (None, usual.len()));
        }
        let later = &one[4..];
        for (name, sources, evidence) in [
            ("exchanged", [(&one[..], 1), (one, 0)], Evidence::Closing),
            ("one twice", [(one, 0), (one, 0)], Evidence::Closing),
            ("other flight", [(one, 0), (other, 1)], Evidence::Rows),
            ("late", [(one, 0), (later, 1)], Evidence::Rows),
        ] {
            let (found, kept) = judged(&trained, &joined(sources));
            let (of, tick) = found.unwrap_or_else(|| panic!("{name}"));
            assert!(of == evidence && tick <= 11, "{name}: {of:?} {tick}");
            assert_eq!(kept, 0, "{name}");
        }
    }

    #[test]
    fn a_camera_that_was_turned_sideways_in_fog_gives_no_distances() {
        let trained = trained();
        let flight = joined([(&trained.2[0], 0), (&trained.2[0], 1)]);
        for off_px in [-20.0, 20.0] {
            let right = DVec2::new(off_px, 0.0);
            let turned = flight.iter().map(|observed| {
                let turned = |view, place_px| Some(place_px + f64::from(view == 1) * right);
                observed.moved(turned)
            });
            let mut turned: Vec<Observation> = turned.collect();
            let (found, kept) = judged(&trained, &turned);
            assert_eq!(found.map(|of| of.0), Some(Evidence::Paths));
            assert_eq!(kept, 0);
            // A visible background reveals turns, so this is another path.
            turned
                .iter_mut()
                .for_each(|observed| observed.looks.fill(Look::Placed));
            assert_eq!(judged(&trained, &turned), (None, turned.len()));
        }
    }

    #[test]
    fn what_follows_a_contradiction_begins_anew_and_what_agreed_before_stays() {
        let trained = trained();
        let flight = joined([(&trained.2[0], 0), (&trained.2[0], 1)]);
        let (fits, filter, _) = &trained;
        let mut exchanged = joined([(&trained.2[0], 1), (&trained.2[0], 0)]);
        let (from, to) = (30, 60);
        let mut mixed = flight.clone();
        mixed[from..to].swap_with_slice(&mut exchanged[from..to]);
        let followed = mixed.iter().map(|observed| (Some(3), observed.clone()));
        let (kept, _) = filter.without_contradictions(fits, followed.collect());
        let estimates = filter.predict(fits, &kept, Knowing::Past);
        let answered = |ticks: std::ops::Range<usize>| estimates[ticks].iter().flatten().count();
        assert_eq!(answered(0..from), from);
        assert_eq!(answered(from + 12..to), 0);
        assert!(answered(to + 12..kept.len()) >= kept.len() - to - 14);
    }
}
