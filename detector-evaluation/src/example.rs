//! Pictures for the report: what was found, what was missed, and what is no aircraft.
//!
//! Input: every picture with its boxes. Output: a few of each kind, cut out of the videos. Hits are the farthest ones, misses the nearest,
//! false boxes the surest; no two from the same mile of a view, or of the same track.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Cursor;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use dataset::corpus::Corpus;
use dataset::open_scenario::OpenScenario;
use dataset::pixel_box::PixelBox;
use image::{ImageFormat, RgbImage};

use crate::error::{Error, Result};
use crate::outcome::{Outcome, Searched};
use dataset::sight::Sight;

/// Examples of each kind and mode.
const SHOWN: usize = 8;
/// Width of a crop over its height.
const ASPECT: f64 = 1.5;
/// Width of a crop, pixels, unless the box needs more.
const LEAST_WIDTH_PX: f64 = 96.0;
/// Width of a crop over that of the box.
const SURROUNDINGS: f64 = 3.0;

/// What an example shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Kind {
    Hit,
    Miss,
    FalseAlarm,
}

/// An example that may be shown.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Candidate {
    pub(crate) kind: Kind,
    scenario: String,
    view: String,
    tick: u32,
    distance_nm: f64,
    truth: Option<PixelBox>,
    found: Option<PixelBox>,
    /// Score, or reason of a miss.
    pub(crate) note: String,
    /// Smaller is shown first.
    rank: f64,
    /// Only one of these is shown: view, and mile or track.
    alike: (String, i64),
}

/// The best candidates so far.
#[derive(Debug, Clone, Default)]
pub(crate) struct Candidates {
    by_kind: BTreeMap<Kind, Vec<Candidate>>,
}

/// A crop with the boxes in it, in pixels of the crop.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Example {
    pub(crate) candidate: Candidate,
    /// PNG, as a `data:` address.
    pub(crate) source: String,
    pub(crate) width_px: u32,
    pub(crate) height_px: u32,
    pub(crate) truth: Option<PixelBox>,
    pub(crate) found: Option<PixelBox>,
}

