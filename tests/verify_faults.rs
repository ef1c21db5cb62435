//! `dtd verify` against faults that only a recorded corpus can have: images, poses and cameras that do not belong together, sealed again,
//! so that the content must reveal them. The checks of single files are tested in `crates/verify/src/tests.rs`.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use dataset::corpus::calibration::{Calibration, CameraEntry};
use dataset::corpus::scenario::ScenarioRecord;
use dataset::corpus::seal::seal_folder;
use dataset::corpus::{Corpus, ScenarioFolder};
use dataset::tables::frames::Frames;
use dataset::video::{VideoReader, VideoSettings, VideoWriter};
use dataset::work::watch::Silent;
use serde_json::Value;
use testkit::command::{Dtd, text};
use testkit::files::copy_folder;
use testkit::sweep::SmallSweep;
use verify::{Finding, VerifyOptions, VerifyReport, verify, verify_with};

/// Two scenarios that fly the same recording from 2 NM, one in clear air, one in fog, with slightly misplaced and degraded cameras.
fn sweep_toml() -> String {
    SmallSweep {
        name: "faults",
        seed: 0,
        weathers: &["clear", "foggy"],
        repeats: 1,
        size_px: (384, 256),
        frame_rate: "2",
        tables: r#"
[start]
dtd_nm = 2.4
cross_track_m = { mean = 0, sd = 20 }
speed_mps = 72

[[recorded]]
files = "flights/01_calm_ils.csv"

[weather.clear]
visibility_m = 80000
wind_speed_mps = 2
wind_from_true_deg = 20

[weather.foggy]
visibility_m = 5000

[jitter]
heading_deg = { mean = 0, sd = 0.05 }
hfov_deg = { mean = 0, sd = 0.02 }

[imaging]
refraction_coefficient = 0.13
blur_sigma_px = 0.4
"#,
    }
    .toml()
}
const CLEAR: &str = "1200-clear-r1";
const FOGGY: &str = "1200-foggy-r1";
/// A tick in which the aircraft is near enough for visible motion, counted from the end of the recording.
const FROM_THE_END: usize = 30;

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));

/// The valid corpus, made once per run of the tests.
fn sound() -> &'static Path {
    static CORPUS: OnceLock<tempfile::TempDir> = OnceLock::new();
    let folder = CORPUS.get_or_init(|| DTD.recorded(&sweep_toml()));
    Box::leak(folder.path().join("corpus").into_boxed_path())
}

/// A copy of the valid corpus to damage.
struct Copy {
    _folder: tempfile::TempDir,
    corpus: Corpus,
}

impl Copy {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        copy_folder(sound(), folder.path());
        let corpus = Corpus::open(folder.path()).unwrap();
        Self {
            _folder: folder,
            corpus,
        }
    }

    fn clear(&self) -> ScenarioFolder {
        self.corpus.scenario(CLEAR)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.clear().root().join(name)
    }

    /// Seals the damaged scenario, as an author who trusts only hashes would.
    fn seal(&self) {
        let seal = self.clear().seal().unwrap().unwrap();
        seal_folder(self.clear().root(), &seal.config_hash).unwrap();
    }

    /// Labels the scenario again, which seals it, too.
    fn label(&self) {
        self.seal();
        let outcome = labeller::label_corpus(&self.corpus, &Silent).unwrap();
        assert_eq!(outcome.labelled, [CLEAR], "{outcome:?}");
    }

    fn findings(&self) -> Vec<Finding> {
        verify(&self.corpus).findings
    }

    /// The findings without decoding an image.
    fn findings_without_pictures(&self) -> Vec<Finding> {
        let options = VerifyOptions {
            decode: false,
            ..VerifyOptions::default()
        };
        verify_with(&self.corpus, options, &Silent)
            .unwrap()
            .findings
    }

    fn change_record(&self, change: impl FnOnce(&mut ScenarioRecord)) {
        let mut record = ScenarioRecord::read(&self.clear().record_path()).unwrap();
        change(&mut record);
        record.write(&self.clear().record_path()).unwrap();
    }

    /// Changes the left camera, with everything in the file that depends on it.
    fn change_left_camera(&self, change: impl FnOnce(&mut CameraEntry)) {
        let path = self.clear().calibration_path();
        let mut calibration = Calibration::read(&path).unwrap();
        let mut entry = calibration.cameras["left"].clone();
        change(&mut entry);
        let whole = CameraEntry::from_pose(entry.placed, entry.width_px, entry.height_px)
            .with_imaging(&entry.imaging());
        calibration.cameras.insert("left".into(), whole);
        calibration.write(&path).unwrap();
    }

    fn change_frames(&self, change: impl FnOnce(&mut Frames)) {
        let mut frames = Frames::read(&self.clear().frames_path()).unwrap();
        change(&mut frames);
        frames.write(&self.clear().frames_path()).unwrap();
    }

    /// Decodes a video, changes its images, and encodes them again.
    fn change_pictures(&self, view: &str, change: impl FnOnce(&mut Vec<Vec<u8>>)) {
        let path = self.clear().video_path(view);
        let mut reader = VideoReader::open(&path).unwrap();
        let (width_px, height_px) = (reader.width(), reader.height());
        let mut pictures = Vec::new();
        let mut rgb = Vec::new();
        while reader.next_frame(&mut rgb).unwrap().is_some() {
            pictures.push(rgb.clone());
        }
        change(&mut pictures);
        let rate = ScenarioRecord::read(&self.clear().record_path())
            .unwrap()
            .frame_rate;
        let settings = VideoSettings::default();
        let mut writer = VideoWriter::create(&path, &settings, width_px, height_px, rate).unwrap();
        for picture in &pictures {
            writer.write(picture).unwrap();
        }
        writer.finish().unwrap();
    }
}

