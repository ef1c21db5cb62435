//! Correction for late images.
//!
//! A late image shows where the aircraft was before, so boxes and shifts are moved along the path that the view itself saw; where that is
//! unknown, the view is ignored. Errors of the path make each shift less certain. An error in the lag is common to the whole flight.
//!
//! A run knows which row of a view belongs to a place in another ([`Pair`]), to hundredths of a pixel, and with it flights tell lags to
//! some milliseconds, and when they change ([`lags_by`]); live, the images up to now do ([`PastLags`]). Without such rows, as in training
//! and with other cameras, rows follow from the planned cameras ([`lag_by_cameras`]). These may be off by half a degree: wrong directions,
//! rolls and focal lengths displace rows by a linear function of the places, which is fitted with the lag.

mod past;

use std::collections::BTreeMap;

use dataset::geometry::camera::Camera;
use dataset::geometry::rays::{EpipolarLine, across_sd_px};
use dataset::numbers::motion::scatter;
use dataset::work::watch::Watch;
use glam::DVec2;
use sight::lag::{
    self, Lag, PLACE_TERMS, Rows, Sighting, lag_at, moved, moved_sd_px, with_one_lag,
};
use sight::sight::{CERTAIN_SD, CONTRADICTS_SD};

use crate::samples::camera_health::{Corrections, first_of};
use crate::samples::trusted_boxes::centre_and_size;
use crate::samples::{CommonError, Observation, ScenarioSummary};

/// Standard deviation of a lag, relative to it. Views that were five seconds late (`late-5s` of scripts/moved_cameras.py) had lags that
/// were off by up to 1 % in clear weather, and by up to 9 % in fog, where only the last five miles are seen.
const PART_SD: f64 = 0.03;
/// Maximum scatter of the rows after a fit of the lag, in their standard deviations. More shows two aircraft: pairs of flights had 2.6 to
/// 45 after half a minute (tests/judges/live_wrong_views.py). In 90 flights of one aircraft, late or not, it was at most 1.44
/// (scripts/moved_cameras.py).
const MAX_EXCESS: f64 = 2.0;
/// Minimum standard deviation of a lag, s. More sightings do not reduce it: views from two sides see different parts of near aircraft, and
/// wrong directions of cameras resemble a lag. Of 275 clean flights whose sightings left less, lags by planned cameras were 8 ms (root mean
/// square).
const MIN_LAG_SD_S: f64 = 0.01;
/// Standard deviations of what planned cameras add to rows, pixels: a constant, and slopes over a thousand pixels, for masts surveyed to
/// half a degree. Within a few miles of the runway, the only part visible in fog, the motion is nearly a linear function of the places.
const PLANNED_SD_PX: [f64; PLACE_TERMS] = [100.0, 12.0, 12.0, 12.0];
/// Minimum number of sightings for a lag by planned cameras.
const MIN_SIGHTINGS: usize = 40;
/// Minimum lag by planned cameras, s: 0.04 % of the distance at ten kilometres, with masts 600 m apart.
const MIN_LAG_S: f64 = 0.1;
/// Changes of one view's lag that two pairs of views tell are the same if they are so near, s: an image every two seconds.
const SAME_CHANGE_S: f64 = 2.0;
/// What the cameras of a flight add to the rows that a run expects, beside their directions, pixels: a constant, and slopes over a thousand
/// pixels. Constants of 24 training flights had 0.02 px; with these slopes, ten recorded flights tell drifts as well as they state.
const ROW_SD_PX: f64 = 0.05;
const SLOPE_SD_PX: f64 = 0.06;

pub(crate) use past::PastLags;

/// Box centres by time, s.
type Path = Vec<(f64, DVec2)>;

/// Two views whose rows a run knows.
pub(crate) struct Pair<'a> {
    /// The reference view and the second one.
    pub views: [usize; 2],
    /// Pixels down from the expected row in the second view, by the places in both.
    pub off_px: Box<dyn Fn([DVec2; 2]) -> f64 + 'a>,
    /// Standard deviation of rows in training, pixels.
    pub row_sd_px: f64,
    /// Standard deviation of the lags that these rows tell of punctual flights, s.
    pub lag_sd_s: f64,
}

