use super::*;

/// A registration of the right view at tick 0.
fn registration() -> Registration {
    Registration {
        tick: 0,
        view: "right".into(),
        reference: "left".into(),
        result: Err(NoShift::Faint),
    }
}

/// An example with registrations and no detections, whose record says this about registrations.
fn registered(rows: &[Registration], said: &Value) -> Example {
    let nothing_found = Detections::default();
    let tables = NewTables {
        registrations: Some(rows),
        ..NewTables::unregistered(&nothing_found)
    };
    with_tables(tables, &json!({ "registration": said }))
}

#[test]
fn damaged_missing_and_foreign_registrations_are_found() {
    let said = json!({"method": 1, "reference": "left", "pairs": 1, "answered": 0, "seconds": 0.5});
    let table = "registrations/aaaa.parquet";
    let change = |spoil: &dyn Fn(&Path)| {
        let example = registered(&[registration()], &said);
        spoil(&example.path(table));
        example.findings()
    };
    assert_eq!(change(&|_| {}), "");
    let cut = |path: &Path| {
        let bytes = fs::read(path).unwrap();
        fs::write(path, &bytes[..bytes.len() - 9]).unwrap();
    };
    let others = |path: &Path| {
        let row = Registration {
            result: Err(NoShift::Lost),
            ..registration()
        };
        Registration::write(&[row], path).unwrap();
    };
    let unowned = |path: &Path| {
        fs::copy(path, path.with_file_name("bbbb.parquet")).unwrap();
    };
    type Spoil<'a> = &'a dyn Fn(&Path);
    let cases: [(Spoil<'_>, &str); 4] = [
        (&cut, "its hash differs"),
        (&others, "its hash differs"),
        (
            &|path| fs::remove_file(path).unwrap(),
            "is missing, though there is a record of it",
        ),
        (&unowned, "bbbb.parquet: belongs to no detections"),
    ];
    for (spoil, words) in cases {
        let findings = change(spoil);
        assert!(
            findings.contains(words) && findings.contains("registrations/"),
            "{findings}"
        );
    }
    let findings = change(&cut);
    assert!(
        findings.contains(table) && !findings.contains("registration.pairs"),
        "{findings}"
    );
    let example = registered(&[registration()], &said);
    let path = detections::record_path(&example.scenario(), "aaaa");
    let mut record: Value = read_json(&path, "record").unwrap();
    let fields = record.as_object_mut().unwrap();
    fields.remove("registrations_blake3");
    write_json(&path, &record).unwrap();
    let findings = example.findings();
    assert!(
        findings.contains("is not named by the record of the detections"),
        "{findings}"
    );
}

#[test]
fn damaged_and_foreign_health_and_two_states_of_a_picture_are_found() {
    let row = |tick: u32, view: &str| ViewHealth {
        tick,
        view: view.into(),
        state: HealthState::Steady,
        motion: None,
        state_live: HealthState::Steady,
    };
    let watched = |rows: &[ViewHealth]| {
        let nothing_found = Detections::default();
        let tables = NewTables {
            health: Some(rows),
            ..NewTables::unregistered(&nothing_found)
        };
        with_tables(tables, &json!({}))
    };
    assert_eq!(watched(&[row(0, "left"), row(0, "right")]).findings(), "");
    for (rows, words) in [
        (
            [row(0, "left"), row(0, "left")],
            "tick 0 of the view is there already",
        ),
        (
            [row(0, "left"), row(9_999, "left")],
            "is 9999, expected below",
        ),
        ([row(0, "left"), row(0, "above")], "above is not a view"),
    ] {
        let findings = watched(&rows).findings();
        assert!(
            findings.contains(words) && findings.contains("health/"),
            "{findings}"
        );
    }
    let example = watched(&[row(0, "left")]);
    let path = example.path("health/aaaa.parquet");
    ViewHealth::write(&[row(0, "right")], &path).unwrap();
    assert!(example.findings().contains("its hash differs"));
}

#[test]
fn damaged_and_foreign_backgrounds_and_two_of_a_view_are_found() {
    let row = |tick: u32, view: &str| ViewBackground {
        tick,
        view: view.into(),
        images: 24,
        top_px: 0,
        usual: CameraTurn {
            shift_x_px: 0.0,
            shift_y_px: 0.0,
            roll_deg: 0.0,
            shift_sd_px: 0.0,
        },
        png: Vec::new(),
    };
    let kept = |rows: &[ViewBackground]| {
        let nothing_found = Detections::default();
        let tables = NewTables {
            backgrounds: Some(rows),
            ..NewTables::unregistered(&nothing_found)
        };
        with_tables(tables, &json!({}))
    };
    for (rows, words) in [
        ([row(0, "left"), row(0, "right")], ""),
        (
            [row(0, "left"), row(1, "left")],
            "the view has a background already",
        ),
        (
            [row(0, "left"), row(9_999, "right")],
            "is 9999, expected below",
        ),
        ([row(0, "left"), row(0, "above")], "above is not a view"),
    ] {
        let findings = kept(&rows).findings();
        assert!(findings.contains(words), "{findings}");
        assert_eq!(
            findings.contains("backgrounds/"),
            !words.is_empty(),
            "{findings}"
        );
    }
    let example = kept(&[row(0, "left")]);
    let path = example.path("backgrounds/aaaa.parquet");
    ViewBackground::write(&[row(0, "right")], &path).unwrap();
    assert!(example.findings().contains("its hash differs"));
    fs::rename(&path, path.with_file_name("bbbb.parquet")).unwrap();
    assert!(
        example
            .findings()
            .contains("bbbb.parquet: belongs to no detections")
    );
}

#[test]
fn registrations_of_no_picture_of_the_scenario_or_with_other_counts_are_found() {
    let row = registration;
    let no_tick = Registration { tick: 99, ..row() };
    let no_view = Registration {
        view: "lift".into(),
        ..row()
    };
    let itself = Registration {
        reference: "right".into(),
        ..row()
    };
    for (rows, said, words) in [
        (vec![no_tick], json!({}), "tick: is 99"),
        (vec![no_view], json!({}), "view: lift is not a view"),
        (vec![itself], json!({}), "right is the view itself"),
        (
            vec![row(), row()],
            json!({}),
            "tick 0 of the view is there already",
        ),
        (
            vec![row()],
            json!({"pairs": 7}),
            "registration.pairs is 7, expected 1",
        ),
        (
            vec![row()],
            json!({"answered": 1}),
            "registration.answered is 1, expected 0",
        ),
        (
            vec![row()],
            json!({"reference": "right"}),
            "registration.reference is \"right\"",
        ),
        (
            vec![row()],
            json!({"seconds": -1.0}),
            "registration.seconds is -1e0",
        ),
    ] {
        let findings = registered(&rows, &said).findings();
        assert!(findings.contains(words), "{findings}");
    }
}
