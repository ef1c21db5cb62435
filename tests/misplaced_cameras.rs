//! Cameras that look elsewhere in each scenario, from recorded images to errors.

use std::fs;

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

#[test]
fn flights_before_cameras_that_look_elsewhere_are_estimated_as_well() {
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
    fs::write(folder.join("train.toml"), TRAINING).unwrap();
    let run = |arguments: &str| {
        let arguments: Vec<&str> = arguments.split(' ').collect();
        DTD.command(&arguments).current_dir(folder).succeeds();
    };
    run("generate sweep.toml --out corpus");
    run("label corpus");
    run("detect corpus");
    run("train corpus --out run --config train.toml");
    run("evaluate run --corpus corpus");
    let metrics = fs::read(folder.join("run/metrics.json")).unwrap();
    let metrics: Value = serde_json::from_slice(&metrics).unwrap();
    let mape_pct = &metrics["estimators"]["inverse_range"]["mape_pct"];
    println!(
        "MAPE of inverse_range: {mape_pct} %; {}",
        metrics["alignment"]
    );
    assert_eq!(metrics["alignment"]["unaligned"], serde_json::json!([]));
    assert!(mape_pct.as_f64().unwrap() < 0.3, "{mape_pct} %");
}
