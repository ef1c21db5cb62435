//! The jobs of docs/ci.md: valid for GitHub Actions and GitLab, and their commands replay the tape of the tests. The repository's own
//! workflows are valid as well.

use std::path::Path;
use std::process::Command;
use std::{env, fs};

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

#[test]
fn the_commands_of_the_jobs_replay_label_and_verify_a_tape() {
    let program = Path::new(env!("CARGO_BIN_EXE_dtd")).parent().unwrap();
    let path = format!("{}:{}", program.display(), env::var("PATH").unwrap());
    for (file, _) in EXAMPLES {
        let commands = commands(&repository().join(file));
        assert_eq!(commands.len(), 3, "{file}: {commands:?}");
        let folder = repository_of_a_user();
        for command in commands {
            let output = Command::new("sh")
                .args(["-ec", &command])
                .current_dir(&folder)
                .env("PATH", &path)
                .output()
                .unwrap();
            let said = String::from_utf8_lossy(&output.stderr);
            assert!(output.status.success(), "{file}: {command}: {said}");
        }
        assert!(folder.path().join("corpus/scenarios").is_dir());
    }
}
