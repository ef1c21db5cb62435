//! Following one aircraft through a flight: which boxes of each tick are its boxes.
//!
//! Boxes of one view continue each other by their track or their motion ([`Trace`](super::aircraft::Trace)); boxes of two views belong
//! together if they agree with the relation of the views ([`Relation`]). The objects that result are ranked by the time for which two views
//! agreed on them, then by the time for which one saw them, then by their size, so of two arrivals the nearer one counts if both came into
//! sight together. The choice uses the ticks so far, never later ones.

use dataset::tables::pixel_box::PixelBox;

use super::aircraft::Aircraft;
use super::is_related;
use super::path::{Path, Sighting};
use super::relation::Relation;
use crate::samples::Observation;
use crate::samples::camera_health::look::Look;
use crate::samples::trusted_boxes::other_boxes::Candidate;

/// Boxes of a view at a tick that are considered, those with the highest scores.
const MAX_BOXES: usize = 16;
/// Objects that are remembered at most.
const MAX_AIRCRAFT: usize = 64;
/// The time to the tick before counts up to this, seconds: in a longer gap anything may have happened.
const MAX_STEP_S: f64 = 5.0;
/// An aircraft that two views agreed on for this time stays the one that is followed, seconds ...
const ESTABLISHED_S: f64 = 10.0;
/// ... until no view has seen it for this time, seconds.
const GIVEN_UP_S: f64 = 60.0;
/// Other objects are forgotten sooner, seconds.
const FORGOTTEN_S: f64 = 10.0;
/// Advantage of the object that is followed over others that two views agree on, seconds.
const ADVANTAGE_S: f64 = 3.0;
/// Views may contradict each other about an object for this time, seconds.
const DISPUTE_S: f64 = 3.0;
/// Objects in two views contradict each other if they were last seen within this time, seconds: rows change by a pixel or two in a second.
const RIVAL_S: f64 = 3.0;
/// An object of one view alone counts after this time, seconds: then places tell its speed.
const APPROACH_S: f64 = 10.0;
/// A view without an image for this time is blind, seconds.
const BLIND_S: f64 = 10.0;
/// Of two boxes that contradict each other, one is an intruder if it is so many times as far from where it is expected, plus this.
const INTRUDER: f64 = 2.0;
const INTRUDER_AWAY: f64 = 0.2;

/// Relations and paths that the training learned.
#[derive(Debug, Clone, Copy)]
pub(super) struct Learned<'a> {
    pub(super) relations: &'a [Relation],
    pub(super) paths: &'a [Path],
}

/// The objects in sight of a flight. Their number is limited, and so is what is remembered of each.
#[derive(Debug, Clone, Default)]
pub(crate) struct Follower {
    aircraft: Vec<Aircraft>,
    /// Number of the one that is followed.
    followed: Option<usize>,
    next_number: usize,
    last_s: Option<f64>,
    /// By view, when it had its last image.
    looked_s: Vec<Option<f64>>,
}

/// An object at a tick.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct InSight {
    pub(super) number: usize,
    /// It is the one that is followed.
    pub(super) is_followed: bool,
    /// By view, the index of its box among [`Observation::candidates`]; none where it may be something else.
    pub(super) boxes: Vec<Option<usize>>,
}

