mod standing;

use super::*;

/// A box of this length around a point, a third as high as long.
fn at(x_px: f64, y_px: f64, length_px: f64) -> PixelBox {
    PixelBox {
        cx_px: x_px,
        cy_px: y_px,
        width_px: length_px,
        height_px: length_px / 3.0,
    }
}

/// A number from -1 to 1 that looks random: the same for the same arguments.
fn jitter(seed: u32, step: u32) -> f64 {
    let mixed =
        (seed.wrapping_mul(0x9E37_79B9) ^ step.wrapping_mul(0x85EB_CA6B)).wrapping_mul(0xC2B2_AE35);
    f64::from(mixed ^ mixed >> 15) / f64::from(u32::MAX) * 2.0 - 1.0
}

fn shaken(exact: PixelBox, seed: u32, step: u32) -> PixelBox {
    PixelBox {
        cx_px: exact.cx_px + 0.5 * jitter(seed, step),
        cy_px: exact.cy_px + 0.5 * jitter(seed + 1, step),
        width_px: exact.width_px * (1.0 + 0.1 * jitter(seed + 2, step)),
        height_px: exact.height_px * (1.0 + 0.1 * jitter(seed + 3, step)),
    }
}

fn clear(pixel_box: PixelBox) -> FoundBox {
    FoundBox {
        pixel_box,
        is_faint: false,
    }
}

fn faint(pixel_box: PixelBox) -> FoundBox {
    FoundBox {
        pixel_box,
        is_faint: true,
    }
}

/// Tracks of clear boxes, by image, and the tracks that count.
fn track(period_s: f64, pictures: &[Vec<PixelBox>]) -> (Vec<Vec<u32>>, Vec<bool>) {
    let all_clear = |boxes: &Vec<PixelBox>| boxes.iter().copied().map(clear).collect();
    let pictures: Vec<_> = pictures.iter().map(all_clear).collect();
    track_seen(period_s, &pictures)
}

fn track_seen(period_s: f64, pictures: &[Vec<FoundBox>]) -> (Vec<Vec<u32>>, Vec<bool>) {
    let mut tracker = Tracker::of_pictures(pictures.len());
    let mut hindsight = Hindsight::default();
    let tracks = pictures
        .iter()
        .map(|boxes| {
            tracker.advance(period_s);
            let tracks = tracker.take(boxes, SearchedParts::Everywhere);
            let tracked = boxes.iter().zip(&tracks).filter_map(|(seen, track)| {
                let track = (*track)?;
                Some(TrackedBox {
                    track,
                    pixel_box: seen.pixel_box,
                    is_faint: seen.is_faint,
                    confirmed_s: tracker.confirmed_s(track),
                })
            });
            hindsight.take(tracker.now_s(), tracked);
            tracks.into_iter().flatten().collect()
        })
        .collect();
    (tracks, hindsight.counting())
}

/// An approach at 70 m/s, seen by a camera 60 m beside its path with a focal length of 11,000 px, at this range.
fn approach(range_m: f64) -> PixelBox {
    let px_per_m = 11_000.0 / range_m;
    at(
        960.0 + 60.0 * px_per_m,
        640.0 - 5.0 * px_per_m,
        35.0 * px_per_m,
    )
}

#[test]
fn what_looks_like_an_aircraft_for_a_second_is_none_at_any_picture_rate() {
    for (period_s, pictures, counts_if) in [
        (1.0 / 30.0, 30, false),
        (1.0 / 30.0, 90, true),
        (1.0, 3, true),
    ] {
        let mut all: Vec<Vec<PixelBox>> = vec![Vec::new(); 300];
        for (step, boxes) in (0..).zip(&mut all[100..100 + pictures]) {
            boxes.push(shaken(
                at(780.0 + 3.0 * f64::from(step), 470.0, 17.0),
                3,
                step,
            ));
        }
        let (_, counts) = track(period_s, &all);
        assert_eq!(counts, [counts_if], "{pictures} images of {period_s} s");
    }
}

