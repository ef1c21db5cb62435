//! Live input: boxes at one tick.

use dataset::geometry::camera::Camera;
use dataset::tables::pixel_box::PixelBox;
use dataset::tables::registrations::Shift;

use crate::samples::trusted_boxes::other_boxes::{self, Registered};
use crate::samples::{CommonError, Look, Observation, Scored, whole_of};

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

/// An accepted box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// The box.
    pub pixel_box: PixelBox,
    /// Confidence of the model.
    pub score: f64,
    /// Track number in that view.
    pub track: Option<u32>,
}

impl SeenTick {
    /// The observation at this tick number and time in nanoseconds. `cameras` per view.
    pub(crate) fn observed(&self, (tick, time_ns): (u32, i64), cameras: &[Camera]) -> Observation {
        assert_eq!(self.views.len(), cameras.len(), "views of a tick");
        let found: Vec<_> = self.views.iter().zip(cameras).map(whole).collect();
        let registered: Vec<Option<Registered>> = (self.views.iter())
            .map(|view| view.registration.filter(|(from, _)| *from < cameras.len()))
            .collect();
        let looks = self.views.iter().map(|view| view.look).collect();
        let views = self.views.iter().enumerate();
        let errors = views.map(|(view, seen)| CommonError {
            view,
            sd_px: seen.common_sd_px.into(),
        });
        Observation::of((0, tick, time_ns), &found, &registered, looks).with_common(errors)
    }
}

fn whole((view, camera): (&SeenView, &Camera)) -> Option<Vec<other_boxes::Candidate>> {
    let scored = |seen: &Candidate| -> Scored {
        let candidate = other_boxes::Candidate {
            pixel_box: seen.pixel_box,
            track: seen.track,
        };
        (seen.score, candidate)
    };
    let found = view.boxes.iter().map(scored);
    (!view.boxes.is_empty()).then(|| whole_of(found, camera))
}
