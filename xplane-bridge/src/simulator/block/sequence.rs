//! The order of a block: the tick to show next, the tick in each grab, and the proven images.
//!
//! Input: the numbers of drawn frames, in which requests were answered, and grabs with their numbers. Output: the images of all ticks in
//! order, each once. No clock, no socket: everything can be replayed in a test.
//!
//! A grab with number m shows the scene of frame m - lag. The lag is measured by probes (`probe.rs`) at both ends of a block and between
//! its segments, and has to be the same each time: images count once the next probe has measured their lag. A view whose last block ended
//! with a probe begins the next block with that lag, which the first probe has to confirm. Where a tick is shown in two frames
//! (`numbers.rs`), a grab counts only if both frames that it may show have the same tick.

#[cfg(test)]
mod tests;

use std::collections::VecDeque;

use super::numbers::{Grab, Numbers};
use super::pictures::{Pictures, Taken};
use super::probe::{MAX_LAG, Outcome, Probe};
use super::requests::{Requests, Show};
use super::settling::Settling;
use crate::pixels::Rectangle;

/// The code counts steady frames up to this number.
const MAX_STEADY: u64 = 7;
/// Probes in a row that are unclear, and changes of the lag in a block, before every tick is held.
const MAX_UNCLEAR: u32 = 12;
const MAX_CHANGES: u32 = 3;

/// The parts of an image that the order of a block depends on. Two grabs of the same frame are equal.
pub(super) trait Scene: PartialEq {
    /// Bytes of a rectangle.
    fn part(&self, area: Rectangle) -> Vec<u8>;

    /// True if exposure, shadows and loading have come to rest since an earlier image of the same tick.
    fn is_settled_after(&self, before: &Self) -> bool;
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Tally {
    /// Ticks that were shown again, because their image was lost or not proven.
    pub(super) repeated: u32,
    /// Probes that measured the lag.
    pub(super) seen: u32,
    /// Probes whose aircraft could not be seen.
    pub(super) unseen: u32,
    /// Number of changes of the lag.
    pub(super) changes: u32,
    /// Ticks that were held until they had settled.
    pub(super) held: u32,
}

/// Knowledge about a view before its block.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Known {
    /// The lag, which is used where no probe can be seen.
    pub(super) lag: Option<u64>,
    /// True if the view's last block measured it: this one then begins with it instead of a probe.
    pub(super) is_measured: bool,
    /// True if numbers were repeated, so that every tick is shown in two frames.
    pub(super) numbers_repeat: bool,
    /// True if the scene moves by itself in a pause: two equal grabs are chance, and it has to be watched.
    pub(super) scene_moves: bool,
}

impl Known {
    /// The lag with which a block begins, before a probe has confirmed it.
    fn first_lag(self) -> Option<u64> {
        self.lag.filter(|_| self.is_measured)
    }
}

/// Place of a probe's aircraft in the image, by tick; `None` if it is outside.
pub(super) type ProbePlace = Box<dyn Fn(u32) -> Option<Rectangle> + Send>;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// The first tick is held until the scene is at rest.
    Settling,
    /// A tick is held while a probe is watched.
    Probing,
    /// Every drawn frame shows the next tick, with a known lag.
    Moving,
    /// Every tick is held until it has settled.
    Held,
}

/// A block that is being recorded.
pub(super) struct Sequence<P> {
    ticks: u32,
    /// Ticks between two probes.
    segment: u32,
    settle_frames: u64,
    probe_place: ProbePlace,
    /// The lag is the one that the probes of this block measured, or that was known before.
    pub(super) known: Known,
    phase: Phase,
    pub(super) requests: Requests,
    pub(super) numbers: Numbers<P>,
    /// Grabs that may show a request that is not answered yet.
    undecided: VecDeque<Grab<P>>,
    pub(super) settling: Settling<P>,
    pub(super) pictures: Pictures<P>,
    probe: Option<Probe>,
    /// A probe was sent, and no request after it.
    ends_with_probe: bool,
    unclear: u32,
    pub(super) tally: Tally,
}

