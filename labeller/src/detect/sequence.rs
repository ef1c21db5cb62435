//! Searches a view's consecutive images at the places that the previous ones suggest.
//!
//! Whole images are searched as described in [`crate::tiling`]. Between them, each tracked aircraft gets one window around its expected
//! place, and the rest of the image is neither converted nor searched.

mod strips;

use std::mem;
use std::ops::Range;
use std::time::Instant;

use dataset::corpus::detections::{MissReason, SearchMode};
use dataset::tables::pixel_box::PixelBox;
use dataset::video::PicturePart;

use super::mode::Mode;
use super::pictures::image::Image;
use crate::detector::{Detector, ScoredBox, Window, WindowSize, keep_best};
use crate::error::Result;
use crate::registration::EDGE_PX;
use crate::tiling::row_band::RowBand;
use crate::tiling::search_windows::{shrunk_picture, window_around};
use crate::tiling::{Sighting, TilingSettings, search_picture};
use crate::tracking::{ExpectedBox, FoundBox, SearchedParts, Tracker};
use strips::Strips;

/// Time between searches of whole images, seconds; longer at low image rates while an aircraft is followed. An aircraft that enters the
/// image is found a second later, 70 m closer.
pub(super) const FULL_SEARCH_S: f64 = 1.0;
/// After a loss the whole image is searched at once, but not more often than this part of the usual period: in fog an aircraft is lost
/// in every other image.
const LOSS_PART: f64 = 0.25;
/// While an aircraft is followed, the shortest time between two periodic searches of whole images, in images.
const MIN_PERIOD: f64 = 5.0;

/// View search. Memory does not grow with the number of images.
pub(super) struct Sequence {
    tiling: TilingSettings,
    mode: Mode,
    tracker: Tracker,
    /// Time of the last image.
    last_s: Option<f64>,
    /// A single one, unless searches of whole images are spread.
    strips: Strips,
    is_spread: bool,
}

/// Results for one image.
struct SearchedImage {
    sightings: Vec<Sighting>,
    mode: SearchMode,
    /// The tracks that it was searched for, if it was not searched whole.
    around: Option<Vec<u32>>,
    /// The rows in which it was searched besides.
    rows: Range<u32>,
    /// Reason to report if no box is found.
    nothing: MissReason,
}

/// Tracked box, as known at its time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Tracked {
    pub(super) pixel_box: PixelBox,
    pub(super) score: f64,
    pub(super) tile: u32,
    pub(super) track: u32,
    /// Too uncertain to count alone.
    pub(super) is_faint: bool,
    /// Time of the first of the boxes that confirmed its track.
    pub(super) confirmed_s: Option<f64>,
    pub(super) counts: bool,
}

/// Boxes in one image.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct TrackedImage {
    pub(super) boxes: Vec<Tracked>,
    pub(super) mode: SearchMode,
    /// Reason to report if there is no box.
    pub(super) nothing: MissReason,
}

impl Sequence {
    /// `pictures`: their number, if it is known.
    pub(super) fn new(tiling: TilingSettings, mode: Mode, pictures: Option<usize>) -> Self {
        Self {
            tiling,
            mode,
            tracker: pictures.map_or_else(Tracker::endless, Tracker::of_pictures),
            last_s: None,
            strips: Strips::default(),
            is_spread: false,
        }
    }

    /// This search with whole images spread over several ones, for images that come in real time.
    pub(super) fn spread(self) -> Self {
        Self {
            is_spread: true,
            ..self
        }
    }

    /// Forgets all images up to now.
    pub(super) fn begin_again(&mut self) {
        *self = Self {
            strips: self.strips.begun_again(),
            is_spread: self.is_spread,
            ..Self::new(self.tiling, self.mode, None)
        };
    }

    /// Time of the last image since the first one, seconds.
    pub(super) fn now_s(&self) -> f64 {
        self.tracker.now_s()
    }

    pub(super) fn look(
        &mut self,
        detector: &mut dyn Detector,
        picture: &mut dyn Image,
        time_s: f64,
    ) -> Result<TrackedImage> {
        let since_s = self.last_s.map_or(0.0, |last_s| time_s - last_s);
        self.tracker.advance(since_s);
        let looked = match self.mode {
            Mode::Full => self.everywhere(detector, picture)?,
            Mode::Scaled => self.shrunk(detector, picture)?,
            Mode::Tracked | Mode::Auto => {
                let mut strips = mem::take(&mut self.strips);
                let looked = self.where_expected(&mut strips, detector, picture, [time_s, since_s]);
                self.strips = strips;
                looked?
            }
        };
        self.last_s = Some(time_s);
        Ok(self.shown(looked))
    }