impl Pair<'_> {
    /// Lag of a flight, if it does not change, seconds; `None` of too few sightings.
    pub(crate) fn lag_s(&self, flight: &[&Observation]) -> Option<f64> {
        let fit = self.fitted(flight, |tracks, rows| lag::constant(tracks, rows, 0.0))?;
        Some(fit.lags[0].seconds)
    }

    /// Lags of the second view, with what more sightings of the flight do not reduce; none if it shows another aircraft.
    fn lags(&self, flight: &[&Observation]) -> Option<Vec<Lag>> {
        let mut fit = self.fitted(flight, lag::changing)?;
        if fit.excess > MAX_EXCESS {
            return Some(vec![Lag {
                from_s: f64::NEG_INFINITY,
                seconds: 0.0,
                sd_s: 0.0,
            }]);
        }
        for lag in &mut fit.lags {
            lag.sd_s = lag.sd_s.hypot(self.lag_sd_s);
        }
        Some(fit.lags)
    }

    fn fitted(
        &self,
        flight: &[&Observation],
        fit: impl Fn(&[Vec<Sighting>], &Rows) -> Option<lag::Fit>,
    ) -> Option<lag::Fit> {
        let tracks = sightings(self.views, self.row_sd_px, flight);
        let row_sds_px = flight.iter().filter_map(|observed| {
            observed.registered_places(self.views)?;
            Some(observed.row_sd_px(self.views, ROW_SD_PX))
        });
        let row_sd_px = row_sds_px.fold(ROW_SD_PX.max(self.row_sd_px), f64::max);
        let slope_sd_px = SLOPE_SD_PX.hypot(row_sd_px - ROW_SD_PX);
        let mut sd_px = [slope_sd_px; PLACE_TERMS];
        sd_px[0] = row_sd_px;
        let off_px = |places_px: [DVec2; 2]| Some((self.off_px)(places_px));
        fit(
            &tracks,
            &Rows {
                off_px: &off_px,
                sd_px,
            },
        )
    }
}

/// What two views see, by the tracks of both: of one aircraft each.
fn sightings(views: [usize; 2], min_sd_px: f64, flight: &[&Observation]) -> Vec<Vec<Sighting>> {
    let mut tracks: BTreeMap<[Option<u32>; 2], Vec<Sighting>> = BTreeMap::new();
    for observed in flight {
        let seen = observed.registered_places(views);
        let Some(((shift, places_px), seen)) = seen.zip(observed.best(views[0])) else {
            continue;
        };
        let own_sd_px = shift.sd_px.y.hypot(across_sd_px(seen.width_px));
        let of_tracks = tracks.entry(views.map(|view| observed.track(view)));
        of_tracks.or_default().push(Sighting {
            time_s: observed.time_s(),
            taken_off_s: 0.0,
            places_px,
            width_px: seen.width_px,
            sd_px: own_sd_px.max(min_sd_px),
        });
    }
    tracks.into_values().collect()
}

/// Lag of the second view by its epipolar lines in the planned cameras of both, if that is sure.
fn lag_by_cameras(
    views: [usize; 2],
    cameras: [&Camera; 2],
    flight: &[&Observation],
) -> Option<Lag> {
    let rows = Rows {
        off_px: &|[first, second]| Some(EpipolarLine::of(cameras, first)?.off_px(second)),
        sd_px: PLANNED_SD_PX,
    };
    let fit = lag::constant(&sightings(views, 0.0, flight), &rows, 0.0)?;
    let lag = fit.lags[0];
    // Twice what none of 385 flights without a lag reached.
    let is_sure = lag.seconds.abs() >= MIN_LAG_S.max(CERTAIN_SD * sd_s(&lag));
    (is_sure && fit.sightings >= MIN_SIGHTINGS).then_some(lag)
}

