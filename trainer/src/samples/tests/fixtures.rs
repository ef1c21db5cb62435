//! Synthetic samples for tests.

use dataset::corpus::splits::Side;
use dataset::geometry::geodesy::Geodetic;
use dataset::tables::pixel_box::PixelBox;
use dataset::tables::registrations::Shift;
use glam::DVec2;
use testkit::synthetic::SyntheticCorpus;

use crate::samples::training_cameras::TrainingCameras;
use crate::samples::view_shift::ViewShift;
use crate::samples::{Candidate, DistanceRange, Observation, Sample, Samples};

impl Samples {
    /// Samples from a synthetic corpus, beyond a minimum distance in nautical miles.
    pub(crate) fn synthetic(corpus: &SyntheticCorpus, min_nm: f64) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let corpus = corpus.write(folder.path()).unwrap();
        let mut samples = Self::read(&corpus, None).unwrap();
        samples.retain_within(DistanceRange {
            min_nm,
            max_nm: None,
        });
        samples
    }

    /// The training side with only those boxes that contain the aircraft.
    pub(crate) fn with_true_boxes(&self) -> Vec<Sample> {
        let training = self.of_side(Side::Train);
        TrainingCameras::of(self, &training).true_boxes(&training)
    }
}

/// A tiny corpus with registered views.
pub(crate) fn registered_corpus(shift_noise_px: f64) -> SyntheticCorpus {
    SyntheticCorpus {
        shift_noise_px: Some(shift_noise_px),
        ..SyntheticCorpus::tiny()
    }
}

impl Observation {
    /// An aircraft in these columns of two registered views, with one tick per second.
    pub(crate) fn registered(tick: u32, columns_px: [f64; 2]) -> Self {
        Self::registered_at(
            tick,
            columns_px.map(|column_px| DVec2::new(column_px, 600.0)),
        )
    }

    /// An aircraft in these places of two registered views, with one tick per second.
    pub(crate) fn registered_at(tick: u32, places_px: [DVec2; 2]) -> Self {
        let boxes = places_px.map(|place_px| box_at(place_px.x, place_px.y));
        let [first_px, second_px] = places_px;
        let shift = shift_of(first_px.into(), (second_px - first_px).into());
        let mut observed = Sample::of_boxes(1.0, boxes.map(Some).to_vec()).observed;
        observed.shifts[1] = Some(ViewShift::of(0, &shift));
        observed.tick = tick;
        observed.time_ns = i64::from(tick) * 1_000_000_000;
        observed
    }

    /// The best box in a view.
    pub(crate) fn best_mut(&mut self, view: usize) -> Option<&mut PixelBox> {
        Some(&mut self.candidates[view].first_mut()?.pixel_box)
    }

    /// Replaces the boxes in all views.
    pub(crate) fn show(&mut self, boxes: impl IntoIterator<Item = Option<PixelBox>>) {
        for (view, seen) in boxes.into_iter().enumerate() {
            self.show_in(view, seen, None);
        }
    }

    /// Replaces the boxes in a view.
    pub(crate) fn show_in(&mut self, view: usize, seen: Option<PixelBox>, track: Option<u32>) {
        let candidate = seen.map(|pixel_box| Candidate {
            pixel_box,
            score: 0.9,
            track,
        });
        self.candidates[view] = Vec::from_iter(candidate);
    }
}

impl Sample {
    /// A sample with only boxes, for tests that need no more.
    pub(crate) fn of_boxes(dtd_m: f64, boxes: Vec<Option<PixelBox>>) -> Self {
        let mut observed = Observation::unseen((0, 0, 0), boxes.len());
        observed.show(boxes);
        Self {
            observed,
            dtd_m,
            along_track_m: dtd_m,
            cross_track_m: 0.0,
            position: Geodetic {
                latitude_deg: 1.0,
                longitude_deg: 103.0,
                altitude_msl_m: 100.0,
            },
            transmission: Some(1.0),
        }
    }
}

pub(crate) fn box_at(cx_px: f64, cy_px: f64) -> PixelBox {
    PixelBox {
        cx_px,
        cy_px,
        width_px: 40.0,
        height_px: 14.0,
    }
}

/// A registered shift with usual precision.
pub(crate) fn shift_of([x_px, y_px]: [f64; 2], [dx_px, dy_px]: [f64; 2]) -> Shift {
    Shift {
        x_px,
        y_px,
        dx_px,
        dy_px,
        sd_x_px: 0.03,
        sd_y_px: 0.04,
    }
}