impl<P: Scene> Sequence<P> {
    /// A block of this many ticks with a probe after each `segment`.
    pub(super) fn new(
        ticks: u32,
        segment: u32,
        settle_frames: u32,
        known: Known,
        probe_place: ProbePlace,
    ) -> Self {
        Self {
            ticks,
            segment: segment.max(1),
            settle_frames: u64::from(settle_frames.max(1)),
            probe_place,
            known,
            phase: Phase::Settling,
            requests: Requests::new(ticks),
            numbers: Numbers::new(known.numbers_repeat),
            undecided: VecDeque::new(),
            settling: Settling::new(),
            pictures: Pictures::new(),
            probe: None,
            ends_with_probe: false,
            unclear: 0,
            tally: Tally::default(),
        }
    }

    /// The next request to send, if one may be sent now.
    pub(super) fn next_show(&mut self) -> Option<Show> {
        if let Some(show) = self.requests.send_second() {
            return Some(show);
        }
        let show = match self.choose() {
            // An aircraft in a wrong place must not stay.
            None if self.ends_with_probe => Show::Tick(self.requests.last_tick()),
            chosen => chosen?,
        };
        self.ends_with_probe = matches!(show, Show::Probe(_));
        let is_held = self.phase == Phase::Moving && self.numbers.are_late();
        let is_held = is_held && !self.ends_with_probe;
        self.requests.send(show, is_held);
        Some(show)
    }

    fn choose(&mut self) -> Option<Show> {
        match self.phase {
            Phase::Settling => {
                let is_first = self.requests.shown.is_empty() && !self.requests.is_unanswered();
                is_first.then_some(Show::Tick(0))
            }
            Phase::Probing if self.probe.is_none() => self.new_probe(),
            Phase::Probing => None,
            Phase::Moving => self.next_while_moving(),
            Phase::Held => self.next_while_held(),
        }
    }

    fn next_while_moving(&mut self) -> Option<Show> {
        if self.probe.is_none() && self.is_probe_due() {
            return self.new_probe();
        }
        // Something has to follow a probe, and a new tick is better than an old one once more.
        let lag = self.known.lag.unwrap_or_default();
        if self.requests.is_full(lag) && !self.ends_with_probe {
            return None;
        }
        let has_room = self.pictures.kept.len() < self.most_pictures();
        self.requests.next_tick(has_room)
    }

    fn next_while_held(&mut self) -> Option<Show> {
        if self.requests.is_under_way() || self.probe.is_some() {
            return None;
        }
        let is_due = self.requests.since_probe >= self.segment;
        if is_due && self.pictures.delivered + 1 < self.ticks {
            return self.new_probe();
        }
        let tick = self.requests.next_tick(self.pictures.kept.is_empty());
        self.tally.held += u32::from(tick.is_some());
        tick
    }

    /// Most images that are kept: a segment, and half of the next one while a probe proves the first.
    fn most_pictures(&self) -> usize {
        (self.segment + self.segment / 2) as usize
    }

    fn is_probe_due(&self) -> bool {
        let is_under_way = self.requests.is_under_way();
        let are_all_shown = self.requests.are_all_shown();
        if is_under_way && are_all_shown {
            // The last probe follows the last tick at once, if it will be seen.
            return self.tally.unseen == 0 && (self.probe_place)(self.ticks - 1).is_some();
        }
        let has_no_room = self.pictures.kept.len() >= self.most_pictures();
        let has_no_room = has_no_room && self.requests.again.is_empty();
        let is_waiting = !is_under_way && (are_all_shown || has_no_room);
        let is_due = self.requests.since_probe >= self.segment || is_waiting;
        is_due && !self.pictures.are_proven()
    }

    /// A probe, if the aircraft is in the image; else what follows from not seeing it.
    fn new_probe(&mut self) -> Option<Show> {
        self.requests.since_probe = 0;
        let tick = self.requests.last_tick();
        if let Some(patch) = (self.probe_place)(tick) {
            let expected = self.known.lag.filter(|_| self.phase == Phase::Moving);
            self.probe = Some(Probe::new(patch, expected));
            return Some(Show::Probe(tick));
        }
        let shown = self.requests.shown.keys().next_back().copied();
        let grabbed = self.pictures.kept.values().filter_map(|taken| taken.grab);
        let now = grabbed.chain(shown).max().unwrap_or(0);
        self.told(now, Outcome::Unseen);
        // It has changed the phase, or proven images.
        self.choose()
    }

    /// The oldest unanswered request was written in a frame.
    pub(super) fn answered(&mut self, frame: u64) {
        match (self.requests.answered(frame), self.phase) {
            (Some(Show::Tick(tick)), Phase::Moving | Phase::Held) if !self.pictures.has(tick) => {
                self.requests.unseen.insert(frame, tick);
            }
            (Some(Show::Probe(_)), _) => {
                self.probe
                    .iter_mut()
                    .for_each(|probe| probe.written_in(frame));
            }
            _ => {}
        }
        self.decide();
    }

