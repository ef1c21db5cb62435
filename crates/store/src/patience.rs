//! Retries for a store that does not answer, and progress and cancellation of transfers.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use dataset::work::watch::Watch;
use tokio::time::sleep;

use crate::error::Result;

const FIRST_PAUSE: Duration = Duration::from_millis(500);
const MAX_PAUSE: Duration = Duration::from_secs(30);
/// Cancellation is noticed within this time while waiting.
const LOOK_UP: Duration = Duration::from_millis(100);

/// Timeout for a store that does not answer, counted from the last byte transferred.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Patience(pub Duration);

/// A transfer with its repeated attempts: progress, and cancellation by its watch.
pub struct Transfer<'a> {
    pub(crate) watch: &'a dyn Watch,
    /// Bytes of all attempts.
    bytes: AtomicU64,
    /// Files that are complete, of all attempts.
    kept: AtomicU64,
    /// Bytes of this attempt since the last complete file. A next attempt transfers them again.
    unkept_bytes: AtomicU64,
}

impl<'a> Transfer<'a> {
    /// A transfer that has not begun. The watch is warned when the store does not answer, once per interruption.
    pub const fn new(watch: &'a dyn Watch) -> Self {
        Self {
            watch,
            bytes: AtomicU64::new(0),
            kept: AtomicU64::new(0),
            unkept_bytes: AtomicU64::new(0),
        }
    }

    /// Bytes transferred so far, including failed attempts.
    pub fn bytes(&self) -> u64 {
        self.bytes.load(Ordering::Relaxed)
    }

    /// This many more bytes were transferred.
    pub(crate) fn passed(&self, bytes: u64) {
        self.bytes.fetch_add(bytes, Ordering::Relaxed);
        self.unkept_bytes.fetch_add(bytes, Ordering::Relaxed);
    }

    /// A file was transferred completely: no later attempt transfers it again.
    pub(crate) fn kept(&self) {
        self.kept.fetch_add(1, Ordering::Relaxed);
        self.unkept_bytes.store(0, Ordering::Relaxed);
    }

    /// [`Watch::check`] of the watch.
    ///
    /// # Errors
    /// The transfer should stop.
    pub fn check(&self) -> Result<()> {
        Ok(self.watch.check()?)
    }
}

impl Patience {
    /// Repeats `attempt` with growing delays while the store does not answer. An attempt resumes where the last one stopped: the
    /// waiting time restarts if it completes a file, or gets further into one than any attempt before. Bytes that are transferred
    /// again are no progress: a store that always breaks off at the same place would be retried forever.
    pub async fn with<T>(
        self,
        transfer: &Transfer<'_>,
        mut attempt: impl AsyncFnMut() -> Result<T>,
    ) -> Result<T> {
        let kept_so_far = || transfer.kept.load(Ordering::Relaxed);
        let (mut kept, mut furthest_bytes) = (kept_so_far(), 0);
        let mut waiting_since: Option<Instant> = None;
        let mut pause = FIRST_PAUSE;
        loop {
            let began = Instant::now();
            transfer.unkept_bytes.store(0, Ordering::Relaxed);
            let error = match attempt().await {
                Err(error) if error.is_passing() => error,
                other => return other,
            };
            let now_kept = kept_so_far();
            let now_bytes = transfer.unkept_bytes.load(Ordering::Relaxed);
            let got_further = now_kept > kept || now_bytes > furthest_bytes;
            if now_kept > kept {
                furthest_bytes = 0;
            }
            (kept, furthest_bytes) = (now_kept, furthest_bytes.max(now_bytes));
            if got_further {
                waiting_since = None;
                pause = FIRST_PAUSE;
            }
            if waiting_since.is_none() {
                let line = format!("retrying the store: {error}");
                transfer.watch.warn(&line);
            }
            let since =
                *waiting_since.get_or_insert(if got_further { Instant::now() } else { began });
            if since.elapsed() + pause > self.0 {
                return Err(error);
            }
            let until = Instant::now() + pause;
            while Instant::now() < until {
                transfer.check()?;
                sleep(LOOK_UP.min(until.saturating_duration_since(Instant::now()))).await;
            }
            pause = (pause * 2).min(MAX_PAUSE);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::StoreError;
    use dataset::work::watch::Silent;
    use std::sync::atomic::AtomicU32;

    fn away() -> StoreError {
        StoreError::Away {
            url: "s3://bucket".into(),
            doing: "list".into(),
            message: "connection refused".into(),
        }
    }

    struct Listener {
        told: AtomicU32,
        stop: bool,
    }

    impl Watch for Listener {
        fn warn(&self, _line: &str) {
            self.told.fetch_add(1, Ordering::Relaxed);
        }

        fn is_stopped(&self) -> bool {
            self.stop
        }
    }

    fn listener(stop: bool) -> Listener {
        Listener {
            told: AtomicU32::new(0),
            stop,
        }
    }

    #[tokio::test(start_paused = true)]
    async fn a_store_that_comes_back_is_waited_for_and_it_is_said_once() {
        let mut tries = 0;
        let listener = listener(false);
        let done = Patience(Duration::from_secs(60))
            .with(&Transfer::new(&listener), async || {
                tries += 1;
                if tries < 3 { Err(away()) } else { Ok(tries) }
            })
            .await;
        assert_eq!(done.unwrap(), 3);
        assert_eq!(listener.told.load(Ordering::Relaxed), 1);
    }

    #[tokio::test]
    async fn patience_ends_with_the_last_error_and_begins_anew_when_something_passes() {
        let mut tries = 0;
        let listener = listener(false);
        let transfer = Transfer::new(&listener);
        let error = Patience(Duration::from_millis(600))
            .with(&transfer, async || {
                tries += 1;
                if tries == 2 {
                    transfer.passed(5);
                }
                Err::<(), _>(away())
            })
            .await
            .unwrap_err();
        assert!(error.is_passing());
        // The second attempt made progress: it was reported again, and a third was made.
        assert_eq!((tries, listener.told.load(Ordering::Relaxed)), (3, 2));
    }

    #[tokio::test]
    async fn bytes_that_are_transferred_again_and_again_are_no_progress() {
        let mut tries = 0;
        // Complete files are: the second attempt gets further with fewer bytes.
        let transfer = Transfer::new(&Silent);
        let error = Patience(Duration::from_millis(600))
            .with(&transfer, async || {
                tries += 1;
                transfer.passed(if tries == 1 { 7 } else { 5 });
                if tries == 2 {
                    transfer.kept();
                    transfer.passed(5);
                }
                Err::<(), _>(away())
            })
            .await
            .unwrap_err();
        assert!(error.is_passing());
        assert_eq!(tries, 3);
    }

    #[tokio::test]
    async fn what_will_not_pass_is_not_repeated_and_a_wish_to_stop_is_heard() {
        let mut tries = 0;
        let refused = Patience(Duration::from_secs(60))
            .with(&Transfer::new(&Silent), async || {
                tries += 1;
                Err::<(), _>(StoreError::Refused {
                    url: String::new(),
                    doing: String::new(),
                    message: String::new(),
                })
            })
            .await;
        assert!(matches!(refused, Err(StoreError::Refused { .. })));
        assert_eq!(tries, 1);
        let stopped = Patience(Duration::from_secs(60))
            .with(&Transfer::new(&listener(true)), async || {
                Err::<(), _>(away())
            })
            .await;
        assert!(matches!(stopped, Err(StoreError::Stopped(_))));
    }
}
