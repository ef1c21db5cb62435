//! A thread for each view: it opens the source, decodes, judges each image, and opens the source again when it is lost.
//!
//! A few images wait for the search, and the newest replaces the oldest: that one was decoded, but is not searched. A recording that is
//! read as fast as possible waits instead.

use std::sync::mpsc::Sender;
use std::sync::{Arc, Mutex};

use dataset::video::DecodedImage;

use crate::clock::{ClockSource, Stamp, Stamper};
use crate::error::Error;
use crate::options::Pace;
use crate::output::metrics::{Fate, Stage};
use crate::queue::{Queue, lock};
use crate::source::Source;
use crate::source::input::{Input, InputImage, other_size};
use crate::source::limits::{End, OpenFault, Patience};
use crate::view_state::image_look::Looks;
use crate::view_state::{DecodedLook, ViewState, ViewWatch};
use crate::views::read_limit::ReadLimit;
use crate::views::search::Searched;
use crate::views::shared::Shared;

/// Milliseconds before a lost source is opened again: at first, and at most.
const FIRST_DELAY_MS: u64 = 100;
const MAX_DELAY_MS: u64 = 1_000;
/// Milliseconds within which a source must open: at first, and for one that is slow, with a doubled limit after each attempt.
pub(crate) const OPEN_MS: u64 = 4_000;
const MAX_OPEN_MS: u64 = 32_000;

pub(crate) struct FeedImage {
    pub(crate) image: DecodedImage,
    /// When it was taken, in the time of answers, seconds.
    pub(crate) time_s: f64,
    /// For its age: no later than it was taken, seconds since the start of the program.
    pub(crate) taken_s: f64,
    /// When its last packet arrived, and when it was decoded.
    pub(crate) arrival_s: f64,
    pub(crate) decoded_s: f64,
    /// Clock correction that is part of `time_s`, s.
    pub(crate) added_s: f64,
    /// Number of the connection.
    pub(crate) connection: u32,
    /// False while the camera looks elsewhere or its images repeat: the search only sees whether that is over.
    pub(crate) can_be_measured: bool,
    /// False for black and damaged images, which only keep their place in a recording.
    pub(crate) can_be_searched: bool,
}

/// Message from a view's thread to the conductor.
pub(crate) enum Message {
    /// The feed's report.
    Report(usize, Report),
    /// A searched image.
    Searched(usize, Box<Searched>),
    /// Skipped recorded image's time.
    Skipped(usize, f64),
    /// A permanent failure.
    Failed(Error),
    /// The search has ended.
    Finished(usize),
}

/// News about the source.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Report {
    /// It was opened: the codec.
    Opened { codec: &'static str },
    /// The connection's first image.
    FirstImage {
        size_px: [u32; 2],
        clock: ClockSource,
    },
    /// The image times have a new origin.
    Clock(ClockSource),
    /// It was lost, or is not there.
    Lost(String),
    /// It can never be used.
    Useless(String),
    /// The recording is over.
    Ended,
}

pub(crate) struct Feed {
    pub(crate) view: usize,
    pub(crate) name: String,
    pub(crate) source: Source,
    /// Size of the images that the run knows.
    pub(crate) size_px: [u32; 2],
    pub(crate) queue: Arc<Queue<FeedImage>>,
    pub(crate) status: Arc<Mutex<ViewWatch>>,
    pub(crate) messages: Sender<Message>,
    pub(crate) shared: Arc<Shared>,
    /// Time of the last image, also from an earlier connection.
    pub(crate) last_time_s: Option<f64>,
    /// Number of connections until now.
    pub(crate) connections: u32,
    /// Time limit of the next attempt to open the source, ms.
    pub(crate) open_ms: u64,
    pub(crate) read_limit: ReadLimit,
}