fn listed(findings: &[Finding]) -> String {
    findings
        .iter()
        .map(|finding| format!("{finding}\n"))
        .collect()
}

/// Asserts that a fault of the clear scenario is found in this file, row and view, in these words.
fn assert_found(
    findings: &[Finding],
    file: &str,
    row: Option<u64>,
    view: Option<&str>,
    words: &str,
) {
    let found = findings.iter().any(|finding| {
        finding.scenario.as_deref() == Some(CLEAR)
            && finding.file == file
            && finding.row == row
            && finding.view.as_deref() == view
            && finding.message.contains(words)
    });
    assert!(
        found,
        "expected {file} row {row:?} view {view:?} {words:?} in:\n{}",
        listed(findings)
    );
    assert_only_the_clear_one(findings);
}

fn assert_only_the_clear_one(findings: &[Finding]) {
    for finding in findings {
        assert_ne!(finding.scenario.as_deref(), Some(FOGGY), "{finding}");
    }
}

fn flip_a_byte(path: &Path) {
    let mut bytes = fs::read(path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(path, bytes).unwrap();
}

#[test]
fn a_sound_corpus_has_no_findings_and_its_pictures_prove_that_views_and_tables_are_in_step() {
    let report: VerifyReport = verify(&Corpus::open(sound()).unwrap());
    assert_eq!(listed(&report.findings), "");
    assert_eq!(
        (report.scenarios, report.labelled, report.views.len()),
        (2, 2, 4)
    );
    assert_eq!(report.missing, Vec::<String>::new());
    println!("{:#?}", report.views);
    for proof in report.views.iter().filter(|proof| proof.scenario == CLEAR) {
        assert!(proof.clear_boxes > 30, "{proof:?}");
        assert!(
            proof.filled_boxes * 10 >= proof.clear_boxes * 9,
            "{proof:?}"
        );
        assert!(proof.offset_px.unwrap() < 3.0, "{proof:?}");
        let (lag_ms, error_ms) = (proof.lag_ms.unwrap(), proof.lag_error_ms.unwrap());
        assert!(lag_ms.abs() < 3.0 * error_ms, "{proof:?}");
        // Half a tick, in images where the fin is thinner than a pixel.
        assert!(error_ms < 250.0, "{proof:?}");
    }
}

#[test]
fn the_command_lists_faults_as_text_and_as_json_and_fails() {
    let sound_one = DTD.run(&["verify", text(sound()), "--complete"]);
    let said = String::from_utf8_lossy(&sound_one.stdout);
    assert_eq!(sound_one.status.code(), Some(0), "{said}");
    assert!(said.contains(": no faults"), "{said}");

    let copy = Copy::new();
    flip_a_byte(&copy.path("calibration.json"));
    fs::remove_dir_all(copy.corpus.scenario(FOGGY).root()).unwrap();
    let output = DTD.run(&["verify", text(copy.corpus.root()), "--no-decode"]);
    let said = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("calibration.json does not match its seal"));
    assert!(said.contains("1 planned scenario is missing"), "{said}");

    let arguments = ["verify", text(copy.corpus.root()), "--complete", "--json"];
    let output = DTD.run(&arguments);
    assert_eq!(output.status.code(), Some(1));
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let of = |id: &str| {
        let findings = report["findings"].as_array().unwrap().iter();
        findings.filter(|finding| finding["scenario"] == id).count()
    };
    assert_eq!(of(FOGGY), 1, "{report}");
    assert!(of(CLEAR) >= 1);
    assert_eq!(report["missing"], serde_json::json!([FOGGY]));
}

