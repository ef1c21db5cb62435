//! Association of boxes: one aircraft across several views.
//!
//! A detector's best box in a view may show a lamp, a bird or a second arrival, regardless of the other views. Here the views have to
//! agree: a [`Relation`] per pair of views, learned from training boxes, tells which boxes can show the same aircraft, and a [`Follower`]
//! keeps to one aircraft per flight. If views contradict each other, the aircraft that was followed before keeps its boxes, or none is
//! used. An object in one view alone counts once it comes along the training's paths ([`Path`]), until views agree on something else. In
//! fog a camera may be turned unnoticed: an aircraft that stays beside these paths gets no estimate ([`aside`]).

mod aircraft;
mod aside;
mod follower;
mod path;
mod relation;
mod sighting;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::samples::{Observation, Sample};
use aside::Pair;
pub(crate) use aside::{Aside, AsideWatch};
pub(crate) use follower::Follower;
use follower::ObjectBoxes;
use path::Path;
use relation::{MIN_PAIRS, Relation};
pub(crate) use sighting::MEMORY_S;
use sighting::Sighting;

/// Relations between views, and paths in each view.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PairedViews {
    /// For pairs of views that saw the aircraft together often enough, by view index.
    pub relations: Vec<Relation>,
    /// For views that saw the aircraft often enough, by view index.
    paths: Vec<Path>,
}

/// An object at a tick.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ObjectTick {
    /// Number in order of appearance.
    pub number: usize,
    /// True for the object that is followed.
    pub is_followed: bool,
    /// The tick with only this object's boxes.
    pub observed: Observation,
}

impl PairedViews {
    /// Learns from samples with only true boxes.
    pub(crate) fn fit(views: usize, true_boxes: &[&Sample]) -> Self {
        Self {
            relations: (pairs_among(views))
                .filter_map(|pair| fitted(pair, true_boxes))
                .collect(),
            paths: (0..views)
                .filter_map(|view| fitted_path(view, true_boxes))
                .collect(),
        }
    }

    /// Lines for users about pairs of views without a relation, or without a watch for turned cameras. `views`: their names.
    pub(crate) fn unrelated(&self, views: &[String], true_boxes: &[&Sample]) -> Vec<String> {
        let unwatched = self.relations.iter().filter(|of| of.columns.is_none());
        let unwatched = unwatched.map(|relation| {
            let [one, other] = relation.views.map(|view| &views[view]);
            format!(
                "views {one} and {other}: fewer than {} training flights were seen by both for a minute, so a camera that is turned in fog \
                 will not be noticed",
                aside::MIN_FLIGHTS
            )
        });
        pairs_among(views.len())
            .filter(|pair| !self.relations.iter().any(|relation| relation.views == *pair))
            .map(|pair| {
                let [one, other] = pair.map(|view| &views[view]);
                format!(
                    "views {one} and {other} are not compared: both see the aircraft in {} ticks of the training side, expected at least \
                     {MIN_PAIRS}; the best box of each view counts, also if they are of different objects",
                    pairs_of(pair, true_boxes).iter().flatten().count()
                )
            })
            .chain(unwatched)
            .collect()
    }

    /// Copy with everything about one view learned again.
    pub(crate) fn with_view_refitted(
        &self,
        view: usize,
        views: usize,
        true_boxes: &[&Sample],
    ) -> Self {
        let Self {
            mut relations,
            mut paths,
        } = self.without(view);
        let others = (0..views).filter(|&other| other != view);
        relations.extend(others.filter_map(|other| {
            let pair = [view.min(other), view.max(other)];
            fitted(pair, true_boxes)
        }));
        relations.sort_by_key(|relation| relation.views);
        paths.extend(fitted_path(view, true_boxes));
        paths.sort_by_key(|path| path.view);
        Self { relations, paths }
    }

    /// Copy without everything about one view.
    pub(crate) fn without(&self, view: usize) -> Self {
        let mut others = self.clone();
        others.relations.retain(|of| !of.views.contains(&view));
        others.paths.retain(|of| of.view != view);
        others
    }

    /// True without any relation.
    pub(crate) fn is_empty(&self) -> bool {
        self.relations.is_empty()
    }

    /// Whole flights with at most one box per view: the boxes of one aircraft. Views without a relation stay unchanged.
    pub(crate) fn of_one_aircraft(&self, flights: &[Observation]) -> Vec<Observation> {
        if self.is_empty() {
            return flights.to_vec();
        }
        let flights = flights.chunk_by(|a, b| a.scenario == b.scenario);
        let chosen = flights.flat_map(|flight| {
            let followed = self.followed(flight);
            let aside = self.aside(&followed);
            let placed = followed.into_iter().map(|(number, observed)| {
                let time_s = observed.time_s();
                let aside = number.and_then(|number| aside.get(&number));
                match aside.filter(|aside| aside.is_hidden && time_s >= aside.since_s) {
                    Some(aside) => observed.without_images(|view| aside.views.contains(&view)),
                    None => observed,
                }
            });
            placed.collect::<Vec<_>>()
        });
        chosen.collect()
    }

