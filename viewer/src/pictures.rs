//! Single pictures of a video, by tick.
//!
//! Videos are decoded from a keyframe on. A page steps mostly to the next picture, which is the next one to decode; for steps backwards
//! the pictures that were decoded on the way are kept.

use std::collections::VecDeque;
use std::path::Path;

use axum::body::Bytes;
use dataset::Result;
use dataset::error::Error;
use dataset::frame_rate::FrameRate;
use dataset::video::VideoReader;

use crate::bitmap;

/// Pictures kept, bytes: seven of 1920 x 1280.
const KEPT_BYTES: usize = 56 << 20;
/// Up to this many pictures ahead decoding is faster than going to a keyframe.
const NEAR_TICKS: u32 = 30;

/// The pictures of one view.
pub(crate) struct Pictures {
    reader: VideoReader,
    frame_rate: FrameRate,
    /// The tick of the picture that is decoded next, unless the reader went to a keyframe.
    next_tick: u32,
    rgb: Vec<u8>,
    kept: VecDeque<(u32, Bytes)>,
}

impl Pictures {
    pub(crate) fn open(path: &Path, frame_rate: FrameRate) -> Result<Self> {
        Ok(Self {
            reader: VideoReader::open(path)?,
            frame_rate,
            next_tick: 0,
            rgb: Vec::new(),
            kept: VecDeque::new(),
        })
    }

    /// The picture of a tick, as a bitmap file.
    ///
    /// # Errors
    /// The video has none, or is damaged. It has to be opened again.
    pub(crate) fn at(&mut self, tick: u32, path: &Path) -> Result<Bytes> {
        if let Some((_, picture)) = self.kept.iter().find(|(kept, _)| *kept == tick) {
            return Ok(picture.clone());
        }
        let goes_back = tick < self.next_tick;
        if goes_back || tick > self.next_tick + NEAR_TICKS {
            self.reader.seek(self.frame_rate.pts_of_tick(tick))?;
        }
        let size_px = [self.reader.width(), self.reader.height()];
        let picture_bytes = size_px[0] as usize * size_px[1] as usize * 3;
        let most_kept = (KEPT_BYTES / picture_bytes.max(1)).max(1);
        loop {
            let decoded = self.reader.skip_frame()?;
            let found = decoded.and_then(|pts| self.tick_of(pts));
            let Some(found) = found.filter(|found| *found <= tick) else {
                let message = format!(
                    "has no picture of tick {tick}; `dtd verify` checks all pictures of a corpus"
                );
                return Err(Error::corpus(path, message));
            };
            self.next_tick = found + 1;
            let is_kept = goes_back && ((tick - found) as usize) < most_kept;
            if found < tick && !is_kept {
                continue;
            }
            self.reader.convert(&mut self.rgb)?;
            let picture = Bytes::from(bitmap::of_rgb(&self.rgb, size_px));
            if self.kept.len() == most_kept {
                self.kept.pop_front();
            }
            self.kept.push_back((found, picture.clone()));
            if found == tick {
                return Ok(picture);
            }
        }
    }

    fn tick_of(&self, pts: i64) -> Option<u32> {
        let denominator = i64::from(self.frame_rate.denominator);
        (pts % denominator == 0).then_some(())?;
        u32::try_from(pts / denominator).ok()
    }
}
