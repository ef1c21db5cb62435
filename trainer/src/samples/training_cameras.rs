//! Cameras that determine which boxes on the training side contain the aircraft, fitted to the boxes themselves.
//!
//! Ground truth gives the aircraft's position at each tick, not in an image. A real camera's calibration may be wrong by more than a box,
//! so it is only the starting point: each view's camera is fitted to the boxes of all training flights at once ([`camera_fit`]). Most boxes
//! must contain the aircraft, and the fitted camera must be within a few degrees of the stated one.
//!
//! The fit needs ground truth, so it uses the training side alone and applies to it alone.

mod camera_fit;
mod contradiction;
mod dropped_boxes;
#[cfg(test)]
mod tests;

use dataset::corpus::detections::RegisteredWith;
use dataset::geometry::camera::Camera;
use dataset::tables::pixel_box::PixelBox;
use dataset::work::watch::Watch;
use glam::DVec2;

use crate::samples::trusted_boxes::{centre_and_size, is_at};
use crate::samples::{Sample, Samples};

use camera_fit::{CameraFit, LabelledBox};
use contradiction::contradictions_line;
use dropped_boxes::TrainingDrops;
pub(crate) use dropped_boxes::{DroppedBoxes, DroppedByView};

/// Maximum number of boxes per view in a fit; more have little effect.
const MAX_BOXES: usize = 2_000;

/// Fitted cameras, one per view.
#[derive(Debug, Clone)]
pub(crate) struct TrainingCameras {
    fits: Vec<CameraFit>,
    /// Per view, true if most boxes agree with the fit.
    agree: Vec<bool>,
    /// Stated cameras by scenario and view.
    stated: Vec<Vec<Camera>>,
}

impl TrainingCameras {
    /// Fits the cameras to these ticks and their ground truth.
    pub(crate) fn of(samples: &Samples, training: &[&Sample]) -> Self {
        let stated: Vec<Vec<Camera>> = (samples.scenarios.iter())
            .map(|scenario| scenario.cameras.clone())
            .collect();
        let fit = |view: usize| {
            let boxes = training.iter().filter_map(|sample| {
                let (centre_px, _) = centre_and_size(sample.best(view)?);
                let camera = stated[sample.scenario][view];
                let at_m = sample.position.to_ecef();
                Some(LabelledBox::new(sample.scenario, camera, at_m, centre_px))
            });
            let boxes: Vec<LabelledBox> = boxes.collect();
            let step = boxes.len().div_ceil(MAX_BOXES).max(1);
            CameraFit::of(&boxes.into_iter().step_by(step).collect::<Vec<_>>())
        };
        let views = samples.views.len();
        let mut cameras = Self {
            fits: (0..views).map(fit).collect(),
            agree: vec![true; views],
            stated,
        };
        cameras.agree = (0..views)
            .map(|view| cameras.is_of_most(view, training))
            .collect();
        cameras
    }

    /// True if most boxes in a view agree with its fitted camera: a minority may show any stationary object near distant aircraft.
    fn is_of_most(&self, view: usize, training: &[&Sample]) -> bool {
        let boxes = training.iter().filter_map(|sample| {
            let seen = sample.best(view)?;
            Some(self.is_true(view, sample, seen))
        });
        let (agreeing, others): (Vec<bool>, Vec<bool>) = boxes.partition(|is_true| *is_true);
        agreeing.len() >= others.len()
    }

    /// The samples with only those boxes that contain the aircraft; samples without any are dropped.
    pub(crate) fn true_boxes(&self, training: &[&Sample]) -> Vec<Sample> {
        let samples = training.iter().map(|sample| self.with_true_boxes(sample));
        samples.filter(|sample| sample.detections() > 0).collect()
    }

    /// Warns of many false boxes, and of stated cameras that contradict the boxes; returns the number of dropped boxes.
    pub(crate) fn report(
        &self,
        samples: &Samples,
        training: &[&Sample],
        watch: &dyn Watch,
    ) -> DroppedByView {
        let dropped = TrainingDrops::of(self, samples, training);
        if dropped.are_unusual() {
            watch.warn(&dropped.to_string());
        }
        let contradictions = self.contradictions(&samples.views);
        if !contradictions.is_empty() {
            let registered_again =
                matches!(samples.registered_with(), Some(RegisteredWith::Run(_)));
            watch.warn(&contradictions_line(&contradictions, registered_again));
        }
        dropped.by_view
    }

    fn with_true_boxes(&self, sample: &Sample) -> Sample {
        let is_true = |(view, seen)| self.is_true(view, sample, seen).then_some(view);
        let views: Vec<usize> = sample.seen().filter_map(is_true).collect();
        sample.with(sample.with_boxes_that(|view, _| views.contains(&view)))
    }

    fn is_true(&self, view: usize, sample: &Sample, seen: &PixelBox) -> bool {
        let place = self.agree[view].then(|| self.place_px(view, sample));
        place
            .flatten()
            .is_some_and(|place_px| is_at(seen, place_px))
    }

    /// Expected image position of the aircraft, pixels.
    fn place_px(&self, view: usize, sample: &Sample) -> Option<DVec2> {
        let camera = &self.stated[sample.scenario][view];
        self.fits[view].place_px(camera, sample.position.to_ecef())
    }
}