/// Lags per view by the rows of a flight, or else by its planned cameras; `None` if neither tells any.
fn lags_by(pairs: &[Pair], cameras: &[Camera], flight: &[&Observation]) -> Option<Vec<Vec<Lag>>> {
    let mut shifts = flight
        .iter()
        .flat_map(|observed| observed.shifts.iter().flatten());
    let reference = shifts.next()?.reference;
    let views = flight[0].views();
    let mut measured: Vec<(usize, Vec<Lag>)> = (pairs.iter())
        .filter(|pair| pair.views[0] == reference)
        .filter_map(|pair| Some((pair.views[1], pair.lags(flight)?)))
        .collect();
    if measured.is_empty() {
        let others = (0..cameras.len()).filter(|view| *view != reference);
        measured.extend(others.filter_map(|view| {
            let views = [reference, view];
            let lag = lag_by_cameras(views, views.map(|view| &cameras[view]), flight)?;
            Some((view, vec![lag]))
        }));
    }
    if measured.is_empty() {
        return None;
    }
    let firsts = measured.iter().map(|(_, lags)| counted(lags[0]).seconds);
    let first_s = firsts.fold(0.0, f64::min);
    let mut of_views = vec![Vec::new(); views];
    // An image shows the past, never the future: of two views that disagree, the one that shows the earlier aircraft is late.
    of_views[reference].push(Lag {
        from_s: f64::NEG_INFINITY,
        seconds: -first_s,
        sd_s: 0.0,
    });
    let mut changes: Vec<(usize, Lag)> = Vec::new();
    for (view, lags) in measured {
        let first = counted(lags[0]);
        let seconds = first.seconds - first_s;
        // Moved by the reference's lag alone, it is as uncertain as its own.
        let sd_s = if seconds == first.seconds {
            first.sd_s
        } else {
            sd_s(&lags[0])
        };
        of_views[view].push(Lag {
            seconds,
            sd_s,
            ..first
        });
        for change in lags.windows(2) {
            let (from_s, longer_s) = (change[1].from_s, change[1].seconds - change[0].seconds);
            let (lost, by_s) = match skipping(flight, [reference, view], from_s, longer_s)? {
                0 => (reference, -longer_s),
                _ => (view, longer_s),
            };
            let is_known = |(of, known): &(usize, Lag)| {
                *of == lost && (known.from_s - from_s).abs() <= SAME_CHANGE_S
            };
            if !changes.iter().any(is_known) {
                changes.push((
                    lost,
                    Lag {
                        seconds: by_s,
                        ..change[1]
                    },
                ));
            }
        }
    }
    changes.sort_by(|(_, a), (_, b)| a.from_s.total_cmp(&b.from_s));
    for (view, change) in changes {
        let before_s = of_views[view].last().map_or(0.0, |lag| lag.seconds);
        let after = counted(Lag {
            seconds: before_s + change.seconds,
            ..change
        });
        of_views[view].push(after);
    }
    Some(of_views)
}

/// A lag, if it is more than chance; of recordings that are as synchronous as their ticks say, it is none.
fn counted(lag: Lag) -> Lag {
    let sd_s = sd_s(&lag);
    // 32 flights without a lag had up to 1.8 standard deviations.
    if lag.seconds.abs() >= CONTRADICTS_SD * sd_s {
        return Lag { sd_s, ..lag };
    }
    Lag {
        seconds: 0.0,
        sd_s: 0.0,
        ..lag
    }
}

/// Standard deviation of a lag, with what more sightings do not reduce.
fn sd_s(lag: &Lag) -> f64 {
    let systematic_s = MIN_LAG_SD_S.hypot(PART_SD * lag.seconds);
    lag.sd_s.hypot(systematic_s)
}

