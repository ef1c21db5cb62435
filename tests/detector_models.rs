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
use model::{Answer, Model, windows_of};
use onnx_graph::proto::Dimension;
use testkit::command::{Dtd, Ending, json, said, text};
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

/// `dtd detect` of a copy of the corpus in `folder` with this model.
fn detect_in(folder: &Path, model: &Model<'_>) -> Command {
    let path = folder.join("model.onnx");
    model.write(&path);
    detect(&corpus(folder), &path)
}

/// `dtd detect` of a corpus with the model in a file.
fn detect(corpus: &Path, model: &Path) -> Command {
    let mut command = dtd();
    command
        .args(["detect", text(corpus), "--json", "--mode", "full"])
        .args(["--model", text(model)]);
    command
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
        let folder = tempfile::tempdir().unwrap();
        let output = detect_in(folder.path(), &model).succeeds();
        assert_eq!(json(&output)["counts"]["detections"], 0, "{shape:?}");
    }
}

/// That each image has the hidden box and no other, with this middle.
fn assert_found(case: &str, output: &Output, corpus: &Path, middle: [f64; 2]) {
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
    let settings = "layout = 'rows'\naircraft_class = 2\nbox_origin = 'pixel-corner'\n";
    let one = |answer| Model::of(vec![answer]);
    let rows = |count, at, classes, class| one(rows_with(count, at, &hidden(classes, class)));
    let nms = one(final_rows(100, 1.0)).with_metadata(&airplanes);
    let cases = [
        ("v5, v7", rows(3 * plain, 50, 80, 4)),
        ("v5, one class", rows(3 * plain, 50, 1, 0)),
        ("v5, named", rows(3 * plain, 50, 2, 1).with_metadata(&coco)),
        ("v7 end to end", one(end_to_end)),
        ("efficient nms", Model::of(efficient_nms())),
        ("v8, v11", one(columns_with(plain, 80, 4))),
        ("v8, one class", one(columns_with(plain, 1, 0))),
        (
            "v11, named",
            one(columns_with(plain, 3, 1)).with_metadata(&planes),
        ),
        ("v10, v26", one(final_rows(300, 4.0))),
        ("v11 with suppression", nms),
        ("yolox", one(yolox)),
        ("settings", rows(50, 7, 3, 2).with_settings(settings)),
    ];
    for (case, model) in cases {
        assert_reads(case, model);
    }
    assert_reads_at([40.5, 30.5], "ours", rows(cells(&[8]), 50, 1, 0));
}

/// Detects with a model of wide windows, and expects the hidden box in every image.
fn assert_reads(case: &str, model: Model<'_>) {
    assert_reads_at([40.0, 30.0], case, model);
}

/// [`assert_reads`] with the middle of the box.
fn assert_reads_at(middle: [f64; 2], case: &str, model: Model<'_>) {
    let folder = tempfile::tempdir().unwrap();
    let output = detect_in(folder.path(), &model.with_input(whole_pictures())).succeeds();
    assert_found(case, &output, &folder.path().join("corpus"), middle);
}

/// Input of windows as large as the images.
fn whole_pictures() -> [Dimension; 4] {
    let [width, height] = PICTURE_PX.map(|side_px| Dimension::Fixed(side_px as i64));
    [Dimension::Fixed(1), Dimension::Fixed(3), height, width]
}

/// Strides of most models, and of those with a finer or without a fine head.
const P3: &[usize] = &[8, 16, 32];
const P2: &[usize] = &[4, 8, 16, 32];
const TINY: &[usize] = &[16, 32];

/// The other shapes with several meanings, and the heads of Ultralytics' families: `labeller/src/detector/layout/meaning/tests.rs`.
#[test]
fn shapes_with_several_meanings_are_read_by_their_numbers_without_settings() {
    let parts: Vec<_> = candidates(P3).into_iter().map(normalized).collect();
    let of_nas = {
        let row = |class: f32| [&[0.0][..], &CORNERS, &[SCORE, class]].concat();
        Answer::floats("flat_predictions", &[2, 7], [row(4.0), row(0.0)].concat())
    };
    let certain = rows_of(&parts, |k| vec![if k == 9 { SCORE } else { 0.01 }, 1.0]);
    let certain_case = "one class with a score of 1 everywhere, in parts of the window";
    for (case, answer) in [("YOLO-NAS flat", of_nas), (certain_case, certain)] {
        assert_reads(case, Model::of(vec![answer]));
    }
}

