//! The source `screen`: the simulator's window, grabbed from the screen, with the proof that each image is the requested frame.
//!
//! Registration: the simulator shows a check pattern with our code; the whole screen is grabbed until that code is read, which
//! gives the window's rectangle, and so its size. Afterwards only this rectangle is grabbed. More codes measure the lag: how many
//! grabs and how long it takes from "it is drawn" until it is visible. While recording, every grab waits twice the longest lag and
//! skips as many grabs; the frame stays on the screen until the next request, so waiting is always safe. After the recording
//! [`ScreenSource::confirm`] measures again: a window that moved, or a screen that has become slower than the waiting time, ends
//! the attempt.
//!
//! The pattern is drawn under the windows of the user interface as well as over them, so that a window over the scene is found and named.

mod coded_grabs;
mod covered;
mod device;
mod ffmpeg_screen;
mod frame_code;
mod grabber;
mod pixel_form;
mod remote_screen;
#[cfg(test)]
mod tests;

use std::fmt;
use std::sync::Arc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use tokio::time::{Instant, sleep};

use super::check_pattern::{Sighting, Unreadable, both_colours, covers, draw};
use super::{Confirmed, PatternDisplay, PixelError, Rectangle, RgbPicture};
use crate::error::BridgeError;
use crate::link::{PictureSize, SimulatorWindow};
pub(crate) use coded_grabs::{CodedGrabs, CodedPicture};
use covered::{Hidden, cover_on_screen, share_of};
pub use ffmpeg_screen::FfmpegScreen;
use grabber::Grabber;
pub use remote_screen::RemoteScreen;

/// Timeout for a pattern to become visible.
const PATIENCE: Duration = if cfg!(test) {
    Duration::from_millis(200)
} else {
    Duration::from_secs(2)
};
/// A pattern with a larger hidden share may be an earlier one: two patterns differ in half their cells.
const LATE_SHARE: f64 = 0.25;
/// Number of codes for measuring the lag.
const TRIALS: u32 = 8;
/// While recording, this multiple of the longest lag is waited for.
const LAG_MARGIN: u32 = 2;
/// For a screen with any lag, wait at least one refresh at 60 Hz: below that, the machine's other work decides.
const REFRESH: Duration = Duration::from_micros(16_667);

/// A screen that can be grabbed: this machine's, or a fake one in tests.
pub trait Screen: fmt::Debug + Send + Sync {
    /// Name for messages.
    fn name(&self) -> String;

    /// Starts grabbing a region, or the whole screen.
    ///
    /// # Errors
    /// It cannot be grabbed.
    fn open(&self, part: Option<Rectangle>) -> Result<Box<dyn Grab>, PixelError>;
}

/// Takes images from a screen region.
pub trait Grab: Send {
    /// Takes the next image. It may be older than this call: its age is measured, never assumed.
    ///
    /// # Errors
    /// If there is none.
    fn grab(&mut self, picture: &mut RgbPicture) -> Result<(), PixelError>;

    /// [`Grab::grab`] that separates the bytes inside a margin, rows without gaps. The inside of `margins` is undefined then.
    ///
    /// # Errors
    /// If there is none.
    fn grab_inside(
        &mut self,
        margin_px: u32,
        margins: &mut RgbPicture,
        inside: &mut Vec<u8>,
    ) -> Result<(), PixelError> {
        self.grab(margins)?;
        let (right, bottom) = (margins.width_px - margin_px, margins.height_px - margin_px);
        inside.clear();
        for y in margin_px..bottom {
            inside.extend_from_slice(margins.pixels(margin_px, right, y).as_flattened());
        }
        Ok(())
    }
}

/// Delay from the simulator's report that a frame is drawn until the frame is visible.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Lag {
    /// Grabs that still showed something older.
    pub grabs: u32,
    /// Time until the start of the first grab that showed it; zero if it was the first.
    pub time: Duration,
}

impl fmt::Display for Lag {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} grabs, {:.1?}", self.grabs, self.time)
    }
}

impl Lag {
    fn or_longer(self, other: Self) -> Self {
        Self {
            grabs: self.grabs.max(other.grabs),
            time: self.time.max(other.time),
        }
    }
}

/// Highest level of a black screen: codecs and screens round.
const BLACK_LEVEL: u8 = 1;
/// An image that still equals the previous one after this many more grabs shows no change; before that, it may be late.
const STALE_GRABS: u32 = 10;