/// The view, of two, whose own path skips some seconds at a time, by which the lag of the second one grows; `None` if neither does: then
/// it is not their times that changed.
fn skipping(flight: &[&Observation], views: [usize; 2], at_s: f64, longer_s: f64) -> Option<usize> {
    let skipped = views.map(|view| {
        let later = flight
            .iter()
            .filter(|of| of.time_s() >= at_s && of.best(view).is_some());
        let track = later.map(|of| of.track(view)).next()?;
        let of_track = flight.iter().filter(|of| of.track(view) == track);
        let seen = of_track.filter_map(|observed| {
            let (place_px, _) = centre_and_size(observed.best(view)?);
            Some((observed.time_s(), place_px))
        });
        lag::skipped_s(&seen.collect::<Vec<_>>(), at_s)
    });
    let off = |view: usize, expected_s: f64| {
        let [found_s, sd_s] = skipped[view].unwrap_or([0.0, f64::INFINITY]);
        ((found_s - expected_s) / sd_s.max(MIN_LAG_SD_S)).powi(2)
    };
    // A lost image lets a path skip forwards: the lag of the second view falls.
    let by_view = [
        off(0, longer_s) + off(1, 0.0),
        off(0, 0.0) + off(1, -longer_s),
    ];
    let by_none = off(0, 0.0) + off(1, 0.0);
    let view = usize::from(by_view[1] <= by_view[0]);
    (by_view[view] < by_none).then_some(view)
}

/// True for a lag that moves boxes, or makes them less certain.
fn is_corrected(lag: &Lag) -> bool {
    lag.seconds != 0.0 || lag.sd_s != 0.0
}

/// Corrects the ticks of a flight for the lags of each view, and counts the changes.
fn in_time(flight: &mut [&mut Observation], lags: &[Vec<Lag>], counts: &mut Corrections) {
    if !lags.iter().flatten().any(is_corrected) {
        return;
    }
    let mut tracks: BTreeMap<(usize, Option<u32>), Path> = BTreeMap::new();
    for observed in flight.iter() {
        for (view, seen) in observed.seen() {
            let track = tracks.entry((view, observed.track(view))).or_default();
            track.push((observed.time_s(), centre_and_size(seen).0));
        }
    }
    let paths = tracks.iter().flat_map(|(key, places)| {
        let parts = with_one_lag(places, &lags[key.0], |(time_s, _)| *time_s);
        parts.map(move |part| (*key, part, scatter(part)))
    });
    let paths: Vec<_> = paths.collect();
    for observed in flight {
        let time_s = observed.time_s();
        // Per view: movement, its standard deviation, and the error that the lag leaves.
        let motions = (0..lags.len()).map(|view| {
            let lag = lag_at(&lags[view], time_s).filter(is_corrected);
            let Some(lag) = lag else {
                return Some([DVec2::ZERO; 3]);
            };
            let key = (view, observed.track(view));
            let path = paths.iter().find(|(of, part, _)| {
                let ends = part.first().zip(part.last());
                *of == key && ends.is_some_and(|(first, last)| (first.0..=last.0).contains(&time_s))
            });
            let ends = path.and_then(|(_, part, scatter_px)| {
                Some((moved(part, time_s, lag.seconds)?, *scatter_px))
            });
            match ends {
                Some((ends, scatter_px)) => Some([
                    ends[1].place - ends[0].place,
                    moved_sd_px(&ends, lag.seconds, scatter_px),
                    lag.sd_s * ends[1].per_s,
                ]),
                None if lag.seconds == 0.0 => Some([DVec2::ZERO; 3]),
                None => None,
            }
        });
        let motions: Vec<Option<[DVec2; 3]>> = motions.collect();
        for (view, _) in observed.seen() {
            if lag_at(&lags[view], time_s).is_none_or(|lag| lag.seconds == 0.0) {
                continue;
            }
            match motions[view] {
                Some(_) => counts.late += 1,
                None => counts.late_withheld += 1,
            }
        }
        let of = |view: usize, number: usize| motions[view].unwrap_or_default()[number];
        // Its image does not show that there is no aircraft.
        let is_withheld = |view: usize| observed.best(view).is_some() && motions[view].is_none();
        **observed = observed
            .without_images(is_withheld)
            .moved(|view, place_px| Some(place_px + motions[view]?[0]))
            .widened(|view| of(view, 1))
            .with_common((0..lags.len()).map(|view| CommonError {
                view,
                sd_px: of(view, 2),
            }));
    }
}

