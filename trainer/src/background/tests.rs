use dataset::geometry::camera::CameraPose;
use dataset::geometry::pose::Pose;
use dataset::tables::pixel_box::PixelBox;
use glam::{DVec2, DVec3};

use super::motion::Motion;
use super::*;
use crate::samples::Sample;
use crate::samples::view_shift::ViewShift;

fn planned() -> CameraEntry {
    let pose = Pose {
        latitude_deg: 1.37,
        longitude_deg: 103.98,
        altitude_msl_m: 17.0,
        heading_true_deg: 198.0,
        pitch_deg: 1.6,
        roll_deg: 0.0,
    };
    CameraEntry::from_pose(
        CameraPose {
            pose,
            hfov_deg: 10.0,
        },
        800,
        540,
    )
}

/// Grey levels in a scene without repetition: smooth, with flat blobs some pixels wide, as near a horizon.
fn scene(place: DVec2) -> f64 {
    let node = |x: f64, y: f64| {
        let mixed = (x * 12.9898 + y * 78.233).sin() * 43_758.545;
        40.0 * (mixed - mixed.floor()) + 60.0
    };
    let (x, y) = (place.x / 11.0, place.y / 5.0);
    let smooth = |part: f64| part * part * (3.0 - 2.0 * part);
    let (u, v) = (smooth(x - x.floor()), smooth(y - y.floor()));
    let row = |y: f64| node(x.floor(), y) * (1.0 - u) + node(x.floor() + 1.0, y) * u;
    row(y.floor()) * (1.0 - v) + row(y.floor() + 1.0) * v
}

/// Image from a camera that moved relative to `scene`, with different light and some noise.
fn seen(place: &ViewPlace, motion: Motion, [gain, offset, noise]: [f64; 3]) -> GreyImage {
    let (width, top) = (place.camera.width_px as usize, place.top.unwrap());
    let rows = place.camera.height_px as usize - top;
    let mut random = 1_u64;
    let mut light = Vec::new();
    for row in 0..rows {
        for column in 0..width {
            let at = DVec2::new(column as f64, (top + row) as f64);
            let mut from = at;
            for _ in 0..4 {
                from += at - motion.of_ground(&place.camera, place.horizon_px, from);
            }
            random = random
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            let error = ((random >> 33) as f64 / 2_f64.powi(31) - 0.5) * noise;
            light.push((gain * scene(from) + offset + error) as f32);
        }
    }
    GreyImage { width, top, light }
}

const BY_DAY: [f64; 3] = [1.0, 0.0, 0.0];

fn moved() -> Motion {
    Motion {
        turn_rad: DVec3::new(0.0008, -0.0045, 0.0003),
        stretch: 0.02,
    }
}

#[test]
fn a_turned_and_raised_camera_is_found_whatever_the_light() {
    let place = ViewPlace::of("left", &planned());
    let reference = Reference::of(seen(&place, Motion::default(), BY_DAY));
    let wanted = moved();
    for light in [[1.0, 0.0, 1.0], [0.3, 20.0, 1.0], [-0.5, 140.0, 1.0]] {
        let compared = Compared::of(&seen(&place, wanted, light));
        let found = reference
            .motion_to(&compared, &place.camera, place.horizon_px)
            .unwrap();
        let at_horizon = |motion: Motion| {
            turned(
                &place.camera,
                matrix(motion.turn_rad),
                DVec2::new(300.0, place.horizon_px),
            )
        };
        let error = at_horizon(found.motion) - at_horizon(wanted);
        assert!(error.length() < 0.1, "{error} px with light {light:?}");
        assert!(
            (found.motion.stretch - wanted.stretch).abs() < 0.002,
            "{found:?}"
        );
        assert!(found.sd_px < 0.1, "{found:?}");
    }
}

