//! The same box in the outputs of every kind of detector.

use onnx_graph::proto::{AttributeProto, Dimension, GraphProto, TensorProto, ValueInfoProto};

use crate::model::{Answer, encoded, node, open};

/// Images of the corpus, pixels.
pub(crate) const PICTURE_PX: [usize; 2] = [96, 64];
/// The box in every answer, from the image's corner, and its score.
pub(crate) const HIDDEN: [f32; 4] = [40.5, 30.5, 20.0, 8.0];
pub(crate) const CORNERS: [f32; 4] = [30.5, 26.5, 50.5, 34.5];
pub(crate) const SCORE: f32 = 0.75;

/// Cells of such an image.
pub(crate) fn cells(strides: &[usize]) -> usize {
    let of_stride = |&stride: &usize| {
        PICTURE_PX
            .map(|side_px| side_px / stride)
            .iter()
            .product::<usize>()
    };
    strides.iter().map(of_stride).sum()
}

/// Zeros but for one row.
pub(crate) fn rows_with(rows: usize, at: usize, row: &[f32]) -> Answer {
    let mut numbers = vec![0.0; rows * row.len()];
    numbers[at * row.len()..(at + 1) * row.len()].copy_from_slice(row);
    Answer::floats("output", &[1, rows as i64, row.len() as i64], numbers)
}

/// A row of box, objectness and classes.
pub(crate) fn objects_row(shape: [f32; 4], classes: usize, class: usize) -> Vec<f32> {
    let mut row = [&shape[..], &[1.0], &vec![0.0; classes]].concat();
    row[5 + class] = SCORE;
    row
}

/// A column of box and classes among empty ones.
pub(crate) fn columns_with(columns: usize, classes: usize, class: usize) -> Answer {
    let mut numbers = vec![0.0; columns * (4 + classes)];
    for (field, value) in HIDDEN.into_iter().enumerate() {
        numbers[field * columns + 9] = value;
    }
    numbers[(4 + class) * columns + 9] = SCORE;
    Answer::floats("output0", &[1, 4 + classes as i64, columns as i64], numbers)
}

/// Final boxes: one of the given class, the others not.
pub(crate) fn final_rows(rows: usize, class: f32) -> Answer {
    let row = |class: f32| [&CORNERS[..], &[SCORE, class]].concat();
    let mut numbers = [row(class), row(class + 1.0)].concat();
    numbers.resize(rows * 6, 0.0);
    Answer::floats("output0", &[1, rows as i64, 6], numbers)
}

/// The four outputs of exports for TensorRT: a different class, the aircraft, and a box past their number.
pub(crate) fn efficient_nms() -> Vec<Answer> {
    vec![
        Answer::integers("num_dets", &[1, 1], vec![2]),
        Answer::floats("det_boxes", &[1, 3, 4], [CORNERS; 3].concat()),
        Answer::floats("det_scores", &[1, 3], vec![0.9, SCORE, 1.0]),
        Answer::integers("det_classes", &[1, 3], vec![0, 4, 4]),
    ]
}

/// Score of all other candidates.
const LOW: f32 = 0.01;
/// Number of the candidate with the hidden box.
const AT: usize = 9;

/// Candidates in the middle of each cell, as a decoder leaves them: centre and size. One of them is the hidden box.
pub(crate) fn candidates(strides: &[usize]) -> Vec<[f32; 4]> {
    let of_stride = |&stride: &usize| {
        let [columns, rows] = PICTURE_PX.map(|side_px| side_px / stride);
        (0..columns * rows).map(move |cell| {
            let middle = |at: usize| (at as f32 + 0.5) * stride as f32;
            let size = 2.0 * stride as f32;
            [middle(cell % columns), middle(cell / columns), size, size]
        })
    };
    let mut all: Vec<_> = strides.iter().flat_map(of_stride).collect();
    all[AT] = HIDDEN;
    all
}

pub(crate) fn by_corners([x, y, width, height]: [f32; 4]) -> [f32; 4] {
    let [right, down] = [width / 2.0, height / 2.0];
    [x - right, y - down, x + right, y + down]
}

/// In parts of the window.
pub(crate) fn normalized([a, b, c, d]: [f32; 4]) -> [f32; 4] {
    let [width, height] = PICTURE_PX.map(|side_px| side_px as f32);
    [a / width, b / height, c / width, d / height]
}

/// The class scores of a candidate: that of the aircraft, if it is the hidden box.
pub(crate) fn scores_of(candidate: usize, classes: usize, class: usize) -> Vec<f32> {
    let mut scores = vec![LOW; classes];
    if candidate == AT {
        scores[class] = SCORE;
    }
    scores
}

/// Rows of boxes and what follows.
pub(crate) fn rows_of(boxes: &[[f32; 4]], rest: impl Fn(usize) -> Vec<f32>) -> Answer {
    let rows = boxes.iter().enumerate();
    let numbers: Vec<f32> = rows
        .flat_map(|(k, numbers)| [&numbers[..], &rest(k)].concat())
        .collect();
    let columns = numbers.len() / boxes.len();
    Answer::floats("output0", &[1, boxes.len() as i64, columns as i64], numbers)
}

/// Columns of boxes and class scores.
pub(crate) fn columns_of(
    name: &'static str,
    boxes: &[[f32; 4]],
    classes: usize,
    class: usize,
) -> Answer {
    let count = boxes.len();
    let fields = (0..4).flat_map(|field| boxes.iter().map(move |numbers| numbers[field]));
    let scores =
        (0..classes).flat_map(|of| (0..count).map(move |k| scores_of(k, classes, class)[of]));
    let numbers: Vec<f32> = fields.chain(scores).collect();
    Answer::floats(name, &[1, 4 + classes as i64, count as i64], numbers)
}

/// Score and number of the best class of a candidate; other candidates are of another one.
pub(crate) fn best_of(candidate: usize, class: usize) -> [f32; 2] {
    if candidate == AT {
        [SCORE, class as f32]
    } else {
        [LOW, class as f32 + 1.0]
    }
}

/// A model of windows of any size: a convolution that answers each cell of 8 px with the box.
pub(crate) fn of_any_size() -> Vec<u8> {
    let fields = [HIDDEN[0], HIDDEN[1], HIDDEN[2], HIDDEN[3], SCORE];
    let channels = fields.len() as i64;
    let mut nodes = vec![
        node("Conv", &["pictures", "weights", "fields"], &["map"]),
        node("Reshape", &["map", "shape"], &["output0"]),
    ];
    nodes[0].attribute = vec![AttributeProto::ints("strides", &[8, 8])];
    let sides = ["batch", "height", "width"].map(open);
    let [batch, height, width] = &sides;
    let graph = GraphProto {
        name: "any".into(),
        node: nodes,
        initializer: vec![
            TensorProto::floats(
                "weights",
                &[channels, 3, 8, 8],
                &vec![0.0; 3 * 8 * 8 * fields.len()],
            ),
            TensorProto::floats("fields", &[channels], &fields),
            TensorProto::integers("shape", &[0, channels, -1]),
        ],
        input: vec![ValueInfoProto::floats(
            "pictures",
            &[
                batch.clone(),
                Dimension::Fixed(3),
                height.clone(),
                width.clone(),
            ],
        )],
        output: vec![ValueInfoProto::floats(
            "output0",
            &[batch.clone(), Dimension::Fixed(channels), open("cells")],
        )],
    };
    encoded(graph, &[])
}
