//! Further boxes in an image: the one with the highest score is not always the aircraft.
//!
//! An observation has the best box of each view, and here the remaining boxes with the registered shifts, so that
//! [`crate::samples::paired_views`] can choose later. Most ticks have no further boxes.

use dataset::tables::pixel_box::PixelBox;
use dataset::tables::registrations::Shift;
use glam::DVec2;

use crate::samples::Observation;
use crate::samples::sample::moved_box;
use crate::samples::view_shift::ViewShift;

/// A registered shift with the index of its reference view.
pub(crate) type Registered = (usize, Shift);

/// A whole box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Candidate {
    pub pixel_box: PixelBox,
    pub track: Option<u32>,
}

/// Boxes with lower scores at a tick.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct OtherBoxes {
    /// Per view, sorted by score.
    pub boxes: Vec<Vec<Candidate>>,
    /// Registered shifts per view, for any box.
    pub registered: Vec<Option<Registered>>,
}

impl OtherBoxes {
    /// All but the first box per view; `None` if no view has a second box.
    pub(crate) fn of(
        found: &[Option<Vec<Candidate>>],
        registered: &[Option<Registered>],
    ) -> Option<Box<Self>> {
        let others = |found: &Option<Vec<Candidate>>| -> Vec<Candidate> {
            found.iter().flatten().skip(1).copied().collect()
        };
        Self {
            boxes: found.iter().map(others).collect(),
            registered: registered.to_vec(),
        }
        .unless_empty()
    }

    /// Boxes in views that still have a best box.
    pub(crate) fn of_views(others: Option<&Self>, boxes: &[Option<PixelBox>]) -> Option<Box<Self>> {
        let mut left = others?.clone();
        for (others, seen) in left.boxes.iter_mut().zip(boxes) {
            if seen.is_none() {
                others.clear();
            }
        }
        left.unless_empty()
    }

    /// Boxes and shifts as seen by other cameras ([`Observation::moved`]).
    pub(crate) fn moved(&self, place: impl Fn(usize, DVec2) -> Option<DVec2>) -> Self {
        let boxes = self.boxes.iter().enumerate().map(|(view, others)| {
            let others = others.iter().filter_map(|other| {
                let pixel_box = moved_box(&other.pixel_box, view, &place)?;
                Some(Candidate {
                    pixel_box,
                    ..*other
                })
            });
            others.collect()
        });
        let registered = self
            .registered
            .iter()
            .enumerate()
            .map(|(view, registered)| {
                let (reference, shift) = (*registered)?;
                let followed_px = DVec2::new(shift.x_px, shift.y_px);
                let there_px = place(view, followed_px + DVec2::new(shift.dx_px, shift.dy_px))?;
                let [x_px, y_px] = place(reference, followed_px)?.to_array();
                let shift = Shift {
                    x_px,
                    y_px,
                    dx_px: there_px.x - x_px,
                    dy_px: there_px.y - y_px,
                    ..shift
                };
                Some((reference, shift))
            });
        Self {
            boxes: boxes.collect(),
            registered: registered.collect(),
        }
    }

    fn unless_empty(self) -> Option<Box<Self>> {
        let any = self.boxes.iter().any(|others| !others.is_empty());
        any.then(|| Box::new(self))
    }
}

impl Observation {
    /// All boxes in a view, sorted by score.
    pub(crate) fn candidates(&self, view: usize) -> impl Iterator<Item = Candidate> {
        let best = self.boxes[view].map(|pixel_box| Candidate {
            pixel_box,
            track: self.tracks[view],
        });
        let others = self.others.as_ref().map(|others| &others.boxes[view]);
        best.into_iter()
            .chain(others.into_iter().flatten().copied())
    }

    /// The tick with only the boxes that fulfil a condition. The next box replaces a rejected best one.
    pub(crate) fn with_boxes_that(&self, is_kept: impl Fn(usize, &PixelBox) -> bool) -> Self {
        let kept = |view: usize| {
            let candidates = self.candidates(view).enumerate();
            let kept = candidates.filter(|(_, candidate)| is_kept(view, &candidate.pixel_box));
            kept.map(|(index, _)| index).collect()
        };
        let kept: Vec<Vec<usize>> = (0..self.boxes.len()).map(kept).collect();
        self.with_candidates(&kept)
    }

