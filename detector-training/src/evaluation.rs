//! Accuracy of a detector on frames that it was not trained on.
//!
//! Input: a network and whole decoded frames with ground-truth boxes. Output: recall, precision and errors of centre and size by width of
//! the aircraft. Frames are processed as in the labeller (Auto Segmentation, S11): non-overlapping tiles, then a crop centred on
//! each hit.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};

use burn::tensor::Device;
pub use dataset::numbers::spread::Spread;
use dataset::tables::pixel_box::PixelBox;
use dataset::work::watch::{Stopped, Watch};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::grid::{ScoredBox, peaks};
use super::network::Network;
use super::network::convolution::GatherTables;
use super::network::patches::PatchBatch;
use super::samples::corpus_samples::JudgedFrame;
use super::samples::training_picture::TrainingPicture;

/// Side of the squares that are searched one by one, pixels.
const TILE_PX: usize = 640;
/// Upper ends of the bins of width, pixels; the last bin is open.
const WIDTH_BINS_PX: [f64; 5] = [20.0, 30.0, 50.0, 90.0, f64::INFINITY];
/// Two detections closer than this share of their width are the same aircraft.
const SAME_SHARE: f64 = 0.5;

/// Result of evaluating a detector.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    /// Minimum peak score.
    pub threshold: f64,
    /// Number of frames.
    pub frames: usize,
    /// Frames with a visible aircraft.
    pub visible: usize,
    /// Share of visible aircraft that were found.
    pub recall: f64,
    /// Share of the detections that are the aircraft (visible or barely visible).
    pub precision: f64,
    /// False detections a frame.
    pub false_per_frame: f64,
    /// Figures by width of the ground-truth box.
    pub by_width: Vec<WidthBin>,
    /// Recall by name of the weather.
    pub recall_by_weather: BTreeMap<String, f64>,
}

/// Errors of aircraft of similar width: found minus true, pixels.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WidthBin {
    /// Maximum width of the ground-truth box, pixels; missing in the last bin.
    pub width_up_to_px: Option<f64>,
    /// Number of visible aircraft.
    pub visible: usize,
    /// Share of these aircraft that were found.
    pub recall: Option<f64>,
    /// Centre, right.
    pub cx_px: Option<Spread>,
    /// Centre, down.
    pub cy_px: Option<Spread>,
    /// Width.
    pub width_px: Option<Spread>,
    /// Height.
    pub height_px: Option<Spread>,
}

/// Runs the network on all frames and compares with the truth.
///
/// # Errors
/// The watch stopped it.
pub fn evaluate(
    network: &Network,
    frames: &[JudgedFrame],
    threshold: f64,
    watch: &dyn Watch,
) -> Result<Evaluation, Stopped> {
    watch.begin("detector: judging", frames.len() as u64);
    let done = AtomicU64::new(0);
    let outcomes = frames
        .par_iter()
        .map_init(
            || GatherTables::new(&Device::flex()),
            |tables, frame| {
                watch.check()?;
                let found = detect(network, tables, &frame.picture, threshold);
                watch.advance(done.fetch_add(1, Ordering::Relaxed) + 1, "");
                Ok(Outcome::of(frame, &found))
            },
        )
        .collect::<Result<Vec<_>, Stopped>>()?;
    Ok(summary(outcomes, threshold))
}

/// Compares what any detector found in all frames with the truth. `found` holds the boxes of each frame, best first.
pub fn judge(frames: &[JudgedFrame], found: &[Vec<ScoredBox>], threshold: f64) -> Evaluation {
    assert_eq!(frames.len(), found.len(), "every frame was searched");
    let outcomes = frames
        .iter()
        .zip(found)
        .map(|(frame, found)| Outcome::of(frame, found));
    summary(outcomes.collect(), threshold)
}

