//! Groups a view's boxes into tracks, and decides which tracks are aircraft.
//!
//! Input: the boxes of consecutive images, with their times. Output: each box's track number, whether it counts at this moment, and the
//! expected places of the tracked aircraft in the next image. A track begins with any box that belongs to no track; it is confirmed by
//! [`HITS`] clear boxes in [`OUTCOMES`] images. Faint boxes, which are too uncertain to count alone, also begin and continue tracks, but do
//! not confirm them (Zhang et al., "ByteTrack", ECCV 2022). The filter is in [`motion`].
//!
//! ```text
//! image's boxes -> Tracker (bounded memory) -> track, counts now     dtd detect and live
//!                     |  boxes with tracks
//!                     v
//!                  Hindsight (whole video) -> tracks that count      dtd detect, at the end
//! ```
//!
//! With hindsight all boxes on counting tracks do so, including the first ones.

mod hindsight;
mod history;
mod lamps;
mod motion;
mod standing;

use std::ops::Range;

use dataset::tables::pixel_box::PixelBox;

pub(crate) use hindsight::{Hindsight, TrackedBox};
use history::History;
use motion::Motion;
use standing::{GROWTH_SHOWS_S, MAX_STILL_S, has_stood_still, hops};

/// Version of the rules, in the detections' record. Detections by different versions are repeated.
pub(crate) const METHOD: u32 = 2;
/// Clear boxes that confirm a track...
const HITS: u32 = 3;
/// ... within this number of consecutive images that were searched for it.
const OUTCOMES: u32 = 5;
/// Maximum squared distance from the expected box. 18.5 leaves out one box in a thousand if all errors are normal; box errors have longer
/// tails.
const GATE: f64 = 30.0;
/// Maximum squared distance for faint boxes: clutter is more likely than a long tail.
const FAINT_GATE: f64 = 18.5;
/// A confirmed track ends after this number of consecutive images without a box...
const MAX_MISSES: u32 = 5;
/// ... and this time without a box, s.
const MAX_GAP_S: f64 = 2.0;
/// Minimum duration of aircraft tracks, s: at 30 images per second a patch of cloud looks like an aircraft in three images, and is
/// still there in the next ones.
const MIN_TRACK_S: f64 = 2.0;

/// Tracker for a single view.
#[derive(Debug)]
pub(crate) struct Tracker {
    hits: u32,
    followed: Vec<Track>,
    next: u32,
    now_s: f64,
}

/// An aircraft, or what may be one.
#[derive(Debug)]
struct Track {
    number: u32,
    motion: Motion,
    /// Last images that were searched for it, the newest in the lowest bit: 1 with a box, and before the first one.
    outcomes: u32,
    /// The same bits: 1 with a clear box.
    clear: u32,
    misses: u32,
    history: History,
}

/// A box that was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct FoundBox {
    pub(crate) pixel_box: PixelBox,
    /// Too uncertain to count alone.
    pub(crate) is_faint: bool,
}

/// An aircraft that is followed, as expected at the time of [`Tracker::advance`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ExpectedBox {
    pub(crate) track: u32,
    pub(crate) pixel_box: PixelBox,
    /// Maximum motion between two images, in box lengths.
    pub(crate) lengths_moved: f64,
    pub(crate) is_confirmed: bool,
}

/// Searched parts of the image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum SearchedParts<'a> {
    Everywhere,
    /// Only the expected places of these tracks, and these rows.
    Around(&'a [u32], &'a Range<u32>),
}

impl SearchedParts<'_> {
    /// True if all of the image at the height of this box was searched.
    fn has_row_of(self, pixel_box: &PixelBox) -> bool {
        match self {
            Self::Everywhere => true,
            Self::Around(_, rows) => {
                (f64::from(rows.start)..f64::from(rows.end)).contains(&pixel_box.cy_px)
            }
        }
    }
}

