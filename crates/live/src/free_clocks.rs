//! Clocks of cameras that nothing ties together: which offsets are known, and when they change.

use dataset::geometry::camera::Camera;
use dataset::geometry::rays::{Sighting, VerticalLag};

use crate::clock_offset::{ClockOffset, Offset};

/// An offset is used once its standard deviation is below this, seconds.
const MOST_SD_S: f64 = 0.03;
/// An arrival is over when no aircraft was seen for so long, seconds. Then a known offset is changed.
const QUIET_S: f64 = 5.0;

/// News about the clock of a view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum News {
    /// Its offset is unknown.
    Unknown,
    /// Its offset at this time from now on, instead of the one before.
    Known(Offset),
}

/// The clock of a view, compared with that of the first one.
#[derive(Debug)]
pub(crate) struct FreeClock {
    cameras: [Camera; 2],
    before: ClockOffset,
    arrival: VerticalLag,
    is_known: bool,
    is_told: bool,
    /// When this view and the first one last saw an aircraft.
    sighted_s: f64,
}

impl FreeClock {
    /// For the first view's camera and that of the view, with what was kept of an earlier start.
    pub(crate) fn of(cameras: [Camera; 2], kept: Option<Offset>) -> Self {
        Self {
            arrival: VerticalLag::between([&cameras[0], &cameras[1]]),
            cameras,
            before: ClockOffset::of(kept),
            is_known: false,
            is_told: false,
            sighted_s: 0.0,
        }
    }

    /// True if its offset is known.
    pub(crate) fn is_known(&self) -> bool {
        self.is_known
    }

    /// Takes what both views see at a time.
    pub(crate) fn take(&mut self, time_s: f64, sighting: Option<Sighting>) -> Option<News> {
        let is_over = time_s > self.sighted_s + QUIET_S && self.end_arrival();
        if let Some(sighting) = sighting {
            self.sighted_s = time_s;
            self.arrival.take(sighting);
        }
        if self.is_known && !is_over {
            return None;
        }
        let now = match self.arrival.lag() {
            Some(lag) if !self.is_known => self.before.with(lag),
            _ => self.before,
        };
        match now
            .at(time_s)
            .filter(|found| found.sd_s <= MOST_SD_S || self.is_known)
        {
            Some(found) => {
                self.is_known = true;
                Some(News::Known(found))
            }
            None if std::mem::replace(&mut self.is_told, true) => None,
            None => Some(News::Unknown),
        }
    }

    /// The offset with the arrival that was under way at the end, if it tells anything.
    pub(crate) fn at_end(&mut self) -> Option<Offset> {
        let is_new = self.end_arrival() && self.is_known;
        is_new.then(|| self.before.at(self.sighted_s)).flatten()
    }

    /// Begins another arrival; true if the one before told something.
    fn end_arrival(&mut self) -> bool {
        let lag = self.arrival.lag();
        if !self.arrival.is_empty() {
            self.arrival = VerticalLag::between([&self.cameras[0], &self.cameras[1]]);
        }
        if let Some(lag) = lag {
            self.before = self.before.with(lag);
        }
        lag.is_some()
    }
}

#[cfg(test)]
mod tests {
    use dataset::geometry::geodesy::Geodetic;
    use glam::DVec3;
    use testkit::changi_02l;
    use testkit::rig::{VIEWS, placed};

    use super::*;

    /// Seconds of an arrival, and by how much the clock of the second view is slow.
    const ARRIVAL_S: u32 = 280;
    const SLOW_S: f64 = 0.5;

    /// The aircraft a time after it is 24 km from the target: level, then on the glide path.
    fn place_m(time_s: f64) -> DVec3 {
        let runway = changi_02l();
        let along_m = 24_000.0 - 75.0 * time_s;
        let height_m = 900_f64.min(along_m * 3_f64.to_radians().tan());
        let altitude_m = runway.threshold.altitude_msl_m + height_m;
        let at: Geodetic = runway
            .point_on_approach(along_m, 0.0)
            .at_altitude_m(altitude_m);
        at.to_ecef()
    }

    fn cameras() -> [Camera; 2] {
        VIEWS.map(|view| Camera::from_pose(&placed(view), 1920, 1280))
    }

    fn arrival(clock: &mut FreeClock, from_s: f64, added_s: f64) -> Vec<News> {
        let [left, right] = cameras();
        let mut news = Vec::new();
        for second in 0..ARRIVAL_S {
            let flown_s = f64::from(second);
            let there = right.project(place_m(flown_s + SLOW_S - added_s));
            let sighting = Sighting {
                time_s: from_s + flown_s,
                places_px: [left.project(place_m(flown_s)).unwrap(), there.unwrap()],
                width_px: 20.0,
                added_s,
            };
            news.extend(clock.take(sighting.time_s, Some(sighting)));
        }
        news
    }

    #[test]
    fn an_unknown_offset_is_told_once_found_after_enough_sightings_and_refined_after_the_arrival() {
        let mut clock = FreeClock::of(cameras(), None);
        let news = arrival(&mut clock, 0.0, 0.0);
        let [News::Unknown, News::Known(first)] = news[..] else {
            panic!("{news:?}")
        };
        assert!((first.offset_s - SLOW_S).abs() < 0.03, "{first:?}");
        assert!(clock.is_known() && clock.take(281.0, None).is_none());
        let Some(News::Known(refined)) = clock.take(290.0, None) else {
            panic!("it is over")
        };
        assert!(refined.sd_s < first.sd_s, "{first:?}, {refined:?}");
        assert!((refined.offset_s - SLOW_S).abs() < 0.02, "{refined:?}");
        assert!(clock.take(291.0, None).is_none());
        assert!(arrival(&mut clock, 600.0, 0.5).is_empty());
        assert!(clock.at_end().unwrap().sd_s < refined.sd_s);
        assert_eq!(clock.at_end(), None);
    }

    #[test]
    fn a_kept_offset_is_known_at_once() {
        let kept = Offset {
            offset_s: 0.5,
            sd_s: 0.006,
            drift_ppm: 0.0,
            drift_sd_ppm: 20.0,
        };
        let mut clock = FreeClock::of(cameras(), Some(kept));
        let Some(News::Known(found)) = clock.take(0.0, None) else {
            panic!("it was kept")
        };
        assert!((found.offset_s - 0.5).abs() < 1e-9);
    }
}
