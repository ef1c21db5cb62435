//! Following one aircraft through a flight.
//!
//! Within a view, boxes continue each other by track or motion ([`Trace`](super::aircraft::Trace)); across views, boxes belong together if
//! they satisfy the [`Relation`]. The resulting objects are ranked by the time for which two views agreed on them, then by time in sight,
//! then by size, so the nearer arrival wins if two come into sight together. Only past ticks count.

use dataset::tables::pixel_box::PixelBox;

use super::aircraft::Aircraft;
use super::path::Path;
use super::relation::Relation;
use super::sighting::{MEMORY_S, RECENT_S, Sighting};
use super::{PairedViews, is_related};
use crate::samples::{Candidate, Look, Observation};

/// Maximum number of considered boxes per view and tick, by score.
const MAX_BOXES: usize = 16;
/// Maximum number of remembered objects.
const MAX_AIRCRAFT: usize = 64;
/// Maximum time credited per tick, seconds: longer gaps may hide anything.
const MAX_STEP_S: f64 = 5.0;
/// Time for which views may disagree, s: rows change by one or two pixels per second.
const DISPUTE_S: f64 = 3.0;
/// Ratio and difference of distances from the expected position that identify one of two contradicting boxes as an intruder.
const INTRUDER: f64 = 2.0;
const INTRUDER_AWAY: f64 = 0.2;

/// Objects in sight. Their number and memory are bounded.
#[derive(Debug, Clone, Default)]
pub(crate) struct Follower {
    aircraft: Vec<Aircraft>,
    /// Number of the followed object.
    followed: Option<usize>,
    next_number: usize,
    last_s: Option<f64>,
    /// Time of the last image per view.
    looked_s: Vec<Option<f64>>,
}

/// An object's boxes at a tick.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ObjectBoxes {
    pub(super) number: usize,
    /// True for the followed object.
    pub(super) is_followed: bool,
    /// Candidate index per view ([`Observation::candidates`]); none where the box is doubtful.
    pub(super) boxes: Vec<Option<usize>>,
}