impl Tracker {
    /// For a view with this number of images. If it has fewer than [`HITS`], a box in each confirms a track.
    pub(crate) fn of_pictures(pictures: usize) -> Self {
        Self {
            hits: HITS.min(u32::try_from(pictures).unwrap_or(HITS)),
            followed: Vec::new(),
            next: 0,
            now_s: 0.0,
        }
    }

    pub(crate) fn endless() -> Self {
        Self::of_pictures(usize::MAX)
    }

    /// Goes on to the next image, `seconds` after the last one.
    pub(crate) fn advance(&mut self, seconds: f64) {
        self.now_s += seconds;
        for track in &mut self.followed {
            track.motion.advance(seconds);
        }
    }

    /// Time of the image since the first one, seconds.
    pub(crate) fn now_s(&self) -> f64 {
        self.now_s
    }

    /// The expected places of the tracked aircraft: confirmed ones first, then by the beginning of their tracks. Tracks with only faint
    /// boxes lately are left out. `period_s`: time between two images, seconds.
    pub(crate) fn expected(&self, period_s: f64) -> Vec<ExpectedBox> {
        let mut expected: Vec<_> = self
            .followed
            .iter()
            .filter(|track| track.history.is_confirmed() || hits_in(track.clear) > 0)
            .map(|track| ExpectedBox {
                track: track.number,
                pixel_box: track.motion.expected(),
                lengths_moved: track.motion.lengths_moved(period_s),
                is_confirmed: track.history.is_confirmed(),
            })
            .collect();
        expected.sort_by_key(|expected| !expected.is_confirmed);
        expected
    }

    /// The expected place of a confirmed aircraft that was in the previous image and is not among these boxes.
    pub(crate) fn lost(&self, boxes: &[FoundBox]) -> Option<PixelBox> {
        let matches = self.matches(boxes, SearchedParts::Everywhere);
        let is_seen = |at: usize| matches.iter().any(|(_, seen)| *seen == at);
        let mut tracks = self.followed.iter().enumerate();
        let lost = tracks
            .find(|(at, track)| track.misses == 0 && track.history.is_confirmed() && !is_seen(*at));
        lost.map(|(_, track)| track.motion.expected())
    }

    /// Takes the boxes that were found at the current time, and returns the tracks that they belong to: none for a faint box that
    /// continues none, unless all of the image there was searched.
    pub(crate) fn take(
        &mut self,
        boxes: &[FoundBox],
        searched: SearchedParts<'_>,
    ) -> Vec<Option<u32>> {
        let mut track_of: Vec<Option<u32>> = vec![None; boxes.len()];
        for (index, at) in self.matches(boxes, searched) {
            let track = &mut self.followed[at];
            let seen = boxes[index];
            track.motion.correct(&seen.pixel_box);
            track_of[index] = Some(track.number);
            track.history.push(self.now_s, &seen);
        }
        let hits = self.hits;
        for track in &mut self.followed {
            let index = track_of
                .iter()
                .position(|number| *number == Some(track.number));
            let found = index.map(|index| boxes[index]);
            let was_looked_for = searched.has_row_of(&track.motion.expected())
                || matches!(searched, SearchedParts::Around(tracks, _) if tracks.contains(&track.number));
            if found.is_some() || was_looked_for {
                track.note(found);
                if hits_in(track.clear) >= hits {
                    track.history.confirm(hits);
                }
            }
        }
        let now_s = self.now_s;
        self.followed.retain(|track| {
            if track.history.is_confirmed() {
                !track.is_gone(now_s)
            } else {
                !track.has_failed(hits) && !has_stood_still(track.history.boxes(), MAX_STILL_S)
            }
        });
        for (track, seen) in track_of.iter_mut().zip(boxes) {
            if track.is_none() && (!seen.is_faint || searched.has_row_of(&seen.pixel_box)) {
                *track = Some(self.begin(*seen));
            }
        }
        track_of
    }

