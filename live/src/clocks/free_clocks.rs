//! A view's clock beside the first view's: which offset is in use, when it changes, and how uncertain it is.
//!
//! A free clock has no offset until an aircraft tells it. Clocks that their senders set have one from the start, zero, as uncertain as such
//! clocks are; aircraft refine it.

use dataset::geometry::camera::Camera;
use sight::lag::Sighting;

use crate::clocks::clock_offset::{ClockOffset, Lag, Offset};
use crate::clocks::vertical_lag::VerticalLag;
use crate::output::MAX_COASTING_S;

/// An offset is used, and changed, once its standard deviation is below this, seconds. One that is expected from the start is used at once.
pub(super) const MAX_SD_S: f64 = 0.03;
/// An arrival whose lag differs by more standard deviations from the known offset shows that the clock was changed.
const MAX_DEVIATIONS: f64 = 5.0;

/// Change of the offset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum News {
    /// The offset is unknown.
    Unknown,
    /// Offset from this time on.
    Known(Offset),
}

/// A view's clock, compared with the first view's.
#[derive(Debug)]
pub(crate) struct FreeClock {
    cameras: [Camera; 2],
    drift_sd: f64,
    /// An offset is in use until its standard deviation is above twice this, seconds.
    max_sd_s: f64,
    before: ClockOffset,
    arrival: VerticalLag,
    /// Includes the arrival under way, if it has a lag yet.
    with_arrival: Option<ClockOffset>,
    /// The offset that is in use, and its time.
    used: Option<(f64, Offset)>,
    is_told: bool,
    /// An arrival told something since the start.
    has_measured: bool,
    /// When this view and the first one last saw an aircraft.
    sighted_s: f64,
}

impl FreeClock {
    /// For the cameras of the first view and of this one, with the offset that is expected, or that an earlier start kept. `drift_sd`: see
    /// [`ClockOffset::of`].
    pub(crate) fn of(cameras: [Camera; 2], expected: Option<Offset>, drift_sd: f64) -> Self {
        let before = ClockOffset::of(expected, drift_sd);
        let at_start = before.at(0.0);
        Self {
            arrival: VerticalLag::between(cameras),
            cameras,
            drift_sd,
            max_sd_s: at_start.map_or(MAX_SD_S, |expected| MAX_SD_S.max(expected.sd_s)),
            before,
            with_arrival: None,
            used: at_start.map(|expected| (0.0, expected)),
            is_told: false,
            has_measured: false,
            sighted_s: 0.0,
        }
    }

    pub(crate) fn is_known(&self) -> bool {
        self.used.is_some()
    }

    /// True if an arrival has been measured since the start.
    pub(crate) fn has_measured(&self) -> bool {
        self.has_measured
    }

    /// Standard deviation of the offset in use at a time, seconds; `None` while it is unknown.
    pub(crate) fn error_s(&self, time_s: f64) -> Option<f64> {
        let used = self.used_at(time_s)?;
        let now = self.best(time_s)?;
        Some(now.sd_s.hypot(now.offset_s - used.offset_s))
    }

    fn used_at(&self, time_s: f64) -> Option<Offset> {
        let (since_s, used) = self.used?;
        Some(Offset {
            offset_s: used.offset_s + used.drift_ppm * 1e-6 * (time_s - since_s),
            ..used
        })
    }

    /// The best offset at a time, with the arrival under way.
    pub(crate) fn best(&self, time_s: f64) -> Option<Offset> {
        (self.with_arrival.as_ref().unwrap_or(&self.before)).at(time_s)
    }

    /// It is the view's clock again, after a different one was.
    pub(crate) fn resume(&mut self) {
        self.end_arrival();
        self.is_told = false;
    }

    /// Forgets the arrival up to now, as after a turn of a camera: it does not fit the rest.
    pub(crate) fn forget_arrival(&mut self) {
        self.arrival = VerticalLag::between(self.cameras);
        self.with_arrival = None;
    }

    /// The images take a different way from now on.
    pub(crate) fn restart(&mut self, time_s: f64) {
        self.end_arrival();
        self.before = ClockOffset::of(self.before.at(time_s), self.drift_sd).since(time_s);
    }

    /// Takes what both views see at a time.
    pub(crate) fn take(&mut self, time_s: f64, sighting: Option<Sighting>) -> Option<News> {
        let is_over = time_s > self.sighted_s + MAX_COASTING_S && self.end_arrival();
        let mut is_measured = false;
        if let Some(sighting) = sighting {
            self.sighted_s = time_s;
            is_measured = self.arrival.take(sighting);
            if is_measured {
                self.with_arrival = self.arrival.lag().map(|lag| self.joined(lag));
            }
        }
        if self.is_known() && self.is_vague(time_s) {
            (self.used, self.is_told) = (None, false);
        }
        let now = self.best(time_s);
        let sure = now.filter(|found| found.sd_s <= MAX_SD_S);
        let news = match self.used_at(time_s) {
            None => sure,
            Some(_) if is_over => now,
            // More than by chance: each change disturbs the answers a little.
            Some(used) => sure
                .filter(|found| is_measured && (found.offset_s - used.offset_s).abs() > found.sd_s),
        };
        let is_told = std::mem::replace(&mut self.is_told, true);
        if let Some(found) = news {
            self.used = Some((time_s, found));
            self.has_measured |= self.with_arrival.is_some();
            return Some(News::Known(found));
        }
        let untold = || self.used_at(time_s).map_or(News::Unknown, News::Known);
        (!is_told).then(untold)
    }

    /// The offset with the arrival that was under way at the end, if it tells anything.
    pub(crate) fn at_end(&mut self) -> Option<Offset> {
        let is_new = self.end_arrival() && self.is_known();
        is_new.then(|| self.before.at(self.sighted_s)).flatten()
    }

    /// Begins a new arrival; true if the last one had a lag.
    fn end_arrival(&mut self) -> bool {
        let lag = self.arrival.lag();
        self.forget_arrival();
        if let Some(lag) = lag {
            self.before = self.joined(lag);
            self.has_measured = true;
        }
        lag.is_some()
    }

    /// The offset after this lag.
    fn joined(&self, lag: Lag) -> ClockOffset {
        let alone = ClockOffset::of(None, self.drift_sd).with(lag);
        let is_other = || {
            let (found, known) = (alone.at(lag.at_s)?, self.before.at(lag.at_s)?);
            let sd_s = known.sd_s.hypot(found.sd_s);
            Some((found.offset_s - known.offset_s).abs() > MAX_DEVIATIONS * sd_s)
        };
        if is_other().unwrap_or(false) {
            alone
        } else {
            self.before.clone().with(lag)
        }
    }

    /// True if the last arrival was too long ago, and the one that is under way does not tell enough.
    fn is_vague(&self, time_s: f64) -> bool {
        let is_vague = |clock: &ClockOffset| {
            let now = clock.at(time_s);
            now.is_none_or(|now| now.sd_s > 2.0 * self.max_sd_s)
        };
        is_vague(&self.before) && self.with_arrival.as_ref().is_none_or(is_vague)
    }
}

#[cfg(test)]
mod tests;
