//! The stand-in's window on a real X server, grabbed through FFmpeg's device as X-Plane's would be.
#![cfg(target_os = "linux")]

use std::sync::{Arc, Mutex};

use dataset::geometry::pose::{Controls, Pose};
use mock_xplane::server::{
    Engine, Instants, OtherAircraft, SceneRenderer, SceneSetting, ServerOptions,
};
use mock_xplane::window::{DisplayWindow, WindowError, X11Window};
use testkit::changi_02l;
use testkit_simulator::client::{self, level};
use testkit_simulator::{Xvfb, quiet, serving_with};
use xplane_bridge::link::SimulatorWindow;
use xplane_bridge::pixels::check_pattern::draw;
use xplane_bridge::pixels::{
    Confirmed, FfmpegScreen, Lag, PatternDisplay, PixelChoice, PixelKind, Rectangle, RgbPicture,
    Screen, ScreenSource,
};
use xplane_bridge::{BridgeError, CONNECT_TIMEOUT, CaptureRequest, Deliver, Simulator};

const SIZE: (u32, u32) = (160, 96);

/// An image in which every pixel differs from its neighbours and from the same pixel of the previous image.
fn picture(number: u32) -> RgbPicture {
    let (width_px, height_px) = SIZE;
    let mut picture = RgbPicture::black(width_px, height_px);
    for (at, level) in picture.rgb.iter_mut().enumerate() {
        *level = (at as u32)
            .wrapping_mul(2_654_435_761)
            .wrapping_add(number * 977) as u8;
    }
    picture
}

fn place(window: &SimulatorWindow) -> Rectangle {
    Rectangle {
        x_px: window.x_px as u32,
        y_px: window.y_px as u32,
        width_px: SIZE.0,
        height_px: SIZE.1,
    }
}

/// The window, driven by the test alone.
struct StageDisplay(Arc<dyn DisplayWindow>);

impl PatternDisplay for StageDisplay {
    fn show(&mut self, code: Option<u32>) -> Confirmed<'_> {
        let (width_px, height_px) = SIZE;
        let shown = match code {
            Some(code) => draw(code, width_px, height_px),
            None => RgbPicture::black(width_px, height_px),
        };
        self.0.show(&shown).unwrap();
        Box::pin(std::future::ready(Ok(())))
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn every_picture_of_the_window_is_grabbed_to_the_last_bit_and_never_the_one_before() {
    let xvfb = Xvfb::start("320x240x24");
    let stage: Arc<dyn DisplayWindow> =
        Arc::new(X11Window::open(Some(xvfb.display()), SIZE).unwrap());
    let screen: Arc<dyn Screen> = Arc::new(FfmpegScreen::of_display(xvfb.display()));
    let display = &mut StageDisplay(stage.clone());
    let mut source = ScreenSource::set_up(&screen, SIZE, false, None, display)
        .await
        .unwrap();
    assert_eq!(source.window(), place(&stage.describe().unwrap()));
    assert_eq!(
        source.lag(),
        Lag::default(),
        "Xvfb shows what it has confirmed"
    );
    for number in 0..100 {
        let shown = picture(number);
        stage.show(&shown).unwrap();
        let grabbed = source.picture(Vec::new()).await.unwrap();
        assert!(grabbed == shown.rgb, "image {number} differs");
    }
    source.confirm(display).await.unwrap();
}

/// Draws the tick's number into every byte.
struct Counter;

impl Engine for Counter {
    fn prepare(&self, _: &SceneSetting<'_>) -> Box<dyn SceneRenderer> {
        Box::new(Counter)
    }
}

impl SceneRenderer for Counter {
    fn draw(&self, _: (&Pose, &Controls), _: &[OtherAircraft], instants: Instants, rgb: &mut [u8]) {
        rgb.fill(instants.lamps_s as u8);
    }
}

/// A window that shows each image only when the next one comes, although it reports that it shows it.
#[derive(Debug)]
struct Late {
    window: X11Window,
    waiting: Mutex<Option<RgbPicture>>,
}

impl DisplayWindow for Late {
    fn describe(&self) -> Result<SimulatorWindow, WindowError> {
        self.window.describe()
    }

