//! Decides from a track's boxes whether it stands still, as lamps and masts do, and whether a box has left the place.
//!
//! A thing is still if its place stays the same within about a pixel for a minute, whatever its width does: in rain the boxes of a lamp
//! grow and shrink by half. Larger things may also stay within a part of their length, unless they grow. An aircraft always moves more: a
//! flight straight at a mast on the 3 degree glide path moves least. It falls by
//!
//! ```text
//! (b tan 3 deg + h) / d^2 - (1 - k) / 2R      radians per metre flown
//! ```
//!
//! for a mast of height `h`, `b` beyond the target, at the distance `d`; the second term is the curvature of the Earth and of light. With
//! the rig `wide-baseline` (b 1,500 m, h 10 m, focal length 10,973 px) at 13 NM, that is 1.9 px in the 40 s between the middles of the
//! first and the last third of a minute, at a ground speed of 60 m/s, and 2.8 px at 82 m/s; at 10 NM it is 4.6 and 6.7 px. Flights that
//! land on the runway beside the masts move by 13 px (at 60 m/s) across the image, level flights by 35 px down.

use std::f64::consts::FRAC_PI_2;
use std::ops::Range;

use dataset::numbers::spread::Spread;
use dataset::tables::pixel_box::PixelBox;
use sight::sight::CONTRADICTS_SD;

/// A box with its time, seconds.
pub(super) type TimedBox = (f64, PixelBox);

/// Minimum duration of a still track that is no arriving aircraft, s.
pub(super) const MAX_STILL_S: f64 = 60.0;
/// Minimum growth between the middles of the first and the last third. An aircraft at 13 NM grows by a tenth in 40 s...
const MIN_GROWTH: f64 = 0.05;
/// ... and does so beyond chance, in standard errors: the widths of a rarely found lamp differ by half...
const SURE_GROWTH: f64 = 2.0;
/// ... and in a shorter time too little to be measured, seconds...
pub(super) const GROWTH_SHOWS_S: f64 = 20.0;
/// Length ratio of boxes beside each other that may be one thing.
const ALIKE: Range<f64> = 0.8..1.25;
/// Minimum motion across the image, in box lengths.
const MIN_MOVED_LENGTHS: f64 = 0.25;
/// Minimum distance between the medians of the first and the last third, px: half the least motion of aircraft...
const MIN_MOVED_PX: f64 = 1.0;
/// ... or as large as this, if chance explains it, which leaves a fifth of that motion.
pub(super) const MAX_MOVED_BY_CHANCE_PX: f64 = 1.5;
/// Minimum number of boxes at a place...
const MIN_BOXES_OF_A_PLACE: usize = 5;
/// ... over this part of [`GROWTH_SHOWS_S`].
const MIN_PLACE_PART: f64 = 0.75;
/// Minimum standard deviation of lamp box centres, px, because a few boxes may agree by chance.
const MIN_CENTRE_DEVIATION_PX: f64 = 0.3;

/// The time from the first to the last box.
pub(super) fn lasted_s(boxes: &[TimedBox]) -> f64 {
    match (boxes.first(), boxes.last()) {
        (Some((first_s, _)), Some((last_s, _))) => last_s - first_s,
        _ => 0.0,
    }
}

/// True if a track was seen for at least `seconds` and has hardly moved, measured by its length. Growth is not checked, because the sizes
/// of faint boxes are unreliable. Boxes by time.
pub(super) fn has_stood_still(boxes: &[TimedBox], seconds: f64) -> bool {
    lasted_s(boxes) >= seconds && !has_moved(&ends(boxes))
}

/// True for objects such as masts, whose boxes mostly stood still for a minute, also after a hop: with two seconds between the images, a
/// young track may hop along a row of lamps. A rarely found object has several tracks at its place. Boxes by time.
pub(super) fn stands_still(boxes: &[TimedBox]) -> bool {
    let is_long = |boxes: &[TimedBox]| lasted_s(boxes) >= MAX_STILL_S;
    let still = || {
        let stays = between_hops(boxes).into_iter();
        let long = stays.filter(|stay| is_long(stay) && keeps_its_place(stay));
        long.map(<[TimedBox]>::len).sum::<usize>()
    };
    // An aircraft that stops after its landing, or whose camera repeats an image, was elsewhere for most of the time.
    is_long(boxes) && (place_if_still(boxes).is_some() || 2 * still() > boxes.len())
}

