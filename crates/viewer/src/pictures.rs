//! Single images of a video, by tick.
//!
//! Videos are decoded from a keyframe on. A page steps mostly to the next image, which is the next one to decode; for steps backwards
//! the images that were decoded on the way are kept.

mod bitmap;
pub(crate) mod planes;
pub(crate) mod thumbnail;

use std::collections::VecDeque;
use std::path::Path;

use axum::body::Bytes;
use dataset::Result;
use dataset::error::Error;
use dataset::numbers::frame_rate::FrameRate;
use dataset::video::{BYTES_PER_PIXEL, VideoReader};
use serde::Deserialize;

/// Images kept, bytes: fifteen of 1920 x 1280 as planes.
const KEPT_BYTES: usize = 56 << 20;
/// Up to this many images ahead decoding is faster than going to a keyframe.
const NEAR_TICKS: u32 = 30;

/// Requested image format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Form {
    /// A bitmap file, with the pixels that a detector gets.
    Bitmap,
    /// Coded planes, half the bytes, if the video has the usual pixel format; else a bitmap.
    Planes,
}

/// An image as it is sent.
#[derive(Debug, Clone)]
pub(crate) struct Picture {
    pub(crate) bytes: Bytes,
    /// Columns and rows of planes, which do not say so themselves. `None` for a bitmap file.
    pub(crate) size_px: Option<[u32; 2]>,
}

/// A view's images.
pub(crate) struct Pictures {
    reader: VideoReader,
    frame_rate: FrameRate,
    /// The tick of the image that is decoded next, unless the reader went to a keyframe.
    next_tick: u32,
    rgb: Vec<u8>,
    /// The last decoded images, all in one format.
    kept: VecDeque<(u32, Picture)>,
    form: Form,
}

impl Pictures {
    pub(crate) fn open(path: &Path, frame_rate: FrameRate) -> Result<Self> {
        Ok(Self {
            reader: VideoReader::open_ticks(path, frame_rate)?,
            frame_rate,
            next_tick: 0,
            rgb: Vec::new(),
            kept: VecDeque::new(),
            form: Form::Bitmap,
        })
    }

    /// The image at a tick.
    ///
    /// # Errors
    /// The video has none, or is damaged. It has to be opened again.
    pub(crate) fn at(&mut self, tick: u32, form: Form, path: &Path) -> Result<Picture> {
        if form != self.form {
            self.kept.clear();
            self.form = form;
        }
        if let Some((_, picture)) = self.kept.iter().find(|(kept, _)| *kept == tick) {
            return Ok(picture.clone());
        }
        let goes_back = tick < self.next_tick;
        if goes_back || tick > self.next_tick + NEAR_TICKS {
            self.reader.seek(self.frame_rate.pts_of_tick(tick))?;
        }
        let pixels = self.reader.width() as usize * self.reader.height() as usize;
        // All cached images have one size. A bitmap is the largest form, and is also sent instead of planes that a video does not have.
        let picture_bytes = match self.kept.back() {
            Some((_, picture)) => picture.bytes.len(),
            None => pixels * BYTES_PER_PIXEL,
        };
        let most_kept = (KEPT_BYTES / picture_bytes.max(1)).max(1);
        loop {
            let decoded = self.reader.skip_frame()?;
            let found = decoded.and_then(|pts| self.tick_of(pts));
            let Some(found) = found.filter(|found| *found <= tick) else {
                let message = format!(
                    "has no image of tick {tick}; `dtd verify` checks all images of a corpus"
                );
                return Err(Error::corpus(path, message));
            };
            self.next_tick = found + 1;
            let is_kept = goes_back && ((tick - found) as usize) < most_kept;
            if found < tick && !is_kept {
                continue;
            }
            let picture = self.decoded()?;
            if self.kept.len() == most_kept {
                self.kept.pop_front();
            }
            self.kept.push_back((found, picture.clone()));
            if found == tick {
                return Ok(picture);
            }
        }
    }

    /// The image that was decoded last.
    fn decoded(&mut self) -> Result<Picture> {
        let size_px = [self.reader.width(), self.reader.height()];
        if self.form == Form::Planes
            && let Some(planes) = self.reader.planes()?
        {
            return Ok(Picture {
                bytes: planes.into(),
                size_px: Some(size_px),
            });
        }
        self.reader.convert(&mut self.rgb)?;
        Ok(Picture {
            bytes: bitmap::of_rgb(&self.rgb, size_px).into(),
            size_px: None,
        })
    }

    fn tick_of(&self, pts: i64) -> Option<u32> {
        let denominator = i64::from(self.frame_rate.denominator);
        (pts % denominator == 0).then_some(())?;
        u32::try_from(pts / denominator).ok()
    }
}
