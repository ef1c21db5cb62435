//! Time limit for the next image of an open source.
//!
//! A server that has stopped keeps its connection, so one without images is given up. A slow camera is given three of its intervals, as its
//! images came or, before that, as it announces them. A camera whose images never came gets twice the time after each connection that was
//! given up before it showed two.

/// At first, and at most, milliseconds.
const MIN_MS: u64 = 2_000;
const MAX_MS: u64 = 32_000;
/// Intervals in which an image must come.
const INTERVALS: f64 = 3.0;
/// Part by which a new interval changes the usual one.
const LEARNED_PART: f64 = 0.05;

/// Limit of the waits for images.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ReadLimit {
    /// Usual time between images, seconds.
    interval_s: Option<f64>,
    /// The same, as the source announces it.
    announced_s: f64,
    /// The last one.
    last_s: f64,
    unknown_ms: u64,
}

impl Default for ReadLimit {
    fn default() -> Self {
        Self {
            interval_s: None,
            announced_s: 0.0,
            last_s: 0.0,
            unknown_ms: MIN_MS,
        }
    }
}

impl ReadLimit {
    /// Of the next wait, milliseconds.
    pub(crate) fn next_ms(&self) -> u64 {
        let interval_s = self.interval_s.unwrap_or(self.announced_s).max(self.last_s);
        let known_ms = (1e3 * INTERVALS * interval_s) as u64;
        known_ms.max(self.unknown_ms).min(MAX_MS)
    }

    /// The source announces this time between images, seconds.
    pub(crate) fn announced(&mut self, interval_s: f64) {
        self.announced_s = interval_s;
    }

    /// An image came so long after the one before, seconds.
    pub(crate) fn came(&mut self, after_s: f64) {
        (self.unknown_ms, self.last_s) = (MIN_MS, after_s);
        let usual_s = self.interval_s.get_or_insert(after_s);
        *usual_s += LEARNED_PART * (after_s - *usual_s);
    }

    /// A connection has ended that was given up at the limit, after so many images.
    pub(crate) fn given_up(&mut self, images: u32) {
        if images < 2 && self.interval_s.is_none() {
            self.unknown_ms = (2 * self.unknown_ms).min(MAX_MS);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_with_an_image_every_ten_seconds_is_waited_for() {
        let mut limit = ReadLimit::default();
        let mut connections = 0;
        while limit.next_ms() <= 10_000 {
            limit.given_up(1);
            connections += 1;
        }
        assert_eq!(connections, 3);
        limit.came(10.0);
        assert_eq!(limit.next_ms(), 30_000);
        let mut announced = ReadLimit::default();
        announced.announced(5.0);
        assert_eq!(announced.next_ms(), 15_000);
    }

    #[test]
    fn a_fast_camera_is_given_up_soon_however_often_it_stops() {
        let mut limit = ReadLimit::default();
        for _ in 0..10 {
            (0..100).for_each(|_| limit.came(0.04));
            assert_eq!(limit.next_ms(), MIN_MS);
            limit.given_up(100);
        }
        (0..10).for_each(|_| limit.given_up(0));
        assert_eq!(limit.next_ms(), MIN_MS);
    }

    #[test]
    fn a_camera_that_is_slower_than_it_announces_is_waited_for() {
        let mut limit = ReadLimit::default();
        limit.announced(0.04);
        (0..3).for_each(|_| limit.given_up(1));
        limit.came(10.0);
        assert_eq!(limit.next_ms(), 30_000);
        // A camera that slows down at night.
        let mut limit = ReadLimit::default();
        (0..100).for_each(|_| limit.came(0.04));
        limit.came(1.9);
        assert_eq!(limit.next_ms(), 5_700);
    }
}
