//! A thread for each view: it opens the source, decodes, judges each image, and opens the source again when it is lost.
//!
//! A few images wait for the search, and the newest replaces the oldest: that one was decoded, but is not searched. A recording that is
//! read as fast as possible waits instead.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::Sender;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread;
use std::time::Duration;

use dataset::video::DecodedImage;

use crate::clock::{ClockSource, Clues, RunClock, Stamp, Stamper};
use crate::error::Error;
use crate::image_look::Looks;
use crate::input::{End, Input, InputImage, OpenFault, Patience};
use crate::metrics::{Fate, Metrics, Stage};
use crate::search::Searched;
use crate::slot::Slot;
use crate::source::Source;
use crate::view_state::{Seen, ViewState, ViewWatch};

/// Milliseconds before a lost source is opened again: at first, and at most.
const FIRST_DELAY_MS: u64 = 100;
const MOST_DELAY_MS: u64 = 2_000;
/// Milliseconds after which a sleeping thread looks whether it should end.
const NAP_MS: u64 = 20;

/// An image for the search.
pub(crate) struct FeedImage {
    pub(crate) image: DecodedImage,
    /// When it was taken, in the time of answers, seconds.
    pub(crate) time_s: f64,
    /// For its age: no later than it was taken, seconds since the start of the program.
    pub(crate) taken_s: f64,
    /// When its last packet arrived, and when it was decoded.
    pub(crate) arrival_s: f64,
    pub(crate) decoded_s: f64,
    /// Source of its time.
    pub(crate) clock: ClockSource,
    /// False while the camera looks elsewhere or its images repeat: the search only sees whether that is over.
    pub(crate) can_be_measured: bool,
    /// False for black and damaged images, which only keep their place in a recording.
    pub(crate) can_be_searched: bool,
}

/// Message from a thread of a view to the conductor.
pub(crate) enum Message {
    /// About the source of a view.
    Report(usize, Report),
    /// A searched image of a view.
    Searched(usize, Box<Searched>),
    /// An image of a recording that must not be measured, at this time.
    Skipped(usize, f64),
    /// The search of a view failed, for good.
    Failed(Error),
    /// The search of a view has ended.
    Finished(usize),
}

/// Report of a feed besides its images.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Report {
    /// It was opened: the codec.
    Opened { codec: &'static str },
    /// The first image of a connection.
    FirstImage {
        size_px: [u32; 2],
        clock: ClockSource,
    },
    /// It was lost, or is not there.
    Lost(String),
    /// It can never be used.
    Useless(String),
    /// Its recording is over.
    Ended,
}

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

/// State that all feeds share.
pub(crate) struct Shared {
    pub(crate) clock: RunClock,
    pub(crate) pace: Pace,
    pub(crate) stop: Arc<AtomicBool>,
    pub(crate) metrics: Arc<Metrics>,
    /// When the first image of any view was taken, seconds since the start: time 0 of answers.
    zero_s: OnceLock<f64>,
    /// Start of recordings that are played: seconds since the start minus seconds of the recording.
    recordings_s: OnceLock<f64>,
    /// Seconds that are added to the times of each view's images.
    given_s: Vec<f64>,
    /// The same as they were measured, while the clock of the view or of the first one runs free: the bits of seconds.
    measured_s: Vec<AtomicU64>,
    runs_free: Vec<AtomicBool>,
}

impl Shared {
    pub(crate) fn new(
        clock: RunClock,
        pace: Pace,
        stop: Arc<AtomicBool>,
        metrics: Arc<Metrics>,
        offsets_s: impl IntoIterator<Item = f64>,
    ) -> Self {
        let given_s: Vec<f64> = offsets_s.into_iter().collect();
        Self {
            measured_s: given_s.iter().map(|_| AtomicU64::new(0)).collect(),
            runs_free: given_s.iter().map(|_| AtomicBool::new(false)).collect(),
            given_s,
            clock,
            pace,
            stop,
            metrics,
            zero_s: OnceLock::new(),
            recordings_s: OnceLock::new(),
        }
    }

