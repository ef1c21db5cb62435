//! Blocks of ticks from a camera that rests, through the hosted plugin and a real screen: every image shows its own tick, whatever the
//! scene's lag, and equals the settled one.
#![cfg(target_os = "linux")]

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use dataset::conditions::{CloudKind, CloudLayer, Conditions};
use dataset::geometry::camera::{Camera, CameraPose};
use dataset::geometry::pose::{FlightState, Pose};
use dataset::numbers::frame_rate::FrameRate;
use glam::DVec2;
use mock_xplane::server::{FramesDrawn, LinkServer, PluginOptions, SceneBehind, ServerOptions};
use mock_xplane::window::{DisplayWindow, X11Window};
use testkit::short_flight::{camera_beside_runway, down_the_glide_path, noon, runway};
use testkit_simulator::{Xvfb, quiet, serving};
use xplane_bridge::datarefs::Generation;
use xplane_bridge::doctor::{Check, DoctorOptions, Intent, Measuring, Verdict, examine};
use xplane_bridge::link::PictureSize;
use xplane_bridge::pixels::{FfmpegScreen, PixelChoice, Screen};
use xplane_bridge::{
    BlockOfTicks, BlockReport, CaptureRequest, CapturedFrame, Deliver, Simulator, WebApiPlace,
};

/// Images, and the window with the margins for the code.
const SIZE_PX: (u32, u32) = (160, 120);
const WINDOW_PX: (u32, u32) = (192, 152);
const CONNECT_TIMEOUT: Duration = Duration::from_secs(60);
const RATE: FrameRate = FrameRate {
    numerator: 10,
    denominator: 1,
};

/// A stand-in with a window on a separate X server.
struct HostedPlugin {
    _xvfb: Xvfb,
    simulator: Simulator,
    frames: FramesDrawn,
}

/// The stand-in's screen and address.
async fn serve(
    options: PluginOptions,
    clock_rate: f64,
    faults: &str,
) -> (Xvfb, Arc<dyn Screen>, SocketAddr) {
    serve_with(options, clock_rate, faults, "none").await
}

async fn serve_with(
    options: PluginOptions,
    clock_rate: f64,
    faults: &str,
    quirks: &str,
) -> (Xvfb, Arc<dyn Screen>, SocketAddr) {
    let xvfb = Xvfb::start("200x160x24");
    let window = X11Window::open(Some(xvfb.display()), options.window_px).unwrap();
    let address = serving(ServerOptions {
        generation: Generation::XPlane12,
        link: LinkServer::Plugin(options),
        stage: Some(Arc::new(window) as Arc<dyn DisplayWindow>),
        clock_rate,
        faults: faults.parse().unwrap(),
        quirks: quirks.parse().unwrap(),
        ..quiet()
    })
    .await;
    let screen = Arc::new(FfmpegScreen::of_display(xvfb.display()));
    (xvfb, screen, address)
}

async fn shown(options: PluginOptions) -> HostedPlugin {
    shown_with(options, "").await
}

async fn shown_with(options: PluginOptions, faults: &str) -> HostedPlugin {
    let frames = options.frames_drawn.clone();
    let (xvfb, screen, address) = serve(options, 1.0, faults).await;
    let mut simulator = Simulator::connect(address, CONNECT_TIMEOUT).await.unwrap();
    let pixels = simulator.use_pixels(PixelChoice::Auto, SIZE_PX, &screen);
    pixels.await.unwrap();
    HostedPlugin {
        _xvfb: xvfb,
        simulator,
        frames,
    }
}

fn plugin(scene_behind: SceneBehind) -> PluginOptions {
    PluginOptions {
        scene_behind: Some(scene_behind),
        // A screen's refresh rate: without a limit, the stand-in draws frames that no grab catches.
        most_frames_per_s: Some(60.0),
        ..testkit_simulator::plugin::options(WINDOW_PX)
    }
}

/// Two cameras beside the runway that look up the approach.
fn camera(view: u32) -> CameraPose {
    camera_beside_runway(if view == 0 { -60.0 } else { 60.0 })
}

fn first_view(states: &[FlightState]) -> BlockOfTicks<'_> {
    BlockOfTicks {
        first_tick: 0,
        states,
        frame_rate: RATE,
        view: 0,
        camera: camera(0),
        size_px: SIZE_PX,
    }
}

