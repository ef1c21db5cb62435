//! Images that repeat an earlier one although the aircraft moves.
//!
//! Equal images alone are no evidence: without an aircraft a noiseless image equals the previous one, and encoders leave out small changes.
//! The change that the aircraft's motion should make must be several times the measured one or, with seconds between the images, all images
//! around must have changed far more: haze moves too.

use dataset::numbers::spread::median_slope;
use dataset::tables::pixel_box::PixelBox;
use dataset::video::Luma;
use glam::DVec2;
use sight::fit::NOISE_LEVELS;

use super::{Look, median_or_zero};

/// Margin around the box, as a part of its sides and in pixels.
const AROUND_PART: f64 = 0.25;
const AROUND_PX: f64 = 4.0;
/// Step between compared rows.
const ROW_STEP: usize = 16;
/// Maximum distance between boxes of the same image in different windows: pixels, and a part of the width.
const MAX_EQUAL_PX: f64 = 2.0;
const MAX_EQUAL_PART: f64 = 0.03;
/// Minimum ratio of expected to measured change, and minimum expected change, grey levels.
pub(super) const MIN_RATIO: f64 = 3.0;
const MIN_EXPECTED_LEVELS: f64 = 2.0;
/// Maximum motion for which slopes hold, px.
const MAX_MOVED_PX: f64 = 1.5;
/// Number of ticks on either side that show the usual change around a box.
const NEAR_TICKS: usize = 10;
/// Minimum usual change, grey levels; maximum ratio of the judged image's change; a small ratio, and the maximum number of images around
/// with smaller ones.
const MIN_USUAL_LEVELS: f64 = 0.5;
const MAX_FROZEN_PART: f64 = 0.06;
const SMALL_PART: f64 = 0.2;
const MAX_SMALL_CHANGES: usize = 3;
/// Minimum whole-image change in new images, as a part of the usual one and in grey levels: rain, noise, clouds. An aircraft may pause at
/// a turn in its path.
const NEW_PART: f64 = 0.7;
const MIN_WHOLE_LEVELS: f64 = 0.1;
/// Encoders leave out small changes from one image to the next one soon after.
const MIN_GAP_S: f64 = 0.2;
/// Boxes before and after a run that tell how the aircraft moves, at most and at least.
const BOXES: usize = 6;
const MIN_BOXES: usize = 4;

/// Difference of two consecutive images.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Change {
    /// Around the box, grey levels, root mean square.
    pub(crate) levels: f64,
    pub(crate) whole_levels: f64,
    /// Means of the products of the slopes around the box, right and down, square levels per square pixel.
    pub(crate) slopes: [f64; 3],
}

impl Change {
    /// `None` if the box has too few pixels within the image.
    pub(crate) fn between(before: &Luma<'_>, now: &Luma<'_>, seen: PixelBox) -> Option<Self> {
        let clamped = |centre: f64, side: f64, end: usize| {
            let half = side * (0.5 + AROUND_PART) + AROUND_PX;
            let place = |at: f64| at.round().clamp(1.0, end as f64 - 1.0) as usize;
            place(centre - half)..place(centre + half)
        };
        let columns = clamped(seen.cx_px, seen.width_px, now.width_px);
        let rows = clamped(seen.cy_px, seen.height_px, now.height_px);
        let count = (columns.len() * rows.len()) as f64;
        if count < 16.0 {
            return None;
        }
        let mut squares = 0_u64;
        let mut slopes = [0_i64; 3];
        for row in rows {
            let [above, here, below] =
                [row - 1, row, (row + 1).min(now.height_px - 1)].map(|row| now.row(row));
            let earlier = before.row(row);
            for column in columns.clone() {
                squares += u64::from(here[column].abs_diff(earlier[column])).pow(2);
                let next = (column + 1).min(now.width_px - 1);
                let across = i64::from(here[next]) - i64::from(here[column - 1]);
                let down = i64::from(below[column]) - i64::from(above[column]);
                slopes[0] += across * across;
                slopes[1] += across * down;
                slopes[2] += down * down;
            }
        }
        Some(Self {
            levels: (squares as f64 / count).sqrt(),
            whole_levels: whole_levels(before, now),
            slopes: slopes.map(|sum| sum as f64 / count / 4.0),
        })
    }

    fn is_equal(&self) -> bool {
        self.levels <= NOISE_LEVELS && self.whole_levels <= NOISE_LEVELS
    }

    /// Expected change by motion and growth, grey levels, root mean square.
    fn expected_levels(&self, moved_px: DVec2, grown: f64, seen: &PixelBox) -> f64 {
        let moved = moved_px.clamp_length_max(MAX_MOVED_PX);
        // A growth moves the edges: the root mean square over a side is its end / sqrt(3).
        let grown = DVec2::new(seen.width_px, seen.height_px) * grown / 2.0 / 3.0_f64.sqrt();
        let grown = grown.clamp_length_max(MAX_MOVED_PX);
        let [xx, xy, yy] = self.slopes;
        let by_motion =
            xx * moved.x * moved.x + 2.0 * xy * moved.x * moved.y + yy * moved.y * moved.y;
        let by_growth = xx * grown.x * grown.x + yy * grown.y * grown.y;
        (by_motion + by_growth).max(0.0).sqrt()
    }
}

