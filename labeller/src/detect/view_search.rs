//! Searches one view of a scenario, from its video to table rows.
//!
//! Input: the view's video and ticks, and a detector. Output: boxes with their tracks, reasons for images without any, the surroundings of
//! each image's best box for registration, and a breakdown of the processor time. No files are written.

pub(crate) mod cpu_time;
mod timed;

use dataset::corpus::detections::{Detection, Detections, Miss, MissReason, SearchMode};
use dataset::corpus::open_scenario::OpenScenario;
use dataset::geometry::camera::Camera;
use dataset::tables::backgrounds::ViewBackground;
use dataset::tables::health::{HealthState, ViewHealth};
use dataset::tables::pixel_box::PixelBox;
use dataset::tables::registrations::NoShift;
use sight::watched::Measured;

use super::mode::Mode;
use super::pairs::best_box::best_of;
use super::pictures::image::{Image, patch};
use super::pictures::{Pictures, ViewTick, ViewTicks};
use super::sequence::{Sequence, Tracked, TrackedImage};
use crate::detector::Detector;
use crate::error::Result;
use crate::registration::Patch;
use crate::tiling::TilingSettings;
use crate::tracking::{Hindsight, TrackedBox};
use crate::view_health::{CameraLook, CameraWatch, Look, judge, usual};
use cpu_time::{CpuClock, CpuTime};
use timed::Timed;

/// Box source.
pub(crate) enum Finder<'a> {
    /// A model looks for them.
    Model {
        detector: &'a mut dyn Detector,
        tiling: &'a TilingSettings,
        mode: Mode,
    },
    /// They are known, and only their surroundings are needed.
    Known(&'a Detections),
}

pub(crate) struct PictureDone {
    pub(crate) tick: u32,
    pub(crate) patch: std::result::Result<Patch, NoShift>,
}

/// Results for one view.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct ViewFindings {
    pub(crate) detections: Detections,
    /// Condition of the camera at each tick, if it was asked for.
    pub(crate) health: Vec<ViewHealth>,
    /// Background of the camera, if it was asked for.
    pub(crate) backgrounds: Vec<ViewBackground>,
    /// Windows that the model was run on.
    pub(crate) windows: u64,
    pub(crate) cpu_s: CpuTime,
}

impl ViewFindings {
    /// Merges the results of all views by tick. Views keep their order within a tick, and boxes (best first) theirs within a view.
    pub(super) fn together(views: impl IntoIterator<Item = Self>) -> Self {
        let mut all = Self::default();
        for view in views {
            all.detections.boxes.extend(view.detections.boxes);
            all.detections.misses.extend(view.detections.misses);
            all.health.extend(view.health);
            all.backgrounds.extend(view.backgrounds);
            all.windows += view.windows;
            all.cpu_s += view.cpu_s;
        }
        all.detections.boxes.sort_by_key(|found| found.tick);
        all.detections.misses.sort_by_key(|miss| miss.tick);
        all.health.sort_by_key(|row| row.tick);
        all
    }
}

/// Searches a view. `picture_done` is called after every image, and its error ends the search. `watched`: the camera whose condition is
/// measured.
///
/// # Errors
/// The video lacks images or has extra ones, or the detector fails.
pub(crate) fn search_view(
    scenario: &OpenScenario,
    view: &ViewTicks,
    finder: Finder<'_>,
    watched: Option<&Camera>,
    picture_done: &mut dyn FnMut(PictureDone) -> Result<()>,
) -> Result<ViewFindings> {
    let clock = CpuClock::start();
    let mut pictures = Pictures::open(scenario, &view.id, &clock)?;
    let count = view.ticks.len();
    let mut source = match finder {
        Finder::Model {
            detector,
            tiling,
            mode,
        } => Source::Search(Box::new(Search {
            detector: Timed {
                detector,
                clock: &clock,
                windows: 0,
            },
            score: tiling.score,
            sequence: Sequence::new(*tiling, mode, Some(count)),
            hindsight: Hindsight::default(),
        })),
        Finder::Known(detections) => Source::Known(detections),
    };
    let mut detections = Detections::default();
    let mut camera = watched.map(CameraWatch::new);
    let mut looks = Vec::new();
    for tick in &view.ticks {
        pictures.next(tick)?;
        let found = match &mut source {
            Source::Search(search) => search.look(&mut pictures, &view.id, tick)?,
            Source::Known(known) => of_picture(known, &view.id, tick.tick),
        };
        let best = best_of(found.boxes.iter().map(ranked));
        if let Some(camera) = &mut camera {
            let counts = |found: &&Detection| found.counts_live.unwrap_or(found.confirmed);
            let counted = best_of(found.boxes.iter().filter(counts).map(ranked));
            let at = (tick.tick, tick.time_s);
            let CameraLook { look, state, .. } = camera.look(at, pictures.lumas(), best, counted);
            looks.push((look, state));
        }
        picture_done(PictureDone {
            tick: tick.tick,
            patch: patch(&mut pictures, best)?,
        })?;
        detections.boxes.extend(found.boxes);
        detections.misses.extend(found.misses);
    }
    pictures.end()?;
    let windows = match source {
        Source::Search(search) => search.finish(&mut detections),
        Source::Known(_) => 0,
    };
    let (health, usual) = health_of(&view.id, looks, &detections);
    let backgrounds = camera.and_then(|camera| camera.background(&view.id, usual));
    Ok(ViewFindings {
        health,
        backgrounds: backgrounds.into_iter().collect(),
        detections,
        windows,
        cpu_s: clock.spent(),
    })
}

