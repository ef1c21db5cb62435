//! Small corpora for the tests of this crate: a short flight down the glide path of WSSS 02L in front of the cameras of the default
//! rig, without labels.

use std::path::Path;

use dataset::calibration::Calibration;
use dataset::camera::CameraPose;
use dataset::conditions::{Clock, Conditions, Weather};
use dataset::corpus::Corpus;
use dataset::frame_rate::FrameRate;
use dataset::frames::{Frame, Frames, ViewStamp};
use dataset::geodesy::Geodetic;
use dataset::pixel_box::PixelBox;
use dataset::pose::{Controls, Pose};
use dataset::runway::Runway;
use dataset::scenario::{Flight, PINHOLE_SCHEMA_VERSION, ScenarioRecord, Versions};
use dataset::seal::{commit_folder, seal_folder};
use dataset::video::{VideoSettings, VideoWriter};

use crate::detector::{Detector, Picture, ScoredBox, Window};

/// Remaining distance at tick 0, metres.
pub(crate) const START_M: f64 = 9_260.0;
/// Displacement between two ticks, metres.
const STEP_M: f64 = 70.0;
const TICKS: u32 = 3;
const RATE: FrameRate = FrameRate {
    numerator: 1,
    denominator: 1,
};

/// Identifiers of the views.
pub(crate) const VIEWS: [&str; 2] = ["left", "right"];

pub(crate) fn runway() -> Runway {
    Runway {
        airport: "WSSS".into(),
        name: "02L".into(),
        threshold: Geodetic {
            latitude_deg: 1.348_971_96,
            longitude_deg: 103.977_501_24,
            altitude_msl_m: 6.71,
        },
        course_true_deg: 23.02,
        glide_path_deg: 3.0,
        touchdown_past_threshold_m: 340.1,
        ils_frequency_mhz: Some(110.9),
        course_magnetic_deg: None,
    }
}

/// A pose on course with 3 degrees of pitch, `along_track_m` before the target and `cross_track_m` right of the centreline.
pub(crate) fn on_glide_path(along_track_m: f64, cross_track_m: f64) -> Pose {
    let runway = runway();
    let height_m = along_track_m.max(0.0) * runway.glide_path_deg.to_radians().tan();
    let at = runway.point_on_approach(along_track_m, cross_track_m);
    Pose {
        latitude_deg: at.latitude_deg,
        longitude_deg: at.longitude_deg,
        altitude_msl_m: runway.threshold.altitude_msl_m + height_m,
        heading_true_deg: runway.course_true_deg,
        pitch_deg: 3.0,
        roll_deg: 0.0,
    }
}

/// The cameras of the rig `wide-baseline`, as placed.
pub(crate) fn placed(view: &str) -> CameraPose {
    let runway = runway();
    let side = if view == "left" { -1.0 } else { 1.0 };
    let at = runway.point_on_approach(-1_500.0, side * 300.0);
    CameraPose {
        pose: Pose {
            latitude_deg: at.latitude_deg,
            longitude_deg: at.longitude_deg,
            altitude_msl_m: runway.threshold.altitude_msl_m + 10.0,
            // The camera looks back along the course; inward is to its right on the left side.
            heading_true_deg: runway.course_true_deg + 180.0 - side * -5.3,
            pitch_deg: 1.6,
            roll_deg: 0.0,
        },
        hfov_deg: 10.0,
    }
}

/// A tick, one per second, without views.
pub(crate) fn frame(tick: u32, pose: Pose) -> Frame {
    Frame {
        tick,
        time_ns: RATE.time_of_tick(tick).0,
        pose,
        velocity_ned_mps: [64.0, 27.0, 3.7],
        true_airspeed_mps: 72.0,
        controls: Controls {
            flap_ratio: 0.75,
            gear_ratio: 1.0,
        },
        on_ground: false,
        views: Vec::new(),
        labels: None,
    }
}

/// A corpus of committed scenarios without labels and without videos.
pub(crate) fn corpus(root: &Path, ids: &[&str]) -> Corpus {
    corpus_with_videos(root, ids, 1920, 1280, None)
}

/// Draws the picture of a view at a tick.
pub(crate) type Painter<'a> = &'a dyn Fn(&str, u32, &mut [u8]);

/// A corpus of committed scenarios with pictures of the given size.
pub(crate) fn corpus_with_videos(
    root: &Path,
    ids: &[&str],
    width_px: u32,
    height_px: u32,
    paint: Option<Painter<'_>>,
) -> Corpus {
    let corpus = Corpus::create(root).unwrap();
    for id in ids {
        let folder = corpus.partial_scenario(id);
        std::fs::create_dir_all(folder.root().join("views")).unwrap();
        record(id).write(&folder.record_path()).unwrap();
        Calibration::from_poses(VIEWS.map(|view| (view, placed(view))), width_px, height_px)
            .write(&folder.calibration_path())
            .unwrap();
        frames().write(&folder.frames_path()).unwrap();
        for view in VIEWS {
            let Some(paint) = paint else { continue };
            let path = folder.video_path(view);
            let mut writer =
                VideoWriter::create(&path, &VideoSettings::default(), width_px, height_px, RATE)
                    .unwrap();
            let mut rgb = vec![0; (width_px * height_px * 3) as usize];
            for tick in 0..TICKS {
                paint(view, tick, &mut rgb);
                writer.write(&rgb).unwrap();
            }
            writer.finish().unwrap();
        }
        seal_folder(folder.root(), "config").unwrap();
        commit_folder(folder.root(), corpus.scenario(id).root()).unwrap();
    }
    corpus
}

