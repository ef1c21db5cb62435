//! The images of a view, one after another: decoded, and converted as far as they are looked at.

pub(crate) mod image;

use dataset::corpus::open_scenario::OpenScenario;
use dataset::numbers::units::SimTime;
use dataset::tables::frames::Frames;
use dataset::video::{Luma, PicturePart, VideoReader};

use super::view_search::cpu_time::{CpuClock, Stage};
use crate::detector::PictureView;
use crate::error::{Error, Result};
use image::Image;

/// A view and its ticks.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ViewTicks {
    /// Identifier of the view.
    pub(crate) id: String,
    pub(crate) ticks: Vec<ViewTick>,
}

/// An image that the video must have.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ViewTick {
    pub(crate) tick: u32,
    pub(crate) time_s: f64,
    /// Its timestamp in the video.
    pub(crate) pts: i64,
}

impl ViewTicks {
    /// Ticks of all views of a table.
    pub(crate) fn of(frames: &Frames) -> Vec<Self> {
        let views = frames.views.iter().enumerate();
        views
            .map(|(index, id)| Self {
                id: id.clone(),
                ticks: frames
                    .rows
                    .iter()
                    .map(|row| ViewTick {
                        tick: row.tick,
                        time_s: SimTime(row.time_ns).seconds(),
                        pts: row.views[index].pts,
                    })
                    .collect(),
            })
            .collect()
    }
}

/// The video of a view while it is searched.
pub(super) struct Pictures<'a> {
    scenario: String,
    view: &'a str,
    clock: &'a CpuClock,
    reader: VideoReader,
    /// The whole image, once it was converted.
    whole: Vec<u8>,
    is_converted: bool,
    part: Vec<u8>,
}

impl<'a> Pictures<'a> {
    pub(super) fn open(
        scenario: &OpenScenario,
        view: &'a str,
        clock: &'a CpuClock,
    ) -> Result<Self> {
        Ok(Self {
            scenario: scenario.id(),
            view,
            reader: clock.during(Stage::Decode, || scenario.open_video(view))?,
            clock,
            whole: Vec::new(),
            is_converted: false,
            part: Vec::new(),
        })
    }

    /// Goes on to the image of a tick.
    pub(super) fn next(&mut self, expected: &ViewTick) -> Result<()> {
        self.is_converted = false;
        let found = self.decode()?;
        if found == Some(expected.pts) {
            return Ok(());
        }
        let found = found.map_or("the end of the video".into(), |found| {
            format!("an image with timestamp {found}")
        });
        Err(self.fault(format!(
            "at tick {} expected an image with timestamp {}, found {found}; generate the scenario again",
            expected.tick, expected.pts
        )))
    }

    /// After the last tick the video must end.
    pub(super) fn end(&mut self) -> Result<()> {
        match self.decode()? {
            None => Ok(()),
            Some(pts) => Err(self.fault(format!(
                "after the last tick there is an image with timestamp {pts}; generate the scenario again"
            ))),
        }
    }

    fn decode(&mut self) -> Result<Option<i64>> {
        let (clock, reader) = (self.clock, &mut self.reader);
        Ok(clock.during(Stage::Decode, || reader.skip_frame())?)
    }

    fn fault(&self, message: String) -> Error {
        Error::scenario(&self.scenario, format!("view {}: {message}", self.view))
    }
}

impl Image for Pictures<'_> {
    fn size_px(&self) -> [u32; 2] {
        [self.reader.width(), self.reader.height()]
    }

    fn whole(&mut self) -> Result<PictureView<'_>> {
        if !self.is_converted {
            let (clock, reader) = (self.clock, &mut self.reader);
            clock.during(Stage::Convert, || reader.convert(&mut self.whole))?;
            self.is_converted = true;
        }
        Ok(PictureView {
            rgb: &self.whole,
            width_px: self.reader.width(),
            height_px: self.reader.height(),
        })
    }

    fn part(&mut self, part: PicturePart) -> Result<PictureView<'_>> {
        let (clock, reader) = (self.clock, &mut self.reader);
        clock.during(Stage::Convert, || reader.convert_part(part, &mut self.part))?;
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