    /// Seconds that are added to the times of a view's images now.
    pub(crate) fn offset_s(&self, view: usize) -> f64 {
        let is_free = [0, view].map(|view| self.runs_free[view].load(Ordering::Relaxed));
        let measured_s = if is_free.contains(&true) {
            self.measured_s(view)
        } else {
            0.0
        };
        self.given_s[view] + measured_s
    }

    /// The offset of a view's clock as it was measured.
    pub(crate) fn measured_s(&self, view: usize) -> f64 {
        f64::from_bits(self.measured_s[view].load(Ordering::Relaxed))
    }

    pub(crate) fn set_measured_s(&self, view: usize, offset_s: f64) {
        self.measured_s[view].store(offset_s.to_bits(), Ordering::Relaxed);
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
    fn sleep_until(&self, time_s: f64) {
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

/// One view's feed.
pub(crate) struct Feed {
    pub(crate) view: usize,
    pub(crate) name: String,
    pub(crate) source: Source,
    /// Size of the images that the run knows.
    pub(crate) size_px: [u32; 2],
    pub(crate) slot: Arc<Slot<FeedImage>>,
    pub(crate) status: Arc<ViewStatus>,
    pub(crate) messages: Sender<Message>,
    pub(crate) shared: Arc<Shared>,
    /// Time of the last image, also of a connection before.
    pub(crate) last_time_s: Option<f64>,
}

impl Feed {
    /// Runs until the recording ends, the source turns out to be useless, or the program is stopped.
    pub(crate) fn run(mut self) {
        let mut delay_ms = FIRST_DELAY_MS;
        while !self.shared.is_stopped() {
            let opened_s = self.shared.clock.now_s();
            let end = self.once();
            self.status.watch().set_connected(false);
            let was_useful = self.shared.metrics.has_images(self.view);
            let report = match end {
                Err(OpenFault::Useless(why)) if !was_useful => Report::Useless(why),
                Ok(End::Finished) if self.source.is_recorded() => Report::Ended,
                Ok(End::Stopped) => break,
                // It would begin again, and fail at the same place.
                Ok(End::Lost(why)) if self.source.is_recorded() => {
                    self.report(Report::Lost(why));
                    Report::Ended
                }
                Ok(End::Finished) => Report::Lost("the sender ended it".into()),
                Ok(End::Lost(why)) | Err(OpenFault::Absent(why) | OpenFault::Useless(why)) => {
                    Report::Lost(why)
                }
            };
            let is_over = !matches!(report, Report::Lost(_));
            self.report(report);
            if is_over {
                break;
            }
            let lasted_s = self.shared.clock.now_s() - opened_s;
            if lasted_s * 1e3 > 2.0 * MOST_DELAY_MS as f64 {
                delay_ms = FIRST_DELAY_MS;
            }
            let wait_s = delay_ms as f64 * 1e-3;
            self.shared.sleep_until(self.shared.clock.now_s() + wait_s);
            delay_ms = (2 * delay_ms).min(MOST_DELAY_MS);
        }
        self.slot.close();
    }

    fn report(&self, report: Report) {
        // Whoever reads it has ended if it fails.
        let _ = self.messages.send(Message::Report(self.view, report));
    }

    /// Opens the source and hands over its images until they end.
    fn once(&mut self) -> Result<End, OpenFault> {
        let patience = Patience::new(self.shared.clock, self.shared.stop.clone());
        let mut input = Input::open(&self.source, &self.name, patience)?;
        self.report(Report::Opened {
            codec: input.codec(),
        });
        let mut connection = Connection::default();
        loop {
            let image = match input.next() {
                Ok(image) => image,
                Err(end) => return Ok(end),
            };
            self.take(image, &mut connection)?;
        }
    }

    fn take(&mut self, image: InputImage, connection: &mut Connection) -> Result<(), OpenFault> {
        let shared = self.shared.clone();
        let size_px = image.image.size_px();
        let Some((stamp, time_s)) = self.stamp(&image, connection) else {
            shared.metrics.count(self.view, Fate::Disordered);
            return Ok(());
        };
        let decoded_s = shared.clock.now_s();
        if !std::mem::replace(&mut connection.had_image, true) {
            if size_px != self.size_px {
                self.check_first(size_px)?;
            }
            self.report(Report::FirstImage {
                size_px,
                clock: stamp.clock,
            });
        }
        let is_other_size = size_px != self.size_px;
        let seen = Seen {
            now_s: match shared.pace {
                Pace::AsFastAsPossible => time_s,
                _ => decoded_s,
            },
            time_s: match shared.pace {
                Pace::AsFastAsPossible => time_s,
                _ => stamp.oldest_s,
            },
            is_damaged: image.is_damaged || is_other_size,
            look: connection.looks.next(image.image.luma()),
        };
        let state = self.status.watch().take(seen);
        let arrival_s = match stamp.clock {
            // It is due now.
            ClockSource::Recording => decoded_s,
            _ => image.arrival_s,
        };
        shared.metrics.time(Stage::Decode, decoded_s - arrival_s);
        if !state.can_be_measured() {
            let fate = if is_other_size {
                Fate::OtherSize
            } else {
                Fate::of(state)
            };
            shared.metrics.count(self.view, fate);
        }
        // The search goes on looking at a camera that moved or repeats images, to see when that is over.
        let shows_scene = !matches!(state, ViewState::Dark | ViewState::Damaged);
        let can_be_searched = shows_scene && !is_other_size;
        if !can_be_searched && shared.pace != Pace::AsFastAsPossible {
            return Ok(());
        }
        let image = FeedImage {
            image: image.image,
            time_s,
            taken_s: stamp.oldest_s.min(arrival_s),
            arrival_s,
            decoded_s,
            clock: stamp.clock,
            can_be_measured: state.can_be_measured(),
            can_be_searched,
        };
        if shared.pace == Pace::AsFastAsPossible {
            self.slot.put_after(image);
        } else if let Some(before) = self.slot.put(image)
            && before.can_be_measured
        {
            shared.metrics.count(self.view, Fate::Overload);
        }
        Ok(())
    }

    /// Time of an image, and the same as of answers; `None` if it is not after the one before.
    fn stamp(&mut self, image: &InputImage, connection: &mut Connection) -> Option<(Stamp, f64)> {
        let shared = self.shared.clone();
        let recorded_s = image.recorded_s.or(image.timestamp_s);
        let recorded_s = recorded_s.filter(|_| self.source.is_recorded());
        let of_recording = |time_s: f64| Stamp {
            time_s,
            clock: ClockSource::Recording,
            oldest_s: time_s,
        };
        let stamp = match (recorded_s, shared.pace) {
            (Some(_), Pace::AsFastAsPossible) => of_recording(image.arrival_s),
            (Some(recorded_s), _) => {
                let now_s = shared.clock.now_s();
                let start_s = *shared.recordings_s.get_or_init(|| now_s - recorded_s);
                shared.sleep_until(start_s + recorded_s);
                of_recording(start_s + recorded_s)
            }
            (None, _) => connection.stamper.stamp(Clues {
                arrival_s: image.arrival_s,
                timestamp_s: image.timestamp_s,
                sender_s: image.sender_s,
            }),
        };
        shared.runs_free[self.view].store(stamp.clock.runs_free(), Ordering::Relaxed);
        let offset_s = shared.offset_s(self.view);
        let time_s = offset_s
            + match (recorded_s, shared.pace) {
                (Some(recorded_s), Pace::RealTime | Pace::AsFastAsPossible) => recorded_s,
                _ => stamp.time_s - shared.zero_s.get_or_init(|| stamp.time_s),
            };
        let is_after = self.last_time_s.is_none_or(|last_s| time_s > last_s);
        if is_after {
            self.last_time_s = Some(time_s);
        }
        is_after.then_some((stamp, time_s))
    }

    /// The first images of a source must have the size of the run's camera. If later ones have another, the view is damaged.
    fn check_first(&self, size_px: [u32; 2]) -> Result<(), OpenFault> {
        let [width, height] = size_px;
        let [known_width, known_height] = self.size_px;
        if self.shared.metrics.has_images(self.view) {
            return Ok(());
        }
        Err(OpenFault::Useless(format!(
            "its images have {width}x{height} pixels, expected {known_width}x{known_height} as in the training; set the camera to that size"
        )))
    }
}

/// State of an open source.
#[derive(Default)]
struct Connection {
    stamper: Stamper,
    looks: Looks,
    had_image: bool,
}
