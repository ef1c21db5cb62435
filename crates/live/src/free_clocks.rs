//! Clocks of cameras that nothing ties together: which offsets are known, and when they change.

use dataset::geometry::camera::Camera;
use glam::DVec2;
use labeller::view_lag::TimeOffset;

use crate::clock_offset::ClockOffset;

/// An offset is used once its standard deviation is below this, seconds.
const MOST_SD_S: f64 = 0.03;
/// It is changed when no aircraft was seen for so long, seconds, and if it is off by so many standard deviations.
const QUIET_S: f64 = 5.0;
const LEAST_DEVIATIONS: f64 = 2.0;

/// An aircraft that two views see at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Sighting {
    /// Its pixels in the first view and in this one.
    pub(crate) places_px: [DVec2; 2],
    /// Motion in this view.
    pub(crate) motion_px_s: DVec2,
}

/// News about the clock of a view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum News {
    /// Its offset is unknown.
    Unknown,
    /// These seconds are added to its times from now on, besides those that were added before.
    Add(TimeOffset),
}

/// The clocks of all views but the first.
#[derive(Debug)]
pub(crate) struct FreeClocks {
    views: Vec<FreeClock>,
}

#[derive(Debug, Clone, Default)]
struct FreeClock {
    offset: ClockOffset,
    is_known: bool,
    is_told: bool,
    /// When this view and the first one last saw an aircraft.
    sighted_s: f64,
}

impl FreeClocks {
    pub(crate) fn of(views: usize) -> Self {
        Self {
            views: vec![FreeClock::default(); views],
        }
    }

    /// True if the offset of a view is known.
    pub(crate) fn is_known(&self, view: usize) -> bool {
        self.views[view].is_known
    }

    /// Takes what two views with free clocks see at a time.
    pub(crate) fn take(
        &mut self,
        view: usize,
        time_s: f64,
        cameras: [&Camera; 2],
        sighting: Option<Sighting>,
    ) -> Option<News> {
        let clock = &mut self.views[view];
        let is_quiet = time_s > clock.sighted_s + QUIET_S;
        if let Some(seen) = sighting {
            clock.sighted_s = time_s;
            let (places_px, motion_px_s) = (seen.places_px, seen.motion_px_s);
            clock.offset.take(time_s, cameras, places_px, motion_px_s);
        }
        let found = clock.offset.remaining().filter(|found| {
            let is_other = found.seconds.abs() > LEAST_DEVIATIONS * found.sd_s;
            found.sd_s <= MOST_SD_S && (!clock.is_known || is_quiet && is_other)
        });
        match found {
            Some(found) => {
                clock.offset.applied(found.seconds);
                clock.is_known = true;
                Some(News::Add(found))
            }
            None if clock.is_known || std::mem::replace(&mut clock.is_told, true) => None,
            None => Some(News::Unknown),
        }
    }
}

#[cfg(test)]
mod tests {
    use testkit::rig::{VIEWS, placed};

    use super::*;

    #[test]
    fn an_unknown_offset_is_told_once_and_found_after_enough_sightings() {
        let [left, right] = VIEWS.map(|view| Camera::from_pose(&placed(view), 1920, 1280));
        let mut clocks = FreeClocks::of(2);
        let mut news = Vec::new();
        for half_second in 0..200 {
            let time_s = f64::from(half_second) / 2.0;
            // Half a second late: off by half of its motion, which grows.
            let motion = DVec2::new(0.0, time_s / 20.0);
            let sighting = Sighting {
                places_px: [
                    DVec2::new(900.0, 600.0),
                    DVec2::new(900.0, 500.0) + 0.5 * motion,
                ],
                motion_px_s: motion,
            };
            let found = clocks.take(1, time_s, [&left, &right], Some(sighting));
            news.extend(found.map(|found| (half_second, found)));
        }
        assert_eq!(news[0], (0, News::Unknown));
        let [_, (_, News::Add(offset))] = news[..] else {
            panic!("{news:?}")
        };
        assert!((offset.seconds - 0.5).abs() < 0.02, "{offset:?}");
        assert!(clocks.is_known(1));
    }
}