    fn show(&self, picture: &RgbPicture) -> Result<(), WindowError> {
        let mut waiting = self.waiting.lock().unwrap();
        match waiting.replace(picture.clone()) {
            Some(before) => self.window.show(&before),
            None => Ok(()),
        }
    }
}

/// The stand-in on a stage, and its client.
async fn connected(stage: Option<Arc<dyn DisplayWindow>>) -> Simulator {
    let options = ServerOptions { stage, ..quiet() };
    // It ends with the test's runtime.
    let (addresses, _) = serving_with(options, Arc::new(Counter)).await;
    Simulator::connect(addresses.udp, CONNECT_TIMEOUT)
        .await
        .unwrap()
}

fn screen_of(display: &str) -> Arc<dyn Screen> {
    Arc::new(FfmpegScreen::of_display(display))
}

fn capture(tick: u32, deliver: Deliver) -> CaptureRequest {
    let pose = level(1.3, 103.95, 300.0, 23.0);
    CaptureRequest {
        time_ns: i64::from(tick) * 1_000_000_000,
        deliver,
        ..client::capture(tick, pose, (pose, 10.0), SIZE)
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn captures_of_the_screen_go_through_the_whole_link_and_are_proven_before_and_after() {
    let xvfb = Xvfb::start("320x240x24");
    let window = X11Window::open(Some(xvfb.display()), SIZE).unwrap();
    let mut simulator = connected(Some(Arc::new(window))).await;
    let choice = PixelChoice::Only(PixelKind::Screen);
    let screen = screen_of(xvfb.display());
    let kind = simulator.use_pixels(choice, SIZE, &screen).await.unwrap();
    assert_eq!(kind, PixelKind::Screen);
    assert_eq!(simulator.most_outstanding(), 1);
    simulator.freeze(&changi_02l()).await.unwrap();
    for tick in 1..20 {
        let asked = capture(tick, simulator.deliver());
        simulator.send_capture(&asked).await.unwrap();
        let frame = simulator.receive_frame().await.unwrap();
        assert_eq!(*frame.rgb, vec![tick as u8; asked.rgb_bytes()]);
        simulator.recycle(frame.rgb);
    }
    simulator.confirm_pixels().await.unwrap();
    simulator.release().await.unwrap();
}

/// Error that makes the screen unusable with this window.
async fn refusal(
    stage: Option<Arc<dyn DisplayWindow>>,
    display: &str,
    choice: PixelChoice,
) -> BridgeError {
    let mut simulator = connected(stage).await;
    let screen = screen_of(display);
    let used = simulator.use_pixels(choice, SIZE, &screen).await;
    used.unwrap_err()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_window_that_is_too_small_missing_or_elsewhere_is_refused_with_what_to_change() {
    let xvfb = Xvfb::start("320x240x24");
    let other = Xvfb::start("320x240x24");
    let screen = PixelChoice::Only(PixelKind::Screen);
    let small: Arc<dyn DisplayWindow> =
        Arc::new(X11Window::open(Some(xvfb.display()), (120, 80)).unwrap());

    let text = refusal(Some(small.clone()), xvfb.display(), screen)
        .await
        .to_string();
    for words in ["120x80", "160x96", "exactly this size"] {
        assert!(text.contains(words), "no {words:?} in {text}");
    }
    // The window is not on the grabbed display.
    let text = refusal(Some(small), other.display(), screen)
        .await
        .to_string();
    for words in [other.display(), "no check pattern", "120x80 at (0, 0)"] {
        assert!(text.contains(words), "no {words:?} in {text}");
    }
    let error = refusal(None, xvfb.display(), screen).await;
    let text = error.to_string();
    assert!(
        text.contains("--pixels screen") && text.contains("only link"),
        "{text}"
    );
    assert!(matches!(error, BridgeError::Pixels(error) if error.is_bad_input()));
}

#[test]
fn the_first_grab_shows_the_screen_as_it_is_now_and_not_as_it_was_when_it_was_opened() {
    let xvfb = Xvfb::start("320x240x24");
    let window = X11Window::open(Some(xvfb.display()), SIZE).unwrap();
    window.show(&picture(1)).unwrap();
    let mut grabs = screen_of(xvfb.display())
        .open(Some(place(&window.describe().unwrap())))
        .unwrap();
    window.show(&picture(2)).unwrap();
    let mut found = RgbPicture::default();
    grabs.grab(&mut found).unwrap();
    assert_eq!(found, picture(2));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_window_under_another_one_is_refused() {
    let xvfb = Xvfb::start("320x240x24");
    let below = X11Window::open(Some(xvfb.display()), SIZE).unwrap();
    let above = X11Window::open(Some(xvfb.display()), (100, 60)).unwrap();
    let screen = PixelChoice::Only(PixelKind::Screen);
    let text = refusal(Some(Arc::new(below)), xvfb.display(), screen)
        .await
        .to_string();
    assert!(text.contains("in front of all others"), "{text}");
    drop(above);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_simulator_that_draws_late_is_noticed_by_the_code_of_an_earlier_pattern() {
    let xvfb = Xvfb::start("320x240x24");
    let window = X11Window::open(Some(xvfb.display()), SIZE).unwrap();
    let late: Arc<dyn DisplayWindow> = Arc::new(Late {
        window,
        waiting: Mutex::default(),
    });
    let screen = PixelChoice::Only(PixelKind::Screen);
    // The first pattern is not there at all; the second client sees the first one's.
    let first = refusal(Some(late.clone()), xvfb.display(), screen).await;
    assert!(first.to_string().contains("no check pattern"), "{first}");
    late.show(&draw(0x0bad_cafe, SIZE.0, SIZE.1)).unwrap();
    let second = refusal(Some(late), xvfb.display(), screen)
        .await
        .to_string();
    assert!(
        second.contains("still shows 0badcafe") && second.contains("earlier ticks"),
        "{second}"
    );
}