/// Corrects whole flights: by the rows of these pairs, or else by the planned cameras. Returns lines for users.
pub(crate) fn put_in_time<'a>(
    views: &[String],
    scenarios: &mut [ScenarioSummary],
    observations: impl Iterator<Item = &'a mut Observation>,
    pairs: &[Pair],
) -> Vec<String> {
    let mut all: Vec<&mut Observation> = observations.collect();
    let mut lines = Vec::new();
    for flight in all.chunk_by_mut(|a, b| a.scenario == b.scenario) {
        let scenario = &mut scenarios[flight[0].scenario];
        let seen: Vec<&Observation> = flight.iter().map(|observed| &**observed).collect();
        if let Some(lags) = lags_by(pairs, &scenario.cameras, &seen) {
            in_time(flight, &lags, &mut scenario.corrections);
            lines.extend(named(&scenario.id, views, &lags));
        }
    }
    lines
}

/// Warns of the first of these lines.
pub(crate) fn warn_of_lags(lines: &[String], watch: &dyn Watch) {
    if let Some(line) = first_of(lines) {
        watch.warn(&format!("{line}; its boxes are moved along its own path, or left out where that is not known, and intervals include what remains uncertain"));
    }
}

/// Lines for users: which views were late or early, by how much, and from when on.
fn named(scenario: &str, views: &[String], lags: &[Vec<Lag>]) -> Vec<String> {
    let of_views = views.iter().zip(lags).flat_map(|(view, lags)| {
        let counting = lags.iter().filter(|lag| lag.seconds != 0.0);
        counting.map(move |lag| {
            let direction = if lag.seconds > 0.0 { "late" } else { "early" };
            let since = if lag.from_s.is_finite() {
                format!(" from {:.1} s on", lag.from_s)
            } else {
                String::new()
            };
            format!(
                "{scenario}: view {view} is {:.2} s {direction}{since} (standard deviation {:.2} s)",
                lag.seconds.abs(),
                lag.sd_s
            )
        })
    });
    of_views.collect()
}

#[cfg(test)]
mod tests {
    use dataset::geometry::geodesy::Geodetic;
    use testkit::changi_02l;
    use testkit::rig::{VIEWS, placed};

    use super::*;
    use crate::samples::Look;

    const LATE_S: f64 = 0.45;

    fn lag(from_s: f64, seconds: f64) -> Lag {
        Lag {
            from_s,
            seconds,
            sd_s: 0.03,
        }
    }

    /// The second view is late.
    fn late() -> Vec<Vec<Lag>> {
        vec![Vec::new(), vec![lag(f64::NEG_INFINITY, LATE_S)]]
    }

    /// Ticks from two views; the second is late.
    fn flight(late_s: f64) -> Vec<Observation> {
        let tick = |tick: u32| {
            let time_s = f64::from(tick);
            let columns = [300.0 + 4.0 * time_s, 500.0 + 20.0 * (time_s - late_s)];
            Observation::registered(tick, columns)
        };
        (0..20).map(tick).collect()
    }

    fn in_time_by(
        lags: &[Vec<Lag>],
        mut flight: Vec<Observation>,
    ) -> (Vec<Observation>, Corrections) {
        let mut counts = Corrections::default();
        in_time(
            &mut flight.iter_mut().collect::<Vec<_>>(),
            lags,
            &mut counts,
        );
        (flight, counts)
    }

