//! Image times: the sender's wall clock if it can be right, else timestamps placed by their arrivals, else the arrival. No clock is exact:
//! [`Tie`] says how far the clocks of two views can differ before an aircraft tells.
//!
//! Timestamps run evenly but begin anywhere. The image with the shortest delay places them; a clock that runs at a different rate is
//! followed, up to 200 ppm. Late images stay late: only a clock whose readings jump is placed again.

mod rate;

use std::ops::RangeInclusive;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};

use rate::Rate;

/// Time source.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ClockSource {
    /// The wall clock of the sender (RTCP).
    Sender,
    /// Timestamps, placed by their arrivals.
    Timestamps,
    /// The image's arrival.
    Arrival,
    /// The recording.
    Recording,
}

impl ClockSource {
    pub(crate) fn tie(self) -> Tie {
        match self {
            Self::Recording => Tie::Common,
            Self::Sender => Tie::Senders,
            Self::Timestamps | Self::Arrival => Tie::Free,
        }
    }
}

/// Common source of two clocks. Of two clocks with different sources, the weaker tie counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Tie {
    /// The common time of recordings.
    Common,
    /// Wall clocks that their senders set, by NTP or by hand: their difference has a standard deviation of [`SENDERS_SD_S`].
    Senders,
    /// Nothing.
    #[default]
    Free,
}

/// A smaller change between this computer's two clocks is the time between reading them, seconds: larger errors of UTC are set at once.
const MIN_SET_S: f64 = 0.05;

/// This computer's time, which never jumps while it runs, and UTC, which may be set.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RunClock {
    began: Instant,
    began_utc_s: f64,
    utc: fn() -> SystemTime,
}

impl RunClock {
    pub(crate) fn start() -> Self {
        Self::with_utc(SystemTime::now)
    }

    fn with_utc(utc: fn() -> SystemTime) -> Self {
        Self {
            began: Instant::now(),
            began_utc_s: utc_s(utc()),
            utc,
        }
    }

    pub(crate) fn now_s(&self) -> f64 {
        self.began.elapsed().as_secs_f64()
    }

    /// A UTC time, as seconds since the start.
    pub(crate) fn since_start_s(&self, utc_s: f64) -> f64 {
        utc_s - self.began_utc_s()
    }

    /// UTC at a time since the start.
    pub(crate) fn utc(&self, since_start_s: f64) -> SystemTime {
        let utc_s = (self.began_utc_s() + since_start_s).max(0.0);
        UNIX_EPOCH + Duration::from_secs_f64(utc_s)
    }

    /// UTC of the start, as it is known now: a computer without a battery learns the date after programs have started.
    fn began_utc_s(&self) -> f64 {
        // Between two readings of the other clock that are near each other: a busy machine may pause here.
        let read = || {
            let before_s = self.now_s();
            let began_utc_s = utc_s((self.utc)()) - before_s;
            (self.now_s() - before_s < MIN_SET_S / 5.0).then_some(began_utc_s)
        };
        let Some(began_utc_s) = (0..3).find_map(|_| read()) else {
            return self.began_utc_s;
        };
        if (began_utc_s - self.began_utc_s).abs() < MIN_SET_S {
            self.began_utc_s
        } else {
            began_utc_s
        }
    }
}

fn utc_s(utc: SystemTime) -> f64 {
    let since = utc.duration_since(UNIX_EPOCH);
    since.unwrap_or_default().as_secs_f64()
}

/// A time in seconds since the start of the program, and where it is from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Stamp {
    pub(crate) time_s: f64,
    pub(crate) clock: ClockSource,
    /// No later than it was taken, whatever its clock says: for its age.
    pub(crate) oldest_s: f64,
    /// Shortest time from the sender's clock to the arrivals, also of a clock that is not used.
    pub(crate) sender_delay_s: Option<f64>,
}

impl Stamp {
    /// An image of a recording.
    pub(crate) fn recorded(time_s: f64) -> Self {
        Self {
            time_s,
            clock: ClockSource::Recording,
            oldest_s: time_s,
            sender_delay_s: None,
        }
    }

    /// Shortest time from the used clock to the arrivals, s; `None` for recordings.
    pub(crate) fn delay_s(&self) -> Option<f64> {
        match self.clock {
            ClockSource::Recording => None,
            ClockSource::Sender => self.sender_delay_s,
            // It is placed by them.
            ClockSource::Timestamps | ClockSource::Arrival => Some(0.0),
        }
    }
}

