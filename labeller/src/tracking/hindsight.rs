//! Selects a whole video's tracks that are aircraft, once all boxes are known.
//!
//! Input: the boxes of the [`Tracker`](super::Tracker) with their tracks. Output: true for each track that counts. Only then is it known
//! which tracks stand still at the end, or pass where something stood.

use dataset::tables::pixel_box::PixelBox;

use super::MIN_TRACK_S;
use super::lamps::Places;
use super::standing::{TimedBox, is_mostly_at, is_same_thing, place_if_still, stands_still, stays};

/// Minimum track duration in a video shorter than twice [`MIN_TRACK_S`], as a part of the video.
const MIN_VIDEO_PART: f64 = 0.5;

/// Boxes of all tracks in a view.
#[derive(Debug, Default)]
pub(crate) struct Hindsight {
    tracks: Vec<Whole>,
    /// Times of the first and of the last image.
    began_s: Option<f64>,
    now_s: f64,
}

/// A box with the tracker's results.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct TrackedBox {
    pub(crate) track: u32,
    pub(crate) pixel_box: PixelBox,
    /// Too uncertain to count alone.
    pub(crate) is_faint: bool,
    /// Time of the first of the clear boxes that had confirmed its track by then.
    pub(crate) confirmed_s: Option<f64>,
}

/// A track.
#[derive(Debug, Default)]
struct Whole {
    boxes: Vec<TimedBox>,
    /// The clear ones, whose sizes can be relied on.
    clear: Vec<TimedBox>,
    confirmed_s: Option<f64>,
}

impl Hindsight {
    /// Takes the boxes of the next image.
    pub(crate) fn take(&mut self, now_s: f64, boxes: impl IntoIterator<Item = TrackedBox>) {
        self.began_s.get_or_insert(now_s);
        self.now_s = now_s;
        for seen in boxes {
            let number = seen.track as usize;
            if self.tracks.len() <= number {
                self.tracks.resize_with(number + 1, Whole::default);
            }
            self.tracks[number].push(now_s, &seen);
        }
    }

    /// For each track, by number, true if it counts when all images are done.
    pub(crate) fn counting(&self) -> Vec<bool> {
        let video_s = self.now_s - self.began_s.unwrap_or(self.now_s);
        let shortest_s = MIN_TRACK_S.min(MIN_VIDEO_PART * video_s);
        let tracks = &self.tracks;
        let still: Vec<_> = tracks
            .iter()
            .map(|track| place_if_still(&track.clear))
            .collect();
        let stays: Vec<_> = tracks
            .iter()
            .flat_map(|track| stays(&track.boxes))
            .collect();
        let is_fixture = |place: &PixelBox| {
            let there = tracks
                .iter()
                .zip(&still)
                .filter(|(_, other)| other.is_some_and(|other| is_same_thing(place, &other)));
            let mut boxes: Vec<_> = there
                .flat_map(|(track, _)| track.clear.iter().copied())
                .collect();
            boxes.sort_by(|a, b| a.0.total_cmp(&b.0));
            stands_still(&boxes)
        };
        let places = Places::of(tracks.iter().map(|track| track.boxes.as_slice()));
        let counts = |(number, (track, still)): (usize, (&Whole, &Option<PixelBox>))| {
            track.confirmed_s.is_some()
                && track.clear_for_s() >= shortest_s
                && !stands_still(&track.clear)
                && !is_mostly_at(&stays, &track.clear)
                && !places.is_from_lamp_to_lamp(number, &track.clear)
                && !still.as_ref().is_some_and(is_fixture)
        };
        tracks.iter().zip(&still).enumerate().map(counts).collect()
    }
}

impl Whole {
    fn push(&mut self, now_s: f64, seen: &TrackedBox) {
        self.boxes.push((now_s, seen.pixel_box));
        if !seen.is_faint {
            self.clear.push((now_s, seen.pixel_box));
        }
        self.confirmed_s = self.confirmed_s.or(seen.confirmed_s);
    }

    /// Time from the first confirming box to the last clear one, s.
    fn clear_for_s(&self) -> f64 {
        match (self.confirmed_s, self.clear.last()) {
            (Some(first_s), Some((last_s, _))) => last_s - first_s,
            _ => 0.0,
        }
    }
}
