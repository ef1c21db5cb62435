//! One tick before touchdown: what the cameras saw, and where the aircraft was.

use std::ops::Deref;

use dataset::geometry::geodesy::Geodetic;
use dataset::tables::pixel_box::PixelBox;
use glam::DVec2;

use crate::samples::camera_health::look::Look;
use crate::samples::trusted_boxes::centre_and_size;
use crate::samples::trusted_boxes::other_boxes::{Candidate, OtherBoxes, Registered};
use crate::samples::view_shift::ViewShift;

/// An error of the places in a view that all ticks of a flight share, such as the error of a lag or of a camera's turn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct CommonError {
    /// Index of the view.
    pub view: usize,
    /// Displacement of places by one standard deviation, right and down, pixels.
    pub sd_px: DVec2,
}

/// Observation at one tick: the only input of an estimator.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Observation {
    /// Index into [`super::Samples::scenarios`].
    pub scenario: usize,
    /// Tick within the scenario.
    pub tick: u32,
    /// Time since the scenario's first tick, nanoseconds.
    pub time_ns: i64,
    /// Box of each view, in the order of [`super::Samples::views`].
    pub boxes: Vec<Option<PixelBox>>,
    /// Numbers of the tracks that they belong to, in the same order.
    pub tracks: Vec<Option<u32>>,
    /// Position of the aircraft in each view by registration, in the same order.
    pub shifts: Vec<Option<ViewShift>>,
    /// Views whose only boxes are cut off by the image's edge, which are not in `boxes`.
    pub cut_off: usize,
    /// Image of each view, in the same order. A view that looks and has no box sees nothing; one that fails is blind.
    pub looks: Vec<Look>,
    /// Errors of the places in views that all ticks of the flight share, independent of each other.
    pub common_errors: Vec<CommonError>,
    /// Boxes with lower scores in the same images, if there are any.
    pub others: Option<Box<OtherBoxes>>,
}

impl Observation {
    /// Of a scenario at a tick and a time in nanoseconds. `found`: by view the whole boxes, the highest score first, none of them where
    /// the image's edge cuts off all; `registered`, `looks`: by view.
    pub(crate) fn of(
        (scenario, tick, time_ns): (usize, u32, i64),
        found: &[Option<Vec<Candidate>>],
        registered: &[Option<Registered>],
        looks: Vec<Look>,
    ) -> Self {
        let best: Vec<_> = found.iter().map(|found| found.as_ref()?.first()).collect();
        let boxes: Vec<_> = best.iter().map(|best| Some((*best)?.pixel_box)).collect();
        let shift = |(registered, seen): (&Option<Registered>, &Option<PixelBox>)| {
            let (reference, shift) = registered.as_ref()?;
            let in_reference = boxes[*reference].as_ref()?;
            ViewShift::between((*reference, in_reference), seen.as_ref()?, shift)
        };
        Self {
            shifts: registered.iter().zip(&boxes).map(shift).collect(),
            scenario,
            tick,
            time_ns,
            cut_off: (found.iter().flatten())
                .filter(|found| found.is_empty())
                .count(),
            tracks: best.iter().map(|best| (*best)?.track).collect(),
            others: OtherBoxes::of(found, registered),
            boxes,
            looks,
            common_errors: Vec::new(),
        }
    }

    /// The same tick with only some of its boxes; a shift goes with its box, and so do the other boxes of its view.
    pub(crate) fn with_boxes(&self, boxes: Vec<Option<PixelBox>>) -> Self {
        let kept = |shift: &ViewShift, seen: &Option<PixelBox>| {
            seen.is_some() && boxes[shift.reference].is_some()
        };
        let shifts = self.shifts.iter().zip(&boxes);
        Self {
            shifts: shifts
                .map(|(shift, seen)| shift.filter(|shift| kept(shift, seen)))
                .collect(),
            others: OtherBoxes::of_views(self.others.as_deref(), &boxes),
            tracks: self.tracks.clone(),
            looks: self.looks.clone(),
            common_errors: self.common_errors.clone(),
            boxes,
            ..*self
        }
    }

    /// The same tick without the images of some views.
    pub(crate) fn without_images(&self, is_lost: impl Fn(usize) -> bool) -> Self {
        let boxes = self.boxes.iter().enumerate();
        let boxes = boxes.map(|(view, seen)| seen.filter(|_| !is_lost(view)));
        let looks = self.looks.iter().enumerate();
        let looks = looks.map(|(view, look)| if is_lost(view) { Look::Blind } else { *look });
        Self {
            looks: looks.collect(),
            ..self.with_boxes(boxes.collect())
        }
    }

    /// The same tick as other cameras would have seen it: `place` gives the place of a point of a view there, pixels, or `None` where it is
    /// not known; such boxes and shifts are dropped.
    pub(crate) fn moved(&self, place: impl Fn(usize, DVec2) -> Option<DVec2>) -> Self {
        let shift = |view: usize| {
            let shift = self.shifts[view]?;
            let followed_px = centre_and_size(self.boxes[shift.reference].as_ref()?).0;
            let there_px = place(view, followed_px + shift.shift_px)?;
            Some(ViewShift {
                shift_px: there_px - place(shift.reference, followed_px)?,
                ..shift
            })
        };
        let pixel_box =
            |(view, seen): (usize, &Option<PixelBox>)| moved_box(seen.as_ref()?, view, &place);
        let moved = Self {
            shifts: (0..self.shifts.len()).map(shift).collect(),
            tracks: self.tracks.clone(),
            boxes: self.boxes.clone(),
            looks: self.looks.clone(),
            common_errors: self.common_errors.clone(),
            others: self
                .others
                .as_ref()
                .map(|others| Box::new(others.moved(&place))),
            ..*self
        };
        moved.with_boxes(self.boxes.iter().enumerate().map(pixel_box).collect())
    }

