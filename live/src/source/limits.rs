//! Ends of sources and of waits for them.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use crate::clock::RunClock;

/// Reason why a source cannot be opened.
#[derive(Debug)]
pub(crate) enum OpenFault {
    /// It may be there later.
    Absent(String),
    /// A camera answers, and not with the images of this view. Others may set it right.
    Wrong(String),
    /// It will never do.
    Useless(String),
    /// The disk fails, whatever the file is.
    Disk(dataset::Error),
}

pub(crate) struct Patience {
    pub(crate) clock: RunClock,
    until_ms: AtomicU64,
    stop: Arc<AtomicBool>,
}

impl Patience {
    pub(crate) fn new(clock: RunClock, stop: Arc<AtomicBool>) -> Arc<Self> {
        Arc::new(Self {
            clock,
            until_ms: AtomicU64::new(0),
            stop,
        })
    }

    pub(crate) fn wait(&self, most_ms: u64) {
        let now_ms = (self.clock.now_s() * 1e3) as u64;
        self.until_ms.store(now_ms + most_ms, Ordering::Relaxed);
    }

    /// Time until the wait is over.
    pub(crate) fn left(&self) -> Duration {
        let now_ms = (self.clock.now_s() * 1e3) as u64;
        Duration::from_millis(self.until_ms.load(Ordering::Relaxed).saturating_sub(now_ms))
    }

    pub(crate) fn is_over(&self) -> bool {
        self.is_stopped() || self.left().is_zero()
    }

    pub(crate) fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// Cause of the end of images.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum End {
    /// There are no more.
    Finished,
    /// The connection is gone.
    Lost(String),
    /// No image came within this time, ms.
    Silent(u64),
    /// The source is unusable.
    Useless(String),
    /// The caller stopped it.
    Stopped,
}
