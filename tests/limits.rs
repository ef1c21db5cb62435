//! Impossible values, sizes and files in every place where untrusted files are read: a fault with its position, in time, and in
//! little memory; never a panic, a hang or a result.

#[path = "limits/damaged_scenario.rs"]
mod damaged_scenario;
#[path = "limits/idle_connections.rs"]
mod idle_connections;
#[path = "limits/memory.rs"]
mod memory;
mod tiny;

use std::ffi::OsString;
use std::fs;
use std::os::unix::ffi::OsStringExt;
use std::path::Path;
use std::process::Output;
use std::time::Duration;

use dataset::tables::columns::{Table, TableWriter};
use rustix::fs::{CWD, FileType, Mode};
use serde_json::Value;
use testkit::command::said;
use tiny::{Tiny, run};

/// Far longer than any of this takes.
const PATIENCE: Duration = Duration::from_secs(120);

fn dtd(tiny: &Tiny, arguments: &[&str]) -> Output {
    run(&mut tiny.dtd(arguments), PATIENCE).unwrap_or_else(|| panic!("{arguments:?} hangs"))
}

/// Asserts that a verb ends with this code and prints all of this.
fn assert_says(tiny: &Tiny, arguments: &[&str], code: i32, words: &[&str]) {
    let output = dtd(tiny, arguments);
    let said = said(&output);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {said}");
    assert!(!said.contains("panicked"), "{arguments:?}: {said}");
    for word in words {
        assert!(
            said.contains(word),
            "{arguments:?} does not say {word:?}: {said}"
        );
    }
}

