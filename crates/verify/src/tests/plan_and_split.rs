use super::*;

#[test]
fn a_leaking_split_is_found_by_what_was_flown_and_by_what_is_listed() {
    let example = Example::new();
    let mut shared = record(IDS[1]);
    shared.trajectory = format!("live-{}", IDS[0]);
    let scenario = example.corpus.scenario(IDS[1]);
    shared.write(&scenario.record_path()).unwrap();
    seal::seal_folder(scenario.root(), "config").unwrap();
    assert!(
        example
            .findings()
            .contains(": leak: trajectory live-0600-clear-r1"),
        "{}",
        example.findings()
    );

    let mut listed = splits([Side::Train, Side::Test]);
    for assignment in listed.scenarios.values_mut() {
        assignment.trajectory = shared.trajectory.clone();
    }
    write_json(&example.corpus.splits_path(), &listed).unwrap();
    let findings = example.findings();
    let words = "is on two sides: 0600-clear-r1 is on the training side";
    assert!(findings.contains(words), "{findings}");
}

#[test]
fn a_planned_scenario_that_is_missing_is_a_fault_only_if_the_corpus_should_be_complete() {
    let example = Example::new();
    fs::remove_dir_all(example.scenario().root()).unwrap();
    let quick = VerifyOptions {
        decode: false,
        complete: false,
    };
    let report = verify_with(&example.corpus, quick, &Silent).unwrap();
    assert_eq!(report.findings, Vec::new());
    assert_eq!(
        (report.missing, report.pictures),
        (vec![IDS[0].to_owned()], 0)
    );
    let complete = VerifyOptions {
        complete: true,
        ..quick
    };
    let report = verify_with(&example.corpus, complete, &Silent).unwrap();
    assert_eq!(report.findings.len(), 1);
    assert_eq!(
        report.findings[0].to_string(),
        format!(
            "plan.json scenario {}: planned, but not in the corpus",
            IDS[0]
        )
    );
}

#[test]
fn a_corpus_without_a_plan_has_no_fault_and_what_needs_the_plan_is_named() {
    let example = Example::new();
    let not_checked = |options| {
        let report = verify_with(&example.corpus, options, &Silent).unwrap();
        (report.not_checked, report.findings)
    };
    let quick = VerifyOptions {
        decode: false,
        complete: false,
    };
    fs::remove_file(example.corpus.plan_path()).unwrap();
    let (named, findings) = not_checked(quick);
    assert_eq!(findings, []);
    assert!(
        named.len() == 1 && named[0].contains("no plan.json"),
        "{named:?}"
    );
    fs::remove_file(example.corpus.splits_path()).unwrap();
    let (named, findings) = not_checked(quick);
    assert_eq!(findings, []);
    assert!(
        named.len() == 2 && named[1].contains("no splits.json"),
        "{named:?}"
    );
    // Whether a corpus is complete depends on its plan, and a corpus with a sweep was generated together with a plan.
    let complete = VerifyOptions {
        complete: true,
        ..quick
    };
    assert_eq!(not_checked(complete).1.len(), 1);
    fs::write(example.corpus.sweep_path(), "").unwrap();
    let (named, findings) = not_checked(quick);
    assert_eq!((named, findings.len()), (vec![], 2));
}

/// An example with these replacements in the text of its plan.
fn with_plan(changes: &[(&str, &str)]) -> Example {
    let example = Example::new();
    let mut plan = fs::read_to_string(example.corpus.plan_path()).unwrap();
    for (text, other) in changes {
        assert!(plan.contains(text), "{text}");
        plan = plan.replace(text, other);
    }
    fs::write(example.corpus.plan_path(), plan).unwrap();
    example
}

#[test]
fn a_changed_plan_does_not_have_its_hash_any_more() {
    let change = ("\"config_hash\": \"config\"", "\"config_hash\": \"other\"");
    let findings = with_plan(&[change]).findings();
    for words in [
        "plan.json: plan_hash is",
        "config_hash was planned as \"other\"",
    ] {
        assert!(findings.contains(words), "{findings}");
    }
}

#[test]
fn a_plan_that_other_verbs_refuse_is_a_fault() {
    for (change, words) in [
        (
            ("\"sweep_blake3\"", "\"sweep\""),
            "missing field `sweep_blake3`",
        ),
        (
            ("\"pitch_deg\": 1.6", "\"pitch_deg\": \"up\""),
            "invalid type: string \"up\", expected f64 at line",
        ),
    ] {
        let example = with_plan(&[change]);
        let words = format!("plan.json: is not a valid plan: {words}");
        assert!(
            example.findings().contains(&words),
            "{}",
            example.findings()
        );
        assert!(Plan::of_corpus(&example.corpus).is_err());
    }
}

#[test]
fn each_value_that_is_not_as_planned_is_named_with_both_values() {
    let example = with_plan(&[
        ("\"rig\": \"pair\"", "\"rig\": \"mast\""),
        ("\"seed\": 1,", "\"seed\": 2, \"of_a_later_version\": {},"),
    ]);
    let findings = example.findings();
    for words in [
        "{id}/scenario.json: rig was planned as \"mast\" (plan.json), but recorded as \"pair\"",
        "{id}/scenario.json: seed was planned as 2 (plan.json), but recorded as 1",
    ] {
        for id in IDS {
            assert!(findings.contains(&words.replace("{id}", id)), "{findings}");
        }
    }
    assert_eq!(findings.lines().count(), 4, "{findings}");
}