/// Window for grabbing numbered frames: the image and the code around it.
#[derive(Debug, Clone)]
pub(crate) struct CodedWindow {
    pub(crate) screen: Arc<dyn Screen>,
    /// The image and its code on the screen.
    pub(crate) region: Rectangle,
    /// The window's margins around the image, left and right, above and below, pixels.
    pub(crate) margins_px: [u32; 2],
}

/// A window that is grabbed, and its measurements.
pub struct ScreenSource {
    /// Grabs the whole window.
    grabber: Grabber,
    on: Arc<dyn Screen>,
    margins_px: Option<[u32; 2]>,
    screen: String,
    window: Rectangle,
    lag: Lag,
    codes: Codes,
    /// The last image.
    last: Vec<u8>,
}

impl ScreenSource {
    /// Finds the simulator's window on `screen`, proves that it is visible, complete, unscaled and in the size of the images, or with
    /// margins for frame codes around them if it `may_have_margins`, and measures the lag. `reported`: the window as the simulator
    /// reports it, for messages.
    ///
    /// # Errors A step fails; the message says what to change. The pattern is removed in any case.
    pub async fn set_up(
        screen: &Arc<dyn Screen>,
        (width_px, height_px): (u32, u32),
        may_have_margins: bool,
        reported: Option<&SimulatorWindow>,
        display: &mut dyn PatternDisplay,
    ) -> Result<Self, BridgeError> {
        let result = async {
            let mut codes = Codes::fresh();
            let picture = PictureSize {
                width_px,
                height_px,
            };
            check_room(screen, picture).await?;
            let window = find(screen, &mut codes, reported, display).await?;
            let found = window.size();
            let margins_px = picture.margins_in(found).filter(|_| may_have_margins);
            if found != picture && margins_px.is_none() {
                return Err(wrong_size(picture, found, reported).into());
            }
            let grabber = Grabber::open(screen, Some(window)).await?;
            let mut source = Self {
                grabber,
                on: screen.clone(),
                margins_px,
                screen: screen.name(),
                window,
                lag: Lag::default(),
                codes,
                last: Vec::new(),
            };
            source.lag = source.measure(display).await?;
            source.check_covers(display).await?;
            Ok(source)
        };
        let source = clearing(result.await, display).await?;
        source.wait_until_gone().await?;
        tracing::info!(screen = source.screen, window = %source.window, lag = ?source.lag, "the simulator's window is grabbed");
        Ok(source)
    }

    /// Position of the window on the screen.
    pub fn window(&self) -> Rectangle {
        self.window
    }

    /// The longest lag of the registration.
    pub fn lag(&self) -> Lag {
        self.lag
    }

    /// The waiting time, and the number of skipped grabs, before each image.
    fn allowed(&self) -> Lag {
        Lag {
            grabs: self.lag.grabs,
            time: match self.lag.time {
                Duration::ZERO => Duration::ZERO,
                late => (late * LAG_MARGIN).max(REFRESH),
            },
        }
    }

    /// Measures the longest lag over some codes, each of which must fill the window.
    async fn measure(&mut self, display: &mut dyn PatternDisplay) -> Result<Lag, BridgeError> {
        let mut longest = Lag::default();
        for trial in 0..=TRIALS {
            let code = self.codes.next();
            display.show(Some(code)).await?;
            let size_px = (self.window.width_px, self.window.height_px);
            let expected = Rectangle::between(0, 0, size_px.0, size_px.1);
            let (seen, lag) = wait_for(&self.grabber, &self.screen, Some(size_px), code).await?;
            if seen.rectangle != expected {
                return Err(PixelError::Unusable(format!(
                    "the simulator's window has moved or changed: the check pattern fills {} of what is grabbed, expected {expected}. Leave it \
                     alone while recording",
                    seen.rectangle
                ))
                .into());
            }
            // The first one empties a queue that the device may have filled before anything was grabbed.
            if trial > 0 {
                longest = longest.or_longer(lag);
            }
        }
        Ok(longest)
    }

    /// Looks for what covers the scene: the pattern is drawn under the windows of the simulator, and over them.
    async fn check_covers(&mut self, display: &mut dyn PatternDisplay) -> Result<(), BridgeError> {
        let under = self.hidden_under_windows(display).await?;
        Ok(self.hidden(display).await?.verdict(under)?)
    }

