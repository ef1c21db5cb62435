//! Simulated arrivals, and recorded ones, which tests/data/live-sightings/make.py cuts from a corpus of `dtd demo`.

use std::fs;

use dataset::geometry::geodesy::Geodetic;
use dataset::geometry::rays::across_sd_px;
use glam::{DVec2, DVec3};
use testkit::rig::{VIEWS, placed};
use testkit::{changi_02l, repository};

use super::*;
use crate::clocks::clock_offset::{RECORDING_DRIFT_SD, STREAM_DRIFT_SD};

/// Duration of all arrivals, s, and delay of the second view's clock.
const ARRIVAL_S: u32 = 280;
const SLOW_S: f64 = 0.5;

/// The aircraft a time after it is 24 km from the target: level, then on the glide path.
fn place_m(time_s: f64) -> DVec3 {
    let runway = changi_02l();
    let along_m = 24_000.0 - 75.0 * time_s;
    let height_m = 900_f64.min(along_m * 3_f64.to_radians().tan());
    let altitude_m = runway.threshold.altitude_msl_m + height_m;
    let at: Geodetic = runway
        .point_on_approach(along_m, 0.0)
        .at_altitude_m(altitude_m);
    at.to_ecef()
}

fn cameras() -> [Camera; 2] {
    VIEWS.map(|view| Camera::from_pose(&placed(view), 1920, 1280))
}

fn arrival(clock: &mut FreeClock, from_s: f64, added_s: f64) -> Vec<News> {
    arrival_of(clock, from_s, SLOW_S, added_s)
}

/// News during an arrival while the clock is slow by `slow_s`, with `added_s` already added.
fn arrival_of(clock: &mut FreeClock, from_s: f64, slow_s: f64, added_s: f64) -> Vec<News> {
    let seconds = 0..ARRIVAL_S;
    seconds
        .filter_map(|second| arrival_second(clock, second, [from_s, slow_s, added_s]))
        .collect()
}

/// News at a second of an arrival.
fn arrival_second(clock: &mut FreeClock, second: u32, times_s: [f64; 3]) -> Option<News> {
    let sighting = sighting_at(second, times_s);
    clock.take(sighting.time_s, Some(sighting))
}

fn sighting_at(second: u32, [from_s, slow_s, added_s]: [f64; 3]) -> Sighting {
    let [left, right] = cameras();
    let flown_s = f64::from(second);
    let there = right.project(place_m(flown_s + slow_s - added_s));
    Sighting {
        time_s: from_s + flown_s,
        places_px: [left.project(place_m(flown_s)).unwrap(), there.unwrap()],
        width_px: 20.0,
        sd_px: across_sd_px(20.0),
        taken_off_s: -added_s,
    }
}

#[test]
fn an_unknown_offset_is_told_once_found_after_enough_sightings_and_refined_after_the_arrival() {
    let mut clock = FreeClock::of(cameras(), None, RECORDING_DRIFT_SD);
    let news = arrival(&mut clock, 0.0, 0.0);
    let [News::Unknown, News::Known(first), ..] = news[..] else {
        panic!("{news:?}")
    };
    assert!((first.offset_s - SLOW_S).abs() < 0.03, "{first:?}");
    assert!(news.len() < 6, "{news:?}");
    assert!(clock.is_known() && clock.take(281.0, None).is_none());
    let Some(News::Known(refined)) = clock.take(290.0, None) else {
        panic!("it is over")
    };
    assert!(refined.sd_s < first.sd_s, "{first:?}, {refined:?}");
    assert!((refined.offset_s - SLOW_S).abs() < 0.01, "{refined:?}");
    assert!(clock.take(291.0, None).is_none());
    assert!(arrival(&mut clock, 600.0, 0.5).len() < 3);
    assert!(clock.at_end().unwrap().sd_s < refined.sd_s);
    assert_eq!(clock.at_end(), None);
}

#[test]
fn clocks_that_senders_set_count_from_the_start_as_uncertain_as_they_are_and_an_arrival_refines_them()
 {
    for slow_s in [0.0, 0.05, 0.2, -0.3] {
        let mut clock = FreeClock::of(cameras(), Some(Offset::of_senders()), STREAM_DRIFT_SD);
        let Some(News::Known(expected)) = clock.take(0.0, None) else {
            panic!("it is expected")
        };
        assert!(expected.offset_s == 0.0 && expected.sd_s > 0.2);
        let mut used_s = 0.0;
        for second in 0..ARRIVAL_S {
            let news = arrival_second(&mut clock, second, [0.0, slow_s, used_s]);
            if let Some(News::Known(offset)) = news {
                used_s = offset.offset_s;
            }
            let sd_s = clock.error_s(f64::from(second)).unwrap();
            // Of normal errors, 90 % are within 1.645 standard deviations.
            assert!(
                (used_s - slow_s).abs() < 1.645 * sd_s,
                "{slow_s}: {used_s} +- {sd_s} after {second} s"
            );
        }
        let sd_s = clock.error_s(f64::from(ARRIVAL_S)).unwrap();
        assert!(
            (used_s - slow_s).abs() < 0.01 && sd_s < 0.02,
            "{slow_s}: {used_s} +- {sd_s}"
        );
    }
}