/// A FIFO instead of the file.
fn put_fifo(path: &Path) {
    let _ = fs::remove_file(path);
    rustix::fs::mknodat(CWD, path, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
}

fn change_json(path: &Path, change: impl FnOnce(&mut Value)) {
    let mut value: Value = serde_json::from_slice(&fs::read(path).unwrap()).unwrap();
    change(&mut value);
    fs::write(path, serde_json::to_vec(&value).unwrap()).unwrap();
}

#[test]
fn a_fifo_in_the_place_of_any_file_is_a_fault_and_nothing_waits_for_it() {
    let scenario_files = [
        "DONE.json",
        "MANIFEST.b3",
        "scenario.json",
        "calibration.json",
        "frames.parquet",
        "boxes_truth.parquet",
        "views/left.mp4",
    ];
    for name in scenario_files {
        let tiny = Tiny::made().copy();
        let broken = &tiny.scenarios()[0];
        put_fifo(&broken.join(name));
        assert_says(&tiny, &["verify", "corpus"], 1, &[name, "FIFO"]);
        let label = dtd(&tiny, &["label", "corpus"]);
        assert!(
            !label.status.success() || name.starts_with("views"),
            "{}",
            said(&label)
        );
    }
    for name in ["plan.json", "splits.json"] {
        let tiny = Tiny::made().copy();
        put_fifo(&tiny.path("corpus").join(name));
        assert_says(
            &tiny,
            &["verify", "--no-decode", "corpus"],
            1,
            &[name, "FIFO"],
        );
    }
    let tiny = Tiny::made().copy();
    put_fifo(&tiny.path("fifo"));
    let fifo = &["fifo is a FIFO; expected a regular file"];
    assert_says(&tiny, &["plan", "fifo"], 2, fifo);
    let train = &["train", "corpus", "--out", "new", "--config", "fifo"];
    assert_says(&tiny, train, 2, fifo);
    let device = &["/dev/zero is a device"];
    assert_says(&tiny, &["plan", "/dev/zero"], 2, device);
    assert_says(
        &tiny,
        &["plan", "/dev/zero", "--against", "corpus"],
        2,
        device,
    );
}

#[test]
fn verify_names_the_faults_of_all_scenarios_though_one_cannot_be_read() {
    let tiny = Tiny::made().copy();
    let scenarios = tiny.scenarios();
    fs::write(scenarios[0].join("DONE.json"), "{").unwrap();
    fs::write(scenarios[1].join("scenario.json"), "{").unwrap();
    fs::write(scenarios[1].join("calibration.json"), "{").unwrap();
    fs::write(scenarios[2].join("frames.parquet"), "PAR1").unwrap();
    let record = fs::read_dir(scenarios[3].join("detections"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .find(|path| path.extension().is_some_and(|ending| ending == "json"))
        .unwrap();
    let text = fs::read_to_string(&record).unwrap();
    fs::write(&record, &text[..text.len() / 2]).unwrap();
    let detections = format!("detections/{}", record.file_name().unwrap().display());
    assert_says(
        &tiny,
        &["verify", "--no-decode", "corpus"],
        1,
        &[
            "r1/DONE.json",
            "r2/scenario.json",
            "r2/calibration.json",
            "r3/frames.parquet",
            &detections,
        ],
    );
}

#[test]
fn counts_and_rates_that_no_scenario_has_are_refused_by_every_reader() {
    type Change = fn(&mut Value);
    let changes: [(&str, Change); 5] = [
        ("ticks 4000000000 is out of range", |record| {
            record["ticks"] = 4_000_000_000_u32.into();
        }),
        ("0/8 is not a frame rate", |record| {
            record["frame_rate"]["numerator"] = 0.into();
        }),
        ("1/4294967295 is not a frame rate", |record| {
            record["frame_rate"]["denominator"] = u32::MAX.into();
        }),
        ("names files", |record| {
            record["views"][0] = "../../../splits".into();
        }),
        (
            "conditions.weather.visibility_m -1 is out of range",
            |record| {
                record["conditions"]["weather"]["visibility_m"] = (-1.0).into();
            },
        ),
    ];
    for (words, change) in changes {
        let tiny = Tiny::made().copy();
        change_json(&tiny.scenarios()[0].join("scenario.json"), change);
        assert_says(&tiny, &["verify", "corpus"], 1, &[words]);
        for verb in [
            &["label", "corpus"][..],
            &testkit::command::words("train corpus --out new --config training.toml"),
            &["evaluate", "run", "--corpus", "corpus"],
        ] {
            let output = dtd(&tiny, verb);
            let said = said(&output);
            assert!(!output.status.success(), "{verb:?}: {said}");
            assert!(!said.contains("panicked"), "{verb:?}: {said}");
        }
    }
}

#[test]
fn a_table_of_thirty_million_rows_is_refused_in_little_memory() {
    let tiny = Tiny::made().copy();
    let scenario = &tiny.scenarios()[0];
    let path = scenario.join("boxes_truth.parquet");
    let rows = 30_000_000;
    let zeros = || std::iter::repeat_n(0.0, rows);
    TableWriter::new()
        .f64("cx_px", zeros())
        .f64("cy_px", zeros())
        .write(&path)
        .unwrap();
    assert!(path.metadata().unwrap().len() < 1 << 20);
    // Decoded, it would take half a gigabyte, and several as boxes.
    let verify = ["verify", "--no-decode", "corpus"];
    let output = run(&mut tiny.dtd_within(1 << 20, &verify), PATIENCE).unwrap();
    let said = said(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    let words = "boxes_truth.parquet: has 30000000 rows, expected at most";
    assert!(said.contains(words), "{said}");
}

#[test]
fn labels_that_cannot_be_are_refused_with_row_and_column() {
    let tiny = Tiny::made().copy();
    let path = tiny.scenarios()[0].join("frames.parquet");
    let table = Table::read(&path, u64::MAX).unwrap();
    let mut again = TableWriter::new();
    for name in table.column_names() {
        again = if let Ok(mut values) = table.optional_f64(name) {
            if name == "dtd_m" {
                values[3] = Some(1e308);
            }
            match values.iter().copied().collect::<Option<Vec<_>>>() {
                Some(values) => again.f64(name, values),
                None => again.optional_f64(name, values),
            }
        } else if let Ok(values) = table.i64(name) {
            again.i64(name, values)
        } else if let Ok(values) = table.u32(name) {
            again.u32(name, values)
        } else if let Ok(values) = table.u64(name) {
            again.u64(name, values)
        } else {
            again.bool(name, table.bool(name).unwrap())
        };
    }
    again.write(&path).unwrap();
    let words = "frames.parquet row 3: dtd_m 1e308 is out of range";
    assert_says(&tiny, &["verify", "--no-decode", "corpus"], 1, &[words]);
    let label = dtd(&tiny, &["label", "corpus"]);
    assert!(!label.status.success(), "{}", said(&label));
}

#[test]
fn a_recording_with_a_value_that_cannot_be_is_refused_by_plan() {
    let tiny = Tiny::made().copy();
    let flights = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/flights");
    let text = fs::read_to_string(flights.join("01_calm_ils.csv")).unwrap();
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let columns: Vec<&str> = lines[0].split(',').collect();
    let gear = columns
        .iter()
        .position(|name| *name == "gear_norm")
        .unwrap();
    // On final: what is odd before the approach does not matter.
    let odd = lines.len() - 150;
    let mut fields: Vec<&str> = lines[odd].split(',').collect();
    fields[gear] = "-5";
    lines[odd] = fields.join(",");
    fs::write(tiny.path("odd.csv"), lines.join("\n")).unwrap();
    let sweep = fs::read_to_string(tiny.path("sweep.toml")).unwrap();
    let sweep = format!("{sweep}\n[[recorded]]\nfiles = \"odd.csv\"\n");
    fs::write(tiny.path("recorded.toml"), sweep).unwrap();
    let words = format!(
        "odd.csv:{}: gear_norm -5 is out of range; expected a ratio from 0 to 1",
        odd + 1
    );
    assert_says(&tiny, &["plan", "recorded.toml"], 2, &[&words]);
}

#[test]
fn a_plan_that_leads_out_of_the_corpus_or_has_odd_numbers_is_refused() {
    type Change = fn(&mut Value);
    let changes: [(&str, Change); 3] = [
        ("names files", |plan| {
            plan["scenarios"][0]["id"] = "../../elsewhere".into();
        }),
        ("start_dtd_m 1e99 is out of range", |plan| {
            plan["scenarios"][0]["parameters"]["start_dtd_m"] = 1e99.into();
        }),
        (
            "common.picture.width_px 4000000000 is out of range",
            |plan| {
                plan["common"]["picture"]["width_px"] = 4_000_000_000_u32.into();
            },
        ),
    ];
    for (words, change) in changes {
        let tiny = Tiny::made().copy();
        change_json(&tiny.corpus().join("plan.json"), change);
        let generate = ["generate", "sweep.toml", "--out", "corpus"];
        assert_says(&tiny, &generate, 2, &["plan.json", words]);
        assert!(!tiny.path("elsewhere").exists());
    }
}

#[test]
fn a_mistake_in_training_settings_or_a_search_is_shown_in_its_line_before_anything_is_trained() {
    let tiny = Tiny::made().copy();
    for (option, settings, words) in [
        (
            "--config",
            "seed = 1\n[estimator]\nlstm = [0, 8]\n",
            &[
                "odd.toml:3:8: configuration: estimator.lstm is 0, expected a whole number from 1 to 1024",
                "3 | lstm = [0, 8]\n    |        ^^^^^^",
            ][..],
        ),
        (
            "--config",
            "seed = 1\n[estimator]\ndropout = 0.5\n",
            &[
                "odd.toml:3:1: unknown field `dropout`",
                "3 | dropout = 0.5\n    | ^^^^^^^",
            ],
        ),
        ("--config", "seed = \n", &["odd.toml:1:", "1 | seed ="]),
        (
            "--search",
            "seeds = [0]\n[variants.a.estimator]\nlstn = [8]\n",
            &["unknown field `lstn`"],
        ),
        (
            "--search",
            "seeds = [0]\n[variants.a]\nmax_dtd_nm = -1\n",
            &["odd.toml:3:14: configuration: max_dtd_nm is -1"],
        ),
        (
            "--search",
            "seeds = [0]\n[settings]\nmax_dtd_nm = -1\n[variants.a]\n",
            &["odd.toml:3:14: configuration: max_dtd_nm is -1"],
        ),
        ("--search", "seeds = []\n[variants.a]\n", &["seeds is []"]),
        (
            "--search",
            "seeds = [0]\n[variants.best]\n",
            &["variants is \"best\""],
        ),
        ("--search", "seed = 0\n", &["unknown field `seed`"]),
    ] {
        fs::write(tiny.path("odd.toml"), settings).unwrap();
        let train = ["train", "corpus", "--out", "new", option, "odd.toml"];
        assert_says(&tiny, &train, 2, words);
        assert!(!tiny.path("new").exists());
    }
}

#[test]
fn a_path_that_is_no_text_has_one_message_for_all_verbs() {
    let tiny = Tiny::made().copy();
    let name = OsString::from_vec(b"corp\xffs".to_vec());
    fs::rename(tiny.corpus(), tiny.path("x").with_file_name(&name)).unwrap();
    for (before, after) in [
        (&["label"][..], &[][..]),
        (&["verify"], &[]),
        (&["detect"], &["--model", tiny::MODEL]),
        (&["train"], &["--out", "new"]),
        (&["generate", "sweep.toml", "--out"], &[]),
        (&["plan", "sweep.toml", "--against"], &[]),
        (&["evaluate", "run", "--corpus"], &[]),
        (&["push"], &["file:///nowhere"]),
    ] {
        let arguments: Vec<OsString> = before
            .iter()
            .map(OsString::from)
            .chain([name.clone()])
            .chain(after.iter().map(OsString::from))
            .collect();
        let output = run(&mut tiny.dtd(&arguments), PATIENCE).unwrap();
        let said = said(&output);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        let words = "is not a UTF-8 path";
        assert!(said.contains(words), "{arguments:?}: {said}");
    }
}

#[test]
fn what_needs_more_memory_than_allowed_says_how_much() {
    let tiny = Tiny::made().copy();
    let path = tiny.scenarios()[0].join("detections");
    let table = fs::read_dir(&path)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .find(|path| path.extension().is_some_and(|ending| ending == "parquet"))
        .unwrap();
    // As many as the scenario may have images: 12,000.
    let rows = 12_000;
    TableWriter::new()
        .u32("tick", std::iter::repeat_n(0, rows))
        .text("view", std::iter::repeat_n("left", rows))
        .f64("cx_px", std::iter::repeat_n(0.0, rows))
        .f64("cy_px", std::iter::repeat_n(0.0, rows))
        .f64("width_px", std::iter::repeat_n(1.0, rows))
        .f64("height_px", std::iter::repeat_n(1.0, rows))
        .f64("score", std::iter::repeat_n(0.5, rows))
        .u32("tile", std::iter::repeat_n(0, rows))
        .write(&table)
        .unwrap();
    let words = &["of memory; there are", "by --max-memory"];
    let little = ["--max-memory", "1M", "verify", "--no-decode", "corpus"];
    let detect = [
        "--max-memory",
        "1M",
        "detect",
        "corpus",
        "--model",
        tiny::MODEL,
    ];
    assert_says(
        &tiny,
        &detect,
        2,
        &["a run of 1 windows", words[0], words[1]],
    );
    assert_says(&tiny, &little, 1, words);
    assert_says(&tiny, &["--max-memory", "none", "schema"], 2, &["e.g. 2G"]);
}

/// A file system's quota or `ulimit -f` does not end the process: a failed write is an error, and nothing partial remains.
#[test]
fn a_file_that_may_not_grow_is_an_error_and_no_death_by_signal() {
    let tiny = Tiny::made().copy();
    let store = format!("file://{}", tiny.path("store").display());
    let mut limited = std::process::Command::new("bash");
    limited
        .args(["-c", "ulimit -f 2; exec \"$@\"", "bash"])
        .arg(env!("CARGO_BIN_EXE_dtd"))
        .arg("push")
        .arg(tiny.corpus())
        .arg(store);
    let output = run(&mut limited, PATIENCE).expect("ends");
    let said = said(&output);
    assert!(output.status.code().is_some_and(|code| code != 0), "{said}");
    assert!(said.contains("File too large"), "{said}");
}

#[test]
fn a_name_with_control_characters_reaches_no_terminal_not_even_through_a_pipe() {
    let tiny = Tiny::made().copy();
    let strange = tiny.corpus().join("scenarios/a\u{1b}[31mb");
    fs::create_dir(&strange).unwrap();
    fs::write(strange.join("DONE.json"), "{}").unwrap();
    let output = dtd(&tiny, &["verify", "--no-decode", "corpus"]);
    let said = said(&output);
    assert!(said.contains("\\u{1b}[31mb"), "{said}");
    assert!(!said.contains('\u{1b}'), "{said}");
}