impl Follower {
    /// The objects of the next tick, also those that are out of sight for a while.
    pub(super) fn step(&mut self, learned: Learned, observed: &Observation) -> Vec<InSight> {
        let time_s = observed.time_ns as f64 / 1e9;
        let step_s = self.last_s.map_or(0.0, |last_s| time_s - last_s);
        // Never zero: an object that was paired once differs from one that never was.
        let step_s = step_s.clamp(1e-3, MAX_STEP_S);
        self.last_s = Some(time_s);
        let views = 0..observed.boxes.len();
        let boxes: Vec<Vec<Candidate>> = views
            .map(|view| {
                let is_followed = is_related(learned.relations, view);
                let most = if is_followed { MAX_BOXES } else { 0 };
                observed.candidates(view).take(most).collect()
            })
            .collect();
        self.looked_s.resize(boxes.len(), None);
        for (looked_s, looks) in self.looked_s.iter_mut().zip(&observed.looks) {
            *looked_s = if *looks == Look::Blind {
                *looked_s
            } else {
                Some(time_s)
            };
        }
        let looks = |looked_s: &Option<f64>| looked_s.is_some_and(|at| time_s - at <= BLIND_S);
        let tick = Tick {
            learned,
            time_s,
            boxes: &boxes,
            looks: &self.looked_s.iter().map(looks).collect::<Vec<_>>(),
            has_cut_off: observed.cut_off > 0,
        };
        self.forget(time_s);
        self.continue_all(&tick);
        self.settle_disputes(&tick, step_s);
        self.begin_new(&tick);
        self.join(&tick);
        for aircraft in &mut self.aircraft {
            let count = aircraft.count();
            if count > 0 {
                aircraft.seen_s += step_s;
            }
            if count > 1 && aircraft.disputed_s == 0.0 {
                aircraft.paired_s += step_s;
            }
            aircraft.remember(time_s, &boxes);
            if aircraft.paired_s == 0.0 && aircraft.seen_s >= APPROACH_S {
                aircraft.has_approached |= learned.shows_approach(aircraft, step_s);
            }
        }
        let chosen = self.choose(&tick, step_s);
        self.followed = chosen.map(|chosen| self.aircraft[chosen].number);
        let in_sight = self.aircraft.iter().map(|aircraft| InSight {
            number: aircraft.number,
            is_followed: Some(aircraft.number) == self.followed,
            boxes: if self.is_certain(aircraft, &tick, step_s) {
                aircraft.boxes.clone()
            } else {
                vec![None; boxes.len()]
            },
        });
        in_sight.collect()
    }

    /// Drops objects that are out of sight.
    fn forget(&mut self, time_s: f64) {
        let followed = self.followed;
        self.aircraft.retain(|aircraft| {
            let is_kept = aircraft.paired_s >= ESTABLISHED_S || Some(aircraft.number) == followed;
            let most_s = if is_kept { GIVEN_UP_S } else { FORGOTTEN_S };
            time_s - aircraft.last_s <= most_s
        });
        // The followed one first, then those that are best known, in the order of appearance among equals.
        self.aircraft.sort_by(|a, b| {
            let key = |of: &Aircraft| (Some(of.number) == followed, of.paired_s, of.seen_s);
            let ((a_first, a_paired, a_seen), (b_first, b_paired, b_seen)) = (key(a), key(b));
            (b_first.cmp(&a_first))
                .then(b_paired.total_cmp(&a_paired))
                .then(b_seen.total_cmp(&a_seen))
                .then(a.number.cmp(&b.number))
        });
        self.aircraft.truncate(MAX_AIRCRAFT);
        for aircraft in &mut self.aircraft {
            aircraft.boxes.fill(None);
        }
    }

    /// Gives each object the boxes that continue it, the best known object first: those of its tracks, then those that its motion leads to.
    fn continue_all(&mut self, tick: &Tick) {
        let mut taken: Vec<Vec<bool>> = tick.boxes.iter().map(|of| vec![false; of.len()]).collect();
        for of_tracks in [true, false] {
            for aircraft in &mut self.aircraft {
                for (view, boxes) in tick.boxes.iter().enumerate() {
                    if aircraft.boxes[view].is_some() {
                        continue;
                    }
                    let free = boxes.iter().enumerate().filter(|&(index, &seen)| {
                        let is_of_track = aircraft.is_of_track(view, seen);
                        !taken[view][index] && (is_of_track || !of_tracks)
                    });
                    let near = free.filter_map(|(index, seen)| {
                        Some((index, aircraft.distance_to(tick.time_s, view, *seen)?))
                    });
                    let nearest = near.min_by(|(_, a), (_, b)| a.total_cmp(b));
                    if let Some((index, _)) = nearest {
                        aircraft.boxes[view] = Some(index);
                        taken[view][index] = true;
                    }
                }
            }
        }
    }