    #[test]
    fn boxes_and_shifts_of_a_late_view_are_moved_to_where_it_would_have_seen_them() {
        let (moved, counts) = in_time_by(&late(), flight(LATE_S));
        for (moved, expected) in moved.iter().zip(flight(0.0)) {
            let at = |observed: &Observation| observed.best(1).unwrap().cx_px;
            assert!((at(moved) - at(&expected)).abs() < 1e-6);
            let shift = |observed: &Observation| observed.shift(1).unwrap().shift_px;
            assert!((shift(moved) - shift(&expected)).length() < 1e-6);
            // The motion is known exactly: 20 pixels per second to the right.
            let sd_px = moved.shift(1).unwrap().sd_px;
            assert!((sd_px - DVec2::new(0.03, 0.04)).length() < 1e-6, "{sd_px}");
            let [CommonError { view: 1, sd_px }] = moved.common_errors[..] else {
                panic!("{:?}", moved.common_errors);
            };
            assert!((sd_px - DVec2::new(0.6, 0.0)).length() < 1e-6, "{sd_px}");
            assert_eq!(moved.best(0), expected.best(0));
        }
        assert_eq!((counts.late, counts.late_withheld), (20, 0));
        let none = vec![Vec::new(); 2];
        assert_eq!(in_time_by(&none, flight(0.0)).0, flight(0.0));
    }

    /// Pixel position on the glide path, `time_s` after it is 18 km away.
    fn on_glide_path_px(camera: &Camera, time_s: f64) -> DVec2 {
        let runway = changi_02l();
        let along_m = 18_000.0 - 75.0 * time_s;
        let height_m = along_m * 3_f64.to_radians().tan();
        let at: Geodetic = runway
            .point_on_approach(along_m, 0.0)
            .at_altitude_m(runway.threshold.altitude_msl_m + height_m);
        camera.project(at.to_ecef()).unwrap()
    }

    #[test]
    fn planned_cameras_tell_a_lag_that_is_certain_and_the_view_that_shows_an_earlier_aircraft_is_late()
     {
        let cameras = VIEWS.map(|view| Camera::from_pose(&placed(view), 1920, 1280));
        let late = |ticks: u32, late_s: f64| {
            let seen = |tick: u32| {
                let time_s = f64::from(tick);
                let places_px = [(0, 0.0), (1, late_s)];
                let places_px = places_px
                    .map(|(view, late_s)| on_glide_path_px(&cameras[view], time_s - late_s));
                Observation::registered_at(tick, places_px)
            };
            let flight: Vec<Observation> = (0..ticks).map(seen).collect();
            lags_by(&[], &cameras, &flight.iter().collect::<Vec<_>>())
        };
        let of_right = &late(210, 0.95).unwrap()[1];
        assert!((of_right[0].seconds - 0.95).abs() < 0.05, "{of_right:?}");
        let of_left = &late(210, -0.95).unwrap()[0];
        assert!((of_left[0].seconds - 0.95).abs() < 0.05, "{of_left:?}");
        assert_eq!([late(210, 0.0), late(30, 0.95)], [None, None]);
    }

    /// Places of an aircraft that first flies level and then descends towards the cameras.
    pub(super) fn place_px(time_s: f64) -> DVec2 {
        let level_s = time_s.min(60.0);
        let down_px = 2.0 * level_s + 0.1 * (time_s - level_s);
        DVec2::new(
            600.0 + 1.5 * time_s + 0.01 * time_s * time_s,
            400.0 + down_px,
        )
    }

    /// A tick whose views show the aircraft at these times.
    pub(super) fn tick_of_views(tick: u32, seen_s: [f64; 2]) -> Observation {
        let noise_px = 0.05 * (f64::from(tick) * 12.9898).sin();
        let [first, second] = seen_s.map(place_px);
        let apart = DVec2::new(60.0, 3.0 + noise_px);
        Observation::registered_at(tick, [first, second + apart])
    }

