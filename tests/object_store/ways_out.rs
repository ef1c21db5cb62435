//! From every state of a store a verb names the way out, and the way leads out.

use serde_json::Value;

use super::*;

/// A store in a folder with the corpus in it.
struct Store {
    folder: TempDir,
    url: String,
}

impl Store {
    fn empty() -> Self {
        let folder = tempdir().unwrap();
        let url = format!("file://{}", text(folder.path()));
        Self { folder, url }
    }

    fn full() -> Self {
        let store = Self::empty();
        store.push(&IN_A_FOLDER, 0);
        store
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Runs a verb that must end with this exit code; returns what it says.
    fn run(&self, arguments: &[&str], code: i32) -> String {
        let mut command = dtd(SERVER.address);
        command.args(arguments).ends_with(code, &[])
    }

    fn push(&self, corpus: &Path, code: i32) -> String {
        self.run(&["push", text(corpus), &self.url], code)
    }

    fn fetch(&self, corpus: &Path, code: i32) -> String {
        self.run(&["fetch", &self.url, "--out", text(corpus)], code)
    }

    fn generate(&self, sweep: &Path, stage: &Path, code: i32) -> String {
        let arguments = ["generate", text(sweep), "--out", &self.url, "--staging"];
        self.run(&[&arguments[..], &[text(stage)]].concat(), code)
    }
}

fn small_sweep() -> PathBuf {
    repository().join("tests/data/small.toml")
}

/// The small sweep with another text, in a folder with the recording that it names.
fn sweep_with(from: &str, to: &str) -> (TempDir, PathBuf) {
    let recording = "flights/01_calm_ils.csv";
    let folder = tempdir().unwrap();
    fs::create_dir(folder.path().join("flights")).unwrap();
    let source = repository().join("tests/data").join(recording);
    fs::copy(source, folder.path().join(recording)).unwrap();
    let whole = fs::read_to_string(small_sweep()).unwrap();
    assert!(whole.contains(from));
    let sweep = folder.path().join("sweep.toml");
    fs::write(&sweep, whole.replace(from, to)).unwrap();
    (folder, sweep)
}

#[test]
fn a_place_of_others_is_refused_and_the_name_that_is_given_instead_works() {
    let stage = tempdir().unwrap();
    for (name, content) in [
        ("plan.json", r#"{"planned_values": {}}"#),
        ("splits.json", r#"{"train": [1], "test": [2]}"#),
        ("corpus.toml", "[corpus]\nname = \"letters\"\n"),
        ("thesis.tex", ""),
    ] {
        let store = Store::empty();
        fs::write(store.path(name), content).unwrap();
        let before = contents(store.folder.path());
        let instead = format!("{}/corpus", store.url);
        for words in [
            store.push(&IN_A_FOLDER, 2),
            store.generate(&small_sweep(), stage.path(), 2),
        ] {
            assert!(words.contains(name), "{words}");
            assert!(words.contains(&instead), "{words}");
        }
        assert!(contents(store.folder.path()) == before, "{name}");
        store.run(&["push", text(&IN_A_FOLDER), &instead], 0);
    }
    // In a bucket, alike.
    let url = bucket("of-others");
    SERVER.put("/of-others/a/corpus/plan.json", "{}");
    let output = push(&IN_A_FOLDER, &url);
    assert_eq!(output.status.code(), Some(2), "{}", said(&output));
}

#[test]
fn a_sweep_of_others_in_a_folder_is_never_replaced() {
    let store = Store::full();
    let folder = tempdir().unwrap();
    let sweep = folder.path().join("corpus.toml");
    for theirs in ["[letters]\n", "[corpus]\nname = \"letters\"\nseed = 1\n"] {
        fs::write(&sweep, theirs).unwrap();
        let out = text(folder.path());
        let small = small_sweep();
        for words in [
            store.fetch(folder.path(), 2),
            store.run(&["generate", text(&small), "--out", out], 2),
        ] {
            assert!(words.contains("move it away"), "{words}");
        }
        assert_eq!(fs::read_to_string(&sweep).unwrap(), theirs);
    }
    let elsewhere = tempdir().unwrap();
    fs::rename(&sweep, elsewhere.path().join("corpus.toml")).unwrap();
    store.fetch(folder.path(), 0);
}

#[test]
fn a_damaged_plan_of_a_store_is_written_again_by_generate_or_push() {
    let store = Store::full();
    let stage = tempdir().unwrap();
    let plan = store.path("plan.json");
    let whole = fs::read(&plan).unwrap();
    for damaged in [&[], &whole[..whole.len() / 2]] {
        fs::write(&plan, damaged).unwrap();
        let folder = tempdir().unwrap();
        let words = store.fetch(folder.path(), 1);
        assert!(words.contains("`dtd push`") && words.contains("`dtd generate`"));
        store.generate(&small_sweep(), stage.path(), 0);
        assert!(fs::read(&plan).unwrap() == whole);
    }
    // A smaller sweep would forget scenarios.
    fs::write(&plan, "").unwrap();
    let (_smaller, smaller) = sweep_with("repeats = 3", "repeats = 2");
    let other_stage = tempdir().unwrap();
    let words = store.generate(&smaller, other_stage.path(), 2);
    assert!(words.contains("`dtd push`"), "{words}");
    assert!(
        store
            .push(&IN_A_FOLDER, 0)
            .contains("replaced the store's plan.json")
    );
    assert!(fs::read(&plan).unwrap() == whole);
}

#[test]
fn a_sweep_that_is_not_of_the_stores_plan_is_replaced_along_with_it() {
    let store = Store::full();
    let (_copy, corpus) = copy_of(&IN_A_FOLDER);
    let (_noted, noted) = sweep_with("[corpus]", "# noted\n[corpus]");
    store.run(&["generate", text(&noted), "--out", text(&corpus)], 0);
    // As an upload leaves it that is interrupted after the plan.
    fs::copy(corpus.join("plan.json"), store.path("plan.json")).unwrap();
    let fetched = tempdir().unwrap();
    store.fetch(fetched.path(), 1);
    let words = store.push(&IN_A_FOLDER, 0);
    assert!(words.contains("replaced the store's plan.json"), "{words}");
    store.fetch(fetched.path(), 0);
    // Of two sound copies with the same scenarios, the store's stays.
    store.push(&corpus, 0);
    store.fetch(fetched.path(), 0);
}

#[test]
fn a_damaged_file_beside_a_larger_plan_is_replaced_only_by_its_own() {
    let store = Store::full();
    let (_smaller, smaller) = sweep_with("repeats = 3", "repeats = 2");
    let folder = tempdir().unwrap();
    let only = ["--only", "1200-clear-r1"];
    let arguments = ["generate", text(&smaller), "--out", text(folder.path())];
    store.run(&[&arguments[..], &only].concat(), 0);
    fs::write(store.path("splits.json"), "{").unwrap();
    let words = store.push(folder.path(), 3);
    assert!(words.contains("splits.json was not pushed"), "{words}");
    assert!(words.contains("`dtd push` from the folder"), "{words}");
    store.push(&IN_A_FOLDER, 0);
    let fetched = tempdir().unwrap();
    store.fetch(fetched.path(), 0);
}

#[test]
fn a_damaged_scenario_that_is_not_planned_is_deleted_and_a_planned_one_is_pushed() {
    let store = Store::full();
    let scenarios = store.path("scenarios");
    let planned = scenarios.join("1200-clear-r1");
    // A committed copy under a name that no plan has.
    let stray = scenarios.join("stray");
    fs::create_dir(&stray).unwrap();
    fs::copy(planned.join("DONE.json"), stray.join("DONE.json")).unwrap();
    let video = fs::read_dir(planned.join("views")).unwrap().next().unwrap();
    fs::remove_file(video.unwrap().path()).unwrap();
    let folder = tempdir().unwrap();
    let words = store.fetch(folder.path(), 3);
    let done = format!("{}/scenarios/stray/DONE.json", store.url);
    assert!(words.contains(&format!("delete {done}")), "{words}");
    let of_planned = words
        .lines()
        .find(|line| line.contains("1200-clear-r1 was not fetched"));
    assert!(
        of_planned.is_some_and(|line| line.contains("`dtd push`")),
        "{words}"
    );

    let verify = ["verify", store.url.as_str(), "--no-decode", "--json"];
    let output = dtd(SERVER.address).args(verify).output().unwrap();
    let report: Value = json(&output);
    let findings = report["findings"].as_array().unwrap();
    let files: Vec<&str> = findings
        .iter()
        .filter(|finding| finding["scenario"] == "1200-clear-r1")
        .map(|finding| finding["file"].as_str().unwrap())
        .collect();
    assert!(
        files.iter().all(|file| file.contains("views/")),
        "{files:?}"
    );
    assert!(!files.is_empty());

    fs::remove_file(stray.join("DONE.json")).unwrap();
    assert!(store.push(&IN_A_FOLDER, 0).contains("mended"));
    store.fetch(folder.path(), 0);
    store.run(&verify[..3], 0);
}
