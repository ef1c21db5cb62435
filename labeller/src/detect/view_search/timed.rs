//! A detector whose time and windows are counted.

use super::cpu_time::CpuClock;
use crate::detector::{Detector, PictureView, ScoredBox, Window, WindowSize};
use crate::error::Result;

pub(crate) struct Timed<'a> {
    pub(crate) detector: &'a mut dyn Detector,
    pub(crate) clock: &'a CpuClock,
    pub(crate) windows: u64,
}

impl Detector for Timed<'_> {
    fn window_size(&self) -> WindowSize {
        self.detector.window_size()
    }

    fn detect(
        &mut self,
        picture: &PictureView<'_>,
        windows: &[Window],
        score_floor: f64,
    ) -> Result<Vec<Vec<ScoredBox>>> {
        self.windows += windows.len() as u64;
        let detector = &mut self.detector;
        self.clock.during(
            |cpu_s| &mut cpu_s.infer,
            || detector.detect(picture, windows, score_floor),
        )
    }

    fn first_pass_shrink(&self) -> u32 {
        self.detector.first_pass_shrink()
    }

    fn description(&self) -> String {
        self.detector.description()
    }
}
