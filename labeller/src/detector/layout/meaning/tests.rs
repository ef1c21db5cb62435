use super::*;

const WINDOW_PX: [u32; 2] = [640; 2];

/// Candidates all over the window: centre and size in pixels.
fn candidates() -> Vec<[f32; 4]> {
    let of_cell = |cell: Cell| {
        let [x, y] = [cell.column, cell.line].map(|at| (at + 0.4) * cell.stride_px);
        [x, y, 3.0 * cell.stride_px, 2.0 * cell.stride_px]
    };
    cells_in_order(WINDOW_PX).map(of_cell).collect()
}

fn corners([x, y, width, height]: [f32; 4]) -> [f32; 4] {
    [
        x - width / 2.0,
        y - height / 2.0,
        x + width / 2.0,
        y + height / 2.0,
    ]
}

fn normalized(numbers: [f32; 4]) -> [f32; 4] {
    numbers.map(|number| number / 640.0)
}

/// Rows with a box by `form` and further numbers.
fn rows(count: usize, form: impl Fn([f32; 4]) -> [f32; 4], rest: &[f32]) -> (Vec<usize>, Vec<f32>) {
    let all = candidates();
    let step = all.len() / count;
    let row = |box_px: &[f32; 4]| [&form(*box_px)[..], rest].concat();
    let numbers: Vec<f32> = all.iter().step_by(step).take(count).flat_map(row).collect();
    (vec![1, count, 4 + rest.len()], numbers)
}

fn meaning(
    (shape, numbers): &(Vec<usize>, Vec<f32>),
    profile: &ModelProfile,
    metadata: &ModelMetadata,
) -> Meaning {
    let named = metadata.named_classes();
    let has_objectness = !metadata.is_by_ultralytics();
    let of_shape = Layout::of_shape(shape, WINDOW_PX, has_objectness, named);
    let layout = profile.layout.or(of_shape).unwrap();
    let answer = Answer::new(shape, numbers).unwrap();
    let known = KnownModel {
        window_px: WINDOW_PX,
        profile,
        metadata,
    };
    Meaning::of_probe(layout, answer, &known)
}

fn bare(answer: &(Vec<usize>, Vec<f32>)) -> (Layout, BoxForm, BoxUnit) {
    let found = meaning(answer, &ModelProfile::default(), &ModelMetadata::default());
    (found.layout, found.form, found.unit)
}

#[test]
fn one_shape_with_several_meanings_is_told_apart_by_its_numbers() {
    use BoxForm::{CenterSize, Corners};
    use BoxUnit::{Normalized, Pixels};
    let same = |numbers: [f32; 4]| numbers;
    let class = &[0.01, 7.0];
    let scores = &[0.2, 0.3];
    let of_rt_detr = rows(300, normalized, class);
    let deep_stream = rows(8_400, corners, class);
    let of_anchors = {
        let (_, numbers) = rows(8_400, corners, class);
        (vec![1, 25_200, 6], [&numbers[..]; 3].concat())
    };
    for (case, answer, expected) in [
        (
            "YOLOv10",
            rows(300, corners, class),
            (Layout::Corners, Corners, Pixels),
        ),
        (
            "RT-DETR",
            of_rt_detr,
            (Layout::Corners, CenterSize, Normalized),
        ),
        (
            "DeepStream",
            deep_stream,
            (Layout::Corners, Corners, Pixels),
        ),
        (
            "DeepStream with anchors",
            of_anchors,
            (Layout::Corners, Corners, Pixels),
        ),
        (
            "corners in parts",
            rows(300, |numbers| normalized(corners(numbers)), class),
            (Layout::Corners, Corners, Normalized),
        ),
        (
            "YOLOX of one class with its decoder",
            rows(8_400, same, scores),
            (Layout::YoloxDecoded, CenterSize, Pixels),
        ),
        (
            "YOLOX with its decoder",
            rows(8_400, same, &[0.1; 81]),
            (Layout::YoloxDecoded, CenterSize, Pixels),
        ),
        (
            "YOLOX",
            rows(8_400, |_| [0.3, 0.6, -0.2, 0.4], &[0.1; 81]),
            (Layout::Yolox, CenterSize, Pixels),
        ),
        (
            "YOLOv6",
            rows(8_400, same, &[&[1.0][..], &[0.1; 80]].concat()),
            (Layout::AnchorRows, CenterSize, Pixels),
        ),
        (
            "ours",
            rows(6_400, same, &[0.1, 1.0]),
            (Layout::Rows, CenterSize, Pixels),
        ),
    ] {
        assert_eq!(bare(&answer), expected, "{case}");
    }
}