    /// Takes away boxes that contradict the other views of an object, and divides objects whose views contradict each other for long.
    fn settle_disputes(&mut self, tick: &Tick, step_s: f64) {
        let mut kept = Vec::with_capacity(self.aircraft.len());
        for mut aircraft in std::mem::take(&mut self.aircraft) {
            while let Some(intruder) = tick.intruder(&aircraft) {
                aircraft.boxes[intruder] = None;
            }
            if tick.is_disputed(&aircraft) {
                aircraft.disputed_s += step_s;
            } else if aircraft.count() > 1 {
                aircraft.disputed_s = 0.0;
            }
            if aircraft.disputed_s > DISPUTE_S {
                let number = || {
                    self.next_number += 1;
                    self.next_number - 1
                };
                kept.extend(aircraft.divided(number));
            } else {
                kept.push(aircraft);
            }
        }
        self.aircraft = kept;
    }

    /// Makes an object of every box that continues none.
    fn begin_new(&mut self, tick: &Tick) {
        for (view, boxes) in tick.boxes.iter().enumerate() {
            for index in 0..boxes.len() {
                let taken = self.aircraft.iter().any(|a| a.boxes[view] == Some(index));
                if !taken {
                    let number = self.next_number;
                    self.next_number += 1;
                    let new = Aircraft::new(number, tick.boxes.len(), view, index);
                    self.aircraft.push(new);
                }
            }
        }
    }

    /// Joins objects that different views see and agree on, those that fit best first.
    fn join(&mut self, tick: &Tick) {
        loop {
            let mut best: Option<(f64, usize, usize)> = None;
            for (first, one) in self.aircraft.iter().enumerate() {
                for (second, other) in self.aircraft.iter().enumerate() {
                    // Of two that were paired, each has its own partner.
                    if first == second
                        || other.paired_s > 0.0
                        || (one.paired_s == 0.0 && second < first)
                    {
                        continue;
                    }
                    let Some(misfit) = tick.misfit_of(one, other) else {
                        continue;
                    };
                    if best.is_none_or(|(least, ..)| misfit < least) {
                        best = Some((misfit, first, second));
                    }
                }
            }
            let Some((_, first, second)) = best else {
                return;
            };
            let other = self.aircraft[second].clone();
            self.aircraft[first].absorb(other);
            self.aircraft[first].disputed_s = 0.0;
            self.aircraft.remove(second);
        }
    }

    /// Index of the object to follow.
    fn choose(&self, tick: &Tick, step_s: f64) -> Option<usize> {
        let followed = |aircraft: &Aircraft| Some(aircraft.number) == self.followed;
        let stays = |aircraft: &&Aircraft| followed(aircraft) && aircraft.paired_s >= ESTABLISHED_S;
        if let Some(stays) = self.aircraft.iter().position(|a| stays(&a)) {
            return Some(stays);
        }
        let key = |aircraft: &Aircraft| {
            let is_favoured = followed(aircraft) && aircraft.paired_s > 0.0;
            let advantage_s = if is_favoured { ADVANTAGE_S } else { 0.0 };
            // Of what one view alone has seen, an older object that is no arrival does not stand in the way of one that may be.
            let certain = f64::from(u8::from(self.is_certain(aircraft, tick, step_s)));
            let width_px = tick.width_px(aircraft);
            [
                aircraft.paired_s + advantage_s,
                certain,
                aircraft.seen_s,
                width_px,
            ]
        };
        let recent = self.aircraft.iter().enumerate();
        let recent = recent.filter(|(_, a)| tick.time_s - a.last_s <= FORGOTTEN_S);
        let keys: Vec<_> = recent
            .map(|(index, aircraft)| (index, key(aircraft)))
            .collect();
        keys.iter()
            // The last one of equals wins, so the first in sight comes last.
            .rev()
            .max_by(|(_, a), (_, b)| {
                let by = a.iter().zip(b).map(|(a, b)| a.total_cmp(b));
                by.fold(std::cmp::Ordering::Equal, std::cmp::Ordering::then)
            })
            .map(|(index, _)| *index)
    }

