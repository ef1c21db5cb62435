//! Association of boxes among lamps and other aircraft.

use dataset::corpus::splits::Side;
use dataset::numbers::frame_rate::FrameRate;
use dataset::tables::pixel_box::PixelBox;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;
use testkit::synthetic::SyntheticCorpus;

use super::*;
use crate::samples::{Candidate, Look, Samples};

/// Relations from the training side, and test flights beyond 1 NM.
fn learned(corpus: &SyntheticCorpus) -> (PairedViews, Vec<Vec<Observation>>) {
    let samples = Samples::synthetic(corpus, 1.0);
    let true_boxes = samples.with_true_boxes();
    let paired = PairedViews::fit(samples.views.len(), &true_boxes.iter().collect::<Vec<_>>());
    let flights = samples.flights_of_side(Side::Test);
    let observed = |flight: &[Sample]| flight.iter().map(|s| s.observed.clone()).collect();
    (paired, flights.map(observed).collect())
}

fn every(seconds: u32) -> SyntheticCorpus {
    SyntheticCorpus {
        frame_rate: FrameRate {
            numerator: 1,
            denominator: seconds,
        },
        ..SyntheticCorpus::tiny()
    }
}

fn each_second() -> (PairedViews, Vec<Vec<Observation>>) {
    learned(&every(1))
}

/// Gives the aircraft's boxes one track per view, as a detector does.
fn tracked(flight: &[Observation]) -> Vec<Observation> {
    let mut flight = flight.to_vec();
    for observed in &mut flight {
        for (candidates, track) in observed.candidates.iter_mut().zip([3, 7]) {
            candidates.iter_mut().for_each(|of| of.track = Some(track));
        }
    }
    flight
}

/// Adds a box with the highest score in a view.
fn add(observed: &mut Observation, view: usize, pixel_box: PixelBox, track: Option<u32>) {
    let added = Candidate {
        pixel_box,
        score: 1.0,
        track,
    };
    observed.candidates[view].insert(0, added);
    observed.shifts.fill(None);
}

fn still(cx_px: f64, cy_px: f64) -> PixelBox {
    PixelBox {
        cx_px,
        cy_px,
        width_px: 41.0,
        height_px: 15.0,
    }
}

/// Ticks with a box, and ticks with a false one.
fn answered_and_false(chosen: &[Observation], truth: &[Observation]) -> (usize, usize) {
    let ticks = || chosen.iter().zip(truth);
    let is_false = |(chosen, truth): &(&Observation, &Observation)| {
        let mut seen = chosen.seen();
        seen.any(|(view, seen)| Some(seen) != truth.best(view))
    };
    let answered = ticks()
        .filter(|(chosen, _)| chosen.detections() > 0)
        .count();
    (answered, ticks().filter(is_false).count())
}

fn seen(flight: &[Observation]) -> usize {
    flight
        .iter()
        .filter(|observed| observed.detections() > 0)
        .count()
}

#[test]
fn flights_without_false_boxes_keep_all_of_their_boxes() {
    for seconds in [1, 3, 15] {
        let (paired, flights) = learned(&every(seconds));
        assert_eq!(paired.relations.len(), 1);
        for flight in &flights {
            assert_eq!(&paired.of_one_aircraft(flight), flight);
            let flight = tracked(flight);
            assert_eq!(paired.of_one_aircraft(&flight), flight);
        }
    }
}

#[test]
fn a_false_box_with_the_best_score_in_one_view_is_never_taken_however_long_it_is_there() {
    let (paired, flights) = each_second();
    for (number, flight) in flights.iter().enumerate() {
        for track in [None, Some(50)] {
            for lasts in [1, 3, 10, 30, 60] {
                for (moves, view) in [(0.0, 0), (2.5, 1), (-1.0, 0)] {
                    let truth = if track.is_some() {
                        tracked(flight)
                    } else {
                        flight.clone()
                    };
                    let mut disturbed = truth.clone();
                    for start in [0, 70, 140] {
                        for tick in start..(start + lasts).min(disturbed.len()) {
                            let along = moves * (tick - start) as f64;
                            let lamp = still(400.0 + 30.0 * along, 441.0 + along);
                            add(&mut disturbed[tick], view, lamp, track);
                        }
                    }
                    let chosen = paired.of_one_aircraft(&disturbed);
                    let (answered, wrong) = answered_and_false(&chosen, &truth);
                    let case =
                        format!("flight {number}, {track:?}, {lasts} s, {moves}, view {view}");
                    assert_eq!(wrong, 0, "{case}");
                    assert!(
                        answered as f64 >= 0.97 * seen(&truth) as f64,
                        "{case}: {answered}"
                    );
                }
            }
        }
    }
}

