//! Clocks of cameras that nothing ties together: which offsets are known, and when they change.

use dataset::geometry::camera::Camera;
use dataset::geometry::rays::{Lag, Sighting, VerticalLag};

use crate::clock_offset::{ClockOffset, Offset};

/// An offset is used once its standard deviation is below this, seconds.
const MOST_SD_S: f64 = 0.03;
/// Above this, a known offset counts as unknown: the last arrival was long ago.
const LOST_SD_S: f64 = 0.06;
/// An arrival whose lag differs from the known offset by more standard deviations is the first one of a clock that was changed.
const MOST_DEVIATIONS: f64 = 5.0;
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

/// The clock of a view, compared with the first view's.
#[derive(Debug)]
pub(crate) struct FreeClock {
    cameras: [Camera; 2],
    drift_sd: f64,
    before: ClockOffset,
    arrival: VerticalLag,
    is_known: bool,
    is_told: bool,
    /// An arrival told something since the start.
    has_measured: bool,
    /// When this view and the first one last saw an aircraft.
    sighted_s: f64,
}

impl FreeClock {
    /// For the cameras of the first view and of this one, with the offset that an earlier start kept. `drift_sd`: see [`ClockOffset::of`].
    pub(crate) fn of(cameras: [Camera; 2], kept: Option<Offset>, drift_sd: f64) -> Self {
        Self {
            arrival: VerticalLag::between([&cameras[0], &cameras[1]]),
            cameras,
            drift_sd,
            before: ClockOffset::of(kept, drift_sd),
            is_known: false,
            is_told: false,
            has_measured: false,
            sighted_s: 0.0,
        }
    }

    /// True if its offset is known.
    pub(crate) fn is_known(&self) -> bool {
        self.is_known
    }

    /// True if its offset is not only what was kept.
    pub(crate) fn has_measured(&self) -> bool {
        self.has_measured
    }

    /// The images come by another connection from now on.
    pub(crate) fn restart(&mut self, time_s: f64) {
        self.before = ClockOffset::of(self.before.at(time_s), self.drift_sd).since(time_s);
    }

    /// Takes what both views see at a time.
    pub(crate) fn take(&mut self, time_s: f64, sighting: Option<Sighting>) -> Option<News> {
        let is_over = time_s > self.sighted_s + QUIET_S && self.end_arrival();
        if let Some(sighting) = sighting {
            self.sighted_s = time_s;
            self.arrival.take(sighting);
        }
        if self.is_known && self.is_vague(time_s) {
            (self.is_known, self.is_told) = (false, false);
        }
        if self.is_known && !is_over {
            return None;
        }
        let now = match self.arrival.lag() {
            Some(lag) if !self.is_known => {
                self.has_measured = true;
                self.joined(lag)
            }
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
            self.before = self.joined(lag);
            self.has_measured = true;
        }
        lag.is_some()
    }

    /// The offset with the lag of one more arrival.
    fn joined(&self, lag: Lag) -> ClockOffset {
        let is_other = self.before.at(lag.time_s).is_some_and(|known| {
            let sd_s = known.sd_s.hypot(lag.sd_s);
            (lag.seconds - known.offset_s).abs() > MOST_DEVIATIONS * sd_s
        });
        if is_other {
            ClockOffset::of(None, self.drift_sd).with(lag)
        } else {
            self.before.with(lag)
        }
    }

    /// True if the last arrival was too long ago, and the one that is under way does not tell enough.
    fn is_vague(&self, time_s: f64) -> bool {
        let is_vague = |clock: ClockOffset| {
            let now = clock.at(time_s);
            now.is_none_or(|now| now.sd_s > LOST_SD_S)
        };
        let of_arrival = || self.arrival.lag().map(|lag| self.joined(lag));
        is_vague(self.before) && of_arrival().is_none_or(is_vague)
    }
}

#[cfg(test)]
mod tests {
    use dataset::geometry::geodesy::Geodetic;
    use glam::DVec3;
    use testkit::changi_02l;
    use testkit::rig::{VIEWS, placed};

    use super::*;
    use crate::clock_offset::{RECORDING_DRIFT_SD, STREAM_DRIFT_SD};

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
        let mut clock = FreeClock::of(cameras(), None, RECORDING_DRIFT_SD);
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
        let mut clock = FreeClock::of(cameras(), Some(kept), STREAM_DRIFT_SD);
        let Some(News::Known(found)) = clock.take(0.0, None) else {
            panic!("it was kept")
        };
        assert!((found.offset_s - 0.5).abs() < 1e-9);
        assert!(!clock.has_measured());
    }

    #[test]
    fn an_offset_whose_drift_is_uncertain_is_unknown_after_hours_without_aircraft() {
        let mut clock = FreeClock::of(cameras(), None, RECORDING_DRIFT_SD);
        arrival(&mut clock, 0.0, 0.0);
        assert!(matches!(clock.take(300.0, None), Some(News::Known(_))));
        assert!(clock.take(310.0, None).is_none() && clock.has_measured());
        assert_eq!(clock.take(8.0 * 3_600.0, None), Some(News::Unknown));
        assert!(!clock.is_known());
        // The next arrival tells it again.
        let news = arrival(&mut clock, 30_000.0, 0.0);
        assert!(matches!(news[..], [News::Known(_)]), "{news:?}");
    }

    #[test]
    fn a_clock_that_was_changed_is_learned_anew_from_one_arrival() {
        let kept = Offset {
            offset_s: -0.5,
            sd_s: 0.006,
            drift_ppm: 0.0,
            drift_sd_ppm: 20.0,
        };
        let mut clock = FreeClock::of(cameras(), Some(kept), RECORDING_DRIFT_SD);
        arrival(&mut clock, 0.0, -0.5);
        let Some(News::Known(found)) = clock.take(300.0, None) else {
            panic!("it is over")
        };
        assert!((found.offset_s - SLOW_S).abs() < 0.05, "{found:?}");
    }
}
