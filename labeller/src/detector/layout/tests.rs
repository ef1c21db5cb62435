use super::*;

const WINDOW_PX: [u32; 2] = [640; 2];
/// Number of `airplane` among the classes of COCO.
const COCO_AIRPLANE: usize = 4;

/// The box that every test puts into an output, in corner-origin pixels, and its score.
const HIDDEN: [f32; 4] = [100.5, 50.5, 20.0, 8.0];
const SCORE: f32 = 0.75;

/// Settings that replace what follows from the shape.
#[derive(Default)]
struct Said {
    layout: Option<Layout>,
    class: Option<usize>,
}

fn decoding(layout: Layout, class: usize) -> Decoding {
    Decoding {
        meaning: Meaning::usual(layout),
        class,
        origin: layout.usual_origin(),
        window_px: WINDOW_PX,
        score_floor: 0.5,
    }
}

fn decode(shape: &[usize], data: &[f32], windows: usize, said: Said) -> Vec<Vec<ScoredBox>> {
    let of_shape = Layout::of_shape(shape, WINDOW_PX, true, None);
    let layout = said.layout.or(of_shape).unwrap();
    let class = match layout.classes(shape) {
        Some(1) => 0,
        _ => COCO_AIRPLANE,
    };
    let decoding = decoding(layout, said.class.unwrap_or(class));
    let answer = Answer::new(shape, data).unwrap();
    decoding.decode(answer, windows).unwrap()
}

