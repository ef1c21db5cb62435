//! Searches the pictures of a view one after another, each at the places that the previous ones suggest.
//!
//! Whole pictures are searched as described in [`crate::tiling`]. Between them, each tracked aircraft gets one window around its expected
//! place, and the rest of the picture is neither converted nor searched.

use dataset::corpus::detections::{Detection, Detections, Miss, MissReason, SearchMode};
use dataset::tables::pixel_box::PixelBox;

use super::cpu_time::{CpuClock, Stage};
use super::mode::{Mode, ModeSettings};
use super::pictures::{Pictures, ViewTick, ViewTicks};
use crate::detector::{Detector, PictureView, ScoredBox, Window, WindowSize, keep_best};
use crate::error::Result;
use crate::search_windows::{shrunk_picture, window_around};
use crate::tiling::{Sighting, TilingSettings, search_picture};
use crate::tracking::{Expected, Searched, Seen, Tracker};

/// After a loss the whole picture is searched at once, but not more often than this part of the usual period: in fog an aircraft is lost
/// in every other picture.
const LOSS_PART: f64 = 0.25;
/// While an aircraft is followed, the shortest time between two periodic searches of whole pictures, in pictures.
const LEAST_PERIOD: f64 = 5.0;
/// A picture that is due within this part of the time since the last one is due now.
const DUE_PART: f64 = 0.5;
/// An aircraft that may move further between two pictures, in lengths of its box, is looked for everywhere.
const MOST_LENGTHS: f64 = 1.0;
/// A box this close to the border of its window may be cut off there, pixels.
const BORDER_PX: f64 = 1.5;

/// The pictures of a view while they are searched.
pub(super) struct Sequence<'a> {
    view: &'a str,
    detector: Timed<'a>,
    tiling: &'a TilingSettings,
    modes: ModeSettings,
    tracker: Tracker,
    /// Times of the last picture and of the last one that was searched whole.
    last_s: Option<f64>,
    last_full_s: Option<f64>,
}

/// Results of the search of a picture.
struct Looked {
    sightings: Vec<Sighting>,
    mode: SearchMode,
    /// The tracks that it was searched for, if it was not searched whole.
    around: Option<Vec<u32>>,
    /// Reason to report if no box is found.
    nothing: MissReason,
}

impl<'a> Sequence<'a> {
    pub(super) fn new(
        detector: &'a mut dyn Detector,
        clock: &'a CpuClock,
        tiling: &'a TilingSettings,
        modes: ModeSettings,
        view: &'a ViewTicks,
    ) -> Self {
        Self {
            view: &view.id,
            detector: Timed {
                detector,
                clock,
                windows: 0,
            },
            tiling,
            modes,
            tracker: Tracker::of_pictures(view.ticks.len()),
            last_s: None,
            last_full_s: None,
        }
    }

    /// Searches the next picture. The confirmation of its boxes is not final yet, and faint ones may be dropped at the end.
    pub(super) fn look(
        &mut self,
        pictures: &mut Pictures<'_>,
        at: &ViewTick,
    ) -> Result<Detections> {
        let since_s = self.last_s.map_or(0.0, |last_s| at.time_s - last_s);
        self.tracker.advance(since_s);
        let looked = match self.modes.mode {
            Mode::Full => self.everywhere(pictures)?,
            Mode::Scaled => self.shrunk(pictures)?,
            Mode::Tracked | Mode::Auto => self.where_expected(pictures, at.time_s, since_s)?,
        };
        self.last_s = Some(at.time_s);
        if looked.mode == SearchMode::Full {
            self.last_full_s = Some(at.time_s);
        }
        Ok(self.rows(looked, at))
    }

