//! Observations and ground truth at one tick before touchdown.

use std::ops::Deref;

use dataset::geometry::geodesy::Geodetic;
use dataset::tables::health::HealthState;
use dataset::tables::pixel_box::PixelBox;
use glam::DVec2;

use crate::samples::trusted_boxes::centre_and_size;
use crate::samples::trusted_boxes::other_boxes::{Candidate, OtherBoxes, Registered};
use crate::samples::view_shift::ViewShift;

/// Image usability at a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Look {
    /// No usable image.
    #[default]
    Blind,
    /// The background is hidden: the camera may have been turned.
    Unplaced,
    /// The background shows the camera's direction relative to the rest of the flight, or nothing was checked.
    Placed,
}

impl Look {
    /// Usability under this condition, as known live.
    pub fn of(state: HealthState) -> Self {
        match state {
            HealthState::Unknown => Self::Unplaced,
            _ if state.is_well() => Self::Placed,
            _ => Self::Blind,
        }
    }
}

/// Error in image positions that is common to a whole flight, such as a lag error or a turned camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct CommonError {
    pub view: usize,
    /// Displacement by one standard deviation, right and down, pixels.
    pub sd_px: DVec2,
}

/// Observation at one tick: the only input for estimators.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Observation {
    /// Index into [`super::Samples::scenarios`].
    pub scenario: usize,
    pub tick: u32,
    /// Time since the scenario's first tick, nanoseconds.
    pub time_ns: i64,
    /// Box per view, in the order of [`super::Samples::views`].
    pub boxes: Vec<Option<PixelBox>>,
    /// Track numbers of the boxes.
    pub tracks: Vec<Option<u32>>,
    /// Registered position of the aircraft per view.
    pub shifts: Vec<Option<ViewShift>>,
    /// Number of views with all boxes cut off by the image's edge; such boxes are excluded from `boxes`.
    pub cut_off: usize,
    /// Image usability per view. A usable image without a box shows no aircraft.
    pub looks: Vec<Look>,
    /// Independent errors that are common to the whole flight.
    pub common_errors: Vec<CommonError>,
    /// True if earlier ticks tell nothing about this one: their views contradicted each other.
    pub restarts: bool,
    /// Boxes with lower scores in the same images, if any.
    pub others: Option<Box<OtherBoxes>>,
}

impl Observation {
    /// Observation at this scenario, tick and time in nanoseconds. `found`: whole boxes per view, sorted by score, empty if the image's
    /// edge cuts all boxes off; `registered`, `looks`: per view.
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
            restarts: false,
        }
    }

    /// Time since the scenario's first tick, s.
    pub(crate) fn time_s(&self) -> f64 {
        self.time_ns as f64 / 1e9
    }

    /// The tick with some boxes removed. Their shifts and the further boxes in their views go as well.
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
            boxes,
            ..self.clone()
        }
    }

    /// The tick without the images in some views.
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

    /// The tick without the images in views that contradict each other. `restarts`: one of them did not until now.
    pub(crate) fn withheld(self, views: &[usize], restarts: bool) -> Self {
        if views.is_empty() {
            return self;
        }
        Self {
            restarts,
            ..self.without_images(|view| views.contains(&view))
        }
    }

    /// The tick as seen by other cameras. `place` maps an image point in a view, pixels; boxes and shifts are dropped where it returns
    /// `None`.
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
            others: (self.others.as_ref()).map(|others| Box::new(others.moved(&place))),
            ..self.clone()
        };
        moved.with_boxes(self.boxes.iter().enumerate().map(pixel_box).collect())
    }

    /// The tick with less certain shifts: `sd_px` returns a view's additional standard deviation.
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

    /// The tick with additional common errors.
    pub(crate) fn with_common(mut self, errors: impl IntoIterator<Item = CommonError>) -> Self {
        let errors = errors.into_iter();
        self.common_errors
            .extend(errors.filter(|error| error.sd_px != DVec2::ZERO));
        self
    }

    /// Includes common errors in the deviations of the shifts. Training uses many flights, which do not share common errors.
    pub(crate) fn move_common_to_shifts(&mut self) {
        let common = std::mem::take(&mut self.common_errors);
        if !common.is_empty() {
            *self = self.clone().widened(|view| {
                let of_view = common.iter().filter(|error| error.view == view);
                in_quadrature(of_view.map(|error| error.sd_px))
            });
        }
    }

    /// Number of views that saw the aircraft.
    pub(crate) fn detections(&self) -> usize {
        self.boxes.iter().flatten().count()
    }
}

/// Standard deviation for the sum of independent errors.
fn in_quadrature(sds: impl IntoIterator<Item = DVec2>) -> DVec2 {
    let squares: DVec2 = sds.into_iter().map(|sd| sd * sd).sum();
    DVec2::new(squares.x.sqrt(), squares.y.sqrt())
}

/// A box moved with its centre; `None` if the centre cannot be mapped.
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

/// An observation with its ground truth. It dereferences to the observation: code that takes an [`Observation`] cannot see the truth.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Sample {
    pub observed: Observation,
    /// Distance to touchdown, metres.
    pub dtd_m: f64,
    /// Distance along the course, metres.
    pub along_track_m: f64,
    /// Offset right of the course, metres.
    pub cross_track_m: f64,
    /// Position of the centre of gravity.
    pub position: Geodetic,
    /// Share of contrast that remains over the distance to the nearest camera whose image contains the aircraft; `None` if there is no such
    /// camera.
    pub transmission: Option<f64>,
}

impl Deref for Sample {
    type Target = Observation;

    fn deref(&self) -> &Observation {
        &self.observed
    }
}

impl Sample {
    pub(crate) fn with(&self, observed: Observation) -> Self {
        Self { observed, ..*self }
    }
}

impl Observation {
    /// A tick without any box in this many views.
    pub(crate) fn unseen((scenario, tick, time_ns): (usize, u32, i64), views: usize) -> Self {
        let looks = vec![Look::Placed; views];
        let at = (scenario, tick, time_ns);
        Self::of(at, &vec![None; views], &vec![None; views], looks)
    }
}
