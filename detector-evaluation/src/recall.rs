//! Recall, the share of expected aircraft that were found, by distance, weather, time of day and obstruction; and the ranges that follow.
//!
//! Every image is counted once: not expected, found, or missed for a reason.

mod wilson;

use std::collections::BTreeMap;
use std::ops::AddAssign;

use serde::Serialize;

use crate::outcome::{Outcome, Searched};
use dataset::conditions::sight::Sight;

/// Width of the bins of distance, nautical miles.
pub(crate) const BIN_NM: f64 = 0.5;
/// Distances of the overall figures, nautical miles. Nearer ones are left out: the masts of the default rig stand almost a mile beyond
/// the touchdown target, and the cameras of the paper's recordings lose the aircraft at 1.5 NM.
pub(crate) const OVERALL_NM: [f64; 2] = [1.0, 10.0];
/// The paper's success rate within the effective range.
const EFFECTIVE_SHARE: f64 = 0.99;

/// Counts of expected aircraft.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct Counts {
    /// Images with most of the aircraft inside the frame.
    pub expected: u64,
    /// Images with a detection.
    pub found: u64,
    /// Images with a detection on a confirmed track.
    pub confirmed: u64,
    /// The others, by reason.
    pub missed: BTreeMap<String, u64>,
}

/// Recall with its 95 % interval (Wilson).
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Recall {
    /// Counts behind the share.
    #[serde(flatten)]
    pub counts: Counts,
    /// Share of the expected aircraft that was found; null if none was expected.
    pub recall: Option<f64>,
    /// 95 % interval of the recall.
    pub interval: [f64; 2],
    /// Recall for confirmed tracks.
    pub confirmed_recall: Option<f64>,
}

/// Recall in a bin of distances.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RecallBin {
    /// Smallest distance to touchdown, nautical miles, included.
    pub from_nm: f64,
    /// Largest distance, excluded.
    pub to_nm: f64,
    /// The figures.
    #[serde(flatten)]
    pub recall: Recall,
}

/// Detection range, nautical miles to touchdown.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Range {
    /// Farthest detection, nautical miles.
    pub max_range_nm: Option<f64>,
    /// The distance up to which more than 99 % are found in every bin from a mile on; null if not even there.
    pub effective_range_nm: Option<f64>,
    /// Effective ranges for the ends of each bin's 95 % interval. Below 381 images per bin the lower end never exceeds 99 %.
    pub effective_range_interval_nm: [Option<f64>; 2],
    /// Farthest image that should show the aircraft: no range can be longer.
    pub farthest_expected_nm: Option<f64>,
}

/// Images without an expected aircraft.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct NotExpected {
    /// The aircraft is outside the frame, or below the ground.
    pub absent: u64,
    /// Half of the aircraft, or less, is visible.
    pub barely_visible: u64,
}

/// Image group.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
struct Group {
    weather: String,
    time_of_day: String,
    sight: Sight,
    bin: i64,
}

/// A mode's counts.
#[derive(Debug, Clone, Default)]
pub(crate) struct RecallTally {
    groups: BTreeMap<Group, Counts>,
    not_expected: NotExpected,
    /// Farthest detection and farthest aircraft in sight, by weather.
    farthest_nm: BTreeMap<String, [Option<f64>; 2]>,
}