    /// A flight with the boxes of the followed object, and its number.
    fn followed(&self, flight: &[Observation]) -> Vec<(Option<usize>, Observation)> {
        let mut follower = Follower::default();
        let ticks = flight.iter().map(|observed| {
            let in_sight = follower.step(self, observed);
            let followed = in_sight.into_iter().find(|of| of.is_followed);
            let number = followed.as_ref().map(|of| of.number);
            (number, self.of_object(observed, followed.as_ref()))
        });
        ticks.collect()
    }

    /// Objects that were still beside the training's paths when they ended; one that returned was seen by unturned cameras.
    fn aside(&self, followed: &[(Option<usize>, Observation)]) -> BTreeMap<usize, Aside> {
        let mut watches: BTreeMap<usize, AsideWatch> = BTreeMap::new();
        for (number, observed) in followed {
            if let Some(number) = number {
                let watch = watches.entry(*number).or_default();
                watch.next(&self.relations, observed);
            }
        }
        let ended = watches.into_iter();
        ended
            .filter_map(|(number, watch)| Some((number, watch.aside?)))
            .collect()
    }

    /// Objects beside the paths in a flight, by number.
    pub(crate) fn aside_in(&self, flight: &[Observation]) -> Vec<Aside> {
        self.aside(&self.followed(flight)).into_values().collect()
    }

    /// The next live tick: boxes per remembered object, the followed one first.
    pub(crate) fn next(&self, follower: &mut Follower, observed: &Observation) -> Vec<ObjectTick> {
        let mut in_sight = follower.step(self, observed);
        in_sight.sort_by_key(|of| (!of.is_followed, of.number));
        let objects = in_sight.iter();
        objects
            .map(|of| ObjectTick {
                number: of.number,
                is_followed: of.is_followed,
                observed: self.of_object(observed, Some(of)),
            })
            .collect()
    }

    /// The tick with an object's boxes; the followed one also gets the best box in each view without a relation.
    fn of_object(&self, observed: &Observation, object: Option<&ObjectBoxes>) -> Observation {
        let kept = (0..observed.boxes.len()).map(|view| {
            let index = if is_related(&self.relations, view) {
                object.and_then(|object| object.boxes[view])
            } else {
                let is_followed = object.is_none_or(|object| object.is_followed);
                observed.boxes[view].filter(|_| is_followed).map(|_| 0)
            };
            index.into_iter().collect()
        });
        observed.with_candidates(&kept.collect::<Vec<_>>())
    }

    /// True for valid view indices and plausible deviations.
    pub(crate) fn is_of(&self, views: usize) -> bool {
        let mut relations = self.relations.iter();
        let is_possible = |relation: &Relation| {
            let [one, other] = relation.views;
            one < other && other < views && relation.is_possible()
        };
        let mut paths = self.paths.iter();
        relations.all(is_possible)
            && self.relations.is_sorted_by(|a, b| a.views < b.views)
            && paths.all(|path| path.view < views && path.is_possible())
            && self.paths.is_sorted_by(|a, b| a.view < b.view)
    }
}

fn is_related(relations: &[Relation], view: usize) -> bool {
    let mut relations = relations.iter();
    relations.any(|relation| relation.views.contains(&view))
}

fn pairs_among(views: usize) -> impl Iterator<Item = [usize; 2]> {
    (0..views).flat_map(move |one| (one + 1..views).map(move |other| [one, other]))
}

fn fitted(views: [usize; 2], true_boxes: &[&Sample]) -> Option<Relation> {
    Relation::fit(views, &pairs_of(views, true_boxes))
}

/// Ticks at which both views saw the aircraft, flight by flight.
fn pairs_of<'a>(views: [usize; 2], true_boxes: &[&'a Sample]) -> Vec<Vec<Pair<'a>>> {
    by_flight(true_boxes, |sample| Pair::of(views, sample))
}

fn fitted_path(view: usize, true_boxes: &[&Sample]) -> Option<Path> {
    let sighting = |sample: &Sample| {
        Some(Sighting {
            time_s: sample.time_s(),
            pixel_box: sample.boxes[view]?,
        })
    };
    Path::fit(view, &by_flight(true_boxes, sighting))
}

fn by_flight<'a, T>(
    ticks: &[&'a Sample],
    of_tick: impl Fn(&'a Sample) -> Option<T>,
) -> Vec<Vec<T>> {
    let flights = ticks.chunk_by(|a, b| a.scenario == b.scenario);
    flights
        .map(|flight| flight.iter().filter_map(|sample| of_tick(sample)).collect())
        .collect()
}

#[cfg(test)]
mod tests;