#[test]
fn an_approach_is_one_track_at_any_picture_rate() {
    for period_s in [1.0 / 30.0, 0.5, 1.0, 2.0, 1.0 / 0.3] {
        let pictures: Vec<_> = (0..)
            .map(|step| (step, 18_520.0 - 70.0 * period_s * f64::from(step)))
            .take_while(|(_, range_m)| *range_m > 800.0)
            .map(|(step, range_m)| vec![shaken(approach(range_m), 7, step)])
            .collect();
        let (tracks, counts) = track(period_s, &pictures);
        assert!(
            tracks.iter().all(|tracks| *tracks == [0]),
            "every {period_s} s: {tracks:?}"
        );
        assert_eq!(counts, [true], "every {period_s} s");
    }
}

#[test]
fn three_boxes_in_five_pictures_confirm_a_track_with_its_first_box() {
    for (seen, is_confirmed) in [
        ([1, 0, 1, 0, 1], true),
        ([1, 1, 1, 0, 0], true),
        ([1, 1, 0, 0, 0], false),
        ([1, 0, 0, 0, 0], false),
        ([1, 0, 0, 1, 0], false),
    ] {
        let pictures: Vec<_> = seen
            .into_iter()
            .chain([0; 9])
            .map(|seen| vec![at(100.0, 100.0, 21.0); seen])
            .collect();
        let (_, counts) = track(1.0, &pictures);
        assert_eq!(counts, [is_confirmed], "{seen:?}");
    }
}

#[test]
fn a_view_of_two_pictures_needs_a_box_in_both() {
    let here = vec![at(100.0, 100.0, 21.0)];
    assert_eq!(track(1.0, &[here.clone(), here.clone()]).1, [true]);
    assert_eq!(track(1.0, &[here.clone(), Vec::new()]).1, [false]);
    assert_eq!(track(1.0, &[here]).1, [true]);
}

#[test]
fn boxes_all_over_the_picture_confirm_nothing() {
    let pictures: Vec<_> = (0..300)
        .map(|step| {
            let place = |seed| 960.0 + 950.0 * jitter(seed, step);
            vec![at(place(1), place(5), 20.0), at(place(9), place(13), 30.0)]
        })
        .collect();
    let (_, counts) = track(1.0 / 30.0, &pictures);
    let confirmed = counts.iter().filter(|counts| **counts).count();
    assert!(confirmed == 0, "{confirmed} of {}", counts.len());
}

#[test]
fn aircraft_that_cross_keep_their_tracks() {
    // 100 px/s towards each other on almost the same line; for some images they are one box.
    let pictures: Vec<_> = (0..120)
        .map(|step| {
            let way_px = f64::from(step) * 100.0 / 30.0;
            let one = at(300.0 + way_px, 400.0, 24.0);
            let other = at(700.0 - way_px, 403.0, 21.0);
            if one.iou(&other) > 0.3 {
                return vec![one];
            }
            // The order of boxes carries no information.
            match step % 2 {
                0 => vec![shaken(one, 3, step), shaken(other, 30, step)],
                _ => vec![shaken(other, 30, step), shaken(one, 3, step)],
            }
        })
        .collect();
    let (tracks, counts) = track(1.0 / 30.0, &pictures);
    for (boxes, tracks) in pictures.iter().zip(&tracks) {
        for (seen, track) in boxes.iter().zip(tracks) {
            if boxes.len() == 2 {
                assert_eq!(*track, u32::from(seen.cy_px > 401.5), "{tracks:?}");
            }
        }
    }
    assert_eq!(counts, [true, true]);
}

#[test]
fn a_gap_of_a_second_does_not_end_a_track_and_one_of_three_does() {
    for (gap, expected) in [(30, 0), (90, 1)] {
        let pictures: Vec<_> = (0..180 + gap)
            .map(|step| {
                let seen = at(300.0 + f64::from(step), 400.0, 24.0);
                vec![seen; usize::from(!(90..90 + gap).contains(&step))]
            })
            .collect();
        let (tracks, counts) = track(1.0 / 30.0, &pictures);
        assert_eq!(*tracks.last().unwrap(), [expected], "after {gap} images");
        assert!(counts.iter().all(|counts| *counts));
    }
}

