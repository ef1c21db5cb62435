//! Decoded view images, each checked against its tick's timestamp.

use std::fs;
use std::path::Path;

use dataset::tables::frames::TickRow;
use dataset::video::{GROUP_OF_PICTURES, VideoReader};

use super::source::Source;
use crate::error::Result;
use crate::still::StillFormat;

/// A video that is being decoded.
pub(crate) struct ViewPictures<'a> {
    source: &'a Source<'a>,
    view: &'a str,
    /// Place of the view in the rows of the table.
    index: usize,
    reader: VideoReader,
    /// Tick of the next image in the video.
    next: u32,
}

/// Minimum number of skipped images for a seek, which decodes as many on average: half of those between two key frames.
const SEEK: u32 = GROUP_OF_PICTURES / 2;

impl<'a> ViewPictures<'a> {
    /// Opens a view's video after checking it against the seal.
    pub(crate) fn open(source: &'a Source<'a>, view: &'a str) -> Result<Self> {
        let (index, _) = source.view(view)?;
        Ok(Self {
            source,
            view,
            index,
            reader: source.scenario.open_video(view)?,
            next: 0,
        })
    }

    /// Width and height.
    pub(crate) fn size_px(&self) -> [u32; 2] {
        [self.reader.width(), self.reader.height()]
    }

    /// Decodes the image of a later tick than the last one, which `row` is.
    pub(crate) fn decode(&mut self, row: &TickRow) -> Result<()> {
        let expected = row.views[self.index].pts;
        let between = row.tick - self.next;
        if between >= SEEK {
            self.reader.seek(expected)?;
        }
        let found = loop {
            match self.reader.skip_frame()? {
                Some(earlier) if between > 0 && earlier < expected => {}
                found => break found,
            }
        };
        self.next = row.tick + 1;
        if found == Some(expected) {
            return Ok(());
        }
        Err(self
            .source
            .lost_picture(self.view, row.tick, expected, found))
    }

    /// Writes the image that was decoded last. `rgb` is memory that is used again.
    pub(crate) fn write(
        &mut self,
        path: &Path,
        form: StillFormat,
        rgb: &mut Vec<u8>,
    ) -> Result<()> {
        if form == StillFormat::Jpeg {
            let bytes = self.reader.jpeg(path)?;
            return Ok(fs::write(path, bytes).map_err(dataset::Error::io("write", path))?);
        }
        self.convert(rgb)?;
        form.write(path, rgb, self.size_px())
    }

    /// The image that was decoded last, as RGB.
    pub(crate) fn convert(&mut self, rgb: &mut Vec<u8>) -> Result<()> {
        Ok(self.reader.convert(rgb)?)
    }
}