#[test]
fn while_one_view_sees_something_else_the_other_answers_alone() {
    let (paired, flights) = each_second();
    for flight in flights.iter().map(|flight| tracked(flight)) {
        let mut disturbed = flight.clone();
        for observed in &mut disturbed[60..120] {
            observed.show_in(1, Some(still(900.0, 441.0)), Some(50));
            observed.shifts.fill(None);
        }
        let chosen = paired.of_one_aircraft(&disturbed);
        let (answered, wrong) = answered_and_false(&chosen, &flight);
        assert_eq!(wrong, 0);
        let alone = flight.iter().enumerate().filter(|(tick, observed)| {
            let is_disturbed = (60..120).contains(tick);
            observed.best(0).is_some() || (!is_disturbed && observed.best(1).is_some())
        });
        assert_eq!(answered, alone.count());
    }
}

#[test]
fn of_two_arrivals_one_is_followed_to_the_end_also_where_one_view_loses_it() {
    let (paired, flights) = each_second();
    for apart in [45, 90] {
        let flight = tracked(&flights[0]);
        let ahead = tracked(&flights[1]);
        // The other aircraft is farther along, so nearer and higher in score.
        let mut both = flight.clone();
        for (tick, observed) in both.iter_mut().enumerate() {
            let Some(other) = ahead.get(tick + apart) else {
                continue;
            };
            for view in 0..2 {
                if let Some(seen) = other.best(view) {
                    add(observed, view, *seen, Some(90));
                }
            }
        }
        for observed in &mut both[20..30] {
            // The followed aircraft is lost in one view, where the other remains.
            observed.candidates[1].remove(0);
        }
        let chosen = paired.of_one_aircraft(&both);
        let in_sight = ahead.len() - apart;
        let first = &chosen[..in_sight];
        for (tick, observed) in first.iter().enumerate() {
            for (view, seen) in observed.seen() {
                assert_eq!(Some(seen), ahead[tick + apart].best(view), "tick {tick}");
            }
        }
        assert!(
            seen(first) as f64 > 0.97 * seen(&ahead[apart..]) as f64,
            "{}",
            seen(first)
        );
        // The aircraft behind takes over after a minute without the first.
        let (_, wrong) = answered_and_false(&chosen[in_sight..], &flight[in_sight..]);
        assert_eq!(wrong, 0);
        if apart > 60 {
            assert!(seen(&chosen[in_sight + 62..]) > 0);
        }
    }
}

#[test]
fn of_three_views_the_one_that_contradicts_the_others_is_left_out() {
    let (paired, flights) = learned(&SyntheticCorpus {
        third_camera: true,
        ..every(1)
    });
    assert_eq!(paired.relations.len(), 3);
    let flight = &flights[0];
    assert_eq!(&paired.of_one_aircraft(flight), flight);
    let mut disturbed = flight.clone();
    for observed in &mut disturbed[40..100] {
        observed.show_in(1, Some(still(900.0, 741.0)), None);
    }
    let chosen = paired.of_one_aircraft(&disturbed);
    let (answered, wrong) = answered_and_false(&chosen, flight);
    assert_eq!(wrong, 0);
    assert!(answered + 2 >= seen(flight), "{answered}");
}

#[test]
fn a_single_view_counts_while_the_others_are_blind() {
    let (paired, flights) = each_second();
    for view in 0..2 {
        let blind = |observed: &Observation| observed.without_images(|of| of != view);
        let alone: Vec<Observation> = flights[0].iter().map(blind).collect();
        let chosen = paired.of_one_aircraft(&alone);
        let (answered, wrong) = answered_and_false(&chosen, &alone);
        assert_eq!(wrong, 0);
        // Until its speed is known.
        assert!(answered as f64 >= 0.7 * seen(&alone) as f64, "{answered}");
    }
}

#[test]
fn what_one_view_alone_sees_counts_only_if_it_is_as_fast_as_an_approach() {
    let (paired, flights) = each_second();
    let flight = &flights[0];
    for (times_as_fast, counts) in [(1, true), (8, false)] {
        let ticks = flight.iter().zip(flight.iter().step_by(times_as_fast));
        let alone = ticks.map(|(observed, shown)| {
            let mut alone = observed.without_images(|view| view == 1);
            alone.show_in(0, shown.best(0).copied(), Some(3));
            alone
        });
        let chosen = paired.of_one_aircraft(&alone.collect::<Vec<_>>());
        assert_eq!(seen(&chosen) > 0, counts, "{times_as_fast} times as fast");
    }
}