    /// The largest part of the window that hides the lowest pattern that can be shown.
    async fn look_for_cover(
        &mut self,
        display: &mut dyn PatternDisplay,
    ) -> Result<Option<Rectangle>, BridgeError> {
        let hidden = match self.hidden_under_windows(display).await? {
            Some(hidden) => hidden,
            None => self.hidden(display).await?,
        };
        Ok(hidden.largest())
    }

    /// What hides a pattern that is drawn over everything, in any colour.
    async fn hidden(&mut self, display: &mut dyn PatternDisplay) -> Result<Hidden, BridgeError> {
        let (mut hidden, mut memory) = (Hidden::new(self.window), RgbPicture::default());
        for code in both_colours(self.codes.next()) {
            let shown = display.show(Some(code));
            memory = self.compare(code, shown, &mut hidden, memory).await?;
        }
        Ok(hidden)
    }

    /// The same for a pattern under the windows of the simulator; `None` if it cannot draw one there.
    async fn hidden_under_windows(
        &mut self,
        display: &mut dyn PatternDisplay,
    ) -> Result<Option<Hidden>, BridgeError> {
        let (mut hidden, mut memory) = (Hidden::new(self.window), RgbPicture::default());
        for code in both_colours(self.codes.next()) {
            let Some(shown) = display.show_under_windows(code) else {
                return Ok(None);
            };
            memory = self.compare(code, shown, &mut hidden, memory).await?;
        }
        Ok(Some(hidden))
    }

    /// Adds the hidden cells of a pattern that is being shown. Returns the memory of the last grab.
    async fn compare(
        &self,
        code: u32,
        shown: Confirmed<'_>,
        hidden: &mut Hidden,
        memory: RgbPicture,
    ) -> Result<RgbPicture, BridgeError> {
        let PictureSize {
            width_px,
            height_px,
        } = self.window.size();
        // It is computed while the simulator draws it.
        let (shown, pattern) = tokio::join!(shown, async { draw(code, width_px, height_px) });
        shown?;
        let (began, wait) = (Instant::now(), self.allowed());
        // A complete pattern needs no waiting: no other one looks like it.
        let mut picture = self.grabber.grab(memory, 0).await?;
        let mut found = hidden.in_grab(&picture, &pattern);
        if found.contains(&true) {
            if !wait.time.is_zero() {
                sleep(wait.time).await;
            }
            picture = self.grabber.grab(picture, wait.grabs).await?;
            found = hidden.in_grab(&picture, &pattern);
        }
        // A busy machine may show the pattern later than it did when the lag was measured, and in parts. A cover is in two grabs in a row.
        while found.contains(&true) {
            picture = self.grabber.grab(picture, 0).await?;
            let again = hidden.in_grab(&picture, &pattern);
            let is_late = share_of(&again) > LATE_SHARE && began.elapsed() < PATIENCE;
            if is_late {
                found = again;
                continue;
            }
            for (found, again) in found.iter_mut().zip(again) {
                *found &= again;
            }
            break;
        }
        hidden.add(&found);
        Ok(picture)
    }

    /// Waits until no pattern is visible any more.
    async fn wait_until_gone(&self) -> Result<(), PixelError> {
        let began = Instant::now();
        while !matches!(
            self.grabber.look().await?,
            Err(Unreadable::Absent | Unreadable::Covered(_))
        ) {
            if began.elapsed() > PATIENCE {
                return Err(PixelError::PatternStays);
            }
        }
        Ok(())
    }

    /// Proves after the last image that the initial proof still holds.
    ///
    /// # Errors It does not: the images in between may be wrong. The pattern is removed in any case.
    pub async fn confirm(&mut self, display: &mut dyn PatternDisplay) -> Result<(), BridgeError> {
        let measured = async {
            let (lag, allowed) = (self.measure(display).await?, self.allowed());
            if lag.grabs > allowed.grabs || lag.time > allowed.time {
                return Err(PixelError::Unusable(format!(
                    "frames took {lag} to appear on the screen after the recording, more than the {allowed} waited for during it: its \
                     images may show earlier ticks. Close what else draws on this machine"
                ))
                .into());
            }
            self.check_covers(display).await
        };
        clearing(measured.await, display).await?;
        self.wait_until_gone().await.map_err(BridgeError::from)
    }

    pub(super) fn coded_window(&self) -> Option<CodedWindow> {
        let margins_px = self.margins_px?;
        Some(CodedWindow {
            screen: self.on.clone(),
            region: frame_code::coded_region(self.window, margins_px),
            margins_px,
        })
    }