#[test]
fn a_feed_that_is_two_seconds_late_is_known_to_be_after_an_arrival() {
    let mut clock = FreeClock::of(cameras(), None, STREAM_DRIFT_SD);
    arrival_of(&mut clock, 0.0, -2.0, 0.0);
    let Some(News::Known(found)) = clock.take(290.0, None) else {
        panic!("it is over")
    };
    assert!((found.offset_s + 2.0).abs() < 3.0 * found.sd_s, "{found:?}");
    assert!(found.sd_s < 0.02, "{found:?}");
}

#[test]
fn an_arrival_in_which_a_camera_turns_tells_the_offset_from_then_on() {
    let mut clock = FreeClock::of(cameras(), Some(Offset::of_senders()), STREAM_DRIFT_SD);
    let mut used_s = 0.0;
    for second in 0..ARRIVAL_S {
        if second == 60 {
            clock.forget_arrival();
        }
        let turned_px = if second < 60 { 6.0 } else { 0.0 };
        let mut sighting = sighting_at(second, [0.0, SLOW_S / 5.0, used_s]);
        sighting.places_px[1] += DVec2::splat(turned_px);
        if let Some(News::Known(offset)) = clock.take(sighting.time_s, Some(sighting)) {
            used_s = offset.offset_s;
        }
    }
    let Some(News::Known(found)) = clock.take(290.0, None) else {
        panic!("it is over")
    };
    assert!((found.offset_s - SLOW_S / 5.0).abs() < 0.01, "{found:?}");
}

#[test]
fn a_clock_in_use_again_says_what_it_knew() {
    let mut clock = FreeClock::of(cameras(), None, STREAM_DRIFT_SD);
    arrival(&mut clock, 0.0, 0.0);
    assert!(matches!(clock.take(290.0, None), Some(News::Known(_))));
    assert!(clock.take(291.0, None).is_none());
    clock.resume();
    let Some(News::Known(again)) = clock.take(900.0, None) else {
        panic!("it is known")
    };
    assert!((again.offset_s - SLOW_S).abs() < 0.01, "{again:?}");
}

#[test]
fn a_clock_that_drifts_is_followed_during_the_next_arrival() {
    let mut clock = FreeClock::of(cameras(), None, RECORDING_DRIFT_SD);
    arrival(&mut clock, 0.0, 0.0);
    assert!(matches!(clock.take(290.0, None), Some(News::Known(_))));
    let slow_s = SLOW_S + 600.0 * 100e-6;
    let news = arrival_of(&mut clock, 600.0, slow_s, SLOW_S);
    let Some(News::Known(followed)) = news.last() else {
        panic!("{news:?}")
    };
    assert!((followed.offset_s - slow_s).abs() < 0.01, "{news:?}");
}

#[test]
fn a_kept_offset_is_known_at_once() {
    let kept = Offset {
        offset_s: 0.5,
        sd_s: 0.006,
        drift_ppm: 0.0,
        drift_sd_ppm: 20.0,
    };
    let mut clock = FreeClock::of(cameras(), Some(kept), STREAM_DRIFT_SD);
    let Some(News::Known(found)) = clock.take(0.0, None) else {
        panic!("it was kept")
    };
    assert!((found.offset_s - 0.5).abs() < 1e-9);
    assert!(!clock.has_measured());
}

#[test]
fn an_offset_whose_drift_is_uncertain_is_unknown_after_hours_without_aircraft() {
    let mut clock = FreeClock::of(cameras(), None, RECORDING_DRIFT_SD);
    arrival(&mut clock, 0.0, 0.0);
    assert!(matches!(clock.take(300.0, None), Some(News::Known(_))));
    assert!(clock.take(310.0, None).is_none() && clock.has_measured());
    assert_eq!(clock.take(8.0 * 3_600.0, None), Some(News::Unknown));
    assert!(!clock.is_known());
    // The next arrival tells it again.
    let news = arrival(&mut clock, 30_000.0, 0.0);
    assert!(matches!(news[..], [News::Known(_), ..]), "{news:?}");
}

