use super::*;

#[test]
fn boxes_that_are_missing_moved_doubled_or_not_numbers_are_found() {
    type Change = fn(&mut Vec<TruthBox>);
    let changes: [(&str, Change); 5] = [
        ("but no box", |boxes| drop(boxes.remove(1))),
        ("is not around the aircraft's centre of gravity", |boxes| {
            boxes[0].pixel_box.cx_px += 4.0;
        }),
        ("which has a box already", |boxes| {
            boxes.push(boxes[0].clone());
        }),
        ("is not inside the image", |boxes| {
            boxes[0].pixel_box.width_px += 500.0;
        }),
        ("distance and visibility give", |boxes| {
            boxes[0].transmission *= 0.9;
        }),
    ];
    for (words, change) in changes {
        let findings = Example::with(|example| {
            let mut boxes = truth_boxes();
            change(&mut boxes);
            TruthBox::write(&boxes, &example.scenario().truth_boxes_path()).unwrap();
        });
        assert_found(&findings, words);
        assert!(findings.contains("boxes_truth.parquet"), "{findings}");
    }
    let findings = Example::with(|example| {
        let path = example.scenario().truth_boxes_path();
        overwrite(&path, "width_px", 0, f64::NAN);
    });
    let words = "boxes_truth.parquet row 0: width_px NaN is out of range";
    assert_found(&findings, words);
}