    /// False if its views contradict each other, or if it was never seen by two views and has not approached at a usual speed, stands
    /// still, has another size than aircraft have there, is contradicted by what another view sees, or is not seen by one that looks there.
    fn is_certain(&self, chosen: &Aircraft, tick: &Tick, step_s: f64) -> bool {
        let relations = tick.learned.relations;
        if chosen.disputed_s > 0.0 && chosen.count() > 1 {
            return false;
        }
        let is_rival = |other: &&Aircraft| {
            let mut boxes = other.last_boxes();
            let apart_s = (chosen.last_s - other.last_s).abs();
            other.number != chosen.number
                && other.paired_s == 0.0
                && apart_s <= RIVAL_S
                && boxes.any(|there| {
                    let mut here = chosen.last_boxes();
                    here.any(|here| {
                        let related = related(relations, here, there);
                        related.is_some_and(|(relation, pair)| relation.misfit(pair).is_none())
                    })
                })
        };
        chosen.paired_s > 0.0
            // Between ticks that are as far apart as this, waiting for another one would cost more than lamps do.
            || ((chosen.has_approached || step_s >= MAX_STEP_S)
                && tick.learned.is_on_path(chosen, step_s)
                && !tick.is_missed(chosen)
                && !self.aircraft.iter().any(|other| is_rival(&other)))
    }
}

impl Learned<'_> {
    fn path(&self, view: usize) -> Option<&Path> {
        self.paths.iter().find(|path| path.view == view)
    }

    /// True if an object moves, and has the size and the growth of aircraft on the paths of the training.
    fn is_on_path(&self, of: &Aircraft, step_s: f64) -> bool {
        let holds =
            |(view, seen): (usize, &PixelBox)| self.path(view).is_none_or(|path| path.holds(seen));
        let leads = |(view, ends): (usize, [&Sighting; 2])| {
            let boxes = ends.map(|seen| &seen.pixel_box);
            self.path(view).is_none_or(|path| path.leads(boxes))
        };
        of.is_moving().unwrap_or(step_s >= MAX_STEP_S)
            && of.last_boxes().all(holds)
            && of.motions().all(leads)
    }

    /// True if its motion is known as well, and is about as fast as the training's.
    fn shows_approach(&self, of: &Aircraft, step_s: f64) -> bool {
        let mut motions = of.motions().peekable();
        motions.peek().is_some()
            && motions.all(|(view, ends)| self.path(view).is_none_or(|path| path.is_as_fast(ends)))
            && self.is_on_path(of, step_s)
    }
}

/// The relation of two views, and their boxes in its order; `None` if there is none, or both are of one view.
fn related<'r, 'b>(
    relations: &'r [Relation],
    a: (usize, &'b PixelBox),
    b: (usize, &'b PixelBox),
) -> Option<(&'r Relation, [&'b PixelBox; 2])> {
    let (first, second) = if a.0 < b.0 { (a, b) } else { (b, a) };
    let mut relations = relations.iter();
    let relation = relations.find(|relation| relation.views == [first.0, second.0])?;
    Some((relation, [first.1, second.1]))
}

/// True if the boxes of two views cannot be of one aircraft.
fn contradicts(relations: &[Relation], a: (usize, &PixelBox), b: (usize, &PixelBox)) -> bool {
    related(relations, a, b).is_some_and(|(relation, pair)| relation.contradicts(pair))
}

/// The boxes of a tick.
struct Tick<'a> {
    learned: Learned<'a>,
    time_s: f64,
    boxes: &'a [Vec<Candidate>],
    /// Views that are not blind.
    looks: &'a [bool],
    /// The edge of an image cuts off all that a view sees.
    has_cut_off: bool,
}

