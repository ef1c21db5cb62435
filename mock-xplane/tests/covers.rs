//! Covers over the hosted plugin's window: found at the registration, and named.
#![cfg(target_os = "linux")]

use std::sync::Arc;
use std::time::Duration;

use mock_xplane::quirks::{Quirk, Quirks};
use mock_xplane::server::{LinkServer, PluginOptions, ServerOptions, WindowCovers, WindowForm};
use mock_xplane::window::{CoverWindow, DisplayWindow, X11Window};
use testkit_simulator::{Xvfb, plugin, quiet, serving};
use xplane_bridge::datarefs::Generation;
use xplane_bridge::pixels::{FfmpegScreen, PixelChoice, PixelError, Rectangle, Screen};
use xplane_bridge::{BridgeError, Simulator};

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
        let xvfb = Xvfb::start("500x340x24");
        let window = X11Window::open(Some(xvfb.display()), SIZE_PX).unwrap();
        let options: PluginOptions = plugin::options(SIZE_PX);
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
