//! Images that are left out because newer ones wait: a computer that cannot decode all is up to date again from a later key frame on.
//!
//! Without this the images wait in the socket, and every answer is seconds old although hardly any image is lost.

use std::time::{Duration, Instant};

use crate::output::{MAX_COASTING_S, MAX_FRESH_S};

/// What is known of a stream whose images are not read in time. Times in seconds are the images' own.
#[derive(Debug, Default)]
pub(super) struct Backlog {
    key_s: Option<f64>,
    /// Time between key frames.
    between_keys_s: Option<f64>,
    /// When the first of the images was asked for that were all there already. By the clock, since a file may be sent faster than it plays.
    late_since: Option<Instant>,
    left_out: Option<LeftOut>,
}

#[derive(Debug)]
struct LeftOut {
    since_s: f64,
    /// The newest image has been reached.
    is_up_to_date: bool,
}

impl Backlog {
    /// True if an image is not to be decoded. `was_awaited`: it was not complete when it was asked for.
    ///
    /// Images are left out once they were late for as long as the next key frame may take, so that no more answers are lost than were late.
    pub(super) fn leaves_out(
        &mut self,
        now: Instant,
        time_s: f64,
        is_key: bool,
        was_awaited: bool,
    ) -> bool {
        if is_key {
            self.between_keys_s = self.key_s.replace(time_s).map(|last_s| time_s - last_s);
        }
        if was_awaited {
            self.late_since = None;
        }
        if let Some(left_out) = &mut self.left_out {
            left_out.is_up_to_date |= was_awaited;
            let is_over = left_out.is_up_to_date || time_s - left_out.since_s > MAX_COASTING_S;
            if is_key && is_over {
                (self.left_out, self.late_since) = (None, None);
            }
        } else if !was_awaited {
            let late = now - *self.late_since.get_or_insert(now);
            let is_worth_it =
                |between_s: f64| late >= Duration::from_secs_f64(between_s.max(MAX_FRESH_S));
            if self.between_keys_s.is_some_and(is_worth_it) {
                self.left_out = Some(LeftOut {
                    since_s: time_s,
                    is_up_to_date: false,
                });
            }
        }
        self.left_out.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE_HZ: f64 = 10.0;

    /// Numbers of the images that are decoded, of 200 with a key frame each second, sent at a multiple of their rate; `behind`: those that
    /// were there before they were asked for.
    fn decoded(speed: f64, behind: impl Fn(u32) -> bool) -> Vec<u32> {
        let (mut backlog, began) = (Backlog::default(), Instant::now());
        let is_decoded = |number: &u32| {
            let (time_s, is_key) = (f64::from(*number) / RATE_HZ, number.is_multiple_of(10));
            let now = began + Duration::from_secs_f64(time_s / speed);
            !backlog.leaves_out(now, time_s, is_key, !behind(*number))
        };
        (0..200).filter(is_decoded).collect()
    }

    #[test]
    fn images_that_come_in_time_or_in_bursts_are_all_decoded() {
        assert_eq!(decoded(1.0, |_| false).len(), 200);
        assert_eq!(decoded(1.0, |number| number % 8 > 0).len(), 200);
    }

    #[test]
    fn images_of_a_file_that_is_sent_faster_than_it_plays_are_not_late_yet() {
        assert_eq!(decoded(4.0, |number| (50..80).contains(&number)).len(), 200);
    }

    #[test]
    fn after_a_second_of_late_images_those_until_a_key_frame_at_the_newest_end_are_left_out() {
        let found = decoded(1.0, |number| (50..75).contains(&number));
        let expected = (0..60).chain(80..200);
        assert_eq!(found, expected.collect::<Vec<_>>());
    }

    #[test]
    fn who_never_gets_up_to_date_still_decodes_some() {
        let found = decoded(1.0, |number| number >= 50);
        assert!((60..120).contains(&found.len()), "{found:?}");
        assert!(found.iter().any(|number| *number > 120), "{found:?}");
    }
}
