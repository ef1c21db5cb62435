//! A thread that grabs each numbered frame once, while the caller waits for other things.
//!
//! It looks at a strip of the code many times a second, which is cheap, and grabs the whole picture when the number has changed. Pictures
//! that are torn or carry no code are dropped here. Memory is bounded by the number of buffers, which the caller gives back.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use tokio::sync::mpsc;
use tokio::task::spawn_blocking;

use super::frame_code::{FrameCode, MARGIN_PX, read, read_strip};
use super::{Grab, Screen};
use crate::pixels::{PixelError, Rectangle, RgbPicture};

/// Time between two looks at the strip, which cost two context switches each. A frame lasts 16 ms at 60 frames a second.
const LOOK_EVERY: Duration = Duration::from_micros(1_500);
/// Rows of the strip that are looked at, in the middle of the code.
const STRIP_PX: u32 = 2;

/// A picture with its code, without the margins.
#[derive(Debug)]
pub(crate) struct CodedPicture {
    pub(crate) code: FrameCode,
    pub(crate) rgb: Vec<u8>,
}

/// The running thread. It ends when this is dropped.
#[derive(Debug)]
pub(crate) struct CodedGrabs {
    pictures: mpsc::UnboundedReceiver<Result<CodedPicture, PixelError>>,
    buffers: std::sync::mpsc::Sender<Vec<u8>>,
    rests: Arc<AtomicBool>,
}

impl CodedGrabs {
    /// Starts grabbing a region of a screen: the picture and [`MARGIN_PX`] around it. At most `buffers` pictures are with the caller at a
    /// time.
    pub(crate) fn start(screen: &Arc<dyn Screen>, region: Rectangle, buffers: usize) -> Self {
        let (tell, pictures) = mpsc::unbounded_channel();
        let (give_back, free) = std::sync::mpsc::channel();
        for _ in 0..buffers {
            // The receiver is ours still.
            let _ = give_back.send(Vec::new());
        }
        let rests = Arc::new(AtomicBool::new(false));
        let (screen, resting) = (screen.clone(), rests.clone());
        spawn_blocking(move || {
            if let Err(error) = grab_all(screen.as_ref(), region, &resting, &free, &tell) {
                // Nobody listens when the block has ended.
                let _ = tell.send(Err(error));
            }
        });
        Self {
            pictures,
            buffers: give_back,
            rests,
        }
    }

    /// The next picture. Cancel safe.
    pub(crate) async fn next(&mut self) -> Result<CodedPicture, PixelError> {
        match self.pictures.recv().await {
            Some(picture) => picture,
            None => Err(PixelError::Grab {
                what: "the thread that grabs has ended".into(),
            }),
        }
    }

    /// The next picture, if there is one already.
    pub(crate) fn next_now(&mut self) -> Option<Result<CodedPicture, PixelError>> {
        self.pictures.try_recv().ok()
    }

    /// Gives a picture's memory back.
    pub(crate) fn recycle(&self, rgb: Vec<u8>) {
        // The thread may have ended.
        let _ = self.buffers.send(rgb);
    }

    /// Whether no picture is expected: frames are not grabbed then.
    pub(crate) fn rest(&self, rests: bool) {
        self.rests.store(rests, Ordering::Relaxed);
    }
}

fn grab_all(
    screen: &dyn Screen,
    region: Rectangle,
    rests: &AtomicBool,
    free: &std::sync::mpsc::Receiver<Vec<u8>>,
    tell: &mpsc::UnboundedSender<Result<CodedPicture, PixelError>>,
) -> Result<(), PixelError> {
    let strip = Rectangle {
        y_px: region.y_px + (MARGIN_PX - STRIP_PX) / 2,
        height_px: STRIP_PX,
        ..region
    };
    let (mut strips, mut pictures) = (screen.open(Some(strip))?, screen.open(Some(region))?);
    let (mut strip, mut picture) = (RgbPicture::default(), RgbPicture::default());
    let mut last = None;
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
        let Some(code) =
            grab_whole(pictures.as_mut(), &mut picture)?.filter(|code| Some(*code) != last)
        else {
            continue;
        };
        let Ok(mut rgb) = free.recv() else {
            return Ok(());
        };
        crop(&picture, &mut rgb);
        last = Some(code);
        if tell.send(Ok(CodedPicture { code, rgb })).is_err() {
            return Ok(());
        }
    }
    Ok(())
}

/// The next grab's code, if it is of a single frame.
fn grab_whole(
    grab: &mut dyn Grab,
    picture: &mut RgbPicture,
) -> Result<Option<FrameCode>, PixelError> {
    grab.grab(picture)?;
    Ok(read(picture))
}

/// The picture without [`MARGIN_PX`] around it.
fn crop(grab: &RgbPicture, rgb: &mut Vec<u8>) {
    rgb.clear();
    for y in MARGIN_PX..grab.height_px - MARGIN_PX {
        rgb.extend_from_slice(
            grab.pixels(MARGIN_PX, grab.width_px - MARGIN_PX, y)
                .as_flattened(),
        );
    }
}
