use super::*;

const WINDOW_PX: [u32; 2] = [640; 2];

/// The box that every test puts into an output, in corner-origin pixels, and its score.
const HIDDEN: [f32; 4] = [100.5, 50.5, 20.0, 8.0];
const SCORE: f32 = 0.75;

fn decode(
    shape: &[usize],
    data: &[f32],
    windows: usize,
    profile: ModelProfile,
) -> Vec<Vec<ScoredBox>> {
    let layout = profile
        .layout
        .or(Layout::of_shape(shape, WINDOW_PX))
        .unwrap();
    let decoding = Decoding {
        layout,
        profile: &profile,
        window_px: WINDOW_PX,
        score_floor: 0.5,
    };
    let answer = Answer::new(shape, data).unwrap();
    decoding.decode(answer, windows).unwrap()
}

fn fault(layout: Layout, shape: &[usize], data: &[f32], windows: usize) -> String {
    let decoding = Decoding {
        layout,
        profile: &ModelProfile::default(),
        window_px: WINDOW_PX,
        score_floor: 0.5,
    };
    let answer = Answer::new(shape, data).unwrap();
    decoding.decode(answer, windows).unwrap_err().to_string()
}

fn assert_hidden_box(found: &[ScoredBox], cx_px: f64, cy_px: f64) {
    assert_eq!(found.len(), 1, "{found:?}");
    let PixelBox {
        cx_px: x,
        cy_px: y,
        width_px,
        height_px,
    } = found[0].pixel_box;
    let errors = [x - cx_px, y - cy_px, width_px - 20.0, height_px - 8.0];
    assert!(errors.iter().all(|error| error.abs() < 1e-4), "{found:?}");
    assert!(
        (found[0].score - f64::from(SCORE)).abs() < 1e-6,
        "{found:?}"
    );
}

#[test]
fn layouts_are_told_apart_by_rank_and_sizes() {
    let cases: [(&[usize], Option<Layout>); 11] = [
        (&[6, 6_400, 6], Some(Layout::Rows)),
        (&[1, 25_200, 85], Some(Layout::AnchorRows)),
        (&[1, 25_200, 6], Some(Layout::AnchorRows)),
        (&[1, 8_400, 85], Some(Layout::Yolox)),
        (&[1, 84, 8_400], Some(Layout::Columns)),
        (&[1, 5, 8_400], Some(Layout::Columns)),
        (&[1, 300, 6], Some(Layout::Corners)),
        (&[12, 7], Some(Layout::BatchCorners)),
        (&[1, 3, 80, 80, 85], None),
        (&[1, 100, 85], None),
        (&[1, 1_000], None),
    ];
    for (shape, layout) in cases {
        assert_eq!(Layout::of_shape(shape, WINDOW_PX), layout, "{shape:?}");
    }
    assert_eq!(
        Layout::of_shape(&[1, 3_549, 85], [416; 2]),
        Some(Layout::Yolox)
    );
}

#[test]
fn rows_of_this_projects_detector_count_from_pixel_centres() {
    let mut data = vec![0.0; 2 * 6_400 * 6];
    // The second window contains the box: objectness times class score is the score.
    let at = (6_400 + 17) * 6;
    data[at..at + 4].copy_from_slice(&HIDDEN);
    data[at + 4..at + 6].copy_from_slice(&[1.0, SCORE]);
    let found = decode(&[2, 6_400, 6], &data, 2, ModelProfile::default());
    assert_eq!(found[0], []);
    assert_hidden_box(&found[1], 100.5, 50.5);
}

#[test]
fn anchor_rows_of_coco_models_give_the_airplane_and_lose_half_a_pixel() {
    let mut data = vec![0.0; 25_200 * 85];
    for (row, class) in [(9_000, 5 + 4), (9_001, 5 + 7)] {
        data[row * 85..row * 85 + 4].copy_from_slice(&HIDDEN);
        data[row * 85 + 4] = 1.0;
        data[row * 85 + class] = SCORE;
    }
    let found = decode(&[1, 25_200, 85], &data, 1, ModelProfile::default());
    assert_hidden_box(&found[0], 100.0, 50.0);
}

#[test]
fn yolox_rows_are_decoded_with_their_cells_and_strides() {
    // Stride 16 starts after the 80 x 80 cells of stride 8; cell (6, 3) of its 40 x 40 covers 96 to 112 and 48 to 64.
    let row = 6_400 + 3 * 40 + 6;
    let mut data = vec![0.0; 8_400 * 85];
    let relative = [
        (100.5 - 96.0) / 16.0,
        (50.5 - 48.0) / 16.0,
        (20.0_f32 / 16.0).ln(),
        (8.0_f32 / 16.0).ln(),
    ];
    data[row * 85..row * 85 + 4].copy_from_slice(&relative);
    data[row * 85 + 4] = 1.0;
    data[row * 85 + 5 + 4] = SCORE;
    let found = decode(&[1, 8_400, 85], &data, 1, ModelProfile::default());
    assert_hidden_box(&found[0], 100.0, 50.0);
}

