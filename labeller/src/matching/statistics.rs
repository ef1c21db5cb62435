//! Detections compared with the truth: counts that can be added over scenarios, and the figures derived from them.

use dataset::conditions::sight::Sight;
use dataset::corpus::detections::Detection;
use dataset::tables::pixel_box::TruthBox;
use serde::Serialize;

use crate::matching::Match;

/// Counts over images. One image is one view at one tick.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct DetectionCounts {
    /// Number of images.
    pub pictures: u64,
    /// Detections in all images.
    pub detections: u64,
    /// Confirmed detections.
    pub confirmed: u64,
    /// Comparison of the confirmed detections with labels, if there are any.
    pub against_truth: Option<TruthCounts>,
}

/// Ground-truth box with its visibility.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct TruthInSight {
    pub(crate) truth: TruthBox,
    pub(crate) sight: Sight,
}

/// Counts over images with labels.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct TruthCounts {
    /// Images with more than half of the aircraft, in sight: neither haze nor a cloud hides it. With several aircraft, an image counts for
    /// each of them, here and below.
    pub expected: u64,
    /// Other images with more than half of the aircraft: it is beyond the visibility.
    pub hidden_by_haze: u64,
    /// The rest: it is in or above clouds.
    pub maybe_hidden_by_cloud: u64,
    /// Images with the aircraft in sight and a detection that hits it ([`Match::Hit`]).
    pub found: u64,
    /// Detections that do not touch a ground-truth box, in all images.
    pub false_detections: u64,
    /// Sum over the found aircraft: distance of the centres, pixels.
    pub sum_center_error_px: f64,
    /// Sums over the found aircraft: detected minus true centre, right and down, pixels.
    pub sum_center_offset_px: [f64; 2],
}

impl DetectionCounts {
    /// Counts one scenario. `truth` is `None` if it has no labels.
    pub(crate) fn of(
        pictures: u64,
        detections: &[Detection],
        truth: Option<&[TruthInSight]>,
    ) -> Self {
        let confirmed: Vec<_> = detections.iter().filter(|found| found.confirmed).collect();
        Self {
            pictures,
            detections: detections.len() as u64,
            confirmed: confirmed.len() as u64,
            against_truth: truth.map(|truth| TruthCounts::of(&confirmed, truth)),
        }
    }

    /// Adds further counts.
    pub fn add(&mut self, other: &Self) {
        self.pictures += other.pictures;
        self.detections += other.detections;
        self.confirmed += other.confirmed;
        if let Some(theirs) = &other.against_truth {
            self.against_truth.get_or_insert_default().add(theirs);
        }
    }
}

impl TruthCounts {
    fn of(detections: &[&Detection], truth: &[TruthInSight]) -> Self {
        let mut counts = Self::default();
        let pictured = |detection: &Detection, real: &TruthBox| {
            detection.tick == real.tick && detection.view == real.view
        };
        // Both tables are in tick order: only rows of the same tick are compared.
        let of_tick = |tick: u32| {
            let first = detections.partition_point(|detection| detection.tick < tick);
            let end = detections.partition_point(|detection| detection.tick <= tick);
            first..end
        };
        // One box may touch several aircraft.
        let mut touches_some = vec![false; detections.len()];
        for TruthInSight { truth: real, sight } in truth {
            let here = || {
                let of_tick = of_tick(real.tick).map(|index| (index, detections[index]));
                of_tick.filter(|(_, detection)| pictured(detection, real))
            };
            let compared = |detection: &Detection| Match::of(&detection.pixel_box, &real.pixel_box);
            for (index, found) in here() {
                touches_some[index] |= compared(found) != Match::Elsewhere;
            }
            if !real.is_expected() {
                continue;
            }
            match sight {
                Sight::Open => counts.expected += 1,
                Sight::Haze => counts.hidden_by_haze += 1,
                Sight::Cloud => counts.maybe_hidden_by_cloud += 1,
            }
            if *sight != Sight::Open {
                continue;
            }
            let hits = here().map(|(_, found)| found);
            let hits = hits.filter(|found| compared(found) == Match::Hit);
            if let Some(best) = hits.max_by(|a, b| a.score.total_cmp(&b.score)) {
                let offset = [
                    best.pixel_box.cx_px - real.pixel_box.cx_px,
                    best.pixel_box.cy_px - real.pixel_box.cy_px,
                ];
                counts.found += 1;
                counts.sum_center_error_px += offset[0].hypot(offset[1]);
                counts.sum_center_offset_px[0] += offset[0];
                counts.sum_center_offset_px[1] += offset[1];
            }
        }
        counts.false_detections = touches_some.iter().filter(|touches| !**touches).count() as u64;
        counts
    }

    fn add(&mut self, other: &Self) {
        self.expected += other.expected;
        self.hidden_by_haze += other.hidden_by_haze;
        self.maybe_hidden_by_cloud += other.maybe_hidden_by_cloud;
        self.found += other.found;
        self.false_detections += other.false_detections;
        self.sum_center_error_px += other.sum_center_error_px;
        for (sum, addend) in self
            .sum_center_offset_px
            .iter_mut()
            .zip(other.sum_center_offset_px)
        {
            *sum += addend;
        }
    }

    /// Share of the images with the aircraft in sight in which it was found, 0 to 1; `None` without such images.
    pub fn detection_rate(&self) -> Option<f64> {
        (self.expected > 0).then(|| self.found as f64 / self.expected as f64)
    }

    /// Mean distance of the centres of found aircraft, pixels.
    pub fn mean_center_error_px(&self) -> Option<f64> {
        (self.found > 0).then(|| self.sum_center_error_px / self.found as f64)
    }
}
