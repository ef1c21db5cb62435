//! A thread that grabs each numbered frame once, while the caller waits for other things.
//!
//! It looks at a strip of the code many times per second, which is cheap, and grabs the whole image when the number has changed. Images
//! that are torn or carry no code are dropped here. Memory is bounded by the number of images that exist at a time. Thread and memory
//! stay from block to block, since opening the screen and getting the memory takes as long as several frames.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;
use std::time::Duration;

use tokio::sync::mpsc;
use tokio::task::spawn_blocking;

use super::Screen;
use super::frame_code::{FrameCode, read, read_strip};
use crate::link::{MARGIN_PX, PooledPicture};
use crate::pixels::{PixelError, Rectangle, RgbPicture};

/// Time between two looks at the strip, which cost two context switches each. A frame lasts 16 ms at 60 frames per second.
const LOOK_EVERY: Duration = Duration::from_micros(1_500);
/// Rows of the strip that are looked at, in the middle of the code.
const STRIP_PX: u32 = 2;

/// An image with its code, without the margins.
#[derive(Debug)]
pub(crate) struct CodedPicture {
    pub(crate) code: FrameCode,
    pub(crate) rgb: PooledPicture,
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
    let (mut last, mut memory) = (None, None);
    while !tell.is_closed() {
        let is_new = !rests.load(Ordering::Relaxed) && {
            strips.grab(&mut strip)?;
            let code = read_strip(&strip, STRIP_PX / 2);
            code.is_some() && code != last
        };
        if !is_new {
            thread::sleep(LOOK_EVERY);
            continue;
        }
        // Ours is a sender as well: it waits for an image that is dropped.
        let Some(mut rgb) = memory.take().or_else(|| free.recv().ok()) else {
            return Ok(());
        };
        pictures.grab_inside(MARGIN_PX, &mut margins, &mut rgb)?;
        let Some(code) = read(&margins).filter(|code| Some(*code) != last) else {
            memory = Some(rgb);
            continue;
        };
        last = Some(code);
        let rgb = PooledPicture::new(rgb, pool.clone());
        if tell.send(Ok(CodedPicture { code, rgb })).is_err() {
            return Ok(());
        }
    }
    Ok(())
}
