//! A corpus of the preset `tower-camera`: the same bytes on any number of threads and wherever a run was interrupted. `dtd verify` looks
//! where air and mast have moved the aircraft.

use std::fs;
use std::path::Path;

use serde_json::Value;
use testkit::command::{Dtd, Ending, text};
use testkit::sweep::{SmallSweep, starting_from};

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));
const IDS: [&str; 2] = ["1200-clear-r1", "1200-hazy-r1"];

/// Approaches from 2.5 NM. The masts sway more than the preset's: by more than the error of an outline in every image.
fn sweep_toml() -> String {
    let tables = r#"
[imaging]
preset = "tower-camera"

[imaging.sway]
rms_px = { min = 3, max = 4 }

[weather.clear]
visibility_m = 80000

[weather.hazy]
visibility_m = 15000
"#;
    SmallSweep {
        name: "tower",
        seed: 5,
        weathers: &["clear", "hazy"],
        repeats: 1,
        size_px: (640, 384),
        frame_rate: "1/2",
        tables: &(starting_from(2.5, 2.5, 240) + tables),
    }
    .toml()
}

fn generate(sweep: &Path, corpus: &Path, more: &[&str], threads: &str) {
    let arguments = [&["generate", text(sweep), "--out", text(corpus)], more].concat();
    let mut command = DTD.command(&arguments);
    command.env("RAYON_NUM_THREADS", threads).succeeds();
}

/// Largest of the views' median distances of the aircraft from its place, and the report.
fn verified(corpus: &Path) -> (f64, Value) {
    let output = DTD.run(&["verify", "--json", text(corpus)]);
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let views = report["views"].as_array().unwrap();
    let offsets = views.iter().filter_map(|view| view["offset_px"].as_f64());
    (offsets.fold(0.0, f64::max), report)
}

#[test]
fn a_corpus_is_the_same_bytes_however_it_was_recorded_and_its_boxes_are_found_where_the_images_moved()
 {
    let folder = tempfile::tempdir().unwrap();
    let sweep = folder.path().join("tower.toml");
    fs::write(&sweep, sweep_toml()).unwrap();
    let [whole, resumed] = ["whole", "resumed"].map(|name| folder.path().join(name));
    generate(&sweep, &whole, &[], "1");
    generate(&sweep, &resumed, &["--only", IDS[1]], "3");
    generate(&sweep, &resumed, &[], "3");
    let same = |name: &str| {
        let [one, other] = [&whole, &resumed].map(|corpus| fs::read(corpus.join(name)).unwrap());
        assert!(one == other, "{name} differs");
    };
    same("plan.json");
    for id in IDS {
        for file in ["views/left.mp4", "views/right.mp4", "calibration.json"] {
            same(&format!("scenarios/{id}/{file}"));
        }
    }

    DTD.succeeds(&["label", text(&whole)]);
    let (offset_px, report) = verified(&whole);
    assert_eq!(report["findings"], Value::Array(vec![]), "{report:#}");
    // The centre of brightness is 2 to 3 px from the centre of its box, and 4.5 px from a box that does not follow the sway.
    assert!(
        (0.0..3.6).contains(&offset_px),
        "aircraft are {offset_px} px from their places"
    );
}