#[test]
fn rt_detr_is_read_without_settings_in_all_its_versions() {
    let queries = candidates(P2).into_iter().map(normalized).take(300);
    let queries: Vec<_> = queries.collect();
    let three = "{0: 'drone', 1: 'airplane', 2: 'bird'}";
    let two = "{0: 'drone', 1: 'airplane'}";
    let best = rows_of(&queries, |k| best_of(k, 1).to_vec());
    let all = |classes| rows_of(&queries, move |k| scores_of(k, classes, 1));
    for (case, names, answer) in [
        ("today's", three, best),
        ("earlier", three, all(3)),
        (
            "earlier with two classes, whose rows look like final boxes",
            two,
            all(2),
        ),
    ] {
        let head = [("task", "detect"), ("head", "RTDETRDecoder")];
        let metadata = [&head[..], &[("stride", "32"), ("names", names)]].concat();
        assert_reads(case, Model::of(vec![answer]).with_metadata(&metadata));
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
    // The last of three classes and "no object" excludes the others.
    let of_detr = pair(["pred_boxes", "logits"], &parts, &|k| match k {
        9 => vec![-50.0, SCORE.ln(), -50.0, (1.0 - SCORE).ln()],
        _ => vec![-50.0, -50.0, -50.0, 5.0],
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
            "DETR with as many classes as numbers in a box",
            of_detr,
            "layout = 'boxes-and-scores'\naircraft_class = 1",
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
fn a_model_whose_boxes_are_all_below_a_pixel_is_doubted_aloud() {
    let parts: Vec<_> = candidates(P3).into_iter().map(normalized).collect();
    let model = |settings| {
        let answer = columns_of("output0", &parts, 80, 4);
        Model::of(vec![answer])
            .with_input(whole_pictures())
            .with_settings(settings)
    };
    let words = "smaller than a pixel or outside its window";
    let said_of = |settings| {
        let folder = tempfile::tempdir().unwrap();
        said(&detect_in(folder.path(), &model(settings)).succeeds())
    };
    let wrong = said_of("box_unit = 'pixels'");
    assert!(wrong.contains(words), "{wrong}");
    let right = said_of("");
    assert!(!right.contains(words), "{right}");
}

#[test]
fn a_model_of_any_size_is_told_by_its_open_sides() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("any.onnx");
    fs::write(&model, of_any_size()).unwrap();
    let corpus = corpus(folder.path());
    let output = detect(&corpus, &model).succeeds();
    assert_found("any", &output, &corpus, [40.0, 30.0]);
}

/// Refusals as a user sees them. All windows, batches, classes, shapes and settings that are refused are listed in the tests of
/// `labeller/src/detector`.
#[test]
fn what_no_detector_takes_or_answers_is_bad_input_that_names_it_with_what_to_do() {
    let constant = |shape: &[i64], number| Model::of(vec![Answer::constant(shape, number)]);
    let usual = || constant(&[1, 10, 6], 0.0);
    let columns = |classes| columns_with(84, classes, 0);
    let masks = || Answer::floats("output1", &[1, 2, 4, 4], vec![0.0; 32]);
    let pair = || {
        let scores = Answer::floats("scores", &[1, 10, 80], vec![0.0; 800]);
        Model::of(vec![Answer::constant(&[1, 10, 4], 0.0), scores])
    };
    let of_mmdeploy = vec![
        Answer::floats("dets", &[1, 10, 5], vec![0.0; 50]),
        Answer::integers("labels", &[1, 10], vec![0; 10]),
    ];
    let both = || {
        let second = Answer::floats("output1", &[1, 84, 84], vec![0.0; 84 * 84]);
        Model::of(vec![columns_with(84, 80, 4), second])
    };
    let yolox = |setting| {
        let model = Model::of(vec![rows_with(84, 9, &objects_row(HIDDEN, 80, 4))]);
        model.with_settings(setting)
    };
    let of_three = |settings| Model::of(vec![columns_with(84, 3, 1)]).with_settings(settings);
    let task = |task| [("task", task), ("names", "{0: 'airplane'}")];
    let (segment, classify) = (task("segment"), task("classify"));
    let black = [("dtd_profile", r#"{"input": {"scale": 0.0}}"#)];
    let cases: [(Model<'_>, &[&str]); 20] = [
        (
            pair().with_second_input("scale_factor"),
            &["PaddleDetection: `exclude_post_process=True`"],
        ),
        (
            usual().with_input(windows_of(20_000)),
            &["windows of 20000 px, expected 32 to 4096"],
        ),
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
        (
            pair().with_second_input("orig_target_sizes"),
            &[
                "2 inputs (pictures, orig_target_sizes)",
                "boxes-and-scores",
                "postprocessor",
            ],
        ),
        (
            Model::of(of_mmdeploy),
            &["mmdeploy", "num_dets, boxes, scores and labels"],
        ),
        (pair(), &["layout = \"boxes-and-scores\" reads"]),
        (both(), &["output0, output1", "output = \"output0\""]),
        (
            both().with_settings("output = 'boxes'"),
            &["output = \"boxes\"", "output0, output1"],
        ),
        (
            Model::of(vec![columns(33), masks()]).with_metadata(&segment),
            &["task \"segment\"", "expected one for \"detect\""],
        ),
        (
            constant(&[1, 1000], 0.0).with_metadata(&classify),
            &["task \"classify\""],
        ),
        // Without the word in its metadata.
        (
            Model::of(vec![columns(33), masks()]),
            &[
                "segmentation",
                "\"output0\" Tensor<f32>(1, 37, 84)",
                "\"output1\"",
            ],
        ),
        (
            of_three("[input]\nsize_px = 416\n"),
            &["input.size_px = 416", "windows of 64x64 px"],
        ),
        (
            of_three("layout = 'batch-corners'\n"),
            &["\"batch-corners\"", "[boxes, 7]", "Tensor<f32>(1, 7, 84)"],
        ),
        (
            of_three("aircraft_clas = 1\n"),
            &[
                "model.onnx.toml:1:1",
                "aircraft_clas",
                "aircraft_class",
                "^",
            ],
        ),
        (
            yolox("layout = 'yolox'\nbox_unit = 'normalized'\n"),
            &["box_form or box_unit", "layout is yolox"],
        ),
        (
            yolox("layout = 'yolox'\nbox_form = 'corners'\n"),
            &["box_form or box_unit", "layout is yolox"],
        ),
        (
            Model::of(efficient_nms())
                .with_settings("layout = 'efficient-nms'\noutput = 'det_boxes'\n"),
            &["output = \"det_boxes\"", "four outputs"],
        ),
    ];
    for (model, words) in cases {
        let folder = tempfile::tempdir().unwrap();
        detect_in(folder.path(), &model).ends_with(2, &[words, &["model.onnx"]].concat());
        for scenario in fs::read_dir(folder.path().join("corpus/scenarios")).unwrap() {
            assert!(!scenario.unwrap().path().join("detections").exists());
        }
    }
}

#[test]
fn detections_are_told_apart_by_model_and_settings_and_verify_accepts_both() {
    let folder = tempfile::tempdir().unwrap();
    let model = |class| Model::of(vec![columns_with(84, 80, class)]);
    let bare = detect_in(folder.path(), &model(4)).succeeds();
    let hash = blake3::hash(&model(4).onnx()).to_string();
    let outcome = json(&bare);
    assert_eq!(outcome["model_hash"], hash[..16], "{}", said(&bare));
    assert_eq!(outcome["model"], "model.onnx");
    let path = folder.path().join("model.onnx");
    let corpus = folder.path().join("corpus");
    let with = |settings: &str| {
        fs::write(path.with_extension("onnx.toml"), settings).unwrap();
        json(&detect(&corpus, &path).succeeds())
    };
    let unchanged = with("# nothing yet\n");
    assert_eq!(unchanged["model_hash"], hash[..16]);
    assert_eq!(unchanged["detected"].as_array().unwrap().len(), 0);
    let other = with("aircraft_class = 5\n");
    assert_ne!(other["model_hash"], hash[..16]);
    assert_eq!(other["counts"]["detections"], 0);
    dtd().args(["verify", text(&corpus)]).ends_with(0, &[]);
    // Which of them is meant has to be said.
    let listed = [&outcome, &other].map(|found| {
        let hash = found["model_hash"].as_str().unwrap();
        format!("model.onnx ({hash})")
    });
    dtd()
        .args(["train", text(&corpus), "--quick", "--out"])
        .arg(folder.path().join("run"))
        .args(["--detections", "model.onnx"])
        .ends_with(2, &[&listed[0], &listed[1]]);
}

#[test]
fn the_device_is_recorded_and_one_that_the_library_lacks_is_bad_input_that_says_where_to_get_it() {
    let folder = tempfile::tempdir().unwrap();
    let model = Model::of(vec![columns_with(84, 80, 4)]);
    let on = |device: &str| {
        let mut command = detect_in(folder.path(), &model);
        command.args(["--device", device]);
        command
    };
    // The tests load a build without GPUs.
    let remedies = ["onnxruntime-gpu", "--onnx-runtime", "ORT_DYLIB_PATH"];
    let words = [&["cuda:1", "has only cpu"][..], &remedies].concat();
    on("cuda:1").ends_with(2, &words);
    on("gpu").ends_with(2, &["cuda"]);
    let outcome = json(&on("cpu").succeeds());
    assert_eq!(outcome["device"], "cpu");
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
    dtd()
        .args(["detect", text(sound()), "--model", text(&model)])
        .ends_with(2, &["broken.onnx"]);
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
        command
    };
    detect(None, None).succeeds();
    // Neither by a name that is searched for, nor by a path relative to the working folder.
    for relative in ["libonnxruntime.so", "./libonnxruntime.so"] {
        detect(None, Some(relative)).ends_with(2, &["absolute"]);
        detect(Some(Path::new(relative)), None).ends_with(2, &["absolute"]);
    }
    assert!(!trace.exists(), "the planted library ran");
    // The trace would show it: an explicitly named library is loaded.
    detect(Some(&library), None).ends_with(2, &[]);
    assert!(trace.exists());
}