    /// Searches the expected places of the tracked aircraft, or the whole picture if that is due.
    fn where_expected(
        &mut self,
        pictures: &mut Pictures<'_>,
        now_s: f64,
        since_s: f64,
    ) -> Result<Looked> {
        let expected = self.tracker.expected(since_s);
        let is_fast = |expected: &Expected| expected.lengths_moved > MOST_LENGTHS;
        let is_too_fast = self.modes.mode == Mode::Auto && expected.iter().any(is_fast);
        let has_passed = |period_s: f64| {
            self.last_full_s
                .is_none_or(|last_s| now_s - last_s >= period_s - DUE_PART * since_s)
        };
        let may_follow_loss = has_passed(LOSS_PART * self.modes.full_search_s);
        let period_s = if expected.iter().any(|expected| expected.is_confirmed) {
            self.modes.full_search_s.max(LEAST_PERIOD * since_s)
        } else {
            self.modes.full_search_s
        };
        if is_too_fast || has_passed(period_s) {
            return self.everywhere(pictures);
        }
        let looked = self.around(pictures, &expected)?;
        if may_follow_loss && self.tracker.loses_any(&self.seen(&looked.sightings)) {
            return self.everywhere(pictures);
        }
        Ok(looked)
    }

    fn everywhere(&mut self, pictures: &mut Pictures<'_>) -> Result<Looked> {
        let found = search_picture(&mut self.detector, &pictures.whole()?, self.tiling)?;
        Ok(Looked {
            sightings: found.sightings,
            mode: SearchMode::Full,
            around: None,
            nothing: match found.hits {
                0 => MissReason::Nothing,
                _ => MissReason::Refuted,
            },
        })
    }

    fn shrunk(&mut self, pictures: &mut Pictures<'_>) -> Result<Looked> {
        let window = shrunk_picture(pictures.size_px(), self.detector.window_size());
        let picture = pictures.whole()?;
        let found = self
            .detector
            .detect(&picture, &[window], self.tiling.least_score())?;
        let sightings = found
            .into_iter()
            .flatten()
            .map(|found| Sighting::of(found, 0));
        Ok(Looked {
            sightings: self.best(sightings.collect()),
            mode: SearchMode::Scaled,
            around: None,
            nothing: MissReason::Nothing,
        })
    }

    /// In a window for each aircraft that is followed; the most promising ones if there are many.
    fn around(&mut self, pictures: &mut Pictures<'_>, expected: &[Expected]) -> Result<Looked> {
        let expected = &expected[..expected.len().min(self.tiling.most_windows)];
        let mut sightings = Vec::new();
        for (crop, expected) in (0..).zip(expected) {
            let picture_px = pictures.size_px();
            let window =
                window_around(&expected.pixel_box, picture_px, self.detector.window_size());
            let (pixels, within) = pictures.behind(window)?;
            let shown_px = [pixels.width_px, pixels.height_px];
            let found = self
                .detector
                .detect(&pixels, &[within], self.tiling.least_score())?;
            let whole = found.into_iter().flatten().map(|found| ScoredBox {
                pixel_box: PixelBox {
                    cx_px: found.pixel_box.cx_px + f64::from(window.left_px),
                    cy_px: found.pixel_box.cy_px + f64::from(window.top_px),
                    ..found.pixel_box
                },
                ..found
            });
            let whole =
                whole.filter(|found| is_whole(&found.pixel_box, window, shown_px, picture_px));
            sightings.extend(whole.map(|found| Sighting::of(found, crop)));
        }
        Ok(Looked {
            sightings: self.best(sightings),
            mode: SearchMode::Tracked,
            nothing: match expected {
                [] => MissReason::NotSearched,
                _ => MissReason::Lost,
            },
            around: Some(expected.iter().map(|expected| expected.track).collect()),
        })
    }

    fn best(&self, sightings: Vec<Sighting>) -> Vec<Sighting> {
        let (iou, most) = (self.tiling.merge_iou, self.tiling.most_windows);
        keep_best(sightings, iou, most, Sighting::scored)
    }

