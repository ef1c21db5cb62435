//! The boxes that a track remembers while it is followed.
//!
//! A lamp is found for hours and an approach for ten minutes at most, so boxes are forgotten; a still track forgets sooner, as its place
//! does not change.

use super::FoundBox;
use super::standing::{MAX_STILL_S, TimedBox, has_stood_still, lasted_s, place_if_still};

/// Time span of the remembered boxes, s. When it is reached, the older half is forgotten.
const KEPT_S: f64 = 600.0;
/// Tracks that stand still are looked for so often, seconds, by as many clear boxes per second.
const JUDGED_EACH_S: f64 = 1.0;
const JUDGED_BOXES_PER_S: f64 = 5.0;

/// A track's remembered boxes, and conclusions from them.
#[derive(Debug, Default)]
pub(super) struct History {
    boxes: Vec<TimedBox>,
    /// Some of the clear ones, whose sizes can be relied on.
    clear: Vec<TimedBox>,
    clear_s: [Option<f64>; 3],
    confirmed_s: Option<f64>,
    is_still: bool,
    judged_s: f64,
}

impl History {
    pub(super) fn push(&mut self, now_s: f64, seen: &FoundBox) {
        self.boxes.push((now_s, seen.pixel_box));
        if !seen.is_faint {
            let [_, second, third] = self.clear_s;
            self.clear_s = [second, third, Some(now_s)];
            let last_s = self.clear.last().map(|(at_s, _)| *at_s);
            if last_s.is_none_or(|last_s| now_s - last_s >= 1.0 / JUDGED_BOXES_PER_S) {
                self.clear.push((now_s, seen.pixel_box));
            }
        }
        if now_s - self.judged_s >= JUDGED_EACH_S {
            self.judged_s = now_s;
            self.judge();
        }
    }

    fn judge(&mut self) {
        self.is_still =
            lasted_s(&self.clear) >= MAX_STILL_S && place_if_still(&self.clear).is_some();
        let still_s = 4.0 * MAX_STILL_S;
        let stays = has_stood_still(&self.boxes, still_s);
        for boxes in [&mut self.boxes, &mut self.clear] {
            let kept_s = if stays { still_s } else { KEPT_S };
            if lasted_s(boxes) >= kept_s {
                let last_s = boxes.last().map_or(0.0, |(at_s, _)| *at_s);
                let old = boxes.partition_point(|(at_s, _)| *at_s < last_s - kept_s / 2.0);
                boxes.drain(..old);
            }
        }
    }

    /// The last clear boxes, as many as `hits`, confirm it.
    pub(super) fn confirm(&mut self, hits: u32) {
        let known = self.clear_s.iter().rev().take(hits as usize).flatten();
        let first_s = known.last().copied();
        self.confirmed_s = self.confirmed_s.or(first_s);
    }

    /// Remembered boxes, by time.
    pub(super) fn boxes(&self) -> &[TimedBox] {
        &self.boxes
    }

    /// Time of the first of the clear boxes that confirmed it.
    pub(super) fn confirmed_s(&self) -> Option<f64> {
        self.confirmed_s
    }

    pub(super) fn is_confirmed(&self) -> bool {
        self.confirmed_s.is_some()
    }

    pub(super) fn was_clear(&self) -> bool {
        self.clear_s[2].is_some()
    }

    /// True if it has stood still for a minute, also after a longer flight.
    pub(super) fn is_still(&self) -> bool {
        self.is_still
    }

    /// Time from the first confirming box to the last clear one, s; negative if the track is not confirmed.
    pub(super) fn clear_for_s(&self) -> f64 {
        match (self.confirmed_s, self.clear_s[2]) {
            (Some(first_s), Some(last_s)) => last_s - first_s,
            _ => -1.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use dataset::tables::pixel_box::PixelBox;

    use super::*;

    fn seen(cx_px: f64) -> FoundBox {
        let pixel_box = PixelBox {
            cx_px,
            cy_px: 500.0,
            width_px: 30.0,
            height_px: 10.0,
        };
        FoundBox {
            pixel_box,
            is_faint: false,
        }
    }

    #[test]
    fn a_lamp_that_is_found_for_an_hour_takes_the_memory_of_some_minutes_and_counts_for_one_only() {
        let mut history = History::default();
        for image in 0..36_000 {
            let now_s = f64::from(image) / 10.0;
            history.push(now_s, &seen(600.0 + 0.3 * f64::from(image % 3)));
            assert!(history.boxes().len() <= 2_420, "{}", history.boxes().len());
            if !(60.0..62.0).contains(&now_s) {
                assert_eq!(history.is_still(), now_s > 61.0, "{now_s} s");
            }
        }
    }

    #[test]
    fn the_boxes_of_an_approach_are_remembered_to_its_end() {
        let mut history = History::default();
        for image in 0..5_900 {
            history.push(
                f64::from(image) / 10.0,
                &seen(600.0 + 0.2 * f64::from(image)),
            );
        }
        assert_eq!(history.boxes().len(), 5_900);
        assert!(!history.is_still());
    }
}