#[test]
fn what_one_view_sees_and_another_one_that_looks_there_does_not_gives_no_answer() {
    let (paired, flights) = each_second();
    let flight = tracked(&flights[0]);
    let one_sees = |observed: &Observation| observed.with_boxes_that(|view, _| view == 0);
    let unseen: Vec<Observation> = flight.iter().map(one_sees).collect();
    assert_eq!(seen(&paired.of_one_aircraft(&unseen)), 0);
    // Where the second view never saw an aircraft, it need not see this one.
    let mut narrow = paired.clone();
    narrow.relations[0].common_px = [[5_000.0, 6_000.0]; 2];
    assert!(seen(&narrow.of_one_aircraft(&unseen)) > seen(&unseen) / 2);
    // Occasional missing images do not make a view blind; a long outage does.
    let mut failing = unseen.clone();
    failing
        .iter_mut()
        .step_by(4)
        .for_each(|observed| observed.looks[1] = Look::Blind);
    assert_eq!(seen(&paired.of_one_aircraft(&failing)), 0);
    failing[60..]
        .iter_mut()
        .for_each(|observed| observed.looks[1] = Look::Blind);
    let chosen = paired.of_one_aircraft(&failing);
    assert_eq!(seen(&chosen[..68]), 0);
    assert!(seen(&chosen[72..]) as f64 > 0.9 * seen(&unseen[72..]) as f64);
}

