//! Searches one view of a scenario, from its video to the rows of the table.
//!
//! Input: the video of a view, its ticks and a detector. Output: boxes with their tracks, reasons for pictures without any, the
//! surroundings of the best box of each picture for registration, and a breakdown of the processor time. No files are written.

use dataset::corpus::detections::{Detection, Detections};
use dataset::corpus::open_scenario::OpenScenario;
use dataset::geometry::camera::Camera;
use dataset::tables::health::ViewHealth;
use dataset::tables::pixel_box::PixelBox;
use dataset::tables::registrations::NoShift;

use super::cpu_time::{CpuClock, CpuTime};
use super::mode::ModeSettings;
use super::pictures::{Pictures, ViewTicks};
use super::sequence::Sequence;
use crate::camera_motion::CameraMotion;
use crate::detector::Detector;
use crate::error::Result;
use crate::registration::Patch;
use crate::tiling::TilingSettings;
use crate::view_health::{Look, judge};

/// Source of the boxes of a view.
pub(crate) enum Finder<'a> {
    /// A model looks for them.
    Model {
        detector: &'a mut dyn Detector,
        /// Thresholds and windows of the search.
        tiling: &'a TilingSettings,
        modes: &'a ModeSettings,
    },
    /// They are known, and only their surroundings are needed.
    Known(&'a Detections),
}

/// A picture that is done.
pub(crate) struct PictureDone {
    pub(crate) tick: u32,
    /// The surroundings of its best box.
    pub(crate) patch: std::result::Result<Patch, NoShift>,
}

/// Results of the search of a view.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct ViewFindings {
    pub(crate) detections: Detections,
    /// Condition of the camera at each tick, if it was asked for.
    pub(crate) health: Vec<ViewHealth>,
    /// Windows that the model was run on.
    pub(crate) windows: u64,
    /// Of the calling thread.
    pub(crate) cpu_s: CpuTime,
}

impl ViewFindings {
    /// Merges the results of all views of a scenario, by tick; views keep their order within a tick, and boxes theirs (best first) within a
    /// view.
    pub(super) fn together(views: impl IntoIterator<Item = Self>) -> Self {
        let mut all = Self::default();
        for view in views {
            all.detections.boxes.extend(view.detections.boxes);
            all.detections.misses.extend(view.detections.misses);
            all.health.extend(view.health);
            all.windows += view.windows;
            all.cpu_s += view.cpu_s;
        }
        all.detections.boxes.sort_by_key(|found| found.tick);
        all.detections.misses.sort_by_key(|miss| miss.tick);
        all.health.sort_by_key(|row| row.tick);
        all
    }
}

/// Searches a view; `picture_done` is called after every picture, and its error ends the search. `watched`: the camera whose condition is
/// measured.
///
/// # Errors
/// The video does not have exactly the pictures of these ticks, or the detector fails.
pub(crate) fn search_view(
    scenario: &OpenScenario,
    view: &ViewTicks,
    finder: Finder<'_>,
    watched: Option<&Camera>,
    picture_done: &mut dyn FnMut(PictureDone) -> Result<()>,
) -> Result<ViewFindings> {
    let clock = CpuClock::start();
    let mut pictures = Pictures::open(scenario, &view.id, &clock)?;
    let mut source = match finder {
        Finder::Model {
            detector,
            tiling,
            modes,
        } => {
            let sequence = Sequence::new(detector, &clock, tiling, *modes, view);
            Source::Search(Box::new(sequence))
        }
        Finder::Known(detections) => Source::Known(detections),
    };
    let mut detections = Detections::default();
    let mut motion = watched.map(CameraMotion::new);
    let mut looks = Vec::new();
    for tick in &view.ticks {
        pictures.next(tick)?;
        let found = match &mut source {
            Source::Search(sequence) => sequence.look(&mut pictures, tick)?,
            Source::Known(known) => of_picture(known, &view.id, tick.tick),
        };
        if let Some(motion) = &mut motion {
            let images = pictures.lumas();
            let turn = images[1].as_ref().and_then(|image| motion.next(image));
            let seen = best_of(&found.boxes).map(|best| best.pixel_box);
            looks.push(Look::of((tick.tick, tick.time_s), turn, images, seen));
        }
        let patch = match best_of(&found.boxes) {
            Some(best) => pictures.patch(best.pixel_box)?,
            None => Err(NoShift::NoBox),
        };
        picture_done(PictureDone {
            tick: tick.tick,
            patch,
        })?;
        detections.boxes.extend(found.boxes);
        detections.misses.extend(found.misses);
    }
    pictures.end()?;
    let windows = match source {
        Source::Search(sequence) => sequence.finish(&mut detections),
        Source::Known(_) => 0,
    };
    Ok(ViewFindings {
        health: health_of(&view.id, &looks, &detections),
        detections,
        windows,
        cpu_s: clock.spent(),
    })
}

/// Rows of a view whose images showed this.
fn health_of(view: &str, looks: &[Look], detections: &Detections) -> Vec<ViewHealth> {
    let confirmed: Vec<Option<PixelBox>> = (looks.iter())
        .map(|look| {
            let first = (detections.boxes).partition_point(|found| found.tick < look.tick);
            let here = (detections.boxes[first..].iter()).take_while(|b| b.tick == look.tick);
            let best = best_of(here.filter(|found| found.view == view))?;
            best.confirmed.then_some(best.pixel_box)
        })
        .collect();
    let judged = looks.iter().zip(judge(looks, &confirmed));
    judged
        .map(|(look, (state, motion))| ViewHealth {
            tick: look.tick,
            view: view.to_owned(),
            state,
            motion,
        })
        .collect()
}

enum Source<'a> {
    Search(Box<Sequence<'a>>),
    Known(&'a Detections),
}

/// The known detections of a picture.
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

/// The box to register: a confirmed one, if there is any, and of these the one with the highest score.
fn best_of<'a>(boxes: impl IntoIterator<Item = &'a Detection>) -> Option<&'a Detection> {
    boxes.into_iter().max_by(|a, b| {
        let confirmed = a.confirmed.cmp(&b.confirmed);
        confirmed.then(a.score.total_cmp(&b.score))
    })
}