    /// The image of the frame just drawn, in `memory`.
    ///
    /// # Errors
    /// The screen cannot be grabbed any more, or shows a pattern.
    pub async fn picture(&mut self, memory: Vec<u8>) -> Result<Vec<u8>, PixelError> {
        let wait = self.allowed();
        if !wait.time.is_zero() {
            sleep(wait.time).await;
        }
        let memory = RgbPicture {
            rgb: memory,
            ..RgbPicture::default()
        };
        let mut picture = self.grabber.grab(memory, wait.grabs).await?;
        for _ in 0..STALE_GRABS {
            if picture.rgb != self.last {
                break;
            }
            picture = self.grabber.grab(picture, 0).await?;
        }
        self.last.clone_from(&picture.rgb);
        if covers(&picture) {
            Err(PixelError::PatternStays)
        } else {
            if let Some(margins_px) = self.margins_px {
                cut_margins(&mut picture, margins_px);
            }
            Ok(picture.rgb)
        }
    }

    /// The part of the images that something covers now.
    pub(crate) async fn covered_part(
        &mut self,
        display: &mut dyn PatternDisplay,
    ) -> Result<Option<Rectangle>, BridgeError> {
        let found = self.look_for_cover(display).await;
        let found = clearing(found, display).await?;
        self.wait_until_gone().await?;
        let margins_px = self.margins_px.unwrap_or_default();
        let window_px = [self.window.width_px, self.window.height_px];
        Ok(found.and_then(|cover| in_picture(cover, window_px, margins_px)))
    }
}

impl fmt::Debug for ScreenSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ScreenSource")
            .field("screen", &self.screen)
            .field("window", &self.window)
            .field("lag", &self.lag)
            .finish_non_exhaustive()
    }
}

/// The part of a window rectangle that is in the image between the margins.
fn in_picture(
    cover: Rectangle,
    [width_px, height_px]: [u32; 2],
    [x_px, y_px]: [u32; 2],
) -> Option<Rectangle> {
    let part = Rectangle::between(
        cover.x_px.max(x_px) - x_px,
        cover.y_px.max(y_px) - y_px,
        cover.right_px().min(width_px - x_px).saturating_sub(x_px),
        cover.bottom_px().min(height_px - y_px).saturating_sub(y_px),
    );
    (part.width_px > 0 && part.height_px > 0).then_some(part)
}

/// Cuts margins off, left and right, above and below, without other memory.
fn cut_margins(picture: &mut RgbPicture, [x_px, y_px]: [u32; 2]) {
    let (width_px, height_px) = (picture.width_px - 2 * x_px, picture.height_px - 2 * y_px);
    let row_bytes = width_px as usize * 3;
    for row in 0..height_px as usize {
        let from = ((y_px as usize + row) * picture.width_px as usize + x_px as usize) * 3;
        picture
            .rgb
            .copy_within(from..from + row_bytes, row * row_bytes);
    }
    picture.resize(width_px, height_px);
}

/// Rejects images that are larger than the screen, where no window could show them.
async fn check_room(screen: &Arc<dyn Screen>, wanted: PictureSize) -> Result<(), PixelError> {
    let whole = Grabber::open(screen, None).await?;
    let picture = whole.grab(RgbPicture::default(), 0).await?;
    let found = picture.size();
    if wanted.width_px <= found.width_px && wanted.height_px <= found.height_px {
        return Ok(());
    }
    Err(PixelError::BadInput(format!(
        "images of {wanted} pixels do not fit this screen, which has {found}, and the window's frame and the desktop's bars need room besides: \
         choose smaller ones in [picture] of the sweep, or let X-Plane run on a larger screen"
    )))
}

/// The window is not as large as the images.
fn wrong_size(
    wanted: PictureSize,
    window: PictureSize,
    reported: Option<&SimulatorWindow>,
) -> PixelError {
    let advice = match reported.map(SimulatorWindow::size) {
        Some(reported) if reported != window => {
            let percent = 100.0 * f64::from(window.width_px) / f64::from(reported.width_px.max(1));
            format!(
                "the simulator draws {reported}, and the desktop scales it to {percent:.0} %. Set the display's scaling to 100 %"
            )
        }
        _ => "give the window exactly this size (X-Plane: Settings > Graphics, or --window=WIDTHxHEIGHT on its command line), or change \
              [picture] in the sweep"
            .into(),
    };
    PixelError::Setup(format!(
        "the simulator's window is {window} on the screen, the images must be {wanted}: {advice}"
    ))
}

