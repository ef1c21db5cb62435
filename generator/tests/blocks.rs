//! Scenarios recorded in blocks off a real screen, through the plugin's own Python.
#![cfg(target_os = "linux")]

mod small_corpus;

use std::path::Path;
use std::sync::Arc;

use dataset::camera::{Camera, CameraPose};
use dataset::corpus::Corpus;
use dataset::pose::Pose;
use dataset::scenario::Blocks;
use dataset::verify::verify;
use dataset::video::VideoReader;
use generator::generate::{Cancel, GenerateOptions, SimulatorTarget, generate};
use glam::DVec2;
use mock_xplane::server::{LinkServer, PluginOptions, SceneBehind, ServerOptions};
use mock_xplane::window::{DisplayWindow, X11Window};
use small_corpus::{IDS, options, sweep_of, sweep_toml};
use testkit::sweep::{FOUR_WEATHERS, SmallSweep, starting_from};
use testkit_simulator::{Xvfb, quiet, serving};
use xplane_bridge::datarefs::Generation;
use xplane_bridge::pixels::{FfmpegScreen, PixelChoice};

/// The scenario that flies a recording.
const ID: &str = IDS[1];

/// Records it with a window of this size; returns how.
async fn record(folder: &Path, window_px: (u32, u32), scene_behind: usize) -> Option<Blocks> {
    let sweep = sweep_toml() + "\n[video]\ncodec = \"h264-lossless\"\n";
    record_of(&sweep, ID, folder, window_px, scene_behind).await
}

/// Records a scenario of a sweep.
async fn record_of(
    sweep: &str,
    id: &str,
    folder: &Path,
    window_px: (u32, u32),
    scene_behind: usize,
) -> Option<Blocks> {
    let xvfb = Xvfb::start("240x200x24");
    let window = X11Window::open(Some(xvfb.display()), window_px).unwrap();
    let address = serving(ServerOptions {
        generation: Generation::XPlane12,
        link: LinkServer::Plugin(PluginOptions {
            scene_behind: Some(SceneBehind::Constant(scene_behind)),
            most_frames_per_s: Some(60.0),
            ..testkit_simulator::plugin::options(window_px)
        }),
        stage: Some(Arc::new(window) as Arc<dyn DisplayWindow>),
        ..quiet()
    })
    .await;
    let options = GenerateOptions {
        pixels: PixelChoice::Auto,
        screen: Arc::new(FfmpegScreen::of_display(xvfb.display())),
        ..options(SimulatorTarget::Address(address), &[id])
    };
    let sweep = sweep_of(sweep);
    let outcome = generate(&sweep, folder, &options, &Cancel::new(), &mut |_| ()).await;
    let outcome = outcome.unwrap();
    assert_eq!(outcome.committed, [id], "{:?}", outcome.failed);
    let corpus = Corpus::open(folder).unwrap();
    let faults = verify(&corpus).findings;
    let only_missing = faults
        .iter()
        .all(|fault| fault.to_string().contains("missing"));
    assert!(only_missing, "{faults:#?}");
    corpus.scenario(id).open().unwrap().record().unwrap().blocks
}

#[tokio::test(flavor = "multi_thread")]
async fn a_window_with_margins_is_recorded_in_blocks_and_one_without_picture_by_picture() {
    let folder = tempfile::tempdir().unwrap();
    let blocks = record(&folder.path().join("blocks"), (128, 96), 3)
        .await
        .unwrap();
    assert_eq!((blocks.frames_behind, blocks.held_ticks), (vec![3], 0));
    assert_eq!((blocks.count, blocks.measured), (2, 2));
    let settled = record(&folder.path().join("settled"), (96, 64), 3).await;
    assert_eq!(settled, None);
}

const RAINY_ID: &str = "1200-stormy-r1";
const RAINY_SIZE_PX: (u32, u32) = (160, 120);
/// A pixel of the ground differs if a colour does by more than this, levels ...
const GROUND_LEVELS: u8 = 4;
/// ... and one of the aircraft, before clouds that have drifted, by this.
const AIRCRAFT_LEVELS: u8 = 24;
/// Half the aircraft's size, metres, and what its edges add, pixels.
const AIRCRAFT_M: f64 = 22.0;
const AROUND_PX: f64 = 2.0;
/// Two procedures may differ in this many times the pixels in which streaks make one of them differ from itself, and in so many more.
const NOISE_FACTOR: f64 = 1.5;
const MORE_PIXELS: usize = 8;

/// A rainy flight of some ticks, a second apart.
fn rainy_sweep() -> String {
    let tables = "[[recorded]]\nfiles = \"flights/01_calm_ils.csv\"\nweathers = [\"stormy\"]\n";
    SmallSweep {
        name: "rain",
        seed: 0,
        weathers: &["stormy"],
        repeats: 1,
        size_px: RAINY_SIZE_PX,
        frame_rate: "1/1",
        tables: &format!(
            "{tables}{}{FOUR_WEATHERS}[video]\ncodec = \"h264-lossless\"\n",
            starting_from(0.5, 0.5, 200)
        ),
    }
    .toml()
}