    /// Rows of the table for the results of a picture, with the tracks to which the boxes belong.
    fn rows(&mut self, looked: Looked, at: &ViewTick) -> Detections {
        let searched = match &looked.around {
            None => Searched::Everywhere,
            Some(tracks) => Searched::Around(tracks),
        };
        let tracks = self.tracker.take(&self.seen(&looked.sightings), searched);
        let row = |(seen, track): (Sighting, Option<u32>)| {
            let track = track?;
            Some(Detection {
                track: Some(track),
                mode: looked.mode,
                confirmed: self.tracker.is_confirmed(track),
                ..Detection::untracked(at.tick, self.view, seen.pixel_box, seen.score, seen.tile)
            })
        };
        let seen = looked.sightings.into_iter().zip(tracks);
        let boxes: Vec<_> = seen.filter_map(row).collect();
        let miss = boxes.is_empty().then(|| Miss {
            tick: at.tick,
            view: self.view.to_owned(),
            mode: looked.mode,
            reason: looked.nothing,
        });
        Detections {
            boxes,
            misses: miss.into_iter().collect(),
        }
    }

    /// Called after the last picture: decides which boxes count, and returns the number of windows that were searched.
    pub(super) fn finish(self, detections: &mut Detections) -> u64 {
        let counts = self.tracker.finish();
        for found in &mut detections.boxes {
            found.confirmed = found.track.is_some_and(|track| counts[track as usize]);
        }
        drop_faint(detections, self.tiling.score);
        self.detector.windows
    }

    /// The tracker's input for these sightings.
    fn seen(&self, sightings: &[Sighting]) -> Vec<Seen> {
        let seen = |sighting: &Sighting| Seen {
            pixel_box: sighting.pixel_box,
            is_faint: sighting.score < self.tiling.score,
        };
        sightings.iter().map(seen).collect()
    }
}

/// Drops the boxes below this score that do not count; a picture that had no others is a miss.
fn drop_faint(detections: &mut Detections, score: f64) {
    let Detections { boxes, misses } = detections;
    let is_kept = |found: &Detection| found.confirmed || found.score >= score;
    for here in boxes.chunk_by(|a, b| a.tick == b.tick) {
        if !here.iter().any(is_kept) {
            let reason = match here[0].mode {
                SearchMode::Full => MissReason::Refuted,
                SearchMode::Tracked => MissReason::Lost,
                SearchMode::Scaled => MissReason::Nothing,
            };
            misses.push(Miss {
                tick: here[0].tick,
                view: here[0].view.clone(),
                mode: here[0].mode,
                reason,
            });
        }
    }
    boxes.retain(is_kept);
    misses.sort_by_key(|miss| miss.tick);
}

/// True if a box ends inside the pixels that a window shows, or at the edge of the picture.
fn is_whole(found: &PixelBox, window: Window, shown_px: [u32; 2], picture_px: [u32; 2]) -> bool {
    let [left, top, right, bottom] = found.edges();
    let sides = [
        (left, right, window.left_px, shown_px[0], picture_px[0]),
        (top, bottom, window.top_px, shown_px[1], picture_px[1]),
    ];
    sides
        .into_iter()
        .all(|(first, last, start, length, picture)| {
            let end = start + length;
            (start == 0 || first >= f64::from(start) - 0.5 + BORDER_PX)
                && (end == picture || last <= f64::from(end) - 0.5 - BORDER_PX)
        })
}

/// A detector whose time and windows are counted.
struct Timed<'a> {
    detector: &'a mut dyn Detector,
    clock: &'a CpuClock,
    windows: u64,
}

impl Detector for Timed<'_> {
    fn window_size(&self) -> WindowSize {
        self.detector.window_size()
    }

    fn detect(
        &mut self,
        picture: &PictureView<'_>,
        windows: &[Window],
        score_floor: f64,
    ) -> Result<Vec<Vec<ScoredBox>>> {
        self.windows += windows.len() as u64;
        let detector = &mut self.detector;
        self.clock.during(Stage::Infer, || {
            detector.detect(picture, windows, score_floor)
        })
    }

    fn first_pass_shrink(&self) -> u32 {
        self.detector.first_pass_shrink()
    }

    fn description(&self) -> String {
        self.detector.description()
    }
}

#[cfg(test)]
mod tests;
