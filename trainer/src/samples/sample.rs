//! Observations and ground truth at one tick before touchdown.

pub(crate) mod image_times;

use std::ops::Deref;

use dataset::geometry::geodesy::Geodetic;
use dataset::tables::health::HealthState;
use dataset::tables::pixel_box::PixelBox;
use glam::DVec2;

use crate::samples::trusted_boxes::centre_and_size;
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

/// A detected box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// The box.
    pub pixel_box: PixelBox,
    /// Confidence of the model.
    pub score: f64,
    /// Track number in that view.
    pub track: Option<u32>,
}

/// Observation at one tick: the only input for estimators.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Observation {
    /// Index into [`super::Samples::scenarios`].
    pub scenario: usize,
    pub tick: u32,
    /// Time since the scenario's first tick, nanoseconds.
    pub time_ns: i64,
    /// Whole boxes per view, in the order of [`super::Samples::views`], sorted by score: the first one is not always the aircraft.
    pub candidates: Vec<Vec<Candidate>>,
    /// Registered shifts per view, between any boxes ([`Self::shift`]).
    pub shifts: Vec<Option<ViewShift>>,
    /// Number of views with all boxes cut off by the image's edge; such boxes are excluded from `candidates`.
    pub cut_off: usize,
    /// Image usability per view. A usable image without a box shows no aircraft.
    pub looks: Vec<Look>,
    /// Independent errors that are common to the whole flight.
    pub common_errors: Vec<CommonError>,
    /// True if earlier ticks tell nothing about this one: their views contradicted each other.
    pub restarts: bool,
}

impl Observation {
    /// Observation at this scenario, tick and time in nanoseconds. `found`: whole boxes per view, sorted by score, empty if the image's
    /// edge cuts all boxes off; `shifts`, `looks`: per view.
    pub(crate) fn of(
        (scenario, tick, time_ns): (usize, u32, i64),
        found: Vec<Option<Vec<Candidate>>>,
        shifts: Vec<Option<ViewShift>>,
        looks: Vec<Look>,
    ) -> Self {
        let cut_off = found.iter().flatten().filter(|found| found.is_empty());
        Self {
            scenario,
            tick,
            time_ns,
            cut_off: cut_off.count(),
            candidates: found.into_iter().map(Option::unwrap_or_default).collect(),
            shifts,
            looks,
            common_errors: Vec::new(),
            restarts: false,
        }
    }

    /// A tick without any box in this many views.
    pub(crate) fn unseen(at: (usize, u32, i64), views: usize) -> Self {
        Self::of(
            at,
            vec![None; views],
            vec![None; views],
            vec![Look::Placed; views],
        )
    }

    /// Time since the scenario's first tick, s.
    pub(crate) fn time_s(&self) -> f64 {
        self.time_ns as f64 / 1e9
    }

    pub(crate) fn views(&self) -> usize {
        self.candidates.len()
    }

    /// The box with the highest score in a view.
    pub(crate) fn best(&self, view: usize) -> Option<&PixelBox> {
        Some(&self.candidates[view].first()?.pixel_box)
    }

    /// The views that have a box, with the best one.
    pub(crate) fn seen(&self) -> impl Iterator<Item = (usize, &PixelBox)> {
        (0..self.views()).filter_map(|view| Some((view, self.best(view)?)))
    }

    /// Track number of a view's best box.
    pub(crate) fn track(&self, view: usize) -> Option<u32> {
        self.candidates[view].first()?.track
    }

    /// Registered position in a view relative to another one, if the best boxes of both show what was registered.
    pub(crate) fn shift(&self, view: usize) -> Option<ViewShift> {
        let shift = self.shifts[view]?;
        let joins = shift.joins([self.best(shift.reference)?, self.best(view)?]);
        joins.then_some(shift)
    }

    /// The shift from the first of two views to the second, and what both show, pixels.
    pub(crate) fn registered_places(
        &self,
        [first, second]: [usize; 2],
    ) -> Option<(ViewShift, [DVec2; 2])> {
        let shift = self.shift(second).filter(|of| of.reference == first)?;
        let (here_px, _) = centre_and_size(self.best(first)?);
        Some((shift, [here_px, here_px + shift.shift_px]))
    }

    /// Standard deviation of rows between two views, with this one and common errors, pixels.
    pub(crate) fn row_sd_px(&self, views: [usize; 2], own_px: f64) -> f64 {
        let common = self.common_errors.iter();
        let common = common.filter(|error| views.contains(&error.view));
        common.fold(own_px, |sd_px, error| sd_px.hypot(error.sd_px.y))
    }

    /// The tick with only the boxes that fulfil a condition. The next box replaces a rejected best one.
    pub(crate) fn with_boxes_that(&self, is_kept: impl Fn(usize, &PixelBox) -> bool) -> Self {
        let mut kept = self.clone();
        for (view, candidates) in kept.candidates.iter_mut().enumerate() {
            candidates.retain(|candidate| is_kept(view, &candidate.pixel_box));
        }
        kept
    }

    /// The tick with at most one candidate per view, by its index.
    pub(crate) fn with_candidates(&self, kept: &[Option<usize>]) -> Self {
        let candidates = self.candidates.iter().zip(kept);
        let candidates = candidates.map(|(of_view, kept)| kept.map(|index| of_view[index]));
        Self {
            candidates: candidates.map(Vec::from_iter).collect(),
            ..self.clone()
        }
    }

    /// The tick without the images in some views.
    pub(crate) fn without_images(&self, is_lost: impl Fn(usize) -> bool) -> Self {
        let mut left = self.with_boxes_that(|view, _| !is_lost(view));
        for (view, look) in left.looks.iter_mut().enumerate() {
            if is_lost(view) {
                *look = Look::Blind;
            }
        }
        left
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
        let candidate = |view: usize, of: &Candidate| {
            let [cx_px, cy_px] = place(view, centre_and_size(&of.pixel_box).0)?.to_array();
            let pixel_box = PixelBox {
                cx_px,
                cy_px,
                ..of.pixel_box
            };
            Some(Candidate { pixel_box, ..*of })
        };
        let shift = |(view, shift): (usize, &Option<ViewShift>)| {
            let shift = shift.as_ref()?;
            let from_px = place(shift.reference, shift.from_px)?;
            Some(ViewShift {
                from_px,
                shift_px: place(view, shift.from_px + shift.shift_px)? - from_px,
                ..*shift
            })
        };
        let views = self.candidates.iter().enumerate();
        Self {
            candidates: views
                .map(|(view, all)| all.iter().filter_map(|of| candidate(view, of)).collect())
                .collect(),
            shifts: self.shifts.iter().enumerate().map(shift).collect(),
            ..self.clone()
        }
    }

    /// The tick with less certain shifts: `sd_px` returns a view's additional standard deviation.
    pub(crate) fn widened(mut self, sd_px: impl Fn(usize) -> DVec2) -> Self {
        for (view, shift) in self.shifts.iter_mut().enumerate() {
            if let Some(shift) = shift {
                let of_views = [view, shift.reference].map(&sd_px);
                shift.sd_px = in_quadrature(of_views.into_iter().chain([shift.sd_px]));
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
        self.seen().count()
    }
}

/// Standard deviation for the sum of independent errors.
fn in_quadrature(sds: impl IntoIterator<Item = DVec2>) -> DVec2 {
    let squares: DVec2 = sds.into_iter().map(|sd| sd * sd).sum();
    DVec2::new(squares.x.sqrt(), squares.y.sqrt())
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
