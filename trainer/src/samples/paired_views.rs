//! Association of boxes: one aircraft across several views.
//!
//! A detector's best box in a view may show a lamp, a bird or a second arrival, regardless of the other views. Here the views have to
//! agree: a [`Relation`] per pair of views, learned from training boxes, tells which boxes can show the same aircraft, and a [`Follower`]
//! keeps to one aircraft per flight. If views contradict each other, the aircraft that was followed before keeps its boxes, or none is
//! used. An object in one view alone counts once it comes along the training's paths ([`Path`]), until views agree on something else.

mod aircraft;
mod follower;
mod path;
mod relation;
mod sighting;

use dataset::tables::pixel_box::PixelBox;
use serde::{Deserialize, Serialize};

use crate::samples::{Observation, Sample};
pub(crate) use follower::Follower;
use follower::ObjectBoxes;
use path::Path;
use relation::{MIN_PAIRS, Relation};
use sighting::Sighting;
pub(crate) use sighting::{MAX_GAP_S, MEMORY_S, RECENT_S, STEP_S, STILL_GROWTH};

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

    /// Lines for users about pairs of views without a relation. `views`: their names.
    pub(crate) fn unrelated(&self, views: &[String], true_boxes: &[&Sample]) -> Vec<String> {
        pairs_among(views.len())
            .filter(|pair| !self.relations.iter().any(|relation| relation.views == *pair))
            .map(|pair| {
                let [one, other] = pair.map(|view| &views[view]);
                format!(
                    "views {one} and {other} are not compared: both see the aircraft in {} ticks of the training side, expected at least \
                     {MIN_PAIRS}; the best box of each view counts, also if they are of different objects",
                    pairs_of(pair, true_boxes).count()
                )
            })
            .collect()
    }

    /// Copy with everything about one view learned again.
    pub(crate) fn with_view_refitted(
        &self,
        view: usize,
        views: usize,
        true_boxes: &[&Sample],
    ) -> Self {
        let mut all = self.without(view);
        let pairs = pairs_among(views).filter(|pair| pair.contains(&view));
        all.relations
            .extend(pairs.filter_map(|pair| fitted(pair, true_boxes)));
        all.relations.sort_by_key(|relation| relation.views);
        all.paths.extend(fitted_path(view, true_boxes));
        all.paths.sort_by_key(|path| path.view);
        all
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
        let followed = flights.flat_map(|flight| self.followed(flight));
        followed.map(|(_, observed)| observed).collect()
    }

    /// A flight with the boxes of the followed object, and its number.
    pub(crate) fn followed(&self, flight: &[Observation]) -> Vec<(Option<usize>, Observation)> {
        let mut follower = Follower::default();
        let ticks = flight.iter().map(|observed| {
            let in_sight = follower.step(self, observed);
            let followed = in_sight.into_iter().find(|of| of.is_followed);
            let number = followed.as_ref().map(|of| of.number);
            (number, self.of_object(observed, followed.as_ref()))
        });
        ticks.collect()
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
        let kept = (0..observed.views()).map(|view| {
            if is_related(&self.relations, view) {
                object.and_then(|object| object.boxes[view])
            } else {
                let is_followed = object.is_none_or(|object| object.is_followed);
                (is_followed && observed.best(view).is_some()).then_some(0)
            }
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
    Relation::fit(views, &pairs_of(views, true_boxes).collect::<Vec<_>>())
}

/// Boxes of ticks at which both views saw the aircraft.
fn pairs_of<'a>(
    [first, second]: [usize; 2],
    true_boxes: &[&'a Sample],
) -> impl Iterator<Item = [&'a PixelBox; 2]> {
    let samples = true_boxes.iter();
    samples.filter_map(move |sample| Some([sample.best(first)?, sample.best(second)?]))
}

fn fitted_path(view: usize, true_boxes: &[&Sample]) -> Option<Path> {
    let sighting = |sample: &&Sample| {
        Some(Sighting {
            time_s: sample.time_s(),
            pixel_box: *sample.best(view)?,
        })
    };
    let flights = true_boxes.chunk_by(|a, b| a.scenario == b.scenario);
    let flights = flights.map(|flight| flight.iter().filter_map(sighting).collect());
    Path::fit(view, &flights.collect::<Vec<_>>())
}

#[cfg(test)]
mod tests;