#[test]
fn b3sum_finds_a_sound_scenario_sound_and_a_damaged_one_damaged() {
    let judge = |folder: &Path| {
        Command::new("b3sum")
            .args(["--check", "MANIFEST.b3"])
            .current_dir(folder)
            .output()
            .expect("b3sum is installed by scripts/setup.sh")
    };
    let copy = Copy::new();
    let sound = judge(copy.clear().root());
    let said = String::from_utf8_lossy(&sound.stdout);
    assert!(sound.status.success(), "{said}");
    assert_eq!(said.matches(": OK").count(), said.lines().count(), "{said}");
    for file in ["frames.parquet", "views/left.mp4", "boxes_truth.parquet"] {
        assert!(said.contains(&format!("{file}: OK")), "{said}");
    }
    flip_a_byte(&copy.path("views/left.mp4"));
    let damaged = judge(copy.clear().root());
    let said = String::from_utf8_lossy(&damaged.stdout);
    assert!(!damaged.status.success(), "{said}");
    assert!(said.contains("views/left.mp4: FAILED"), "{said}");
}

#[test]
fn a_dropped_picture_is_found_by_the_number_and_if_that_is_right_by_what_the_pictures_show() {
    let copy = Copy::new();
    copy.change_pictures("left", |pictures| drop(pictures.remove(pictures.len() / 2)));
    copy.seal();
    let ticks = ScenarioRecord::read(&copy.clear().record_path())
        .unwrap()
        .ticks;
    let words = format!("has {} images, but scenario.json says {ticks}", ticks - 1);
    assert_found(
        &copy.findings(),
        "views/left.mp4",
        None,
        Some("left"),
        &words,
    );

    let copy = Copy::new();
    let mut dropped = 0;
    copy.change_pictures("left", |pictures| {
        dropped = pictures.len() / 2;
        pictures.remove(dropped);
        pictures.push(pictures.last().unwrap().clone());
    });
    copy.seal();
    let findings = copy.findings();
    let near = findings.iter().find(|finding| {
        finding.file == "views/left.mp4"
            && finding
                .row
                .is_some_and(|row| row.abs_diff(dropped as u64) <= 8)
            && finding.message.contains("ticks later")
    });
    assert!(near.is_some(), "dropped {dropped}: {}", listed(&findings));
    assert_only_the_clear_one(&findings);
}

#[test]
fn a_doubled_picture_and_a_frozen_video_are_found_in_their_rows() {
    let copy = Copy::new();
    let mut doubled = 0;
    copy.change_pictures("right", |pictures| {
        doubled = pictures.len() - FROM_THE_END;
        pictures[doubled] = pictures[doubled - 1].clone();
    });
    copy.seal();
    assert_found(
        &copy.findings(),
        "views/right.mp4",
        Some(doubled as u64),
        Some("right"),
        "frozen or doubled",
    );

    let copy = Copy::new();
    let mut frozen = 0;
    copy.change_pictures("right", |pictures| {
        frozen = pictures.len() / 2;
        let last = pictures[frozen].clone();
        pictures[frozen..].fill(last);
    });
    copy.seal();
    let findings = copy.findings();
    assert!(
        findings
            .iter()
            .any(|finding| finding.file == "views/right.mp4"
                && finding
                    .row
                    .is_some_and(|row| row > frozen as u64 && row <= frozen as u64 + 4)
                && finding.message.contains("frozen or doubled")),
        "frozen from {frozen}: {}",
        listed(&findings)
    );
}

#[test]
fn swapped_views_are_found_though_all_hashes_are_right() {
    let copy = Copy::new();
    let [left, right, aside] = ["left.mp4", "right.mp4", "aside.mp4"]
        .map(|name| copy.clear().root().join("views").join(name));
    fs::rename(&left, &aside).unwrap();
    fs::rename(&right, &left).unwrap();
    fs::rename(&aside, &right).unwrap();
    let found = copy.findings();
    let words = "views/left.mp4 does not match its seal";
    assert_found(&found, "MANIFEST.b3", None, None, words);
    copy.seal();
    let found = copy.findings();
    for (view, other) in [("left", "right"), ("right", "left")] {
        let words = format!("boxes of view {other}: are the views swapped?");
        assert_found(
            &found,
            &format!("views/{view}.mp4"),
            None,
            Some(view),
            &words,
        );
    }
}