fn summary(outcomes: Vec<Outcome>, threshold: f64) -> Evaluation {
    let visible: Vec<&Outcome> = outcomes
        .iter()
        .filter(|outcome| outcome.visible.is_some())
        .collect();
    let share = |part: usize, whole: usize| {
        if whole > 0 {
            part as f64 / whole as f64
        } else {
            f64::NAN
        }
    };
    let hits: usize = outcomes.iter().map(|outcome| outcome.hits).sum();
    let misses: usize = outcomes.iter().map(|outcome| outcome.false_alarms).sum();
    let found = |of: &[&Outcome]| of.iter().filter(|outcome| outcome.error.is_some()).count();
    let mut weathers: BTreeMap<String, Vec<&Outcome>> = BTreeMap::new();
    for outcome in &visible {
        weathers
            .entry(outcome.weather.clone())
            .or_default()
            .push(outcome);
    }
    Evaluation {
        threshold,
        frames: outcomes.len(),
        visible: visible.len(),
        recall: share(found(&visible), visible.len()),
        precision: share(hits, hits + misses),
        false_per_frame: share(misses, outcomes.len()),
        by_width: width_bins(&visible),
        recall_by_weather: weathers
            .into_iter()
            .map(|(name, of)| (name, share(found(&of), of.len())))
            .collect(),
    }
}

/// Result for one frame.
struct Outcome {
    weather: String,
    /// Ground-truth box, if visible.
    visible: Option<PixelBox>,
    /// Errors of centre right, centre down, width, height, if it was found.
    error: Option<[f64; 4]>,
    hits: usize,
    false_alarms: usize,
}

impl Outcome {
    fn of(frame: &JudgedFrame, found: &[ScoredBox]) -> Self {
        let truth = frame.picture.aircraft;
        let hit = |candidate: &&ScoredBox| {
            truth.is_some_and(|truth| {
                let (a, b) = (candidate.pixel_box, truth.pixel_box);
                (a.cx_px - b.cx_px).abs() < 0.5 * b.width_px
                    && (a.cy_px - b.cy_px).abs() < 0.5 * b.height_px.max(8.0)
            })
        };
        let hits = found.iter().filter(hit).count();
        let visible = truth
            .filter(|truth| truth.visible)
            .map(|truth| truth.pixel_box);
        let error = visible.and_then(|b| {
            let a = found.iter().find(hit)?.pixel_box;
            Some([
                a.cx_px - b.cx_px,
                a.cy_px - b.cy_px,
                a.width_px - b.width_px,
                a.height_px - b.height_px,
            ])
        });
        Self {
            weather: frame.weather.clone(),
            visible,
            error,
            hits,
            false_alarms: found.len() - hits,
        }
    }
}

fn width_bins(visible: &[&Outcome]) -> Vec<WidthBin> {
    let mut low = 0.0;
    WIDTH_BINS_PX
        .iter()
        .map(|&high| {
            let inside = |outcome: &&&Outcome| {
                outcome
                    .visible
                    .is_some_and(|truth| low < truth.width_px && truth.width_px <= high)
            };
            let members: Vec<_> = visible.iter().filter(inside).collect();
            let errors: Vec<[f64; 4]> =
                members.iter().filter_map(|outcome| outcome.error).collect();
            let spread =
                |index: usize| Spread::of(errors.iter().map(|error| error[index]).collect());
            low = high;
            WidthBin {
                width_up_to_px: high.is_finite().then_some(high),
                visible: members.len(),
                recall: (!members.is_empty()).then(|| errors.len() as f64 / members.len() as f64),
                cx_px: spread(0),
                cy_px: spread(1),
                width_px: spread(2),
                height_px: spread(3),
            }
        })
        .collect()
}

/// All aircraft in a frame, best first: tiles, then a centred crop for each hit.
pub fn detect(
    network: &Network,
    tables: &mut GatherTables,
    frame: &TrainingPicture,
    threshold: f64,
) -> Vec<ScoredBox> {
    let mut candidates = Vec::new();
    for top in (0..frame.height_px).step_by(TILE_PX) {
        for left in (0..frame.width_px).step_by(TILE_PX) {
            candidates.extend(detect_in(network, tables, frame, [left, top], threshold));
        }
    }
    let candidates = without_doubles(candidates);
    let mut refined = Vec::new();
    for candidate in candidates {
        let start = |center: f64, length: usize| {
            let most = length.saturating_sub(TILE_PX) as f64;
            (center - TILE_PX as f64 / 2.0).round().clamp(0.0, most) as usize
        };
        let corner = [
            start(candidate.pixel_box.cx_px, frame.width_px),
            start(candidate.pixel_box.cy_px, frame.height_px),
        ];
        let again = detect_in(network, tables, frame, corner, threshold);
        refined.extend(again.into_iter().filter(|found| same(found, &candidate)));
    }
    without_doubles(refined)
}

