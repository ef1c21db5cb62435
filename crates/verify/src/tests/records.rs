use super::*;

/// A reported visibility, with or without its mark.
fn reported(visibility_m: f64, is_marked: bool) -> Option<EffectiveWeather> {
    let mark = is_marked.then_some(EffectiveQuantity::Visibility);
    Some(EffectiveWeather {
        visibility_m: Some(visibility_m),
        differing: mark.into_iter().collect(),
        ..EffectiveWeather::default()
    })
}

#[test]
fn a_marked_scenario_is_named_and_is_no_fault() {
    let example = Example::new();
    let mut record = record(IDS[0]);
    record.effective_weather = reported(20_000.0, true);
    record.schema_version = record.required_version(PINHOLE_SCHEMA_VERSION);
    record.write(&example.scenario().record_path()).unwrap();
    seal::seal_folder(example.scenario().root(), "config").unwrap();
    let report = verify(&example.corpus);
    assert!(report.is_sound(), "{:?}", report.findings);
    let marked: Vec<_> = report.marked().collect();
    let expected = ["visibility is 20000 m, planned was 40000 m".to_owned()];
    assert_eq!(marked, [(IDS[0], &expected[..])]);
    let said = report.weather["clear"].to_string();
    assert_eq!(
        said,
        "visibility 20000 m, 1 of 2 without a report, 1 of 2 marked"
    );
}

#[test]
fn a_record_that_contradicts_itself_or_cannot_be_is_found() {
    type Change = fn(&mut ScenarioRecord);
    let changes: [(Change, &str); 9] = [
        (
            |record| record.touchdown.latitude_deg += 1e-5,
            "touchdown is 1.1",
        ),
        (|record| record.schema_version = 99, "has schema version 99"),
        (|record| record.schema_version = 0, "schema version is 0"),
        (
            |record| record.conditions.as_mut().unwrap().weather.rain_ratio = 2.0,
            "conditions.weather.rain_ratio 2 is out of range; expected a rain intensity from 0 to 1",
        ),
        (
            |record| record.conditions.as_mut().unwrap().weather.rain_ratio = 2.0,
            "0600-clear-r1/scenario.json: conditions was planned",
        ),
        (
            |record| record.effective_weather = reported(20_000.0, false),
            "visibility is 20000 m, planned was 40000 m, and it is not among `differing`",
        ),
        (
            |record| record.effective_weather = reported(39_000.0, true),
            "visibility is among `differing`, and is as planned",
        ),
        (
            |record| record.effective_weather = reported(20_000.0, true),
            "schema version is 1, but the weather at the aircraft differs",
        ),
        (
            |record| record.effective_weather = reported(-5.0, true),
            "effective_weather.visibility_m -5 is out of range",
        ),
    ];
    for (change, words) in changes {
        assert_found(&Example::with_record(change), words);
    }
}

#[test]
fn a_moved_camera_is_found() {
    let findings = Example::with(|example| {
        let path = example.path("calibration.json");
        let mut calibration = Calibration::read(&path).unwrap();
        calibration
            .cameras
            .get_mut("left")
            .unwrap()
            .ecef_from_camera
            .translation_m[0] += 0.01;
        calibration.write(&path).unwrap();
    });
    assert_found(
        &findings,
        "calibration.json: camera left: translation_m does not follow",
    );
}