fn fault(layout: Layout, shape: &[usize], data: &[f32], windows: usize) -> String {
    let answer = Answer::new(shape, data).unwrap();
    let decoding = decoding(layout, 0);
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
fn layouts_are_told_apart_by_rank_and_sizes_whatever_the_window() {
    let square = [640, 640];
    let cases: [(&[usize], [u32; 2], Option<Layout>); 25] = [
        (&[6, 6_400, 6], square, Some(Layout::Rows)),
        (&[1, 25_200, 85], square, Some(Layout::AnchorRows)),
        (&[1, 25_200, 6], square, Some(Layout::AnchorRows)),
        (&[1, 8_400, 85], square, Some(Layout::Yolox)),
        (&[1, 8_400, 6], square, Some(Layout::Yolox)),
        (&[1, 84, 8_400], square, Some(Layout::Columns)),
        (&[1, 5, 8_400], square, Some(Layout::Columns)),
        (&[1, 84, 34_000], square, Some(Layout::Columns)),
        (&[1, 300, 6], square, Some(Layout::Corners)),
        (&[1, 0, 6], square, Some(Layout::Corners)),
        (&[12, 7], square, Some(Layout::BatchCorners)),
        (&[0, 7], square, Some(Layout::BatchCorners)),
        (&[1, 3, 80, 80, 85], square, None),
        (&[1, 100, 85], square, None),
        (&[1, 1_000], square, None),
        // Wide and narrow windows, and small ones, which have fewer candidates than numbers per candidate.
        (&[1, 5_040, 85], [640, 384], Some(Layout::Yolox)),
        (&[1, 15_120, 85], [640, 384], Some(Layout::AnchorRows)),
        (&[1, 84, 5_040], [384, 640], Some(Layout::Columns)),
        (&[1, 3_840, 6], [640, 384], Some(Layout::Rows)),
        (&[1, 102_000, 85], [1280, 1280], Some(Layout::AnchorRows)),
        (&[1, 3_549, 85], [416, 416], Some(Layout::Yolox)),
        (&[1, 84, 85], [64, 64], Some(Layout::Yolox)),
        (&[1, 84, 84], [64, 64], Some(Layout::Columns)),
        (&[1, 63, 85], [32, 32], Some(Layout::AnchorRows)),
        (&[1, 300, 6], [160, 120], Some(Layout::Rows)),
    ];
    for (shape, window_px, layout) in cases {
        let found = Layout::of_shape(shape, window_px, true, None);
        assert_eq!(found, layout, "{shape:?} {window_px:?}");
    }
    let without_objectness = |shape: &[usize]| Layout::of_shape(shape, square, false, None);
    for shape in [&[1, 100, 6][..], &[1, 8_400, 6], &[1, 300, 6]] {
        assert_eq!(
            without_objectness(shape),
            Some(Layout::Corners),
            "{shape:?}"
        );
    }
    assert_eq!(without_objectness(&[1, 6, 8_400]), Some(Layout::Columns));
}

#[test]
fn a_score_that_is_no_probability_is_refused_and_rounding_is_not() {
    for (score, is_wrong) in [
        (7.3, true),
        (-4.0, true),
        (1.000_1, false),
        (f32::NAN, false),
    ] {
        let mut numbers = vec![0.0; 84 * 8_400];
        numbers[(4 + COCO_AIRPLANE) * 8_400] = score;
        let answer = Answer::new(&[1, 84, 8_400], &numbers);
        let decoding = decoding(Layout::Columns, COCO_AIRPLANE);
        // An answer with NaN is none.
        let found = answer.and_then(|answer| decoding.decode(answer, 1));
        let said = found.map_or_else(|fault| fault.to_string(), |_| String::new());
        assert_eq!(
            said.contains("score_form = \"logit\""),
            is_wrong,
            "{score}: {said}"
        );
    }
}

#[test]
fn rows_of_this_projects_detector_count_from_pixel_centres() {
    let mut data = vec![0.0; 2 * 6_400 * 6];
    // The second window contains the box: objectness times class score is the score.
    let at = (6_400 + 17) * 6;
    data[at..at + 4].copy_from_slice(&HIDDEN);
    data[at + 4..at + 6].copy_from_slice(&[1.0, SCORE]);
    let found = decode(&[2, 6_400, 6], &data, 2, Said::default());
    assert_eq!(found[0], []);
    assert_hidden_box(&found[1], 100.5, 50.5);
}

#[test]
fn boxes_of_a_batch_belong_to_the_windows_that_they_name() {
    let rows = [
        [1.0, 90.5, 46.5, 110.5, 54.5, 4.0, SCORE],
        [9.0, 90.5, 46.5, 110.5, 54.5, 4.0, SCORE],
    ];
    let found = decode(&[2, 7], rows.as_flattened(), 2, Said::default());
    assert_eq!(found[0], []);
    assert_hidden_box(&found[1], 100.0, 50.0);
}

#[test]
fn boxes_without_a_size_or_with_an_endless_one_are_none() {
    let mut data = vec![0.0; 8_400 * 6];
    // A size that overflows when decoded, and a negative one.
    data[..6].copy_from_slice(&[1.0, 1.0, 100.0, 1.0, 1.0, 1.0]);
    assert_eq!(decode(&[1, 8_400, 6], &data, 1, Said::default()), [vec![]]);
    for numbers in [
        [1.0, 1.0, -3.0, 1.0],
        [-1e9, 1.0, 9.0, 9.0],
        [1.0, 1.0, 9.0, 1e9],
    ] {
        let data = [&numbers[..], &[1.0, 1.0]].concat();
        assert_eq!(decode(&[1, 1, 6], &data, 1, Said::default()), [vec![]]);
    }
}

#[test]
fn an_empty_answer_is_no_detection_in_any_layout() {
    let cases: [(&[usize], Layout); 7] = [
        (&[2, 0, 6], Layout::Rows),
        (&[2, 0, 6], Layout::AnchorRows),
        (&[2, 0, 6], Layout::Corners),
        (&[2, 0, 6], Layout::EfficientNms),
        (&[2, 84, 0], Layout::Columns),
        (&[0, 7], Layout::BatchCorners),
        (&[2, 0, 85], Layout::Rows),
    ];
    for (shape, layout) in cases {
        let said = Said {
            layout: Some(layout),
            class: Some(0),
        };
        assert_eq!(decode(shape, &[], 2, said), [vec![], vec![]], "{shape:?}");
    }
}

#[test]
fn shapes_that_do_not_fit_are_refused_with_what_was_expected() {
    let cases: [(Layout, &[usize], &str); 9] = [
        (Layout::AnchorRows, &[2, 84, 0], "one or three a cell"),
        (Layout::Rows, &[1, 0, 6], "an answer for each window"),
        (Layout::Rows, &[2, 0, 5], "[batch, candidates, 5 + classes]"),
        (Layout::Rows, &[], "[batch, candidates, 5 + classes]"),
        (
            Layout::Columns,
            &[2, 4, 0],
            "[batch, 4 + classes, candidates]",
        ),
        (Layout::Corners, &[2, 0, 7], "[batch, boxes, 6]"),
        (Layout::Yolox, &[2, 0, 85], "[batch, cells of strides"),
        (Layout::BatchCorners, &[0, 6], "[boxes, 7]"),
        (Layout::Rows, &[0, 0, 6], "an answer for each window"),
    ];
    for (layout, shape, expected) in cases {
        let numbers = if shape.is_empty() { vec![0.0] } else { vec![] };
        let said = fault(layout, shape, &numbers, 2);
        for word in [expected, &format!("{shape:?}"), &layout.to_string()] {
            assert!(said.contains(word), "{word} in {said}");
        }
    }
}

#[test]
fn final_boxes_of_score_one_are_read_in_both_orders() {
    for class in [0_u8, 1, 4] {
        let aircraft = f32::from(class);
        for last in [[aircraft, 1.0], [1.0, aircraft]] {
            let row = [&[0.0, 90.5, 46.5, 110.5, 54.5][..], &last].concat();
            let said = Said {
                class: Some(usize::from(class)),
                ..Said::default()
            };
            let found = decode(&[1, 7], &row, 1, said);
            assert_eq!(found[0].len(), 1, "{last:?}");
            assert_eq!(found[0][0].score, 1.0, "{last:?}");
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
fn fewer_classes_than_when_the_model_was_loaded_are_refused() {
    let answer = Answer::new(&[1, 5, 0], &[]).unwrap();
    let said = decoding(Layout::Columns, 4).decode(answer, 1).unwrap_err();
    assert!(said.to_string().contains("1 classes"), "{said}");
}
