use super::*;

#[test]
fn a_folder_whose_name_is_no_text_is_found() {
    use std::os::unix::ffi::OsStrExt;

    let example = Example::new();
    let name = std::ffi::OsStr::from_bytes(b"0003\xff");
    let path = example.corpus.root().join("scenarios").join(name);
    fs::create_dir(&path).unwrap();
    fs::copy(
        example.scenario().root().join(seal::DONE),
        path.join(seal::DONE),
    )
    .unwrap();
    let findings = example.findings();
    assert!(findings.contains("not UTF-8"), "{findings}");
}

#[test]
fn a_folder_without_a_seal_is_found() {
    let example = Example::new();
    fs::remove_file(example.path("DONE.json")).unwrap();
    assert_found(&example.findings(), "is not complete");
}

#[test]
fn what_is_no_scenario_is_called_so() {
    let example = Example::new();
    let scenarios = example.corpus.root().join("scenarios");
    fs::write(scenarios.join(".DS_Store"), "").unwrap();
    fs::create_dir(scenarios.join("backup")).unwrap();
    let findings = example.findings();
    for name in [".DS_Store", "backup"] {
        let words = format!("scenarios/{name}: not a scenario");
        assert!(findings.contains(&words), "{findings}");
    }
    assert!(!findings.contains(seal::DONE), "{findings}");
}
