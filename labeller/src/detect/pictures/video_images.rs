//! The images of a video, one after the other.

use dataset::video::{Luma, PicturePart, VideoReader};

use super::image::Image;
use crate::detector::PictureView;
use crate::error::Result;

/// A video during the search.
pub struct VideoImages {
    reader: VideoReader,
    /// The whole image, once it was converted.
    whole: Vec<u8>,
    is_converted: bool,
    part: Vec<u8>,
}

impl VideoImages {
    /// The images that this reader decodes.
    pub fn of(reader: VideoReader) -> Self {
        Self {
            reader,
            whole: Vec::new(),
            is_converted: false,
            part: Vec::new(),
        }
    }

    /// The video that is read.
    pub fn reader(&self) -> &VideoReader {
        &self.reader
    }

    /// Goes on to the next image; returns its timestamp, or `None` after the last one.
    pub fn advance(&mut self) -> Result<Option<i64>> {
        self.is_converted = false;
        Ok(self.reader.skip_frame()?)
    }
}

impl Image for VideoImages {
    fn size_px(&self) -> [u32; 2] {
        [self.reader.width(), self.reader.height()]
    }

    fn whole(&mut self) -> Result<PictureView<'_>> {
        if !self.is_converted {
            self.reader.convert(&mut self.whole)?;
            self.is_converted = true;
        }
        Ok(PictureView {
            rgb: &self.whole,
            width_px: self.reader.width(),
            height_px: self.reader.height(),
        })
    }

    fn part(&mut self, part: PicturePart) -> Result<PictureView<'_>> {
        self.reader.convert_part(part, &mut self.part)?;
        Ok(PictureView {
            rgb: &self.part,
            width_px: part.width_px,
            height_px: part.height_px,
        })
    }

    fn lumas(&self) -> [Option<Luma<'_>>; 2] {
        [self.reader.previous_luma(), self.reader.luma()]
    }
}
