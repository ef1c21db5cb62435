//! State that the threads of all views share: the passing of time, corrections of clocks, and the condition of each view.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread;
use std::time::Duration;

use crate::clocks::clock::RunClock;
use crate::output::metrics::Metrics;
use crate::view_state::ViewWatch;

/// Milliseconds after which a sleeping thread looks whether it should end.
const NAP_MS: u64 = 20;

/// Passing of time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Pace {
    /// There is a camera: clocks give the times of images.
    Cameras,
    /// All sources are recordings, played in their own time.
    RealTime,
    /// The same, as fast as they are searched.
    AsFastAsPossible,
}

/// Correction of a clock that was measured.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Correction {
    /// Seconds to add at a time of answers.
    pub(crate) seconds: f64,
    pub(crate) time_s: f64,
    /// By how much that grows in a second.
    pub(crate) drift: f64,
}

impl Correction {
    fn at(&self, time_s: f64) -> f64 {
        self.seconds + self.drift * (time_s - self.time_s)
    }
}

/// State that all feeds share.
pub(crate) struct Shared {
    pub(crate) clock: RunClock,
    pub(crate) pace: Pace,
    pub(crate) stop: Arc<AtomicBool>,
    pub(crate) metrics: Arc<Metrics>,
    /// When the first image of any view was taken, seconds since the start: time 0 of answers.
    pub(crate) zero_s: OnceLock<f64>,
    /// Start of recordings that are played: seconds since the start minus seconds of the recording.
    pub(crate) recordings_s: OnceLock<f64>,
    /// Seconds that are added to the times of each view's images.
    pub(crate) given_s: Vec<f64>,
    /// The same as they were measured, while the clock of the view or of the first one runs free.
    measured: Vec<Mutex<Correction>>,
    /// Free clocks of recordings, which only the caller knows.
    pub(crate) is_measured: Vec<bool>,
    pub(crate) runs_free: Vec<AtomicBool>,
}

impl Shared {
    pub(crate) fn new(
        clock: RunClock,
        pace: Pace,
        stop: Arc<AtomicBool>,
        metrics: Arc<Metrics>,
        given_s: Vec<f64>,
        is_measured: Vec<bool>,
    ) -> Self {
        Self {
            measured: given_s.iter().map(|_| Mutex::default()).collect(),
            runs_free: given_s.iter().map(|_| AtomicBool::new(false)).collect(),
            given_s,
            is_measured,
            clock,
            pace,
            stop,
            metrics,
            zero_s: OnceLock::new(),
            recordings_s: OnceLock::new(),
        }
    }

    /// True if nothing ties the clock of a view to that of the first one.
    pub(crate) fn runs_free(&self, view: usize) -> bool {
        let is_free = |view: usize| self.runs_free[view].load(Ordering::Relaxed);
        is_free(0) || is_free(view)
    }

    /// Seconds that are added to a time of a view's clock because they were measured.
    pub(crate) fn added_s(&self, view: usize, time_s: f64) -> f64 {
        if self.runs_free(view) {
            self.correction(view).at(time_s)
        } else {
            0.0
        }
    }

    /// From now on, the clock of a view is corrected by this.
    pub(crate) fn correct(&self, view: usize, correction: Correction) {
        *self.correction(view) = correction;
    }

    fn correction(&self, view: usize) -> MutexGuard<'_, Correction> {
        let correction = self.measured[view].lock();
        correction.unwrap_or_else(PoisonError::into_inner)
    }

    /// A time of answers in seconds since the start of the program, for cameras.
    pub(crate) fn since_start_s(&self, time_s: f64) -> f64 {
        time_s + self.zero_s.get().copied().unwrap_or(0.0)
    }

    pub(crate) fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// A time since the start of the program in the time of answers; `None` if there is no image yet, or time does not pass.
    pub(crate) fn answer_time_s(&self, since_start_s: f64) -> Option<f64> {
        let zero_s = match self.pace {
            Pace::Cameras => self.zero_s.get(),
            Pace::RealTime => self.recordings_s.get(),
            Pace::AsFastAsPossible => None,
        };
        zero_s.map(|zero_s| since_start_s - zero_s)
    }

    /// Sleeps until a time in seconds since the start, or until the program is stopped.
    pub(crate) fn sleep_until(&self, time_s: f64) {
        while !self.is_stopped() {
            let left_s = time_s - self.clock.now_s();
            if left_s <= 0.0 {
                return;
            }
            thread::sleep(Duration::from_secs_f64(left_s.min(NAP_MS as f64 * 1e-3)));
        }
    }
}

/// The state of a view, which its feed and its search report and the conductor reads.
#[derive(Debug, Default)]
pub(crate) struct ViewStatus(Mutex<ViewWatch>);

impl ViewStatus {
    pub(crate) fn watch(&self) -> MutexGuard<'_, ViewWatch> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
