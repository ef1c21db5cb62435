//! Camera condition from the images up to now, without waiting for the flight's end.
//!
//! Input: a view's looks in their order, with the box that counts. Output: a state at once. The usual direction is that of the first
//! images; an image taken just after a move counts as shaking until enough images agree. Memory does not grow.

use std::collections::VecDeque;

use dataset::numbers::spread::median_slope;
use dataset::tables::health::HealthState;
use dataset::tables::pixel_box::PixelBox;
use sight::ground::Motion;
use sight::watched::Measured;

use super::frozen::MIN_RATIO;
use super::{AROUND_S, AROUND_TICKS, Look, direction_at, known, median, median_or_zero, off_from};

/// Images that differ by more are not equal, grey levels, root mean square: gusts move a faint aircraft to and fro by little more.
const MAX_EQUAL_LEVELS: f64 = 0.3;
/// Time spans that show an aircraft's motion, s.
const MOVED_IN_S: [f64; 3] = [1.0, 3.0, 10.0];
/// Time between remembered boxes, s.
const BOX_EACH_S: f64 = 0.2;
/// Boxes that give its motion, over at least this part of the time.
const MIN_BOXES: usize = 4;
const MIN_SPAN_PART: f64 = 0.7;
/// Minimum expected motion, px.
const MIN_MOVED_PX: f64 = 3.0;

/// Judges consecutive images.
#[derive(Debug, Default)]
pub(super) struct LiveHealth {
    usual: Usual,
    /// Looks that decide about the direction of the next one.
    recent: Vec<Look>,
    last: Option<HealthState>,
    motion: ExpectedMotion,
}

impl LiveHealth {
    /// The state at an image. `counted`: its box that counts.
    pub(super) fn next(&mut self, look: &Look, counted: Option<PixelBox>) -> HealthState {
        let direction = self.direction(look);
        if self.motion.repeats(look, counted) {
            HealthState::Frozen
        } else {
            direction
        }
    }

    fn direction(&mut self, look: &Look) -> HealthState {
        self.usual.take(look);
        self.recent.push(*look);
        let many = self.recent.len();
        let is_old = |(index, old): (usize, &Look)| {
            many - 1 - index > AROUND_TICKS && look.time_s - old.time_s > AROUND_S
        };
        let old = self.recent.iter().enumerate().take_while(|at| is_old(*at));
        let old = old.count();
        self.recent.drain(..old);
        let usual = self.usual.direction;
        let off: Vec<Option<Measured>> = (self.recent.iter())
            .map(|look| Some(off_from(look.turn?, usual?)))
            .collect();
        let measured = direction_at(self.recent.len() - 1, &self.recent, &off);
        known(measured, &mut self.last)
    }
}

/// Usual direction, from the first images.
#[derive(Debug, Default)]
struct Usual {
    first: Vec<Motion>,
    since_s: f64,
    is_final: bool,
    direction: Option<Motion>,
}

impl Usual {
    fn take(&mut self, look: &Look) {
        let Some(measured) = look.turn.filter(|_| !self.is_final) else {
            return;
        };
        if self.first.is_empty() {
            self.since_s = look.time_s;
        }
        self.first.push(measured.turn);
        let shift_px = median(self.first.iter().map(|turn| turn.shift_px));
        let rolls = self.first.iter().map(|turn| turn.roll_rad);
        self.direction = Some(Motion {
            shift_px,
            roll_rad: median_or_zero(rolls),
            ..Motion::default()
        });
        if self.first.len() > 2 * AROUND_TICKS && look.time_s - self.since_s >= AROUND_S {
            self.is_final = true;
            self.first = Vec::new();
        }
    }
}

/// Expected image motion.
#[derive(Debug, Default)]
struct ExpectedMotion {
    boxes: VecDeque<(f64, PixelBox)>,
    /// Time of the image that the following ones equal, and their number.
    equal: Option<(f64, u32)>,
    last: Option<(f64, Option<PixelBox>)>,
}

impl ExpectedMotion {
    /// True if the images have been equal while an aircraft should have moved, and its box has not.
    fn repeats(&mut self, look: &Look, counted: Option<PixelBox>) -> bool {
        let now_s = look.time_s;
        let is_equal = look.change.is_some_and(|change| {
            change.levels <= MAX_EQUAL_LEVELS && change.whole_levels <= MAX_EQUAL_LEVELS
        });
        self.equal = match (self.last, self.equal) {
            (Some((last_s, Some(_))), None) if is_equal && counted.is_some() => Some((last_s, 1)),
            (_, Some((since_s, images))) if is_equal && counted.is_some() => {
                Some((since_s, images + 1))
            }
            _ => None,
        };
        let repeats = counted.is_some_and(|seen| self.should_have_moved(now_s, &seen));
        if let Some(seen) = counted {
            let newest = self.boxes.back();
            if newest.is_none_or(|(at_s, _)| now_s - at_s >= BOX_EACH_S) {
                self.boxes.push_back((now_s, seen));
            }
        }
        while (self.boxes.front()).is_some_and(|(at_s, _)| now_s - at_s > 2.0 * MOVED_IN_S[2]) {
            self.boxes.pop_front();
        }
        self.last = Some((now_s, counted));
        repeats
    }

    fn should_have_moved(&self, now_s: f64, seen: &PixelBox) -> bool {
        let Some((since_s, _)) = self.equal.filter(|(_, images)| *images >= 2) else {
            return false;
        };
        MOVED_IN_S.iter().any(|&seconds| {
            now_s - since_s >= seconds
                && self
                    .moved_px(now_s, seconds, seen)
                    .is_some_and(|[expected_px, moved_px]| {
                        expected_px >= MIN_MOVED_PX && MIN_RATIO * moved_px < expected_px
                    })
        })
    }

    /// The motion that is expected in the last seconds by the boxes before, and the one that a box shows, pixels.
    fn moved_px(&self, now_s: f64, seconds: f64, seen: &PixelBox) -> Option<[f64; 2]> {
        let start_s = now_s - seconds;
        let before: Vec<_> = (self.boxes.iter())
            .filter(|(at_s, _)| (start_s - seconds..=start_s).contains(at_s))
            .collect();
        let (first, last) = (before.first()?, before.last()?);
        if before.len() < MIN_BOXES || last.0 - first.0 < MIN_SPAN_PART * seconds {
            return None;
        }
        let rate = |value: fn(&PixelBox) -> f64| {
            let values = before.iter().map(|(at_s, seen)| (*at_s, value(seen)));
            median_slope(values).unwrap_or_default()
        };
        let moved = |right: f64, down: f64, wider: f64| right.hypot(down).hypot(wider / 2.0);
        let expected_px_s = moved(
            rate(|seen| seen.cx_px),
            rate(|seen| seen.cy_px),
            rate(|seen| seen.width_px),
        );
        let moved_px = moved(
            seen.cx_px - last.1.cx_px,
            seen.cy_px - last.1.cy_px,
            seen.width_px - last.1.width_px,
        );
        Some([expected_px_s * (now_s - last.0), moved_px])
    }
}

#[cfg(test)]
mod tests;