/// Whether a pixel belongs to the ground, or to the aircraft.
struct Places {
    horizon_px: f64,
    aircraft: [DVec2; 2],
}

impl Places {
    fn of(placed: &CameraPose, pose: &Pose) -> Self {
        let camera = Camera::from_pose(placed, RAINY_SIZE_PX.0, RAINY_SIZE_PX.1);
        let slope = placed.pose.pitch_deg.to_radians().tan();
        let at = camera.to_camera(pose.position().to_ecef());
        let half = DVec2::splat(camera.focal_px * AIRCRAFT_M / at.z + AROUND_PX);
        let centre = camera.pixel_of(at);
        Self {
            horizon_px: camera.principal_px.y + camera.focal_px * slope,
            aircraft: [centre - half, centre + half],
        }
    }

    fn has_aircraft(&self, at: DVec2) -> bool {
        let [low, high] = self.aircraft;
        at.cmpge(low).all() && at.cmple(high).all()
    }

    fn has_ground(&self, at: DVec2) -> bool {
        at.y > self.horizon_px + AROUND_PX && !self.has_aircraft(at)
    }
}

/// The number of pixels of a part that differ by more than `levels`.
fn differing(one: &[u8], other: &[u8], levels: u8, is_part: impl Fn(DVec2) -> bool) -> usize {
    let pairs = one.as_chunks::<3>().0.iter().zip(other.as_chunks::<3>().0);
    let place = |at: usize| {
        let (x, y) = (at as u32 % RAINY_SIZE_PX.0, at as u32 / RAINY_SIZE_PX.0);
        DVec2::new(f64::from(x), f64::from(y))
    };
    let differs = |a: &[u8; 3], b: &[u8; 3]| a.iter().zip(b).any(|(a, b)| a.abs_diff(*b) > levels);
    pairs
        .enumerate()
        .filter(|(at, (a, b))| is_part(place(*at)) && differs(a, b))
        .count()
}

#[tokio::test(flavor = "multi_thread")]
async fn where_time_runs_blocks_show_aircraft_and_ground_as_settled_pictures_do_but_for_the_rain() {
    let folder = tempfile::tempdir().unwrap();
    let (width_px, height_px) = RAINY_SIZE_PX;
    let with_margins = (width_px + 32, height_px + 32);
    let windows = [RAINY_SIZE_PX, RAINY_SIZE_PX, with_margins];
    let mut recorded = Vec::new();
    for (number, window_px) in windows.into_iter().enumerate() {
        let corpus = folder.path().join(number.to_string());
        let blocks = record_of(&rainy_sweep(), RAINY_ID, &corpus, window_px, 1).await;
        assert_eq!(blocks.is_some(), window_px == with_margins, "{blocks:?}");
        recorded.push(Corpus::open(&corpus).unwrap().scenario(RAINY_ID));
    }
    let opened = recorded[2].open().unwrap();
    let (record, frames) = (opened.record().unwrap(), opened.frames().unwrap());
    let calibration = opened.calibration().unwrap();
    assert!(
        record.blocks.unwrap().count > 2,
        "more than one block a view"
    );
    let mut seen = 0;
    for view in &record.views {
        let mut videos: Vec<VideoReader> = recorded
            .iter()
            .map(|scenario| VideoReader::open(&scenario.video_path(view)).unwrap())
            .collect();
        for row in &frames.rows {
            let [settled, again, block] = [0, 1, 2].map(|number: usize| {
                let mut rgb = Vec::new();
                videos[number].next_frame(&mut rgb).unwrap().unwrap();
                rgb
            });
            let places = Places::of(&calibration.cameras[view].placed, &row.pose);
            let ground = |one: &[u8], other: &[u8]| {
                differing(one, other, GROUND_LEVELS, |at| places.has_ground(at))
            };
            let aircraft = |one: &[u8], other: &[u8]| {
                differing(one, other, AIRCRAFT_LEVELS, |at| places.has_aircraft(at))
            };
            for (part, found, noise) in [
                ("ground", ground(&block, &settled), ground(&again, &settled)),
                (
                    "aircraft",
                    aircraft(&block, &settled),
                    aircraft(&again, &settled),
                ),
            ] {
                let most = NOISE_FACTOR * noise as f64 + MORE_PIXELS as f64;
                assert!(
                    found as f64 <= most,
                    "tick {} of {view}, {part}: {found} pixels differ, {noise} between settled ones",
                    row.tick
                );
                seen += usize::from(part == "aircraft");
            }
        }
    }
    assert!(seen > 20, "{seen} pictures");
}
