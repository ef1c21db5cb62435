use super::*;

#[test]
fn a_sound_corpus_has_no_findings_and_everything_was_looked_at() {
    let report = verify(&Example::new().corpus);
    assert_eq!(report.findings, Vec::new());
    assert!(report.is_sound());
    assert_eq!(
        (
            report.scenarios,
            report.ticks,
            report.pictures,
            report.labelled
        ),
        (2, 10, 20, 2)
    );
}

#[test]
fn a_flipped_byte_is_found_in_every_file() {
    let example = Example::new();
    for file in [
        "scenario.json",
        "calibration.json",
        "frames.parquet",
        "boxes_truth.parquet",
        "views/left.mp4",
        "views/right.mp4",
    ] {
        let whole = fs::read(example.path(file)).unwrap();
        let mut flipped = whole.clone();
        flipped[whole.len() / 2] ^= 1;
        fs::write(example.path(file), flipped).unwrap();
        assert_found(
            &example.findings(),
            &format!("{file} does not match its seal"),
        );
        fs::write(example.path(file), whole).unwrap();
    }
}

#[test]
fn a_missing_column_and_missing_boxes_are_found() {
    let findings = Example::with(|example| {
        dataset::tables::columns::TableWriter::new()
            .u32("tick", [0])
            .write(&example.scenario().frames_path())
            .unwrap();
    });
    assert_found(&findings, "has no column latitude_deg");
    let findings =
        Example::with(|example| fs::remove_file(example.path("boxes_truth.parquet")).unwrap());
    assert_found(&findings, "has distances, but no ground-truth boxes");
}

#[test]
fn a_fault_names_its_file_once() {
    let example = Example::new();
    fs::write(example.path("scenario.json"), "{").unwrap();
    fs::write(example.path("frames.parquet"), "PAR1").unwrap();
    fs::remove_file(example.path("calibration.json")).unwrap();
    fs::write(example.corpus.plan_path(), "{").unwrap();
    let findings = example.findings();
    let root = example.corpus.root().display().to_string();
    assert!(!findings.contains(&root), "{findings}");
    let words = "plan.json: is not a valid plan";
    assert!(findings.contains(words), "{findings}");
}