    /// Searches the expected places of the tracked aircraft, and the strip of rows that is due or where one of them was lost.
    fn where_expected(
        &self,
        strips: &mut Strips,
        detector: &mut dyn Detector,
        picture: &mut dyn Image,
        [now_s, since_s]: [f64; 2],
    ) -> Result<SearchedImage> {
        let expected = self.tracker.expected(since_s);
        // Farther than its own length between two images, it is looked for everywhere.
        let is_fast = |expected: &ExpectedBox| expected.lengths_moved > 1.0;
        let is_too_fast = self.mode == Mode::Auto && expected.iter().any(is_fast);
        let all = self.rows(detector, picture);
        let due = if is_too_fast {
            Some(all.clone())
        } else {
            strips.due(&all, [now_s, since_s], full_period_s(&expected, since_s))
        };
        let (looked, rows) = match due {
            Some(rows) if rows == all => (None, rows),
            due => {
                let looked = self.around(detector, picture, &expected)?;
                let lost = self.tracker.lost(&self.seen(&looked.sightings));
                let wait_s = LOSS_PART * FULL_SEARCH_S;
                match due.or_else(|| strips.around(&all, lost?.cy_px, [now_s, since_s], wait_s)) {
                    None => return Ok(looked),
                    Some(rows) => (Some(looked), rows),
                }
            }
        };
        let began = Instant::now();
        let (looked, part) = match looked {
            Some(looked) if rows != all => {
                let part = f64::from(rows.end - rows.start) / f64::from(all.end - all.start);
                (self.with_rows(looked, &rows, detector, picture)?, part)
            }
            _ => (self.everywhere(detector, picture)?, 1.0),
        };
        // Recordings are searched alike by machines of any speed.
        let took_s = if self.is_spread {
            began.elapsed().as_secs_f64()
        } else {
            0.0
        };
        strips.took(now_s, took_s, part);
        Ok(looked)
    }

    /// The rows that strips divide: none if the detector's windows have a fixed size.
    fn rows(&self, detector: &dyn Detector, picture: &dyn Image) -> Range<u32> {
        let TilingSettings {
            rows,
            half_scale_rows,
            tile_px,
            ..
        } = self.tiling;
        let all = RowBand::within(rows, picture.size_px()[1]);
        match (detector.window_size(), tile_px, half_scale_rows) {
            (WindowSize::Any { .. }, None, None) => all,
            _ => all.start..all.start,
        }
    }

    /// Adds the search of some rows.
    fn with_rows(
        &self,
        looked: SearchedImage,
        rows: &Range<u32>,
        detector: &mut dyn Detector,
        picture: &mut dyn Image,
    ) -> Result<SearchedImage> {
        let band = RowBand {
            top_px: rows.start,
            bottom_px: rows.end,
        };
        let tiling = TilingSettings {
            rows: Some(band),
            ..self.tiling
        };
        let found = search_picture(detector, &picture.whole()?, &tiling)?;
        let sightings = [looked.sightings, found.sightings].concat();
        Ok(SearchedImage {
            sightings: self.best(sightings),
            rows: rows.clone(),
            ..looked
        })
    }

    fn everywhere(
        &self,
        detector: &mut dyn Detector,
        picture: &mut dyn Image,
    ) -> Result<SearchedImage> {
        let found = search_picture(detector, &picture.whole()?, &self.tiling)?;
        Ok(SearchedImage {
            sightings: found.sightings,
            mode: SearchMode::Full,
            around: None,
            rows: 0..0,
            nothing: match found.hits {
                0 => MissReason::Nothing,
                _ => MissReason::Refuted,
            },
        })
    }

    fn shrunk(
        &self,
        detector: &mut dyn Detector,
        picture: &mut dyn Image,
    ) -> Result<SearchedImage> {
        let window = shrunk_picture(picture.size_px(), detector.window_size());
        let found = detector.detect(&picture.whole()?, &[window], self.tiling.least_score())?;
        let sightings = found
            .into_iter()
            .flatten()
            .map(|found| Sighting { found, tile: 0 });
        Ok(SearchedImage {
            sightings: self.best(sightings.collect()),
            mode: SearchMode::Scaled,
            around: None,
            rows: 0..0,
            nothing: MissReason::Nothing,
        })
    }