async fn block(
    simulator: &mut Simulator,
    states: &[FlightState],
    view: u32,
) -> (Vec<CapturedFrame>, BlockReport) {
    let ticks = BlockOfTicks {
        view,
        camera: camera(view),
        ..first_view(states)
    };
    let mut recording = simulator.begin_block(ticks).unwrap();
    let mut frames = Vec::new();
    while let Some(frame) = recording.next_picture().await.unwrap() {
        frames.push(frame);
    }
    (frames, recording.report())
}

/// The settled image.
async fn settled(
    simulator: &mut Simulator,
    states: &[FlightState],
    tick: u32,
    view: u32,
) -> CapturedFrame {
    let state = &states[tick as usize];
    let capture = CaptureRequest {
        tick,
        time_ns: RATE.time_of_tick(tick).0,
        view,
        pose: state.pose,
        controls: state.controls,
        camera: camera(view),
        width_px: SIZE_PX.0,
        height_px: SIZE_PX.1,
        deliver: Deliver::Drawn,
    };
    simulator.send_capture(&capture).await.unwrap();
    simulator.receive_frame().await.unwrap()
}

/// Records both views in blocks and compares every image with its tick's settled image.
async fn check(scene_behind: SceneBehind, lags: [u32; 2]) {
    let HostedPlugin {
        mut simulator,
        frames: drawn,
        _xvfb,
    } = shown(plugin(scene_behind)).await;
    assert!(simulator.can_record_blocks());
    simulator.set_conditions(&noon(30_000.0)).await.unwrap();
    simulator.freeze(&runway()).await.unwrap();
    let states = down_the_glide_path(1_200.0, 120, RATE);
    let mut moved = Vec::new();
    let before = drawn.get();
    for view in 0..2 {
        let (frames, report) = block(&mut simulator, &states, view).await;
        assert_eq!(frames.len(), states.len());
        assert!(report.is_measured, "{report:?}");
        assert_eq!(
            report.frames_behind,
            Some(lags[view as usize]),
            "view {view}"
        );
        println!("{scene_behind:?}, view {view}: {report:?}");
        moved.push(frames);
    }
    let frames_a_picture = (drawn.get() - before) as f64 / (2 * states.len()) as f64;
    println!("{scene_behind:?}: {frames_a_picture:.2} frames drawn per image");
    let mut different = 0;
    for view in 0..2 {
        for tick in (0..states.len() as u32).step_by(7) {
            let expected = settled(&mut simulator, &states, tick, view).await;
            let found = &moved[view as usize][tick as usize];
            assert_eq!(found.header.tick, tick);
            assert!(
                *found.rgb == *expected.rgb,
                "{scene_behind:?}: view {view}, tick {tick}"
            );
            let next = moved[view as usize].get(tick as usize + 7);
            different += usize::from(next.is_some_and(|next| *next.rgb != *expected.rgb));
        }
    }
    assert!(different > 20, "the aircraft hardly moves: {different}");
    simulator.confirm_pixels().await.unwrap();
    simulator.release().await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn every_picture_of_a_block_is_the_settled_one_whatever_the_lag() {
    // The next two tests cover lags of one and three frames.
    for lag in [0, 4] {
        check(SceneBehind::Constant(lag), [lag as u32; 2]).await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_lag_may_differ_between_the_views() {
    // The first camera of all is the one that X-Plane had before.
    check(SceneBehind::ByCamera([3, 1]), [1, 3]).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_lag_that_changes_in_mid_block_gives_no_picture_of_another_tick() {
    let changed = SceneBehind::Changed {
        before: 1,
        after: 3,
        moves: 60,
    };
    check(changed, [3, 3]).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_camera_that_is_taken_away_costs_frames_and_no_picture() {
    let HostedPlugin {
        mut simulator,
        _xvfb,
        ..
    } = shown(PluginOptions {
        steal_camera_every_frames: Some(37),
        ..plugin(SceneBehind::Constant(2))
    })
    .await;
    simulator.set_conditions(&noon(30_000.0)).await.unwrap();
    simulator.freeze(&runway()).await.unwrap();
    let states = down_the_glide_path(1_200.0, 90, RATE);
    let (frames, report) = block(&mut simulator, &states, 0).await;
    println!("{report:?}");
    for tick in (0..90).step_by(9) {
        let expected = settled(&mut simulator, &states, tick, 0).await;
        assert!(*frames[tick as usize].rgb == *expected.rgb, "tick {tick}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn numbers_that_are_repeated_missing_or_half_give_no_picture_of_another_tick() {
    let states = down_the_glide_path(1_200.0, 60, RATE);
    let mut expected: Option<Vec<Vec<CapturedFrame>>> = None;
    for faults in [
        "",
        "repeat=0.01",
        "repeat=0.05",
        "repeat=0.2",
        "vanish=0.05",
        "half=0.05",
        "insert=0.2",
        "repeat=0.05,vanish=0.02,half=0.02",
    ] {
        let HostedPlugin {
            mut simulator,
            _xvfb,
            ..
        } = shown_with(plugin(SceneBehind::Constant(1)), faults).await;
        simulator.set_conditions(&noon(30_000.0)).await.unwrap();
        simulator.freeze(&runway()).await.unwrap();
        let mut found = Vec::new();
        for view in 0..2 {
            let (frames, report) = block(&mut simulator, &states, view).await;
            assert_eq!(report.held, 0, "{faults}, view {view}: {report:?}");
            found.push(frames);
        }
        if let Some(expected) = &expected {
            let pairs = found.iter().flatten().zip(expected.iter().flatten());
            let wrong = pairs.filter(|(found, expected)| *found.rgb != *expected.rgb);
            assert_eq!(wrong.count(), 0, "{faults}");
        }
        simulator.confirm_pixels().await.unwrap();
        simulator.release().await.unwrap();
        expected.get_or_insert(found);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_scene_that_moves_slowly_in_a_pause_is_recorded_in_blocks_and_one_that_moves_all_over_tick_by_tick()
 {
    let states = down_the_glide_path(1_200.0, 60, RATE);
    for (faults, is_held) in [("swing=40:3:6:20", false), ("swing=3000:3:6:150", true)] {
        let HostedPlugin {
            mut simulator,
            _xvfb,
            ..
        } = shown_with(plugin(SceneBehind::Constant(1)), faults).await;
        simulator.set_conditions(&noon(30_000.0)).await.unwrap();
        simulator.freeze(&runway()).await.unwrap();
        let (frames, report) = block(&mut simulator, &states, 0).await;
        println!("{faults}: {report:?}");
        assert_eq!(frames.len(), states.len());
        assert_eq!(report.held > 0, is_held, "{report:?}");
        if is_held {
            continue;
        }
        let frame = settled(&mut simulator, &states, 30, 0).await;
        let parts = Parts::of(&camera(0), &states[30].pose);
        let differing = differing(&frames[30].rgb, &frame.rgb, AIRCRAFT_LEVELS, |at| {
            parts.has_aircraft(at)
        });
        assert!(
            differing <= MORE_PIXELS,
            "{differing} pixels of the aircraft differ"
        );
        simulator.release().await.unwrap();
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn in_fog_without_a_known_lag_every_tick_is_held_and_right() {
    let HostedPlugin {
        mut simulator,
        _xvfb,
        ..
    } = shown(plugin(SceneBehind::Constant(4))).await;
    simulator.set_conditions(&noon(1_500.0)).await.unwrap();
    simulator.freeze(&runway()).await.unwrap();
    let states = down_the_glide_path(12_000.0, 20, RATE);
    let (frames, report) = block(&mut simulator, &states, 0).await;
    assert_eq!((report.held, report.frames_behind), (20, None));
    assert_eq!(frames.len(), 20);
}

/// A pixel of the ground differs if a colour does by more than this, levels ...
const GROUND_LEVELS: u8 = 4;
/// ... and one of the aircraft, before clouds that drift and behind streaks of rain, by this.
const AIRCRAFT_LEVELS: u8 = 24;
/// Half the aircraft's size, metres, and the margin for its edges, pixels.
const AIRCRAFT_M: f64 = 22.0;
const AROUND_PX: f64 = 2.0;
/// Maximum differing pixels between a block image and a settled one: this multiple of the difference of two settled ones (streaks), plus
/// [`MORE_PIXELS`].
const NOISE_FACTOR: f64 = 1.5;
const MORE_PIXELS: usize = 8;

fn rainy() -> Conditions {
    let mut rainy = noon(20_000.0);
    rainy.weather_name = "stormy".into();
    rainy.weather.rain_ratio = 0.6;
    rainy.weather.clouds = vec![CloudLayer {
        kind: CloudKind::Cumulonimbus,
        cover_ratio: 0.9,
        base_msl_m: 1_000.0,
        top_msl_m: 9_000.0,
    }];
    rainy
}

/// Areas of the ground and the aircraft in an image.
struct Parts {
    horizon_px: f64,
    aircraft: [DVec2; 2],
}

impl Parts {
    fn of(placed: &CameraPose, pose: &Pose) -> Self {
        let camera = Camera::from_pose(placed, SIZE_PX.0, SIZE_PX.1);
        let at = camera.to_camera(pose.position().to_ecef());
        let half = DVec2::splat(camera.focal_px * AIRCRAFT_M / at.z + AROUND_PX);
        let centre = camera.pixel_of(at);
        let slope = placed.pose.pitch_deg.to_radians().tan();
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

/// Number of pixels in a part that differ by more than `levels`.
fn differing(one: &[u8], other: &[u8], levels: u8, is_part: impl Fn(DVec2) -> bool) -> usize {
    let pairs = one.as_chunks::<3>().0.iter().zip(other.as_chunks::<3>().0);
    let place = |at: usize| {
        let (x, y) = (at as u32 % SIZE_PX.0, at as u32 / SIZE_PX.0);
        DVec2::new(f64::from(x), f64::from(y))
    };
    let differs = |a: &[u8; 3], b: &[u8; 3]| a.iter().zip(b).any(|(a, b)| a.abs_diff(*b) > levels);
    pairs
        .enumerate()
        .filter(|(at, (a, b))| is_part(place(*at)) && differs(a, b))
        .count()
}

#[tokio::test(flavor = "multi_thread")]
async fn where_time_runs_a_block_shows_aircraft_and_ground_as_settled_pictures_do_but_for_the_rain()
{
    let HostedPlugin {
        mut simulator,
        _xvfb,
        ..
    } = shown(plugin(SceneBehind::Constant(2))).await;
    simulator.set_conditions(&rainy()).await.unwrap();
    simulator.freeze(&runway()).await.unwrap();
    assert!(simulator.time_runs());
    let states = down_the_glide_path(400.0, 50, RATE);
    let mut of_another_tick = 0;
    for view in 0..2 {
        let (frames, _) = block(&mut simulator, &states, view).await;
        for tick in (0..states.len() as u32).step_by(7) {
            let expected = settled(&mut simulator, &states, tick, view).await.rgb;
            // A different tick between them, so that both have settled.
            settled(&mut simulator, &states, (tick + 25) % 50, view).await;
            let again = settled(&mut simulator, &states, tick, view).await.rgb;
            let parts = Parts::of(&camera(view), &states[tick as usize].pose);
            let ground = |found: &[u8]| {
                differing(found, &expected, GROUND_LEVELS, |at| parts.has_ground(at))
            };
            let aircraft = |found: &[u8]| {
                differing(found, &expected, AIRCRAFT_LEVELS, |at| {
                    parts.has_aircraft(at)
                })
            };
            let most = |noise: usize| (NOISE_FACTOR * noise as f64) as usize + MORE_PIXELS;
            let found = &frames[tick as usize].rgb;
            for (part, pixels, noise) in [
                ("ground", ground(found), ground(&again)),
                ("aircraft", aircraft(found), aircraft(&again)),
            ] {
                assert!(
                    pixels <= most(noise),
                    "view {view}, tick {tick}, {part}: {pixels} pixels differ, {noise} between settled ones"
                );
            }
            if let Some(later) = frames.get(tick as usize + 7) {
                of_another_tick += usize::from(aircraft(&later.rgb) > most(aircraft(&again)));
            }
        }
    }
    assert!(
        of_another_tick > 6,
        "the aircraft hardly moves: {of_another_tick}"
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn the_doctor_measures_the_pace_in_blocks_where_the_window_has_margins_around_the_pictures() {
    let (_xvfb, screen, address) = serve(plugin(SceneBehind::Constant(1)), 20.0, "").await;
    let options = doctor(screen, address);
    let pictures = options.intent.as_ref().unwrap().pictures;
    let checks = examine(&options, &mut |_| {}).await;
    let graphics = found(&checks, "graphics");
    assert_eq!(graphics.verdict, Verdict::Ok);
    for words in [
        "plugins' renderer zink",
        "renopt_MSAA 0",
        "Desktop session type x11",
    ] {
        assert!(graphics.found.contains(words), "{graphics:?}");
    }
    let simulator = Simulator::connect(address, CONNECT_TIMEOUT).await.unwrap();
    let profile = simulator.profile().current().cloned();
    simulator.release().await.unwrap();
    let profile = profile.unwrap_or_else(|| panic!("{checks:#?}"));
    let pace = profile
        .pace
        .found()
        .unwrap_or_else(|| panic!("{checks:#?}"));
    assert!(pace.in_blocks && pace.size == pictures, "{checks:#?}");
    // The checks after it see the whole window again.
    for name in ["lockstep", "flaps and gear"] {
        assert_eq!(found(&checks, name).verdict, Verdict::Ok, "{checks:#?}");
    }
    // With a profile, each sweep still has its answer.
    let of_window = Intent {
        sweep: "others.toml".into(),
        pictures: PictureSize {
            width_px: WINDOW_PX.0,
            height_px: WINDOW_PX.1,
        },
    };
    for (intent, procedure) in [
        (options.intent.clone(), "rests for blocks of ticks"),
        (Some(of_window), "each settled"),
    ] {
        let options = DoctorOptions {
            intent,
            ..doctor(options.screen.clone(), address)
        };
        let checks = examine(&options, &mut |_| {}).await;
        let pace = found(&checks, "pace");
        assert!(pace.found.contains(procedure), "{checks:#?}");
    }
}

fn doctor(screen: Arc<dyn Screen>, address: SocketAddr) -> DoctorOptions {
    let pictures = PictureSize {
        width_px: SIZE_PX.0,
        height_px: SIZE_PX.1,
    };
    DoctorOptions {
        web_api: WebApiPlace::Off,
        listen: Duration::from_millis(1),
        screen,
        intent: Some(Intent {
            sweep: "sweep.toml".into(),
            pictures,
        }),
        ..DoctorOptions::at(Some(address))
    }
}

fn found<'a>(checks: &'a [Check], name: &str) -> &'a Check {
    let check = checks.iter().find(|check| check.name == name);
    check.unwrap_or_else(|| panic!("no {name}: {checks:#?}"))
}

/// The checks of a first hour with a simulator with these quirks.
async fn first_hour(quirks: &str) -> Vec<Check> {
    let options = PluginOptions {
        // The landing takes two minutes of simulated time.
        frame_period_s: 0.1,
        ..plugin(SceneBehind::Constant(2))
    };
    let (_xvfb, screen, address) = serve_with(options, 20.0, "", quirks).await;
    let options = DoctorOptions {
        measuring: Measuring::Never,
        first_hour: Some(runway()),
        ..doctor(screen, address)
    };
    examine(&options, &mut |_| {}).await
}

#[tokio::test(flavor = "multi_thread")]
async fn the_first_hour_compares_moving_parts_in_blocks_and_lands() {
    let checks = first_hour("none").await;
    for name in [
        "grab",
        "flaps and gear",
        "moving parts",
        "shadow and lights",
        "load",
        "autopilot",
    ] {
        assert_eq!(found(&checks, name).verdict, Verdict::Ok, "{checks:#?}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_first_hour_notices_parts_that_follow_a_frame_late_and_parts_that_are_not_drawn() {
    let checks = first_hour("lagging_parts").await;
    let parts = found(&checks, "moving parts");
    assert_eq!(parts.verdict, Verdict::Warning, "{checks:#?}");
    let checks = first_hour("fixed_parts").await;
    let parts = found(&checks, "flaps and gear");
    assert_eq!(parts.verdict, Verdict::Warning, "{checks:#?}");
}
