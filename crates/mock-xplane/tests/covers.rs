//! Covers over the hosted plugin's window: found at the registration, and named; and in no image of a block.
#![cfg(target_os = "linux")]

use std::sync::Arc;
use std::time::Duration;

use dataset::numbers::frame_rate::FrameRate;
use mock_xplane::quirks::{Quirk, Quirks};
use mock_xplane::server::{LinkServer, PluginOptions, ServerOptions, WindowCovers, WindowForm};
use mock_xplane::window::{DisplayWindow, X11Window};
use testkit::short_flight::{camera_beside_runway, down_the_glide_path, noon, runway};
use testkit_simulator::{CoverWindow, Xvfb, plugin, quiet, serving};
use xplane_bridge::datarefs::Generation;
use xplane_bridge::pixels::{FfmpegScreen, PixelChoice, PixelError, Rectangle, Screen};
use xplane_bridge::{BlockOfTicks, BridgeError, Simulator};

const SIZE_PX: (u32, u32) = (480, 320);
const PATIENCE: Duration = Duration::from_secs(60);
/// Two percent of the window: left, top, width, height.
const PLACE_PX: [u32; 4] = [200, 140, 96, 32];

/// An X-Plane 12 whose window is on a separate X server.
struct OnScreen {
    xvfb: Xvfb,
    covers: WindowCovers,
    simulator: Simulator,
}

impl OnScreen {
    async fn start() -> Self {
        Self::start_with(SIZE_PX).await
    }

    async fn start_with(window_px: (u32, u32)) -> Self {
        Self::start_at(window_px, 60.0).await
    }

    async fn start_at(window_px: (u32, u32), most_frames_per_s: f64) -> Self {
        let xvfb = Xvfb::start("540x380x24");
        let window = X11Window::open(Some(xvfb.display()), window_px).unwrap();
        let options = PluginOptions {
            most_frames_per_s: Some(most_frames_per_s),
            ..plugin::options(window_px)
        };
        let covers = options.window_covers.clone();
        let address = serving(ServerOptions {
            generation: Generation::XPlane12,
            link: LinkServer::Plugin(options),
            stage: Some(Arc::new(window) as Arc<dyn DisplayWindow>),
            // A draw callback that asks to come before the windows does so in X-Plane's own documents.
            quirks: Quirks::NONE.with(Quirk::DrawBeforeIsOne),
            ..quiet()
        })
        .await;
        Self {
            xvfb,
            covers,
            simulator: Simulator::connect(address, PATIENCE).await.unwrap(),
        }
    }

    async fn register(&mut self) -> Result<(), BridgeError> {
        let screen: Arc<dyn Screen> = Arc::new(FfmpegScreen::of_display(self.xvfb.display()));
        let registered = self
            .simulator
            .use_pixels(PixelChoice::Auto, SIZE_PX, &screen);
        registered.await.map(|_| ())
    }
}

