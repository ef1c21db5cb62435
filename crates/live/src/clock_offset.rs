//! The offset of two cameras' clocks, from where both see the same aircraft ([`labeller::view_lag`]).

use dataset::geometry::camera::Camera;
use glam::DVec2;
use labeller::view_lag::{CommonSighting, TimeOffset, TimeOffsetFit};

/// Seconds between measurements: errors of neighbouring images are alike.
const STEP_S: f64 = 0.5;
/// No offset has a smaller standard deviation, seconds.
const LEAST_SD_S: f64 = 0.003;

/// Measurements of the offset of a view from the first one.
#[derive(Debug, Clone, Default)]
pub(crate) struct ClockOffset {
    last_s: Option<f64>,
    added_s: f64,
    /// As if nothing had been added to the times.
    fit: TimeOffsetFit,
}

impl ClockOffset {
    /// Takes where both cameras, of the first view and of this one, see the aircraft in images of the same time, and by how much it moves
    /// in this view in a second.
    pub(crate) fn take(
        &mut self,
        time_s: f64,
        cameras: [&Camera; 2],
        places_px: [DVec2; 2],
        motion_px_s: DVec2,
    ) {
        if self.last_s.is_some_and(|last_s| time_s < last_s + STEP_S) {
            return;
        }
        if let Some(sighting) = CommonSighting::of(cameras, places_px, motion_px_s) {
            self.last_s = Some(time_s);
            self.fit.add(&sighting.before(self.added_s));
        }
    }

    /// The offset that remains, once it is known at all.
    pub(crate) fn remaining(&self) -> Option<TimeOffset> {
        let found = self.fit.offset()?;
        Some(TimeOffset {
            seconds: found.seconds - self.added_s,
            sd_s: found.sd_s.hypot(LEAST_SD_S),
        })
    }

    /// These seconds are added to the times of the view from now on.
    pub(crate) fn applied(&mut self, seconds: f64) {
        self.added_s += seconds;
    }
}