/// Clues to an image's time.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Clues {
    /// When it arrived, seconds since the start.
    pub(crate) arrival_s: f64,
    /// Timestamp with an unknown zero, s.
    pub(crate) timestamp_s: Option<f64>,
    /// The sender's wall clock, seconds since the start.
    pub(crate) sender_s: Option<f64>,
    /// Time from this clock to the arrival of the sender's last report, s.
    pub(crate) report_delay_s: Option<f64>,
    /// The image was waited for, so that the arrival is the true one.
    pub(crate) is_prompt: bool,
}

/// Shortest time from a sender's clock to the arrival, seconds: otherwise the clock is wrong, ours is, or the feed is late. Two clocks that
/// are trusted differ by the width of this range at most.
const SENDER_DELAY_S: RangeInclusive<f64> = -0.15..=0.35;
const SENDER_SPAN_S: f64 = *SENDER_DELAY_S.end() - *SENDER_DELAY_S.start();
/// Standard deviation of the difference between two clocks that may be anywhere in this range, s: the width divided by the root of 6.
pub(crate) const SENDERS_SD_S: f64 = SENDER_SPAN_S / 2.449_489_742_783_178;

/// The connection's image clock.
#[derive(Debug, Default)]
pub(crate) struct Stamper {
    sender: Placement,
    reports: Reports,
    timestamps: Placement,
    rate: Rate,
}

/// What a sender's reports say of its clock.
#[derive(Debug, Default)]
struct Reports {
    /// Delays of the last report and of the fastest one, s.
    last_s: Option<f64>,
    fastest_s: Option<f64>,
    /// Rate of the images by the sender's clock.
    rate: Rate,
    is_refuted: bool,
}

impl Reports {
    /// False once images came ever later by the sender's clock while its reports came as fast as before. A slow network would hold up both,
    /// so the camera sends fewer images than it counts, and its clock stays unused in this connection.
    fn are_believed(&mut self, clues: Clues, sender_s: f64, shortest_s: f64) -> bool {
        if clues.is_prompt {
            self.rate.has_changed(clues.arrival_s, sender_s);
        }
        if let Some(report_s) = clues.report_delay_s
            && self.last_s.replace(report_s) != Some(report_s)
        {
            let fastest_s = self.fastest_s.map_or(report_s, |s| s.min(report_s));
            self.fastest_s = Some(fastest_s);
            let later_s = clues.arrival_s - sender_s - shortest_s;
            self.is_refuted |= self.rate.seconds != 1.0 && report_s - fastest_s < later_s / 2.0;
        }
        !self.is_refuted
    }
}

impl Stamper {
    /// `others_s`: shortest delays of the other views by their senders' clocks. Two that arrive seconds late or early, and alike, have been
    /// set by one source: both feeds are late, or our clock is wrong.
    pub(crate) fn stamp(&mut self, clues: Clues, others_s: &[f64]) -> Stamp {
        let Clues { arrival_s, .. } = clues;
        let sender = clues
            .sender_s
            .map(|sender_s| (sender_s, self.sender.delay_s(arrival_s, sender_s)));
        let sender_delay_s = sender.map(|(_, shortest_s)| shortest_s);
        let timestamp_s = clues.timestamp_s.map(|timestamp_s| {
            if clues.is_prompt && self.rate.has_changed(arrival_s, timestamp_s) {
                self.timestamps = Placement::default();
            }
            self.rate.seconds * timestamp_s
        });
        if let Some((sender_s, shortest_s)) = sender
            && self.reports.are_believed(clues, sender_s, shortest_s)
        {
            let is_alike = |other_s: &f64| {
                !SENDER_DELAY_S.contains(other_s) && (shortest_s - other_s).abs() <= SENDER_SPAN_S
            };
            if SENDER_DELAY_S.contains(&shortest_s) || others_s.iter().any(is_alike) {
                return Stamp {
                    time_s: sender_s,
                    clock: ClockSource::Sender,
                    oldest_s: sender_s.min(sender_s + shortest_s),
                    sender_delay_s,
                };
            }
        }
        let (time_s, clock) = match timestamp_s {
            Some(timestamp_s) => (
                timestamp_s + self.timestamps.delay_s(arrival_s, timestamp_s),
                ClockSource::Timestamps,
            ),
            None => (arrival_s, ClockSource::Arrival),
        };
        Stamp {
            time_s,
            clock,
            oldest_s: time_s,
            sender_delay_s,
        }
    }
}

/// Maximum growth rate of the shortest delay: clocks differ by less.
const MAX_DRIFT: f64 = 200e-6;
/// Minimum difference between the steps of a clock and of the arrivals when the clock has jumped, s. A clock that steps evenly is late.
const JUMP_S: f64 = 1.0;
/// A step below this part of the usual one, with an arrival step larger by the same amount, also means a jump: the camera's clock was set
/// back by part of an interval.
const BACK_PART: f64 = 0.5;
/// Weight of new values in running means.
pub(crate) const LEARNED_PART: f64 = 0.05;

