//! `corpus.toml` is checked by the hash in `plan.json`, wherever a corpus is read, moved or added to.

mod tiny;

use std::fs;
use std::path::Path;

use testkit::command::said;
use tiny::Tiny;

/// Changes that no other check of the corpus notices: a flipped bit in a comment, a different visibility, an empty file, none.
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
