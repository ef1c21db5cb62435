//! A view's images in their order: decoded, and converted as far as needed.

pub(crate) mod image;
mod video_images;

use dataset::corpus::open_scenario::OpenScenario;
use dataset::numbers::units::SimTime;
use dataset::tables::frames::Frames;
use dataset::video::{Luma, PicturePart};

use super::view_search::cpu_time::CpuClock;
use crate::detector::PictureView;
use crate::error::{Error, Result};
use image::Image;
pub use video_images::VideoImages;

/// A view and its ticks.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ViewTicks {
    pub(crate) id: String,
    pub(crate) ticks: Vec<ViewTick>,
}

/// An image that the video must have.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ViewTick {
    pub(crate) tick: u32,
    pub(crate) time_s: f64,
    pub(crate) pts: i64,
}

impl ViewTicks {
    /// Ticks of all views in a table.
    pub(crate) fn of(frames: &Frames) -> Vec<Self> {
        let views = frames.views.iter().enumerate();
        views
            .map(|(index, id)| Self {
                id: id.clone(),
                ticks: frames
                    .rows
                    .iter()
                    // Rows of a recorded scenario have no images.
                    .filter_map(|row| {
                        Some(ViewTick {
                            tick: row.tick,
                            time_s: SimTime(row.time_ns).seconds(),
                            pts: row.views.get(index)?.pts,
                        })
                    })
                    .collect(),
            })
            .collect()
    }
}

/// A view's video during the search.
pub(super) struct Pictures<'a> {
    scenario: String,
    view: &'a str,
    clock: &'a CpuClock,
    images: VideoImages,
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
            images: clock.during(
                |cpu_s| &mut cpu_s.decode,
                || scenario.open_video(view).map(VideoImages::of),
            )?,
            clock,
        })
    }

    /// Goes on to a tick's image.
    pub(super) fn next(&mut self, expected: &ViewTick) -> Result<()> {
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
        let (clock, images) = (self.clock, &mut self.images);
        clock.during(|cpu_s| &mut cpu_s.decode, || images.advance())
    }

    fn fault(&self, message: String) -> Error {
        Error::scenario(&self.scenario, format!("view {}: {message}", self.view))
    }
}

impl Image for Pictures<'_> {
    fn size_px(&self) -> [u32; 2] {
        self.images.size_px()
    }

    fn whole(&mut self) -> Result<PictureView<'_>> {
        let (clock, images) = (self.clock, &mut self.images);
        clock.during(|cpu_s| &mut cpu_s.convert, || images.whole())
    }

    fn part(&mut self, part: PicturePart) -> Result<PictureView<'_>> {
        let (clock, images) = (self.clock, &mut self.images);
        clock.during(|cpu_s| &mut cpu_s.convert, || images.part(part))
    }

    fn lumas(&self) -> [Option<Luma<'_>>; 2] {
        self.images.lumas()
    }
}