/// Usual interval between images.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct UsualInterval(Option<f64>);

impl UsualInterval {
    /// Learns from an interval. One that is longer than `most` usual ones, as after lost images, counts as that many.
    pub(crate) fn learn(&mut self, interval: f64, most: f64) {
        let usual = self.0.get_or_insert(interval);
        *usual += LEARNED_PART * (interval.min(most * *usual) - *usual);
    }

    pub(crate) fn get(self) -> Option<f64> {
        self.0
    }
}

/// The shortest time from a clock's reading to the arrival.
#[derive(Debug, Default)]
struct Placement {
    shortest_s: Option<f64>,
    /// Arrival and reading of the image before.
    last_s: Option<[f64; 2]>,
    usual_step_s: UsualInterval,
}

impl Placement {
    /// Takes a reading, and returns the shortest delay.
    fn delay_s(&mut self, arrival_s: f64, reading_s: f64) -> f64 {
        let delay_s = arrival_s - reading_s;
        let last_s = self.last_s.replace([arrival_s, reading_s]);
        let [since_s, step_s] = match last_s {
            Some([arrival, reading]) => [arrival_s - arrival, reading_s - reading],
            None => [0.0, 0.0],
        };
        let usual_s = self.usual_step_s.get().unwrap_or(0.0);
        let is_set_back =
            step_s.max(0.0) < BACK_PART * usual_s && since_s - step_s > BACK_PART * usual_s;
        let has_jumped = is_set_back || !(0.0..=JUMP_S + since_s).contains(&step_s);
        if last_s.is_some() && step_s > 0.0 && !has_jumped {
            self.usual_step_s.learn(step_s, 2.0);
        }
        let shortest_s = match self.shortest_s.filter(|_| !has_jumped) {
            Some(shortest_s) => delay_s.min(shortest_s + MAX_DRIFT * since_s.max(0.0)),
            None => delay_s,
        };
        self.shortest_s = Some(shortest_s);
        shortest_s
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU64, Ordering};

    use super::*;

    const PERIOD_S: f64 = 1.0 / 30.0;

    /// Network delay, at least 20 ms.
    fn delay_s(image: u32) -> f64 {
        0.02 + 0.03 * f64::from(image % 7) / 7.0
    }

    #[test]
    fn a_clock_that_is_set_later_is_right_from_then_on() {
        static SET_S: AtomicU64 = AtomicU64::new(0);
        let clock = RunClock::with_utc(|| {
            SystemTime::now() + Duration::from_secs(SET_S.load(Ordering::Relaxed))
        });
        let error_s = |set_s: u64| {
            let expected = SystemTime::now() + Duration::from_secs(set_s);
            utc_s(clock.utc(clock.now_s())) - utc_s(expected)
        };
        assert!(error_s(0).abs() < 1.0);
        SET_S.store(86_400, Ordering::Relaxed);
        assert!(error_s(86_400).abs() < 1.0);
        let sender_s = clock.since_start_s(utc_s(SystemTime::now()) + 86_400.0);
        assert!((sender_s - clock.now_s()).abs() < 1.0);
    }

    /// The stamp of an image without the sender's clock.
    fn placed(stamper: &mut Stamper, arrival_s: f64, timestamp_s: f64) -> Stamp {
        let clues = Clues {
            arrival_s,
            timestamp_s: Some(timestamp_s),
            sender_s: None,
            report_delay_s: None,
            is_prompt: true,
        };
        stamper.stamp(clues, &[])
    }

    #[test]
    fn timestamps_are_placed_by_the_fastest_arrival() {
        let mut stamper = Stamper::default();
        for image in 0..200 {
            let taken_s = f64::from(image) * PERIOD_S;
            let stamp = placed(&mut stamper, taken_s + delay_s(image), taken_s + 86_400.0);
            assert_eq!(stamp.clock, ClockSource::Timestamps);
            assert!((stamp.time_s - taken_s - 0.02).abs() < 1e-4, "{image}");
        }
    }

