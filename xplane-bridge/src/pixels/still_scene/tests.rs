//! Random scenes, weathers and covers. `DTD_STILL_SCENE_RUNS=100` runs more.

mod scenery;

use scenery::{CoverForm, Random, Scenery, Sky};

use super::*;

const WIDTH_PX: u32 = 320;
const HEIGHT_PX: u32 = 208;
/// Images that are looked at, after those that are watched.
const PICTURES: u32 = 120;

/// Random runs of each test.
fn runs(few: u64) -> u64 {
    match std::env::var("DTD_STILL_SCENE_RUNS") {
        Ok(runs) => runs.parse().expect("DTD_STILL_SCENE_RUNS is a number"),
        Err(_) => few,
    }
}

/// Weathers in a paused world, and in one where time runs.
const SKIES: [Sky; 8] = [
    Sky::Clear,
    Sky::Grainy,
    Sky::Rippling,
    Sky::Swinging { levels: 8 },
    Sky::Swinging { levels: 60 },
    Sky::Cloudy,
    Sky::Drizzle,
    Sky::Storm,
];

/// Looks at a random scene's images, some of them covered; returns the found ones, and those that may be covered although they were
/// accepted.
fn looked(
    seed: u64,
    sky: Sky,
    covered: &dyn Fn(u32, &mut [u8], &mut Random),
) -> Vec<Option<Cover>> {
    let mut scenery = Scenery::new(seed, (WIDTH_PX, HEIGHT_PX), sky);
    let mut rgb = Vec::new();
    let mut pictures = (0..sky.watched() + PICTURES).map(|picture| {
        let aircraft = scenery.draw(picture, &mut rgb);
        covered(picture, &mut rgb, &mut Random::new(seed));
        (rgb.clone(), aircraft)
    });
    if sky.time() == WorldTime::Runs {
        let mut scene = RunningScene::new(WIDTH_PX, HEIGHT_PX);
        return pictures
            .map(|(rgb, aircraft)| scene.look(&rgb, &[aircraft]).err())
            .collect();
    }
    let mut scene = PausedScene::new(WIDTH_PX, HEIGHT_PX);
    let watched = sky.watched() as usize;
    for (rgb, aircraft) in pictures.by_ref().take(watched) {
        scene.watch(&rgb, &[aircraft]);
    }
    assert!(!scene.moves_too_much());
    let looked = pictures.map(|(rgb, aircraft)| scene.look(&rgb, &[aircraft]).err());
    vec![None; watched].into_iter().chain(looked).collect()
}

/// Images that would be used: accepted, and not named afterwards.
fn used(found: &[Option<Cover>]) -> Vec<bool> {
    let mut used = vec![true; found.len()];
    for (at, cover) in found.iter().enumerate() {
        if let Some(cover) = cover {
            let from = at.saturating_sub(cover.pictures_before as usize);
            used[from..=at].fill(false);
        }
    }
    used
}

#[test]
fn undisturbed_scenes_are_never_covered_in_any_weather() {
    for sky in SKIES {
        for seed in 0..runs(4) {
            let found = looked(seed, sky, &|_, _, _| ());
            let first = found.iter().position(Option::is_some);
            assert_eq!(
                first,
                None,
                "{sky:?}, seed {seed}: {:?}",
                found[first.unwrap()]
            );
        }
    }
}

/// Covers over 2 % of the image that come and go: number of runs, and of those in which the cover was not seen to go.
fn covers_come_and_go(sky: Sky) -> (usize, usize) {
    let (mut runs_made, mut stuck) = (0, 0);
    for form in CoverForm::ALL {
        for seed in 0..runs(3) {
            let mut random = Random::new(seed ^ 0xC0FE);
            let from = sky.watched().max(LEARNT as u32) + 2 + random.below(60);
            let to = from + 20 + random.below(30);
            let found = looked(seed, sky, &|picture, rgb, random| {
                if (from..to).contains(&picture) {
                    form.draw(rgb, (WIDTH_PX, HEIGHT_PX), 0.02, random);
                }
            });
            let used = used(&found);
            let missed = (from..to).find(|picture| used[*picture as usize]);
            assert_eq!(
                missed, None,
                "{sky:?}, {form:?}, seed {seed}, {from}..{to}: {found:?}"
            );
            let last = found.iter().rposition(Option::is_some);
            runs_made += 1;
            if let Some(last) = last.filter(|last| *last >= to as usize + 2) {
                println!(
                    "{sky:?}, {form:?}, seed {seed}, {from}..{to}: {last} {:?}",
                    found[last]
                );
                stuck += 1;
            }
        }
    }
    println!("{sky:?}: {stuck} of {runs_made} covers were not seen to go");
    (runs_made, stuck)
}

#[test]
fn in_a_pause_covers_of_two_percent_are_in_no_picture_that_is_used_and_are_seen_to_go() {
    for sky in [Sky::Clear, Sky::Grainy, Sky::Swinging { levels: 20 }] {
        assert_eq!(covers_come_and_go(sky).1, 0, "{sky:?}");
    }
}

#[test]
fn while_time_runs_they_are_in_none_either_but_some_are_not_seen_to_go() {
    for sky in [Sky::Drizzle, Sky::Cloudy, Sky::Storm] {
        let (runs, stuck) = covers_come_and_go(sky);
        assert!(4 * stuck <= runs, "{sky:?}: {stuck} of {runs}");
    }
}