/// A place at which a track stayed for some images.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stay {
    place: Middle,
    lasted_s: f64,
}

/// Places at which a track stayed. Boxes by time.
pub(super) fn stays(boxes: &[TimedBox]) -> impl Iterator<Item = Stay> {
    between_hops(boxes)
        .into_iter()
        .filter(|stay| stay.len() >= MIN_BOXES_OF_A_PLACE && keeps_its_place(stay))
        .map(|stay| Stay {
            place: Middle::of(stay),
            lasted_s: lasted_s(stay),
        })
}

/// True if a track was mostly at places where tracks stayed for a minute: it went from lamp to lamp.
pub(super) fn is_mostly_at(stays: &[Stay], boxes: &[TimedBox]) -> bool {
    let is_at_one = |(_, seen): &&TimedBox| {
        let is_here = |stay: &&Stay| stay.place.distance_px(seen) < MAX_MOVED_BY_CHANCE_PX;
        let here = stays.iter().filter(is_here);
        here.map(|stay| stay.lasted_s).sum::<f64>() >= MAX_STILL_S
    };
    2 * boxes.iter().filter(is_at_one).count() > boxes.len()
}

/// Splits a track at its hops. A single distant box is no hop.
fn between_hops(boxes: &[TimedBox]) -> Vec<&[TimedBox]> {
    let mut stays = Vec::new();
    let mut begin = 0;
    for at in 1..boxes.len() {
        let recent = at.saturating_sub(MIN_BOXES_OF_A_PLACE).max(begin);
        let place = Middle::of(&boxes[recent..at]);
        let is_off = |(_, seen): &TimedBox| place.distance_px(seen) > 2.0 * MAX_MOVED_BY_CHANCE_PX;
        if is_off(&boxes[at]) && boxes.get(at + 1).is_none_or(is_off) {
            stays.push(&boxes[begin..at]);
            begin = at;
        }
    }
    stays.push(&boxes[begin..]);
    stays
}

/// The mean box, if the track stayed at one place, or neither moved nor grew. Boxes by time.
pub(super) fn place_if_still(boxes: &[TimedBox]) -> Option<PixelBox> {
    if boxes.is_empty() {
        return None;
    }
    let [before, after] = ends(boxes);
    let growth_px = (after.width_px - before.width_px).abs();
    let has_grown = lasted_s(boxes) >= GROWTH_SHOWS_S
        && growth_px >= MIN_GROWTH * before.width_px
        && growth_px >= SURE_GROWTH * growth_error_px(boxes);
    let is_still = !has_grown && !has_moved(&[before, after]);
    (is_still || keeps_its_place(boxes)).then(|| mean(boxes))
}

/// True if two tracks may show the same thing: mean boxes at the same place, whatever their widths, or close to each other and alike.
pub(super) fn is_same_thing(one: &PixelBox, other: &PixelBox) -> bool {
    let ratio = other.width_px / one.width_px.max(1.0);
    let apart_px = distance_px(one, other);
    apart_px < MAX_MOVED_BY_CHANCE_PX || apart_px < moved_px(one) && ALIKE.contains(&ratio)
}

/// True if a box is off a track that has just stood still for a while. Still things have no speed, so the filter, which
/// expects manoeuvres, would let a track hop along the edges of clouds.
pub(super) fn hops(boxes: &[TimedBox], to: &PixelBox) -> bool {
    let last_s = boxes.last().map_or(0.0, |(at_s, _)| *at_s);
    let recent = &boxes[boxes.partition_point(|(at_s, _)| *at_s < last_s - GROWTH_SHOWS_S)..];
    if recent.len() < MIN_BOXES_OF_A_PLACE || lasted_s(recent) < MIN_PLACE_PART * GROWTH_SHOWS_S {
        return false;
    }
    let [_, place] = Middle::of_thirds(recent);
    // Both boxes may be off by chance.
    let hop_px = 2.0 * MAX_MOVED_BY_CHANCE_PX.max(CONTRADICTS_SD * place.deviation_px);
    place.distance_px(to) > hop_px && keeps_its_place(recent)
}

