//! Live input: boxes at one tick.

use dataset::geometry::camera::Camera;
use dataset::tables::registrations::Shift;

use crate::samples::view_shift::ViewShift;
use crate::samples::{Candidate, CommonError, Look, Observation, keep_whole};

/// Images with a common time.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SeenTick {
    /// Time, nanoseconds.
    pub time_ns: i64,
    /// True for images of recordings, whose clocks are unchecked: the rows show whether a view is late.
    pub is_recorded: bool,
    /// Images per view; the default without a usable image.
    pub views: Vec<SeenView>,
}

/// Image in one view.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SeenView {
    /// Usability.
    pub look: Look,
    /// Accepted boxes.
    pub boxes: Vec<Candidate>,
    /// Index of the reference view, and the shift from there.
    pub registration: Option<(usize, Shift)>,
    /// Displacement of the boxes by a standard deviation of the clock, right and down, pixels: common to the flight.
    pub common_sd_px: [f64; 2],
}

impl SeenTick {
    /// The observation at this tick number and time in nanoseconds. `cameras` per view.
    pub(crate) fn observed(&self, (tick, time_ns): (u32, i64), cameras: &[Camera]) -> Observation {
        assert_eq!(self.views.len(), cameras.len(), "views of a tick");
        let found = self.views.iter().zip(cameras).map(|(view, camera)| {
            let mut found = view.boxes.clone();
            keep_whole(&mut found, camera);
            (!view.boxes.is_empty()).then_some(found)
        });
        let shifts = self.views.iter().map(|view| {
            let (reference, shift) = view.registration.as_ref()?;
            (*reference < cameras.len()).then(|| ViewShift::of(*reference, shift))
        });
        let looks = self.views.iter().map(|view| view.look).collect();
        let views = self.views.iter().enumerate();
        let errors = views.map(|(view, seen)| CommonError {
            view,
            sd_px: seen.common_sd_px.into(),
        });
        Observation::of((0, tick, time_ns), found.collect(), shifts.collect(), looks)
            .with_common(errors)
    }
}
