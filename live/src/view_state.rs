//! View state, from images and their absence.
//!
//! Equal images alone do not show a freeze: encoders repeat a scene without noise. A view is frozen if its images stop changing after they
//! changed all the time; if they never did, the search decides (an aircraft should have moved).

pub(crate) mod image_look;

use std::collections::VecDeque;

use dataset::numbers::spread::median;
use serde::Serialize;

use crate::view_state::image_look::ImageLook;

/// View state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ViewState {
    /// It can be measured.
    Up,
    /// Images come later than they should, or none has come for a moment.
    Late,
    /// Images repeat.
    Frozen,
    /// The decoder concealed errors since the last key frame, or the images have a wrong size.
    Damaged,
    /// The camera looks elsewhere.
    Moved,
    /// Images are black.
    Dark,
    /// There are no images.
    Down,
}

impl ViewState {
    /// Names in the order of the variants.
    pub(crate) const NAMES: [&'static str; 7] =
        ["up", "late", "frozen", "damaged", "moved", "dark", "down"];

    /// True if the images show the current scene.
    pub(crate) fn can_be_measured(self) -> bool {
        matches!(self, Self::Up | Self::Late)
    }
}

/// Maximum age of images and maximum silence before the view is late, s, or in usual intervals.
const LATE_S: f64 = 0.22;
const LATE_PERIODS: f64 = 3.5;
/// Maximum silence before the view is down, s, or in usual intervals.
const DOWN_S: f64 = 1.0;
const DOWN_PERIODS: f64 = 8.0;
/// Minimum duration of frozen and dark states, s, and minimum number of images.
const FROZEN_S: f64 = 0.35;
const DARK_S: f64 = 0.2;
const MIN_IMAGES: usize = 3;
/// A freeze ends with this number of changed images in a row over this time, s: encoders refine a still image after each key frame. It also
/// ends when no image was frozen for as long as makes a view down, or for this number of usual intervals.
const MIN_CHANGED: usize = 4;
const CHANGED_S: f64 = 0.15;
const HELD_PERIODS: f64 = 6.0;
/// Time window of the usual change, s, and minimum number of images.
const USUAL_S: f64 = 10.0;
const MIN_USUAL: usize = 20;
/// Minimum change of nearly all images in a scene with noise, grey levels.
const MIN_CHANGE: f64 = 0.03;
const CHANGING_PART: f64 = 0.95;
/// An image that changed by less than this part of the least usual change repeats the one before. An encoder goes on refining an image
/// that stands still: by up to 0.4 of the change that noise makes.
const REPEATED_PART: f64 = 0.5;
/// In a freeze, at least one image changes by less than this part. Otherwise the images have become quieter, by a new encoder or in the
/// evening. On a new connection, which may have a new encoder, [`EQUAL_PART`] decides at first.
const STILL_PART: f64 = 0.3;
/// Maximum part in a freeze after the next key frame, when the encoder has no more to refine.
const EQUAL_PART: f64 = 0.1;
/// Longest time between key frames, s; measured cameras have up to 12 s.
pub(crate) const MAX_KEY_FRAME_INTERVAL_S: f64 = 15.0;

/// An image that was decoded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct DecodedLook {
    pub(crate) now_s: f64,
    /// When it was taken, by its stamp.
    pub(crate) time_s: f64,
    pub(crate) is_damaged: bool,
    pub(crate) look: Option<ImageLook>,
}

/// Watches a view.
#[derive(Debug, Default)]
pub(crate) struct ViewWatch {
    is_connected: bool,
    images: usize,
    last_s: Option<f64>,
    /// Age of the last image when it came.
    age_s: f64,
    is_damaged: bool,
    is_moved: bool,
    is_frozen: bool,
    /// Since when all images repeat, or are dark, and how many.
    repeats: Option<(f64, usize)>,
    /// When a repeating image was last equal to the one before, or first changed little enough.
    equal_s: Option<f64>,
    frozen_s: Option<f64>,
    /// Since when all images change, and how many.
    changes: Option<(f64, usize)>,
    dark: Option<(f64, usize)>,
    /// Times and changes of recent images, without repeated ones.
    usual: VecDeque<(f64, f64)>,
}