    /// The tick with these candidates per view ([`Self::candidates`]), in this order.
    pub(crate) fn with_candidates(&self, kept: &[Vec<usize>]) -> Self {
        let candidates = |view: usize| -> Vec<Candidate> {
            let all: Vec<Candidate> = self.candidates(view).collect();
            kept[view].iter().map(|&index| all[index]).collect()
        };
        let views = 0..self.boxes.len();
        let candidates: Vec<Vec<Candidate>> = views.clone().map(candidates).collect();
        let boxes: Vec<Option<PixelBox>> = (candidates.iter())
            .map(|of_view| Some(of_view.first()?.pixel_box))
            .collect();
        let is_best = |view: usize| kept[view].first() == Some(&0);
        let shift = |view: usize| {
            if let Some(shift) = self.shifts[view]
                && is_best(view)
                && is_best(shift.reference)
            {
                return Some(shift);
            }
            let (reference, shift) = self.others.as_ref()?.registered[view]?;
            ViewShift::between(
                (reference, boxes[reference].as_ref()?),
                boxes[view].as_ref()?,
                &shift,
            )
        };
        let others = self.others.as_ref().map(|others| OtherBoxes {
            boxes: (candidates.iter())
                .map(|of_view| of_view.iter().skip(1).copied().collect())
                .collect(),
            registered: others.registered.clone(),
        });
        Self {
            shifts: views.map(shift).collect(),
            tracks: (candidates.iter())
                .map(|of_view| of_view.first()?.track)
                .collect(),
            others: others.and_then(OtherBoxes::unless_empty),
            boxes,
            ..self.clone()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::tests::fixtures::{box_at, shift_of};

    fn candidate(cx_px: f64) -> Candidate {
        Candidate {
            pixel_box: box_at(cx_px, 600.0),
            track: None,
        }
    }

    /// A false box has the highest score in the right view; the views are registered at the aircraft.
    fn observed() -> Observation {
        let found = [
            Some(vec![candidate(500.0)]),
            Some(vec![candidate(900.0), candidate(401.0)]),
        ];
        let shift = shift_of([500.0, 600.0], [-100.0, 0.0]);
        let best = found.iter().flatten().map(|found| Some(found[0].pixel_box));
        Observation {
            boxes: best.collect(),
            others: OtherBoxes::of(&found, &[None, Some((0, shift))]),
            ..Observation::unseen((0, 4, 0), 2)
        }
    }

    fn columns_px(observed: &Observation) -> Vec<Option<f64>> {
        let boxes = observed.boxes.iter();
        boxes.map(|seen| seen.map(|seen| seen.cx_px)).collect()
    }

    #[test]
    fn a_box_in_the_place_of_a_better_one_has_the_registration_of_the_aircraft() {
        let observed = observed();
        let chosen = observed.with_boxes_that(|_, seen| seen.cx_px < 600.0);
        assert_eq!(columns_px(&chosen), [Some(500.0), Some(401.0)]);
        assert_eq!(chosen.shifts[1].unwrap().shift_px.x, -100.0);
        assert_eq!(chosen.others, None);
        let all = observed.with_boxes_that(|_, _| true);
        assert_eq!(all, observed);
    }

    #[test]
    fn other_boxes_and_their_registration_move_with_the_view() {
        let by = |view: usize, px: DVec2| Some(px + [DVec2::X, 3.0 * DVec2::Y][view]);
        let moved = observed().moved(by);
        assert_eq!(columns_px(&moved), [Some(501.0), Some(900.0)]);
        let chosen = moved.with_boxes_that(|_, seen| seen.cx_px < 600.0);
        assert_eq!(chosen.boxes[1].unwrap().cy_px, 603.0);
        let shift_px = chosen.shifts[1].unwrap().shift_px;
        assert_eq!(shift_px, DVec2::new(-101.0, 3.0));
        let unknown = observed().moved(|view, px| (view == 0).then_some(px));
        assert_eq!(columns_px(&unknown), [Some(500.0), None]);
        assert_eq!(unknown.others, None);
    }

    #[test]
    fn a_removed_view_has_no_other_boxes_either() {
        let observed = observed();
        let removed = observed.with_boxes(vec![observed.boxes[0], None]);
        assert_eq!(removed.others, None);
        let kept = observed.with_boxes(vec![None, observed.boxes[1]]);
        assert_eq!(kept.candidates(1).count(), 2);
    }
}
