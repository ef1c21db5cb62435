//! Decoded view images, each checked against its tick's timestamp.

use dataset::tables::frames::TickRow;
use dataset::video::VideoReader;

use super::source::Source;
use crate::error::{Error, Result};

/// A video that is being decoded.
pub(crate) struct ViewPictures<'a> {
    scenario: &'a str,
    view: &'a str,
    /// Place of the view in the rows of the table.
    index: usize,
    reader: VideoReader,
}

impl<'a> ViewPictures<'a> {
    /// Opens a view's video after checking it against the seal.
    pub(crate) fn open(source: &'a Source<'_>, view: &'a str) -> Result<Self> {
        let (index, _) = source.view(view)?;
        Ok(Self {
            scenario: &source.record.id,
            view,
            index,
            reader: source.scenario.open_video(view)?,
        })
    }

    /// Width and height.
    pub(crate) fn size_px(&self) -> [u32; 2] {
        [self.reader.width(), self.reader.height()]
    }

    /// Decodes the image of the next tick, which `row` is.
    pub(crate) fn decode(&mut self, row: &TickRow) -> Result<()> {
        let expected = row.views[self.index].pts;
        let found = self.reader.skip_frame()?;
        if found == Some(expected) {
            return Ok(());
        }
        Err(Error::Video {
            scenario: self.scenario.to_owned(),
            view: self.view.to_owned(),
            tick: row.tick,
            expected,
            found: found.map_or("the end of the video".into(), |pts| pts.to_string()),
        })
    }

    /// The image that was decoded last, as RGB.
    pub(crate) fn convert(&mut self, rgb: &mut Vec<u8>) -> Result<()> {
        Ok(self.reader.convert(rgb)?)
    }
}
