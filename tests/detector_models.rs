//! `dtd detect` with the models of others: every output layout, other tasks and contradicting settings; and with hostile ones: windows
//! and batches that exceed any memory, NaN, and libraries that other users could have planted.

#[path = "detector_models/layouts.rs"]
mod layouts;
#[path = "detector_models/model.rs"]
mod model;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

use dataset::corpus::Corpus;
use dataset::corpus::detections::{self, Detection};
use layouts::{
    CORNERS, HIDDEN, PICTURE_PX, SCORE, best_of, by_corners, candidates, cells, columns_of,
    columns_with, efficient_nms, final_rows, normalized, objects_row, of_any_size, rows_of,
    rows_with, scores_of,
};
use model::{Answer, Model, open, windows_of};
use onnx_graph::proto::Dimension;
use testkit::command::{Dtd, json, said, text};
use testkit::files::copy_folder;
use testkit::sweep::SmallSweep;
use testkit::{repository, skipped};

/// A few images of an approach's end.
fn sweep_toml() -> String {
    SmallSweep {
        name: "few",
        seed: 0,
        weathers: &["clear"],
        repeats: 1,
        size_px: (96, 64),
        frame_rate: "1/8",
        tables: r#"
[start]
dtd_nm = 1
speed_mps = 72

[[recorded]]
files = "flights/01_calm_ils.csv"

[weather.clear]
visibility_m = 80000
wind_speed_mps = 2
wind_from_true_deg = 20
"#,
    }
    .toml()
}

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));

fn dtd() -> Command {
    let mut command = DTD.command(&[""; 0]);
    command.env_remove("ORT_DYLIB_PATH");
    command
}

/// A recorded corpus, made once per run of the tests.
fn sound() -> &'static Path {
    static CORPUS: OnceLock<tempfile::TempDir> = OnceLock::new();
    let folder = CORPUS.get_or_init(|| DTD.recorded(&sweep_toml()));
    Box::leak(folder.path().join("corpus").into_boxed_path())
}

/// A copy of the valid corpus without detections, for one test.
fn corpus(folder: &Path) -> PathBuf {
    let copy = folder.join("corpus");
    copy_folder(sound(), &copy);
    copy
}

/// Runs `dtd detect` in a copy of the corpus.
trait Detect {
    /// Writes it into a new folder.
    fn detect(&self) -> Output;

    /// Runs in `folder`, with more arguments.
    fn detect_in(&self, folder: &Path, more: &[&str]) -> Output;
}

impl Detect for Model<'_> {
    fn detect(&self) -> Output {
        let folder = tempfile::tempdir().unwrap();
        self.detect_in(folder.path(), &[])
    }

    /// Runs on a copy of the corpus in `folder`.
    fn detect_in(&self, folder: &Path, more: &[&str]) -> Output {
        let model = folder.join("model.onnx");
        self.write(&model);
        dtd()
            .args(["detect", text(&corpus(folder)), "--json", "--mode", "full"])
            .args(["--model", text(&model)])
            .args(more)
            .output()
            .unwrap()
    }
}

