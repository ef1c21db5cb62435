use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;

use super::*;
use crate::simulator::block::settling::EQUAL_GRABS;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Fake {
    show: Show,
    aircraft_is_visible: bool,
    brightness: u8,
}

impl Scene for Fake {
    fn part(&self, _: Rectangle) -> Vec<u8> {
        let is_here = matches!(self.show, Show::Probe(_)) && self.aircraft_is_visible;
        vec![if is_here { 40 } else { 120 }; 3 * 30]
    }

    fn is_settled_after(&self, before: &Self) -> bool {
        self.brightness == before.brightness
    }
}

/// Faults on the way from a drawn frame to the sequence.
#[derive(Debug, Clone, Copy)]
struct World {
    /// The scene's lag, and the one from a frame on.
    lag: u64,
    later: Option<(u64, u64)>,
    /// Shares of frames: not grabbed, grabbed twice, drawn without the camera.
    lost: f64,
    doubled: f64,
    broken: f64,
    /// Shares of frames over which the number before is shown again, and whose number is missing or half.
    repeated: f64,
    vanished: f64,
    /// Answers come this many frames late.
    late_answers: usize,
    aircraft_is_visible: bool,
    /// First and last tick with the aircraft in the image.
    in_picture: (u32, u32),
    /// Number of frames until the brightness has come to rest.
    settles_after: u64,
    /// Number of frames that settling always takes.
    settle_frames: u32,
}

const GOOD: World = World {
    lag: 2,
    later: None,
    lost: 0.0,
    doubled: 0.0,
    broken: 0.0,
    repeated: 0.0,
    vanished: 0.0,
    late_answers: 0,
    aircraft_is_visible: true,
    in_picture: (0, u32::MAX),
    settles_after: 30,
    settle_frames: 5,
};

struct Recorded {
    shown: Vec<Show>,
    frames: u64,
    tally: Tally,
    lag: Option<u64>,
}

/// Records a block of this many ticks in a world, as plugin, screen and client would together.
fn record(ticks: u32, lag: Option<u64>, world: World, seed: u64) -> Recorded {
    record_from(ticks, (lag, false), world, seed)
}

/// Records a block that may begin with the known lag instead of a probe.
fn record_from(
    ticks: u32,
    (lag, is_measured): (Option<u64>, bool),
    world: World,
    seed: u64,
) -> Recorded {
    let mut random = ChaCha12Rng::seed_from_u64(seed);
    let patch = Rectangle {
        x_px: 0,
        y_px: 0,
        width_px: 6,
        height_px: 5,
    };
    let mut sequence = Sequence::<Fake>::new(
        ticks,
        20,
        world.settle_frames,
        Known {
            lag,
            is_measured,
            ..Known::default()
        },
        Box::new(move |tick| {
            let (from, to) = world.in_picture;
            (from..to).contains(&tick).then_some(patch)
        }),
    );
    let mut waiting: VecDeque<Show> = VecDeque::new();
    let mut answers: VecDeque<(u64, u64)> = VecDeque::new();
    let (mut written, mut number, mut steady) = (Vec::new(), 0_u64, -1_i64);
    let mut last_code = (0, 0);
    let mut shown = Vec::new();
    for frame in 0..40 * u64::from(ticks) + 4_000 {
        while let Some(show) = sequence.next_show() {
            waiting.push_back(show);
        }
        // The plugin: one request per frame, or the last one again; a frame without the camera shows it as well, and has no number.
        let is_broken = random.random_bool(world.broken);
        let next = (!is_broken).then(|| waiting.pop_front()).flatten();
        let Some(now) = next.or(written.last().copied()) else {
            continue;
        };
        written.push(now);
        if is_broken {
            steady = -1;
        } else {
            number += 1;
            steady = (steady + 1).min(7);
            if next.is_some() {
                answers.push_back((frame + world.late_answers as u64, number));
            }
        }
        while answers.front().is_some_and(|(due, _)| *due <= frame) {
            let (_, number) = answers.pop_front().unwrap();
            sequence.answered(number);
        }
        // The screen: the scene of some frames ago under the number of this one.
        let lag = match world.later {
            Some((from, lag)) if frame >= from => lag,
            _ => world.lag,
        };
        let show = written[written.len().saturating_sub(1 + lag as usize)];
        let picture = Fake {
            show,
            aircraft_is_visible: world.aircraft_is_visible,
            brightness: world.settles_after.saturating_sub(frame) as u8,
        };
        // A client that expects no grabs makes none.
        let rests = !sequence.expects_grabs();
        let mut code = (number, steady as u32);
        let vanishes = random.random_bool(world.vanished);
        if random.random_bool(world.repeated) {
            code = last_code;
        } else if !is_broken && !vanishes {
            last_code = code;
        }
        if !is_broken && !rests && !vanishes && !random.random_bool(world.lost) {
            sequence.seen(code.0, code.1, Some(picture));
            if random.random_bool(world.doubled) {
                sequence.seen(code.0, code.1, Some(picture));
            }
        }
        while let Some(taken) = sequence.pictures.deliver() {
            assert_eq!(taken.picture.brightness, 0, "it has settled");
            shown.push(taken.picture.show);
        }
        if sequence.is_done() {
            return Recorded {
                shown,
                frames: frame + 1,
                tally: sequence.tally,
                lag: sequence.known.lag,
            };
        }
    }
    panic!(
        "not done: {world:?}, seed {seed}, tick {}",
        sequence.pictures.delivered
    );
}

