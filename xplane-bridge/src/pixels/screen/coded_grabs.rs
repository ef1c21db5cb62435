//! A thread that grabs each numbered frame once, while the caller waits for other things.
//!
//! It looks at a strip of the code many times per second, which is cheap, and grabs the whole image when the number has changed. Of images
//! that are torn or carry only half a code it reports the number. A number that stays longer than usual is grabbed once more: a different
//! image under it belongs to a later frame. Memory is bounded by the number of images that exist at a time. Thread and memory
//! stay from block to block, since opening the screen and getting the memory takes as long as several frames.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;
use std::time::{Duration, Instant};

use tokio::sync::mpsc;
use tokio::task::spawn_blocking;

use super::Screen;
use super::frame_code::{FrameCode, read, read_strip};
use crate::link::{MARGIN_PX, PooledPicture};
use crate::pixels::{PixelError, Rectangle, RgbPicture};

/// Time between two looks at the strip, which cost two context switches each. A frame lasts 16 ms at 60 frames per second.
const LOOK_EVERY: Duration = Duration::from_micros(1_500);
/// A number that stays this many times as long as usual may be shown again by a later frame.
const OVERDUE: f64 = 1.5;
/// Weight of the last frame in the usual time of a number.
const NEWEST_WEIGHT: f64 = 0.2;
/// Rows of the strip that are looked at, in the middle of the code.
const STRIP_PX: u32 = 2;

/// A code that was seen.
#[derive(Debug)]
pub(crate) struct CodedPicture {
    pub(crate) code: FrameCode,
    /// The image, without the margins; none if no grab caught all of it.
    pub(crate) rgb: Option<PooledPicture>,
}

/// Window grabs, block after block. The thread ends when this is dropped.
#[derive(Debug, Default)]
pub(crate) struct CodedGrabs {
    thread: Option<GrabThread>,
}

#[derive(Debug)]
struct GrabThread {
    region: Rectangle,
    most_pictures: usize,
    pictures: mpsc::UnboundedReceiver<Result<CodedPicture, PixelError>>,
    rests: Arc<AtomicBool>,
}

impl CodedGrabs {
    /// Begins to grab a screen region: the image and [`MARGIN_PX`] around it. At most `most_pictures` images exist at a time. Images of an
    /// earlier block are forgotten.
    pub(crate) fn begin(
        &mut self,
        screen: &Arc<dyn Screen>,
        region: Rectangle,
        most_pictures: usize,
    ) {
        let is_same = self.thread.as_mut().is_some_and(|thread| {
            let same = (thread.region, thread.most_pictures) == (region, most_pictures);
            same && thread.forget_pictures()
        });
        if !is_same {
            self.thread = Some(GrabThread::start(screen, region, most_pictures));
        }
        self.rest(false);
    }

    /// The next image. Cancel safe.
    pub(crate) async fn next(&mut self) -> Result<CodedPicture, PixelError> {
        let ended = || PixelError::grab("the thread that grabs has ended");
        let thread = self.thread.as_mut().ok_or_else(ended)?;
        thread.pictures.recv().await.unwrap_or_else(|| Err(ended()))
    }

    /// The next image, if there is one already.
    pub(crate) fn next_now(&mut self) -> Option<Result<CodedPicture, PixelError>> {
        self.thread.as_mut()?.pictures.try_recv().ok()
    }

    /// Pauses grabbing if `rests`: no image is expected then.
    pub(crate) fn rest(&self, rests: bool) {
        if let Some(thread) = &self.thread {
            thread.rests.store(rests, Ordering::Relaxed);
        }
    }
}

impl GrabThread {
    fn start(screen: &Arc<dyn Screen>, region: Rectangle, most_pictures: usize) -> Self {
        let (tell, pictures) = mpsc::unbounded_channel();
        let (pool, free) = channel();
        for _ in 0..most_pictures {
            // The receiver is ours still.
            let _ = pool.send(Vec::new());
        }
        let rests = Arc::new(AtomicBool::new(false));
        let (screen, resting) = (screen.clone(), rests.clone());
        spawn_blocking(move || {
            let memory = (pool, free);
            if let Err(error) = grab_all(screen.as_ref(), region, &resting, &memory, &tell) {
                // The receiver is gone when the block has ended.
                let _ = tell.send(Err(error));
            }
        });
        Self {
            region,
            most_pictures,
            pictures,
            rests,
        }
    }

