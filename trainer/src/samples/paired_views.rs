//! One aircraft in several views: of the boxes of a flight, those that are of the same aircraft.
//!
//! A detector's best box of a view may be a lamp, a bird or a second arrival, whatever the other views see. Here the views have to agree: a
//! [`Relation`] of each two views, learned from the training's boxes, says which boxes can be one aircraft, and a [`Follower`] keeps to one
//! aircraft for a flight. Where views contradict each other, the boxes of the aircraft that was followed before are kept, or none. What one
//! view sees while the others see nothing counts once it comes along the paths of the training ([`Path`]), until views have agreed on
//! something else. Where fog hides the background, a camera may have been turned without a sign: an aircraft that stays beside these paths
//! gets no answer there ([`aside`]).

mod aircraft;
mod aside;
mod follower;
mod path;
mod relation;
mod robust_line;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::samples::{Observation, Sample};
use aside::Pair;
pub(crate) use aside::{Aside, AsideWatch};
pub(crate) use follower::Follower;
use follower::{InSight, Learned};
use path::{Path, Sighting};
use relation::{MIN_PAIRS, Relation};

/// The relations of a rig's views, and the paths in each.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PairedViews {
    /// Those of the pairs of views that saw the aircraft together often enough, by the indices of the views.
    relations: Vec<Relation>,
    /// Sizes along the paths, of the views that saw the aircraft often enough, by their indices.
    paths: Vec<Path>,
}

/// One object at a tick.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct OfObject {
    /// Number in the order of appearance.
    pub number: usize,
    /// Of all objects, this one is followed.
    pub is_followed: bool,
    /// The tick with its boxes alone.
    pub observed: Observation,
}

impl PairedViews {
    /// Learns the relations from samples whose boxes contain the aircraft.
    pub(crate) fn fit(views: usize, true_boxes: &[&Sample]) -> Self {
        let pairs = (0..views).flat_map(|one| (one + 1..views).map(move |other| [one, other]));
        Self {
            relations: pairs.filter_map(|pair| fitted(pair, true_boxes)).collect(),
            paths: (0..views)
                .filter_map(|view| fitted_path(view, true_boxes))
                .collect(),
        }
    }

    /// A line for users about each two views that stay unrelated, or whose turns would not be noticed. `views`: their names.
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
        let pairs =
            (0..views.len()).flat_map(|one| (one + 1..views.len()).map(move |other| [one, other]));
        pairs
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

    /// The same with what concerns one view learned again.
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

    /// The same without what concerns one view.
    pub(crate) fn without(&self, view: usize) -> Self {
        let mut others = self.clone();
        others.relations.retain(|of| !of.views.contains(&view));
        others.paths.retain(|of| of.view != view);
        others
    }

    /// True if boxes of two views can be told to be of one aircraft.
    pub(crate) fn is_empty(&self) -> bool {
        self.relations.is_empty()
    }

    /// Whole flights with at most one box per view: the boxes of one aircraft. Boxes of views without a relation stay as they are.
    pub(crate) fn of_one_aircraft(&self, flights: &[Observation]) -> Vec<Observation> {
        if self.is_empty() {
            return flights.to_vec();
        }
        let flights = flights.chunk_by(|a, b| a.scenario == b.scenario);
        let chosen = flights.flat_map(|flight| {
            let followed = self.followed(flight);
            let aside = self.aside(&followed);
            let placed = followed.into_iter().map(|(number, observed)| {
                let time_s = observed.time_ns as f64 / 1e9;
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

    /// A flight with the boxes of the object that is followed, and its number.
    fn followed(&self, flight: &[Observation]) -> Vec<(Option<usize>, Observation)> {
        let mut follower = Follower::default();
        let ticks = flight.iter().map(|observed| {
            let in_sight = follower.step(self.learned(), observed);
            let followed = in_sight.into_iter().find(|of| of.is_followed);
            let number = followed.as_ref().map(|of| of.number);
            (number, self.of_object(observed, followed.as_ref()))
        });
        ticks.collect()
    }

    /// The objects of a flight that were beside the paths of the training to their end: what comes back was seen by cameras that look where
    /// they did.
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
            .filter_map(|(number, watch)| Some((number, watch.last()?)))
            .collect()
    }

    /// The same of one flight, in the order of their numbers.
    pub(crate) fn aside_in(&self, flight: &[Observation]) -> Vec<Aside> {
        self.aside(&self.followed(flight)).into_values().collect()
    }

    /// Takes the next tick of an object among views without an end.
    pub(crate) fn aside_at<'w>(
        &self,
        watch: &'w mut AsideWatch,
        observed: &Observation,
    ) -> Option<&'w Aside> {
        watch.next(&self.relations, observed)
    }

    /// The next tick of views without an end: the boxes of each object that is remembered, the followed one first.
    pub(crate) fn next(&self, follower: &mut Follower, observed: &Observation) -> Vec<OfObject> {
        let mut in_sight = follower.step(self.learned(), observed);
        in_sight.sort_by_key(|of| (!of.is_followed, of.number));
        let objects = in_sight.iter();
        objects
            .map(|of| OfObject {
                number: of.number,
                is_followed: of.is_followed,
                observed: self.of_object(observed, Some(of)),
            })
            .collect()
    }

    fn learned(&self) -> Learned<'_> {
        Learned {
            relations: &self.relations,
            paths: &self.paths,
        }
    }

    /// The tick with the boxes of an object; the best box of a view without a relation is of the followed one.
    fn of_object(&self, observed: &Observation, object: Option<&InSight>) -> Observation {
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

    /// True if these are relations between this many views and paths in them, with possible deviations.
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

    /// All of its numbers.
    pub(crate) fn constants(&self) -> impl Iterator<Item = f64> {
        let relations = self.relations.iter().flat_map(Relation::constants);
        relations.chain(self.paths.iter().flat_map(Path::constants))
    }
}

/// True if there is a relation between a view and another one.
fn is_related(relations: &[Relation], view: usize) -> bool {
    let mut relations = relations.iter();
    relations.any(|relation| relation.views.contains(&view))
}

fn fitted(views: [usize; 2], true_boxes: &[&Sample]) -> Option<Relation> {
    Relation::fit(views, &pairs_of(views, true_boxes))
}

/// The ticks at which two views saw the aircraft, flight by flight.
fn pairs_of<'a>(views: [usize; 2], true_boxes: &[&'a Sample]) -> Vec<Vec<Pair<'a>>> {
    let flights = true_boxes.chunk_by(|a, b| a.scenario == b.scenario);
    let pairs = flights.map(|flight| {
        let pairs = flight.iter().filter_map(|sample| Pair::of(views, sample));
        pairs.collect()
    });
    pairs.collect()
}

fn fitted_path(view: usize, true_boxes: &[&Sample]) -> Option<Path> {
    let flights = true_boxes.chunk_by(|a, b| a.scenario == b.scenario);
    let flights = flights.map(|flight| {
        let sighting = |sample: &&Sample| {
            Some(Sighting {
                time_s: sample.time_ns as f64 / 1e9,
                pixel_box: sample.boxes[view]?,
            })
        };
        flight.iter().filter_map(sighting).collect::<Vec<_>>()
    });
    Path::fit(view, &flights.collect::<Vec<_>>())
}

#[cfg(test)]
mod tests;