    /// The same tick with less certain shifts: `sd_px` gives the standard deviation of the places of a view, which adds to what its shifts
    /// have.
    pub(crate) fn widened(mut self, sd_px: impl Fn(usize) -> DVec2) -> Self {
        let added = |own_px: DVec2, views: [usize; 2]| {
            in_quadrature([own_px, sd_px(views[0]), sd_px(views[1])])
        };
        for (view, shift) in self.shifts.iter_mut().enumerate() {
            if let Some(shift) = shift {
                shift.sd_px = added(shift.sd_px, [view, shift.reference]);
            }
        }
        let others = self.others.iter_mut().flat_map(|of| &mut of.registered);
        for (view, registered) in others.enumerate() {
            if let Some((reference, shift)) = registered {
                let own_px = DVec2::new(shift.sd_x_px, shift.sd_y_px);
                [shift.sd_x_px, shift.sd_y_px] = added(own_px, [view, *reference]).to_array();
            }
        }
        self
    }

    /// The same tick with more errors that it shares with others.
    pub(crate) fn with_common(mut self, errors: impl IntoIterator<Item = CommonError>) -> Self {
        let errors = errors.into_iter();
        self.common_errors
            .extend(errors.filter(|error| error.sd_px != DVec2::ZERO));
        self
    }

    /// The same tick with its common errors as part of the deviations of its shifts.
    fn with_common_in_shifts(mut self) -> Self {
        let common = std::mem::take(&mut self.common_errors);
        self.widened(|view| {
            let of_view = common.iter().filter(|error| error.view == view);
            in_quadrature(of_view.map(|error| error.sd_px))
        })
    }

    /// Number of views that saw the aircraft.
    pub(crate) fn detections(&self) -> usize {
        self.boxes.iter().flatten().count()
    }
}

/// Standard deviations of the sum of independent errors.
fn in_quadrature(sds: impl IntoIterator<Item = DVec2>) -> DVec2 {
    let squares: DVec2 = sds.into_iter().map(|sd| sd * sd).sum();
    DVec2::new(squares.x.sqrt(), squares.y.sqrt())
}

/// A box of a view, moved like its centre; `None` if that has no place.
pub(super) fn moved_box(
    seen: &PixelBox,
    view: usize,
    place: impl Fn(usize, DVec2) -> Option<DVec2>,
) -> Option<PixelBox> {
    let [cx_px, cy_px] = place(view, centre_and_size(seen).0)?.to_array();
    Some(PixelBox {
        cx_px,
        cy_px,
        ..*seen
    })
}

/// An observation with its truth. It dereferences to the observation: whatever takes an [`Observation`] cannot see the truth.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Sample {
    /// The observation.
    pub observed: Observation,
    /// True distance to touchdown, metres.
    pub dtd_m: f64,
    /// True distance along the course, metres.
    pub along_track_m: f64,
    /// True offset right of the course, metres.
    pub cross_track_m: f64,
    /// True position of the centre of gravity.
    pub position: Geodetic,
    /// Share of contrast that remains over the distance to the nearest camera whose image contains the aircraft; `None` if no
    /// image does.
    pub transmission: Option<f64>,
}

impl Deref for Sample {
    type Target = Observation;

    fn deref(&self) -> &Observation {
        &self.observed
    }
}

impl Sample {
    /// Makes its common errors part of the deviations of its shifts, for a training. It learns from many flights, which do not have the
    /// same common errors.
    pub(crate) fn move_common_to_shifts(&mut self) {
        if !self.observed.common_errors.is_empty() {
            self.observed = self.observed.clone().with_common_in_shifts();
        }
    }

    /// The same tick with other observations.
    pub(crate) fn with(&self, observed: Observation) -> Self {
        Self { observed, ..*self }
    }
}

#[cfg(test)]
impl Observation {
    /// An aircraft that two registered views see in these columns, a tick per second.
    pub(crate) fn registered(tick: u32, [first_px, second_px]: [f64; 2]) -> Self {
        let box_at = |cx_px: f64| PixelBox {
            cx_px,
            cy_px: 600.0,
            width_px: 40.0,
            height_px: 14.0,
        };
        let boxes = [first_px, second_px].map(box_at);
        let shift = dataset::tables::registrations::Shift {
            x_px: first_px,
            y_px: 600.0,
            dx_px: second_px - first_px,
            dy_px: 0.0,
            sd_x_px: 0.03,
            sd_y_px: 0.04,
            scale: 1.0,
            gain: 1.0,
            correlation: 0.9,
        };
        let mut observed = Sample::of_boxes(1.0, boxes.map(Some).to_vec()).observed;
        observed.shifts[1] = ViewShift::between((0, &boxes[0]), &boxes[1], &shift);
        observed.tick = tick;
        observed.time_ns = i64::from(tick) * 1_000_000_000;
        observed
    }
}

#[cfg(test)]
impl Sample {
    /// A sample at this distance whose views saw these boxes, for tests that need no more.
    pub(crate) fn of_boxes(dtd_m: f64, boxes: Vec<Option<PixelBox>>) -> Self {
        Self {
            observed: Observation {
                scenario: 0,
                tick: 0,
                time_ns: 0,
                shifts: vec![None; boxes.len()],
                tracks: vec![None; boxes.len()],
                looks: vec![Look::Placed; boxes.len()],
                boxes,
                common_errors: Vec::new(),
                cut_off: 0,
                others: None,
            },
            dtd_m,
            along_track_m: dtd_m,
            cross_track_m: 0.0,
            position: Geodetic {
                latitude_deg: 1.0,
                longitude_deg: 103.0,
                altitude_msl_m: 100.0,
            },
            transmission: Some(1.0),
        }
    }
}
