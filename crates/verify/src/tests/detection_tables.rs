use super::*;

/// A box of the first image.
fn detection() -> Detection {
    let pixel_box = PixelBox::from_edges(10.0, 10.0, 20.0, 20.0);
    Detection::untracked(0, "left", pixel_box, 0.5, 0)
}

/// The reason why an image has no box.
fn miss(tick: u32) -> Miss {
    Miss {
        tick,
        view: "left".into(),
        mode: SearchMode::Full,
        reason: MissReason::Nothing,
    }
}

/// Findings in an example with these detections and this record.
fn with_detections(found: &Detections, record: &Value) -> String {
    with_tables(NewTables::unregistered(found), record).findings()
}

#[test]
fn a_faint_box_that_does_not_count_is_found() {
    let settings = json!({"settings": {"score": 0.7, "faint_score": 0.4}});
    for (confirmed, words) in [
        (true, ""),
        (
            false,
            "settings.score is above 0.5, the score of a box that does not count",
        ),
    ] {
        let found = Detection {
            confirmed,
            ..detection()
        };
        let findings = with_detections(&vec![found].into(), &settings);
        assert_eq!(findings.is_empty(), words.is_empty(), "{findings}");
        assert!(findings.contains(words), "{findings}");
    }
}

#[test]
fn counts_settings_and_models_that_cannot_be_are_found_in_records_of_detections() {
    let sound = json!({"pictures": 10, "detections": 1, "misses": 1, "seconds": 0.1,
        "settings": {"tile_score": 0.15, "score": 0.3, "merge_iou": 0.3, "most_windows": 6}});
    let found = Detections {
        boxes: vec![detection()],
        misses: vec![miss(1)],
    };
    assert_eq!(with_detections(&found, &sound), "");
    for (record, words) in [
        (json!({"pictures": 9}), "pictures is 9, expected 10"),
        (json!({"detections": 4_000_000_000_u64}), "expected 1"),
        (json!({"misses": 2}), "misses is 2, expected 1"),
        (json!({"detections": -1}), "record of detections"),
        (json!({"seconds": -1.0}), "seconds is -1"),
        (
            json!({"settings": {"score": 1e308}}),
            "settings.score 1e308 is out of range",
        ),
        (
            json!({"settings": {"faint_score": 2}}),
            "settings.faint_score 2 is out of range",
        ),
        (
            json!({"settings": {"score": 0.7, "faint_score": 0.6}}),
            "settings.faint_score is above 0.5, the score of a box of view left at tick 0",
        ),
        (
            json!({"settings": {"most_windows": 0}}),
            "settings.most_windows 0",
        ),
        (json!({"model_blake3": "mine"}), "64 hexadecimal digits"),
        (json!({"model_blake3": "b".repeat(64)}), "begin with aaaa"),
        (
            json!({"profile_blake3": "a".repeat(64)}),
            "whose hash begins with aaaa",
        ),
    ] {
        let findings = with_detections(&found, &record);
        assert!(
            findings.contains("aaaa.json") && findings.contains(words),
            "{findings}"
        );
    }
}

#[test]
fn a_reason_for_no_box_beside_a_box_or_of_no_picture_is_found() {
    for (tick, words) in [
        (
            0,
            "tick 0 of the view has the reason \"nothing\" for no box, and other rows too",
        ),
        (99, "tick: is 99, expected below 5"),
    ] {
        let found = Detections {
            boxes: vec![detection()],
            misses: vec![miss(tick)],
        };
        let findings = with_detections(&found, &json!({}));
        assert!(findings.contains(words), "{findings}");
    }
}
