//! Rules of states, on directions that are given.

use super::*;

/// A flight with an image every two seconds, whose camera has these directions.
fn looks(directions: impl IntoIterator<Item = Option<DVec2>>) -> Vec<Look> {
    (0..)
        .zip(directions)
        .map(|(tick, direction)| Look {
            tick,
            time_s: 2.0 * f64::from(tick),
            turn: direction.map(|shift_px| Measured {
                turn: Motion {
                    shift_px,
                    ..Motion::default()
                },
                sd_px: 0.03,
            }),
            change: None,
        })
        .collect()
}

/// Numbers between -1 and 1 that do not repeat.
fn wobble(tick: usize) -> DVec2 {
    let part = |factor: f64| (tick as f64 * factor).sin();
    DVec2::new(part(2.3), part(3.7))
}

fn states(looks: &[Look]) -> Vec<HealthState> {
    let judged = judge(looks, &vec![None; looks.len()]);
    judged.into_iter().map(|(state, _)| state).collect()
}

#[test]
fn a_camera_that_stands_still_is_steady_and_one_in_fog_unknown() {
    let still = looks((0..60).map(|tick| Some(wobble(tick) * 0.05)));
    assert_eq!(states(&still), [HealthState::Steady; 60]);
    assert_eq!(states(&looks([None; 60])), [HealthState::Unknown; 60]);
    assert_eq!(states(&[]), []);
}

#[test]
fn a_camera_that_is_aimed_elsewhere_in_mid_flight_has_moved_from_then_on() {
    let moved = looks((0..60).map(|tick| {
        let step = if tick < 25 { 0.0 } else { 9.0 };
        (tick != 40).then_some(DVec2::new(step, 0.0) + wobble(tick) * 0.05)
    }));
    let judged = judge(&moved, &[None; 60]);
    for (tick, (state, turn)) in judged.into_iter().enumerate() {
        let (expected, x_px) = if tick < 25 {
            (HealthState::Steady, 0.0)
        } else {
            (HealthState::Moved, 9.0)
        };
        assert_eq!(state, expected, "tick {tick}");
        match turn {
            Some(turn) => assert!((turn.shift_x_px - x_px).abs() < 0.1, "{tick}: {turn:?}"),
            None => assert_eq!(tick, 40),
        }
    }
}

#[test]
fn a_camera_that_turns_slowly_moves_and_does_not_shake() {
    let turning = looks((0..100).map(|tick| {
        let turned = DVec2::new(0.127 * tick as f64, 0.0);
        Some(turned + wobble(tick) * 0.03)
    }));
    // The first and last ticks have neighbours on one side alone.
    assert_eq!(states(&turning)[20..95], [HealthState::Moved; 75]);
}

#[test]
fn shaking_is_told_at_each_tick_about_the_mean_direction() {
    let centre = DVec2::new(1.0, -2.0);
    let shaking = looks((0..100).map(|tick| Some(centre + wobble(tick) * 2.8)));
    let judged = judge(&shaking, &[None; 100]);
    let told = judged
        .iter()
        .filter(|(state, _)| *state == HealthState::Shaking);
    assert!(told.count() >= 97);
    let sum: DVec2 = (judged.iter().zip(&shaking))
        .map(|((_, turn), look)| {
            let turn = turn.unwrap();
            look.turn.unwrap().turn.shift_px - DVec2::new(turn.shift_x_px, turn.shift_y_px)
        })
        .sum();
    assert!((sum / 100.0).distance(centre) < 0.2, "{sum}");
    // A hundredth of the variance of 2.8 sin is left in the mean.
    let sd_px = usual(&shaking).unwrap().sd_px;
    assert!((0.19..0.21).contains(&sd_px), "{sd_px}");
}

#[test]
fn one_jolt_is_told_and_its_neighbours_are_steady() {
    let jolt = looks((0..30).map(|tick| {
        let by = if tick == 12 { 2.0 } else { 0.0 };
        Some(DVec2::new(0.0, by))
    }));
    for (tick, state) in states(&jolt).into_iter().enumerate() {
        let expected = if tick == 12 {
            HealthState::Shaking
        } else {
            HealthState::Steady
        };
        assert_eq!(state, expected, "tick {tick}");
    }
}

/// A box that moves by 5 px and an image that changes with it, but for the ticks that `frozen` names.
fn flight(frozen: impl Fn(u32) -> bool, px_per_tick: f64) -> (Vec<Look>, Vec<Option<PixelBox>>) {
    let mut looks = looks([Some(DVec2::ZERO); 40]);
    let mut at_px = 500.0;
    let mut boxes = Vec::new();
    for look in &mut looks {
        let is_frozen = frozen(look.tick);
        if !is_frozen {
            at_px = 500.0 + px_per_tick * f64::from(look.tick);
        }
        boxes.push(Some(PixelBox {
            cx_px: at_px,
            cy_px: 600.0,
            width_px: 30.0,
            height_px: 10.0,
        }));
        let changed = 12.0 * px_per_tick.min(1.0);
        look.change = Some(Change {
            levels: if is_frozen { 0.3 } else { changed },
            whole_levels: if is_frozen { 0.05 } else { 0.2 },
            slopes: [144.0, 0.0, 144.0],
        });
    }
    (looks, boxes)
}

#[test]
fn an_image_that_repeats_while_the_aircraft_moves_is_frozen() {
    let frozen = |tick: u32| tick == 9 || (20..24).contains(&tick);
    let (looks, boxes) = flight(frozen, 3.0);
    for (look, (state, _)) in looks.iter().zip(judge(&looks, &boxes)) {
        let is_frozen = state == HealthState::Frozen;
        assert_eq!(is_frozen, frozen(look.tick), "tick {}: {state}", look.tick);
    }
}

#[test]
fn an_image_in_which_the_aircraft_pauses_while_rain_falls_is_not_frozen() {
    let (mut looks, boxes) = flight(|tick| tick == 9, 3.0);
    let frozen = |looks: &[Look]| judge(looks, &boxes)[9].0 == HealthState::Frozen;
    assert!(frozen(&looks));
    looks[9].change.as_mut().unwrap().whole_levels = 0.2;
    assert!(!frozen(&looks));
}

#[test]
fn equal_images_of_nothing_that_moves_are_not_frozen() {
    // Encoders leave out an aircraft that moves by a hundredth of a pixel.
    let (looks, boxes) = flight(|tick| tick % 3 > 0, 0.01);
    assert!(
        judge(&looks, &boxes)
            .iter()
            .all(|(state, _)| *state == HealthState::Steady)
    );
    let (looks, _) = flight(|_| true, 3.0);
    assert!(
        judge(&looks, &[None; 40])
            .iter()
            .all(|(state, _)| *state == HealthState::Steady)
    );
}

#[test]
fn ticks_of_a_shaking_camera_that_are_measured_badly_or_not_at_all_shake_too() {
    let mut hazy = looks((0..60).map(|tick| (tick % 7 > 0).then_some(wobble(tick) * 2.8)));
    for look in &mut hazy {
        if look.tick % 7 == 3 {
            let turn = look.turn.as_mut().unwrap();
            turn.sd_px = 0.9;
        }
    }
    let told = states(&hazy);
    // The first ticks have too few neighbours before them.
    assert_eq!(told[4..], [HealthState::Shaking; 56]);
}
