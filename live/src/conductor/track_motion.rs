//! Box motion, to move boxes between image times.

use std::collections::{BTreeMap, VecDeque};

use dataset::numbers::least_squares::NormalEquations;
use dataset::tables::pixel_box::PixelBox;
use dataset::tables::registrations::Shift;

/// Seconds of boxes that tell the motion, and the fewest boxes.
const SPAN_S: f64 = 1.0;
const MIN_BOXES: usize = 5;
/// A box is moved by at most this time, seconds: half a frame of the slowest camera whose motion is known.
const MAX_MOVED_S: f64 = 0.12;

/// Track positions in the last second.
#[derive(Debug, Default)]
pub(crate) struct TrackMotion(BTreeMap<u32, VecDeque<[f64; 3]>>);

impl TrackMotion {
    /// Takes the boxes of the next image. Tracks without boxes for a second are forgotten.
    pub(crate) fn take<'a>(
        &mut self,
        time_s: f64,
        boxes: impl Iterator<Item = (u32, &'a PixelBox)>,
    ) {
        for (track, seen) in boxes {
            let places = self.0.entry(track).or_default();
            places.push_back([time_s, seen.cx_px, seen.cy_px]);
        }
        self.0.retain(|_, places| {
            while places
                .front()
                .is_some_and(|place| place[0] < time_s - SPAN_S)
            {
                places.pop_front();
            }
            !places.is_empty()
        });
    }

    /// A track's motion over `seconds`, right and down, px; zero if unknown.
    pub(crate) fn moved_px(&self, track: u32, seconds: f64) -> [f64; 2] {
        let seconds = seconds.clamp(-MAX_MOVED_S, MAX_MOVED_S);
        self.px_s(track).map(|px_s| px_s * seconds)
    }

    /// A track's motion per second, right and down, px; zero if unknown.
    pub(crate) fn px_s(&self, track: u32) -> [f64; 2] {
        let Some(places) = self
            .0
            .get(&track)
            .filter(|places| places.len() >= MIN_BOXES)
        else {
            return [0.0; 2];
        };
        [1, 2].map(|axis| {
            let mut line = NormalEquations::new(2);
            for place in places {
                let since_s = place[0] - places[0][0];
                line.add(&[1.0, since_s], place[axis], 1.0);
            }
            line.solve_for().map_or(0.0, |[_, px_s]| px_s)
        })
    }
}

pub(crate) fn moved_box(seen: PixelBox, [right_px, down_px]: [f64; 2]) -> PixelBox {
    PixelBox {
        cx_px: seen.cx_px + right_px,
        cy_px: seen.cy_px + down_px,
        ..seen
    }
}

/// The shift to a view whose aircraft was moved.
pub(crate) fn moved_shift(shift: Shift, [right_px, down_px]: [f64; 2]) -> Shift {
    Shift {
        dx_px: shift.dx_px + right_px,
        dy_px: shift.dy_px + down_px,
        ..shift
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_steady_motion_is_carried_on_and_an_unknown_one_is_none() {
        let mut motion = TrackMotion::default();
        for tick in 0..60 {
            let time_s = f64::from(tick) / 30.0;
            let seen = PixelBox {
                cx_px: 100.0 + 30.0 * time_s,
                cy_px: 50.0 - 6.0 * time_s,
                width_px: 20.0,
                height_px: 8.0,
            };
            motion.take(time_s, [(7, &seen)].into_iter());
        }
        let [right_px, down_px] = motion.moved_px(7, 1.0 / 60.0);
        assert!((right_px - 0.5).abs() < 1e-9 && (down_px + 0.1).abs() < 1e-9);
        assert_eq!(motion.moved_px(8, 0.01), [0.0; 2]);
        motion.take(10.0, std::iter::empty());
        assert_eq!(motion.moved_px(7, 0.01), [0.0; 2]);
    }
}