#[test]
fn over_moving_water_a_cover_is_found_by_its_brightness() {
    for seed in 0..runs(8) {
        let mut random = Random::new(seed);
        let (x, y) = (random.below(WIDTH_PX - 64), 160 + random.below(18));
        let place = Rectangle::between(x, y, x + 64, y + 30);
        let from = Sky::Rippling.watched() + 20;
        let to = from + 40;
        let found = looked(seed, Sky::Rippling, &|picture, rgb, _| {
            if (from..to).contains(&picture) {
                scenery::brighten(rgb, WIDTH_PX, place, 60);
            }
        });
        for (picture, found) in (0..).zip(found) {
            let is_covered = (from..to).contains(&picture);
            assert_eq!(found.is_some(), is_covered, "seed {seed}, image {picture}");
        }
    }
}

/// True if a square that differs by 40 levels is found wherever it lies.
fn is_found_everywhere(sky: Sky, side_px: u32) -> bool {
    (0..16).all(|offset| {
        let found = looked(3, sky, &|picture, rgb, _| {
            if picture == 20 {
                let (x, y) = (160 + offset, 16 + (offset * 7) % 16);
                let square = Rectangle::between(x, y, x + side_px, y + side_px);
                scenery::brighten(rgb, WIDTH_PX, square, 40);
            }
        });
        found[20].is_some()
    })
}

#[test]
fn the_smallest_square_that_is_always_found_has_12_pixels_in_a_pause_and_20_while_time_runs() {
    for (sky, smallest_px) in [(Sky::Clear, 12), (Sky::Storm, 20)] {
        assert!(is_found_everywhere(sky, smallest_px), "{sky:?}");
        assert!(!is_found_everywhere(sky, smallest_px / 2), "{sky:?}");
    }
}

#[test]
fn a_cover_from_the_beginning_is_noticed_when_it_goes() {
    for sky in [Sky::Clear, Sky::Storm] {
        let found = looked(5, sky, &|picture, rgb, random| {
            if picture < 30 {
                CoverForm::Message.draw(rgb, (WIDTH_PX, HEIGHT_PX), 0.02, random);
            }
        });
        assert!(found[..30].iter().all(Option::is_none), "{sky:?}");
        assert!(found[30].is_some(), "{sky:?}");
    }
}

#[test]
fn what_comes_and_goes_while_the_noise_is_learnt_is_found_at_its_end() {
    for sky in [Sky::Drizzle, Sky::Storm] {
        let found = looked(6, sky, &|picture, rgb, random| {
            if picture == 2 {
                CoverForm::Message.draw(rgb, (WIDTH_PX, HEIGHT_PX), 0.02, random);
            }
        });
        let cover = found[LEARNT].expect("found with the last learnt image");
        assert_eq!(cover.pictures_before as usize, LEARNT, "{sky:?}");
        let late = found.iter().rposition(Option::is_some);
        let late = late.map(|late| (late, found[late]));
        assert!(
            late.is_some_and(|(at, _)| at <= 4 * LEARNT),
            "{sky:?}, {late:?}"
        );
    }
}

#[test]
fn a_scene_that_moves_otherwise_than_while_it_was_watched_is_noticed_and_one_that_moves_all_over_is_refused()
 {
    let sky = Sky::Swinging { levels: 20 };
    let mut scenery = Scenery::new(2, (WIDTH_PX, HEIGHT_PX), sky);
    let mut scene = PausedScene::new(WIDTH_PX, HEIGHT_PX);
    let mut rgb = Vec::new();
    let aircraft = scenery.draw(0, &mut rgb);
    scene.watch(&rgb, &[aircraft]);
    // Half a second is too short.
    let noticed = (1..200).any(|picture| {
        let aircraft = scenery.draw(picture, &mut rgb);
        scene.look(&rgb, &[aircraft]).is_err()
    });
    assert!(noticed);
    scene.forget();
    for level in [60, 160] {
        rgb.fill(level);
        scene.watch(&rgb, &[]);
    }
    assert!(scene.moves_too_much());
}

#[test]
fn an_opaque_cover_that_comes_in_gradually_is_found_by_standing_still_in_the_rain() {
    let (from, complete) = (50, 66);
    let place = Rectangle::between(90, 40, 190, 100);
    for seed in 0..runs(4) {
        let found = looked(seed, Sky::Storm, &|picture, rgb, _| {
            if picture >= from {
                let share = f64::from((picture - from + 1).min(complete - from));
                let opacity = share / f64::from(complete - from);
                // As bright as the scene, so that no step is large.
                scenery::fill(rgb, WIDTH_PX, place, [128, 134, 140], opacity);
            }
        });
        let at = found.iter().position(Option::is_some).expect("it is found");
        let cover = found[at].unwrap();
        let first = at as u32 - cover.pictures_before.min(at as u32);
        assert!(first <= from, "seed {seed}: at {at} {cover:?}");
        assert!(found[at..].iter().all(Option::is_some), "seed {seed}");
        let Rectangle { x_px, width_px, .. } = cover.rectangle;
        let is_inside = x_px >= 90 - 16 && x_px + width_px <= 190 + 16;
        assert!(is_inside, "seed {seed}: {cover:?}");
    }
}
