//! Images that repeat an earlier one although the aircraft moves.
//!
//! Equal images alone say nothing: without an aircraft a noiseless image equals the one before, and an encoder leaves out small changes.
//! What the aircraft's motion before and after would have changed must be several times what it did change, or, with seconds between the
//! images, all others around must have changed far more: haze moves too.

use dataset::tables::pixel_box::PixelBox;
use dataset::video::Luma;
use glam::DVec2;

use super::Look;

/// Around a box, as a part of its sides and in pixels.
const AROUND_PART: f64 = 0.25;
const AROUND_PX: f64 = 4.0;
/// Rows that are compared in the whole image: one of so many.
const ROW_STEP: usize = 16;
/// Images that differ by more around a box, or in the whole image, are not equal: grey levels, root mean square.
const MAX_EQUAL_LEVELS: f64 = 1.5;
/// The same image in other windows gives the same box, to within this: pixels, and a part of its width. Another one is of something else.
const MAX_EQUAL_PX: f64 = 2.0;
const MAX_EQUAL_PART: f64 = 0.03;
/// Motion must have changed this much more, and at least so many levels.
const MIN_RATIO: f64 = 3.0;
const MIN_EXPECTED_LEVELS: f64 = 2.0;
/// Slopes hold for so many pixels.
const MAX_MOVED_PX: f64 = 1.5;
/// Ticks on either side that tell by how much images around a box usually change.
const NEAR: usize = 10;
/// They must change by so many levels, the image in question by at most this part, and at most so many others by less than this part.
const MIN_USUAL_LEVELS: f64 = 0.5;
const MIN_PART: f64 = 0.06;
const SMALL_PART: f64 = 0.2;
const MAX_SMALL: usize = 3;
/// An image that changed by this part of what others around change as a whole is a new one, if that is by so many levels: rain, noise,
/// clouds. An aircraft may pause at a turn of its path.
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
    /// In the whole image.
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
        self.levels <= MAX_EQUAL_LEVELS && self.whole_levels <= MAX_EQUAL_LEVELS
    }

    /// Change by a motion and a growth of a box, grey levels, root mean square.
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

/// True if an image changed as a whole as others around it do.
fn changes_elsewhere(tick: usize, looks: &[Look]) -> bool {
    let whole = |tick: usize| looks[tick].change.map(|change| change.whole_levels);
    let around = tick.saturating_sub(NEAR)..(tick + NEAR + 1).min(looks.len());
    let mut others: Vec<f64> = (around.filter(|&other| other != tick))
        .filter_map(whole)
        .collect();
    others.sort_by(f64::total_cmp);
    let (Some(own), Some(&usual)) = (whole(tick), others.get(others.len() / 2)) else {
        return false;
    };
    usual >= MIN_WHOLE_LEVELS && own >= NEW_PART * usual
}

/// True if an image changed far less than nearly all others around it.
fn changes_least(tick: usize, looks: &[Look]) -> bool {
    let levels = |tick: usize| looks[tick].change.map(|change| change.levels);
    let around = tick.saturating_sub(NEAR)..(tick + NEAR + 1).min(looks.len());
    let mut others: Vec<f64> = (around.filter(|&other| other != tick))
        .filter_map(levels)
        .collect();
    others.sort_by(f64::total_cmp);
    let (Some(own), Some(&usual)) = (levels(tick), others.get(others.len() / 2)) else {
        return false;
    };
    let equal = others
        .iter()
        .filter(|levels| **levels <= SMALL_PART * usual);
    others.len() >= NEAR
        && looks[tick].time_s - looks[tick - 1].time_s >= MIN_GAP_S
        && usual >= MIN_USUAL_LEVELS
        && own <= MIN_PART * usual
        && equal.count() <= MAX_SMALL
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
        slope(boxes.iter().map(|(time_s, seen)| (*time_s, value(seen))))
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

/// Slope of values over time: the median over pairs (Theil and Sen).
pub(super) fn slope(values: impl Iterator<Item = (f64, f64)>) -> f64 {
    let values: Vec<_> = values.collect();
    let pairs = (0..values.len()).flat_map(|i| (0..i).map(move |k| (i, k)));
    let mut slopes: Vec<f64> = pairs
        .map(|(i, k)| (values[i].1 - values[k].1) / (values[i].0 - values[k].0))
        .filter(|slope| slope.is_finite())
        .collect();
    slopes.sort_by(f64::total_cmp);
    slopes.get(slopes.len() / 2).copied().unwrap_or_default()
}
