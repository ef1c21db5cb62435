//! Places where several tracks were seen again and again: lamps that are found now and then, so that none of their tracks lasts.

use super::standing::{MAX_MOVED_BY_CHANCE_PX, MAX_STILL_S, TimedBox};

/// Minimum number of boxes of other tracks at a lamp. Twice [`MAX_STILL_S`] pass from the first to the last.
const MIN_BOXES: usize = 5;

/// A view's boxes, by place.
pub(super) struct Places {
    /// Ascending columns.
    boxes: Vec<Placed>,
}

struct Placed {
    cx_px: f64,
    cy_px: f64,
    at_s: f64,
    track: usize,
}

impl Places {
    /// `tracks`: the boxes of each track, by its number.
    pub(super) fn of<'a>(tracks: impl Iterator<Item = &'a [TimedBox]>) -> Self {
        let placed = |(track, boxes): (usize, &'a [TimedBox])| {
            boxes.iter().map(move |(at_s, seen)| Placed {
                cx_px: seen.cx_px,
                cy_px: seen.cy_px,
                at_s: *at_s,
                track,
            })
        };
        let mut boxes: Vec<Placed> = tracks.enumerate().flat_map(placed).collect();
        boxes.sort_by(|a, b| a.cx_px.total_cmp(&b.cx_px));
        Self { boxes }
    }

    /// True if a track's boxes are mostly at other tracks' lamps: with two seconds between the images, it jumped between them.
    pub(super) fn is_from_lamp_to_lamp(&self, track: usize, boxes: &[TimedBox]) -> bool {
        let at_lamps = boxes.iter().filter(|(_, seen)| {
            let at = |px: f64| self.boxes.partition_point(|placed| placed.cx_px < px);
            let near = &self.boxes
                [at(seen.cx_px - MAX_MOVED_BY_CHANCE_PX)..at(seen.cx_px + MAX_MOVED_BY_CHANCE_PX)];
            let here = near.iter().filter(|placed| {
                let (right, down) = (placed.cx_px - seen.cx_px, placed.cy_px - seen.cy_px);
                placed.track != track && right.hypot(down) < MAX_MOVED_BY_CHANCE_PX
            });
            let times = here.fold((0, f64::INFINITY, f64::NEG_INFINITY), |times, placed| {
                let (count, first_s, last_s) = times;
                (count + 1, placed.at_s.min(first_s), placed.at_s.max(last_s))
            });
            let (count, first_s, last_s) = times;
            count >= MIN_BOXES && last_s - first_s >= 2.0 * MAX_STILL_S
        });
        2 * at_lamps.count() > boxes.len()
    }
}

#[cfg(test)]
mod tests {
    use dataset::tables::pixel_box::PixelBox;

    use super::*;

    fn seen(at_s: f64, cx_px: f64) -> TimedBox {
        let pixel_box = PixelBox {
            cx_px,
            cy_px: 1_010.0,
            width_px: 20.0,
            height_px: 6.0,
        };
        (at_s, pixel_box)
    }

    #[test]
    fn a_track_from_one_rare_lamp_to_the_next_is_no_aircraft_and_one_that_passes_a_lamp_is() {
        // Each lamp is found six times in five minutes, by a new track each time.
        let lamps = [331.0, 147.0, 78.0, 5.0];
        let rare = (0..6).flat_map(|time: u32| {
            lamps.map(|cx_px| {
                vec![seen(
                    50.0 * f64::from(time),
                    cx_px + 0.2 * f64::from(time % 3),
                )]
            })
        });
        let mut tracks: Vec<Vec<TimedBox>> = rare.collect();
        let hopping: Vec<TimedBox> = (0..)
            .zip(lamps)
            .map(|(number, cx_px)| seen(126.0 + 2.0 * f64::from(number), cx_px))
            .collect();
        let passing: Vec<TimedBox> = (0..20)
            .map(|number| {
                seen(
                    100.0 + 2.0 * f64::from(number),
                    400.0 - 23.0 * f64::from(number),
                )
            })
            .collect();
        // Far ahead, in pieces: it moves by three pixels a minute.
        let far = (0..60).map(|number| {
            let at_s = 5.0 * f64::from(number);
            vec![seen(at_s, 900.0 + 0.05 * at_s)]
        });
        tracks.extend(far);
        let first = tracks.len();
        tracks.extend([hopping, passing]);
        let places = Places::of(tracks.iter().map(Vec::as_slice));
        let goes = |track: usize| places.is_from_lamp_to_lamp(track, &tracks[track]);
        assert!(goes(first));
        assert!(!goes(first + 1));
        for far in first - 60..first {
            assert!(!goes(far), "{far}");
        }
    }
}