impl Feed {
    /// Runs until the recording ends, the source turns out to be useless, or the program is stopped.
    pub(crate) fn run(mut self) {
        let mut delay_ms = FIRST_DELAY_MS;
        while !self.shared.is_stopped() {
            let opened_s = self.shared.clock.now_s();
            let end = match self.once() {
                Err(OpenFault::Disk(error)) => {
                    // Whoever reads it has ended if it fails.
                    let _ = self.messages.send(Message::Failed(error.into()));
                    break;
                }
                end => end,
            };
            let is_recorded = self.source.is_recorded();
            let is_wrong = matches!(end, Ok(End::Useless(_)) | Err(OpenFault::Wrong(_)));
            let is_wrong = is_wrong && !is_recorded;
            let may_go_on = self.shared.goes_on_after(self.view, is_wrong);
            let goes_on = if is_wrong {
                may_go_on
            } else {
                self.shared.metrics.has_images(self.view)
            };
            // After the last recording, no camera is waited for that was wrong until then.
            let is_last = is_recorded || (is_wrong && self.shared.is_over());
            let reports = reports_of(end, is_last, goes_on);
            let is_over = !matches!(reports[..], [Report::Lost(_)]);
            for report in reports {
                self.report(report);
            }
            // After the cause, so that the event has it.
            lock(&self.status).set_connected(false);
            if is_over {
                if is_recorded {
                    self.shared.ended(self.view);
                }
                break;
            }
            let lasted_s = self.shared.clock.now_s() - opened_s;
            if lasted_s * 1e3 > 2.0 * MAX_DELAY_MS as f64 {
                delay_ms = FIRST_DELAY_MS;
            }
            let wait_s = delay_ms as f64 * 1e-3;
            self.shared.sleep_until(self.shared.clock.now_s() + wait_s);
            delay_ms = (2 * delay_ms).min(MAX_DELAY_MS);
        }
        self.queue.close();
    }

    fn report(&self, report: Report) {
        // Whoever reads it has ended if it fails.
        let _ = self.messages.send(Message::Report(self.view, report));
    }

    /// Opens the source and hands over its images until they end.
    fn once(&mut self) -> Result<End, OpenFault> {
        let clock = self.shared.clock;
        let patience = Patience::new(clock, self.shared.stop.clone());
        let (most_ms, began_s) = (self.open_ms, clock.now_s());
        let opened = Input::open(&self.source, &self.name, self.size_px, patience, most_ms);
        if opened.is_err() && clock.now_s() - began_s >= 1e-3 * most_ms as f64 {
            self.open_ms = (2 * most_ms).min(MAX_OPEN_MS);
        }
        let mut input = opened?;
        self.connections = self.connections.wrapping_add(1);
        self.report(Report::Opened {
            codec: input.codec(),
        });
        let mut connection = Connection::default();
        loop {
            let image = match input.next(self.read_limit.next_ms()) {
                Ok(image) => image,
                Err(end) => {
                    if matches!(end, End::Silent(_)) {
                        self.read_limit.given_up(connection.images);
                    }
                    return Ok(end);
                }
            };
            let arrival_s = image.clues.arrival_s;
            if let Some(last_s) = connection.arrival_s.replace(arrival_s) {
                self.read_limit.came(arrival_s - last_s);
            }
            connection.images = connection.images.saturating_add(1);
            self.take(image, &mut connection)?;
        }
    }

    fn take(&mut self, image: InputImage, connection: &mut Connection) -> Result<(), OpenFault> {
        let shared = self.shared.clone();
        let size_px = image.image.size_px();
        let Some((stamp, time_s, added_s)) = self.stamp(&image, connection) else {
            shared.metrics.count(self.view, Fate::Disordered);
            if shared.pace != Pace::AsFastAsPossible {
                lock(&self.status).came(shared.clock.now_s());
            }
            return Ok(());
        };
        let decoded_s = shared.clock.now_s();
        let clock = stamp.clock;
        // An image that a correction makes older is older.
        let oldest_s = match clock {
            ClockSource::Recording => stamp.oldest_s,
            _ => (stamp.time_s + shared.given_s[self.view] + added_s).min(stamp.oldest_s),
        };
        match connection.clock.replace(clock) {
            None => {
                // Later images with a different size count as damaged.
                if size_px != self.size_px {
                    return Err(OpenFault::Wrong(other_size(size_px, self.size_px)));
                }
                self.report(Report::FirstImage { size_px, clock });
            }
            Some(before) if before != clock => self.report(Report::Clock(clock)),
            Some(_) => {}
        }
        let is_other_size = size_px != self.size_px;
        let seen = DecodedLook {
            now_s: match shared.pace {
                Pace::AsFastAsPossible => time_s,
                _ => decoded_s,
            },
            time_s: match shared.pace {
                Pace::AsFastAsPossible => time_s,
                _ => oldest_s,
            },
            is_damaged: image.is_damaged || is_other_size,
            look: connection.looks.next(image.image.luma()),
        };
        let state = lock(&self.status).take(seen);
        let arrival_s = match stamp.clock {
            // It is due now.
            ClockSource::Recording => decoded_s,
            _ => image.clues.arrival_s,
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
            taken_s: oldest_s.min(arrival_s),
            arrival_s,
            decoded_s,
            added_s,
            connection: self.connections,
            can_be_measured: state.can_be_measured(),
            can_be_searched,
        };
        if shared.pace == Pace::AsFastAsPossible {
            self.queue.put_after(image);
        } else if let Some(before) = self.queue.put(image)
            && before.can_be_measured
        {
            shared.metrics.count(self.view, Fate::Overload);
        }
        Ok(())
    }