#[test]
fn empty_answers_are_no_detections() {
    type ShapeAndMetadata<'a> = (&'a [i64], &'a [(&'a str, &'a str)]);
    let none: [ShapeAndMetadata<'_>; 2] = [
        (&[0, 7], &[]),
        (&[1, 84, 0], &[("dtd_profile", r#"{"layout": "columns"}"#)]),
    ];
    for (shape, metadata) in none {
        let model = Model::of(vec![Answer::constant(shape, 0.0)]).with_metadata(metadata);
        let output = model.detect();
        assert_eq!(
            output.status.code(),
            Some(0),
            "{shape:?}: {}",
            said(&output)
        );
        assert_eq!(json(&output)["counts"]["detections"], 0, "{shape:?}");
    }
}

/// That each image has the hidden box and no other, with this middle.
fn assert_found(case: &str, output: &Output, corpus: &Path, middle: [f64; 2]) {
    assert_eq!(output.status.code(), Some(0), "{case}: {}", said(output));
    let outcome = json(output);
    let hash = outcome["model_hash"].as_str().unwrap();
    let mut pictures = 0;
    for scenario in Corpus::open(corpus).unwrap().scenarios().unwrap() {
        let scenario = scenario.open().unwrap();
        let found = scenario.detections(hash).unwrap().boxes;
        assert_eq!(
            found.len() as u64,
            scenario.record().unwrap().pictures(),
            "{case}"
        );
        pictures += found.len();
        for Detection {
            pixel_box, score, ..
        } in found
        {
            let [cx_px, cy_px] = middle;
            let errors = [
                pixel_box.cx_px - cx_px,
                pixel_box.cy_px - cy_px,
                pixel_box.width_px - f64::from(HIDDEN[2]),
                pixel_box.height_px - f64::from(HIDDEN[3]),
                score - f64::from(SCORE),
            ];
            assert!(
                errors.iter().all(|error| error.abs() < 1e-3),
                "{case}: {pixel_box:?} {score}"
            );
        }
    }
    assert!(pictures > 0, "{case}");
}

#[test]
fn every_layout_of_a_wide_model_gives_the_aircraft_at_its_place() {
    let plain = cells(&[8, 16, 32]);
    let hidden = |classes, class| objects_row(HIDDEN, classes, class);
    let yolox = {
        // Stride 16 starts after 12 x 8 cells; cell (2, 1) of its 6 x 4 starts at 32, 16.
        let [cx, cy, width, height] = HIDDEN;
        let relative = [
            (cx - 32.0) / 16.0,
            (cy - 16.0) / 16.0,
            (width / 16.0).ln(),
            (height / 16.0).ln(),
        ];
        let row = objects_row(relative, 80, 4);
        rows_with(plain, cells(&[8]) + 6 + 2, &row)
    };
    let end_to_end = {
        let row = |class: f32| [&[0.0][..], &CORNERS, &[class, SCORE]].concat();
        Answer::floats("output", &[2, 7], [row(4.0), row(0.0)].concat())
    };
    let ultralytics = |names| [("task", "detect"), ("stride", "32"), ("names", names)];
    let planes = ultralytics("{0: 'drone', 1: 'plane', 2: 'bird'}");
    let airplanes = ultralytics(r#"{0: "drone", 1: "airplane"}"#);
    let coco = [("stride", "32"), ("names", "['person', 'airplane']")];
    let corner = [40.0, 30.0];
    let settings = "layout = 'rows'\naircraft_class = 2\nbox_origin = 'pixel-corner'\n";
    let cases: [(&str, Model<'_>, [f64; 2]); 13] = [
        (
            "v5, v7",
            Model::of(vec![rows_with(3 * plain, 50, &hidden(80, 4))]),
            corner,
        ),
        (
            "v5, one class",
            Model::of(vec![rows_with(3 * plain, 50, &hidden(1, 0))]),
            corner,
        ),
        (
            "v5, named",
            Model::of(vec![rows_with(3 * plain, 50, &hidden(2, 1))]).with_metadata(&coco),
            corner,
        ),
        ("v7 end to end", Model::of(vec![end_to_end]), corner),
        ("efficient nms", Model::of(efficient_nms()), corner),
        (
            "v8, v11",
            Model::of(vec![columns_with(plain, 80, 4)]),
            corner,
        ),
        (
            "v8, one class",
            Model::of(vec![columns_with(plain, 1, 0)]),
            corner,
        ),
        (
            "v11, named",
            Model::of(vec![columns_with(plain, 3, 1)]).with_metadata(&planes),
            corner,
        ),
        ("v10, v26", Model::of(vec![final_rows(300, 4.0)]), corner),
        (
            "v11 with suppression",
            Model::of(vec![final_rows(100, 1.0)]).with_metadata(&airplanes),
            corner,
        ),
        ("yolox", Model::of(vec![yolox]), corner),
        (
            "ours",
            Model::of(vec![rows_with(cells(&[8]), 50, &hidden(1, 0))]),
            [40.5, 30.5],
        ),
        (
            "settings",
            Model::of(vec![rows_with(50, 7, &hidden(3, 2))]).with_settings(settings),
            corner,
        ),
    ];
    let [width, height] = PICTURE_PX.map(|side_px| Dimension::Fixed(side_px as i64));
    for (case, model, middle) in cases {
        let folder = tempfile::tempdir().unwrap();
        let input = [
            Dimension::Fixed(1),
            Dimension::Fixed(3),
            height.clone(),
            width.clone(),
        ];
        let output = model.with_input(input).detect_in(folder.path(), &[]);
        assert_found(case, &output, &folder.path().join("corpus"), middle);
    }
}

/// Detects with a model of wide windows, and expects the hidden box in every image.
fn assert_reads(case: &str, model: Model<'_>) {
    let [width, height] = PICTURE_PX.map(|side_px| Dimension::Fixed(side_px as i64));
    let folder = tempfile::tempdir().unwrap();
    let input = [Dimension::Fixed(1), Dimension::Fixed(3), height, width];
    let output = model.with_input(input).detect_in(folder.path(), &[]);
    assert_found(case, &output, &folder.path().join("corpus"), [40.0, 30.0]);
}

/// Strides of the families of Ultralytics' models for boxes, and what of their heads shows in an export.
const P3: &[usize] = &[8, 16, 32];
const P2: &[usize] = &[4, 8, 16, 32];
const P6: &[usize] = &[8, 16, 32, 64];
const TINY: &[usize] = &[16, 32];

#[test]
fn the_heads_of_ultralytics_families_are_read_without_settings() {
    // Of those with the same strides, head and end: one. yolov3 stands for yolov5, v6, v8, v9, 11 and 12, p2 and p6 also for their ghosts.
    let families: [(&str, &[usize], &str, bool); 12] = [
        ("yolov3", P3, "Detect", false),
        ("yolov3-tiny", TINY, "Detect", false),
        ("yolov5-p6", P6, "Detect", false),
        ("yolov8-p2", P2, "Detect", false),
        ("yolov8-world", P3, "WorldDetect", false),
        ("yoloe-v8", P3, "YOLOEDetect", false),
        ("yolov10", P3, "v10Detect", true),
        (
            "yolov10 without its one-to-one head",
            P3,
            "v10Detect",
            false,
        ),
        ("yolo26", P3, "Detect", true),
        ("yolo26-p2", P2, "Detect", true),
        ("yolo26-p6", P6, "Detect", true),
        ("yoloe-26", P3, "YOLOEDetect", true),
    ];
    let of = |head, end2end| {
        [
            ("task", "detect"),
            ("stride", "32"),
            ("names", "{0: 'drone', 1: 'airplane', 2: 'bird'}"),
            ("head", head),
            ("end2end", end2end),
        ]
    };
    for (family, strides, head, is_end_to_end) in families {
        let boxes = candidates(strides);
        let answer = if is_end_to_end {
            // As many as there may be, or as there are.
            let kept: Vec<_> = boxes.iter().take(300).map(|one| by_corners(*one)).collect();
            rows_of(&kept, |k| best_of(k, 1).to_vec())
        } else {
            columns_of("output0", &boxes, 3, 1)
        };
        let metadata = of(head, if is_end_to_end { "True" } else { "False" });
        assert_reads(family, Model::of(vec![answer]).with_metadata(&metadata));
    }
    let queries: Vec<_> = candidates(P2)
        .into_iter()
        .map(normalized)
        .take(300)
        .collect();
    let rt_detr = of("RTDETRDecoder", "False");
    for (case, answer) in [
        ("rtdetr", rows_of(&queries, |k| best_of(k, 1).to_vec())),
        (
            "rtdetr of earlier versions",
            rows_of(&queries, |k| scores_of(k, 3, 1)),
        ),
    ] {
        assert_reads(case, Model::of(vec![answer]).with_metadata(&rt_detr));
    }
    let mut of_two = rt_detr;
    of_two[2].1 = "{0: 'drone', 1: 'airplane'}";
    assert_reads(
        "rtdetr of earlier versions with two classes, whose rows look like final boxes",
        Model::of(vec![rows_of(&queries, |k| scores_of(k, 2, 1))]).with_metadata(&of_two),
    );
}

/// The other shapes with several meanings: `labeller/src/detector/layout/meaning/tests.rs`.
#[test]
fn shapes_with_several_meanings_are_read_by_their_numbers_without_settings() {
    let boxes = candidates(P3);
    let parts: Vec<_> = boxes.iter().map(|one| normalized(*one)).collect();
    let with = |objectness: f32, k| [&[objectness][..], &scores_of(k, 80, 4)].concat();
    let of_nas = {
        let row = |class: f32| [&[0.0][..], &CORNERS, &[SCORE, class]].concat();
        Answer::floats("flat_predictions", &[2, 7], [row(4.0), row(0.0)].concat())
    };
    for (case, answer) in [
        ("YOLO-NAS flat", of_nas),
        (
            "YOLOX with its decoder",
            rows_of(&boxes, |k| with(if k == 9 { 1.0 } else { 0.1 }, k)),
        ),
        ("YOLOv6", rows_of(&boxes, |k| with(1.0, k))),
        (
            "one class with a score of 1 everywhere, in parts of the window",
            rows_of(&parts, |k| vec![if k == 9 { SCORE } else { 0.01 }, 1.0]),
        ),
    ] {
        assert_reads(case, Model::of(vec![answer]));
    }
}

#[test]
fn settings_name_output_and_layout_where_nothing_else_tells_them() {
    let with = |k| [&[1.0][..], &scores_of(k, 80, 4)].concat();
    let anchors = |strides| rows_of(&candidates(strides).repeat(3)[..3 * cells(strides)], with);
    let boxes = candidates(P3);
    let pair =
        |names: [&'static str; 2], boxes: &[[f32; 4]], scores: &dyn Fn(usize) -> Vec<f32>| {
            let count = boxes.len() as i64;
            let scores: Vec<f32> = (0..boxes.len()).flat_map(scores).collect();
            let classes = scores.len() as i64 / count;
            vec![
                Answer::floats(names[0], &[1, count, 4], boxes.concat()),
                Answer::floats(names[1], &[1, count, classes], scores),
            ]
        };
    let logit = |score: f32| (score / (1.0 - score)).ln();
    let parts: Vec<_> = boxes.iter().map(|one| normalized(*one)).collect();
    let corners: Vec<_> = boxes.iter().map(|one| by_corners(*one)).collect();
    let of_rf_detr = pair(["dets", "labels"], &parts, &|k| {
        scores_of(k, 91, 5).into_iter().map(logit).collect()
    });
    let both = vec![
        columns_of("output0", &boxes, 80, 4),
        columns_of("output1", &boxes, 80, 4),
    ];
    for (case, outputs, settings) in [
        ("YOLOv5-P2", vec![anchors(P2)], "layout = 'anchor-rows'"),
        ("YOLOv3-tiny", vec![anchors(TINY)], "layout = 'anchor-rows'"),
        ("YOLOv9", both, "output = 'output0'"),
        (
            "RF-DETR",
            of_rf_detr,
            "layout = 'boxes-and-scores'\naircraft_class = 5\n[input]\nmean = [0.485, 0.456, 0.406]\nstd = [0.229, 0.224, 0.225]",
        ),
        (
            "YOLO-NAS",
            pair(["boxes", "scores"], &corners, &|k| scores_of(k, 80, 4)),
            "layout = 'boxes-and-scores'",
        ),
        (
            "a form that numbers would not show",
            vec![columns_of("output0", &parts, 80, 4)],
            "box_unit = 'normalized'\nbox_form = 'center-size'",
        ),
    ] {
        assert_reads(case, Model::of(outputs).with_settings(settings));
    }
}

#[test]
fn models_with_a_second_input_and_those_of_mmdeploy_are_refused_with_what_to_export() {
    let pair = || {
        vec![
            Answer::constant(&[1, 10, 4], 0.0),
            Answer::floats("scores", &[1, 10, 80], vec![0.0; 800]),
        ]
    };
    let of_mmdeploy = || {
        vec![
            Answer::floats("dets", &[1, 10, 5], vec![0.0; 50]),
            Answer::integers("labels", &[1, 10], vec![0; 10]),
        ]
    };
    let both = || {
        vec![
            columns_with(84, 80, 4),
            Answer::floats("output1", &[1, 84, 84], vec![0.0; 84 * 84]),
        ]
    };
    let cases: [(Model<'_>, &[&str]); 5] = [
        (
            Model::of(pair()).with_second_input("orig_target_sizes"),
            &[
                "2 inputs (pictures, orig_target_sizes)",
                "boxes-and-scores",
                "postprocessor",
            ],
        ),
        (
            Model::of(of_mmdeploy()),
            &["mmdeploy", "num_dets, boxes, scores and labels"],
        ),
        (Model::of(pair()), &["layout = \"boxes-and-scores\" reads"]),
        (
            Model::of(both()),
            &["output0, output1", "output = \"output0\""],
        ),
        (
            Model::of(both()).with_settings("output = 'boxes'"),
            &["output = \"boxes\"", "output0, output1"],
        ),
    ];
    for (model, words) in cases {
        assert_refused(&model, words);
    }
}

#[test]
fn a_model_whose_boxes_are_all_below_a_pixel_is_doubted_aloud() {
    let parts: Vec<_> = candidates(P3).into_iter().map(normalized).collect();
    let model = |settings| {
        let [width, height] = PICTURE_PX.map(|side_px| Dimension::Fixed(side_px as i64));
        let input = [Dimension::Fixed(1), Dimension::Fixed(3), height, width];
        let answer = columns_of("output0", &parts, 80, 4);
        Model::of(vec![answer])
            .with_input(input)
            .with_settings(settings)
    };
    let words = "smaller than a pixel or outside its window";
    let wrong = model("box_unit = 'pixels'").detect();
    assert_eq!(wrong.status.code(), Some(0), "{}", said(&wrong));
    assert!(said(&wrong).contains(words), "{}", said(&wrong));
    let right = model("").detect();
    assert!(!said(&right).contains(words), "{}", said(&right));
}

#[test]
fn a_model_of_any_size_is_told_by_its_open_sides() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("any.onnx");
    fs::write(&model, of_any_size()).unwrap();
    let corpus = corpus(folder.path());
    let output = dtd()
        .args(["detect", text(&corpus), "--json", "--mode", "full"])
        .args(["--model", text(&model)])
        .output()
        .unwrap();
    assert_found("any", &output, &corpus, [40.0, 30.0]);
}

#[test]
fn what_no_detector_takes_or_answers_is_bad_input_that_names_it() {
    let constant = |shape: &[i64], number| Model::of(vec![Answer::constant(shape, number)]);
    let usual = || constant(&[1, 10, 6], 0.0);
    let fixed_batch = |batch| {
        let mut input = windows_of(64);
        input[0] = Dimension::Fixed(batch);
        input
    };
    let open_size = || {
        let mut input = windows_of(64);
        input[2] = open("side");
        input[3] = open("side");
        usual().with_input(input)
    };
    let profile = |text| [("dtd_profile", text)];
    let (none, huge) = (
        profile(r#"{"input": {"size_px": 0}}"#),
        profile(r#"{"input": {"size_px": 20000}}"#),
    );
    let black = profile(r#"{"input": {"scale": 0.0}}"#);
    let cases: [(Model<'_>, &[&str]); 8] = [
        (
            usual().with_input(windows_of(20_000)),
            &["windows of 20000 px, expected 32 to 4096"],
        ),
        (
            usual().with_input(fixed_batch(1_000_000_000)),
            &["takes 1000000000 windows"],
        ),
        (open_size().with_metadata(&none), &["input.size_px = 0"]),
        (open_size().with_metadata(&huge), &["input.size_px = 20000"]),
        (
            usual().with_metadata(&black),
            &["input.scale", "dtd_profile"],
        ),
        (
            constant(&[1, 10, 6], f32::NAN),
            &["output \"boxes\" is NaN at [0, 0, 0] of [1, 10, 6]"],
        ),
        (
            constant(&[1, 10], 0.0),
            &[
                "\"pictures\" Tensor<f32>",
                "\"boxes\" Tensor<f32>(1, 10)",
                "model.onnx.toml",
            ],
        ),
        (constant(&[0, 10, 6], 0.0), &["has the shape [0, 10, 6]"]),
    ];
    for (model, words) in cases {
        assert_refused(&model, words);
    }
}

/// Bad input, with these words, and nothing written.
fn assert_refused(model: &Model<'_>, words: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let output = model.detect_in(folder.path(), &[]);
    let said = said(&output);
    assert_eq!(output.status.code(), Some(2), "{words:?}: {said}");
    for word in words.iter().chain(&["model.onnx"]) {
        assert!(said.contains(word), "{word} in {said}");
    }
    for scenario in fs::read_dir(folder.path().join("corpus/scenarios")).unwrap() {
        assert!(!scenario.unwrap().path().join("detections").exists());
    }
}

#[test]
fn a_model_of_another_task_is_bad_input_that_says_so() {
    let columns = |classes| columns_with(84, classes, 0);
    let task = |task| [("task", task), ("names", "{0: 'airplane'}")];
    let (segment, pose, classify) = (task("segment"), task("pose"), task("classify"));
    let names = [("names", "{0: 'airplane'}")];
    let masks = || Answer::floats("output1", &[1, 2, 4, 4], vec![0.0; 32]);
    let cases: [(Model<'_>, &[&str]); 6] = [
        (
            Model::of(vec![columns(33), masks()]).with_metadata(&segment),
            &["task \"segment\"", "expected one for \"detect\""],
        ),
        (
            Model::of(vec![columns(52)]).with_metadata(&pose),
            &["task \"pose\""],
        ),
        (
            Model::of(vec![Answer::constant(&[1, 1000], 0.0)]).with_metadata(&classify),
            &["task \"classify\""],
        ),
        // The same without the word.
        (
            Model::of(vec![columns(33), masks()]),
            &[
                "segmentation",
                "\"output0\" Tensor<f32>(1, 37, 84)",
                "\"output1\"",
            ],
        ),
        (
            Model::of(vec![columns(52)]).with_metadata(&names),
            &["lists 1 class", "52 classes"],
        ),
        (
            Model::of(vec![Answer::constant(&[1, 1000], 0.0)]),
            &["a classifier"],
        ),
    ];
    for (model, words) in cases {
        assert_refused(&model, words);
    }
}

#[test]
fn settings_that_contradict_the_model_are_refused_with_both_sides() {
    let model = || Model::of(vec![columns_with(84, 3, 1)]);
    let cases: [(&str, &[&str]); 6] = [
        (
            "[input]\nsize_px = 416\n",
            &["input.size_px = 416", "windows of 64x64 px"],
        ),
        ("aircraft_class = 3\n", &["aircraft_class = 3", "3 classes"]),
        (
            "layout = 'batch-corners'\n",
            &[
                "layout = \"batch-corners\"",
                "[boxes, 7]",
                "Tensor<f32>(1, 7, 84)",
            ],
        ),
        (
            "layout = 'efficient-nms'\n",
            &["layout = \"efficient-nms\"", "four outputs"],
        ),
        ("", &["3 classes", "aircraft_class"]),
        (
            "aircraft_clas = 1\n",
            &[
                "model.onnx.toml:1:1",
                "aircraft_clas",
                "aircraft_class",
                "^",
            ],
        ),
    ];
    for (settings, words) in cases {
        assert_refused(&model().with_settings(settings), words);
    }
    let row = objects_row(HIDDEN, 80, 4);
    let yolox = || Model::of(vec![rows_with(84, 9, &row)]);
    for key in ["box_unit = 'normalized'", "box_form = 'corners'"] {
        assert_refused(
            &yolox().with_settings(&format!("layout = 'yolox'\n{key}\n")),
            &["box_form or box_unit", "layout is yolox"],
        );
    }
    assert_refused(
        &Model::of(efficient_nms())
            .with_settings("layout = 'efficient-nms'\noutput = 'det_boxes'\n"),
        &["output = \"det_boxes\"", "four outputs"],
    );
}

#[test]
fn detections_are_told_apart_by_model_and_settings_and_verify_accepts_both() {
    let folder = tempfile::tempdir().unwrap();
    let model = |class| Model::of(vec![columns_with(84, 80, class)]);
    let bare = model(4).detect_in(folder.path(), &[]);
    let hash = blake3::hash(&model(4).onnx()).to_string();
    let outcome = json(&bare);
    assert_eq!(outcome["model_hash"], hash[..16], "{}", said(&bare));
    assert_eq!(outcome["model"], "model.onnx");
    let path = folder.path().join("model.onnx");
    let corpus = folder.path().join("corpus");
    let detect = |settings: &str| {
        fs::write(path.with_extension("onnx.toml"), settings).unwrap();
        let output = dtd()
            .args(["detect", text(&corpus), "--json", "--mode", "full"])
            .args(["--model", text(&path)])
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(0), "{}", said(&output));
        json(&output)
    };
    let unchanged = detect("# nothing yet\n");
    assert_eq!(unchanged["model_hash"], hash[..16]);
    assert_eq!(unchanged["detected"].as_array().unwrap().len(), 0);
    let other = detect("aircraft_class = 5\n");
    assert_ne!(other["model_hash"], hash[..16]);
    assert_eq!(other["counts"]["detections"], 0);
    let verified = dtd().args(["verify", text(&corpus)]).output().unwrap();
    assert_eq!(verified.status.code(), Some(0), "{}", said(&verified));
    // Which of them is meant has to be said.
    let train = dtd()
        .args(["train", text(&corpus), "--quick", "--out"])
        .arg(folder.path().join("run"))
        .args(["--detections", "model.onnx"])
        .output()
        .unwrap();
    assert_eq!(train.status.code(), Some(2), "{}", said(&train));
    for name in [&outcome, &other] {
        let listed = format!("model.onnx ({})", name["model_hash"].as_str().unwrap());
        assert!(said(&train).contains(&listed), "{}", said(&train));
    }
}

#[test]
fn the_device_is_recorded_and_one_that_the_library_lacks_is_bad_input_that_says_where_to_get_it() {
    let folder = tempfile::tempdir().unwrap();
    let model = Model::of(vec![columns_with(84, 80, 4)]);
    // No build for Linux has it.
    let lacking = model.detect_in(folder.path(), &["--device", "directml:1"]);
    assert_eq!(lacking.status.code(), Some(2), "{}", said(&lacking));
    for word in [
        "directml:1",
        "has only cpu",
        "onnxruntime-directml",
        "--onnx-runtime",
        "ORT_DYLIB_PATH",
    ] {
        assert!(
            said(&lacking).contains(word),
            "{word} in {}",
            said(&lacking)
        );
    }
    let unknown = model.detect_in(folder.path(), &["--device", "gpu"]);
    assert_eq!(unknown.status.code(), Some(2), "{}", said(&unknown));
    assert!(said(&unknown).contains("cuda"), "{}", said(&unknown));
    let output = model.detect_in(folder.path(), &["--device", "cpu"]);
    let outcome = json(&output);
    assert_eq!(outcome["device"], "cpu", "{}", said(&output));
    let hash = outcome["model_hash"].as_str().unwrap();
    let corpus = Corpus::open(&folder.path().join("corpus")).unwrap();
    let first = corpus.scenarios().unwrap().remove(0);
    let record = fs::read(detections::record_path(&first, hash)).unwrap();
    let record: serde_json::Value = serde_json::from_slice(&record).unwrap();
    assert_eq!(record["device"], "cpu");
}

#[test]
fn a_file_that_is_no_model_is_bad_input() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("broken.onnx");
    fs::write(&model, "this is no model").unwrap();
    let output = dtd()
        .args(["detect", text(sound()), "--model", text(&model)])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2), "{}", said(&output));
    assert!(said(&output).contains("broken.onnx"), "{}", said(&output));
}

/// A shared library that leaves a trace when it is loaded.
fn planted(folder: &Path, trace: &Path) -> Option<PathBuf> {
    let source = folder.join("planted.c");
    let code = format!(
        "#include <stdio.h>\n__attribute__((constructor)) static void run(void) {{ fclose(fopen({:?}, \"w\")); }}\n",
        text(trace)
    );
    fs::write(&source, code).unwrap();
    let library = folder.join("planted.so");
    let compiled = Command::new("cc")
        .args(["-shared", "-fPIC", "-o", text(&library), text(&source)])
        .status();
    if !compiled.is_ok_and(|status| status.success()) {
        skipped("there is no C compiler to make a library with");
        return None;
    }
    Some(library)
}

#[test]
fn a_library_that_lies_above_the_working_folder_is_not_loaded() {
    let folder = tempfile::tempdir().unwrap();
    let trace = folder.path().join("it_ran");
    let Some(library) = planted(folder.path(), &trace) else {
        return;
    };
    let capi = folder
        .path()
        .join(".venv/lib/python3.11/site-packages/onnxruntime/capi");
    fs::create_dir_all(&capi).unwrap();
    fs::copy(&library, capi.join("libonnxruntime.so.1.31.1")).unwrap();
    let deep = folder.path().join("some/where");
    fs::create_dir_all(&deep).unwrap();
    fs::copy(&library, deep.join("libonnxruntime.so")).unwrap();
    let detect = |library: Option<&Path>, variable: Option<&str>| {
        let mut command = dtd();
        command
            .args(["detect", text(&corpus(folder.path())), "--force"])
            .args(["--model", text(&repository().join("models/aircraft.onnx"))])
            .current_dir(&deep);
        if let Some(library) = library {
            command.args(["--onnx-runtime", text(library)]);
        }
        if let Some(variable) = variable {
            command.env("ORT_DYLIB_PATH", variable);
        }
        command.output().unwrap()
    };
    let output = detect(None, None);
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    // Neither by a name that is searched for, nor by a path relative to the working folder.
    for relative in ["libonnxruntime.so", "./libonnxruntime.so"] {
        for output in [
            detect(None, Some(relative)),
            detect(Some(Path::new(relative)), None),
        ] {
            assert_eq!(output.status.code(), Some(2), "{}", said(&output));
            assert!(said(&output).contains("absolute"), "{}", said(&output));
        }
    }
    assert!(!trace.exists(), "the planted library ran");
    // The trace would show it: an explicitly named library is loaded.
    let output = detect(Some(&library), None);
    assert_eq!(output.status.code(), Some(2), "{}", said(&output));
    assert!(trace.exists(), "{}", said(&output));
}