fn ranked(found: &Detection) -> (bool, f64, PixelBox) {
    (found.confirmed, found.score, found.pixel_box)
}

/// Health rows, and the usual direction that turns are relative to.
fn health_of(
    view: &str,
    looks: Vec<(Look, HealthState)>,
    detections: &Detections,
) -> (Vec<ViewHealth>, Option<Measured>) {
    let (looks, live): (Vec<Look>, Vec<HealthState>) = looks.into_iter().unzip();
    let confirmed: Vec<Option<PixelBox>> = (looks.iter())
        .map(|look| {
            let first = (detections.boxes).partition_point(|found| found.tick < look.tick);
            let here = (detections.boxes[first..].iter()).take_while(|b| b.tick == look.tick);
            let here = here.filter(|found| found.view == view && found.confirmed);
            best_of(here.map(ranked))
        })
        .collect();
    let judged = judge(&looks, &confirmed);
    let rows = looks.iter().zip(live).zip(judged);
    let rows = rows.map(|((look, state_live), (state, motion))| ViewHealth {
        tick: look.tick,
        view: view.to_owned(),
        state,
        motion,
        state_live,
    });
    (rows.collect(), usual(&looks))
}

enum Source<'a> {
    Search(Box<Search<'a>>),
    Known(&'a Detections),
}

/// Whole-video search.
struct Search<'a> {
    detector: Timed<'a>,
    /// Minimum score of clear boxes.
    score: f64,
    sequence: Sequence,
    hindsight: Hindsight,
}

impl Search<'_> {
    /// Searches the next image. Confirmation is not final yet, and faint boxes may be dropped at the end.
    fn look(
        &mut self,
        pictures: &mut Pictures<'_>,
        view: &str,
        at: &ViewTick,
    ) -> Result<Detections> {
        let shown = (self.sequence).look(&mut self.detector, pictures, at.time_s)?;
        let tracked = shown.boxes.iter().map(|seen| TrackedBox {
            track: seen.track,
            pixel_box: seen.pixel_box,
            is_faint: seen.is_faint,
            confirmed_s: seen.confirmed_s,
        });
        self.hindsight.take(self.sequence.now_s(), tracked);
        Ok(rows_of(&shown, view, at.tick))
    }

    /// Called after the last image: decides which boxes count, and returns the number of windows that were searched.
    fn finish(self, detections: &mut Detections) -> u64 {
        let counts = self.hindsight.counting();
        for found in &mut detections.boxes {
            found.confirmed = found.track.is_some_and(|track| counts[track as usize]);
        }
        drop_faint(detections, self.score);
        self.detector.windows
    }
}

/// Table rows for one image.
fn rows_of(shown: &TrackedImage, view: &str, tick: u32) -> Detections {
    let row = |seen: &Tracked| Detection {
        track: Some(seen.track),
        mode: shown.mode,
        confirmed: seen.confirmed_s.is_some(),
        counts_live: Some(seen.counts),
        ..Detection::untracked(tick, view, seen.pixel_box, seen.score, seen.tile)
    };
    let miss = shown.boxes.is_empty().then(|| Miss {
        tick,
        view: view.to_owned(),
        mode: shown.mode,
        reason: shown.nothing,
    });
    Detections {
        boxes: shown.boxes.iter().map(row).collect(),
        misses: miss.into_iter().collect(),
    }
}

/// Drops the boxes below this score that do not count and never did; an image that had no others is a miss.
fn drop_faint(detections: &mut Detections, score: f64) {
    let Detections { boxes, misses } = detections;
    let is_kept = |found: &Detection| {
        found.confirmed || found.counts_live == Some(true) || found.score >= score
    };
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

fn of_picture(known: &Detections, view: &str, tick: u32) -> Detections {
    let Detections { boxes, misses } = known;
    let first = boxes.partition_point(|found| found.tick < tick);
    let here = boxes[first..].iter().take_while(|found| found.tick == tick);
    let boxes = here.filter(|found| found.view == view).cloned().collect();
    let first = misses.partition_point(|miss| miss.tick < tick);
    let here = misses[first..].iter().take_while(|miss| miss.tick == tick);
    let misses = here.filter(|miss| miss.view == view).cloned().collect();
    Detections { boxes, misses }
}
