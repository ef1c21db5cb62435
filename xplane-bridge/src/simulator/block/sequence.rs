//! The order of a block: the tick to show next, the tick in each grab, and the proven images.
//!
//! Input: the numbers of drawn frames, in which requests were answered, and grabs with their numbers. Output: the images of all ticks in
//! order, each once. No clock, no socket: everything can be replayed in a test.
//!
//! A grab with number m shows the scene of frame m - lag. The lag is measured by probes (`probe.rs`) at both ends of a block and between
//! its segments, and has to be the same each time: images count once the next probe has measured their lag. A view whose last block ended
//! with a probe begins the next block with that lag, which the first probe has to confirm.
//!
//! A number may be shown again under a later frame's scene. That frame's own number then never appears, so a grab counts only if the number
//! after its own was seen next. If a number was seen over two scenes, or many are missing, each tick is shown in two frames, and a grab
//! counts only if both frames that it may show have the same tick.

use std::collections::{BTreeMap, VecDeque};
use std::mem;

use super::probe::{MAX_LAG, Outcome, Probe};
use crate::pixels::Rectangle;

/// Requests that are shown but not seen yet, at most: enough to use every drawn frame.
const MAX_UNSEEN: usize = 6;
/// Images without a loss after which one more may be in flight.
const WIDEN_AFTER: u32 = 32;
/// Grabs in a row without a change before a scene counts as settled.
const EQUAL_GRABS: u32 = 3;
/// Numbers that were seen over two scenes before every tick is shown in two frames; one may be a cover that came during a frame.
const REPEATED_NUMBERS: u32 = 2;
/// Grabs over which missing numbers are counted, and the number of them at which every tick is shown in two frames.
const COUNTED_GRABS: u32 = 60;
const MANY_MISSING: u32 = 20;
/// Grabs in a row without the number after theirs: none will come.
const MAX_REFUSED: u32 = 240;
/// The code counts steady frames up to this number.
const MAX_STEADY: u64 = 7;
/// Probes in a row that are unclear, and changes of the lag in a block, before every tick is held.
const MAX_UNCLEAR: u32 = 12;
const MAX_CHANGES: u32 = 3;

/// The parts of an image that the order of a block depends on.
pub(super) trait Scene {
    /// Bytes of a rectangle.
    fn part(&self, area: Rectangle) -> Vec<u8>;

    /// True if exposure, shadows and loading have come to rest since an earlier image of the same tick.
    fn is_settled_after(&self, before: &Self) -> bool;

    /// True if it is the same to the last bit: another grab of the same frame.
    fn is_same_as(&self, other: &Self) -> bool;
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Show {
    /// A tick of the block.
    Tick(u32),
    /// The tick with the aircraft displaced.
    Probe(u32),
}

/// A tick's image.
#[derive(Debug)]
pub(super) struct Taken<P> {
    /// The frame in which the tick was written.
    pub(super) frame: u64,
    pub(super) picture: P,
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
    /// Numbers that were seen over two scenes.
    pub(super) repeated_numbers: u32,
}

/// What is known of a view before its block.
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
    Settling { equal: u32 },
    /// A tick is held while a probe is watched.
    Probing,
    /// Every drawn frame shows the next tick.
    Moving { lag: u64 },
    /// Every tick is held until it has settled.
    Held,
}

#[derive(Debug)]
struct Grab<P> {
    number: u64,
    steady: u64,
    picture: P,
}

#[derive(Debug)]
struct Unproven<P> {
    taken: Taken<P>,
    /// The grab that showed it, if a probe has to confirm it.
    grab: Option<u64>,
}

impl<P> Unproven<P> {
    /// The newest frame whose drawing the image may show.
    fn newest_frame(&self) -> u64 {
        self.grab.unwrap_or(self.taken.frame)
    }

    /// True if its tick is certain, with the lag confirmed up to a grab.
    fn is_proven(&self, confirmed_up_to: u64) -> bool {
        self.grab.is_none_or(|grab| grab <= confirmed_up_to)
    }
}