#[test]
fn columns_have_no_objectness() {
    let mut data = vec![0.0; 84 * 8_400];
    for (field, value) in HIDDEN.into_iter().enumerate() {
        data[field * 8_400 + 123] = value;
    }
    data[(4 + 4) * 8_400 + 123] = SCORE;
    let found = decode(&[1, 84, 8_400], &data, 1, ModelProfile::default());
    assert_hidden_box(&found[0], 100.0, 50.0);
}

#[test]
fn final_boxes_by_corners_are_filtered_by_class() {
    let corners = [90.5, 46.5, 110.5, 54.5];
    let mut data = vec![0.0; 300 * 6];
    for (row, class) in [(0, 4.0), (1, 0.0)] {
        data[row * 6..row * 6 + 4].copy_from_slice(&corners);
        data[row * 6 + 4..row * 6 + 6].copy_from_slice(&[SCORE, class]);
    }
    assert_hidden_box(
        &decode(&[1, 300, 6], &data, 1, ModelProfile::default())[0],
        100.0,
        50.0,
    );

    let rows = [
        [1.0, 90.5, 46.5, 110.5, 54.5, 4.0, SCORE],
        [9.0, 90.5, 46.5, 110.5, 54.5, 4.0, SCORE],
    ];
    let found = decode(&[2, 7], rows.as_flattened(), 2, ModelProfile::default());
    assert_eq!(found[0], []);
    assert_hidden_box(&found[1], 100.0, 50.0);
}

#[test]
fn a_profile_decides_where_the_shape_misleads() {
    let profile = ModelProfile {
        layout: Some(Layout::Rows),
        box_origin: Some(BoxOrigin::PixelCorner),
        ..Default::default()
    };
    let mut data = vec![0.0; 300 * 6];
    data[..4].copy_from_slice(&HIDDEN);
    data[4..6].copy_from_slice(&[SCORE, 1.0]);
    assert_hidden_box(&decode(&[1, 300, 6], &data, 1, profile)[0], 100.0, 50.0);
}

#[test]
fn boxes_without_a_size_or_with_an_endless_one_are_none() {
    let mut data = vec![0.0; 8_400 * 6];
    // A size that overflows when decoded, and a negative one.
    data[..6].copy_from_slice(&[1.0, 1.0, 100.0, 1.0, 1.0, 1.0]);
    assert_eq!(
        decode(&[1, 8_400, 6], &data, 1, ModelProfile::default()),
        [vec![]]
    );
    let data = [1.0, 1.0, -3.0, 1.0, 1.0, 1.0];
    assert_eq!(
        decode(&[1, 1, 6], &data, 1, ModelProfile::default()),
        [vec![]]
    );
}

#[test]
fn an_empty_answer_is_no_detection_in_any_layout() {
    let cases: [(&[usize], Layout); 6] = [
        (&[2, 0, 6], Layout::Rows),
        (&[2, 0, 6], Layout::AnchorRows),
        (&[2, 0, 6], Layout::Corners),
        (&[2, 84, 0], Layout::Columns),
        (&[0, 7], Layout::BatchCorners),
        (&[2, 0, 85], Layout::Rows),
    ];
    for (shape, layout) in cases {
        let profile = ModelProfile {
            layout: Some(layout),
            ..Default::default()
        };
        assert_eq!(
            decode(shape, &[], 2, profile),
            [vec![], vec![]],
            "{shape:?}"
        );
    }
}

#[test]
fn shapes_that_do_not_fit_are_refused_with_what_was_expected() {
    let cases: [(Layout, &[usize], &str); 8] = [
        (Layout::Rows, &[1, 0, 6], "an answer for each window"),
        (Layout::Rows, &[2, 0, 5], "[batch, candidates, 5 + classes]"),
        (Layout::Rows, &[], "three dimensions"),
        (
            Layout::Columns,
            &[2, 4, 0],
            "[batch, 4 + classes, candidates]",
        ),
        (Layout::Corners, &[2, 0, 7], "[batch, boxes, 6]"),
        (Layout::Yolox, &[2, 0, 85], "[batch, cells, 5 + classes]"),
        (Layout::BatchCorners, &[0, 6], "[boxes, 7]"),
        (Layout::Rows, &[0, 0, 6], "an answer for each window"),
    ];
    for (layout, shape, expected) in cases {
        let numbers = if shape.is_empty() { vec![0.0] } else { vec![] };
        let said = fault(layout, shape, &numbers, 2);
        for word in [expected, &format!("{shape:?}"), &format!("{layout:?}")] {
            assert!(said.contains(word), "{word} in {said}");
        }
    }
}

#[test]
fn a_box_of_a_window_that_cannot_be_is_refused() {
    for window in [-1.0, 0.5] {
        let row = [window, 90.5, 46.5, 110.5, 54.5, 4.0, SCORE];
        let said = fault(Layout::BatchCorners, &[1, 7], &row, 2);
        assert!(said.contains(&format!("window {window}")), "{said}");
    }
}

#[test]
fn an_unknown_number_of_classes_asks_for_the_aircraft() {
    let said = fault(Layout::Columns, &[1, 11, 8_400], &vec![0.0; 11 * 8_400], 1);
    assert!(
        said.contains("7 classes") && said.contains("aircraft_class"),
        "{said}"
    );
}