impl ViewWatch {
    pub(crate) fn set_connected(&mut self, is_connected: bool) {
        self.is_connected = is_connected;
        if !is_connected {
            *self = Self {
                // The scene is the same when it comes back, and so is the camera's direction.
                usual: std::mem::take(&mut self.usual),
                is_moved: self.is_moved,
                ..Self::default()
            };
        }
    }

    /// Takes the condition of the camera by the search.
    pub(crate) fn set_camera(&mut self, is_moved: bool, is_frozen: bool) {
        (self.is_moved, self.is_frozen) = (is_moved, is_frozen);
    }

    /// Takes an image that is not after the previous one, as for a while when a clock is set back: it only shows that the view delivers.
    pub(crate) fn came(&mut self, now_s: f64) {
        self.last_s = self.last_s.map(|_| now_s);
    }

    /// Takes an image, and returns the state of the view with it.
    pub(crate) fn take(&mut self, seen: DecodedLook) -> ViewState {
        let DecodedLook { now_s, look, .. } = seen;
        self.is_connected = true;
        self.images += 1;
        self.last_s = Some(now_s);
        self.age_s = now_s - seen.time_s;
        self.is_damaged = seen.is_damaged;
        let count = |run: Option<(f64, usize)>| match run {
            Some((since_s, count)) => Some((since_s, count + 1)),
            None => Some((now_s, 1)),
        };
        let is_dark = look.is_some_and(|look| look.is_dark);
        self.dark = is_dark.then(|| count(self.dark)).flatten();
        let change = look.and_then(|look| look.change_levels);
        let repeats = change.zip(self.usual_change());
        match repeats.filter(|(change, usual)| *change <= REPEATED_PART * usual) {
            Some((change, usual)) => {
                (self.repeats, self.changes) = (count(self.repeats), None);
                if change <= EQUAL_PART * usual {
                    self.equal_s = Some(now_s);
                } else if change <= STILL_PART * usual && self.images > MIN_USUAL {
                    self.equal_s.get_or_insert(now_s);
                }
            }
            None => {
                (self.repeats, self.changes) = (None, count(self.changes));
                self.equal_s = self.equal_s.filter(|_| self.frozen_s.is_some());
            }
        }
        if self
            .equal_s
            .is_some_and(|at_s| now_s > at_s + MAX_KEY_FRAME_INTERVAL_S)
        {
            (self.equal_s, self.frozen_s) = (None, None);
            for (_, usual) in &mut self.usual {
                *usual = change.unwrap_or(*usual);
            }
        }
        if self.repeats_long() && !is_dark {
            self.frozen_s = Some(now_s);
        }
        self.frozen_s = self.frozen_s.filter(|frozen_s| {
            let held_s = DOWN_S.max(HELD_PERIODS * self.period_s().unwrap_or(0.0));
            now_s - frozen_s <= held_s && !self.lasts(self.changes, MIN_CHANGED, CHANGED_S)
        });
        let repeats = self.equal_s.is_some() || self.frozen_s.is_some();
        if let Some(change) = change.filter(|_| !is_dark && !repeats) {
            self.usual.push_back((now_s, change));
        }
        while self.usual.len() > MIN_USUAL
            && self
                .usual
                .front()
                .is_some_and(|(at_s, _)| at_s + USUAL_S < now_s)
        {
            self.usual.pop_front();
        }
        self.state(now_s)
    }