fn of_their_ticks(recorded: &Recorded) -> bool {
    let expected = (0..recorded.shown.len() as u32).map(Show::Tick);
    recorded.shown.iter().copied().eq(expected)
}

#[test]
fn every_lag_up_to_four_frames_is_found_and_costs_little() {
    for lag in 0..=4 {
        let recorded = record(1_000, None, World { lag, ..GOOD }, lag);
        assert!(of_their_ticks(&recorded), "lag {lag}");
        assert_eq!(recorded.lag, Some(lag));
        assert_eq!(recorded.tally.repeated, 0, "lag {lag}");
        let frames_per_picture = recorded.frames as f64 / 1_000.0;
        assert!(frames_per_picture < 1.2, "lag {lag}: {frames_per_picture}");
    }
}

#[test]
fn a_block_that_begins_with_the_lag_of_the_last_one_is_shorter_and_no_picture_is_of_another_tick_if_it_has_changed()
 {
    for seed in 0..500 {
        let (lag, before) = (seed % 5, seed / 5 % 5);
        let world = World {
            lag,
            late_answers: seed as usize % 3,
            ..GOOD
        };
        let recorded = record_from(150, (Some(before), true), world, seed);
        assert!(of_their_ticks(&recorded), "{world:?}, {before} before");
        assert_eq!(recorded.lag, Some(lag), "{before} before");
        if lag == before {
            assert_eq!(recorded.tally.repeated, 0, "{world:?}");
            let with_a_probe = record(150, Some(before), world, seed);
            assert!(recorded.frames + 5 <= with_a_probe.frames);
        } else {
            assert!(recorded.tally.repeated > 0, "{world:?}, {before} before");
        }
    }
}

#[test]
fn a_block_whose_lag_is_known_settles_in_the_frames_that_it_always_takes_and_ends_with_one_probe() {
    for settles_after in [0, 1, 4, 6, 20] {
        for lag in 0..=4 {
            let world = World {
                lag,
                settles_after,
                ..GOOD
            };
            let recorded = record_from(20, (Some(lag), true), world, lag);
            assert!(of_their_ticks(&recorded), "{world:?}");
            assert_eq!(recorded.tally.seen, 1, "{world:?}");
            let settled =
                u64::from(world.settle_frames).max(settles_after.max(lag) + u64::from(EQUAL_GRABS));
            let ending = 3 + lag;
            let beside = recorded.frames - 20;
            assert!(
                beside >= u64::from(world.settle_frames),
                "{world:?}: {beside} frames"
            );
            assert!(beside <= settled + ending + 2, "{world:?}: {beside} frames");
        }
    }
}

#[test]
fn a_scene_that_settles_slowly_is_waited_for_as_long_as_it_always_takes() {
    for lag in 0..=4 {
        let slow = World {
            lag,
            settles_after: 110,
            settle_frames: 120,
            ..GOOD
        };
        for begins_with_it in [true, false] {
            let recorded = record_from(20, (Some(lag), begins_with_it), slow, lag);
            assert!(of_their_ticks(&recorded), "{slow:?}");
        }
    }
}