/// A box with nearly normal detection errors.
fn erring(exact: PixelBox, random: &mut ChaCha12Rng) -> PixelBox {
    let mut error = |sd: f64| sd * ((0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0);
    PixelBox {
        cx_px: exact.cx_px + error(0.35),
        cy_px: exact.cy_px + error(0.35),
        width_px: exact.width_px + error(1.3),
        height_px: exact.height_px + error(0.5),
    }
}

/// Ticks with objects in the first view only.
fn alone(
    like: &Observation,
    step_ns: i64,
    boxes: impl IntoIterator<Item = PixelBox>,
) -> Vec<Observation> {
    let image = |(image, pixel_box): (i64, PixelBox)| {
        let mut observed = like.without_images(|view| view == 1);
        observed.show_in(0, Some(pixel_box), Some(3));
        observed.time_ns = step_ns * image;
        observed
    };
    (0..).zip(boxes).map(image).collect()
}

#[test]
fn what_stands_still_in_one_view_gives_no_answer_although_its_boxes_err() {
    let (paired, flights) = each_second();
    let seen_first = flights[0].iter().find(|of| of.best(0).is_some()).unwrap();
    let place = *seen_first.best(0).unwrap();
    let (mut answered, mut all) = (0, 0);
    for seed in 0..100 {
        let mut random = ChaCha12Rng::seed_from_u64(seed);
        let boxes = (0..150).map(|_| erring(place, &mut random));
        let images = alone(seen_first, 200_000_000, boxes);
        answered += seen(&paired.of_one_aircraft(&images));
        all += images.len();
    }
    let part = answered as f64 / all as f64;
    println!("{answered} answers at {all} ticks");
    assert!(part < 0.01, "{part}");
}

#[test]
fn a_far_arrival_that_comes_straight_at_the_only_camera_that_sees_it_counts_within_a_minute() {
    let (mut paired, flights) = each_second();
    let seen_first = flights[0].iter().find(|of| of.best(0).is_some()).unwrap();
    let usual = *seen_first.best(0).unwrap();
    // 20 pixels wide at 10 NM, 70 m/s, always at the same position.
    let straight = |distance_m: f64| PixelBox {
        width_px: 20.0 * 18_520.0 / distance_m,
        ..usual
    };
    let sightings = |seed: u64| {
        let mut random = ChaCha12Rng::seed_from_u64(seed);
        let sighting = |second: i32| Sighting {
            time_s: f64::from(second),
            pixel_box: erring(
                straight(13.0 * 1_852.0 - 70.0 * f64::from(second)),
                &mut random,
            ),
        };
        (0..212).map(sighting).collect::<Vec<_>>()
    };
    paired.paths[0] = Path::fit(0, &[sightings(1), sightings(2), sightings(3)]).unwrap();
    for seed in 10..20 {
        let boxes = sightings(seed).into_iter().map(|seen| seen.pixel_box);
        let images = alone(seen_first, 1_000_000_000, boxes);
        let chosen = paired.of_one_aircraft(&images);
        // From 10.7 NM to 9 NM, and to 5 NM.
        let [far, nearer] = [60..106, 106..212].map(|of| seen(&chosen[of]));
        assert!(far >= 37 && nearer >= 95, "seed {seed}: {far}, {nearer}");
        let mut random = ChaCha12Rng::seed_from_u64(seed);
        let still = (0..212).map(|_| erring(usual, &mut random));
        let images = alone(seen_first, 1_000_000_000, still);
        let answered = seen(&paired.of_one_aircraft(&images));
        assert!(answered < 4, "{answered} of 212 images of a still thing");
    }
}

#[test]
fn views_that_see_different_things_from_the_start_give_no_answer() {
    let (paired, flights) = each_second();
    let mut disturbed = tracked(&flights[0]);
    for observed in &mut disturbed {
        observed.show_in(1, Some(still(900.0, 441.0)), Some(50));
    }
    let both = disturbed
        .iter()
        .filter(|observed| observed.detections() == 2);
    let chosen = paired.of_one_aircraft(&disturbed);
    assert!(both.count() > 100);
    let answered = seen(&chosen) as f64;
    assert!(answered < 0.02 * disturbed.len() as f64, "{answered}");
}

#[test]
fn views_that_begin_to_show_different_arrivals_give_no_answer_until_they_have_agreed_for_long() {
    let (paired, flights) = each_second();
    let mut disturbed = tracked(&flights[0]);
    let truth = disturbed.clone();
    for (tick, observed) in disturbed.iter_mut().enumerate().take(100).skip(30) {
        let other = flights[1].get(tick + 90).and_then(|of| of.best(1));
        observed.show_in(1, other.copied(), Some(50));
        observed.shifts.fill(None);
    }
    let chosen = paired.of_one_aircraft(&disturbed);
    let answered =
        |ticks: std::ops::Range<usize>| (seen(&chosen[ticks.clone()]), seen(&truth[ticks]));
    let (first, of_first) = answered(0..30);
    assert_eq!(first, of_first);
    // The other arrival shows in ten seconds that it is one.
    assert_eq!(answered(50..130).0, 0);
    let (last, of_last) = answered(170..truth.len());
    assert_eq!(last, of_last);
}

#[test]
fn a_view_answers_alone_after_the_one_that_showed_a_different_arrival_is_left_out() {
    let (paired, flights) = each_second();
    let mut disturbed = tracked(&flights[0]);
    let truth = disturbed.clone();
    for (tick, observed) in disturbed.iter_mut().enumerate().skip(30) {
        let other = flights[1].get(tick + 90).and_then(|of| of.best(1));
        observed.show_in(1, other.copied(), Some(50));
        observed.shifts.fill(None);
        if tick >= 80 {
            *observed = observed.without_images(|view| view == 1);
        }
    }
    let chosen = paired.of_one_aircraft(&disturbed);
    assert_eq!(seen(&chosen[50..80]), 0);
    // The other view's last image counts for ten seconds.
    let (alone, of) = (seen(&chosen[92..]), seen(&truth[92..]));
    assert!(alone as f64 > 0.9 * of as f64, "{alone} of {of}");
}

#[test]
fn boxes_of_two_views_are_of_one_aircraft_in_one_row_and_size_and_with_the_parallax_of_that_size() {
    let (paired, flights) = each_second();
    let relation = &paired.relations[0];
    let far = flights[0]
        .iter()
        .find(|observed| observed.detections() == 2)
        .unwrap();
    let [left, right] = [0, 1].map(|view| *far.best(view).unwrap());
    let misfit = |right: PixelBox| relation.misfit([&left, &right]);
    assert!(misfit(right).unwrap() < 10.0, "{:?}", misfit(right));
    let lower = PixelBox {
        cy_px: right.cy_px + 97.0,
        ..right
    };
    let larger = PixelBox {
        width_px: 2.2 * right.width_px,
        ..right
    };
    let beside = PixelBox {
        cx_px: right.cx_px + 400.0,
        ..right
    };
    for other in [lower, larger, beside] {
        assert_eq!(misfit(other), None, "{other:?}");
    }
}

#[test]
fn relations_of_a_view_are_learned_again_without_touching_the_others() {
    let (paired, _) = each_second();
    assert!(paired.is_of(2) && !paired.is_of(1));
    assert!(paired.without(1).relations.is_empty());
    assert_eq!(paired.without(1).paths, paired.paths[..1]);
    assert_eq!(paired.with_view_refitted(1, 2, &[]), paired.without(1));
}

#[test]
fn views_that_see_the_aircraft_together_too_seldom_are_named_with_what_follows() {
    let samples = Samples::synthetic(&every(1), 1.0);
    let true_boxes = samples.with_true_boxes();
    let sees_both = |sample: &&Sample| sample.detections() == 2;
    let common: Vec<&Sample> = true_boxes.iter().filter(sees_both).collect();
    let lines = |learned_from: &[&Sample]| {
        let paired = PairedViews::fit(samples.views.len(), learned_from);
        paired.unrelated(&samples.views, learned_from)
    };
    let few = lines(&common[..29]);
    assert_eq!(few.len(), 1, "{few:?}");
    for words in [
        "are not compared",
        "in 29 ticks",
        "at least 30",
        "the best box of each view counts",
    ] {
        assert!(few[0].contains(words), "{few:?}");
    }
    assert!(lines(&common).is_empty());
}
