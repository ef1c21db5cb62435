//! Requests of a block: the ticks that are still to be shown, and the frames in which shown ones were written.

use std::collections::{BTreeMap, VecDeque};
use std::mem;

/// Requests that are shown but not seen yet, at most, beyond those that the lag keeps back: enough to use every drawn frame.
const MAX_UNSEEN: usize = 6;
/// Images without a loss after which one more may be in flight.
const WIDEN_AFTER: u32 = 32;
/// Requests that are remembered: more than any grab goes back.
const REMEMBERED: usize = 2 * MAX_UNSEEN + 16;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Show {
    /// A tick of the block.
    Tick(u32),
    /// The tick with the aircraft displaced.
    Probe(u32),
}

#[derive(Debug, Default)]
pub(super) struct Requests {
    ticks: u32,
    /// The next tick that was never shown, and those to show again.
    next_tick: u32,
    pub(super) again: VecDeque<u32>,
    /// New ticks since the last probe.
    pub(super) since_probe: u32,
    /// Sent and not answered yet; true if the request before was the same, to hold its tick for a second frame.
    sent: VecDeque<(Show, bool)>,
    /// The tick to be sent once more.
    second: Option<Show>,
    /// The frame of the last answer.
    answered_up_to: u64,
    /// Content shown from each frame on.
    pub(super) shown: BTreeMap<u64, Show>,
    /// Answered ticks without an image, by frame.
    pub(super) unseen: BTreeMap<u64, u32>,
    /// Number of requests fewer in flight than at most, because images were lost.
    narrowed_by: usize,
    without_loss: u32,
}

impl Requests {
    pub(super) fn new(ticks: u32) -> Self {
        Self {
            ticks,
            ..Self::default()
        }
    }

    /// The next tick, an earlier one first; a new one only if there is room for its image.
    pub(super) fn next_tick(&mut self, has_room: bool) -> Option<Show> {
        let again = self.again.pop_front().map(Show::Tick);
        again.or_else(|| {
            (has_room && self.next_tick < self.ticks).then(|| {
                self.next_tick += 1;
                self.since_probe += 1;
                Show::Tick(self.last_tick())
            })
        })
    }

    /// The last tick that was shown for the first time, or the first one.
    pub(super) fn last_tick(&self) -> u32 {
        self.next_tick.saturating_sub(1)
    }

    pub(super) fn are_all_shown(&self) -> bool {
        self.again.is_empty() && self.next_tick == self.ticks
    }

    /// Notes that a request is sent, and is to be followed by the same once more.
    pub(super) fn send(&mut self, show: Show, is_held: bool) {
        self.second = is_held.then_some(show);
        self.sent.push_back((show, false));
    }

    /// Sends the last request once more, if its tick has to be held.
    pub(super) fn send_second(&mut self) -> Option<Show> {
        let show = self.second.take()?;
        self.sent.push_back((show, true));
        Some(show)
    }

    /// The oldest unanswered request was written in a frame. Returns it, unless the one before was the same.
    pub(super) fn answered(&mut self, frame: u64) -> Option<Show> {
        let (show, is_second) = self.sent.pop_front()?;
        self.answered_up_to = frame;
        if is_second {
            return None;
        }
        self.shown.insert(frame, show);
        if self.shown.len() > REMEMBERED {
            self.shown.pop_first();
        }
        Some(show)
    }

    /// Takes the tick that was written in a frame off those without an image. True if it was one.
    pub(super) fn take_unseen(&mut self, frame: u64) -> bool {
        let is_first = self.unseen.remove(&frame).is_some();
        self.without_loss += u32::from(is_first);
        if self.without_loss >= WIDEN_AFTER {
            self.without_loss = 0;
            self.narrowed_by = self.narrowed_by.saturating_sub(1);
        }
        is_first
    }

    /// Ticks that no grab after this frame's can show are shown again. Returns their number.
    pub(super) fn miss(&mut self, newest_frame: u64) -> u32 {
        let shown = &self.shown;
        let missed = self.unseen.extract_if(.., |since, _| {
            let next = shown.range(*since + 1..).next();
            next.is_some_and(|(next, _)| newest_frame + 1 >= *next)
        });
        let before = self.again.len();
        self.again.extend(missed.map(|(_, tick)| tick));
        let missed = self.again.len() - before;
        if missed > 0 {
            self.narrowed_by = (self.narrowed_by + missed).min(MAX_UNSEEN - 1);
            self.without_loss = 0;
        }
        missed as u32
    }

    /// Shows everything again that is under way, unless it `has_image`, in the order of the ticks. Returns the number of ticks that were
    /// not to be shown again already.
    pub(super) fn repeat_all(&mut self, has_image: impl Fn(u32) -> bool) -> u32 {
        self.second = None;
        let counted = self.again.len();
        let sent = self.sent.iter().filter_map(|(show, _)| match show {
            Show::Tick(tick) => Some(*tick),
            Show::Probe(_) => None,
        });
        let unseen = mem::take(&mut self.unseen).into_values();
        let mut again: Vec<u32> = unseen.chain(sent).chain(self.again.drain(..)).collect();
        again.retain(|tick| !has_image(*tick));
        again.sort_unstable();
        again.dedup();
        self.again = again.into();
        self.again.len().saturating_sub(counted) as u32
    }

    /// True if no more may be in flight, with a scene that is so many frames behind.
    pub(super) fn is_full(&self, lag: u64) -> bool {
        let sent = self.sent.iter().filter(|(_, is_second)| !is_second);
        sent.count() + self.unseen.len() >= MAX_UNSEEN - self.narrowed_by + lag as usize
    }

    /// True if a request has to be answered, or its image to be seen.
    pub(super) fn is_under_way(&self) -> bool {
        self.is_unanswered() || !self.unseen.is_empty()
    }

    /// True if a request has to be answered before anything else happens.
    pub(super) fn is_unanswered(&self) -> bool {
        !self.sent.is_empty()
    }

    /// True if every request that was written up to a frame has been answered.
    pub(super) fn is_answered_up_to(&self, frame: u64) -> bool {
        self.sent.is_empty() || self.answered_up_to >= frame
    }
}
