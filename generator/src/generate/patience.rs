//! How long a run puts up with what goes wrong.

use std::time::Duration;

/// Time limits and retries.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Patience {
    /// How often a scenario is tried before it is set aside.
    pub attempts: u32,
    /// Between the first attempt and the second.
    pub first_pause: Duration,
    /// So many times longer is each further pause.
    pub pause_factor: u32,
    /// How long one answer of the simulator may take while pictures are taken: longer means frozen.
    pub answer: Duration,
    /// How long a simulator that does not answer is waited for: somebody, or something, may be starting it again.
    pub simulator: Duration,
    /// How long an object store that does not answer is waited for.
    pub store: Duration,
}

impl Default for Patience {
    /// X-Plane loads scenery for half a minute, and takes minutes to start.
    fn default() -> Self {
        Self {
            attempts: 3,
            first_pause: Duration::from_secs(2),
            pause_factor: 5,
            answer: Duration::from_secs(60),
            simulator: Duration::from_secs(300),
            store: Duration::from_secs(300),
        }
    }
}

impl Patience {
    /// How long to wait after so many failed attempts.
    pub(super) fn pause_after(&self, failed: u32) -> Duration {
        self.first_pause
            .saturating_mul(self.pause_factor.saturating_pow(failed.saturating_sub(1)))
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