    /// A number was seen, `steady` frames after a doubtful one, maybe with a grab of its frame.
    pub(super) fn seen(&mut self, number: u64, steady: u32, picture: Option<P>) {
        let (grab, are_late) = self.numbers.see(number, steady, picture);
        self.undecided.extend(grab);
        if are_late && self.phase == Phase::Moving {
            self.forget_unproven();
            self.phase = Phase::Probing;
        }
        self.decide();
    }

    /// Takes the grabs of which every request that they may show has been answered.
    fn decide(&mut self) {
        while let Some(grab) = self.undecided.pop_front() {
            let newest = self.newest_frame(grab.number);
            if !self.requests.is_answered_up_to(newest) {
                return self.undecided.push_front(grab);
            }
            self.take(grab);
        }
    }

    /// Minimum and maximum frames by which a grab's scene is behind its number, if that is its own frame's.
    fn frames_behind(&self) -> (u64, u64) {
        let lag = match self.phase {
            Phase::Moving => self.known.lag,
            Phase::Settling => self.known.first_lag(),
            Phase::Probing | Phase::Held => None,
        };
        lag.map_or((0, self.settle_frames), |lag| (lag, lag))
    }

    /// The newest frame whose scene a grab may show.
    fn newest_frame(&self, number: u64) -> u64 {
        let (least, _) = self.frames_behind();
        (number + self.numbers.stale_frames).saturating_sub(least)
    }

    /// Content that a grab shows for certain, and the frame since which it has been shown.
    fn content(&self, grab: &Grab<P>) -> Option<(u64, Show)> {
        let (_, most) = self.frames_behind();
        let newest = self.newest_frame(grab.number);
        let (since, show) = self.requests.shown.range(..=newest).next_back()?;
        let is_whole = grab.steady >= most.min(MAX_STEADY) && *since + most <= grab.number;
        is_whole.then_some((*since, *show))
    }

    fn take(&mut self, mut grab: Grab<P>) {
        if let Some(picture) = grab.picture.take() {
            self.take_picture(&grab, picture);
        }
        // Ticks that no later grab can show are shown again.
        self.tally.repeated += self.requests.miss(self.newest_frame(grab.number));
        if let Some((frame, outcome)) = self.probe.as_ref().and_then(Probe::outcome) {
            self.probe = None;
            match (self.phase, outcome) {
                // The lag holds up to the grab that shows the probe; if none does, it may have fallen meanwhile.
                (Phase::Moving, Outcome::Behind(lag)) => self.told(frame + lag, outcome),
                // An aircraft that was seen does not disappear: the scene may be further behind than a probe can measure.
                (_, Outcome::Unseen) if self.tally.seen > 0 => self.told(frame, Outcome::Unclear),
                // What moved behind it at that moment may have hidden the first one.
                (Phase::Probing, Outcome::Unseen)
                    if self.known.lag.is_none() && !self.settling.came_to_rest =>
                {
                    self.told(frame, Outcome::Unclear);
                }
                _ => self.told(frame, outcome),
            }
        }
    }

    fn take_picture(&mut self, grab: &Grab<P>, picture: P) {
        if let Some(probe) = &mut self.probe {
            probe.see(grab.number, picture.part(probe.patch));
        }
        match (self.phase, self.content(grab)) {
            (Phase::Settling, Some((since, Show::Tick(_)))) => {
                let is_time = grab.steady >= self.settle_frames.min(MAX_STEADY)
                    && since + self.settle_frames <= grab.number;
                let moves = self.known.scene_moves;
                if self
                    .settling
                    .see(picture, P::is_settled_after, is_time, moves)
                {
                    let is_known = self.known.first_lag().is_some();
                    self.phase = if is_known {
                        Phase::Moving
                    } else {
                        Phase::Probing
                    };
                }
            }
            (Phase::Moving | Phase::Held, Some((frame, Show::Tick(tick))))
                if self.requests.take_unseen(frame) && !self.pictures.has(tick) =>
            {
                let grab = (self.phase == Phase::Moving).then_some(grab.number);
                let taken = Taken {
                    frame,
                    picture,
                    grab,
                };
                self.pictures.kept.insert(tick, taken);
            }
            _ => {}
        }
    }