    /// The image's stamp, answer time and clock correction; `None` if it is not after the previous one.
    fn stamp(
        &mut self,
        image: &InputImage,
        connection: &mut Connection,
    ) -> Option<(Stamp, f64, f64)> {
        let shared = self.shared.clone();
        let recorded_s = image.recorded_s.or(image.clues.timestamp_s);
        let recorded_s = recorded_s.filter(|_| self.source.is_recorded());
        let stamp = match (recorded_s, shared.pace) {
            (Some(_), Pace::AsFastAsPossible) => Stamp::recorded(image.clues.arrival_s),
            (Some(recorded_s), _) => {
                let now_s = shared.clock.now_s();
                let start_s = *shared.recordings_s.get_or_init(|| now_s - recorded_s);
                shared.sleep_until(start_s + recorded_s);
                Stamp::recorded(start_s + recorded_s)
            }
            (None, _) => {
                let others_s = shared.sender_delays_s(self.view);
                connection.stamper.stamp(image.clues, &others_s)
            }
        };
        shared.set_clock(self.view, &stamp);
        let told_s = shared.given_s[self.view]
            + match (recorded_s, shared.pace) {
                (Some(recorded_s), Pace::RealTime | Pace::AsFastAsPossible) => recorded_s,
                _ => stamp.time_s - shared.zero_s.get_or_init(|| stamp.time_s),
            };
        let added_s = shared.added_s(self.view, told_s);
        let time_s = told_s + added_s;
        let is_after = self.last_time_s.is_none_or(|last_s| time_s > last_s);
        if is_after {
            self.last_time_s = Some(time_s);
        }
        is_after.then_some((stamp, time_s, added_s))
    }
}

#[derive(Default)]
struct Connection {
    stamper: Stamper,
    looks: Looks,
    /// Source of the time of the last image.
    clock: Option<ClockSource>,
    images: u32,
    arrival_s: Option<f64>,
}

/// Reports about an end. A single loss is opened again; otherwise the feed is over. `goes_on`: the program does even if this source is
/// useless.
fn reports_of(end: Result<End, OpenFault>, is_recorded: bool, goes_on: bool) -> Vec<Report> {
    match end {
        // The conductor has been told already.
        Ok(End::Stopped) | Err(OpenFault::Disk(_)) => Vec::new(),
        Ok(End::Useless(why)) | Err(OpenFault::Wrong(why) | OpenFault::Useless(why))
            if !goes_on =>
        {
            vec![Report::Useless(why)]
        }
        Ok(End::Finished) if is_recorded => vec![Report::Ended],
        Ok(End::Finished) => vec![Report::Lost("the sender ended it".into())],
        Ok(End::Silent(most_ms)) => {
            vec![Report::Lost(format!("no image came for {most_ms} ms"))]
        }
        // It would begin again, and fail at the same place.
        Ok(End::Lost(why) | End::Useless(why))
        | Err(OpenFault::Wrong(why) | OpenFault::Useless(why))
            if is_recorded =>
        {
            vec![Report::Lost(why), Report::Ended]
        }
        Ok(End::Lost(why) | End::Useless(why))
        | Err(OpenFault::Absent(why) | OpenFault::Wrong(why) | OpenFault::Useless(why)) => {
            vec![Report::Lost(why)]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_is_not_played_again_and_what_never_had_an_image_is_useless() {
        let useless = || Ok(End::Useless("no".into()));
        let lost = Report::Lost("no".into());
        let over = vec![lost.clone(), Report::Ended];
        for (end, is_recorded, goes_on, expected) in [
            (useless(), true, false, vec![Report::Useless("no".into())]),
            (
                Err(OpenFault::Wrong("no".into())),
                false,
                true,
                vec![lost.clone()],
            ),
            (
                Err(OpenFault::Wrong("no".into())),
                false,
                false,
                vec![Report::Useless("no".into())],
            ),
            (useless(), true, true, over.clone()),
            (useless(), false, true, vec![lost.clone()]),
            (Ok(End::Lost("no".into())), true, true, over),
            (
                Err(OpenFault::Absent("no".into())),
                false,
                false,
                vec![lost],
            ),
            (Ok(End::Finished), true, true, vec![Report::Ended]),
            (Ok(End::Stopped), false, true, Vec::new()),
        ] {
            assert_eq!(reports_of(end, is_recorded, goes_on), expected);
        }
    }
}