    #[test]
    fn the_senders_clock_is_used_unless_it_is_seconds_off() {
        for (skew_s, expected) in [
            (0.0, ClockSource::Sender),
            (3.0, ClockSource::Timestamps),
            (0.9, ClockSource::Timestamps),
            (-3.0, ClockSource::Timestamps),
        ] {
            let mut stamper = Stamper::default();
            for image in 0..100 {
                let taken_s = f64::from(image) * PERIOD_S;
                let clues = Clues {
                    arrival_s: taken_s + delay_s(image),
                    timestamp_s: Some(taken_s),
                    sender_s: Some(taken_s + skew_s),
                    report_delay_s: None,
                    is_prompt: true,
                };
                // A right clock of another view, or one that is wrong by a different amount, helps nothing.
                let stamp = stamper.stamp(clues, &[0.02, -40.0]);
                assert_eq!(stamp.clock, expected, "skew {skew_s}");
                assert!((stamp.time_s - taken_s).abs() < 0.051, "skew {skew_s}");
            }
        }
    }

    #[test]
    fn feeds_that_are_equally_late_by_their_senders_clocks_have_these_times_and_their_age() {
        const LATE_S: f64 = 2.0;
        let mut stamper = Stamper::default();
        for image in 0..100 {
            let taken_s = f64::from(image) * PERIOD_S;
            let clues = Clues {
                arrival_s: taken_s + LATE_S + delay_s(image),
                timestamp_s: Some(taken_s),
                sender_s: Some(taken_s),
                report_delay_s: None,
                is_prompt: true,
            };
            let stamp = stamper.stamp(clues, &[LATE_S + 0.1]);
            assert_eq!((stamp.clock, stamp.time_s), (ClockSource::Sender, taken_s));
            assert_eq!(stamp.oldest_s, taken_s);
            assert!(stamp.delay_s().is_some_and(|delay_s| delay_s >= LATE_S));
        }
    }

    #[test]
    fn a_clock_that_jumps_is_placed_again_and_a_stall_is_not_a_jump() {
        let mut stamper = Stamper::default();
        let mut stamp = |image: u32, jump_s: f64, stall_s: f64| {
            let taken_s = f64::from(image) * PERIOD_S;
            let stamp = placed(&mut stamper, taken_s + 0.02 + stall_s, taken_s + jump_s);
            stamp.time_s - taken_s
        };
        for image in 0..60 {
            assert!(stamp(image, 0.0, 0.0) < 0.03);
        }
        // Held for two seconds, then delivered at once.
        for image in 60..120 {
            let stall_s = f64::from(120 - image) * PERIOD_S;
            assert!(stamp(image, 0.0, stall_s) < 0.03, "{image}");
        }
        assert!(stamp(120, 100.0, 0.0) < 0.03, "forwards");
        assert!(stamp(121, -50.0, 0.0) < 0.03, "backwards");
        // A steady backlog is not a jump either: its images are old.
        for image in 122..300 {
            assert!(stamp(image, -50.0, 1.5) < 0.05, "{image}");
        }
    }

    #[test]
    fn a_camera_that_sends_fewer_images_than_it_counts_is_late_for_seconds_only() {
        let mut stamper = Stamper::default();
        for image in 0..21 * 60_u32 {
            let taken_s = f64::from(image) / 21.0;
            // From the half on as many as it counts, at its own rate again.
            let counted_s =
                f64::from(image.min(630)) / 25.0 + f64::from(image.saturating_sub(630)) / 21.0;
            let stamp = placed(&mut stamper, taken_s + delay_s(image), 40.0 + counted_s);
            let late_s = taken_s - stamp.time_s;
            assert!(late_s < 0.9, "{image}: {late_s}");
            let is_settled = (126..630).contains(&image) || image > 630 + 126;
            assert!(!is_settled || late_s.abs() < 0.05, "{image}: {late_s}");
        }
    }

    #[test]
    fn a_clock_by_which_images_come_ever_later_is_not_believed_unless_its_reports_come_later_too() {
        for (is_network_slow, expected) in [
            (false, ClockSource::Timestamps),
            (true, ClockSource::Sender),
        ] {
            let mut stamper = Stamper::default();
            for image in 0..21 * 30_u32 {
                let taken_s = f64::from(image) / 21.0;
                let counted_s = f64::from(image) / 25.0;
                // A report every five seconds.
                let reported_s = (taken_s / 5.0).floor() * 5.0;
                let held_up_s = 0.16 * reported_s * f64::from(u8::from(is_network_slow));
                let clues = Clues {
                    arrival_s: taken_s + delay_s(image),
                    timestamp_s: Some(counted_s),
                    sender_s: Some(counted_s),
                    report_delay_s: Some(0.02 + 1e-4 * reported_s + held_up_s),
                    is_prompt: true,
                };
                // The other camera counts alike.
                let stamp = stamper.stamp(clues, &[taken_s - counted_s]);
                if taken_s > 10.0 {
                    assert_eq!(stamp.clock, expected, "{taken_s} s");
                    let is_fresh = (taken_s - stamp.time_s).abs() < 0.05;
                    assert!(is_network_slow || is_fresh, "{taken_s} s: {}", stamp.time_s);
                }
            }
        }
    }

