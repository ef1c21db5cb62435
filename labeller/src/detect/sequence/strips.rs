//! Spreads the searches of whole images over several images, a strip of rows in each, so that none delays the next ones.

use std::ops::Range;

/// Maximum number of strips: more would search most rows twice.
const MAX_STRIPS: u32 = 8;
/// Rows that a strip shares with each neighbour, pixels: small aircraft are complete in one of them.
const OVERLAP_PX: u32 = 32;
/// Maximum part of the time between two images that a strip takes.
const MAX_PART: f64 = 0.6;
/// Maximum part of all time that strips take: the rest is for the aircraft that are followed.
const MAX_SHARE: f64 = 0.25;
/// Weight of a new measurement of the time that a search takes.
const LEARNED_PART: f64 = 0.25;

/// The strips of the current search, and the time that they take.
#[derive(Debug, Clone, Default)]
pub(super) struct Strips {
    count: u32,
    next: u32,
    /// Time of the last image with a strip, and the time that this took, s.
    last: Option<(f64, f64)>,
    /// Time that a whole image takes, s.
    whole_s: Option<f64>,
}

impl Strips {
    /// A new search that takes as long for a whole image.
    pub(super) fn begun_again(&self) -> Self {
        Self {
            whole_s: self.whole_s,
            ..Self::default()
        }
    }

    /// The part of these rows to search in the image at `now_s`, `since_s` after the one before; `None` if no strip is due. All are
    /// searched within `period_s`, or later if that would take too much time.
    pub(super) fn due(
        &mut self,
        rows: &Range<u32>,
        [now_s, since_s]: [f64; 2],
        period_s: f64,
    ) -> Option<Range<u32>> {
        if self.next == 0 {
            let parts = self.whole_s.unwrap_or(0.0) / (MAX_PART * since_s.max(1e-3));
            let most = if rows.is_empty() { 1 } else { MAX_STRIPS };
            self.count = (parts.ceil() as u32).clamp(1, most);
        }
        let has_passed = self.has_passed([now_s, since_s], period_s / f64::from(self.count));
        has_passed.then(|| {
            let height_px = (rows.end - rows.start).div_ceil(self.count);
            let top_px = rows.start + self.next * height_px;
            self.next = (self.next + 1) % self.count;
            strip(rows, top_px, height_px)
        })
    }

    /// The strip around a row, where an aircraft was lost.
    pub(super) fn around(
        &self,
        rows: &Range<u32>,
        row_px: f64,
        at_s: [f64; 2],
        wait_s: f64,
    ) -> Option<Range<u32>> {
        let height_px = (rows.end - rows.start).div_ceil(self.count.max(1));
        let top_px = (row_px - 0.5 * f64::from(height_px)).max(0.0) as u32;
        let last_px = rows.end.saturating_sub(height_px).max(rows.start);
        let may_follow = self.has_passed(at_s, wait_s);
        may_follow.then(|| strip(rows, top_px.clamp(rows.start, last_px), height_px))
    }

    /// True if the wait ends before the middle of the time to the next image.
    fn has_passed(&self, [now_s, since_s]: [f64; 2], wait_s: f64) -> bool {
        self.last.is_none_or(|(last_s, took_s)| {
            now_s + 0.5 * since_s - last_s >= wait_s.max(took_s / MAX_SHARE)
        })
    }

    /// Takes the time that a strip with this part of all rows took.
    pub(super) fn took(&mut self, now_s: f64, took_s: f64, part: f64) {
        self.last = Some((now_s, took_s));
        let whole_s = self.whole_s.get_or_insert(took_s / part);
        *whole_s += LEARNED_PART * (took_s / part - *whole_s);
    }
}

fn strip(rows: &Range<u32>, top_px: u32, height_px: u32) -> Range<u32> {
    let bottom_px = (top_px + height_px + OVERLAP_PX).min(rows.end);
    top_px.saturating_sub(OVERLAP_PX).max(rows.start)..bottom_px
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROWS: Range<u32> = 0..1_280;

    /// Images at these intervals, of which a whole one takes `whole_s`: times and rows of the strips.
    fn strips(images: u32, since_s: f64, whole_s: f64) -> Vec<(f64, Range<u32>)> {
        let mut strips = Strips::default();
        let mut all = Vec::new();
        for image in 0..images {
            let now_s = f64::from(image) * since_s;
            if let Some(rows) = strips.due(&ROWS, [now_s, since_s], 1.0) {
                let part = f64::from(rows.end - rows.start) / 1_280.0;
                strips.took(now_s, whole_s * part, part);
                all.push((now_s, rows));
            }
        }
        all
    }

    #[test]
    fn a_search_that_takes_longer_than_the_next_image_is_spread_over_a_second() {
        let all = strips(600, 1.0 / 30.0, 0.15);
        assert_eq!(all[0].1, ROWS, "its time is unknown at first");
        let second = &all[1..9];
        assert_eq!(second[0].1, 0..192);
        assert_eq!(second[3].1, 448..672);
        assert_eq!(second[7].1, 1_088..1_280);
        assert!(second[7].0 - second[0].0 < 1.0, "{second:?}");
    }

    #[test]
    fn a_search_that_delays_no_image_stays_whole() {
        let all = strips(100, 0.2, 0.1);
        assert!(all.len() == 20 && all.iter().all(|(_, rows)| *rows == ROWS));
    }

    #[test]
    fn strips_take_a_quarter_of_the_time_where_the_processor_is_short() {
        let all = strips(600, 0.2, 3.0);
        let between_s = (all[40].0 - all[20].0) / 20.0;
        let took_s = 3.0 * 224.0 / 1_280.0;
        assert!(
            (0.9..1.1).contains(&(between_s * MAX_SHARE / took_s)),
            "{between_s}"
        );
    }

    #[test]
    fn an_aircraft_that_is_lost_is_looked_for_in_the_rows_around_it() {
        let mut strips = Strips {
            count: 8,
            ..Strips::default()
        };
        assert_eq!(
            strips.around(&ROWS, 600.0, [5.0, 0.1], 0.25),
            Some(488..712)
        );
        strips.took(5.0, 0.02, 0.15);
        assert_eq!(strips.around(&ROWS, 600.0, [5.1, 0.1], 0.25), None);
        assert_eq!(
            strips.around(&(300..700), 5.0, [5.3, 0.1], 0.25),
            Some(300..382)
        );
    }
}
