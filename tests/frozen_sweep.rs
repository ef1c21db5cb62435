//! `corpus.toml` is checked by the hash in `plan.json`, wherever a corpus is read, moved or added to.

mod tiny;

use std::fs;
use std::path::Path;

use tiny::{Tiny, said};

/// Changes that no other check of the corpus notices: a flipped bit in a comment, another visibility, an empty file, none.
fn damage(path: &Path, how: usize) {
    let text = fs::read_to_string(path).unwrap();
    match how {
        0 => fs::write(path, text.replace("80000", "70000")).unwrap(),
        1 => fs::write(path, format!("{text}#")).unwrap(),
        2 => fs::write(path, "").unwrap(),
        _ => fs::remove_file(path).unwrap(),
    }
}

#[test]
fn a_changed_sweep_is_found_by_verify_and_mended_by_generate_push_and_fetch() {
    for how in 0..4 {
        let tiny = Tiny::made().copy();
        let code = |arguments: &[&str]| {
            let output = tiny.dtd(arguments).output().unwrap();
            (output.status.code(), said(&output))
        };
        let ends_with = |expected: i32, arguments: &[&str]| {
            let (found, words) = code(arguments);
            assert_eq!(
                found,
                Some(expected),
                "damage {how}: {arguments:?}: {words}"
            );
            words
        };
        let verify = ["verify", "corpus", "--no-decode"];
        let sweep = tiny.path("corpus/corpus.toml");
        let read = |path: &Path| fs::read_to_string(path).unwrap();
        let intact = read(&sweep);
        let url = tiny.store();
        ends_with(0, &verify);
        ends_with(0, &["push", "corpus", &url]);

        damage(&sweep, how);
        assert!(ends_with(1, &verify).contains("corpus.toml: "));
        if how < 3 {
            assert!(ends_with(2, &["push", "corpus", &url]).contains("corpus.toml"));
        }
        ends_with(0, &["fetch", &url, "--out", "corpus"]);
        assert_eq!(read(&sweep), intact, "damage {how} stays after fetch");

        damage(&sweep, how);
        ends_with(0, &["generate", "sweep.toml", "--out", "corpus"]);
        assert_eq!(read(&sweep), intact, "damage {how} stays after generate");
        ends_with(0, &verify);

        let in_store = tiny.path("store/corpus.toml");
        damage(&in_store, how);
        ends_with(1, &["verify", &url, "--no-decode"]);
        if how < 3 {
            ends_with(1, &["fetch", &url, "--out", "fetched"]);
        }
        ends_with(0, &["push", "corpus", &url]);
        assert_eq!(read(&in_store), intact, "damage {how} stays in the store");
        ends_with(0, &["fetch", &url, "--out", "fetched"]);
    }
}

/// The plan without the hash of the sweep, as earlier versions wrote it.
fn of_earlier_version(plan: &str) -> String {
    let kept = plan.lines().filter(|line| !line.contains("sweep_blake3"));
    kept.map(|line| format!("{line}\n")).collect()
}

#[test]
fn an_edited_sweep_of_an_earlier_version_is_found_by_its_expansion_and_mended() {
    let tiny = Tiny::made().copy();
    let run = |arguments: &[&str]| {
        let output = tiny.dtd(arguments).output().unwrap();
        (output.status.code(), said(&output))
    };
    let verify = ["verify", "corpus", "--no-decode"];
    let url = tiny.store();
    let fetch = ["fetch", url.as_str(), "--out", "corpus"];
    let (plan, sweep) = (
        tiny.path("corpus/plan.json"),
        tiny.path("corpus/corpus.toml"),
    );
    let with_hash = fs::read_to_string(&plan).unwrap();
    fs::write(&plan, of_earlier_version(&with_hash)).unwrap();
    assert_eq!(run(&["push", "corpus", &url]).0, Some(0));
    let intact = fs::read_to_string(&sweep).unwrap();
    for (from, to, words) in [
        ("80000", "70000", "visibility was 80000 m, now 70000 m"),
        ("repeats = 5", "repeats = 6", "is not in plan.json"),
        ("80000", "-1", "corpus.toml"),
    ] {
        let edited = intact.replace(from, to);
        assert_ne!(edited, intact);
        fs::write(&sweep, &edited).unwrap();
        for (arguments, code) in [(&verify[..], 1), (&["push", "corpus", &url], 2)] {
            let (found, said) = run(arguments);
            assert_eq!(found, Some(code), "{to}: {arguments:?}: {said}");
            assert!(said.contains(words), "{to}: {said}");
        }
        let (code, said) = run(&fetch);
        assert_eq!(code, Some(0), "{to}: {said}");
        assert_eq!(fs::read_to_string(&sweep).unwrap(), intact);
        // A comment changes no plan.
        fs::write(&sweep, format!("{intact}# noted\n")).unwrap();
        assert_eq!(run(&verify).0, Some(0));
    }
    fs::write(&sweep, intact.replace("80000", "70000")).unwrap();
    assert_eq!(
        run(&["generate", "sweep.toml", "--out", "corpus"]).0,
        Some(0)
    );
    assert_eq!(fs::read_to_string(&sweep).unwrap(), intact);
    assert_eq!(fs::read_to_string(&plan).unwrap(), with_hash);
    assert_eq!(run(&verify).0, Some(0));
}

#[test]
fn a_corpus_of_an_earlier_version_is_valid_and_gets_the_hash_when_it_is_generated_again() {
    let tiny = Tiny::made().copy();
    let plan = tiny.path("corpus/plan.json");
    let with_hash = fs::read_to_string(&plan).unwrap();
    let without = of_earlier_version(&with_hash);
    assert_ne!(without, with_hash);
    fs::write(&plan, &without).unwrap();
    for arguments in [
        &["verify", "corpus", "--no-decode"][..],
        &["generate", "sweep.toml", "--out", "corpus"],
        &["verify", "corpus", "--no-decode"],
    ] {
        let output = tiny.dtd(arguments).output().unwrap();
        assert!(output.status.success(), "{arguments:?}: {}", said(&output));
    }
    assert_eq!(fs::read_to_string(&plan).unwrap(), with_hash);
}