#[test]
fn a_track_that_was_not_looked_for_does_not_end() {
    let mut tracker = Tracker::of_pictures(100);
    for _ in 0..3 {
        tracker.advance(0.1);
        tracker.take(&[clear(at(300.0, 400.0, 24.0))], SearchedParts::Everywhere);
    }
    for _ in 0..40 {
        tracker.advance(0.1);
        tracker.take(&[], SearchedParts::Around(&[], &(0..0)));
    }
    assert_eq!(tracker.expected(0.1).len(), 1);
    for _ in 0..40 {
        tracker.advance(0.1);
        tracker.take(&[], SearchedParts::Around(&[0], &(0..0)));
    }
    assert_eq!(tracker.expected(0.1), []);
}

#[test]
fn a_confirmed_aircraft_that_was_just_seen_is_missed_at_once_and_only_once() {
    let mut tracker = Tracker::of_pictures(100);
    let here = clear(at(300.0, 400.0, 24.0));
    for step in 0..4 {
        tracker.advance(0.1);
        assert_eq!(tracker.lost(&[]).is_some(), step == 3);
        tracker.take(&[here], SearchedParts::Everywhere);
    }
    tracker.advance(0.1);
    assert!(tracker.lost(&[clear(at(900.0, 400.0, 24.0))]).is_some());
    assert!(tracker.lost(&[here]).is_none());
    tracker.take(&[], SearchedParts::Everywhere);
    tracker.advance(0.1);
    assert!(tracker.lost(&[]).is_none());
}

#[test]
fn what_stands_still_for_a_minute_is_no_arriving_aircraft() {
    let pictures = |seconds: u32, seen: fn(f64) -> PixelBox| -> Vec<_> {
        (0..seconds * 5)
            .map(|step| vec![shaken(seen(f64::from(step) / 5.0), 11, step)])
            .collect()
    };
    let mast: fn(f64) -> PixelBox = |_| at(900.0, 500.0, 40.0);
    assert_eq!(track(0.2, &pictures(70, mast)).1, [false]);
    assert_eq!(
        track(0.2, &pictures(50, mast)).1,
        [true],
        "too short to know"
    );
}

#[test]
fn a_lamp_that_is_found_for_some_seconds_again_and_again_is_one_thing_that_stands_still() {
    let seconds: [u32; 3] = [0, 40, 100];
    let pictures = |last: &dyn Fn(u32) -> PixelBox| {
        let of_second = |second: u32| {
            let begins = seconds.iter().rev().find(|begins| second >= **begins);
            let is_found = begins.is_some_and(|begins| second - begins < 6);
            match is_found {
                true if second >= 100 => vec![shaken(last(second), 3, second)],
                true => vec![shaken(at(900.0, 500.0, 40.0), 3, second)],
                false => Vec::new(),
            }
        };
        (0..120).map(of_second).collect::<Vec<_>>()
    };
    let lamp = pictures(&|_| at(900.0, 500.0, 40.0));
    assert_eq!(track(1.0, &lamp).1, [false, false, false]);
    // Passing the lamp's place.
    let passing = pictures(&|second| at(880.0 + 8.0 * f64::from(second - 100), 500.0, 40.0));
    assert_eq!(
        track(1.0, &passing).1,
        [true, true, true],
        "40 s are too short to know"
    );
    // It stands still elsewhere, for too short a time to decide.
    let elsewhere = pictures(&|_| at(930.0, 500.0, 40.0));
    assert_eq!(track(1.0, &elsewhere).1, [true, true, true]);
}

