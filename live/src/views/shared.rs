//! State that the threads of all views share: the passing of time, and clock corrections.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, OnceLock};
use std::thread;
use std::time::Duration;

use crate::clock::{RunClock, Stamp, Tie};
use crate::options::{Options, Pace};
use crate::output::metrics::Metrics;
use crate::queue::lock;

/// Milliseconds after which a sleeping thread looks whether it should end.
const NAP_MS: u64 = 20;

/// Measured clock correction.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Correction {
    /// Seconds to add at a time of answers.
    pub(crate) seconds: f64,
    pub(crate) time_s: f64,
    /// Growth per second.
    pub(crate) drift: f64,
}

impl Correction {
    pub(crate) fn at(&self, time_s: f64) -> f64 {
        self.seconds + self.drift * (time_s - self.time_s)
    }

    /// This correction after another one was taken off, at its own time.
    pub(crate) fn without(&self, other: &Self) -> Self {
        Self {
            seconds: self.seconds - other.at(self.time_s),
            drift: self.drift - other.drift,
            ..*self
        }
    }
}

/// The clock that a view's images have now.
#[derive(Debug, Clone, Copy)]
struct ViewClock {
    tie: Tie,
    /// Shortest times to the arrivals from this clock and from the sender's, s.
    delay_s: Option<f64>,
    sender_delay_s: Option<f64>,
}

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
    /// Measured corrections.
    measured: Vec<Mutex<Correction>>,
    /// Free clocks of recordings, which only the caller knows.
    is_measured: Vec<bool>,
    clocks: Vec<Mutex<ViewClock>>,
    /// Views without a source, or whose camera was wrong when it last answered.
    is_wrong: Vec<AtomicBool>,
    /// Views whose recording is over.
    has_ended: Vec<AtomicBool>,
}

impl Shared {
    pub(crate) fn of(options: &Options, metrics: Arc<Metrics>) -> Self {
        let views = options.run.views().iter();
        let given_s = |view| options.offsets_s.get(view).copied().unwrap_or(0.0);
        let no_image = ViewClock {
            tie: Tie::Common,
            delay_s: None,
            sender_delay_s: None,
        };
        Self {
            measured: views.clone().map(|_| Mutex::default()).collect(),
            clocks: views.clone().map(|_| Mutex::new(no_image)).collect(),
            given_s: views.clone().map(given_s).collect(),
            is_measured: (views.clone())
                .map(|view| options.measured.contains(view))
                .collect(),
            has_ended: views.clone().map(|_| AtomicBool::default()).collect(),
            is_wrong: views
                .map(|view| AtomicBool::new(!options.sources.contains_key(view)))
                .collect(),
            clock: RunClock::start(),
            pace: options.pace(),
            stop: Arc::default(),
            metrics,
            zero_s: OnceLock::new(),
            recordings_s: OnceLock::new(),
        }
    }

    /// Takes how an attempt to open a view ended. True if the program goes on although its camera is wrong: one camera must not end what
    /// others may still do. Before the first image of any view, cameras that are all wrong do.
    pub(crate) fn goes_on_after(&self, view: usize, is_wrong: bool) -> bool {
        self.is_wrong[view].store(is_wrong, Ordering::Relaxed);
        let mut others = self.is_wrong.iter().enumerate();
        others.any(|(other, is_wrong)| {
            self.metrics.has_images(other) || !is_wrong.load(Ordering::Relaxed)
        })
    }

    /// Takes the end of a view's recording.
    pub(crate) fn ended(&self, view: usize) {
        self.has_ended[view].store(true, Ordering::Relaxed);
    }

    /// True if no view can have an image any more: recordings are over, and the other cameras wrong since the start.
    pub(crate) fn is_over(&self) -> bool {
        let has_ended = |view: usize| self.has_ended[view].load(Ordering::Relaxed);
        let mut views = self.is_wrong.iter().enumerate();
        views.all(|(view, is_wrong)| {
            let never_came = is_wrong.load(Ordering::Relaxed) && !self.metrics.has_images(view);
            has_ended(view) || never_came
        })
    }

    /// Takes the clock of a view's next image.
    pub(crate) fn set_clock(&self, view: usize, stamp: &Stamp) {
        let mut clock = lock(&self.clocks[view]);
        clock.tie = if self.is_measured[view] {
            Tie::Free
        } else {
            stamp.clock.tie()
        };
        clock.delay_s = stamp.delay_s();
        // After a loss, the clock is still as right as before.
        clock.sender_delay_s = stamp.sender_delay_s.or(clock.sender_delay_s);
    }

    /// What ties a view's clock to others.
    pub(crate) fn tie(&self, view: usize) -> Tie {
        lock(&self.clocks[view]).tie
    }

    /// Shortest times to the arrivals of all views, by their clocks.
    pub(crate) fn delays_s(&self) -> Vec<Option<f64>> {
        let clocks = self.clocks.iter();
        clocks.map(|clock| lock(clock).delay_s).collect()
    }

    /// Shortest times to the arrivals of the other views, by their senders' clocks.
    pub(crate) fn sender_delays_s(&self, except: usize) -> Vec<f64> {
        let clocks = self.clocks.iter().enumerate();
        let others = clocks.filter(|(view, _)| *view != except);
        others
            .filter_map(|(_, clock)| lock(clock).sender_delay_s)
            .collect()
    }

    /// Measured correction of the view's clock at a time, s.
    pub(crate) fn added_s(&self, view: usize, time_s: f64) -> f64 {
        lock(&self.measured[view]).at(time_s)
    }

    /// Sets the correction.
    pub(crate) fn correct(&self, view: usize, correction: Correction) {
        *lock(&self.measured[view]) = correction;
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