    pub(super) fn pair() -> Pair<'static> {
        Pair {
            views: [0, 1],
            off_px: Box::new(|[first, second]: [DVec2; 2]| second.y - first.y - 3.0),
            row_sd_px: 0.05,
            lag_sd_s: 0.01,
        }
    }

    /// Lags by the rows of a flight whose views show the aircraft at other times than their ticks.
    fn lags_of_views(seen_s: [&dyn Fn(f64) -> f64; 2]) -> Vec<Vec<Lag>> {
        let seen = |tick| tick_of_views(tick, seen_s.map(|seen_s| seen_s(f64::from(tick))));
        let flight: Vec<Observation> = (0..120).map(seen).collect();
        lags_by(&[pair()], &[], &flight.iter().collect::<Vec<_>>()).unwrap()
    }

    #[test]
    fn rows_tell_which_view_is_late_or_has_lost_an_image_and_when() {
        let on_time: &dyn Fn(f64) -> f64 = &|time_s| time_s;
        let late: &dyn Fn(f64) -> f64 = &|time_s| time_s - 0.2;
        let lost: &dyn Fn(f64) -> f64 = &|time_s| if time_s < 40.0 { time_s } else { time_s + 1.0 };
        let shown = |seen_s| {
            let lags = lags_of_views(seen_s);
            let shown = |lag: &Lag| (lag.from_s, (10.0 * lag.seconds).round() / 10.0);
            lags.iter()
                .map(|of_view| of_view.iter().map(shown).collect::<Vec<_>>())
                .collect::<Vec<_>>()
        };
        let always = |seconds: f64| vec![(f64::NEG_INFINITY, seconds)];
        let early = vec![(f64::NEG_INFINITY, 0.0), (40.0, -1.0)];
        assert_eq!(shown([on_time, on_time]), [always(0.0), always(0.0)]);
        assert_eq!(shown([on_time, late]), [always(0.0), always(0.2)]);
        assert_eq!(shown([late, on_time]), [always(0.2), always(0.0)]);
        assert_eq!(shown([on_time, lost]), [always(0.0), early.clone()]);
        assert_eq!(shown([lost, on_time]), [early, always(0.0)]);
    }

    #[test]
    fn rows_that_no_lag_explains_are_of_two_aircraft_and_tell_none() {
        let seen = |tick: u32| {
            let time_s = f64::from(tick);
            let [first, second] = [time_s, time_s - 0.4].map(place_px);
            let gust_px = 1.5 * (0.9 * time_s).sin();
            let apart = DVec2::new(60.0, 3.0 + gust_px);
            Observation::registered_at(tick, [first, second + apart])
        };
        let flight: Vec<Observation> = (0..120).map(seen).collect();
        let lags = lags_by(&[pair()], &[], &flight.iter().collect::<Vec<_>>()).unwrap();
        assert!(!lags.iter().flatten().any(is_corrected), "{lags:?}");
    }

    #[test]
    fn the_movement_is_as_uncertain_as_the_places_scatter() {
        const NOISE_PX: f64 = 0.5;
        let mut noisy = flight(LATE_S);
        for (number, observed) in noisy.iter_mut().enumerate() {
            // Alternating, so that no cubic follows.
            let off_px = if number % 2 == 0 { NOISE_PX } else { -NOISE_PX };
            observed.best_mut(1).unwrap().cx_px += off_px;
        }
        let (widened, _) = in_time_by(&late(), noisy);
        // A cubic through eight positions one second apart determines the slope in the middle to 0.41 of their deviation.
        let expected_px = 0.03_f64.hypot(LATE_S * 0.41 * NOISE_PX);
        let sd_px = widened[10].shift(1).unwrap().sd_px;
        // A median overestimates errors that all have the same size.
        assert!((1.0..1.8).contains(&(sd_px.x / expected_px)), "{sd_px}");
        assert!(
            sd_px.x > 2.0 * 0.03 && (sd_px.y - 0.04).abs() < 1e-6,
            "{sd_px}"
        );
    }

    #[test]
    fn a_late_view_does_not_count_where_its_motion_is_unknown() {
        let few = flight(LATE_S).into_iter().take(3).collect();
        let (moved, counts) = in_time_by(&late(), few);
        assert!(
            moved
                .iter()
                .all(|tick| tick.best(1).is_none() && tick.best(0).is_some())
        );
        let looks = [Look::Placed, Look::Blind];
        assert!(moved.iter().all(|tick| tick.looks == looks));
        assert_eq!((counts.late, counts.late_withheld), (0, 3));
    }
}