    /// Discards the received images. Returns true if grabbing continues.
    fn forget_pictures(&mut self) -> bool {
        loop {
            match self.pictures.try_recv() {
                Ok(Ok(_)) => {}
                Ok(Err(_)) | Err(mpsc::error::TryRecvError::Disconnected) => return false,
                Err(mpsc::error::TryRecvError::Empty) => return true,
            }
        }
    }
}

fn grab_all(
    screen: &dyn Screen,
    region: Rectangle,
    rests: &AtomicBool,
    (pool, free): &(Sender<Vec<u8>>, Receiver<Vec<u8>>),
    tell: &mpsc::UnboundedSender<Result<CodedPicture, PixelError>>,
) -> Result<(), PixelError> {
    let strip = Rectangle {
        y_px: region.y_px + (MARGIN_PX - STRIP_PX) / 2,
        height_px: STRIP_PX,
        ..region
    };
    let (mut strips, mut pictures) = (screen.open(Some(strip))?, screen.open(Some(region))?);
    let (mut strip, mut margins) = (RgbPicture::default(), RgbPicture::default());
    let (mut last, mut memory) = (LastCode::default(), None);
    while !tell.is_closed() {
        let seen = if rests.load(Ordering::Relaxed) {
            last.since = None;
            None
        } else {
            strips.grab(&mut strip)?;
            read_strip(&strip, STRIP_PX / 2)
        };
        let is_new = seen.is_some() && seen != last.code;
        let Some(seen) = seen.filter(|_| is_new || last.is_torn || last.is_overdue()) else {
            thread::sleep(LOOK_EVERY);
            continue;
        };
        // Ours is a sender as well: it waits for an image that is dropped.
        let Some(mut rgb) = memory.take().or_else(|| free.recv().ok()) else {
            return Ok(());
        };
        pictures.grab_inside(MARGIN_PX, &mut margins, &mut rgb)?;
        let found = read(&margins);
        if is_new && found != Some(seen) {
            last.comes(seen);
            last.is_torn = true;
            let coded = CodedPicture {
                code: seen,
                rgb: None,
            };
            if tell.send(Ok(coded)).is_err() {
                return Ok(());
            }
        }
        let Some(code) = found else {
            memory = Some(rgb);
            if !is_new {
                last.since = None;
                thread::sleep(LOOK_EVERY);
            }
            continue;
        };
        last.comes(code);
        let rgb = Some(PooledPicture::new(rgb, pool.clone()));
        if tell.send(Ok(CodedPicture { code, rgb })).is_err() {
            return Ok(());
        }
    }
    Ok(())
}

/// The last code that was seen, and for how long one usually stays.
#[derive(Debug, Default)]
struct LastCode {
    code: Option<FrameCode>,
    /// Since when it is there; `None` once it was grabbed again, and after a rest.
    since: Option<Instant>,
    usual: Option<Duration>,
    /// True if no whole image of it was grabbed yet.
    is_torn: bool,
}

impl LastCode {
    /// True if a later frame may show it by now.
    fn is_overdue(&self) -> bool {
        let stays = self.since.zip(self.usual);
        stays.is_some_and(|(since, usual)| since.elapsed() > usual.mul_f64(OVERDUE))
    }

    /// A code was grabbed.
    fn comes(&mut self, code: FrameCode) {
        let before = self.code.replace(code);
        if std::mem::take(&mut self.is_torn) && before == Some(code) {
            return;
        }
        if before == Some(code) {
            // Once more is enough.
            self.since = None;
            return;
        }
        let now = Instant::now();
        if let (Some(since), true) = (
            self.since,
            before.is_some_and(|before| code.follows(before)),
        ) {
            let stayed = now - since;
            self.usual = Some(self.usual.map_or(stayed, |usual| {
                usual.mul_f64(1.0 - NEWEST_WEIGHT) + stayed.mul_f64(NEWEST_WEIGHT)
            }));
        }
        self.since = Some(now);
    }
}