/// True if the place is the same in the first and the last third, within about a pixel.
fn keeps_its_place(boxes: &[TimedBox]) -> bool {
    let [before, after] = Middle::of_thirds(boxes);
    let deviation_px = before.deviation_px.max(after.deviation_px);
    // Medians of normal errors scatter by that much more than means.
    let error = FRAC_PI_2.sqrt() * (1.0 / before.boxes + 1.0 / after.boxes).sqrt();
    let chance_px = CONTRADICTS_SD * error * deviation_px.max(MIN_CENTRE_DEVIATION_PX);
    (after.cx_px - before.cx_px).hypot(after.cy_px - before.cy_px)
        < chance_px.clamp(MIN_MOVED_PX, MAX_MOVED_BY_CHANCE_PX)
}

#[derive(Debug, Clone, Copy)]
struct Middle {
    cx_px: f64,
    cy_px: f64,
    /// Robust standard deviation of the centres, the larger one of both directions.
    deviation_px: f64,
    boxes: f64,
}

impl Middle {
    /// Medians of the first and the last third.
    fn of_thirds(boxes: &[TimedBox]) -> [Self; 2] {
        thirds(boxes).map(Self::of)
    }

    fn of(boxes: &[TimedBox]) -> Self {
        let axes: [fn(&PixelBox) -> f64; 2] = [|seen| seen.cx_px, |seen| seen.cy_px];
        let [right, down] = axes.map(|centre| {
            let centres = boxes.iter().map(|(_, seen)| centre(seen)).collect();
            Spread::of(centres).map_or([0.0; 2], |spread| [spread.median, spread.deviation])
        });
        Self {
            cx_px: right[0],
            cy_px: down[0],
            deviation_px: right[1].max(down[1]),
            boxes: boxes.len().max(1) as f64,
        }
    }

    fn distance_px(&self, seen: &PixelBox) -> f64 {
        (seen.cx_px - self.cx_px).hypot(seen.cy_px - self.cy_px)
    }
}

/// Boxes of the first and the last third of the time.
fn thirds(boxes: &[TimedBox]) -> [&[TimedBox]; 2] {
    let third_s = lasted_s(boxes) / 3.0;
    let [first_s, last_s] =
        [boxes.first(), boxes.last()].map(|at| at.map_or(0.0, |(at_s, _)| *at_s));
    let end = boxes.partition_point(|(at_s, _)| *at_s <= first_s + third_s);
    let begin = boxes.partition_point(|(at_s, _)| *at_s < last_s - third_s);
    [&boxes[..end], &boxes[begin..]]
}

/// Mean boxes of the first and the last third.
fn ends(boxes: &[TimedBox]) -> [PixelBox; 2] {
    thirds(boxes).map(mean)
}

/// Standard error of the difference between the thirds' mean widths.
fn growth_error_px(boxes: &[TimedBox]) -> f64 {
    let middle_px = mean(boxes).width_px;
    let squares = boxes
        .iter()
        .map(|(_, seen)| (seen.width_px - middle_px).powi(2));
    let count = boxes.len() as f64;
    let variance = squares.sum::<f64>() / count;
    (variance * 2.0 / (count / 3.0)).sqrt()
}

fn has_moved([before, after]: &[PixelBox; 2]) -> bool {
    distance_px(before, after) >= moved_px(before)
}

fn distance_px(a: &PixelBox, b: &PixelBox) -> f64 {
    (a.cx_px - b.cx_px).hypot(a.cy_px - b.cy_px)
}

/// Minimum movement that counts as moved, px.
fn moved_px(of: &PixelBox) -> f64 {
    MIN_MOVED_LENGTHS * of.width_px
}

fn mean(boxes: &[TimedBox]) -> PixelBox {
    let mut sum = [0.0; 4];
    for (_, seen) in boxes {
        let numbers = [seen.cx_px, seen.cy_px, seen.width_px, seen.height_px];
        sum.iter_mut()
            .zip(numbers)
            .for_each(|(sum, number)| *sum += number);
    }
    let count = boxes.len() as f64;
    let [cx_px, cy_px, width_px, height_px] = sum.map(|sum| sum / count);
    PixelBox {
        cx_px,
        cy_px,
        width_px,
        height_px,
    }
}