impl Tick<'_> {
    /// The boxes of an object at this tick, as view and index.
    fn seen<'b>(
        &self,
        aircraft: &'b Aircraft,
    ) -> impl Iterator<Item = (usize, usize)> + Clone + 'b {
        let boxes = aircraft.boxes.iter().enumerate();
        boxes.filter_map(|(view, index)| Some((view, (*index)?)))
    }

    fn pixel_box(&self, (view, index): (usize, usize)) -> (usize, &PixelBox) {
        (view, &self.boxes[view][index].pixel_box)
    }

    /// Mean misfit of two objects as one; `None` if they cannot be one: a view sees both, or views contradict each other.
    fn misfit_of(&self, one: &Aircraft, other: &Aircraft) -> Option<f64> {
        let mut misfits = Vec::new();
        for b in self.seen(other) {
            let candidate = self.boxes[b.0][b.1];
            if one.boxes[b.0].is_some() || !one.may_be(self.time_s, b.0, candidate) {
                return None;
            }
            for a in self.seen(one) {
                if !other.may_be(self.time_s, a.0, self.boxes[a.0][a.1]) {
                    return None;
                }
                let (a, b) = (self.pixel_box(a), self.pixel_box(b));
                if let Some((relation, pair)) = related(self.learned.relations, a, b) {
                    misfits.push(relation.misfit(pair)?);
                }
            }
        }
        let count = misfits.len();
        (count > 0).then(|| misfits.iter().sum::<f64>() / count as f64)
    }

    /// Number of other views that contradict a box of an object.
    fn contradictions(&self, aircraft: &Aircraft, of: (usize, usize)) -> usize {
        let others = self.seen(aircraft).filter(|other| other.0 != of.0);
        let of = self.pixel_box(of);
        others
            .filter(|&other| contradicts(self.learned.relations, of, self.pixel_box(other)))
            .count()
    }

    fn is_disputed(&self, aircraft: &Aircraft) -> bool {
        let mut seen = self.seen(aircraft);
        seen.any(|of| self.contradictions(aircraft, of) > 0)
    }

    /// True if a view looks where an aircraft of this place would be, and does not see it.
    fn is_missed(&self, aircraft: &Aircraft) -> bool {
        let is_missed_by = |other: usize| {
            self.looks[other] && !self.has_cut_off && aircraft.boxes[other].is_none()
        };
        self.seen(aircraft).any(|of| {
            let (view, seen) = self.pixel_box(of);
            let mut relations = self.learned.relations.iter();
            relations.any(|relation| relation.also_sees(view, seen).is_some_and(is_missed_by))
        })
    }

    /// The view whose box is most likely of something else; `None` if no views contradict each other, or both sides are as likely.
    fn intruder(&self, aircraft: &Aircraft) -> Option<usize> {
        let seen: Vec<(usize, usize)> = self.seen(aircraft).collect();
        let contradictions = |&of: &(usize, usize)| self.contradictions(aircraft, of);
        let most = seen
            .iter()
            .map(contradictions)
            .max()
            .filter(|&most| most > 0)?;
        let suspects = seen.iter().filter(|of| contradictions(of) == most);
        let suspects: Vec<(f64, usize)> = suspects
            .map(|&(view, index)| {
                let seen = self.boxes[view][index];
                let away = aircraft.distance_to(self.time_s, view, seen);
                (away.unwrap_or(1.0), view)
            })
            .collect();
        let worst = suspects.iter().max_by(|a, b| a.0.total_cmp(&b.0))?;
        let is_clear = suspects
            .iter()
            .filter(|other| other.1 != worst.1)
            .all(|other| worst.0 > INTRUDER * other.0 + INTRUDER_AWAY);
        is_clear.then_some(worst.1)
    }

    /// Largest width of an object's boxes, pixels.
    fn width_px(&self, aircraft: &Aircraft) -> f64 {
        let widths = self.seen(aircraft);
        let widths = widths.map(|(view, index)| self.boxes[view][index].pixel_box.width_px);
        widths.fold(0.0, f64::max)
    }
}
