//! What `dtd demo --fresh` rejects, as seen from a shell: everything is still there afterwards.

use std::fs;
use std::path::Path;
use std::process::Output;

use tempfile::tempdir;

use super::DTD;

fn demo(folder: &Path, more: &[&str]) -> Output {
    DTD.command(&["demo", "--fresh", "--out"])
        .arg(folder)
        .args(more)
        .output()
        .unwrap()
}

fn assert_refused(output: &Output, words: &[&str]) {
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{message}");
    for word in words {
        assert!(message.contains(word), "no {word:?} in {message}");
    }
}

#[test]
fn a_folder_that_no_demo_marked_is_left_alone_with_all_that_is_in_it() {
    let folder = tempdir().unwrap();
    for (name, text) in [("thesis.tex", "years of work"), ("corpus/plan.json", "{}")] {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }
    let output = demo(folder.path(), &[]);
    assert_refused(&output, &["thesis.tex", "corpus", "nothing was removed"]);
    assert!(folder.path().join("thesis.tex").exists());
    assert!(folder.path().join("corpus/plan.json").exists());
    assert!(
        !folder.path().join("DEMO.json").exists(),
        "nor is it marked now"
    );
}

#[test]
fn what_stands_beside_a_demo_or_in_it_is_named_and_nothing_is_removed() {
    let folder = tempdir().unwrap();
    let marker = r#"{"made_by": "dtd demo", "owns": ["corpus", "run"]}"#;
    let own = [
        "corpus/plan.json",
        "corpus/scenarios/1200-clear-r1/frames.parquet",
        "run/run.json",
    ];
    let others = [
        "corpus/scenarios/1200-clear-r1/notes.new",
        "run/figures/best.svg",
        "README",
    ];
    for name in own.iter().chain(&others) {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        let plan = r#"{"scenarios": [{"id": "1200-clear-r1", "config_hash": "00"}]}"#;
        fs::write(path, plan).unwrap();
    }
    fs::write(folder.path().join("DEMO.json"), marker).unwrap();
    let output = demo(folder.path(), &[]);
    assert_refused(
        &output,
        &["scenarios/1200-clear-r1/notes.new", "run/figures", "README"],
    );
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(!message.contains("frames.parquet"), "{message}");
    for name in own.iter().chain(&others) {
        assert!(folder.path().join(name).exists(), "{name}");
    }
}

#[test]
fn a_sweep_and_a_model_that_are_none_are_refused_before_anything_is_removed() {
    let folder = tempdir().unwrap();
    let marker = r#"{"made_by": "dtd demo", "owns": ["corpus", "run"]}"#;
    fs::write(folder.path().join("DEMO.json"), marker).unwrap();
    fs::create_dir(folder.path().join("run")).unwrap();
    fs::write(folder.path().join("run/run.json"), "{}").unwrap();
    let none = folder.path().join("none.toml");
    let none = none.to_str().unwrap();
    for (argument, words) in [("--sweep", "none.toml"), ("--model", "--model expects")] {
        let output = demo(folder.path(), &[argument, none]);
        assert_refused(&output, &[words]);
        assert!(folder.path().join("run/run.json").exists());
    }
    fs::write(folder.path().join("file"), "").unwrap();
    let output = demo(&folder.path().join("file"), &[]);
    assert_refused(&output, &["is a file; expected a folder"]);
}