/// An aircraft that crosses the image, one image per second, clear in some.
fn crossing(is_clear: impl Fn(u32) -> bool) -> Vec<Vec<FoundBox>> {
    let seen = |second: u32| {
        let here = shaken(at(300.0 + 3.0 * f64::from(second), 400.0, 24.0), 1, second);
        vec![if is_clear(second) {
            clear(here)
        } else {
            faint(here)
        }]
    };
    (0..60).map(seen).collect()
}

#[test]
fn faint_boxes_before_between_and_after_the_clear_ones_belong_to_the_track() {
    let (tracks, counts) = track_seen(1.0, &crossing(|second| (20..30).contains(&second)));
    assert!(tracks.iter().all(|tracks| *tracks == [0]), "{tracks:?}");
    assert_eq!(counts, [true]);
    // Never three clear ones in five images.
    let (tracks, counts) = track_seen(1.0, &crossing(|second| second % 5 < 2));
    assert!(tracks.iter().all(|tracks| *tracks == [0]), "{tracks:?}");
    assert_eq!(counts, [false]);
    assert_eq!(track_seen(1.0, &crossing(|_| false)).1, [false]);
}

#[test]
fn a_clear_box_belongs_to_the_track_before_a_faint_one() {
    let mut pictures = crossing(|second| second < 10);
    let PixelBox { cx_px, cy_px, .. } = pictures[10][0].pixel_box;
    pictures[10] = vec![
        faint(at(cx_px, cy_px, 24.0)),
        clear(at(cx_px + 1.5, cy_px + 1.0, 24.0)),
    ];
    let (tracks, _) = track_seen(1.0, &pictures[..11]);
    assert_eq!(tracks[10], [1, 0]);
}

#[test]
fn faint_boxes_do_not_make_what_appears_for_a_moment_an_aircraft() {
    let flash = |is_clear: &dyn Fn(u32) -> bool| {
        let seen = |step: u32| {
            let here = at(300.0 + 0.2 * f64::from(step), 400.0, 24.0);
            vec![if is_clear(step) {
                clear(here)
            } else {
                faint(here)
            }]
        };
        let pictures: Vec<_> = (0..300).map(seen).collect();
        track_seen(1.0 / 30.0, &pictures).1
    };
    assert_eq!(flash(&|step| (100..130).contains(&step)), [false]);
    assert_eq!(
        flash(&|step| step == 10 || (100..103).contains(&step)),
        [false],
        "once, and again after three seconds"
    );
    assert_eq!(flash(&|step| (100..170).contains(&step)), [true]);
}

#[test]
fn a_lamp_whose_boxes_grow_faint_does_not_wait_for_an_aircraft() {
    for first_clear in [0, 5] {
        let lamp = |second: u32| shaken(at(600.0, 400.0, 24.0), 5, second);
        let pictures: Vec<_> = (0..70)
            .map(|second: u32| match second {
                0..50 if second < first_clear => vec![clear(lamp(second))],
                0..50 => vec![faint(lamp(second))],
                _ => vec![clear(at(600.0 + 4.0 * f64::from(second - 50), 399.0, 24.0))],
            })
            .collect();
        let (tracks, counts) = track_seen(1.0, &pictures);
        assert_ne!(tracks[49], tracks[60], "{tracks:?}");
        assert!(!counts[tracks[49][0] as usize], "{counts:?}");
        assert!(counts[tracks[60][0] as usize], "{counts:?}");
    }
}

#[test]
fn an_approach_is_followed_while_it_is_faint() {
    for period_s in [0.2, 1.0] {
        let pictures: Vec<_> = (0..(90.0 / period_s) as u32)
            .map(|step| {
                let time_s = f64::from(step) * period_s;
                let px_per_m = 11_000.0 / (17_000.0 - 80.0 * time_s);
                let here = at(960.0 + 300.0 * px_per_m, 640.0, 35.0 * px_per_m);
                let here = shaken(here, 3, step);
                vec![if time_s < 4.0 {
                    clear(here)
                } else {
                    faint(here)
                }]
            })
            .collect();
        let (tracks, counts) = track_seen(period_s, &pictures);
        assert!(tracks.iter().all(|tracks| *tracks == [0]), "{tracks:?}");
        assert_eq!(counts, [true]);
    }
}