fn detect_in(
    network: &Network,
    tables: &mut GatherTables,
    frame: &TrainingPicture,
    [left, top]: [usize; 2],
    threshold: f64,
) -> Vec<ScoredBox> {
    let side = TILE_PX;
    let mut pixels = vec![0.0; side * side * 3];
    let (width, height) = (
        side.min(frame.width_px - left),
        side.min(frame.height_px - top),
    );
    for y in 0..height {
        let line = &frame.rgb[((top + y) * frame.width_px + left) * 3..][..width * 3];
        for (out, &value) in pixels[y * side * 3..].iter_mut().zip(line) {
            *out = f32::from(value) / 255.0;
        }
    }
    let mut batch = PatchBatch::new(1, side, side);
    batch.fill(0, &pixels);
    let map = network.forward(&batch, tables);
    let cells: Vec<f32> = map
        .rows
        .into_data()
        .try_into_vec()
        .expect("the output holds floats");
    let moved = |found: ScoredBox| {
        let (cx_px, cy_px) = (
            found.pixel_box.cx_px + left as f64,
            found.pixel_box.cy_px + top as f64,
        );
        ScoredBox {
            pixel_box: PixelBox {
                cx_px,
                cy_px,
                ..found.pixel_box
            },
            ..found
        }
    };
    peaks(&cells, map.width, map.height, threshold)
        .into_iter()
        .map(moved)
        .collect()
}

fn same(a: &ScoredBox, b: &ScoredBox) -> bool {
    let reach = SAME_SHARE * a.pixel_box.width_px.max(b.pixel_box.width_px);
    (a.pixel_box.cx_px - b.pixel_box.cx_px).hypot(a.pixel_box.cy_px - b.pixel_box.cy_px) < reach
}

/// The best of each group of detections of the same aircraft, best first.
fn without_doubles(mut candidates: Vec<ScoredBox>) -> Vec<ScoredBox> {
    candidates.sort_by(|a, b| b.score.total_cmp(&a.score));
    let mut kept: Vec<ScoredBox> = Vec::new();
    for candidate in candidates {
        if !kept.iter().any(|better| same(better, &candidate)) {
            kept.push(candidate);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::targets::CropTruth;

    fn scored(cx_px: f64, score: f64) -> ScoredBox {
        ScoredBox {
            pixel_box: PixelBox {
                cx_px,
                cy_px: 30.0,
                width_px: 20.0,
                height_px: 7.0,
            },
            score,
        }
    }

    fn frame(visible: bool) -> JudgedFrame {
        let aircraft = Some(CropTruth {
            pixel_box: scored(50.0, 1.0).pixel_box,
            visible,
        });
        let picture = TrainingPicture {
            rgb: Vec::new(),
            width_px: 0,
            height_px: 0,
            aircraft,
            cover: None,
        };
        JudgedFrame {
            picture,
            weather: "clear".into(),
        }
    }

    #[test]
    fn a_close_detection_is_a_hit_and_a_far_one_a_false_alarm() {
        let outcome = Outcome::of(&frame(true), &[scored(50.5, 0.9), scored(80.0, 0.5)]);
        assert_eq!((outcome.hits, outcome.false_alarms), (1, 1));
        assert_eq!(outcome.error.unwrap()[0], 0.5);
    }

    #[test]
    fn finding_what_can_hardly_be_seen_is_no_false_alarm_and_missing_it_no_miss() {
        let outcome = Outcome::of(&frame(false), &[scored(50.5, 0.9)]);
        assert_eq!(
            (outcome.hits, outcome.false_alarms, outcome.visible),
            (1, 0, None)
        );
    }

    #[test]
    fn of_two_detections_of_one_aircraft_the_better_stays() {
        let kept = without_doubles(vec![
            scored(50.0, 0.6),
            scored(52.0, 0.8),
            scored(90.0, 0.3),
        ]);
        assert_eq!(kept, vec![scored(52.0, 0.8), scored(90.0, 0.3)]);
    }
}