    /// Pairs of boxes and tracks: the closest first, confirmed tracks before all others, and faint boxes last. A lamp's track must not
    /// latch onto an aircraft: a stationary track is either clear or faint, and continued neither by boxes of the other kind nor by distant
    /// ones. Tracks that were never clear are only matched in whole-image searches, because they are not searched for in between.
    fn matches(&self, boxes: &[FoundBox], searched: SearchedParts<'_>) -> Vec<(usize, usize)> {
        let mut pairs = Vec::new();
        for (at, track) in self.followed.iter().enumerate() {
            let history = &track.history;
            let is_confirmed = history.is_confirmed();
            let was_clear = history.was_clear();
            if !was_clear && !searched.has_row_of(&track.motion.expected()) {
                continue;
            }
            for (index, seen) in boxes.iter().enumerate() {
                let distance = track.motion.distance(&seen.pixel_box);
                let (gate, is_other) = if seen.is_faint {
                    (FAINT_GATE, is_confirmed)
                } else {
                    (GATE, !was_clear)
                };
                let is_refused = || {
                    is_other && has_stood_still(history.boxes(), GROWTH_SHOWS_S)
                        || hops(history.boxes(), &seen.pixel_box)
                };
                if distance <= gate && !is_refused() {
                    let order = (seen.is_faint, !is_confirmed, !was_clear);
                    pairs.push((order, distance, index, at));
                }
            }
        }
        pairs.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let mut matches: Vec<(usize, usize)> = Vec::new();
        for (_, _, index, at) in pairs {
            if matches
                .iter()
                .all(|known| known.0 != index && known.1 != at)
            {
                matches.push((index, at));
            }
        }
        matches
    }

    fn begin(&mut self, seen: FoundBox) -> u32 {
        let number = self.next;
        self.next += 1;
        let clear = u32::from(!seen.is_faint);
        let mut history = History::default();
        history.push(self.now_s, &seen);
        if clear >= self.hits {
            history.confirm(self.hits);
        }
        self.followed.push(Track {
            number,
            motion: Motion::starting_at(&seen.pixel_box),
            outcomes: u32::MAX,
            clear,
            misses: 0,
            history,
        });
        number
    }

    /// Time of the first of the clear boxes that confirmed a followed track.
    pub(crate) fn confirmed_s(&self, track: u32) -> Option<f64> {
        self.history(track).and_then(History::confirmed_s)
    }

    /// True if a followed track counts at this moment: it is confirmed, has lasted, and does not stand still.
    pub(crate) fn counts(&self, track: u32) -> bool {
        self.history(track)
            .is_some_and(|history| history.clear_for_s() >= MIN_TRACK_S && !history.is_still())
    }

    fn history(&self, track: u32) -> Option<&History> {
        let found = self.followed.iter().find(|known| known.number == track);
        found.map(|found| &found.history)
    }
}

impl Track {
    fn note(&mut self, found: Option<FoundBox>) {
        let was_found = found.is_some();
        let is_clear = found.is_some_and(|seen| !seen.is_faint);
        self.outcomes = self.outcomes << 1 | u32::from(was_found);
        self.clear = self.clear << 1 | u32::from(is_clear);
        self.misses = if was_found { 0 } else { self.misses + 1 };
    }

    /// True if a confirmed track is no longer searched for.
    fn is_gone(&self, now_s: f64) -> bool {
        let seen_s = self.history.boxes().last().map_or(now_s, |(at_s, _)| *at_s);
        self.misses >= MAX_MISSES && now_s - seen_s >= MAX_GAP_S
    }

    /// True if too few of the last images had a box for a track that is not confirmed.
    fn has_failed(&self, hits: u32) -> bool {
        self.misses > OUTCOMES - HITS || hits_in(self.outcomes) < hits
    }
}

/// Number of the last [`OUTCOMES`] images that had a box.
fn hits_in(outcomes: u32) -> u32 {
    (outcomes & ((1 << OUTCOMES) - 1)).count_ones()
}

#[cfg(test)]
mod tests;
