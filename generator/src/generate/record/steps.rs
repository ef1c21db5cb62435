//! Step durations per scenario, for the log and for the installation's profile.

use std::time::{Duration, Instant};

#[derive(Debug)]
pub(crate) struct Steps {
    /// Connecting, and starting the flight or travelling to it.
    pub(crate) loading: Duration,
    /// Writing the weather, until it is there.
    pub(crate) weather: Duration,
    /// All images, the tables, and the seal.
    pub(crate) recording: Duration,
}

/// Measures one step after the other.
pub(crate) struct Stopwatch(Instant);

impl Stopwatch {
    pub(crate) fn start() -> Self {
        Self(Instant::now())
    }

    /// The time since the last step.
    pub(crate) fn lap(&mut self) -> Duration {
        let now = Instant::now();
        now - std::mem::replace(&mut self.0, now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_lap_begins_where_the_last_one_ended() {
        let began = Instant::now();
        let mut watch = Stopwatch::start();
        let laps = [watch.lap(), watch.lap(), watch.lap()];
        assert!(laps.iter().sum::<Duration>() <= began.elapsed());
    }
}
