//! The boxes that cameras without an end saw at a tick.

use dataset::geometry::camera::Camera;
use dataset::tables::pixel_box::PixelBox;
use dataset::tables::registrations::Shift;

use crate::samples::camera_health::look::Look;
use crate::samples::trusted_boxes::other_boxes::{self, Registered};
use crate::samples::{Observation, Scored, whole_of};

/// The images of one time.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SeenTick {
    /// Their time, nanoseconds.
    pub time_ns: i64,
    /// By view; the default where there is no image, or none that may be measured.
    pub views: Vec<SeenView>,
}

/// An image of a view.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SeenView {
    /// Its image.
    pub look: Look,
    /// Its boxes that count at this moment.
    pub boxes: Vec<Candidate>,
    /// The index of the view that it is registered with, and the shift from there.
    pub registration: Option<(usize, Shift)>,
}

/// A box that counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// The box.
    pub pixel_box: PixelBox,
    /// Confidence of the model.
    pub score: f64,
    /// Number of its track in that view.
    pub track: Option<u32>,
}

impl SeenTick {
    /// The observation of a tick with this number, at a time in nanoseconds. `cameras` by view.
    pub(crate) fn observed(&self, (tick, time_ns): (u32, i64), cameras: &[Camera]) -> Observation {
        assert_eq!(self.views.len(), cameras.len(), "views of a tick");
        let found: Vec<_> = self.views.iter().zip(cameras).map(whole).collect();
        let registered: Vec<Option<Registered>> = (self.views.iter())
            .map(|view| view.registration.filter(|(from, _)| *from < cameras.len()))
            .collect();
        let looks = self.views.iter().map(|view| view.look).collect();
        Observation::of((0, tick, time_ns), &found, &registered, looks)
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