/// The rectangle of the simulator's window on the whole screen.
async fn find(
    screen: &Arc<dyn Screen>,
    codes: &mut Codes,
    reported: Option<&SimulatorWindow>,
    display: &mut dyn PatternDisplay,
) -> Result<Rectangle, BridgeError> {
    let whole = Grabber::open(screen, None).await?;
    let code = codes.next();
    display.show(Some(code)).await?;
    let place = match reported {
        Some(window) => format!("{} (the simulator's window is {window})", screen.name()),
        None => screen.name(),
    };
    let size_px = reported.map(|window| (window.width_px, window.height_px));
    let (seen, _) = wait_for(&whole, &place, size_px, code).await?;
    Ok(seen.rectangle)
}

/// Grabs until a code is visible. With the window's size, a cover over a pattern of that size is named.
async fn wait_for(
    grabber: &Grabber,
    screen: &str,
    size_px: Option<(u32, u32)>,
    code: u32,
) -> Result<(Sighting, Lag), PixelError> {
    let shown = Instant::now();
    let mut lag = Lag::default();
    loop {
        let found = grabber.look().await?;
        if let Ok(seen) = found
            && seen.code == code
        {
            return Ok((seen, lag));
        }
        let waited = shown.elapsed();
        if waited > PATIENCE {
            let says =
                format!("the simulator says that it shows the check pattern {code:08x}, but");
            return Err(match found {
                Ok(seen) => PixelError::Unusable(format!(
                    "{says} after {waited:.1?} the screen still shows {:08x}: it is drawn late or not at all, and images would show earlier \
                     ticks. Is the simulator paused or its window frozen?",
                    seen.code
                )),
                Err(found) => match cover_over_pattern(grabber, size_px, code, found).await? {
                    Some(cover) => cover,
                    None => {
                        let why = why_absent(grabber).await?;
                        PixelError::Unusable(format!(
                            "{says} after {waited:.1?} the screen {screen} shows {found}. {why}"
                        ))
                    }
                },
            });
        }
        lag = Lag {
            grabs: lag.grabs + 1,
            time: waited,
        };
    }
}

/// Likely cause of a pattern that is nowhere.
async fn why_absent(grabber: &Grabber) -> Result<&'static str, PixelError> {
    let picture = grabber.grab(RgbPicture::default(), 0).await?;
    Ok(if picture.rgb.iter().all(|level| *level <= BLACK_LEVEL) {
        "All of it is black: the session is locked, the screen is off, or it is a Wayland session, whose desktop programs cannot grab \
         (\"Desktop session type\" in X-Plane's Log.txt): log in to an X11 session"
    } else {
        "Is its window open on this screen, in front of all others, not minimised and not reaching over the edge? If so, the drawing of \
         plugins is missing: switch on Settings > Graphics > \"Use Zink\" in X-Plane 12"
    })
}

/// Names the cover over an unreadable pattern.
async fn cover_over_pattern(
    grabber: &Grabber,
    size_px: Option<(u32, u32)>,
    code: u32,
    found: Unreadable,
) -> Result<Option<PixelError>, PixelError> {
    let (Unreadable::Covered(window) | Unreadable::Damaged(window)) = found else {
        return Ok(None);
    };
    if size_px != Some((window.width_px, window.height_px)) {
        return Ok(None);
    }
    let picture = grabber.grab(RgbPicture::default(), 0).await?;
    Ok(cover_on_screen(&picture, window, code))
}

/// Removes the pattern, also after a failure, which is then reported.
async fn clearing<T>(
    result: Result<T, BridgeError>,
    display: &mut dyn PatternDisplay,
) -> Result<T, BridgeError> {
    let cleared = display.show(None).await;
    let done = result?;
    cleared.map(|()| done)
}

/// Codes that differ from each other, and from the codes of any earlier client.
#[derive(Debug, Clone, Copy)]
struct Codes(u32);

impl Codes {
    fn fresh() -> Self {
        let now = SystemTime::now().duration_since(UNIX_EPOCH);
        Self(now.map_or(1, |since| since.as_nanos() as u32))
    }

    fn next(&mut self) -> u32 {
        // An odd step passes through all 2^32 codes; this one changes about half of the cells each time.
        self.0 = self.0.wrapping_add(0x9e37_79b9);
        self.0
    }
}