#[test]
fn poses_that_are_one_tick_late_in_all_tables_are_found_in_the_pictures() {
    // Every pose belongs to the next tick, consistent with velocities, echoes, labels and boxes: only the images reveal it.
    let copy = Copy::new();
    copy.change_frames(|frames| {
        let rows = &mut frames.rows;
        for row in 0..rows.len() - 1 {
            let next = rows[row + 1].clone();
            let this = &mut rows[row];
            this.pose = next.pose;
            this.velocity_ned_mps = next.velocity_ned_mps;
            this.true_airspeed_mps = next.true_airspeed_mps;
            this.controls = next.controls;
            this.on_ground = next.on_ground;
            for stamp in &mut this.views {
                stamp.echoed_pose = next.pose;
            }
        }
        // The last one is a straight continuation.
        let [before, last] = [rows.len() - 2, rows.len() - 1];
        let step = rows[before].pose;
        let earlier = rows[before - 1].pose;
        let last = &mut rows[last];
        last.pose = step;
        last.pose.latitude_deg += step.latitude_deg - earlier.latitude_deg;
        last.pose.longitude_deg += step.longitude_deg - earlier.longitude_deg;
        last.pose.altitude_msl_m += step.altitude_msl_m - earlier.altitude_msl_m;
        for stamp in &mut last.views {
            stamp.echoed_pose = last.pose;
        }
        rows.iter_mut().for_each(|row| row.labels = None);
    });
    fs::remove_file(copy.path("boxes_truth.parquet")).unwrap();
    copy.label();
    let findings = copy.findings();
    for view in ["left", "right"] {
        let file = format!("views/{view}.mp4");
        let is_late =
            |message: &str| message.contains(" ms late") || message.contains("ticks earlier");
        let found = findings
            .iter()
            .find(|finding| finding.file == file && is_late(&finding.message));
        assert!(found.is_some(), "{file}: {}", listed(&findings));
    }
    assert!(
        findings
            .iter()
            .all(|finding| finding.file.starts_with("views/")),
        "{}",
        listed(&findings)
    );
}

#[test]
fn a_wrong_touchdown_is_found_even_if_threshold_and_labels_follow_it() {
    let copy = Copy::new();
    copy.change_record(|record| {
        record.runway.touchdown_past_threshold_m += 50.0;
        record.touchdown = record.runway.touchdown_target();
    });
    copy.label();
    let words = "runway was planned as";
    assert_found(&copy.findings(), "scenario.json", None, None, words);
}

#[test]
fn a_camera_that_is_not_as_it_was_planned_is_found_even_if_tables_and_labels_follow_it() {
    type Change = fn(&mut CameraEntry);
    let changes: [(&str, Change); 7] = [
        ("heading_true_deg", |left| {
            left.placed.pose.heading_true_deg += 0.01;
        }),
        ("roll_deg", |left| left.placed.pose.roll_deg = 0.1),
        // Values that give another `k`.
        ("hfov_deg", |left| left.placed.hfov_deg += 0.1),
        ("latitude_deg, longitude_deg, altitude_msl_m", |left| {
            left.placed.pose.altitude_msl_m += 0.5;
        }),
        ("refraction_coefficient", |left| {
            left.refraction_coefficient = 0.2;
        }),
        ("distortion", |left| {
            left.distortion = vec![-0.01, 0.0, 0.0, 0.0, 0.0];
        }),
        ("degradation", |left| left.degradation = None),
    ];
    for (what, change) in changes {
        let copy = Copy::new();
        let before = Calibration::read(&copy.clear().calibration_path())
            .unwrap()
            .cameras["left"]
            .clone();
        copy.change_left_camera(change);
        let after = Calibration::read(&copy.clear().calibration_path())
            .unwrap()
            .cameras["left"]
            .clone();
        copy.change_frames(|frames| {
            let left = frames.views.iter().position(|view| view == "left").unwrap();
            for row in &mut frames.rows {
                row.views[left].echoed_camera = after.placed;
                row.labels = None;
            }
        });
        fs::remove_file(copy.path("boxes_truth.parquet")).unwrap();
        copy.label();
        let findings = copy.findings_without_pictures();
        let of_the_plan: Vec<&Finding> = findings
            .iter()
            .filter(|finding| finding.message.contains("(plan.json)"))
            .collect();
        assert_eq!(of_the_plan.len(), 1, "{what}: {}", listed(&findings));
        let words = format!("{what} was planned as ");
        assert!(
            of_the_plan[0].message.contains(&words),
            "{what}: {}",
            of_the_plan[0]
        );
        assert_eq!(
            (of_the_plan[0].file.as_str(), of_the_plan[0].view.as_deref()),
            ("calibration.json", Some("left"))
        );
        assert_only_the_clear_one(&findings);
        let [expected, found] = [&before, &after].map(|entry| match what {
            "heading_true_deg" => entry.placed.pose.heading_true_deg.to_string(),
            "roll_deg" => entry.placed.pose.roll_deg.to_string(),
            "hfov_deg" => entry.placed.hfov_deg.to_string(),
            "refraction_coefficient" => entry.refraction_coefficient.to_string(),
            _ => String::new(),
        });
        let words =
            format!("{what} was planned as {expected} (plan.json), but recorded as {found}");
        assert!(
            expected.is_empty() || of_the_plan[0].message.contains(&words),
            "{what}: {}",
            of_the_plan[0]
        );
    }
}