fn frames() -> Frames {
    let row = |tick: u32| {
        let pose = on_glide_path(START_M - STEP_M * f64::from(tick), 0.0);
        let stamp = |view| ViewStamp {
            sim_frame: u64::from(tick) + 100,
            pts: RATE.pts_of_tick(tick),
            echoed_pose: pose,
            echoed_camera: placed(view),
        };
        Frame {
            views: VIEWS.map(stamp).to_vec(),
            ..frame(tick, pose)
        }
    };
    Frames {
        views: VIEWS.map(str::to_owned).to_vec(),
        rows: (0..TICKS).map(row).collect(),
    }
}

fn record(id: &str) -> ScenarioRecord {
    let runway = runway();
    ScenarioRecord {
        schema_version: PINHOLE_SCHEMA_VERSION,
        id: id.into(),
        trajectory: format!("trajectory-of-{id}"),
        seed: 7,
        plan_hash: "plan".into(),
        config_hash: "config".into(),
        aircraft: "B737-800".into(),
        frame_rate: RATE,
        ticks: TICKS,
        touchdown: runway.touchdown_target(),
        runway,
        flight_touchdown: None,
        geoid: None,
        conditions: Conditions {
            time_of_day: "12:00".into(),
            clock: Clock {
                day_of_year: 80,
                zulu_time_s: 14_400.0,
            },
            weather_name: "clear".into(),
            weather: Weather {
                visibility_m: 40_000.0,
                clouds: Vec::new(),
                rain_ratio: 0.0,
                wind_speed_mps: 0.0,
                wind_from_true_deg: 0.0,
                turbulence_ratio: 0.0,
            },
        },
        flight: Flight::Live,
        rig: "wide-baseline".into(),
        views: VIEWS.map(str::to_owned).to_vec(),
        versions: Versions {
            dtd: "0".into(),
            simulator: "fixture".into(),
            capture_link: 1,
            pixels: None,
        },
    }
}

/// A detector for tests: the box around all bright pixels of each connected run of columns in a window.
#[derive(Default)]
pub(crate) struct BlobFinder {
    /// Number of windows that it received.
    pub(crate) windows_seen: usize,
}

const BRIGHT: u8 = 128;
const BLOB_WINDOW_PX: u32 = 640;

/// Paints a box of whole pixels white.
pub(crate) fn paint_blob(rgb: &mut [u8], width_px: u32, blob: &PixelBox) {
    let [left, top, right, bottom] = blob.edges().map(|edge| (edge + 0.5) as usize);
    for row in top..bottom {
        let line = row * width_px as usize;
        rgb[(line + left) * 3..(line + right) * 3].fill(255);
    }
}

impl Detector for BlobFinder {
    fn window_px(&self) -> u32 {
        BLOB_WINDOW_PX
    }

    fn detect(
        &mut self,
        picture: &Picture<'_>,
        windows: &[Window],
        _score_floor: f64,
    ) -> crate::Result<Vec<Vec<ScoredBox>>> {
        self.windows_seen += windows.len();
        Ok(windows
            .iter()
            .map(|window| blobs_in(picture, *window))
            .collect())
    }

    fn description(&self) -> String {
        "finder of bright blobs".into()
    }
}

fn blobs_in(picture: &Picture<'_>, window: Window) -> Vec<ScoredBox> {
    let end = |start: u32, length: u32| (start + BLOB_WINDOW_PX).min(length);
    let rows = window.top_px..end(window.top_px, picture.height_px);
    let green =
        |column: u32, row: u32| picture.rgb[((row * picture.width_px + column) * 3 + 1) as usize];
    // Bright rows of each column, then neighbouring bright columns as one blob.
    let mut blobs: Vec<[u32; 4]> = Vec::new();
    for column in window.left_px..end(window.left_px, picture.width_px) {
        let bright = || rows.clone().filter(|row| green(column, *row) >= BRIGHT);
        let (Some(top), Some(bottom)) = (bright().next(), bright().next_back()) else {
            continue;
        };
        match blobs.last_mut() {
            Some(blob) if blob[2] + 1 == column => {
                *blob = [blob[0], blob[1].min(top), column, blob[3].max(bottom)];
            }
            _ => blobs.push([column, top, column, bottom]),
        }
    }
    let in_window = |blob: [u32; 4]| {
        let [left, top, right, bottom] = blob.map(f64::from);
        let (x, y) = (f64::from(window.left_px), f64::from(window.top_px));
        let pixel_box = PixelBox::from_edges(
            left - x - 0.5,
            top - y - 0.5,
            right - x + 0.5,
            bottom - y + 0.5,
        );
        ScoredBox {
            pixel_box,
            score: 1.0,
        }
    };
    blobs.into_iter().map(in_window).collect()
}
