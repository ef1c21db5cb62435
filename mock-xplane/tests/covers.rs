//! Covers over the hosted plugin's window: found at the registration, and named; and in no picture of a block.
#![cfg(target_os = "linux")]

use std::sync::Arc;
use std::time::Duration;

use dataset::camera::CameraPose;
use dataset::conditions::{Clock, Conditions, Weather};
use dataset::frame_rate::FrameRate;
use dataset::pose::{Controls, FlightState, Pose};
use dataset::runway::Runway;
use mock_xplane::quirks::{Quirk, Quirks};
use mock_xplane::server::{LinkServer, PluginOptions, ServerOptions, WindowCovers, WindowForm};
use mock_xplane::window::{CoverWindow, DisplayWindow, X11Window};
use testkit::changi_02l;
use testkit_simulator::{Xvfb, plugin, quiet, serving};
use xplane_bridge::datarefs::Generation;
use xplane_bridge::pixels::{FfmpegScreen, PixelChoice, PixelError, Rectangle, Screen};
use xplane_bridge::{BlockOfTicks, BridgeError, Simulator};

const SIZE_PX: (u32, u32) = (480, 320);
const PATIENCE: Duration = Duration::from_secs(60);
/// Two percent of the window: left, top, width, height.
const PLACE_PX: [u32; 4] = [200, 140, 96, 32];

/// An X-Plane 12 whose window is on an X server of its own.
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
        let xvfb = Xvfb::start("540x380x24");
        let window = X11Window::open(Some(xvfb.display()), window_px).unwrap();
        let options = PluginOptions {
            most_frames_per_s: Some(60.0),
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

/// What is put over the window.
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
    simulator.set_conditions(&noon()).await.unwrap();
    simulator.freeze(&runway()).await.unwrap();
    let (expected, _) = block(simulator).await;
    for (number, form) in [
        Form::Message,
        Form::PluginWindow,
        Form::Notification,
        Form::Pointer,
    ]
    .into_iter()
    .enumerate()
    {
        let (covers, display) = (shown.covers.clone(), shown.xvfb.display().to_owned());
        let after = Duration::from_millis(500 + 150 * number as u64);
        cover_for_a_second(form, covers, display, after);
        let (found, repeated) = block(&mut shown.simulator).await;
        assert!(repeated > 0, "{form:?}: no picture was covered");
        for (tick, (found, expected)) in found.iter().zip(&expected).enumerate() {
            assert!(found == expected, "{form:?}: tick {tick}");
        }
    }
}

fn runway() -> Runway {
    Runway {
        course_magnetic_deg: Some(23.0),
        ..changi_02l()
    }
}

fn noon() -> Conditions {
    Conditions {
        time_of_day: "12:00".into(),
        clock: Clock {
            day_of_year: 172,
            zulu_time_s: 4.0 * 3_600.0,
        },
        weather_name: "clear".into(),
        weather: Weather {
            visibility_m: 30_000.0,
            clouds: Vec::new(),
            rain_ratio: 0.0,
            wind_speed_mps: 0.0,
            wind_from_true_deg: 0.0,
            turbulence_ratio: 0.0,
        },
    }
}

/// The pictures of 150 ticks down the glide path, from beside the runway, and how many were taken again.
async fn block(simulator: &mut Simulator) -> (Vec<Vec<u8>>, u32) {
    let frame_rate = FrameRate {
        numerator: 10,
        denominator: 1,
    };
    let states: Vec<FlightState> = (0..150)
        .map(|tick| {
            let time_s = frame_rate.time_of_tick(tick).seconds();
            let to_go_m = 3_500.0 - 72.0 * time_s;
            let at = runway().point_on_approach(to_go_m, 0.0);
            FlightState {
                time_s,
                pose: Pose {
                    latitude_deg: at.latitude_deg,
                    longitude_deg: at.longitude_deg,
                    altitude_msl_m: 7.0 + to_go_m * 0.0524,
                    heading_true_deg: 23.02,
                    pitch_deg: 3.0,
                    roll_deg: 0.0,
                },
                velocity_north_mps: 66.0,
                velocity_east_mps: 28.0,
                velocity_down_mps: 3.8,
                true_airspeed_mps: 72.0,
                controls: Controls::default(),
                on_ground: false,
            }
        })
        .collect();
    let at = runway().point_on_approach(-1_000.0, -300.0);
    let mut recording = simulator
        .begin_block(BlockOfTicks {
            first_tick: 0,
            states: &states,
            frame_rate,
            view: 0,
            camera: CameraPose {
                pose: Pose {
                    latitude_deg: at.latitude_deg,
                    longitude_deg: at.longitude_deg,
                    altitude_msl_m: 16.0,
                    heading_true_deg: 203.02,
                    pitch_deg: 2.0,
                    roll_deg: 0.0,
                },
                hfov_deg: 14.0,
            },
            size_px: SIZE_PX,
        })
        .unwrap();
    let mut pictures = Vec::new();
    while let Some(frame) = recording.next_picture().await.unwrap() {
        pictures.push(frame.rgb.to_vec());
    }
    let report = recording.report();
    println!("{report:?}");
    (pictures, report.repeated)
}