#[test]
fn lost_doubled_and_doubtful_frames_never_give_a_picture_of_another_tick() {
    let mut random = ChaCha12Rng::seed_from_u64(7);
    for seed in 0..40 {
        let world = World {
            lag: random.random_range(0..=4),
            lost: random.random_range(0.0..0.2),
            doubled: random.random_range(0.0..0.2),
            broken: random.random_range(0.0..0.03),
            late_answers: random.random_range(0..4),
            ..GOOD
        };
        let recorded = record(500, None, world, seed);
        assert!(of_their_ticks(&recorded), "{world:?}");
    }
}

#[test]
fn repeated_and_missing_numbers_never_give_a_picture_of_another_tick_and_every_tick_is_recorded() {
    for seed in 0..60 {
        let world = World {
            lag: seed % 5,
            repeated: [0.0, 0.01, 0.05, 0.2][seed as usize / 5 % 4],
            vanished: [0.0, 0.02, 0.1][seed as usize / 20],
            // A busy machine does not see every frame.
            lost: [0.0, 0.03][seed as usize % 2],
            late_answers: seed as usize % 3,
            ..GOOD
        };
        let recorded = record(1_000, None, world, seed);
        assert!(of_their_ticks(&recorded), "{world:?}, seed {seed}");
        println!(
            "{:.2} frames an image: {world:?}",
            recorded.frames as f64 / 1_000.0
        );
    }
}

#[test]
fn a_lag_that_changes_in_mid_block_costs_pictures_but_mixes_none() {
    for seed in 0..40 {
        let world = World {
            lag: seed % 5,
            later: Some((60 + 13 * seed, (seed + 1 + seed % 4) % 5)),
            ..GOOD
        };
        let recorded = record(500, None, world, seed);
        assert!(of_their_ticks(&recorded), "{world:?}");
        assert_eq!(recorded.tally.changes, 1, "{world:?}");
        assert!(recorded.tally.repeated > 0, "{world:?}");
    }
}

#[test]
fn a_lag_that_changes_in_any_frame_of_a_short_block_gives_no_picture_of_another_tick() {
    for (lag, after) in (0..25).map(|pair| (pair / 5, pair % 5)) {
        for from in 0..75 {
            let world = World {
                lag,
                later: Some((from, after)),
                late_answers: from as usize % 3,
                settles_after: 0,
                ..GOOD
            };
            let recorded = record_from(45, (Some(lag), true), world, from);
            assert!(of_their_ticks(&recorded), "{world:?}");
        }
    }
}

#[test]
fn where_the_aircraft_cannot_be_seen_the_known_lag_holds() {
    let fog = World {
        aircraft_is_visible: false,
        lag: 3,
        ..GOOD
    };
    let recorded = record(300, Some(3), fog, 1);
    assert!(of_their_ticks(&recorded));
    assert_eq!((recorded.tally.seen, recorded.tally.held), (0, 0));
    assert!(recorded.tally.unseen > 0);
}

#[test]
fn without_any_known_lag_every_tick_is_held_until_it_has_settled() {
    let fog = World {
        aircraft_is_visible: false,
        lag: 4,
        ..GOOD
    };
    let recorded = record(100, None, fog, 1);
    assert!(of_their_ticks(&recorded));
    assert_eq!(recorded.tally.held, 100);
    assert_eq!(recorded.lag, None);
}

#[test]
fn a_flight_that_is_in_the_picture_for_a_part_only_is_recorded_to_its_end() {
    for in_picture in [(0, 0), (0, 35), (35, u32::MAX), (30, 60)] {
        for known_lag in [None, Some(2)] {
            let world = World { in_picture, ..GOOD };
            let recorded = record(100, known_lag, world, 3);
            assert!(of_their_ticks(&recorded), "{world:?}, {known_lag:?}");
        }
    }
}

#[test]
fn a_lag_that_grows_beyond_what_probes_tell_is_never_confirmed() {
    let world = World {
        lag: 1,
        later: Some((150, 5)),
        ..GOOD
    };
    let recorded = record(200, None, world, 5);
    assert!(of_their_ticks(&recorded));
    assert!(recorded.tally.held > 0);
}

#[test]
fn undisturbed_blocks_repeat_nothing() {
    for seed in 0..1_000 {
        let world = World {
            lag: seed % 5,
            late_answers: seed as usize % 3,
            ..GOOD
        };
        let recorded = record(100, None, world, seed);
        assert!(of_their_ticks(&recorded));
        assert_eq!(recorded.tally.repeated, 0, "{world:?}");
    }
}