impl RecallTally {
    pub(crate) fn count(&mut self, weather: &str, time_of_day: &str, searched: &[Searched<'_>]) {
        let farthest = self.farthest_nm.entry(weather.to_owned()).or_default();
        let farther = |there: &mut Option<f64>, nm: f64| {
            *there = Some(there.map_or(nm, |before| before.max(nm)));
        };
        for searched in searched {
            let picture = searched.picture;
            let Some(outcome) = searched.outcome() else {
                match picture.truth {
                    None => self.not_expected.absent += 1,
                    Some(_) => self.not_expected.barely_visible += 1,
                }
                continue;
            };
            let group = Group {
                weather: weather.to_owned(),
                time_of_day: time_of_day.to_owned(),
                sight: picture.sight,
                bin: bin_of(picture.distance_nm),
            };
            let counts = self.groups.entry(group).or_default();
            counts.expected += 1;
            if picture.sight == Sight::Open {
                farther(&mut farthest[1], picture.distance_nm);
            }
            match outcome {
                Outcome::Found(hit) => {
                    counts.found += 1;
                    counts.confirmed += u64::from(hit.confirmed);
                    farther(&mut farthest[0], picture.distance_nm);
                }
                Outcome::Missed(reason) => *counts.missed.entry(reason.into()).or_default() += 1,
            }
        }
    }

    pub(crate) fn not_expected(&self) -> NotExpected {
        self.not_expected
    }

    /// All images that were counted.
    pub(crate) fn pictures(&self) -> u64 {
        let NotExpected {
            absent,
            barely_visible,
        } = self.not_expected;
        let expected: u64 = self.groups.values().map(|counts| counts.expected).sum();
        absent + barely_visible + expected
    }

    /// Names of the weathers.
    pub(crate) fn weathers(&self) -> impl Iterator<Item = &String> {
        self.farthest_nm.keys()
    }

    /// Local times.
    pub(crate) fn times(&self) -> Vec<String> {
        let mut times: Vec<_> = self.groups.keys().map(|group| &group.time_of_day).collect();
        times.sort();
        times.dedup();
        times.into_iter().cloned().collect()
    }

    /// Weathers that never hide the aircraft; all, if each does.
    pub(crate) fn open_weathers(&self) -> Vec<String> {
        let hides = |weather: &String| {
            self.groups
                .keys()
                .any(|group| group.weather == *weather && group.sight != Sight::Open)
        };
        let open: Vec<_> = self.weathers().filter(|weather| !hides(weather)).collect();
        if open.is_empty() {
            self.weathers().cloned().collect()
        } else {
            open.into_iter().cloned().collect()
        }
    }

    /// Counts over all distances, by obstruction.
    pub(crate) fn by_sight(
        &self,
        wanted: impl Fn(&Condition<'_>) -> bool,
    ) -> BTreeMap<Sight, Counts> {
        let mut sums: BTreeMap<_, Counts> = BTreeMap::new();
        for (group, counts) in &self.groups {
            if wanted(&Condition::of(group)) {
                *sums.entry(group.sight).or_default() += counts;
            }
        }
        sums
    }

    /// Recall of the aircraft in sight between `OVERALL_NM`.
    pub(crate) fn overall(&self, wanted: impl Fn(&Condition<'_>) -> bool) -> Recall {
        let [from, to] = OVERALL_NM.map(bin_of);
        let mut sum = Counts::default();
        for (bin, counts) in self.bins(wanted) {
            if (from..to).contains(&bin) {
                sum += &counts;
            }
        }
        Recall::of(sum)
    }

    /// Recall of the aircraft in sight, bin by bin; bins without images are left out. Past touchdown there is one bin.
    pub(crate) fn by_distance(&self, wanted: impl Fn(&Condition<'_>) -> bool) -> Vec<RecallBin> {
        let bins = self.bins(wanted).into_iter();
        bins.map(|(bin, counts)| RecallBin {
            from_nm: bin as f64 * BIN_NM,
            to_nm: (bin + 1) as f64 * BIN_NM,
            recall: Recall::of(counts),
        })
        .collect()
    }

    /// Ranges in some weathers.
    pub(crate) fn range(&self, weathers: &[String]) -> Range {
        let bins =
            self.by_distance(|condition| weathers.iter().any(|name| name == condition.weather));
        let farthest = |which: usize| {
            let here = weathers
                .iter()
                .filter_map(|name| self.farthest_nm.get(name));
            here.filter_map(|farthest| farthest[which]).reduce(f64::max)
        };
        let farthest_expected_nm = farthest(1);
        let effective = |share: fn(&Recall) -> Option<f64>| {
            let range = effective_range_nm(&bins, share)?;
            // The last bin may be half empty.
            Some(farthest_expected_nm.map_or(range, |farthest| range.min(farthest)))
        };
        Range {
            max_range_nm: farthest(0),
            effective_range_nm: effective(|recall| recall.recall),
            effective_range_interval_nm: [
                effective(|recall| Some(recall.interval[0])),
                effective(|recall| Some(recall.interval[1])),
            ],
            farthest_expected_nm,
        }
    }

    fn bins(&self, wanted: impl Fn(&Condition<'_>) -> bool) -> BTreeMap<i64, Counts> {
        let mut bins: BTreeMap<_, Counts> = BTreeMap::new();
        for (group, counts) in &self.groups {
            if group.sight == Sight::Open && wanted(&Condition::of(group)) {
                *bins.entry(group.bin).or_default() += counts;
            }
        }
        bins
    }
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct Condition<'a> {
    pub(crate) weather: &'a str,
    pub(crate) time_of_day: &'a str,
}

impl<'a> Condition<'a> {
    fn of(group: &'a Group) -> Self {
        Self {
            weather: &group.weather,
            time_of_day: &group.time_of_day,
        }
    }
}

/// Distance bin; all distances past touchdown share one.
fn bin_of(distance_nm: f64) -> i64 {
    ((distance_nm / BIN_NM).floor() as i64).max(-1)
}

/// The far end of the last of the bins from `OVERALL_NM` on that all have more than [`EFFECTIVE_SHARE`].
fn effective_range_nm(bins: &[RecallBin], share: fn(&Recall) -> Option<f64>) -> Option<f64> {
    bins.iter()
        .filter(|bin| bin.from_nm >= OVERALL_NM[0])
        .take_while(|bin| share(&bin.recall).is_some_and(|share| share > EFFECTIVE_SHARE))
        .last()
        .map(|bin| bin.to_nm)
}

impl Recall {
    fn of(counts: Counts) -> Self {
        let share = |part: u64| (counts.expected > 0).then(|| part as f64 / counts.expected as f64);
        Self {
            recall: share(counts.found),
            interval: wilson::interval(counts.found, counts.expected),
            confirmed_recall: share(counts.confirmed),
            counts,
        }
    }
}

impl AddAssign<&Counts> for Counts {
    fn add_assign(&mut self, other: &Counts) {
        self.expected += other.expected;
        self.found += other.found;
        self.confirmed += other.confirmed;
        for (reason, pictures) in &other.missed {
            *self.missed.entry(reason.clone()).or_default() += pictures;
        }
    }
}

#[cfg(test)]
mod tests {
    use dataset::corpus::detections::Detections;

    use super::*;
    use crate::outcome::picture::Picture;
    use crate::samples::{picture, seen};

    const ALL: fn(&Condition<'_>) -> bool = |_| true;

    fn tally(weather: &str, pictures: &[Picture], found: &[u32]) -> RecallTally {
        let mut tally = RecallTally::default();
        add(&mut tally, weather, pictures, found);
        tally
    }

    fn add(tally: &mut RecallTally, weather: &str, pictures: &[Picture], found: &[u32]) {
        let boxes = found.iter().map(|&tick| seen(tick, "left", 100.0, 0.9));
        let detections: Detections = boxes.collect::<Vec<_>>().into();
        let views = ["left".to_owned()];
        tally.count(
            weather,
            "12:00",
            &Searched::all(pictures, &views, &detections),
        );
    }

    /// 200 images in each bin from 0 up to `to_nm`, the nearest first.
    fn approach(to_nm: f64) -> Vec<Picture> {
        let ticks = 0..(to_nm / BIN_NM) as u32 * 200;
        ticks
            .map(|tick| picture(tick, 0, f64::from(tick) * BIN_NM / 200.0))
            .collect()
    }

    #[test]
    fn every_picture_is_counted_once() {
        let mut pictures = approach(2.0);
        pictures[0].truth = None;
        pictures[1].truth.as_mut().unwrap().visible_fraction = 0.4;
        pictures[2].sight = Sight::Haze;
        pictures[3].sight = Sight::Cloud;
        pictures[4].distance_nm = -0.7;
        let tally = tally("clear", &pictures, &[2, 4, 5]);
        assert_eq!(tally.pictures(), pictures.len() as u64);
        let not_expected = NotExpected {
            absent: 1,
            barely_visible: 1,
        };
        assert_eq!(tally.not_expected(), not_expected);
        let by_sight = tally.by_sight(ALL);
        let of = |sight| {
            let counts: &Counts = &by_sight[&sight];
            let missed: u64 = counts.missed.values().sum();
            assert_eq!(counts.found + missed, counts.expected);
            (counts.expected, counts.found)
        };
        assert_eq!(of(Sight::Haze), (1, 1));
        assert_eq!(of(Sight::Cloud), (1, 0));
        assert_eq!(of(Sight::Open), (796, 2));
        let bins = tally.by_distance(ALL);
        assert_eq!((bins[0].from_nm, bins[0].recall.counts.expected), (-0.5, 1));
        let in_bins: u64 = bins.iter().map(|bin| bin.recall.counts.expected).sum();
        assert_eq!(in_bins, 796);
    }

    #[test]
    fn the_effective_range_ends_before_the_first_bin_with_99_percent_or_less() {
        let pictures = approach(13.0);
        let farthest = pictures.last().unwrap().distance_nm;
        // One of 200 is missed in the bin from 6 NM, two in that from 8, all from 12 but one.
        let missed = |tick: &u32| match tick {
            2_400 | 3_200 | 3_201 => true,
            tick => (4_800..5_100).contains(tick) || *tick > 5_100,
        };
        let found: Vec<_> = (0..5_200).filter(|tick| !missed(tick)).collect();
        let range = tally("clear", &pictures, &found).range(&["clear".into()]);
        assert_eq!(range.effective_range_nm, Some(8.0));
        // 200 of 200 leave 98.1 %; the upper end of 198 of 200 is 99.7 %.
        assert_eq!(range.effective_range_interval_nm, [None, Some(12.0)]);
        assert_eq!(range.max_range_nm, Some(12.75));
        assert_eq!(range.farthest_expected_nm, Some(farthest));
    }

    #[test]
    fn with_twice_as_many_pictures_the_lower_end_of_the_interval_is_a_range_too() {
        let pictures = approach(4.0);
        let all: Vec<_> = (0..1_600).collect();
        let mut tally = tally("clear", &pictures, &all);
        add(&mut tally, "clear", &pictures, &all);
        let range = tally.range(&["clear".into()]);
        let farthest = range.farthest_expected_nm;
        assert_eq!(
            range.effective_range_nm, farthest,
            "not beyond the last image"
        );
        assert_eq!(range.effective_range_interval_nm, [farthest, farthest]);
    }

    #[test]
    fn what_happens_below_a_mile_does_not_end_the_range() {
        let found: Vec<_> = (400..1_600).collect();
        let tally = tally("clear", &approach(4.0), &found);
        assert!(tally.range(&["clear".into()]).effective_range_nm > Some(3.9));
        assert_eq!(tally.overall(ALL).recall, Some(1.0));
        let nothing = tally.range(&["foggy".into()]);
        assert_eq!(
            (nothing.max_range_nm, nothing.effective_range_nm),
            (None, None)
        );
    }

    #[test]
    fn weathers_that_hide_the_aircraft_somewhere_are_not_open() {
        let pictures = approach(2.0);
        let mut foggy = pictures.clone();
        foggy[799].sight = Sight::Haze;
        let mut tally = tally("clear", &pictures, &[]);
        add(&mut tally, "foggy", &foggy, &[]);
        assert_eq!(tally.open_weathers(), ["clear"]);
        assert_eq!(self::tally("foggy", &foggy, &[]).open_weathers(), ["foggy"]);
        let expected = |weather: &str| tally.overall(|at| at.weather == weather).counts.expected;
        assert_eq!((expected("clear"), expected("foggy")), (400, 399));
    }
}
