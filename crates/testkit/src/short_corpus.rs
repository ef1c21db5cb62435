//! Corpora of few ticks a scenario: down the glide path of Changi 02L in front of the cameras of the default rig, without labels.

use std::fs;
use std::path::Path;

use dataset::corpus::Corpus;
use dataset::corpus::calibration::Calibration;
use dataset::corpus::seal::{commit_folder, seal_folder};
use dataset::geometry::pose::Pose;
use dataset::numbers::frame_rate::FrameRate;
use dataset::tables::frames::{Frames, TickRow};
use dataset::video::{VideoSettings, VideoWriter};

use crate::approach::on_glide_path;
use crate::changi_02l;
use crate::rig::{VIEWS, placed, wide_baseline};
use crate::scenario::{self, record, stamp};

/// Remaining distance at tick 0, metres.
pub const START_M: f64 = 9_260.0;
/// Displacement in a second, metres.
const STEP_M: f64 = 70.0;
const TICKS: u32 = 3;
const RATE: FrameRate = FrameRate {
    numerator: 1,
    denominator: 1,
};

/// Draws a view's image at a tick.
pub type Painter<'a> = &'a dyn Fn(&str, u32, &mut [u8]);

/// A corpus of committed scenarios without videos, for images of 1920 x 1280.
pub fn write(root: &Path, ids: &[&str]) -> Corpus {
    write_with_videos(root, ids, 1920, 1280, None)
}

/// A corpus of committed scenarios with images of the given size.
pub fn write_with_videos(
    root: &Path,
    ids: &[&str],
    width_px: u32,
    height_px: u32,
    paint: Option<Painter<'_>>,
) -> Corpus {
    let corpus = Corpus::create(root).unwrap();
    for id in ids {
        write_scenario(&corpus, id, [width_px, height_px], (RATE, TICKS), paint);
    }
    corpus
}

/// A corpus with a single committed scenario: its ticks, frame rate and image size are given.
pub fn write_flight(
    root: &Path,
    id: &str,
    size_px: [u32; 2],
    rate: FrameRate,
    ticks: u32,
    paint: Painter<'_>,
) -> Corpus {
    let corpus = Corpus::create(root).unwrap();
    write_scenario(&corpus, id, size_px, (rate, ticks), Some(paint));
    corpus
}

fn write_scenario(
    corpus: &Corpus,
    id: &str,
    [width_px, height_px]: [u32; 2],
    (rate, ticks): (FrameRate, u32),
    paint: Option<Painter<'_>>,
) {
    let folder = corpus.partial_scenario(id);
    fs::create_dir_all(folder.root().join("views")).unwrap();
    record(id, rate, ticks)
        .write(&folder.record_path())
        .unwrap();
    Calibration::from_poses(wide_baseline(&changi_02l()), width_px, height_px)
        .write(&folder.calibration_path())
        .unwrap();
    frames(rate, ticks).write(&folder.frames_path()).unwrap();
    for view in VIEWS {
        let Some(paint) = paint else { continue };
        let path = folder.video_path(view);
        let settings = VideoSettings::default();
        let mut writer = VideoWriter::create(&path, &settings, width_px, height_px, rate).unwrap();
        let mut rgb = vec![0; (width_px * height_px * 3) as usize];
        for tick in 0..ticks {
            paint(view, tick, &mut rgb);
            writer.write(&rgb).unwrap();
        }
        writer.finish().unwrap();
    }
    seal_folder(folder.root(), "config").unwrap();
    commit_folder(folder.root(), corpus.scenario(id).root()).unwrap();
}

/// A tick, one a second, without views.
pub fn frame(tick: u32, pose: Pose) -> TickRow {
    scenario::frame(tick, RATE, pose)
}

fn frames(rate: FrameRate, ticks: u32) -> Frames {
    let row = |tick: u32| {
        let flown_m = STEP_M * rate.time_of_tick(tick).seconds();
        let bare = scenario::frame(tick, rate, on_glide_path(START_M - flown_m, 0.0));
        let views = VIEWS.map(|view| stamp(u64::from(tick) + 100, &bare, rate, placed(view)));
        TickRow {
            views: views.to_vec(),
            ..bare
        }
    };
    Frames {
        views: VIEWS.map(str::to_owned).to_vec(),
        rows: (0..ticks).map(row).collect(),
    }
}
