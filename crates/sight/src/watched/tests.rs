//! Rendered ground, turned by known amounts.

use dataset::geometry::camera::CameraPose;
use dataset::geometry::pose::Pose;

use glam::DVec2;

use super::*;

pub(crate) const WIDTH: usize = 640;
pub(crate) const HEIGHT: usize = 480;

pub(crate) fn camera() -> Camera {
    let placed = CameraPose {
        pose: Pose {
            latitude_deg: 1.36,
            longitude_deg: 103.98,
            altitude_msl_m: 50.0,
            heading_true_deg: 23.0,
            pitch_deg: 0.0,
            roll_deg: 0.0,
        },
        hfov_deg: 50.0,
    };
    Camera::from_pose(&placed, WIDTH as u32, HEIGHT as u32)
}

/// Brightness of the ground at a place of the reference image: smooth patches of several sizes that do not repeat.
pub(crate) fn ground(place: DVec2) -> f64 {
    let patches = [(6.0, 25.0), (17.0, 30.0), (50.0, 40.0)].map(|(size_px, levels)| {
        let cell = (place / size_px).floor();
        let part = place / size_px - cell;
        let smooth = part * part * (3.0 - 2.0 * part);
        let corner = |x: f64, y: f64| {
            let at = cell + DVec2::new(x, y);
            ((at.x * 12.9898 + at.y * 78.233 + size_px).sin() * 43_758.545).rem_euclid(1.0)
        };
        let row = |y: f64| corner(0.0, y) * (1.0 - smooth.x) + corner(1.0, y) * smooth.x;
        levels * (row(0.0) * (1.0 - smooth.y) + row(1.0) * smooth.y)
    });
    80.0 + patches.iter().sum::<f64>()
}

pub(crate) fn evening(place: DVec2) -> f64 {
    0.6 * ground(place) + 30.0 - 0.02 * place.x
}

/// The image of the ground after a motion.
pub(crate) fn image(motion: Motion, ground: impl Fn(DVec2) -> f64) -> Vec<u8> {
    let camera = camera();
    let places = (0..HEIGHT).flat_map(|row| (0..WIDTH).map(move |column| (column, row)));
    places
        .map(|(column, row)| {
            let place = DVec2::new(column as f64, row as f64);
            let usual = motion.usual_px(&camera, place);
            ground(usual).round().clamp(0.0, 255.0) as u8
        })
        .collect()
}

fn turn(x: f64, y: f64, roll_deg: f64) -> Motion {
    Motion {
        shift_px: DVec2::new(x, y),
        roll_rad: roll_deg.to_radians(),
        ..Motion::default()
    }
}

fn next(motion: &mut Watched, levels: &[u8]) -> Option<Measured> {
    motion.next(&Luma::of(levels, WIDTH))
}

#[track_caller]
fn assert_near(found: Option<Measured>, expected: Motion) {
    let found = found.expect("the ground shows the direction");
    let error_px = found.turn.shift_px.distance(expected.shift_px);
    assert!(error_px < 0.05, "{found:?}, expected {expected:?}");
    let error_deg = (found.turn.roll_rad - expected.roll_rad).to_degrees();
    assert!(error_deg.abs() < 0.01, "{found:?}, expected {expected:?}");
    assert!(found.sd_px < 0.1, "{found:?}");
}

#[test]
fn turns_are_measured_to_a_twentieth_of_a_pixel_also_one_of_a_degree() {
    let mut motion = Watched::new(&camera());
    assert_near(
        next(&mut motion, &image(Motion::default(), ground)),
        Motion::default(),
    );
    for turn in [
        turn(0.5, 0.0, 0.0),
        turn(-0.3, 0.45, 0.0),
        turn(1.7, -1.2, 0.05),
        turn(12.0, -7.0, 0.0),
        turn(0.0, 0.0, 0.0),
        turn(-31.4, 2.2, 0.0),
    ] {
        assert_near(next(&mut motion, &image(turn, ground)), turn);
    }
}

#[test]
fn other_light_and_clouds_that_move_change_nothing() {
    let mut motion = Watched::new(&camera());
    next(&mut motion, &image(Motion::default(), ground)).unwrap();
    let expected = turn(0.8, -0.6, 0.0);
    assert_near(next(&mut motion, &image(expected, evening)), expected);
    let passing = |place: DVec2| {
        let is_cloud = place.x < 200.0;
        ground(if is_cloud {
            place + DVec2::new(3.3, 1.0)
        } else {
            place
        })
    };
    assert_near(next(&mut motion, &image(expected, passing)), expected);
}

#[test]
fn a_ground_without_structure_or_another_one_shows_no_direction() {
    let mut motion = Watched::new(&camera());
    let fog = image(Motion::default(), |_| 120.0);
    assert_eq!(next(&mut motion, &fog), None);
    let mut motion = Watched::new(&camera());
    next(&mut motion, &image(Motion::default(), ground)).unwrap();
    assert_eq!(next(&mut motion, &fog), None);
    let elsewhere = image(Motion::default(), |place| {
        ground(DVec2::new(place.y, 3.0 * place.x))
    });
    assert_eq!(next(&mut motion, &elsewhere), None);
    assert_near(
        next(&mut motion, &fog).or(next(&mut motion, &image(turn(0.4, 0.0, 0.0), ground))),
        turn(0.4, 0.0, 0.0),
    );
}

#[test]
fn a_reference_whose_light_fades_is_replaced_at_its_turn() {
    let mut motion = Watched::new(&camera());
    next(&mut motion, &image(Motion::default(), ground)).unwrap();
    // Ever more ground looks different.
    for part in 0..=20 {
        let until = f64::from(part) * 40.0;
        let turn = turn(0.1 * f64::from(part), 0.0, 0.0);
        let changed = |place: DVec2| {
            let seen = if place.x < until {
                DVec2::new(place.y, place.x)
            } else {
                place
            };
            ground(seen)
        };
        let found = next(&mut motion, &image(turn, changed)).unwrap();
        let error_px = found.turn.shift_px.distance(turn.shift_px);
        assert!(error_px < 0.1, "{part}: {found:?}");
    }
}
