//! Lag of the scene behind the code in frames, measured with a probe: a frame with the aircraft displaced.
//!
//! The camera rests, so a patch of background changes only while the displaced aircraft is in it: in one grab, which gives the lag.

use std::collections::BTreeMap;

use crate::pixels::Rectangle;

/// The longest lag that a probe can measure, frames.
pub(super) const MAX_LAG: u64 = 4;
/// A grab beyond the longest lag, which shows the scene as it is without the probe.
const AFTER: u64 = MAX_LAG + 1;
/// A pixel has changed if a colour differs by more than this, grey levels: in a pause a screen repeats every bit ...
const CHANGED_LEVELS: u8 = 2;
/// ... and by this many times what differs between two grabs without a probe.
const NOISE_FACTOR: f64 = 3.0;
/// Minimum changed pixels; fewer are noise.
const MIN_CHANGED_PIXELS: usize = 3;
/// A grab that shows the probe has at least this share of the changed pixels of the clearest one.
const CLEAR_SHARE: f64 = 0.3;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Outcome {
    /// The scene is this many frames behind.
    Behind(u64),
    /// The aircraft cannot be seen at all: fog, night, outside the image.
    Unseen,
    /// Grabs are missing, or several show it.
    Unclear,
}

/// A probe that is under way: the patch of each grab where the displaced aircraft will be.
#[derive(Debug)]
pub(super) struct Probe {
    /// The patch in the image.
    pub(super) patch: Rectangle,
    /// Current lag, if any.
    expected: Option<u64>,
    /// Frame in which the probe was written, once known.
    frame: Option<u64>,
    patches: BTreeMap<u64, Vec<u8>>,
}

impl Probe {
    pub(super) fn new(patch: Rectangle, expected: Option<u64>) -> Self {
        Self {
            patch,
            expected,
            frame: None,
            patches: BTreeMap::new(),
        }
    }

    /// Notes the frame in which the probe was written.
    pub(super) fn written_in(&mut self, frame: u64) {
        self.frame = Some(frame);
    }

    pub(super) fn see(&mut self, grab: u64, patch: Vec<u8>) {
        self.patches.insert(grab, patch);
        let from = self.frame.unwrap_or(grab).saturating_sub(2 * AFTER);
        self.patches = self.patches.split_off(&from);
    }

    /// Frame in which the probe was written, and its result, once enough grabs have come. A probe that shows where it is expected, and only
    /// there, has its result at once.
    pub(super) fn outcome(&self) -> Option<(u64, Outcome)> {
        let frame = self.frame?;
        let (last, _) = self.patches.last_key_value()?;
        if *last >= frame + AFTER {
            return Some((frame, self.judge(frame)));
        }
        let expected = self.expected?;
        let is_there = |grab| self.patches.contains_key(&grab);
        let may_confirm = (frame..=frame + expected + 1).all(is_there);
        let confirmed = Outcome::Behind(expected);
        (may_confirm && self.judge(frame) == confirmed).then_some((frame, confirmed))
    }

    fn judge(&self, frame: u64) -> Outcome {
        let before = self.patches.range(..frame).next_back();
        let mut after = self.patches.range(frame + AFTER..);
        let (background, other) = match (before, after.next()) {
            (Some((_, before)), after) => (
                before,
                after.or_else(|| self.patches.range(..frame).rev().nth(1)),
            ),
            (None, Some((_, background))) => (background, after.next()),
            (None, None) => return Outcome::Unclear,
        };
        let threshold = other.map_or(CHANGED_LEVELS, |(_, other)| {
            let noise = levels_of_noise(background, other) * NOISE_FACTOR;
            CHANGED_LEVELS.max(noise.min(f64::from(u8::MAX)) as u8)
        });
        let changed: Vec<Option<usize>> = (0..=MAX_LAG)
            .map(|lag| {
                let patch = self.patches.get(&(frame + lag))?;
                Some(changed_pixels(patch, background, threshold))
            })
            .collect();
        let most = changed.iter().flatten().copied().max().unwrap_or(0);
        tracing::debug!(frame, ?changed, threshold, patch = %self.patch, "probe");
        if most < MIN_CHANGED_PIXELS {
            let all_there = changed.iter().all(Option::is_some);
            return if all_there {
                Outcome::Unseen
            } else {
                Outcome::Unclear
            };
        }
        let clear = |count: &Option<usize>| {
            count.is_some_and(|count| count as f64 >= CLEAR_SHARE * most as f64)
        };
        let mut lags = (0..=MAX_LAG)
            .zip(&changed)
            .filter(|(_, count)| clear(count));
        match (lags.next(), lags.next()) {
            (Some((lag, _)), None) => Outcome::Behind(lag),
            _ => Outcome::Unclear,
        }
    }
}