    /// Searches a window per followed aircraft; the most promising ones if there are many.
    fn around(
        &self,
        detector: &mut dyn Detector,
        picture: &mut dyn Image,
        expected: &[ExpectedBox],
    ) -> Result<SearchedImage> {
        let expected = &expected[..expected.len().min(self.tiling.most_windows)];
        let mut sightings = Vec::new();
        for (crop, expected) in (0..).zip(expected) {
            let picture_px = picture.size_px();
            let window = window_around(&expected.pixel_box, picture_px, detector.window_size());
            let (part, within) = behind(window, picture_px);
            let pixels = picture.part(part)?;
            let shown_px = [pixels.width_px, pixels.height_px];
            let found = detector.detect(&pixels, &[within], self.tiling.least_score())?;
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
            sightings.extend(whole.map(|found| Sighting { found, tile: crop }));
        }
        Ok(SearchedImage {
            sightings: self.best(sightings),
            mode: SearchMode::Tracked,
            nothing: match expected {
                [] => MissReason::NotSearched,
                _ => MissReason::Lost,
            },
            around: Some(expected.iter().map(|expected| expected.track).collect()),
            rows: 0..0,
        })
    }

    fn best(&self, sightings: Vec<Sighting>) -> Vec<Sighting> {
        let (iou, most) = (self.tiling.merge_iou, self.tiling.most_windows);
        keep_best(sightings, iou, most, |sighting| sighting.found)
    }

    /// Assigns the boxes to tracks.
    fn shown(&mut self, looked: SearchedImage) -> TrackedImage {
        let searched = match &looked.around {
            None => SearchedParts::Everywhere,
            Some(tracks) => SearchedParts::Around(tracks, &looked.rows),
        };
        let seen = self.seen(&looked.sightings);
        let tracks = self.tracker.take(&seen, searched);
        let tracked = |((found, seen), track): ((&Sighting, &FoundBox), Option<u32>)| {
            let track = track?;
            Some(Tracked {
                pixel_box: found.found.pixel_box,
                score: found.found.score,
                tile: found.tile,
                track,
                is_faint: seen.is_faint,
                confirmed_s: self.tracker.confirmed_s(track),
                counts: self.tracker.counts(track),
            })
        };
        let found = looked.sightings.iter().zip(&seen).zip(tracks);
        TrackedImage {
            boxes: found.filter_map(tracked).collect(),
            mode: looked.mode,
            nothing: looked.nothing,
        }
    }

    fn seen(&self, sightings: &[Sighting]) -> Vec<FoundBox> {
        let seen = |sighting: &Sighting| FoundBox {
            pixel_box: sighting.found.pixel_box,
            is_faint: sighting.found.score < self.tiling.score,
        };
        sightings.iter().map(seen).collect()
    }
}

/// Time between searches of whole images, s.
fn full_period_s(expected: &[ExpectedBox], since_s: f64) -> f64 {
    if expected.iter().any(|expected| expected.is_confirmed) {
        FULL_SEARCH_S.max(MIN_PERIOD * since_s)
    } else {
        FULL_SEARCH_S
    }
}

/// The image part that a window shows, and the window within this part.
fn behind(window: Window, [width_px, height_px]: [u32; 2]) -> (PicturePart, Window) {
    let shown = |side_px: u32, start_px: u32, picture_px: u32| {
        let shown_px = side_px.saturating_mul(window.shrink);
        shown_px.min(picture_px.saturating_sub(start_px))
    };
    let part = PicturePart {
        left_px: window.left_px,
        top_px: window.top_px,
        width_px: shown(window.width_px, window.left_px, width_px),
        height_px: shown(window.height_px, window.top_px, height_px),
    };
    let within = Window {
        left_px: 0,
        top_px: 0,
        ..window
    };
    (part, within)
}

/// True if a box ends inside the pixels that a window shows, or at the edge of the image.
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
            (start == 0 || first >= f64::from(start) - 0.5 + EDGE_PX)
                && (end == picture || last <= f64::from(end) - 0.5 - EDGE_PX)
        })
}

#[cfg(test)]
mod tests;