    pub(crate) fn state(&self, now_s: f64) -> ViewState {
        let Some(last_s) = self.last_s.filter(|_| self.is_connected) else {
            return ViewState::Down;
        };
        let silent_s = now_s - last_s;
        let period_s = self.period_s();
        // The interval is unknown after a single image.
        let late_s = match period_s {
            Some(period_s) => LATE_S.max(LATE_PERIODS * period_s),
            None => DOWN_S,
        };
        if silent_s > DOWN_S.max(DOWN_PERIODS * period_s.unwrap_or(0.0)) {
            ViewState::Down
        } else if self.lasts(self.dark, MIN_IMAGES, DARK_S) {
            ViewState::Dark
        } else if self.is_moved {
            ViewState::Moved
        } else if self.is_damaged {
            ViewState::Damaged
        } else if self.is_frozen || self.frozen_s.is_some() {
            ViewState::Frozen
        } else if silent_s.max(self.age_s) > late_s {
            ViewState::Late
        } else {
            ViewState::Up
        }
    }

    /// Reason why the view is late.
    pub(crate) fn why_late(&self, now_s: f64) -> String {
        let silent_s = self.last_s.map_or(0.0, |last_s| now_s - last_s);
        if silent_s > self.age_s {
            return format!("no image has come for {silent_s:.1} s");
        }
        let age_s = self.age_s;
        format!(
            "its images are {age_s:.1} s old when they are decoded: the network or the camera delays them, or this computer is busy"
        )
    }

    /// True if images have repeated long enough to be frozen.
    fn repeats_long(&self) -> bool {
        self.equal_s.is_some() && self.lasts(self.repeats, MIN_IMAGES, FROZEN_S)
    }

    /// True if a run has at least `fewest` images and lasts `least_s` up to the last image.
    fn lasts(&self, run: Option<(f64, usize)>, fewest: usize, least_s: f64) -> bool {
        let now = run.zip(self.last_s);
        now.is_some_and(|((since_s, count), last_s)| count >= fewest && last_s - since_s >= least_s)
    }

    /// The state of the view with its last image, for recordings that are read faster than they were made.
    pub(crate) fn state_at_last_image(&self) -> ViewState {
        self.state(self.last_s.unwrap_or(0.0))
    }

    fn period_s(&self) -> Option<f64> {
        let times = self.usual.iter().map(|(at_s, _)| *at_s);
        let mut between: Vec<f64> = (times.clone().zip(times.skip(1)))
            .map(|(before, after)| after - before)
            .collect();
        (!between.is_empty()).then(|| median(&mut between))
    }