#[test]
fn a_lamp_whose_faint_boxes_have_another_size_stands_still() {
    let seen = |second: u32| {
        let length_px = 30.0 + 8.0 * jitter(9, second / 4);
        let here = shaken(at(352.0, 961.0, length_px), 3, second);
        let halo = at(here.cx_px, here.cy_px, 21.0);
        // Clear for some seconds, again and again, and more often later.
        let is_clear = second % 40 < 4 + second / 40;
        vec![if is_clear { clear(here) } else { faint(halo) }]
    };
    let pictures: Vec<_> = (0..240).map(seen).collect();
    let (_, counts) = track_seen(1.0, &pictures);
    assert!(!counts.contains(&true), "{counts:?}");
}

#[test]
fn a_faint_box_in_a_window_begins_nothing() {
    let mut tracker = Tracker::of_pictures(100);
    let here = at(300.0, 400.0, 24.0);
    tracker.advance(1.0);
    assert_eq!(
        tracker.take(&[clear(here)], SearchedParts::Everywhere),
        [Some(0)]
    );
    tracker.advance(1.0);
    let beside = faint(at(340.0, 420.0, 12.0));
    let seen = [clear(here), beside];
    assert_eq!(
        tracker.take(&seen, SearchedParts::Around(&[0], &(0..0))),
        [Some(0), None]
    );
    assert_eq!(
        tracker.take(&seen, SearchedParts::Everywhere),
        [Some(0), Some(1)]
    );
}

#[test]
fn nothing_is_followed_that_was_only_faint() {
    let mut tracker = Tracker::of_pictures(100);
    for picture in crossing(|second| second == 4).iter().take(6) {
        let is_first = tracker.expected(1.0).is_empty();
        tracker.advance(1.0);
        tracker.take(picture, SearchedParts::Everywhere);
        assert!(is_first || !tracker.expected(1.0).is_empty());
    }
    assert_eq!(tracker.expected(1.0).len(), 1, "once it was clear");
    let mut tracker = Tracker::of_pictures(100);
    for picture in crossing(|_| false).iter().take(6) {
        tracker.advance(1.0);
        tracker.take(picture, SearchedParts::Everywhere);
        assert_eq!(tracker.expected(1.0), []);
    }
}

/// Times with a box that counts at once, s.
fn counting_s(period_s: f64, pictures: &[Vec<FoundBox>]) -> Vec<f64> {
    let mut tracker = Tracker::endless();
    let seconds = pictures.iter().filter_map(|boxes| {
        tracker.advance(period_s);
        let tracks = tracker.take(boxes, SearchedParts::Everywhere);
        let counts = tracks.into_iter().flatten().any(|t| tracker.counts(t));
        counts.then(|| tracker.now_s())
    });
    seconds.collect()
}

#[test]
fn an_approach_counts_two_seconds_after_its_first_boxes_and_from_then_on() {
    for period_s in [1.0 / 30.0, 0.5, 1.0] {
        let images = (120.0 / period_s) as u32;
        let pictures: Vec<_> = (0..images)
            .map(|step| {
                let range_m = 18_520.0 - 70.0 * period_s * f64::from(step);
                vec![clear(shaken(approach(range_m), 7, step))]
            })
            .collect();
        let counting = counting_s(period_s, &pictures);
        assert!(counting[0] <= 2.0 + 3.0 * period_s, "{counting:?}");
        let later = (120.0 - counting[0]) / period_s;
        assert!((counting.len() as f64 - later).abs() < 3.0);
    }
}

#[test]
fn a_mast_stops_counting_after_a_minute() {
    let pictures: Vec<_> = (0..1_000)
        .map(|step| vec![clear(shaken(at(900.0, 500.0, 40.0), 11, step))])
        .collect();
    let counting = counting_s(0.2, &pictures);
    assert!(*counting.last().unwrap() < 62.0, "{counting:?}");
}