    /// Applies a probe's outcome to the frames around it.
    fn told(&mut self, frame: u64, outcome: Outcome) {
        self.tally.seen += u32::from(matches!(outcome, Outcome::Behind(_)));
        self.tally.unseen += u32::from(outcome == Outcome::Unseen);
        self.unclear = u32::from(outcome == Outcome::Unclear) * (self.unclear + 1);
        match (self.phase, outcome) {
            (_, Outcome::Unclear) if self.unclear >= MAX_UNCLEAR => self.hold_every_tick(),
            (Phase::Moving, Outcome::Unclear) => {
                self.requests.since_probe = self.segment;
                // One of them may show the displaced aircraft.
                let grabs = frame.saturating_sub(1)..=frame + MAX_LAG + 1;
                let is_one = |grab: u64| grabs.contains(&grab);
                let doubtful = self
                    .pictures
                    .discard(|picture| picture.grab.is_some_and(is_one));
                self.repeat(doubtful);
            }
            (_, Outcome::Unclear) => {}
            // With late numbers a scene looks less behind than it is.
            (Phase::Moving, Outcome::Behind(found))
                if Some(found) > self.known.lag
                    || Some(found + self.numbers.stale_frames) < self.known.lag =>
            {
                self.tally.changes += 1;
                if self.tally.changes > MAX_CHANGES {
                    self.hold_every_tick();
                } else {
                    self.forget_unproven();
                    self.phase = Phase::Probing;
                }
            }
            (Phase::Moving, _) => self.pictures.confirmed_up_to = frame,
            (_, Outcome::Behind(lag)) => {
                self.known.lag = Some(lag);
                self.move_since(frame);
            }
            (Phase::Held, Outcome::Unseen) => {}
            (_, Outcome::Unseen) if self.known.lag.is_some() => self.move_since(frame),
            (_, Outcome::Unseen) => self.hold_every_tick(),
        }
    }

    fn move_since(&mut self, frame: u64) {
        self.pictures.confirmed_up_to = frame;
        self.requests.since_probe = 0;
        self.phase = Phase::Moving;
    }

    fn hold_every_tick(&mut self) {
        self.forget_unproven();
        self.requests.since_probe = 0;
        self.phase = Phase::Held;
    }

    /// Discards the images taken since the last probe, so that they are taken again.
    fn forget_unproven(&mut self) {
        let unproven = self.pictures.discard_unproven();
        self.repeat(unproven);
        let pictures = &self.pictures;
        self.tally.repeated += self.requests.repeat_all(|tick| pictures.has(tick));
    }

    fn repeat(&mut self, ticks: Vec<u32>) {
        self.tally.repeated += ticks.len() as u32;
        self.requests.again.extend(ticks);
    }

    /// Discards covered grabs from a frame on: their ticks are shown again. Returns true if none was delivered.
    pub(super) fn take_again(&mut self, from_frame: u64) -> bool {
        let covered = (self.pictures).discard(|picture| picture.newest_frame() >= from_frame);
        self.repeat(covered);
        self.numbers.forget_from(from_frame);
        self.undecided.retain(|grab| grab.number < from_frame);
        self.pictures.delivered_grab < from_frame
    }

    /// True while exposure, shadows and loading have not come to rest: images of the same tick still differ.
    pub(super) fn is_settling(&self) -> bool {
        self.phase == Phase::Settling
    }

    /// True if a grab shows the first tick for as long as settling always takes: what still differs then moves by itself.
    pub(super) fn has_had_its_time(&self, number: u64) -> bool {
        let first = self.requests.shown.keys().next();
        first.is_some_and(|first| first + self.settle_frames <= number)
    }

    /// True if the image of every tick has been taken and proven, though perhaps not delivered.
    pub(super) fn is_complete(&self) -> bool {
        let taken = self.pictures.delivered as usize + self.pictures.kept.len();
        taken == self.ticks as usize && self.pictures.are_proven()
    }

    /// True if every tick has been delivered.
    pub(super) fn is_done(&self) -> bool {
        self.pictures.delivered == self.ticks
    }

    /// True if a grab is needed for anything in progress.
    pub(super) fn expects_grabs(&self) -> bool {
        let is_moving = matches!(self.phase, Phase::Moving);
        !is_moving || self.requests.is_under_way() || self.probe.is_some()
    }
}