impl Follower {
    /// Objects at the next tick, including those temporarily out of sight.
    pub(super) fn step(
        &mut self,
        learned: &PairedViews,
        observed: &Observation,
    ) -> Vec<ObjectBoxes> {
        let time_s = observed.time_s();
        let step_s = self.last_s.map_or(0.0, |last_s| time_s - last_s);
        // Never zero, so that an object paired once differs from an unpaired one.
        let step_s = step_s.clamp(1e-3, MAX_STEP_S);
        self.last_s = Some(time_s);
        let views = observed.candidates.iter().enumerate();
        let boxes: Vec<Vec<Candidate>> = views
            .map(|(view, candidates)| {
                let is_followed = is_related(&learned.relations, view);
                let most = if is_followed { MAX_BOXES } else { 0 };
                candidates.iter().take(most).copied().collect()
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
        let looks = |looked_s: &Option<f64>| looked_s.is_some_and(|at| time_s - at <= RECENT_S);
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
            if aircraft.paired_s == 0.0 && aircraft.seen_s >= RECENT_S {
                aircraft.has_approached |= learned.shows_approach(aircraft, step_s);
            }
        }
        self.doubt(&tick, step_s);
        let chosen = self.choose(&tick, step_s);
        self.followed = chosen.map(|chosen| self.aircraft[chosen].number);
        let in_sight = self.aircraft.iter().map(|aircraft| ObjectBoxes {
            number: aircraft.number,
            is_followed: Some(aircraft.number) == self.followed,
            boxes: if Self::is_certain(aircraft, &tick, step_s) {
                aircraft.boxes.clone()
            } else {
                vec![None; boxes.len()]
            },
        });
        in_sight.collect()
    }

    fn forget(&mut self, time_s: f64) {
        let followed = self.followed;
        self.aircraft.retain(|aircraft| {
            let is_kept = aircraft.paired_s >= RECENT_S || Some(aircraft.number) == followed;
            let most_s = if is_kept { MEMORY_S } else { RECENT_S };
            time_s - aircraft.last_s <= most_s
        });
        // The followed object first, then by evidence, and in order of appearance among equals.
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

    /// Assigns boxes to the objects that they continue, the best-known object first: by track, then by motion.
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

    /// Removes boxes that contradict the other views, and divides objects after a long contradiction.
    fn settle_disputes(&mut self, tick: &Tick, step_s: f64) {
        let mut kept = Vec::with_capacity(self.aircraft.len());
        for mut aircraft in std::mem::take(&mut self.aircraft) {
            while let Some(intruder) = tick.intruder(&aircraft) {
                aircraft.leave(intruder);
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

    /// Starts an object from every box that continues none.
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

    /// Joins matching objects from different views, the best match first.
    fn join(&mut self, tick: &Tick) {
        loop {
            let mut best: Option<(f64, usize, usize)> = None;
            for (first, one) in self.aircraft.iter().enumerate() {
                for (second, other) in self.aircraft.iter().enumerate() {
                    // Two paired objects have different partners.
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

    /// Adds to the doubt about an object while another view sees a different approaching one in its place, as with videos of two flights.
    /// Without another view, there is none.
    fn doubt(&mut self, tick: &Tick, step_s: f64) {
        for index in 0..self.aircraft.len() {
            let of = &self.aircraft[index];
            let change_s = if of.count() > 1 && of.disputed_s == 0.0 {
                -step_s
            } else if tick.is_of_the_only_view(of) {
                -of.doubted_s
            } else if tick.is_replaced(of, &self.aircraft) {
                step_s
            } else {
                0.0
            };
            let doubted_s = &mut self.aircraft[index].doubted_s;
            *doubted_s = (*doubted_s + change_s).clamp(0.0, MEMORY_S);
        }
    }

    /// Index of the object to follow.
    fn choose(&self, tick: &Tick, step_s: f64) -> Option<usize> {
        let followed = |aircraft: &Aircraft| Some(aircraft.number) == self.followed;
        let stays = |aircraft: &&Aircraft| followed(aircraft) && aircraft.paired_s >= RECENT_S;
        if let Some(stays) = self.aircraft.iter().position(|a| stays(&a)) {
            return Some(stays);
        }
        let key = |aircraft: &Aircraft| {
            let is_favoured = followed(aircraft) && aircraft.paired_s > 0.0;
            let advantage_s = if is_favoured { DISPUTE_S } else { 0.0 };
            // Among objects in one view alone, an older one that does not arrive must not block one that may.
            let certain = f64::from(u8::from(Self::is_certain(aircraft, tick, step_s)));
            let width_px = tick.width_px(aircraft);
            [
                aircraft.paired_s + advantage_s,
                certain,
                aircraft.seen_s,
                width_px,
            ]
        };
        let recent = self.aircraft.iter().enumerate();
        let recent = recent.filter(|(_, a)| tick.time_s - a.last_s <= RECENT_S);
        let keys: Vec<_> = recent
            .map(|(index, aircraft)| (index, key(aircraft)))
            .collect();
        keys.iter()
            // The last of equals wins, so the first in sight comes last.
            .rev()
            .max_by(|(_, a), (_, b)| {
                let by = a.iter().zip(b).map(|(a, b)| a.total_cmp(b));
                by.fold(std::cmp::Ordering::Equal, std::cmp::Ordering::then)
            })
            .map(|(index, _)| *index)
    }

    /// False if its views contradict each other or show different aircraft, or if it was never paired and has not approached at a usual
    /// speed, stands still, has an unusual size for its position, or is missing in a view that should see it.
    fn is_certain(chosen: &Aircraft, tick: &Tick, step_s: f64) -> bool {
        if chosen.disputed_s > 0.0 && chosen.count() > 1 || chosen.doubted_s > DISPUTE_S {
            return false;
        }
        chosen.paired_s > 0.0
            // With ticks this far apart, waiting for the next would cost more than lamps do.
            || ((chosen.has_approached || step_s >= MAX_STEP_S)
                && tick.learned.is_on_path(chosen, step_s)
                && !tick.is_missed(chosen))
    }
}

impl PairedViews {
    fn path(&self, view: usize) -> Option<&Path> {
        self.paths.iter().find(|path| path.view == view)
    }

    /// True if an object moves, with the size and growth of aircraft on the training's paths.
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

    /// True if it also moves about as fast as the training's aircraft.
    fn shows_approach(&self, of: &Aircraft, step_s: f64) -> bool {
        let mut motions = of.motions().peekable();
        motions.peek().is_some()
            && motions.all(|(view, ends)| self.path(view).is_none_or(|path| path.is_as_fast(ends)))
            && self.is_on_path(of, step_s)
    }
}

/// The relation between two views with the boxes in its order; `None` without a relation.
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

/// True if two boxes cannot show the same aircraft.
fn contradicts(relations: &[Relation], a: (usize, &PixelBox), b: (usize, &PixelBox)) -> bool {
    related(relations, a, b).is_some_and(|(relation, pair)| relation.contradicts(pair))
}

struct Tick<'a> {
    learned: &'a PairedViews,
    time_s: f64,
    boxes: &'a [Vec<Candidate>],
    /// Views that are not blind.
    looks: &'a [bool],
    /// True if an image edge cuts off everything in a view.
    has_cut_off: bool,
}

impl Tick<'_> {
    /// An object's boxes at this tick, as view and index.
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

    /// Mean misfit between two objects; `None` if they cannot be the same: a view sees both, or views contradict each other.
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
                if let Some((relation, pair)) = related(&self.learned.relations, a, b) {
                    misfits.push(relation.misfit(pair)?);
                }
            }
        }
        let count = misfits.len();
        (count > 0).then(|| misfits.iter().sum::<f64>() / count as f64)
    }

    /// Number of other views that contradict a box.
    fn contradictions(&self, aircraft: &Aircraft, of: (usize, usize)) -> usize {
        let others = self.seen(aircraft).filter(|other| other.0 != of.0);
        let of = self.pixel_box(of);
        others
            .filter(|&other| contradicts(&self.learned.relations, of, self.pixel_box(other)))
            .count()
    }

    fn is_disputed(&self, aircraft: &Aircraft) -> bool {
        let mut seen = self.seen(aircraft);
        seen.any(|of| self.contradictions(aircraft, of) > 0)
    }

    /// True if a view that should see the aircraft does not.
    fn is_missed(&self, aircraft: &Aircraft) -> bool {
        self.missing(aircraft).next().is_some()
    }

    /// True if no other view looks.
    fn is_of_the_only_view(&self, aircraft: &Aircraft) -> bool {
        let looks = |(view, looks): (usize, &bool)| *looks && aircraft.boxes[view].is_none();
        aircraft.count() == 1 && !self.looks.iter().enumerate().any(looks)
    }

    /// True if only such a view sees another approaching object.
    fn is_replaced(&self, aircraft: &Aircraft, all: &[Aircraft]) -> bool {
        self.missing(aircraft).any(|missing| {
            let mut others = all.iter().filter(|other| other.count() == 1);
            others.any(|other| other.boxes[missing].is_some() && other.approaches())
        })
    }

    /// Views that should see the aircraft but do not.
    fn missing<'b>(&'b self, aircraft: &'b Aircraft) -> impl Iterator<Item = usize> + 'b {
        let is_missed_by = |other: &usize| {
            self.looks[*other] && !self.has_cut_off && aircraft.boxes[*other].is_none()
        };
        self.seen(aircraft).flat_map(move |of| {
            let (view, seen) = self.pixel_box(of);
            let others = self.learned.relations.iter();
            let others = others.filter_map(move |relation| relation.also_sees(view, seen));
            others.filter(is_missed_by)
        })
    }

    /// The view with the most doubtful box; `None` without a contradiction, or if both sides are equally likely.
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

    /// Maximum box width, pixels.
    fn width_px(&self, aircraft: &Aircraft) -> f64 {
        let widths = self.seen(aircraft);
        let widths = widths.map(|(view, index)| self.boxes[view][index].pixel_box.width_px);
        widths.fold(0.0, f64::max)
    }
}
