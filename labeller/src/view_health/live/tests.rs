use glam::DVec2;

use super::super::Change;
use super::*;

const RATE: f64 = 30.0;

fn look(image: u32, off_px: Option<f64>, levels: Option<f64>) -> Look {
    Look {
        tick: image,
        time_s: f64::from(image) / RATE,
        turn: off_px.map(|off_px| Measured {
            turn: Motion {
                shift_px: DVec2::new(off_px, 0.0),
                ..Motion::default()
            },
            sd_px: 0.03,
        }),
        change: levels.map(|levels| Change {
            levels,
            whole_levels: levels,
            slopes: [4.0, 0.0, 4.0],
        }),
    }
}

fn box_at(cx_px: f64) -> PixelBox {
    PixelBox {
        cx_px,
        cy_px: 500.0,
        width_px: 60.0,
        height_px: 20.0,
    }
}

#[test]
fn equal_images_of_a_moving_aircraft_are_frozen_and_a_slow_one_is_not() {
    let frozen_from = |px_s: f64, stops: u32| {
        let mut health = LiveHealth::default();
        let states: Vec<_> = (0..600)
            .map(|number| {
                let place = px_s * f64::from(number.min(stops)) / RATE;
                let look = look(number, None, Some(0.2));
                let jitter = 0.3 * (f64::from(number * 37 % 11) / 5.0 - 1.0);
                let jitter = if number > stops { 0.0 } else { jitter };
                health.next(&look, Some(box_at(300.0 + place + jitter)))
            })
            .collect();
        let frozen = |state: &HealthState| *state == HealthState::Frozen;
        states.iter().position(frozen)
    };
    let first = frozen_from(6.0, 300).unwrap();
    assert!((300..335).contains(&first), "{first}");
    for px_s in [0.0, 0.2, 1.0, 6.0, 60.0] {
        assert_eq!(frozen_from(px_s, 600), None, "{px_s} px/s");
    }
}

#[test]
fn a_camera_that_is_moved_is_off_at_once_and_well_again_when_it_is_moved_back() {
    let mut health = LiveHealth::default();
    let state = |number: u32, off_px: Option<f64>, health: &mut LiveHealth| {
        health.next(&look(number, off_px, None), None)
    };
    for number in 0..200 {
        let wobble = 0.05 * f64::from(number % 3);
        let found = state(number, Some(wobble), &mut health);
        assert_eq!(found, HealthState::Steady, "{number}");
    }
    for number in 200..400 {
        let off_px = (number % 10 != 3).then_some(4.0);
        let found = state(number, off_px, &mut health);
        let expected = if number < 280 {
            [HealthState::Shaking, HealthState::Moved].contains(&found)
        } else {
            found == HealthState::Moved
        };
        assert!(expected, "{number}: {found}");
    }
    let last = (400..600).map(|number| state(number, Some(0.0), &mut health));
    assert_eq!(last.last(), Some(HealthState::Steady));
    assert!(health.recent.len() < 80);
}
