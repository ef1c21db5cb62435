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
mod tests;
