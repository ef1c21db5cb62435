//! Fake screens: on time, late, covered, moved, scaled, never drawn on.

use std::sync::{Mutex, MutexGuard};

use super::*;
use crate::pixels::check_pattern::draw;

const WINDOW: Rectangle = Rectangle {
    x_px: 30,
    y_px: 20,
    width_px: 96,
    height_px: 64,
};

/// The content of the fake screen, and its faults.
#[derive(Debug, Clone)]
struct FakeDesktop {
    window: Rectangle,
    /// Codes shown, `None` for the simulator's image.
    shown: Vec<Option<u32>>,
    /// Grabs that still show the old content after each change.
    late_grabs: u32,
    /// Number of late changes left.
    late_left: u32,
    /// First change that the screen no longer shows.
    dead_from: Option<usize>,
    /// First change with the window elsewhere.
    moved_from: Option<usize>,
}

#[derive(Debug, Clone)]
struct MadeUp(Arc<Mutex<FakeDesktop>>);

impl MadeUp {
    fn new(change: impl FnOnce(&mut FakeDesktop)) -> Self {
        let mut desktop = FakeDesktop {
            window: WINDOW,
            shown: vec![None],
            late_grabs: 0,
            late_left: 0,
            dead_from: None,
            moved_from: None,
        };
        change(&mut desktop);
        Self(Arc::new(Mutex::new(desktop)))
    }

    fn desktop(&self) -> MutexGuard<'_, FakeDesktop> {
        self.0.lock().unwrap()
    }

    async fn set_up(&self) -> Result<ScreenSource, BridgeError> {
        let screen: Arc<dyn Screen> = Arc::new(self.clone());
        let reported = SimulatorWindow {
            title: "X-System".into(),
            x_px: 30,
            y_px: 20,
            width_px: 96,
            height_px: 64,
            scale: 1.0,
        };
        ScreenSource::set_up(&screen, (96, 64), false, Some(&reported), &mut self.clone()).await
    }
}

#[tokio::test]
async fn pictures_larger_than_the_screen_are_refused_with_its_size() {
    let screen: Arc<dyn Screen> = Arc::new(MadeUp::new(|_| {}));
    let mut display = MadeUp::new(|_| {});
    let set_up = ScreenSource::set_up(&screen, (1_920, 1_280), false, None, &mut display).await;
    let said = set_up.unwrap_err().to_string();
    assert!(
        said.contains("images of 1920x1280 pixels do not fit this screen")
            && said.contains("which has 200x150, and")
            && said.contains("[picture] of the sweep"),
        "{said}"
    );
}

impl PatternDisplay for MadeUp {
    fn show(&mut self, code: Option<u32>) -> Confirmed<'_> {
        let mut desktop = self.desktop();
        desktop.shown.push(code);
        desktop.late_left = desktop.late_grabs;
        Box::pin(std::future::ready(Ok(())))
    }
}

impl Screen for MadeUp {
    fn name(&self) -> String {
        "made up".into()
    }

    fn open(&self, part: Option<Rectangle>) -> Result<Box<dyn Grab>, PixelError> {
        let part = part.unwrap_or(Rectangle::between(0, 0, 200, 150));
        Ok(Box::new(MadeUpGrab(self.clone(), part)))
    }
}

struct MadeUpGrab(MadeUp, Rectangle);

impl Grab for MadeUpGrab {
    fn grab(&mut self, picture: &mut RgbPicture) -> Result<(), PixelError> {
        let mut desktop = self.0.desktop();
        let newest = desktop.shown.len() - 1;
        let mut seen = newest;
        if desktop.late_left > 0 {
            desktop.late_left -= 1;
            seen = newest.saturating_sub(1);
        }
        seen = seen.min(desktop.dead_from.unwrap_or(usize::MAX));
        let mut window = desktop.window;
        if desktop.moved_from.is_some_and(|from| newest >= from) {
            window.x_px += 5;
        }
        let content = match desktop.shown[seen] {
            Some(code) => draw(code, window.width_px, window.height_px),
            None => {
                let mut picture = RgbPicture::black(window.width_px, window.height_px);
                picture.rgb.fill(desktop.shown.len() as u8);
                picture
            }
        };
        let mut screen = RgbPicture::black(200, 150);
        for y in 0..window.height_px {
            screen
                .pixels_mut(window.x_px, window.right_px(), window.y_px + y)
                .copy_from_slice(content.pixels(0, window.width_px, y));
        }
        let part = self.1;
        picture.resize(part.width_px, part.height_px);
        for y in 0..part.height_px {
            let row = screen.pixels(part.x_px, part.right_px(), part.y_px + y);
            picture.pixels_mut(0, part.width_px, y).copy_from_slice(row);
        }
        Ok(())
    }
}

fn message<T>(result: Result<T, BridgeError>) -> String {
    result.err().expect("an error").to_string()
}

