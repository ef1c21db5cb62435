use dataset::geometry::camera::CameraPose;
use dataset::geometry::pose::Pose;
use sight::ground::Ground;

use super::*;
use crate::samples::Sample;
use crate::samples::tests::fixtures::box_at;
use crate::samples::view_shift::ViewShift;

/// 20 seconds of arc, pixels.
const STABILITY_PX: f64 = 0.44;

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
        80.0 * (mixed - mixed.floor()) + 60.0
    };
    let (x, y) = (place.x / 11.0, place.y / 5.0);
    let smooth = |part: f64| part * part * (3.0 - 2.0 * part);
    let (u, v) = (smooth(x - x.floor()), smooth(y - y.floor()));
    let row = |y: f64| node(x.floor(), y) * (1.0 - u) + node(x.floor() + 1.0, y) * u;
    row(y.floor()) * (1.0 - v) + row(y.floor() + 1.0) * v
}

/// Background of a camera that has moved before a scene.
fn seen(motion: Motion, scene: impl Fn(DVec2) -> f64) -> Background {
    let camera = planned().camera();
    let top_px = Ground::of(&camera).top;
    let rows = top_px..camera.height_px as usize;
    let places = rows.flat_map(|row| (0..camera.width_px).map(move |column| (column, row)));
    let levels = places.map(|(column, row)| {
        let place_px = DVec2::new(f64::from(column), row as f64);
        scene(motion.usual_px(&camera, place_px)).round() as u8
    });
    Background {
        width_px: camera.width_px as usize,
        top_px,
        levels: levels.collect(),
        images: background::IMAGES,
        turn: Motion::default(),
    }
}

fn moved() -> Motion {
    Motion {
        shift_px: DVec2::new(5.3, -2.4),
        roll_rad: 0.0004,
        zoom: 0.004,
        lift: 0.0,
    }
}

fn evening(place: DVec2) -> f64 {
    0.6 * scene(place) + 20.0
}

fn elsewhere(place: DVec2) -> f64 {
    scene(place + DVec2::new(9_000.0, 500.0))
}

/// A view with these references.
fn view(name: &str, backgrounds: Vec<Background>) -> View {
    let named = backgrounds.into_iter().enumerate();
    let named = named.map(|(index, background)| (format!("flight {index}"), background));
    let learned = StoredView {
        view: name.into(),
        planned: planned(),
        known: None,
        usual_px: [0.0; UNKNOWNS],
        spread_px: [0.0; UNKNOWNS],
        stability_px: [STABILITY_PX, STABILITY_PX, 0.04, 0.08, 0.0],
        references: Vec::new(),
    };
    View {
        learned,
        references: References::learn(&planned().camera(), named.collect(), false),
    }
}

/// Two views, the left one with references that begin at different rows, as of cameras that vary.
fn learned() -> Backgrounds {
    let mut lower = seen(moved(), evening);
    lower.levels.drain(..3 * lower.width_px);
    lower.top_px += 3;
    let left = [seen(Motion::default(), scene), lower];
    let right = vec![seen(Motion::default(), elsewhere)];
    Backgrounds {
        views: vec![view("left", left.into()), view("right", right)],
    }
}

fn observed() -> Observation {
    let mut observed = Sample::of_boxes(
        1.0,
        vec![Some(box_at(300.0, 100.0)), Some(box_at(350.0, 100.0))],
    )
    .observed;
    observed.shifts[1] = Some(ViewShift {
        reference: 0,
        from_px: DVec2::new(300.0, 100.0),
        shift_px: DVec2::new(50.25, 0.5),
        sd_px: DVec2::splat(0.03),
    });
    observed
}

fn centre_px(observed: &Observation, view: usize) -> DVec2 {
    centre_and_size(observed.best(view).unwrap()).0
}

