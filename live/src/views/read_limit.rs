//! Time limit for the next image.
//!
//! A stopped server keeps its connection, so a connection without images is given up. A slow camera gets three of its intervals. If a
//! camera has never shown two images, its limit doubles with every connection that was given up.

use crate::clock::UsualInterval;

/// First and maximum limit, ms.
const MIN_MS: u64 = 2_000;
const MAX_MS: u64 = 32_000;
/// Limit in usual intervals.
const INTERVALS: f64 = 3.0;

/// Limit of the waits for images.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ReadLimit {
    interval_s: UsualInterval,
    last_s: f64,
    unknown_ms: u64,
}

impl Default for ReadLimit {
    fn default() -> Self {
        Self {
            interval_s: UsualInterval::default(),
            last_s: 0.0,
            unknown_ms: MIN_MS,
        }
    }
}

impl ReadLimit {
    pub(crate) fn next_ms(&self) -> u64 {
        let interval_s = self.interval_s.get().unwrap_or(0.0).max(self.last_s);
        let known_ms = (1e3 * INTERVALS * interval_s) as u64;
        known_ms.max(self.unknown_ms).min(MAX_MS)
    }

    /// Learns from an image that came `after_s` after the previous one.
    pub(crate) fn came(&mut self, after_s: f64) {
        (self.unknown_ms, self.last_s) = (MIN_MS, after_s);
        self.interval_s.learn(after_s, f64::INFINITY);
    }

    /// A connection was given up after this number of images.
    pub(crate) fn given_up(&mut self, images: u32) {
        if images < 2 && self.interval_s.get().is_none() {
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
    fn a_camera_that_slows_down_at_night_is_waited_for() {
        let mut limit = ReadLimit::default();
        (0..100).for_each(|_| limit.came(0.04));
        limit.came(1.9);
        assert_eq!(limit.next_ms(), 5_700);
    }
}
