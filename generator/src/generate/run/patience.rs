//! Run timeouts and retries.

use std::time::Duration;

/// Factor of each delay after the first.
const PAUSE_FACTOR: u32 = 5;

/// Timeouts and retries.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Patience {
    /// Number of attempts before a scenario is set aside.
    pub attempts: u32,
    /// Between the first attempt and the second.
    pub first_pause: Duration,
    /// Simulator's answer timeout while images are taken: longer means frozen.
    pub answer: Duration,
    /// Timeout for a simulator that does not answer: it may be starting. A restart takes a part of it for each try.
    pub simulator: Duration,
}

impl Default for Patience {
    /// X-Plane loads scenery for half a minute, and takes minutes to start.
    fn default() -> Self {
        Self {
            attempts: 3,
            first_pause: Duration::from_secs(2),
            answer: Duration::from_secs(60),
            simulator: Duration::from_secs(1_600),
        }
    }
}

impl Patience {
    /// The delay after this many failed attempts.
    pub(crate) fn pause_after(&self, failed: u32) -> Duration {
        self.first_pause
            .saturating_mul(PAUSE_FACTOR.saturating_pow(failed.saturating_sub(1)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_grow() {
        let patience = Patience::default();
        let pauses = [1, 2, 3].map(|failed| patience.pause_after(failed).as_secs());
        assert_eq!(pauses, [2, 10, 50]);
    }
}