#[test]
fn what_a_moved_camera_sees_goes_where_the_reference_saw_it_and_keeps_its_rays() {
    let backgrounds = learned();
    let camera = planned().camera();
    let before = observed();
    let mut sights = backgrounds.unseen();
    let motions = [moved(), moved().back()];
    for (sight, motion) in sights.0.iter_mut().zip(motions) {
        sight.as_mut().unwrap().motion = motion;
    }
    let after = backgrounds.corrected(&before, &sights);
    let seen_again = |motion: Motion, usual_px: DVec2| {
        motion.place_px(&camera, camera.image_of(usual_px).extend(1.0))
    };
    for (view, motion) in motions.into_iter().enumerate() {
        let (before, after) = (centre_px(&before, view), centre_px(&after, view));
        assert!(before.distance(after) > 5.0, "{before} and {after}");
        assert!(seen_again(motion, after).distance(before) < 1e-6);
    }
    let followed_px = centre_px(&after, 0) + after.shift(1).unwrap().shift_px;
    let there_px = centre_px(&before, 0) + DVec2::new(50.25, 0.5);
    assert!(seen_again(motions[1], followed_px).distance(there_px) < 1e-6);
}

#[test]
fn a_camera_is_moved_exchanged_or_as_usual_by_its_background_and_as_stable_as_usual_without_one() {
    let backgrounds = learned();
    let mut sights = backgrounds.unseen();
    let mut show = |motion, scene: fn(DVec2) -> f64| {
        let shown = backgrounds.show(&mut sights, 0, &seen(motion, scene));
        (shown, backgrounds.corrected(&observed(), &sights))
    };
    let errors_px = |observed: &Observation| {
        let of_left = observed.common_errors.iter().filter(|of| of.view == 0);
        of_left.map(|of| of.sd_px.length()).fold(0.0, f64::max)
    };
    let (shown, seen) = show(Motion::default(), evening);
    assert_eq!(shown, Shown::Usual);
    assert!(centre_px(&seen, 0).distance(centre_px(&observed(), 0)) < 0.1);
    let (shown, seen) = show(moved(), scene);
    // In a corner, where the zoom adds to the turn.
    let corner_px = moved().usual_px(&planned().camera(), DVec2::new(800.0, 0.0));
    let expected_px = DVec2::new(800.0, 0.0) - corner_px;
    assert!(
        matches!(shown, Shown::Moved(off_px) if off_px.distance(expected_px) < 0.15),
        "{shown:?}"
    );
    let usual_px = moved().usual_px(&planned().camera(), centre_px(&observed(), 0));
    assert!(centre_px(&seen, 0).distance(usual_px) < 0.15, "{seen:?}");
    assert!(errors_px(&seen) < 0.15, "{seen:?}");
    let (shown, seen) = show(Motion::default(), elsewhere);
    assert_eq!(shown, Shown::OtherView("right".into()));
    assert_eq!((seen.best(0), seen.shift(1)), (None, None));
    assert!(seen.best(1).is_some());
    let (shown, seen) = show(Motion::default(), |place| {
        scene(DVec2::new(7_000.0 - place.x, place.y))
    });
    assert_eq!((shown, seen.best(0)), (Shown::Elsewhere, None));
    let (shown, seen) = show(Motion::default(), |_| 120.0);
    assert_eq!(shown, Shown::Unknown);
    assert!(seen.best(0).is_some());
    assert!((errors_px(&seen) - STABILITY_PX).abs() < 0.02, "{seen:?}");
}

#[test]
fn references_are_placed_by_one_another_and_come_back_from_their_files() {
    let backgrounds = learned();
    let second = &backgrounds.views[0].references.all()[1];
    assert!(
        second.motion.shift_px.distance(moved().shift_px) < 0.1,
        "{second:?}"
    );
    assert!(
        (second.motion.zoom - moved().zoom).abs() < 1e-4,
        "{second:?}"
    );
    let (stored, png) = (backgrounds.stored(), backgrounds.png());
    let back = Backgrounds::of(&stored, &png).unwrap();
    assert_eq!(back.stored(), stored);
    assert_eq!(back.png(), png);
    let flight = seen(moved(), scene);
    let shown = |all: &Backgrounds| all.show(&mut all.unseen(), 0, &flight);
    assert_eq!(shown(&back), shown(&backgrounds));
    assert!(Backgrounds::of(&stored, &png[..png.len() / 2]).is_none());
}
