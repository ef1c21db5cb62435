use dataset::conditions::sight::Sight;
use dataset::corpus::detections::Detection;
use dataset::tables::pixel_box::TruthBox;

use super::false_boxes::FalseBoxes;
use super::statistics::{DetectionCounts, TruthCounts, TruthInSight};
use super::*;

#[test]
fn a_box_that_only_touches_the_aircraft_is_no_hit_and_no_false_alarm() {
    let truth = PixelBox::from_edges(100.0, 100.0, 120.0, 107.0);
    let found = |left: f64, width: f64| PixelBox::from_edges(left, 100.0, left + width, 107.0);
    for (found, expected) in [
        (found(103.0, 20.0), Match::Hit),
        (found(115.0, 20.0), Match::Loose),
        (found(20.0, 200.0), Match::Loose),
        (found(121.0, 20.0), Match::Elsewhere),
    ] {
        assert_eq!(Match::of(&found, &truth), expected, "{found:?}");
    }
}

fn at(cx_px: f64) -> PixelBox {
    PixelBox {
        cx_px,
        cy_px: 100.0,
        width_px: 20.0,
        height_px: 8.0,
    }
}

fn real(tick: u32, view: &str, visible_fraction: f64) -> TruthInSight {
    let truth = TruthBox {
        tick,
        view: view.into(),
        class: "aircraft".into(),
        pixel_box: at(100.0),
        visible_fraction,
        truncation: 0.0,
        transmission: 1.0,
        aircraft_number: None,
        occluded_fraction: None,
    };
    TruthInSight {
        truth,
        sight: Sight::Open,
    }
}

fn seen(tick: u32, view: &str, cx_px: f64, score: f64) -> Detection {
    Detection::untracked(tick, view, at(cx_px), score, 0)
}

#[test]
fn found_missed_and_false_are_counted_by_view_and_tick() {
    let truth = [
        real(0, "left", 1.0),
        real(0, "right", 1.0),
        real(1, "left", 1.0),
        real(2, "left", 0.2),
    ];
    let detections = [
        seen(0, "left", 103.0, 0.9),
        seen(0, "left", 500.0, 0.4), // false, but not the best
        seen(1, "left", 500.0, 0.9), // false, and the best: found nevertheless
        seen(1, "left", 100.0, 0.5),
        seen(1, "right", 100.0, 0.5), // no truth there: false
        seen(2, "left", 100.0, 0.5),  // hardly visible: neither expected nor false
        Detection {
            confirmed: false, // does not count
            ..seen(2, "left", 500.0, 0.9)
        },
    ];
    let counts = DetectionCounts::of(6, &detections, Some(&truth));
    let truth = counts.against_truth.unwrap();
    assert_eq!(
        (truth.expected, truth.found, truth.false_detections),
        (3, 2, 3)
    );
    assert_eq!(truth.sum_center_offset_px, [3.0, 0.0]);
    assert_eq!(truth.detection_rate(), Some(2.0 / 3.0));
}

#[test]
fn each_aircraft_of_an_image_counts_and_a_box_between_two_is_false_to_neither() {
    let of = |number: u32, cx_px: f64, occluded: f64| {
        let mut one = real(0, "left", 1.0);
        one.truth.pixel_box = at(cx_px);
        one.truth.aircraft_number = Some(number);
        one.truth.occluded_fraction = Some(occluded);
        one
    };
    let truth = [
        of(0, 100.0, 0.0),
        of(1, 112.0, 0.0),
        of(2, 300.0, 0.0),
        of(3, 500.0, 0.7),
    ];
    let detections = [
        seen(0, "left", 106.0, 0.9), // hits both
        seen(0, "left", 700.0, 0.9), // false
    ];
    let counts = DetectionCounts::of(1, &detections, Some(&truth));
    let counts = counts.against_truth.unwrap();
    // The fourth is behind another one.
    assert_eq!(
        (counts.expected, counts.found, counts.false_detections),
        (3, 2, 1)
    );
    let found = FalseBoxes::of("0001-a", &detections, &truth);
    assert_eq!((found[0].boxes, found[0].cx_px), (1, 700.0));
}

#[test]
fn an_aircraft_that_fog_or_clouds_hide_is_neither_found_nor_missed() {
    let behind = |tick: u32, sight: Sight| TruthInSight {
        sight,
        ..real(tick, "left", 1.0)
    };
    let truth = [
        behind(0, Sight::Haze),
        behind(1, Sight::Haze),
        behind(2, Sight::Cloud),
        behind(3, Sight::Open),
    ];
    let detections = [
        seen(1, "left", 100.0, 0.9), // its lights in the haze: not false
        seen(3, "left", 100.0, 0.9),
    ];
    let counts = DetectionCounts::of(4, &detections, Some(&truth));
    let counts = counts.against_truth.unwrap();
    assert_eq!((counts.expected, counts.found), (1, 1));
    assert_eq!(
        (counts.hidden_by_haze, counts.maybe_hidden_by_cloud),
        (2, 1)
    );
    assert_eq!(counts.false_detections, 0);
}

#[test]
fn scenarios_without_labels_leave_the_truth_missing() {
    let mut sum = DetectionCounts::of(2, &[seen(0, "left", 1.0, 0.9)], None);
    sum.add(&DetectionCounts::of(2, &[], None));
    assert_eq!(
        (sum.pictures, sum.detections, sum.against_truth),
        (4, 1, None)
    );
    assert_eq!(sum.confirmed, 1);
    assert_eq!(TruthCounts::default().detection_rate(), None);
}

fn tracked(tick: u32, view: &str, cx_px: f64, track: u32) -> Detection {
    Detection {
        track: Some(track),
        ..Detection::untracked(tick, view, at(cx_px), 0.9, 0)
    }
}

#[test]
fn confirmed_boxes_beside_the_aircraft_are_told_by_view_with_the_place_of_the_largest_track() {
    let truth = [0, 1, 2].map(|tick| real(tick, "left", 1.0));
    let detections = [
        tracked(0, "left", 105.0, 0),
        tracked(0, "left", 700.0, 1),
        tracked(1, "left", 500.0, 2),
        tracked(1, "right", 100.0, 0), // no truth there
        tracked(2, "left", 501.0, 2),
        Detection {
            confirmed: false,
            ..tracked(2, "left", 800.0, 3)
        },
    ];
    let found = FalseBoxes::of("0001-a", &detections, &truth);
    let told: Vec<_> = found
        .iter()
        .map(|of| (of.view.as_str(), of.boxes, of.tracks, of.tick, of.cx_px))
        .collect();
    assert_eq!(told, [("left", 3, 2, 1, 501.0), ("right", 1, 1, 1, 100.0)]);
    assert_eq!(FalseBoxes::of("0001-a", &detections[..1], &truth), []);
}