#[test]
fn a_background_without_anything_in_common_is_not_aligned() {
    let place = ViewPlace::of("left", &planned());
    let picture = seen(&place, Motion::default(), BY_DAY);
    let views = ViewBackgrounds::of(place.clone(), vec![("a".into(), picture)]);
    let noise = Compared::of(&seen(&place, Motion::default(), [0.0, 60.0, 4.0]));
    let located = views
        .motion(0, &noise)
        .map(|measured| views.located(0, &measured));
    assert!(
        located.is_none_or(|located| located.sd_px > MAX_SD_PX),
        "{located:?}"
    );
}

#[test]
fn references_are_placed_by_one_another_and_come_back_from_their_files() {
    let place = ViewPlace::of("left", &planned());
    let pictures = vec![
        ("a".into(), seen(&place, Motion::default(), BY_DAY)),
        ("b".into(), seen(&place, moved(), [0.5, 30.0, 1.0])),
    ];
    let backgrounds = Backgrounds {
        views: vec![ViewBackgrounds::of(place, pictures)],
    };
    let there = &backgrounds.views[0].references[1];
    assert!(
        (there.direction.turn_rad - moved().turn_rad).length() < 1e-4,
        "{:?}",
        there.direction.turn_rad
    );
    let (stored, png) = (backgrounds.stored(), backgrounds.png());
    let back = Backgrounds::of(&stored, &png).unwrap();
    assert_eq!(back.stored(), stored);
    let light = |all: &Backgrounds| all.views[0].references[1].reference.picture().light.clone();
    let differences = light(&back)
        .into_iter()
        .zip(light(&backgrounds))
        .map(|(a, b)| (a - b).abs());
    assert!(differences.fold(0.0, f32::max) <= 0.5 / PARTS + 1e-4);
    assert!(Backgrounds::of(&stored, &png[..png.len() / 2]).is_none());
}

#[test]
fn what_was_seen_goes_where_the_reference_saw_it_and_keeps_its_rays() {
    let place = ViewPlace::of("left", &planned());
    let camera = place.camera;
    let view = ViewBackgrounds {
        place,
        references: Vec::new(),
    };
    let backgrounds = Backgrounds {
        views: vec![view.clone(), view],
    };
    let seen_at = |x_px: f64| PixelBox {
        cx_px: x_px,
        cy_px: 100.0,
        width_px: 30.0,
        height_px: 10.0,
    };
    let mut observed =
        Sample::of_boxes(1.0, vec![Some(seen_at(300.0)), Some(seen_at(350.0))]).observed;
    observed.shifts[1] = Some(ViewShift {
        reference: 0,
        shift_px: DVec2::new(50.25, 0.5),
        sd_px: DVec2::splat(0.03),
        scale: 1.0,
        gain: 1.0,
        correlation: 0.9,
    });
    let turns = [
        DVec3::new(0.001, -0.004, 0.0),
        DVec3::new(0.0, 0.002, 0.001),
    ];
    let mut corrected = observed.clone();
    backgrounds.correct(&mut corrected, &turns.map(Some));
    let ray = |turn: DVec3, seen: DVec2| {
        let mut camera = camera;
        camera.ecef_from_camera *= matrix(turn);
        camera.ray(seen)
    };
    let centre = |all: &Observation, view: usize| {
        all.boxes[view]
            .map(|seen| DVec2::new(seen.cx_px, seen.cy_px))
            .unwrap()
    };
    for (view, turn) in turns.into_iter().enumerate() {
        let (before, after) = (centre(&observed, view), centre(&corrected, view));
        assert!((after - before).length() > 5.0);
        assert!((ray(turn, after) - camera.ray(before)).length() < 1e-12);
    }
    let shift = corrected.shifts[1].unwrap().shift_px;
    let followed = centre(&corrected, 0) + shift;
    let before = camera.ray(centre(&observed, 0) + DVec2::new(50.25, 0.5));
    assert!((ray(turns[1], followed) - before).length() < 1e-12);
    backgrounds.correct(&mut corrected, &[Some(DVec3::ZERO), None]);
    assert_eq!(
        (corrected.boxes[1], corrected.shifts[1]),
        (None, None),
        "not aligned"
    );
    assert!(corrected.boxes[0].is_some());
}