#[test]
fn a_clock_that_was_changed_is_learned_anew_from_one_arrival() {
    let kept = Offset {
        offset_s: -0.5,
        sd_s: 0.006,
        drift_ppm: 0.0,
        drift_sd_ppm: 20.0,
    };
    let mut clock = FreeClock::of(cameras(), Some(kept), RECORDING_DRIFT_SD);
    arrival(&mut clock, 0.0, -0.5);
    let Some(News::Known(found)) = clock.take(300.0, None) else {
        panic!("it is over")
    };
    assert!((found.offset_s - SLOW_S).abs() < 0.05, "{found:?}");
}

/// Boxes of both views in a recorded arrival, one row per second.
struct Recorded {
    time_s: f64,
    places_px: [DVec2; 2],
    width_px: f64,
}

fn recorded() -> Vec<Vec<Recorded>> {
    let path = repository().join("tests/data/live-sightings/sightings.csv");
    let text = fs::read_to_string(path).unwrap();
    let rows: Vec<(&str, Recorded)> = (text.lines().skip(1))
        .map(|line| {
            let (arrival, numbers) = line.split_once(',').unwrap();
            let numbers: Vec<f64> = numbers.split(',').map(|n| n.parse().unwrap()).collect();
            let [time_s, left_x, left_y, right_x, right_y, width_px] = numbers[..] else {
                panic!("{line}")
            };
            let row = Recorded {
                time_s,
                places_px: [DVec2::new(left_x, left_y), DVec2::new(right_x, right_y)],
                width_px,
            };
            (arrival, row)
        })
        .collect();
    let mut arrivals: Vec<(&str, Vec<Recorded>)> = Vec::new();
    for (arrival, row) in rows {
        match arrivals.last_mut() {
            Some((last, rows)) if *last == arrival => rows.push(row),
            _ => arrivals.push((arrival, vec![row])),
        }
    }
    arrivals.into_iter().map(|(_, rows)| rows).collect()
}

/// The place in the second view at a time, if that was seen just before and after.
fn there_px(rows: &[Recorded], time_s: f64) -> Option<DVec2> {
    let after = rows.partition_point(|row| row.time_s < time_s);
    let [from, to] = [rows.get(after.checked_sub(1)?)?, rows.get(after)?];
    let step_s = to.time_s - from.time_s;
    let part = (time_s - from.time_s) / step_s;
    (step_s < 1.5).then(|| from.places_px[1].lerp(to.places_px[1], part))
}

#[test]
fn four_recorded_arrivals_tell_a_slow_clock_and_its_drift_as_well_as_they_state() {
    /// The second clock is slow by this at the start, and that grows.
    const AT_START_S: f64 = 1.0;
    const DRIFT: f64 = 100e-6;
    const EACH_S: f64 = 400.0;
    let slow_s = |time_s: f64| AT_START_S + DRIFT * time_s;
    let mut clock = FreeClock::of(cameras(), None, RECORDING_DRIFT_SD);
    let mut known: Option<(f64, Offset)> = None;
    let mut refined = Vec::new();
    let arrivals = recorded();
    assert_eq!(arrivals.len(), 4);
    for (number, rows) in (0..).zip(&arrivals) {
        let began_s = EACH_S * f64::from(number);
        for row in rows {
            let time_s = began_s + row.time_s;
            let added_s = known.map_or(0.0, |(at_s, offset)| {
                offset.offset_s + offset.drift_ppm * 1e-6 * (time_s - at_s)
            });
            let there = there_px(rows, row.time_s + slow_s(time_s) - added_s);
            let sighting = there.map(|there| Sighting {
                time_s,
                places_px: [row.places_px[0], there],
                width_px: row.width_px,
                sd_px: across_sd_px(row.width_px),
                taken_off_s: -added_s,
            });
            if let Some(News::Known(offset)) = clock.take(time_s, sighting) {
                known = Some((time_s, offset));
            }
        }
        let over_s = began_s + rows[rows.len() - 1].time_s + 6.0;
        let Some(News::Known(offset)) = clock.take(over_s, None) else {
            panic!("arrival {number} told nothing")
        };
        known = Some((over_s, offset));
        let error_s = offset.offset_s - slow_s(over_s);
        let drift_error_ppm = offset.drift_ppm - DRIFT * 1e6;
        println!(
            "{offset:?}: off by {:.1} ms, {drift_error_ppm:.1} ppm",
            error_s * 1e3
        );
        assert!(
            error_s.abs() <= 3.0 * offset.sd_s,
            "{error_s} s: {offset:?}"
        );
        assert!(
            drift_error_ppm.abs() <= 3.0 * offset.drift_sd_ppm,
            "{offset:?}"
        );
        refined.push((error_s, drift_error_ppm));
    }
    assert!(refined[0].0.abs() <= 0.015, "{refined:?}");
    let (error_s, drift_error_ppm) = refined[3];
    assert!(
        error_s.abs() <= 0.010 && drift_error_ppm.abs() <= 40.0,
        "{refined:?}"
    );
}
