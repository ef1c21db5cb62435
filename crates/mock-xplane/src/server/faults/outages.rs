//! Freezes and restarts of the simulator: counts the events that trigger outages, and notifies all tasks when one begins.
//!
//! Code that is about to answer a client awaits [`Outages::over`] first. A restart recreates all these tasks, so they simply never
//! return from there.

use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use tokio::sync::watch;
use tokio::time::{Instant, sleep};

use super::{Moment, Outage, OutageKind};

/// All outages of a process: past, present and future.
#[derive(Debug)]
pub(crate) struct Outages {
    counts: Mutex<Counts>,
    now: watch::Sender<Option<Outage>>,
}

#[derive(Debug)]
struct Counts {
    began: Instant,
    frames: u64,
    captures: u64,
    to_come: Vec<Outage>,
}

impl Outages {
    pub(crate) fn new(to_come: Vec<Outage>) -> Self {
        let counts = Counts {
            began: Instant::now(),
            frames: 0,
            captures: 0,
            to_come,
        };
        Self {
            counts: Mutex::new(counts),
            now: watch::Sender::new(None),
        }
    }

    /// A frame was simulated.
    pub(crate) fn count_frame(&self) {
        self.count(|counts| counts.frames += 1);
    }

    /// An image was requested.
    pub(crate) fn count_capture(&self) {
        self.count(|counts| counts.captures += 1);
    }

    /// Freezes the simulator for a while, unless an outage is in progress.
    pub(crate) fn freeze_for(&self, time: Duration) {
        let freeze = Outage {
            begins: Moment::After(Duration::ZERO),
            kind: OutageKind::Freeze,
            lasts: Some(time),
        };
        self.now.send_if_modified(|now| {
            let free = now.is_none();
            if free {
                *now = Some(freeze);
            }
            free
        });
    }

    /// Waits until the simulator answers, which is at once unless there is an outage.
    pub(crate) async fn over(&self) {
        // The sender is ours, so that there is always one.
        let _ = self.now.subscribe().wait_for(Option::is_none).await;
    }

    /// Waits for the next restart; handles freezes in the meantime.
    pub(crate) async fn next_restart(&self) -> Outage {
        let mut changes = self.now.subscribe();
        loop {
            let begun = changes.wait_for(Option::is_some).await.map(|now| *now);
            match begun {
                Ok(Some(outage)) if outage.kind == OutageKind::Restart => return outage,
                Ok(Some(freeze)) => self.pass(freeze).await,
                _ => std::future::pending().await,
            }
        }
    }

    /// Waits until an outage is over and notifies everybody.
    pub(crate) async fn pass(&self, outage: Outage) {
        match outage.lasts {
            Some(time) => sleep(time).await,
            None => std::future::pending().await,
        }
        tracing::warn!("the outage is over");
        self.now.send_replace(None);
    }

    fn count(&self, count: impl FnOnce(&mut Counts)) {
        let mut counts = self.counts.lock().unwrap_or_else(PoisonError::into_inner);
        count(&mut counts);
        // One at a time: an outage that falls due during an earlier one begins after it.
        if self.now.borrow().is_some() {
            return;
        }
        let due = counts
            .to_come
            .iter()
            .position(|outage| match outage.begins {
                Moment::After(time) => counts.began.elapsed() >= time,
                Moment::Frame(n) => counts.frames >= n,
                Moment::Capture(n) => counts.captures >= n,
            });
        if let Some(at) = due {
            let outage = counts.to_come.remove(at);
            tracing::warn!(?outage, "an outage begins, as ordered");
            self.now.send_replace(Some(outage));
        }
    }
}

#[cfg(test)]
mod tests {
    use tokio::time::timeout;

    use super::*;

    fn outages(faults: &str) -> Outages {
        Outages::new(faults.parse::<super::super::Faults>().unwrap().outages)
    }

    async fn answers(outages: &Outages) -> bool {
        timeout(Duration::from_millis(20), outages.over())
            .await
            .is_ok()
    }

    #[tokio::test(start_paused = true)]
    async fn a_freeze_begins_at_its_capture_and_passes() {
        let outages = outages("freeze=captures:2:5");
        outages.count_capture();
        assert!(answers(&outages).await);
        outages.count_capture();
        assert!(!answers(&outages).await);
        let nothing_restarts = timeout(Duration::from_secs(6), outages.next_restart()).await;
        assert!(nothing_restarts.is_err());
        assert!(answers(&outages).await);
        outages.count_capture();
        assert!(answers(&outages).await, "an outage happens once");
    }

    #[tokio::test(start_paused = true)]
    async fn what_is_due_during_an_outage_begins_after_it() {
        let outages = outages("freeze=frames:1:1,restart=frames:2:1");
        outages.count_frame();
        outages.count_frame();
        let frozen = timeout(Duration::from_secs(2), outages.next_restart()).await;
        assert!(frozen.is_err(), "two outages at once");
        outages.count_frame();
        let restart = outages.next_restart().await;
        assert_eq!(restart.kind, OutageKind::Restart);
        assert!(!answers(&outages).await);
    }
}