impl Candidates {
    /// Takes the pictures of a scenario.
    pub(crate) fn offer(
        &mut self,
        scenario: &OpenScenario,
        searched: &[Searched<'_>],
    ) -> Result<()> {
        let record = scenario.record()?;
        for searched in searched {
            let picture = searched.picture;
            let view = &record.views[picture.view];
            let mile = picture.distance_nm.floor() as i64;
            let candidate =
                |kind, found: Option<PixelBox>, note: String, rank, group: i64| Candidate {
                    kind,
                    scenario: record.id.clone(),
                    view: view.clone(),
                    tick: picture.tick,
                    distance_nm: picture.distance_nm,
                    truth: picture.truth.as_ref().map(|truth| truth.pixel_box),
                    found,
                    note,
                    rank,
                    alike: (format!("{}/{view}", record.id), group),
                };
            let scored = |score: f64| format!("score {score:.2}");
            match searched.outcome() {
                Some(Outcome::Found(hit)) => {
                    let (found, note) = (Some(hit.pixel_box), scored(hit.score));
                    self.take(candidate(
                        Kind::Hit,
                        found,
                        note,
                        -picture.distance_nm,
                        mile,
                    ));
                }
                Some(Outcome::Missed(reason)) if picture.sight == Sight::Open => {
                    let nearest = searched.boxes.first().map(|found| found.pixel_box);
                    let (note, rank) = (reason.to_owned(), picture.distance_nm.abs());
                    self.take(candidate(Kind::Miss, nearest, note, rank, mile));
                }
                _ => {}
            }
            for found in searched.false_boxes() {
                // Tracks count from 0, ticks too: the sign keeps them apart.
                let group = found.track.map_or(-1 - i64::from(picture.tick), i64::from);
                let (at, note) = (Some(found.pixel_box), scored(found.score));
                self.take(candidate(Kind::FalseAlarm, at, note, -found.score, group));
            }
        }
        Ok(())
    }

    fn take(&mut self, candidate: Candidate) {
        let kept = self.by_kind.entry(candidate.kind).or_default();
        if let Some(like) = kept.iter_mut().find(|kept| kept.alike == candidate.alike) {
            if candidate.rank < like.rank {
                *like = candidate;
            }
        } else if kept.len() < SHOWN {
            kept.push(candidate);
        } else if let Some(worst) = kept.iter_mut().max_by(|a, b| a.rank.total_cmp(&b.rank))
            && candidate.rank < worst.rank
        {
            *worst = candidate;
        }
    }

    /// Cuts the candidates out of the videos: hits, then misses, then false boxes, the best first.
    pub(crate) fn cut(self, corpus: &Corpus) -> Result<Vec<Example>> {
        let mut chosen: Vec<Candidate> = self.by_kind.into_values().flatten().collect();
        chosen.sort_by(|a, b| a.kind.cmp(&b.kind).then(a.rank.total_cmp(&b.rank)));
        let videos: BTreeSet<_> = chosen
            .iter()
            .map(|c| (c.scenario.clone(), c.view.clone()))
            .collect();
        let mut cut: Vec<Option<Example>> = chosen.iter().map(|_| None).collect();
        for (id, view) in videos {
            let mut here: Vec<usize> = (0..chosen.len())
                .filter(|&index| chosen[index].scenario == id && chosen[index].view == view)
                .collect();
            here.sort_by_key(|&index| chosen[index].tick);
            let mut reader = corpus.scenario(&id).open()?.open_video(&view)?;
            let (mut next_tick, mut rgb) = (0, Vec::new());
            for index in here {
                let candidate = &chosen[index];
                while next_tick < candidate.tick {
                    reader.skip_frame()?;
                    next_tick += 1;
                }
                if next_tick == candidate.tick {
                    reader.next_frame(&mut rgb)?;
                    next_tick += 1;
                }
                let size = [reader.width(), reader.height()];
                cut[index] = Some(Example::of(candidate.clone(), &rgb, size)?);
            }
        }
        Ok(cut.into_iter().flatten().collect())
    }
}

impl Candidate {
    /// Where it is, in words.
    pub(crate) fn place(&self) -> String {
        let Self {
            scenario,
            view,
            tick,
            distance_nm,
            ..
        } = self;
        format!("{distance_nm:.1} NM; {scenario}, {view}, tick {tick}")
    }
}

impl Example {
    fn of(
        candidate: Candidate,
        rgb: &[u8],
        [picture_width, picture_height]: [u32; 2],
    ) -> Result<Self> {
        // A miss is shown where the aircraft is.
        let shown = match candidate.kind {
            Kind::Miss => candidate.truth.or(candidate.found),
            Kind::Hit | Kind::FalseAlarm => candidate.found,
        };
        let around = shown.unwrap_or(PixelBox::from_edges(0.0, 0.0, 0.0, 0.0));
        let needed = (around.width_px * SURROUNDINGS).max(around.height_px * SURROUNDINGS * ASPECT);
        let width = needed.max(LEAST_WIDTH_PX).min(f64::from(picture_width)) as u32;
        let height = ((f64::from(width) / ASPECT) as u32).min(picture_height);
        let start = |centre: f64, length: u32, picture: u32| {
            (centre - f64::from(length) / 2.0).clamp(0.0, f64::from(picture - length)) as u32
        };
        let left = start(around.cx_px, width, picture_width);
        let top = start(around.cy_px, height, picture_height);
        let crop = RgbImage::from_fn(width, height, |x, y| {
            let pixel = (((top + y) * picture_width + left + x) * 3) as usize;
            image::Rgb([rgb[pixel], rgb[pixel + 1], rgb[pixel + 2]])
        });
        let mut png = Cursor::new(Vec::new());
        crop.write_to(&mut png, ImageFormat::Png)
            .map_err(Error::Crop)?;
        let inside = |pixel_box: PixelBox| PixelBox {
            // The corner of a picture's first pixel is half a pixel before its centre.
            cx_px: pixel_box.cx_px + 0.5 - f64::from(left),
            cy_px: pixel_box.cy_px + 0.5 - f64::from(top),
            ..pixel_box
        };
        Ok(Self {
            source: format!(
                "data:image/png;base64,{}",
                STANDARD.encode(png.into_inner())
            ),
            width_px: width,
            height_px: height,
            truth: candidate.truth.map(inside),
            found: candidate.found.map(inside),
            candidate,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn candidate(rank: f64, group: i64) -> Candidate {
        Candidate {
            kind: Kind::Miss,
            scenario: "1200-clear-r1".into(),
            view: "left".into(),
            tick: 0,
            distance_nm: rank,
            truth: Some(PixelBox::from_edges(100.0, 40.0, 120.0, 47.0)),
            found: None,
            note: "nothing".into(),
            rank,
            alike: ("1200-clear-r1/left".into(), group),
        }
    }

    #[test]
    fn the_best_of_a_kind_are_kept_one_of_each_mile_or_track() {
        let mut candidates = Candidates::default();
        for rank in [5.5, 5.1, 5.9] {
            candidates.take(candidate(rank, 5));
        }
        for mile in 6..20 {
            candidates.take(candidate(mile as f64, mile));
        }
        candidates.take(candidate(1.0, 1));
        let kept = &candidates.by_kind[&Kind::Miss];
        let mut ranks: Vec<_> = kept.iter().map(|kept| kept.rank).collect();
        ranks.sort_by(f64::total_cmp);
        assert_eq!(ranks, [1.0, 5.1, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0]);
    }

    #[test]
    fn a_crop_lies_inside_the_picture_and_has_the_box_where_the_pixels_are() {
        let (width, height) = (300, 200);
        let mut rgb = vec![0; width * height * 3];
        for (x, y) in (100..=120).flat_map(|x| (41..=47).map(move |y| (x, y))) {
            rgb[(y * width + x) * 3] = 255;
        }
        let example = Example::of(candidate(5.0, 5), &rgb, [300, 200]).unwrap();
        assert_eq!((example.width_px, example.height_px), (96, 64));
        let png = example
            .source
            .strip_prefix("data:image/png;base64,")
            .unwrap();
        let crop = image::load_from_memory(&STANDARD.decode(png).unwrap())
            .unwrap()
            .to_rgb8();
        let truth = example.truth.unwrap();
        let at = |x: f64, y: f64| crop.get_pixel(x as u32, y as u32).0[0];
        let [left, top, right, bottom] = truth.edges();
        assert_eq!(
            (at(left + 1.0, top + 1.0), at(right - 1.0, bottom - 1.0)),
            (255, 255)
        );
        assert_eq!((at(left - 2.0, top), at(right + 2.0, bottom - 1.0)), (0, 0));
        let corner = Candidate {
            truth: Some(PixelBox::from_edges(0.0, 0.0, 400.0, 10.0)),
            ..candidate(5.0, 5)
        };
        let whole = Example::of(corner, &rgb, [300, 200]).unwrap();
        assert_eq!((whole.width_px, whole.height_px), (300, 200));
    }
}
