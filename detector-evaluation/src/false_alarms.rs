//! False alarms (boxes without an aircraft) and their rates.
//!
//! A rate is scaled to one hour of a camera with 30 images per second, whatever the rate of the corpus: false boxes per image times
//! 108,000. Confirmed alarms are counted as tracks: one alarm is raised once, however long it lasts. The number per hour of slow video does
//! not predict the number per hour of fast video, so both rates are given.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::AddAssign;

use serde::Serialize;

use crate::outcome::Searched;

/// Images per camera and hour.
const PICTURES_PER_HOUR: u32 = 30 * 3_600;

/// Counts of false alarms.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct AlarmCounts {
    /// Images that were searched.
    pub pictures: u64,
    /// Duration of the videos, all views, hours.
    pub video_hours: f64,
    /// Boxes that do not touch an aircraft.
    pub boxes: u64,
    /// Boxes of confirmed tracks.
    pub confirmed_boxes: u64,
    /// Confirmed tracks none of whose boxes touches an aircraft; boxes, in modes without tracking.
    pub confirmed_tracks: u64,
}

/// False alarms and their rates.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FalseAlarms {
    /// Counts behind the rates.
    #[serde(flatten)]
    pub counts: AlarmCounts,
    /// Video duration at 30 images per second, hours.
    pub hours: f64,
    /// False boxes an hour and view, before confirmation.
    pub boxes_per_hour: Option<f64>,
    /// False boxes of confirmed tracks an hour and view.
    pub confirmed_boxes_per_hour: Option<f64>,
    /// False confirmed tracks an hour and view.
    pub confirmed_tracks_per_hour: Option<f64>,
    /// Confirmed tracks per hour of the corpus's own video.
    pub confirmed_tracks_per_video_hour: Option<f64>,
}

/// Counts by weather.
#[derive(Debug, Clone, Default)]
pub(crate) struct AlarmTally {
    by_weather: BTreeMap<String, AlarmCounts>,
}

impl AlarmTally {
    pub(crate) fn count(&mut self, weather: &str, period_s: f64, searched: &[Searched<'_>]) {
        let mut counts = AlarmCounts {
            pictures: searched.len() as u64,
            video_hours: searched.len() as f64 * period_s / 3_600.0,
            ..Default::default()
        };
        let (mut suspected, mut real) = (BTreeSet::new(), BTreeSet::new());
        for searched in searched {
            let view = searched.picture.view;
            let tracks =
                |found: &&dataset::corpus::detections::Detection| Some((view, found.track?));
            let false_boxes: Vec<_> = searched.false_boxes().collect();
            counts.boxes += false_boxes.len() as u64;
            for found in false_boxes.iter().filter(|found| found.confirmed) {
                counts.confirmed_boxes += 1;
                match tracks(found) {
                    Some(track) => _ = suspected.insert(track),
                    None => counts.confirmed_tracks += 1,
                }
            }
            let is_false = |found: &&dataset::corpus::detections::Detection| {
                false_boxes.iter().any(|other| std::ptr::eq(*other, *found))
            };
            let true_boxes = searched.boxes.iter().filter(|found| !is_false(found));
            real.extend(true_boxes.filter_map(tracks));
        }
        counts.confirmed_tracks += suspected.difference(&real).count() as u64;
        *self.by_weather.entry(weather.to_owned()).or_default() += counts;
    }

    /// False alarms in the weathers that are `wanted`.
    pub(crate) fn of(&self, wanted: impl Fn(&str) -> bool) -> FalseAlarms {
        let mut sum = AlarmCounts::default();
        for (weather, counts) in &self.by_weather {
            if wanted(weather) {
                sum += *counts;
            }
        }
        FalseAlarms::of(sum)
    }
}

impl FalseAlarms {
    fn of(counts: AlarmCounts) -> Self {
        let hours = counts.pictures as f64 / f64::from(PICTURES_PER_HOUR);
        let rate = |number: u64| (counts.pictures > 0).then(|| number as f64 / hours);
        Self {
            hours,
            boxes_per_hour: rate(counts.boxes),
            confirmed_boxes_per_hour: rate(counts.confirmed_boxes),
            confirmed_tracks_per_hour: rate(counts.confirmed_tracks),
            confirmed_tracks_per_video_hour: (counts.video_hours > 0.0)
                .then(|| counts.confirmed_tracks as f64 / counts.video_hours),
            counts,
        }
    }
}

impl AddAssign for AlarmCounts {
    fn add_assign(&mut self, other: Self) {
        self.pictures += other.pictures;
        self.video_hours += other.video_hours;
        self.boxes += other.boxes;
        self.confirmed_boxes += other.confirmed_boxes;
        self.confirmed_tracks += other.confirmed_tracks;
    }
}

#[cfg(test)]
mod tests {
    use dataset::corpus::detections::{Detection, Detections};

    use super::*;
    use crate::samples::{picture, seen};

    fn alarms(boxes: Vec<Detection>) -> FalseAlarms {
        let pictures: Vec<_> = (0..54).map(|tick| picture(tick, 0, 5.0)).collect();
        let mut tally = AlarmTally::default();
        let views = ["left".to_owned()];
        let detections: Detections = boxes.into();
        tally.count(
            "clear",
            10.0,
            &Searched::all(&pictures, &views, &detections),
        );
        tally.of(|_| true)
    }

    fn tracked(tick: u32, cx_px: f64, track: u32, confirmed: bool) -> Detection {
        Detection {
            track: Some(track),
            confirmed,
            ..seen(tick, "left", cx_px, 0.9)
        }
    }

    #[test]
    fn a_false_track_is_one_alarm_however_long_it_lasts() {
        let mut boxes = vec![
            tracked(0, 100.0, 0, true), // the aircraft
            tracked(1, 900.0, 0, true), // its track slips for a moment: false boxes, but no alarm
            tracked(0, 500.0, 2, false),
        ];
        boxes.extend((0..10).map(|tick| tracked(tick, 700.0, 1, tick >= 3)));
        let found = alarms(boxes);
        let expected = AlarmCounts {
            pictures: 54,
            video_hours: 0.15,
            boxes: 12,
            confirmed_boxes: 8,
            confirmed_tracks: 1,
        };
        assert_eq!(found.counts, expected);
        // 54 images take 1/2000 h.
        assert_eq!(found.hours, 0.0005);
        assert_eq!(found.boxes_per_hour, Some(24_000.0));
        assert_eq!(found.confirmed_tracks_per_hour, Some(2_000.0));
        assert_eq!(found.confirmed_tracks_per_video_hour, Some(1.0 / 0.15));
    }

    #[test]
    fn without_tracks_every_false_box_is_an_alarm() {
        let found = alarms(vec![
            seen(0, "left", 700.0, 0.9),
            seen(1, "left", 700.0, 0.9),
            seen(1, "left", 100.0, 0.9),
        ]);
        assert_eq!((found.counts.boxes, found.counts.confirmed_tracks), (2, 2));
    }

    #[test]
    fn no_pictures_have_no_rate() {
        assert_eq!(AlarmTally::default().of(|_| true).boxes_per_hour, None);
    }
}
