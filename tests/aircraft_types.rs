//! Corpora of several aircraft types: plan, flights, images, labels.

use std::collections::BTreeMap;
use std::fs;

use serde_json::{Value, json};
use testkit::command::{Dtd, text};
use testkit::sweep::{SmallSweep, starting_from};
use testkit_simulator::judged_boxes;

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));

/// Four approaches of two types, of 65 m and 27 m of span.
fn sweep() -> String {
    let sweep = SmallSweep {
        name: "types",
        seed: 5,
        weathers: &["clear"],
        repeats: 4,
        size_px: (960, 640),
        frame_rate: "1/2",
        tables: &format!(
            "{}\n[weather.clear]\nvisibility_m = 80000\n",
            starting_from(2.9, 3.1, 300)
        ),
    };
    let several = "aircraft = { one_of = [\"A359\", \"ATR72-600\"] }";
    let toml = sweep.toml();
    assert!(toml.contains("aircraft = \"B737-800\""));
    toml.replace("aircraft = \"B737-800\"", several)
}

#[test]
fn each_scenario_has_the_type_that_it_draws_in_its_images_and_its_boxes() {
    let folder = DTD.recorded(&sweep());
    let corpus = folder.path().join("corpus");
    let plan: Value = serde_json::from_slice(&fs::read(corpus.join("plan.json")).unwrap()).unwrap();
    assert_eq!(plan["common"]["aircraft"], Value::Null);
    let mut types = BTreeMap::new();
    for scenario in plan["scenarios"].as_array().unwrap() {
        let id = scenario["id"].as_str().unwrap();
        let record = corpus.join("scenarios").join(id).join("scenario.json");
        let record: Value = serde_json::from_slice(&fs::read(record).unwrap()).unwrap();
        let planned = &scenario["parameters"]["aircraft"];
        assert_eq!(&record["aircraft"], planned, "{id}");
        *types.entry(planned.to_string()).or_insert(0) += 1;
    }
    assert_eq!(types.len(), 2, "{types:?}");

    let verdict = judged_boxes(&corpus, &[0.75]);
    for aircraft in ["A350-900", "ATR72-600"] {
        let boxes = verdict[aircraft]["boxes"].as_u64().unwrap();
        assert!(boxes > 40, "{verdict}");
    }

    // The images show what the boxes say.
    let report = DTD.json(&["verify", text(&corpus), "--json"]);
    assert_eq!(report["findings"], json!([]));
}

#[test]
fn types_are_listed_with_their_sources_and_drawn() {
    let listed = DTD.json(&["aircraft", "--json"]);
    let listed = listed.as_array().unwrap();
    assert!(listed.len() >= 8);
    for of in listed {
        assert!(!of["sources"].as_array().unwrap().is_empty(), "{of}");
    }
    let folder = tempfile::tempdir().unwrap();
    let image = folder.path().join("types.png");
    DTD.succeeds(&[
        "aircraft",
        "show",
        "A359",
        "B737-800",
        "--png",
        text(&image),
    ]);
    let drawn = image::open(&image).unwrap().into_rgb8();
    let paint = drawn.pixels().filter(|pixel| pixel.0 != [236, 240, 245]);
    assert!(paint.count() > 20_000);
    DTD.ends_with(
        &[
            "aircraft",
            "show",
            "A358",
            "--png",
            text(&folder.path().join("no.png")),
        ],
        2,
        &["the nearest is A350-900"],
    );
}