#[test]
fn columns_in_parts_of_the_window_are_told_from_pixels() {
    let all = candidates();
    let columns = |form: fn([f32; 4]) -> [f32; 4]| {
        let boxes: Vec<[f32; 4]> = all.iter().map(|numbers| form(*numbers)).collect();
        let fields = (0..4).flat_map(|field| boxes.iter().map(move |numbers| numbers[field]));
        let scores = std::iter::repeat_n(0.1, 80 * all.len());
        (
            vec![1, 84, all.len()],
            fields.chain(scores).collect::<Vec<f32>>(),
        )
    };
    let unit = |answer| bare(&answer).2;
    assert_eq!(unit(columns(normalized)), BoxUnit::Normalized);
    assert_eq!(unit(columns(|numbers| numbers)), BoxUnit::Pixels);
}

#[test]
fn metadata_name_the_head_where_numbers_say_nothing() {
    let by_ultralytics = |head: &str| ModelMetadata {
        task: Some("detect".into()),
        head: Some(head.into()),
        ..ModelMetadata::default()
    };
    let empty = (vec![1, 300, 6], vec![0.0; 1_800]);
    for (head, form, unit) in [
        ("RTDETRDecoder", BoxForm::CenterSize, BoxUnit::Normalized),
        ("v10Detect", BoxForm::Corners, BoxUnit::Pixels),
    ] {
        let found = meaning(&empty, &ModelProfile::default(), &by_ultralytics(head));
        let found = (found.layout, found.form, found.unit);
        assert_eq!(found, (Layout::Corners, form, unit), "{head}");
    }
}

#[test]
fn settings_go_before_the_numbers_of_boxes_and_scores() {
    let words = "layout = 'boxes-and-scores'\nbox_form = 'corners'\nbox_unit = 'pixels'\nscore_form = 'probability'";
    let logits = rows(300, normalized, &[-4.0; 91]);
    let found = meaning(&logits, &toml_profile(words), &ModelMetadata::default());
    let expected = Meaning {
        form: BoxForm::Corners,
        ..Meaning::usual(Layout::BoxesAndScores)
    };
    assert_eq!(found, expected);
}

#[test]
fn logits_whose_last_class_is_almost_always_no_object_are_excluding_classes() {
    let profile = toml_profile("layout = 'boxes-and-scores'");
    let scores = |last: f32| {
        let logits = rows(100, normalized, &[&[-4.0; 91][..], &[last]].concat());
        meaning(&logits, &profile, &ModelMetadata::default()).scores
    };
    assert_eq!(
        [scores(6.0), scores(-4.0)],
        [ScoreForm::Softmax, ScoreForm::Logit]
    );
}

fn toml_profile(text: &str) -> ModelProfile {
    let path = std::path::Path::new("net.onnx.toml");
    ModelProfile::parse(text, path, std::path::Path::new("net.onnx")).unwrap()
}

#[test]
fn a_single_number_out_of_range_changes_neither_unit_nor_scores() {
    let profile: ModelProfile = toml_profile("layout = 'boxes-and-scores'");
    let (shape, mut numbers) = rows(300, normalized, &[0.2; 80]);
    numbers[4] = 1.000_000_1;
    numbers[84] = 1.6;
    let found = meaning(&(shape, numbers), &profile, &ModelMetadata::default());
    assert_eq!(
        (found.scores, found.unit),
        (ScoreForm::Probability, BoxUnit::Normalized)
    );
}
