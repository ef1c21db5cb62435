//! Time limit for opening a source.
//!
//! A server that has stopped accepts a connection and never answers, and one that is just ending an earlier connection may answer and send
//! nothing. A long attempt then outlasts the fault. So a source that has been opened before gets twice the longest time that this took,
//! and the limit is doubled after each attempt that reached it. Opening waits for an image, so a slow camera takes longer.

/// First limit, and maximum limit for sources that have opened in half that time, ms.
const MAX_MS: u64 = 4_000;
/// Maximum limit for other sources, ms.
const SLOW_MS: u64 = 32_000;
/// Minimum limit, ms: a busy machine is no fault.
const MIN_MS: u64 = 1_000;

/// Limit of the attempts to open a source.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct OpenLimit {
    next_ms: u64,
    /// The longest time that a successful attempt took, milliseconds.
    longest_ms: u64,
}

impl Default for OpenLimit {
    fn default() -> Self {
        Self {
            next_ms: MAX_MS,
            longest_ms: 0,
        }
    }
}

impl OpenLimit {
    pub(crate) fn next_ms(self) -> u64 {
        self.next_ms
    }

    /// Learns from an attempt that took `took_s`.
    pub(crate) fn take(&mut self, has_opened: bool, took_s: f64) {
        let took_ms = (1e3 * took_s) as u64;
        if has_opened {
            // An opening that waits for a key frame takes more or less long by chance.
            self.longest_ms = self.longest_ms.max(took_ms);
            self.next_ms = (2 * self.longest_ms).clamp(MIN_MS, SLOW_MS);
        } else if took_ms >= self.next_ms {
            let most_ms = match self.longest_ms {
                0 => SLOW_MS,
                longest_ms => (2 * longest_ms).clamp(MAX_MS, SLOW_MS),
            };
            self.next_ms = (2 * self.next_ms).min(most_ms);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_source_that_opened_fast_is_given_up_soon_and_then_later_and_later() {
        let mut limit = OpenLimit::default();
        let mut found = vec![limit.next_ms()];
        for (has_opened, took_s) in [
            (false, 4.0),
            (true, 0.7),
            (false, 0.1),
            (false, 1.4),
            (false, 2.8),
            (true, 0.2),
            (true, 3.0),
        ] {
            limit.take(has_opened, took_s);
            found.push(limit.next_ms());
        }
        assert_eq!(
            found,
            [4_000, 8_000, 1_400, 1_400, 2_800, 4_000, 1_400, 6_000]
        );
    }

    #[test]
    fn a_slow_camera_is_given_the_time_until_its_next_image() {
        let mut limit = OpenLimit::default();
        while limit.next_ms() < 10_000 {
            limit.take(false, 1e-3 * limit.next_ms() as f64);
        }
        limit.take(true, 9.0);
        assert_eq!(limit.next_ms(), 18_000);
    }
}