#[tokio::test]
async fn a_window_is_found_and_its_pictures_are_those_shown() {
    let screen = MadeUp::new(|_| ());
    let mut source = screen.set_up().await.unwrap();
    assert_eq!(source.window(), WINDOW);
    assert_eq!(source.lag(), Lag::default());
    assert_eq!(screen.desktop().shown.last(), Some(&None), "pattern left");
    let shown = screen.desktop().shown.len() as u8;
    let rgb = source.picture(Vec::new()).await.unwrap();
    assert_eq!(rgb, vec![shown; 96 * 64 * 3]);
    source.confirm(&mut screen.clone()).await.unwrap();
}

#[tokio::test]
async fn a_screen_that_is_late_is_waited_for() {
    let screen = MadeUp::new(|desktop| desktop.late_grabs = 3);
    let mut source = screen.set_up().await.unwrap();
    assert_eq!(source.lag().grabs, 3);
    // The next frame is drawn; the first three grabs still show the previous one.
    screen.clone().show(None).await.unwrap();
    let newest = screen.desktop().shown.len() as u8;
    let rgb = source.picture(Vec::new()).await.unwrap();
    assert_eq!(screen.desktop().late_left, 0);
    assert_eq!(rgb[0], newest);
    source.confirm(&mut screen.clone()).await.unwrap();
}

#[tokio::test]
async fn a_picture_that_is_still_the_one_before_is_grabbed_again_and_one_that_stays_is_believed() {
    let screen = MadeUp::new(|_| ());
    let mut source = screen.set_up().await.unwrap();
    let first = source.picture(Vec::new()).await.unwrap();
    screen.desktop().late_grabs = 4;
    screen.clone().show(None).await.unwrap();
    let newest = screen.desktop().shown.len() as u8;
    let second = source.picture(Vec::new()).await.unwrap();
    assert_eq!((second[0], second == first), (newest, false));
    assert_eq!(source.picture(Vec::new()).await.unwrap(), second);
}

#[tokio::test]
async fn a_screen_that_becomes_later_than_measured_ends_the_attempt() {
    let screen = MadeUp::new(|desktop| desktop.late_grabs = 1);
    let mut source = screen.set_up().await.unwrap();
    screen.desktop().late_grabs = 4;
    let text = message(source.confirm(&mut screen.clone()).await);
    assert!(text.contains("may show earlier ticks"), "{text}");
    assert_eq!(screen.desktop().shown.last(), Some(&None), "pattern left");
}

#[tokio::test]
async fn a_simulator_that_stops_drawing_is_noticed_by_its_stale_code() {
    let screen = MadeUp::new(|desktop| desktop.dead_from = Some(4));
    let text = message(screen.set_up().await);
    let stale = screen.desktop().shown[4].unwrap();
    assert!(
        text.contains("still shows") && text.contains(&format!("{stale:08x}")),
        "{text}"
    );
    assert_eq!(screen.desktop().shown.last(), Some(&None), "pattern left");
}

#[tokio::test]
async fn a_window_that_is_not_there_is_said_to_be_missing() {
    let screen = MadeUp::new(|desktop| desktop.dead_from = Some(0));
    let text = message(screen.set_up().await);
    assert!(
        text.contains("no check pattern") && text.contains("in front of all others"),
        "{text}"
    );
    assert!(text.contains("\"X-System\", 96x64 at (30, 20)"), "{text}");
}

#[tokio::test]
async fn a_window_of_another_size_is_refused_with_both_sizes() {
    let screen = MadeUp::new(|desktop| desktop.window.width_px = 80);
    let text = message(screen.set_up().await);
    for words in ["80x64", "96x64", "scales it to 83 %"] {
        assert!(text.contains(words), "no {words:?} in {text}");
    }
    // Without a report of the simulator, scaling cannot be distinguished from a small window.
    let desktop = MadeUp::new(|desktop| desktop.window.width_px = 80);
    let screen: Arc<dyn Screen> = Arc::new(desktop.clone());
    let found = ScreenSource::set_up(&screen, (96, 64), false, None, &mut desktop.clone()).await;
    let text = message(found);
    assert!(text.contains("exactly this size"), "{text}");
}

#[tokio::test]
async fn a_window_that_moves_while_recording_ends_the_attempt() {
    let screen = MadeUp::new(|_| ());
    let mut source = screen.set_up().await.unwrap();
    let now = screen.desktop().shown.len();
    screen.desktop().moved_from = Some(now);
    let text = message(source.confirm(&mut screen.clone()).await);
    assert!(
        text.contains("moved") || text.contains("not whole"),
        "{text}"
    );
}

#[tokio::test]
async fn a_pattern_in_a_picture_of_the_recording_is_refused() {
    let screen = MadeUp::new(|_| ());
    let mut source = screen.set_up().await.unwrap();
    screen.clone().show(Some(7)).await.unwrap();
    let error = source.picture(Vec::new()).await.unwrap_err();
    assert!(matches!(error, PixelError::PatternStays), "{error}");
}