    /// Low quantile of the changes, if images change all the time.
    fn usual_change(&self) -> Option<f64> {
        if self.usual.len() < MIN_USUAL {
            return None;
        }
        let mut changes: Vec<f64> = self.usual.iter().map(|(_, change)| *change).collect();
        changes.sort_by(f64::total_cmp);
        let rare = (changes.len() as f64 * (1.0 - CHANGING_PART)) as usize;
        Some(changes[rare]).filter(|least| *least >= MIN_CHANGE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_S: f64 = 1.0 / 30.0;

    /// Feeds an image with this change; returns the state after it.
    fn show(watch: &mut ViewWatch, now_s: f64, change: f64, is_dark: bool) -> ViewState {
        watch.take(DecodedLook {
            now_s,
            time_s: now_s - 0.03,
            is_damaged: false,
            look: Some(ImageLook {
                is_dark,
                change_levels: Some(change),
            }),
        })
    }

    /// Feeds seconds of images, each with this change; returns the state after the last.
    fn feed(
        watch: &mut ViewWatch,
        from_s: f64,
        to_s: f64,
        change: f64,
        is_dark: bool,
    ) -> ViewState {
        let mut state = ViewState::Up;
        let mut now_s = from_s;
        while now_s < to_s - 1e-9 {
            state = show(watch, now_s, change, is_dark);
            now_s += PERIOD_S;
        }
        state
    }

    #[test]
    fn a_view_without_images_is_late_and_then_down() {
        let mut watch = ViewWatch::default();
        assert_eq!(watch.state(0.0), ViewState::Down);
        assert_eq!(feed(&mut watch, 0.0, 5.0, 0.4, false), ViewState::Up);
        assert_eq!(watch.state(5.1), ViewState::Up);
        assert_eq!(watch.state(5.25), ViewState::Late);
        assert_eq!(watch.state(6.1), ViewState::Down);
        watch.came(6.1);
        assert_eq!(watch.state(6.2), ViewState::Up, "out of order");
        watch.set_connected(false);
        assert_eq!(watch.state(5.0), ViewState::Down);
        assert_eq!(feed(&mut watch, 8.0, 8.1, 0.4, false), ViewState::Up);
    }

    #[test]
    fn images_that_stop_changing_are_frozen_within_half_a_second() {
        let mut watch = ViewWatch::default();
        feed(&mut watch, 0.0, 5.0, 0.4, false);
        assert_eq!(feed(&mut watch, 5.0, 5.2, 0.0, false), ViewState::Up);
        assert_eq!(feed(&mut watch, 5.2, 5.5, 0.0, false), ViewState::Frozen);
        assert_eq!(feed(&mut watch, 5.5, 60.0, 0.0, false), ViewState::Frozen);
        assert_eq!(feed(&mut watch, 60.0, 60.2, 0.4, false), ViewState::Up);
    }

    #[test]
    fn an_image_that_stands_still_and_is_refined_by_its_encoder_is_frozen() {
        let mut watch = ViewWatch::default();
        let mut state = ViewState::Up;
        // Measured changes of a noisy scene, then of its repeated image, at 5 images per second.
        let noisy = [1.75, 1.67, 1.66, 1.64, 1.8].repeat(10);
        let still = [0.0, 0.44, 0.48, 0.68, 0.24, 0.25, 0.42, 0.61];
        for (image, change) in noisy.into_iter().chain(still).enumerate() {
            state = show(&mut watch, image as f64 / 5.0, change, false);
            let expected = if image < 53 {
                ViewState::Up
            } else {
                ViewState::Frozen
            };
            assert!(state == expected || image == 52, "{image}: {state:?}");
        }
        assert_eq!(state, ViewState::Frozen);
    }

    #[test]
    fn a_picture_that_stands_still_is_frozen_across_key_frames_until_all_images_change() {
        let mut watch = ViewWatch::default();
        feed(&mut watch, 0.0, 5.0, 0.1, false);
        feed(&mut watch, 5.0, 5.5, 0.0, false);
        for image in 0..30 * 60 {
            // Every second a key frame and its refinement, as measured.
            let refined = [0.71, 0.33, 0.0, 0.01, 0.06, 0.02, 0.16];
            let change = refined.get(image % 30).copied().unwrap_or(0.002);
            let from_s = 5.5 + PERIOD_S * image as f64;
            let state = feed(&mut watch, from_s, from_s + PERIOD_S, change, false);
            assert_eq!(state, ViewState::Frozen, "{image}");
        }
        assert_eq!(feed(&mut watch, 65.5, 65.7, 0.1, false), ViewState::Up);
    }

    #[test]
    fn a_picture_that_stands_still_is_frozen_while_its_encoder_begins_anew() {
        let mut watch = ViewWatch::default();
        feed(&mut watch, 0.0, 5.0, 0.085, false);
        // As measured, from the image that the encoder begins with: it has nothing to refine after its next key frame.
        let settles = [0.01, 0.194, 0.662, 0.245, 0.019, 0.335, 0.028];
        let images = settles.into_iter().chain([0.02; 24]).chain([0.775]);
        let mut now_s = 5.0;
        for change in images.cycle().take(96) {
            let state = feed(&mut watch, now_s, now_s + PERIOD_S, change, false);
            now_s += PERIOD_S;
            assert!(now_s < 5.0 + 1.0 || state == ViewState::Frozen, "{now_s}");
        }
    }

    #[test]
    fn a_slow_camera_that_stands_still_is_frozen_across_key_frames() {
        let mut watch = ViewWatch::default();
        for image in 0..200 {
            // After 100 images a still image; every five a key frame and its refinement.
            let still = [0.71, 0.33, 0.0, 0.0, 0.0];
            let change = if image < 100 { 0.1 } else { still[image % 5] };
            let state = show(&mut watch, image as f64 / 5.0, change, false);
            assert!(
                image < 105 || state == ViewState::Frozen,
                "{image}: {state:?}"
            );
        }
    }

    #[test]
    fn images_that_go_on_changing_less_are_not_frozen_for_long() {
        let fifth_of_noise_s = MAX_KEY_FRAME_INTERVAL_S + 1.0;
        for (kind, usual, reconnects, change, settled_s) in [
            ("another encoder after a loss", 0.5, true, 0.1, 0.0),
            ("a scene that becomes quieter", 1.7, false, 0.7, 0.0),
            (
                "an encoder that keeps a fifth of the noise",
                1.7,
                false,
                0.34,
                fifth_of_noise_s,
            ),
        ] {
            let mut watch = ViewWatch::default();
            feed(&mut watch, 0.0, 20.0, usual, false);
            watch.set_connected(!reconnects);
            for tenth in 200..400 {
                let from_s = f64::from(tenth) / 10.0;
                let state = feed(&mut watch, from_s, from_s + 0.1, change, false);
                assert!(
                    state == ViewState::Up || from_s < 20.0 + settled_s,
                    "{kind}: {state:?} at {from_s} s"
                );
            }
        }
    }

    #[test]
    fn a_camera_that_repeats_each_image_five_times_is_not_frozen() {
        let mut watch = ViewWatch::default();
        feed(&mut watch, 0.0, 5.0, 0.34, false);
        assert_eq!(feed(&mut watch, 5.0, 5.5, 0.0, false), ViewState::Frozen);
        for sixth in 0..60 {
            let from_s = 5.5 + 6.0 * PERIOD_S * f64::from(sixth);
            feed(&mut watch, from_s, from_s + PERIOD_S, 0.7, false);
            let state = feed(
                &mut watch,
                from_s + PERIOD_S,
                from_s + 6.0 * PERIOD_S,
                0.0,
                false,
            );
            // A freeze before is over after a second.
            assert!(state == ViewState::Up || sixth < 6, "{sixth}: {state:?}");
        }
    }

    #[test]
    fn a_scene_without_noise_is_never_frozen() {
        let mut watch = ViewWatch::default();
        for second in 0..3_600 {
            let from_s = f64::from(second);
            // A key frame changes the encoder's remains.
            feed(&mut watch, from_s, from_s + PERIOD_S, 0.5, false);
            let state = feed(&mut watch, from_s + PERIOD_S, from_s + 1.0, 0.0, false);
            assert_eq!(state, ViewState::Up, "{second}");
        }
    }

    #[test]
    fn black_images_are_dark_within_a_second_and_damage_stays_until_it_is_over() {
        let mut watch = ViewWatch::default();
        feed(&mut watch, 0.0, 5.0, 0.4, false);
        assert_eq!(feed(&mut watch, 5.0, 5.4, 0.0, true), ViewState::Dark);
        assert_eq!(feed(&mut watch, 5.4, 5.5, 0.4, false), ViewState::Up);
        let mut image = DecodedLook {
            now_s: 5.5,
            time_s: 5.5,
            is_damaged: true,
            look: None,
        };
        assert_eq!(watch.take(image), ViewState::Damaged);
        image.is_damaged = false;
        assert_eq!(watch.take(image), ViewState::Up);
    }

    #[test]
    fn a_slow_camera_is_not_late_between_two_images() {
        let mut watch = ViewWatch::default();
        for second in 0..30 {
            show(&mut watch, f64::from(second), 1.0, false);
        }
        assert_eq!(watch.state(29.9), ViewState::Up);
        assert_eq!(watch.state(33.0), ViewState::Late);
    }
}