fn assert_names(cover: Rectangle) {
    let [left, top, width, height] = PLACE_PX;
    for (found, expected) in [
        (cover.x_px, left),
        (cover.y_px, top),
        (cover.x_px + cover.width_px, left + width),
        (cover.y_px + cover.height_px, top + height),
    ] {
        assert!(found.abs_diff(expected) <= 16, "{cover}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn windows_of_the_simulator_are_found_at_the_registration_because_the_pattern_lies_under_them()
 {
    let mut shown = OnScreen::start().await;
    for form in [WindowForm::Message, WindowForm::Plugin] {
        let [left, top, width, height] = PLACE_PX;
        let area_px = [left, top, left + width, top + height];
        shown.covers.show(form, area_px, PATIENCE);
        match shown.register().await {
            Err(BridgeError::Pixels(PixelError::WindowOverScene { cover, .. })) => {
                assert_names(cover);
            }
            other => panic!("{form:?}: {other:?}"),
        }
        shown.covers.close_all();
        shown.register().await.unwrap();
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn windows_of_other_programs_are_found_at_the_registration_and_after_the_recording() {
    let mut shown = OnScreen::start().await;
    let place = PLACE_PX.map(|px| px as i32);
    let display = Some(shown.xvfb.display().to_owned());
    let open = |is_notification: bool| {
        let display = display.as_deref();
        if is_notification {
            CoverWindow::notification(display, place).unwrap()
        } else {
            CoverWindow::pointer_with_hint(display, place).unwrap()
        }
    };
    for is_notification in [true, false] {
        let cover = open(is_notification);
        match shown.register().await {
            Err(BridgeError::Pixels(PixelError::ProgramOverWindow { cover, .. })) => {
                assert_names(cover);
            }
            other => panic!("notification: {is_notification}: {other:?}"),
        }
        drop(cover);
        shown.register().await.unwrap();
        let cover = open(is_notification);
        let error = shown.simulator.confirm_pixels().await.unwrap_err();
        let BridgeError::Pixels(PixelError::ProgramOverWindow { cover: named, .. }) = error else {
            panic!("notification: {is_notification}: {error}");
        };
        assert_names(named);
        drop(cover);
    }
}

/// Object put over the window.
#[derive(Debug, Clone, Copy)]
enum Form {
    Message,
    PluginWindow,
    Notification,
    Pointer,
}

/// Puts it there for a second, some time after now.
fn cover_for_a_second(form: Form, covers: WindowCovers, display: String, after: Duration) {
    let [left, top, width, height] = PLACE_PX;
    let second = Duration::from_secs(1);
    std::thread::spawn(move || {
        std::thread::sleep(after);
        let area_px = [left, top, left + width, top + height];
        let place = PLACE_PX.map(|px| px as i32);
        let window = match form {
            Form::Message => {
                covers.show(WindowForm::Message, area_px, second);
                return;
            }
            Form::PluginWindow => {
                covers.show(WindowForm::Plugin, area_px, second);
                return;
            }
            Form::Notification => CoverWindow::notification(Some(&display), place),
            Form::Pointer => CoverWindow::pointer_with_hint(Some(&display), place),
        };
        std::thread::sleep(second);
        drop(window.unwrap());
    });
}

#[tokio::test(flavor = "multi_thread")]
async fn a_cover_that_comes_for_a_second_while_a_block_is_recorded_is_in_none_of_its_pictures() {
    let window_px = (SIZE_PX.0 + 32, SIZE_PX.1 + 32);
    let mut shown = OnScreen::start_with(window_px).await;
    shown.register().await.unwrap();
    let simulator = &mut shown.simulator;
    simulator.set_conditions(&noon(30_000.0)).await.unwrap();
    simulator.freeze(&runway()).await.unwrap();
    let (expected, _) = block(simulator, 150).await.unwrap();
    for form in [
        Form::Message,
        Form::PluginWindow,
        Form::Notification,
        Form::Pointer,
    ] {
        // It may come before the first image, or after the last.
        let mut covered = 0;
        for after_ms in [500, 1_500, 2_500, 3_500, 4_500] {
            let (covers, display) = (shown.covers.clone(), shown.xvfb.display().to_owned());
            cover_for_a_second(form, covers, display, Duration::from_millis(after_ms));
            let (found, repeated) = block(&mut shown.simulator, 150).await.unwrap();
            for (tick, (found, expected)) in found.iter().zip(&expected).enumerate() {
                assert!(found == expected, "{form:?}: tick {tick}");
            }
            covered += repeated;
            if covered > 0 {
                break;
            }
        }
        assert!(covered > 0, "{form:?}: no image was covered");
    }
}

/// Every grab of a covered frame shows the cover, not only the first one.
#[tokio::test(flavor = "multi_thread")]
async fn a_cover_over_frames_that_are_grabbed_many_times_is_in_none_of_the_pictures() {
    let window_px = (SIZE_PX.0 + 32, SIZE_PX.1 + 32);
    let mut shown = OnScreen::start_at(window_px, 6.0).await;
    shown.register().await.unwrap();
    let simulator = &mut shown.simulator;
    simulator.set_conditions(&noon(30_000.0)).await.unwrap();
    simulator.freeze(&runway()).await.unwrap();
    let (expected, _) = block(simulator, 30).await.unwrap();
    for form in [Form::Message, Form::Notification] {
        let (covers, display) = (shown.covers.clone(), shown.xvfb.display().to_owned());
        cover_for_a_second(form, covers, display, Duration::from_millis(4_000));
        let (found, repeated) = block(&mut shown.simulator, 30).await.unwrap();
        for (tick, (found, expected)) in found.iter().zip(&expected).enumerate() {
            assert!(found == expected, "{form:?}: tick {tick}");
        }
        assert!(repeated > 0, "{form:?}: no image was covered");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_cover_from_before_a_block_until_after_it_is_waited_for_or_ends_it_where_time_runs() {
    let [left, top, width, height] = PLACE_PX;
    let area_px = [left, top, left + width, top + height];
    for rain_ratio in [0.0, 0.6] {
        let mut shown = OnScreen::start_with((SIZE_PX.0 + 32, SIZE_PX.1 + 32)).await;
        shown.register().await.unwrap();
        let mut conditions = noon(30_000.0);
        conditions.weather.rain_ratio = rain_ratio;
        let simulator = &mut shown.simulator;
        simulator.set_conditions(&conditions).await.unwrap();
        simulator.freeze(&runway()).await.unwrap();
        let (expected, _) = block(simulator, 20).await.unwrap();
        let shown_for = Duration::from_secs(if rain_ratio > 0.0 { 10 } else { 3 });
        shown.covers.show(WindowForm::Message, area_px, shown_for);
        match block(simulator, 20).await {
            Ok((found, _)) if rain_ratio == 0.0 => {
                assert!(found == expected, "an image shows the cover");
            }
            Err(BridgeError::Pixels(PixelError::CoveredBefore { .. })) if rain_ratio > 0.0 => {}
            other => panic!(
                "rain {rain_ratio}: {:?}",
                other.map(|(found, _)| found.len())
            ),
        }
    }
}

/// The images of ticks down the glide path, from beside the runway, and how many were taken again.
async fn block(simulator: &mut Simulator, ticks: u32) -> Result<(Vec<Vec<u8>>, u32), BridgeError> {
    let frame_rate = FrameRate {
        numerator: 10,
        denominator: 1,
    };
    let states = down_the_glide_path(3_500.0, ticks, frame_rate);
    let mut recording = simulator
        .begin_block(BlockOfTicks {
            first_tick: 0,
            states: &states,
            frame_rate,
            view: 0,
            camera: camera_beside_runway(-300.0),
            size_px: SIZE_PX,
        })
        .unwrap();
    let mut pictures = Vec::new();
    while let Some(frame) = recording.next_picture().await? {
        pictures.push(frame.rgb.to_vec());
    }
    let report = recording.report();
    println!("{report:?}");
    Ok((pictures, report.repeated))
}