fn whole_levels(before: &Luma<'_>, now: &Luma<'_>) -> f64 {
    let (mut squares, mut count) = (0_u64, 0);
    for row in (0..now.height_px).step_by(ROW_STEP) {
        let pairs = now.row(row).iter().zip(before.row(row));
        let of_row: u32 = pairs.map(|(a, b)| u32::from(a.abs_diff(*b)).pow(2)).sum();
        squares += u64::from(of_row);
        count += now.width_px;
    }
    (squares as f64 / f64::from(u32::try_from(count.max(1)).unwrap_or(u32::MAX))).sqrt()
}

/// For each look, whether its image repeats the one before.
pub(super) fn frozen(looks: &[Look], confirmed: &[Option<PixelBox>]) -> Vec<bool> {
    let stays = |tick: usize| {
        let box_at = |tick: usize| confirmed.get(tick).copied().flatten();
        let before = tick.checked_sub(1).and_then(box_at);
        let boxes = before.zip(box_at(tick));
        boxes.is_some_and(|(before, now)| {
            let centre = |seen: PixelBox| DVec2::new(seen.cx_px, seen.cy_px);
            centre(before).distance(centre(now)) <= MAX_EQUAL_PX + MAX_EQUAL_PART * now.width_px
        })
    };
    let equal: Vec<bool> = (0..looks.len())
        .map(|tick| {
            let is_equal = looks[tick].change.is_some_and(|change| change.is_equal());
            is_equal && stays(tick) && !changes_elsewhere(tick, looks)
        })
        .collect();
    let mut frozen = vec![false; looks.len()];
    let mut start = 0;
    while start < looks.len() {
        let length = equal[start..].iter().take_while(|equal| **equal).count();
        let run = start..start + length;
        if !run.is_empty() && run.start > 0 && moves(run.clone(), looks, confirmed, &equal) {
            frozen[run.clone()].fill(true);
        }
        start += length.max(1);
    }
    for tick in 1..looks.len() {
        frozen[tick] |= equal[tick] && changes_least(tick, looks);
    }
    frozen
}

/// Change of the images around a tick, without its own.
fn changes_around(tick: usize, looks: &[Look], levels: fn(&Change) -> f64) -> Vec<f64> {
    let around = tick.saturating_sub(NEAR_TICKS)..(tick + NEAR_TICKS + 1).min(looks.len());
    (around.filter(|&other| other != tick))
        .filter_map(|other| looks[other].change.as_ref().map(levels))
        .collect()
}

/// True if an image changed as a whole as others around it do.
fn changes_elsewhere(tick: usize, looks: &[Look]) -> bool {
    let others = changes_around(tick, looks, |change| change.whole_levels);
    let usual = median_or_zero(others.into_iter());
    looks[tick]
        .change
        .is_some_and(|own| usual >= MIN_WHOLE_LEVELS && own.whole_levels >= NEW_PART * usual)
}

/// True if an image changed far less than nearly all others around it.
fn changes_least(tick: usize, looks: &[Look]) -> bool {
    let Some(own) = looks[tick].change else {
        return false;
    };
    let others = changes_around(tick, looks, |change| change.levels);
    let usual = median_or_zero(others.iter().copied());
    let equal = others
        .iter()
        .filter(|levels| **levels <= SMALL_PART * usual);
    others.len() >= NEAR_TICKS
        && looks[tick].time_s - looks[tick - 1].time_s >= MIN_GAP_S
        && usual >= MIN_USUAL_LEVELS
        && own.levels <= MAX_FROZEN_PART * usual
        && equal.count() <= MAX_SMALL_CHANGES
}

/// True if the aircraft moves too much for a run of equal images.
fn moves(
    run: std::ops::Range<usize>,
    looks: &[Look],
    confirmed: &[Option<PixelBox>],
    equal: &[bool],
) -> bool {
    let live = |tick: &usize| !equal[*tick] && confirmed[*tick].is_some();
    let before = (0..run.start).rev().filter(live).take(BOXES);
    let after = (run.end..looks.len()).filter(live).take(BOXES);
    let ticks: Vec<usize> = before.chain(after).collect();
    if ticks.len() < MIN_BOXES {
        return false;
    }
    let boxes: Vec<(f64, PixelBox)> = (ticks.into_iter())
        .filter_map(|tick| Some((looks[tick].time_s, confirmed[tick]?)))
        .collect();
    let rate = |value: fn(&PixelBox) -> f64| {
        let values = boxes.iter().map(|(time_s, seen)| (*time_s, value(seen)));
        median_slope(values).unwrap_or_default()
    };
    let moved_px_s = DVec2::new(rate(|seen| seen.cx_px), rate(|seen| seen.cy_px));
    let grown_s = rate(|seen| seen.width_px.max(1.0).ln());
    let seconds = looks[run.end - 1].time_s - looks[run.start - 1].time_s;
    let (mut levels, mut expected) = (0.0_f64, 0.0_f64);
    for tick in run {
        let (Some(change), Some(seen)) = (looks[tick].change, &confirmed[tick]) else {
            continue;
        };
        levels = levels.max(change.levels);
        let whole = change.expected_levels(moved_px_s * seconds, grown_s * seconds, seen);
        expected = expected.max(whole);
    }
    expected >= MIN_EXPECTED_LEVELS && expected >= MIN_RATIO * levels
}
