//! The jobs of docs/ci.md: valid for GitHub Actions and GitLab, and their commands replay the tape of the tests. The repository's own
//! workflows are valid as well.

use std::path::Path;
use std::process::{Command, Output};
use std::{env, fs};

use dataset::corpus::Corpus;
use dataset::corpus::seal::seal_folder;
use dataset::tables::frames::Frames;
use testkit::{program_of_venv, repository};

/// Files, and the schemas that `check-jsonschema` has for them.
const EXAMPLES: [(&str, &str); 2] = [
    ("deploy/ci/github.yml", "vendor.github-workflows"),
    ("deploy/ci/gitlab.yml", "vendor.gitlab-ci"),
];

/// The repository's own workflows, and their schema.
const OWN: [(&str, &str); 2] = [
    (".github/workflows/ci.yml", "vendor.github-workflows"),
    (".github/workflows/release.yml", "vendor.github-workflows"),
];

/// The lines of a job that run `dtd`.
fn commands(file: &Path) -> Vec<String> {
    fs::read_to_string(file)
        .unwrap()
        .lines()
        .map(|line| line.trim_start().trim_start_matches("- "))
        .filter(|line| line.starts_with("dtd "))
        .map(str::to_owned)
        .collect()
}

/// A repository with the files that docs/ci.md names.
fn repository_of_a_user() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let data = repository().join("tests/data");
    let sweep = fs::read_to_string(data.join("tape/session.toml")).unwrap();
    assert!(sweep.contains("\"../flights/"));
    fs::write(
        folder.path().join("sweep.toml"),
        sweep.replace("\"../flights/", "\"flights/"),
    )
    .unwrap();
    fs::copy(
        data.join("tape/session.mcap"),
        folder.path().join("session.mcap"),
    )
    .unwrap();
    let flights = folder.path().join("flights");
    fs::create_dir(&flights).unwrap();
    for entry in fs::read_dir(data.join("flights")).unwrap() {
        let entry = entry.unwrap();
        fs::copy(entry.path(), flights.join(entry.file_name())).unwrap();
    }
    folder
}

#[test]
fn the_jobs_are_valid_for_github_and_gitlab() {
    for (file, schema) in EXAMPLES.into_iter().chain(OWN) {
        let output = Command::new(program_of_venv("check-jsonschema"))
            .args(["--builtin-schema", schema])
            .arg(repository().join(file))
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success(), "{file}: {said}");
    }
}

/// Runs a command of a job.
fn run(command: &str, folder: &Path) -> Output {
    let program = Path::new(env!("CARGO_BIN_EXE_dtd")).parent().unwrap();
    let path = format!("{}:{}", program.display(), env::var("PATH").unwrap());
    let mut shell = Command::new("sh");
    shell.args(["-ec", command]).current_dir(folder);
    shell.env("PATH", &path).output().unwrap()
}

/// Adds 10 m to the distances of a corpus.
fn move_labels(corpus: &Path) {
    for folder in Corpus::open(corpus).unwrap().scenarios().unwrap() {
        let mut frames = Frames::read(&folder.frames_path()).unwrap();
        for labels in frames.rows.iter_mut().filter_map(|row| row.labels.as_mut()) {
            labels.dtd_m += 10.0;
        }
        frames.write(&folder.frames_path()).unwrap();
        let seal = folder.seal().unwrap().unwrap();
        seal_folder(folder.root(), &seal.config_hash).unwrap();
    }
}

#[test]
fn the_commands_of_the_jobs_replay_label_and_compare_and_a_label_that_differs_is_red() {
    for (file, _) in EXAMPLES {
        let commands = commands(&repository().join(file));
        let [generate, label, verify] = commands.as_slice() else {
            panic!("{file}: {commands:?}");
        };
        let folder = repository_of_a_user();
        let succeeds = |command: &str| {
            let output = run(command, folder.path());
            let said = String::from_utf8_lossy(&output.stderr);
            assert!(output.status.success(), "{file}: {command}: {said}");
        };
        succeeds(generate);
        succeeds(label);
        succeeds("cp -r corpus expected && rm -r expected/scenarios/*/views");
        succeeds(verify);
        move_labels(&folder.path().join("expected"));
        let output = run(verify, folder.path());
        let said = String::from_utf8_lossy(&output.stdout);
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(said.contains("frames.parquet row 0: dtd_m: is "), "{said}");
    }
}