    #[test]
    fn images_that_were_not_waited_for_show_no_rate() {
        let mut stamper = Stamper::default();
        for image in 0..21 * 30 {
            let clues = Clues {
                arrival_s: f64::from(image) / 21.0,
                timestamp_s: Some(f64::from(image) / 25.0),
                sender_s: None,
                report_delay_s: None,
                is_prompt: false,
            };
            let late_s = clues.arrival_s - stamper.stamp(clues, &[]).time_s;
            assert!(late_s >= 0.15 * clues.arrival_s, "{image}: {late_s}");
        }
    }

    #[test]
    fn a_clock_that_is_set_back_by_part_of_a_second_is_placed_again_at_once() {
        for (period_s, back_s) in [(0.2, 0.15), (0.2, 0.3), (PERIOD_S, 0.025), (PERIOD_S, 0.5)] {
            let mut stamper = Stamper::default();
            let mut last_s = f64::NEG_INFINITY;
            for image in 0..200 {
                let taken_s = f64::from(image) * period_s;
                let set_s = if image < 100 { 0.0 } else { back_s };
                let stamp = placed(
                    &mut stamper,
                    taken_s + 0.02 + 0.1 * (delay_s(image) - 0.02),
                    taken_s - set_s,
                );
                let error_s = stamp.time_s - taken_s - 0.02;
                assert!(
                    (-1e-9..0.004).contains(&error_s),
                    "{back_s}: {error_s} at {image}"
                );
                assert!(stamp.time_s > last_s, "{back_s}: {image}");
                last_s = stamp.time_s;
            }
        }
    }

    /// Feeds an image; returns its time error and the clock used.
    fn error_s(
        stamper: &mut Stamper,
        taken_s: f64,
        delay_s: f64,
        timestamp_s: f64,
        sender_s: f64,
    ) -> (f64, ClockSource) {
        let clues = Clues {
            arrival_s: taken_s + delay_s,
            timestamp_s: Some(timestamp_s),
            sender_s: Some(sender_s),
            report_delay_s: None,
            is_prompt: true,
        };
        let stamp = stamper.stamp(clues, &[]);
        (stamp.time_s - taken_s, stamp.clock)
    }

    #[test]
    fn a_senders_clock_that_jumps_is_left_at_once_and_trusted_again_when_it_is_right() {
        for jump_s in [3.0, 0.5, -0.5, -3.0, 86_400.0] {
            let mut stamper = Stamper::default();
            for image in 0..300 {
                let taken_s = f64::from(image) * PERIOD_S;
                let is_wrong = (100..200).contains(&image);
                let sender_s = taken_s + if is_wrong { jump_s } else { 0.0 };
                let delay_s = delay_s(image);
                let (error_s, clock) = error_s(&mut stamper, taken_s, delay_s, taken_s, sender_s);
                assert!(error_s.abs() < 0.051, "{jump_s}: {error_s} at {image}");
                let expected = if is_wrong {
                    ClockSource::Timestamps
                } else {
                    ClockSource::Sender
                };
                assert_eq!(clock, expected, "{jump_s}: {image}");
            }
        }
    }

    #[test]
    fn a_day_of_timestamps_is_placed_as_well_as_a_second_also_where_their_counter_wraps() {
        // 32 bits of 90 kHz.
        let wrap_s = f64::from(u32::MAX) / 90_000.0;
        let mut stamper = Stamper::default();
        for image in 0..86_400 * 5 {
            let taken_s = f64::from(image) / 5.0;
            let counted_s = (taken_s * (1.0 + 50e-6) + 7_000.0).rem_euclid(wrap_s);
            let stamp = placed(&mut stamper, taken_s + delay_s(image), counted_s);
            let error_s = stamp.time_s - taken_s;
            // After the wrap the first arrival places them, and it may have been a slow one.
            assert!(
                (0.0..0.051).contains(&error_s),
                "{error_s} after {taken_s} s"
            );
        }
    }

    #[test]
    fn a_clock_that_runs_fast_is_followed() {
        let mut stamper = Stamper::default();
        for image in 0..30 * 600 {
            let taken_s = f64::from(image) * PERIOD_S;
            let stamp = placed(&mut stamper, taken_s, taken_s * (1.0 - 100e-6));
            assert!((stamp.time_s - taken_s).abs() < 0.004, "{image}");
        }
    }
}