/// Number of pixels that differ by more than a threshold in a colour.
pub(in crate::simulator) fn changed_pixels(a: &[u8], b: &[u8], threshold: u8) -> usize {
    let pairs = a.as_chunks::<3>().0.iter().zip(b.as_chunks::<3>().0);
    pairs
        .filter(|(a, b)| a.iter().zip(*b).any(|(a, b)| a.abs_diff(*b) > threshold))
        .count()
}

/// The difference that one pixel in a hundred exceeds.
fn levels_of_noise(a: &[u8], b: &[u8]) -> f64 {
    let mut differences: Vec<u8> = a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).collect();
    differences.sort_unstable();
    let at = differences
        .len()
        .saturating_sub(1 + differences.len() / 100);
    differences.get(at).copied().map_or(0.0, f64::from)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A patch of ten pixels.
    fn patch(level: u8) -> Vec<u8> {
        vec![level; 30]
    }

    /// A probe in frame 100, with grabs that differ from the background.
    fn told(
        grabs: impl IntoIterator<Item = u64>,
        showing: &[u64],
        background: u8,
    ) -> Option<(u64, Outcome)> {
        told_expecting(None, grabs, showing, background)
    }

    fn told_expecting(
        expected: Option<u64>,
        grabs: impl IntoIterator<Item = u64>,
        showing: &[u64],
        background: u8,
    ) -> Option<(u64, Outcome)> {
        let patch_px = Rectangle {
            x_px: 0,
            y_px: 0,
            width_px: 5,
            height_px: 2,
        };
        let mut probe = Probe::new(patch_px, expected);
        for grab in grabs {
            let level = if showing.contains(&grab) {
                background + 30
            } else {
                background
            };
            probe.see(grab, patch(level));
            if grab == 100 {
                probe.written_in(100);
            }
        }
        probe.outcome()
    }

    #[test]
    fn the_lag_is_the_grab_in_which_the_aircraft_is_elsewhere() {
        for lag in 0..=MAX_LAG {
            assert_eq!(
                told(97..=105, &[100 + lag], 90),
                Some((100, Outcome::Behind(lag)))
            );
        }
    }

    #[test]
    fn it_is_told_only_when_every_grab_may_have_come() {
        assert_eq!(told(97..=104, &[102], 90), None);
    }

    #[test]
    fn the_expected_lag_is_confirmed_by_the_grab_after_it() {
        for lag in 0..MAX_LAG {
            let told = |last, showing: &[u64]| told_expecting(Some(lag), 97..=last, showing, 90);
            let shown = [100 + lag];
            assert_eq!(told(100 + lag, &shown), None);
            assert_eq!(told(101 + lag, &shown), Some((100, Outcome::Behind(lag))));
            // A different lag, or two grabs, need all grabs.
            assert_eq!(told(104, &[101 + lag]), None);
            assert_eq!(told(104, &[100 + lag, 101 + lag]), None);
        }
        let without_102 = (97..=103).filter(|grab| *grab != 102);
        assert_eq!(told_expecting(Some(1), without_102, &[101], 90), None);
    }

    #[test]
    fn nothing_seen_is_no_lag_and_two_grabs_are_unclear() {
        assert_eq!(told(97..=105, &[], 90), Some((100, Outcome::Unseen)));
        assert_eq!(
            told(97..=105, &[101, 102], 90),
            Some((100, Outcome::Unclear))
        );
    }

    #[test]
    fn a_missing_grab_could_have_shown_it() {
        let without_102 = (97..=105).filter(|grab| *grab != 102);
        assert_eq!(told(without_102, &[], 90), Some((100, Outcome::Unclear)));
    }
}
