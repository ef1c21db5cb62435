//! Cameras that look elsewhere in each scenario, from recorded images to errors: with and without the alignment of backgrounds.

use std::fs;
use std::path::Path;

use serde_json::Value;
use testkit::command::{Dtd, Ending};
use testkit::sweep::{FROM_2_NM, SmallSweep};

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));

/// 0.1 degrees are five pixels here.
const TABLES: &str = r#"
[split]
train = 0.6
validation = 0.2
test = 0.2

[jitter]
heading_deg = { mean = 0, sd = 0.1 }

[weather.clear]
visibility_m = 80000
"#;

/// Only formulas count: networks after a few steps.
const TRAINING: &str = r#"
calibration = { hidden = [8], features = 8, head_hidden = [8], min_steps = 5, optimisation = { steps = 10, batch_size = 16, learning_rate = 2e-3 } }
estimator = { lstm = [8], head_hidden = [8], optimisation = { steps = 10, batch_size = 16, learning_rate = 1e-3 } }
mono = { hidden = [8], optimisation = { steps = 10, batch_size = 16, learning_rate = 3e-3 } }
"#;

fn run(folder: &Path, arguments: &[&str]) {
    DTD.command(arguments).current_dir(folder).succeeds();
}

#[test]
fn flights_before_cameras_that_look_elsewhere_are_estimated_as_well_once_their_backgrounds_are_aligned()
 {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let sweep = SmallSweep {
        name: "misplaced",
        seed: 11,
        weathers: &["clear"],
        repeats: 7,
        size_px: (480, 320),
        frame_rate: "1/3",
        tables: &format!("{FROM_2_NM}{TABLES}"),
    };
    fs::write(folder.join("sweep.toml"), sweep.toml()).unwrap();
    fs::write(folder.join("as-they-are.toml"), TRAINING).unwrap();
    let aligned = format!("align_backgrounds = true\n{TRAINING}");
    fs::write(folder.join("aligned.toml"), aligned).unwrap();
    run(folder, &["generate", "sweep.toml", "--out", "corpus"]);
    run(folder, &["label", "corpus"]);
    run(folder, &["detect", "corpus"]);
    let metrics = |name: &str| -> Value {
        let settings = format!("{name}.toml");
        run(
            folder,
            &["train", "corpus", "--out", name, "--config", &settings],
        );
        run(folder, &["evaluate", name, "--corpus", "corpus"]);
        let metrics = fs::read(folder.join(name).join("metrics.json")).unwrap();
        serde_json::from_slice(&metrics).unwrap()
    };
    let error_pct = |metrics: &Value| {
        let estimator = &metrics["estimators"]["inverse_range"];
        estimator["mape_pct"].as_f64().unwrap()
    };
    let before = metrics("as-they-are");
    let after = metrics("aligned");
    assert_eq!(before["alignment"], Value::Null);
    assert_eq!(after["alignment"]["unaligned"], serde_json::json!([]));
    let (before, after) = (error_pct(&before), error_pct(&after));
    println!("MAPE of inverse_range: {before} % as they are, {after} % aligned");
    assert!(
        after < before / 5.0,
        "{before} % as they are, {after} % aligned"
    );
}