/// A request that was sent.
#[derive(Debug, Clone, Copy)]
struct Sent {
    show: Show,
    /// True if the request before it was the same, to hold its tick for a second frame.
    is_second: bool,
}

/// A block that is being recorded.
pub(super) struct Sequence<P> {
    ticks: u32,
    /// Ticks between two probes.
    segment: u32,
    settle_frames: u64,
    probe_place: ProbePlace,
    known: Known,
    phase: Phase,
    /// The next tick that was never shown, and those to show again.
    next_tick: u32,
    again: VecDeque<u32>,
    delivered: u32,
    /// Newest grab with a delivered image.
    delivered_grab: u64,
    since_probe: u32,
    /// Sent and not answered yet.
    sent: VecDeque<Sent>,
    /// The tick to be sent once more.
    second: Option<Show>,
    /// The frame of the last answer.
    answered_up_to: u64,
    /// Frames by which a number may be older than its frame: 0, or 1 if numbers were repeated. Each tick is shown in one frame more.
    stale_frames: u64,
    /// The last grab, until the number after it is seen, and the last number.
    newest: Option<Grab<P>>,
    newest_number: u64,
    /// Grabs whose successor was missing: in a row, and among the last ones.
    refused: u32,
    counted: (u32, u32),
    /// True if the scene was watched for long enough to know how it moves.
    has_watched: bool,
    /// True if equal grabs ended the settling.
    came_to_rest: bool,
    /// Content shown from each frame on.
    shown: BTreeMap<u64, Show>,
    /// Answered ticks without an image, by frame.
    unseen: BTreeMap<u64, u32>,
    most_unseen: usize,
    without_loss: u32,
    undecided: VecDeque<Grab<P>>,
    last_settling: Option<P>,
    probe: Option<Probe>,
    /// A probe was sent, and no request after it.
    ends_with_probe: bool,
    /// A probe was due whose aircraft is not in the image.
    has_skipped_probe: bool,
    unclear: u32,
    confirmed_up_to: u64,
    pictures: BTreeMap<u32, Unproven<P>>,
    spent: Vec<P>,
    tally: Tally,
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
            phase: Phase::Settling { equal: 0 },
            next_tick: 0,
            again: VecDeque::new(),
            delivered: 0,
            delivered_grab: 0,
            since_probe: 0,
            sent: VecDeque::new(),
            second: None,
            answered_up_to: 0,
            stale_frames: u64::from(known.numbers_repeat),
            newest: None,
            newest_number: 0,
            refused: 0,
            counted: (0, 0),
            has_watched: false,
            came_to_rest: false,
            shown: BTreeMap::new(),
            unseen: BTreeMap::new(),
            most_unseen: MAX_UNSEEN,
            without_loss: 0,
            undecided: VecDeque::new(),
            last_settling: None,
            probe: None,
            ends_with_probe: false,
            has_skipped_probe: false,
            unclear: 0,
            confirmed_up_to: 0,
            pictures: BTreeMap::new(),
            spent: Vec::new(),
            tally: Tally::default(),
        }
    }

    /// True if every tick is shown in two frames.
    pub(super) fn shows_two_frames(&self) -> bool {
        self.stale_frames > 0
    }

    /// Sets that the scene was watched for long enough to know how it moves. One that moves never comes to rest.
    pub(super) fn set_has_watched(&mut self, has_watched: bool) {
        self.has_watched = has_watched;
    }

    /// True if hardly any number is followed by the next one, so that no grab counts.
    pub(super) fn is_hopeless(&self) -> bool {
        self.refused >= MAX_REFUSED
    }

    /// The next request to send, if one may be sent now.
    pub(super) fn next_show(&mut self) -> Option<Show> {
        if let Some(show) = self.second.take() {
            self.sent.push_back(Sent {
                show,
                is_second: true,
            });
            return Some(show);
        }
        let mut show = self.choose();
        // A probe that cannot be shown changes the phase, or proves images: then there may be something else to show.
        while show.is_none() && mem::take(&mut self.has_skipped_probe) {
            show = self.choose();
        }
        // An aircraft in a wrong place must not stay.
        let show = show.or_else(|| {
            let tick = self.next_tick.saturating_sub(1);
            self.ends_with_probe.then_some(Show::Tick(tick))
        })?;
        self.ends_with_probe = matches!(show, Show::Probe(_));
        self.sent.push_back(Sent {
            show,
            is_second: false,
        });
        let is_held = self.stale_frames > 0 && !self.ends_with_probe;
        self.second = (is_held && matches!(self.phase, Phase::Moving { .. })).then_some(show);
        Some(show)
    }

    fn choose(&mut self) -> Option<Show> {
        match self.phase {
            Phase::Settling { .. } if self.shown.is_empty() && self.sent.is_empty() => {
                Some(Show::Tick(0))
            }
            Phase::Settling { .. } => None,
            Phase::Probing if self.probe.is_none() => self.new_probe(),
            Phase::Probing => None,
            Phase::Moving { .. } => self.next_while_moving(),
            Phase::Held => self.next_while_held(),
        }
    }

    fn next_while_moving(&mut self) -> Option<Show> {
        if self.probe.is_none() && self.is_probe_due() {
            return self.new_probe();
        }
        let sent = self.sent.iter().filter(|sent| !sent.is_second);
        let under_way = sent.count() + self.unseen.len();
        // Something has to follow a probe, and a new tick is better than an old one once more.
        if under_way >= self.most_unseen && !self.ends_with_probe {
            return None;
        }
        self.next_tick(self.pictures.len() < self.most_pictures())
    }

    fn next_while_held(&mut self) -> Option<Show> {
        if !self.sent.is_empty() || !self.unseen.is_empty() || self.probe.is_some() {
            return None;
        }
        if self.since_probe >= self.segment && self.delivered + 1 < self.ticks {
            return self.new_probe();
        }
        let tick = self.next_tick(self.pictures.is_empty());
        self.tally.held += u32::from(tick.is_some());
        tick
    }

    /// Most images that are kept: a segment, and half of the next one while a probe proves the first.
    fn most_pictures(&self) -> usize {
        (self.segment + self.segment / 2) as usize
    }

    fn next_tick(&mut self, has_room: bool) -> Option<Show> {
        if let Some(tick) = self.again.pop_front() {
            return Some(Show::Tick(tick));
        }
        (has_room && self.next_tick < self.ticks).then(|| {
            self.next_tick += 1;
            self.since_probe += 1;
            Show::Tick(self.next_tick - 1)
        })
    }

    fn is_probe_due(&self) -> bool {
        let confirmed = self.confirmed_up_to;
        let is_unproven = !(self.pictures.values()).all(|picture| picture.is_proven(confirmed));
        let is_under_way = !self.sent.is_empty() || !self.unseen.is_empty();
        let are_all_shown = self.next_tick == self.ticks && self.again.is_empty();
        if is_under_way && are_all_shown {
            // The last probe follows the last tick at once, if it will be seen.
            return self.tally.unseen == 0 && (self.probe_place)(self.ticks - 1).is_some();
        }
        let has_no_room = self.again.is_empty() && self.pictures.len() >= self.most_pictures();
        let is_waiting = !is_under_way && (are_all_shown || has_no_room);
        is_unproven && (self.since_probe >= self.segment || is_waiting)
    }

    /// A probe, if the aircraft is in the image; else what follows from not seeing it.
    fn new_probe(&mut self) -> Option<Show> {
        self.since_probe = 0;
        let tick = self.next_tick.saturating_sub(1);
        if let Some(patch) = (self.probe_place)(tick) {
            let expected = match self.phase {
                Phase::Moving { lag } => Some(lag),
                Phase::Settling { .. } | Phase::Probing | Phase::Held => None,
            };
            self.probe = Some(Probe::new(patch, expected));
            return Some(Show::Probe(tick));
        }
        let now = self.shown.keys().next_back().copied().unwrap_or(0);
        let newest = self
            .pictures
            .values()
            .filter_map(|picture| picture.grab)
            .max();
        self.told(now.max(newest.unwrap_or(0)), Outcome::Unseen);
        self.has_skipped_probe = true;
        None
    }

    /// The oldest unanswered request was written in a frame.
    pub(super) fn answered(&mut self, frame: u64) {
        let Some(Sent { show, is_second }) = self.sent.pop_front() else {
            return;
        };
        self.answered_up_to = frame;
        if is_second {
            return self.decide();
        }
        self.shown.insert(frame, show);
        match show {
            Show::Tick(tick) => {
                let has_picture = tick < self.delivered || self.pictures.contains_key(&tick);
                if !has_picture && !matches!(self.phase, Phase::Settling { .. } | Phase::Probing) {
                    self.unseen.insert(frame, tick);
                }
            }
            Show::Probe(_) => {
                if let Some(probe) = &mut self.probe {
                    probe.written_in(frame);
                }
            }
        }
        self.decide();
    }

    /// A number was seen, `steady` frames after a doubtful one, maybe with a grab of its frame.
    pub(super) fn seen(&mut self, number: u64, steady: u32, picture: Option<P>) {
        if number <= self.newest_number {
            self.seen_again(number, picture);
            return;
        }
        if let Some(grab) = self.newest.take() {
            if number <= grab.number + 1 + self.stale_frames {
                self.refused = 0;
                self.count(false);
                self.undecided.push_back(grab);
            } else {
                self.refused += 1;
                self.count(true);
                self.refuse(grab);
            }
        }
        self.newest_number = number;
        self.newest = picture.map(|picture| Grab {
            number,
            steady: u64::from(steady),
            picture,
        });
        self.decide();
    }

    /// The last number, or an older one, is shown once more.
    fn seen_again(&mut self, number: u64, picture: Option<P>) {
        let is_other = |picture: &P| {
            let grab = self.newest.as_ref();
            grab.is_some_and(|grab| !picture.is_same_as(&grab.picture))
        };
        let is_repeated = number < self.newest_number || picture.as_ref().is_some_and(is_other);
        self.spent.extend(picture);
        if !is_repeated {
            return;
        }
        self.tally.repeated_numbers += 1;
        if let Some(grab) = self.newest.take() {
            self.refuse(grab);
        }
        // What two frames of each tick are for.
        if self.stale_frames > 0 {
            return;
        }
        // The numbers may be late from now on, as if the scene were ahead.
        self.measure_anew();
        if self.tally.repeated_numbers >= REPEATED_NUMBERS {
            self.show_two_frames();
        }
    }

    fn measure_anew(&mut self) {
        if let Phase::Moving { .. } = self.phase {
            self.forget_unproven();
            self.phase = Phase::Probing;
        }
    }

    fn refuse(&mut self, grab: Grab<P>) {
        self.spent.push(grab.picture);
        if self.is_certain(grab.number) && self.undecided.is_empty() {
            self.miss(grab.number);
        }
    }

    fn count(&mut self, is_missing: bool) {
        let (grabs, missing) = self.counted;
        self.counted = (grabs + 1, missing + u32::from(is_missing));
        if self.counted.0 == COUNTED_GRABS {
            if self.counted.1 >= MANY_MISSING {
                self.show_two_frames();
            }
            self.counted = (0, 0);
        }
    }

    /// From now on every tick is shown in two frames, and what is not proven yet is shown again.
    fn show_two_frames(&mut self) {
        if self.stale_frames > 0 {
            return;
        }
        self.stale_frames = 1;
        self.measure_anew();
    }

    fn decide(&mut self) {
        while let Some(grab) = self.undecided.pop_front() {
            if !self.is_certain(grab.number) {
                self.undecided.push_front(grab);
                return;
            }
            self.take(grab);
        }
        let oldest = self.shown.keys().rev().nth(2 * MAX_UNSEEN + 16).copied();
        if let Some(oldest) = oldest {
            self.shown = self.shown.split_off(&oldest);
        }
    }

    /// True if every request that a grab may show has been answered.
    fn is_certain(&self, number: u64) -> bool {
        self.sent.is_empty() || self.answered_up_to >= self.newest_frame(number)
    }

    /// Minimum and maximum frames by which a grab's scene is behind its number, if that is its own frame's.
    fn frames_behind(&self) -> (u64, u64) {
        match (self.phase, self.known.first_lag()) {
            (Phase::Moving { lag }, _) | (Phase::Settling { .. }, Some(lag)) => (lag, lag),
            _ => (0, self.settle_frames),
        }
    }

    /// The newest frame whose scene a grab may show.
    fn newest_frame(&self, number: u64) -> u64 {
        let (least, _) = self.frames_behind();
        (number + self.stale_frames).saturating_sub(least)
    }

    /// Content that a grab shows for certain, and the frame since which it has been shown.
    fn content(&self, grab: &Grab<P>) -> Option<(u64, Show)> {
        let (_, most) = self.frames_behind();
        let newest = self.newest_frame(grab.number);
        let (since, show) = self.shown.range(..=newest).next_back()?;
        let is_whole = grab.steady >= most.min(MAX_STEADY) && *since + most <= grab.number;
        is_whole.then_some((*since, *show))
    }

    fn take(&mut self, grab: Grab<P>) {
        if let Some(probe) = &mut self.probe {
            probe.see(grab.number, grab.picture.part(probe.patch));
        }
        let number = grab.number;
        match (self.phase, self.content(&grab)) {
            (Phase::Settling { equal }, Some((since, Show::Tick(_)))) => {
                let is_time = grab.steady >= self.settle_frames.min(MAX_STEADY)
                    && since + self.settle_frames <= number;
                self.settle(grab.picture, is_time, equal);
            }
            (Phase::Moving { .. } | Phase::Held, Some((since, Show::Tick(tick)))) => {
                self.keep(number, since, tick, grab.picture);
            }
            _ => self.spent.push(grab.picture),
        }
        self.miss(number);
        if let Some((frame, outcome)) = self.probe.as_ref().and_then(Probe::outcome) {
            self.probe = None;
            // An aircraft that was seen does not disappear: the scene may be further behind than a probe can measure.
            let is_doubtful = outcome == Outcome::Unseen && self.tally.seen > 0;
            // The lag holds up to the grab that shows the probe; if none does, it may have fallen meanwhile.
            let up_to = match (self.phase, outcome) {
                (Phase::Moving { .. }, Outcome::Behind(lag)) => frame + lag,
                _ => frame,
            };
            self.told(
                up_to,
                if is_doubtful {
                    Outcome::Unclear
                } else {
                    outcome
                },
            );
        }
    }

    /// Compares a grab with the one before. A scene has not settled before `is_time`: when the frames to settle have passed.
    fn settle(&mut self, picture: P, is_time: bool, equal: u32) {
        let is_equal = self
            .last_settling
            .as_ref()
            .is_some_and(|before| picture.is_settled_after(before));
        let equal = if is_equal { equal + 1 } else { 0 };
        self.spent.extend(self.last_settling.replace(picture));
        let is_at_rest = equal >= EQUAL_GRABS && !self.known.scene_moves;
        self.phase = if is_time && (is_at_rest || self.has_watched) {
            self.came_to_rest = is_at_rest;
            self.spent.extend(self.last_settling.take());
            match self.known.first_lag() {
                Some(lag) => Phase::Moving { lag },
                None => Phase::Probing,
            }
        } else {
            Phase::Settling { equal }
        };
    }

    fn keep(&mut self, grab: u64, since: u64, tick: u32, picture: P) {
        let is_known = tick < self.delivered || self.pictures.contains_key(&tick);
        if self.unseen.remove(&since).is_none() || is_known {
            self.spent.push(picture);
            return;
        }
        self.without_loss += 1;
        if self.without_loss >= WIDEN_AFTER && self.most_unseen < MAX_UNSEEN {
            self.without_loss = 0;
            self.most_unseen += 1;
        }
        let taken = Taken {
            frame: since,
            picture,
        };
        let grab = matches!(self.phase, Phase::Moving { .. }).then_some(grab);
        self.pictures.insert(tick, Unproven { taken, grab });
    }

    /// Ticks that no later grab can show are shown again.
    fn miss(&mut self, number: u64) {
        let newest = self.newest_frame(number);
        let is_past = |since: &u64| {
            let next = self.shown.range(since + 1..).next();
            next.is_some_and(|(next, _)| newest + 1 >= *next)
        };
        let past: Vec<u64> = self
            .unseen
            .keys()
            .copied()
            .filter(|since| is_past(since))
            .collect();
        for since in past {
            if let Some(tick) = self.unseen.remove(&since) {
                self.again.push_back(tick);
                self.tally.repeated += 1;
                self.most_unseen = (self.most_unseen / 2).max(1);
                self.without_loss = 0;
            }
        }
    }

    /// Applies a probe's outcome to the frames around it.
    fn told(&mut self, frame: u64, outcome: Outcome) {
        match outcome {
            Outcome::Behind(_) => self.tally.seen += 1,
            Outcome::Unseen => self.tally.unseen += 1,
            Outcome::Unclear => {}
        }
        self.unclear = if outcome == Outcome::Unclear {
            self.unclear + 1
        } else {
            0
        };
        match (self.phase, outcome) {
            (_, Outcome::Unclear) if self.unclear >= MAX_UNCLEAR => self.hold_every_tick(),
            (Phase::Moving { .. }, Outcome::Unclear) => {
                self.since_probe = self.segment;
                // One of them may show the displaced aircraft.
                let grabs = frame.saturating_sub(1)..=frame + MAX_LAG + 1;
                self.discard(|picture| picture.grab.is_some_and(|grab| grabs.contains(&grab)));
            }
            (_, Outcome::Unclear) => {}
            // With late numbers a scene looks less behind than it is.
            (Phase::Moving { lag }, Outcome::Behind(found))
                if found > lag || found + self.stale_frames < lag =>
            {
                self.tally.changes += 1;
                self.forget_unproven();
                if self.tally.changes > MAX_CHANGES {
                    self.hold_every_tick();
                } else {
                    self.phase = Phase::Probing;
                }
            }
            (Phase::Moving { .. }, _) => self.confirmed_up_to = frame,
            (_, Outcome::Behind(lag)) => {
                self.known.lag = Some(lag);
                self.move_with(lag, frame);
            }
            (Phase::Held, Outcome::Unseen) => {}
            (_, Outcome::Unseen) => match self.known.lag {
                Some(lag) => self.move_with(lag, frame),
                None => self.hold_every_tick(),
            },
        }
    }

    fn move_with(&mut self, lag: u64, since: u64) {
        self.confirmed_up_to = since;
        self.since_probe = 0;
        self.phase = Phase::Moving { lag };
    }

    fn hold_every_tick(&mut self) {
        self.forget_unproven();
        self.since_probe = 0;
        self.phase = Phase::Held;
    }

    /// Discards the images taken since the last probe, so that they are taken again.
    fn forget_unproven(&mut self) {
        self.second = None;
        let confirmed = self.confirmed_up_to;
        self.discard(|picture| !picture.is_proven(confirmed));
        let counted = self.again.len();
        let unseen = mem::take(&mut self.unseen).into_values();
        let sent = self.sent.iter().filter_map(|sent| match sent.show {
            Show::Tick(tick) => Some(tick),
            Show::Probe(_) => None,
        });
        let mut again: Vec<u32> = unseen.chain(sent).chain(self.again.drain(..)).collect();
        again.retain(|tick| *tick >= self.delivered && !self.pictures.contains_key(tick));
        again.sort_unstable();
        again.dedup();
        self.tally.repeated += again.len().saturating_sub(counted) as u32;
        self.again = again.into();
    }

    /// Discards some images: their ticks are shown again.
    fn discard(&mut self, is_doubtful: impl Fn(&Unproven<P>) -> bool) {
        let doubtful = self
            .pictures
            .extract_if(.., |_, picture| is_doubtful(picture));
        for (tick, picture) in doubtful {
            self.again.push_back(tick);
            self.tally.repeated += 1;
            self.spent.push(picture.taken.picture);
        }
    }

    /// Discards covered grabs from a frame on: their ticks are shown again. Returns true if none was delivered.
    pub(super) fn take_again(&mut self, from_frame: u64) -> bool {
        self.discard(|picture| picture.newest_frame() >= from_frame);
        let newest = self.newest.take_if(|grab| grab.number >= from_frame);
        self.spent.extend(newest.map(|grab| grab.picture));
        let undecided = mem::take(&mut self.undecided).into_iter();
        let (covered, clear): (VecDeque<_>, VecDeque<_>) =
            undecided.partition(|grab| grab.number >= from_frame);
        self.undecided = clear;
        self.spent
            .extend(covered.into_iter().map(|grab| grab.picture));
        self.delivered_grab < from_frame
    }

    /// The next image, in the order of the ticks, once it is proven.
    pub(super) fn deliver(&mut self) -> Option<Taken<P>> {
        let first = self.pictures.first_entry()?;
        let is_next = *first.key() == self.delivered;
        let is_proven = first.get().is_proven(self.confirmed_up_to);
        (is_next && is_proven).then(|| {
            self.delivered += 1;
            let picture = first.remove();
            self.delivered_grab = self.delivered_grab.max(picture.newest_frame());
            picture.taken
        })
    }

    /// True while exposure, shadows and loading have not come to rest: images of the same tick still differ.
    pub(super) fn is_settling(&self) -> bool {
        matches!(self.phase, Phase::Settling { .. })
    }

    /// True if a grab shows the first tick for as long as settling always takes: what still differs then moves by itself.
    pub(super) fn has_had_its_time(&self, number: u64) -> bool {
        let first = self.shown.keys().next();
        first.is_some_and(|first| first + self.settle_frames <= number)
    }

    /// True if the scene did not move while it settled.
    pub(super) fn came_to_rest(&self) -> bool {
        self.came_to_rest
    }

    /// Images that are not needed.
    pub(super) fn spent(&mut self) -> Vec<P> {
        mem::take(&mut self.spent)
    }

    /// True if the image of every tick has been taken and proven, though perhaps not delivered.
    pub(super) fn is_complete(&self) -> bool {
        let taken = self.delivered as usize + self.pictures.len();
        let is_proven = |picture: &Unproven<P>| picture.is_proven(self.confirmed_up_to);
        taken == self.ticks as usize && self.pictures.values().all(is_proven)
    }

    /// True if every tick has been delivered.
    pub(super) fn is_done(&self) -> bool {
        self.delivered == self.ticks
    }

    /// True if a request has to be answered before anything else happens.
    pub(super) fn waits_for_answer(&self) -> bool {
        !self.sent.is_empty()
    }

    /// True if a grab is needed for anything in progress.
    pub(super) fn expects_grabs(&self) -> bool {
        let is_idle = self.sent.is_empty() && self.unseen.is_empty() && self.probe.is_none();
        !(is_idle && matches!(self.phase, Phase::Moving { .. }))
    }

    /// The first tick whose image is not proven yet.
    pub(super) fn waits_for_tick(&self) -> u32 {
        self.delivered
    }

    /// The lag that the probes of this block measured, or that was known before.
    pub(super) fn lag(&self) -> Option<u64> {
        self.known.lag
    }

    /// Statistics of the recording.
    pub(super) fn tally(&self) -> Tally {
        self.tally
    }
}

#[cfg(test)]
mod tests;
