//! `dtd generate` as a scheduler treats it: killed, stopped, started twice, with a full disk or an unusable one.

use std::fs;
use std::io::Read;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::LazyLock;
use std::thread::sleep;
use std::time::{Duration, Instant};

use serde_json::Value;
use tempfile::tempdir;

fn repository() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn small_sweep() -> PathBuf {
    repository().join("tests/data/small.toml")
}

fn generate(corpus: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_dtd"));
    command
        .arg("generate")
        .arg(small_sweep())
        .arg("--out")
        .arg(corpus)
        .arg("--json")
        .current_dir(repository())
        // The environment of a scheduler that runs these tests is ignored.
        .env_remove("SLURM_ARRAY_TASK_ID")
        .env_remove("JOB_COMPLETION_INDEX");
    command
}

fn start(corpus: &Path) -> Child {
    generate(corpus)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

fn said(output: &Output) -> String {
    format!(
        "{}{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    )
}

fn json(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", said(output)))
}

/// Every file of a corpus by name, with its bytes.
fn contents(corpus: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found = Vec::new();
    let mut folders = vec![corpus.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let bytes = fs::read(&path).unwrap();
                found.push((path.strip_prefix(corpus).unwrap().to_owned(), bytes));
            }
        }
    }
    found.sort();
    found
}

fn assert_same(corpus: &Path) {
    let [found, expected] = [corpus, &UNDISTURBED.0].map(contents);
    let names = |all: &[(PathBuf, Vec<u8>)]| -> Vec<PathBuf> {
        all.iter().map(|(name, _)| name.clone()).collect()
    };
    assert_eq!(names(&found), names(&expected));
    for ((name, found), (_, expected)) in found.iter().zip(&expected) {
        assert!(found == expected, "{} differs", name.display());
    }
}

/// A corpus without disturbances, made once, and its duration.
static UNDISTURBED: LazyLock<(PathBuf, Duration)> = LazyLock::new(|| {
    let corpus = Path::new(env!("CARGO_TARGET_TMPDIR")).join("undisturbed");
    let _ = fs::remove_dir_all(&corpus);
    let began = Instant::now();
    let output = generate(&corpus).output().unwrap();
    assert!(output.status.success(), "{}", said(&output));
    assert_eq!(json(&output)["committed"].as_array().unwrap().len(), 6);
    (corpus, began.elapsed())
});

#[test]
fn a_run_that_is_killed_again_and_again_ends_with_the_bytes_of_an_undisturbed_one() {
    let took = UNDISTURBED.1;
    let folder = tempdir().unwrap();
    let corpus = folder.path().join("corpus");
    // Spread over the duration of a run; the last ones come late, when most of it is finished.
    for part in [0.15, 0.5, 0.35, 0.7, 0.25] {
        let mut run = start(&corpus);
        sleep(took.mul_f64(part));
        run.kill().unwrap();
        run.wait().unwrap();
    }
    let output = generate(&corpus).output().unwrap();
    assert!(output.status.success(), "{}", said(&output));
    assert_same(&corpus);
}

#[test]
fn sigterm_ends_a_run_in_good_order_and_the_same_command_goes_on() {
    let folder = tempdir().unwrap();
    let corpus = folder.path().join("corpus");
    let run = start(&corpus);
    // In the middle of the first scenario.
    let scenarios = corpus.join("scenarios");
    let began = Instant::now();
    while fs::read_dir(&scenarios).is_ok_and(|mut entries| entries.next().is_none())
        || !scenarios.exists()
    {
        assert!(began.elapsed() < Duration::from_secs(60), "nothing began");
        sleep(Duration::from_millis(5));
    }
    let pid = run.id().to_string();
    assert!(
        Command::new("kill")
            .args(["-TERM", &pid])
            .status()
            .unwrap()
            .success()
    );
    let output = run.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(75), "{}", said(&output));
    assert!(said(&output).contains("run the same command again to resume"));
    let outcome = json(&output);
    assert_eq!(outcome["stopped"]["cause"], "interrupted");
    assert_eq!(outcome["failed"], serde_json::json!([]));
    let whole = outcome["committed"].as_array().unwrap().len();
    assert_eq!(
        fs::read_dir(&scenarios).unwrap().count(),
        whole,
        "something is left"
    );
    assert!(!corpus.join("claims").exists());

    let output = generate(&corpus).output().unwrap();
    assert_eq!(
        json(&output)["skipped"].as_array().unwrap().len(),
        whole,
        "{}",
        said(&output)
    );
    assert_same(&corpus);
}

#[test]
fn two_runs_at_once_share_a_corpus() {
    let folder = tempdir().unwrap();
    let corpus = folder.path().join("corpus");
    let runs = [start(&corpus), start(&corpus)];
    let mut made = 0;
    for run in runs {
        let output = run.wait_with_output().unwrap();
        assert!(output.status.success(), "{}", said(&output));
        let outcome = json(&output);
        let count = |list: &str| outcome[list].as_array().unwrap().len();
        assert_eq!(count("committed") + count("skipped"), 6);
        made += count("committed");
    }
    assert_eq!(made, 6);
    assert_same(&corpus);
}

#[test]
fn shards_come_from_the_schedulers_environment() {
    let folder = tempdir().unwrap();
    let corpus = folder.path().join("corpus");
    let slurm = |id: &str| {
        let output = generate(&corpus)
            .env("SLURM_ARRAY_TASK_ID", id)
            .env("SLURM_ARRAY_TASK_MIN", "1")
            .env("SLURM_ARRAY_TASK_MAX", "3")
            .env("SLURM_ARRAY_TASK_COUNT", "3")
            .output()
            .unwrap();
        assert!(said(&output).contains("SLURM_ARRAY_TASK_ID"));
        json(&output)["committed"].as_array().unwrap().len()
    };
    assert_eq!(["1", "2", "3"].map(slurm), [2, 2, 2]);
    assert_same(&corpus);

    let output = generate(&corpus)
        .env("JOB_COMPLETION_INDEX", "0")
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2), "{}", said(&output));
    assert!(said(&output).contains("DTD_SHARDS"));
}

#[test]
fn a_disk_that_takes_no_more_ends_the_run_and_nothing_half_written_counts() {
    let folder = tempdir().unwrap();
    let corpus = folder.path().join("corpus");
    let first = generate(&corpus)
        .args(["--only", "1200-clear-r1"])
        .output()
        .unwrap();
    assert!(first.status.success(), "{}", said(&first));
    // Files may not grow beyond 12 kB, and tables are larger: without root, as close to a full disk as possible. 1024-byte blocks
    // in bash.
    let limited = "trap '' XFSZ; ulimit -f 12; exec \"$@\"";
    let plain = generate(&corpus);
    let output = Command::new("bash")
        .args(["-c", limited, "bash"])
        .arg(plain.get_program())
        .args(plain.get_args())
        .current_dir(repository())
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    let outcome = json(&output);
    assert_eq!(outcome["stopped"]["cause"], "storage", "{outcome}");
    assert_eq!(outcome["failed"], serde_json::json!([]));
    let message = said(&output);
    for words in [
        "File too large",
        "free",
        "needed",
        "run the same command again",
    ] {
        assert!(message.contains(words), "no {words:?} in {message}");
    }
    let verified = Command::new(env!("CARGO_BIN_EXE_dtd"))
        .arg("verify")
        .arg(&corpus)
        .output()
        .unwrap();
    assert!(verified.status.success(), "{}", said(&verified));
    let whole = ["committed", "skipped"].map(|list| outcome[list].as_array().unwrap().len());
    let left = fs::read_dir(corpus.join("scenarios")).unwrap().count();
    assert_eq!((whole, left), ([0, 1], 1));

    let output = generate(&corpus).output().unwrap();
    assert!(output.status.success(), "{}", said(&output));
    assert_same(&corpus);
}

#[test]
fn places_where_no_corpus_can_be_are_bad_input() {
    let folder = tempdir().unwrap();
    let file = folder.path().join("file");
    fs::write(&file, "").unwrap();
    // Nobody, not even root, can create a folder there.
    for place in [file.as_path(), Path::new("/proc/corpus")] {
        let output = generate(place).output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{}", said(&output));
        assert!(
            said(&output).contains(place.to_str().unwrap()),
            "{}",
            said(&output)
        );
    }
}

#[test]
fn a_damaged_split_is_bad_input() {
    let folder = tempdir().unwrap();
    let corpus = folder.path().join("corpus");
    fs::create_dir_all(corpus.join("scenarios")).unwrap();
    fs::write(corpus.join("splits.json"), "{ half").unwrap();
    let output = generate(&corpus).output().unwrap();
    assert_eq!(output.status.code(), Some(2), "{}", said(&output));
    assert_eq!(
        said(&output).matches("expected").count() + said(&output).matches("key must").count(),
        1
    );
}

#[test]
fn a_corpus_without_scenarios_and_a_model_that_is_none_are_bad_input() {
    let folder = tempdir().unwrap();
    let empty = folder.path().join("empty");
    fs::create_dir_all(empty.join("scenarios")).unwrap();
    let no_model = folder.path().join("model.onnx");
    fs::write(&no_model, "not an ONNX file").unwrap();
    let dtd = |arguments: &[&Path]| {
        Command::new(env!("CARGO_BIN_EXE_dtd"))
            .args(arguments)
            .current_dir(repository())
            .output()
            .unwrap()
    };
    for (arguments, words) in [
        (vec![Path::new("label"), &empty], "dtd generate"),
        (vec![Path::new("detect"), &empty], "dtd generate"),
        (
            vec![
                Path::new("detect"),
                &UNDISTURBED.0,
                Path::new("--model"),
                &no_model,
            ],
            "model.onnx",
        ),
    ] {
        let output = dtd(&arguments);
        assert_eq!(
            output.status.code(),
            Some(2),
            "{arguments:?}: {}",
            said(&output)
        );
        assert!(said(&output).contains(words), "{}", said(&output));
    }
}

#[test]
fn a_reader_that_goes_away_ends_nothing_in_a_panic() {
    let mut plan = Command::new(env!("CARGO_BIN_EXE_dtd"))
        .args(["plan", "scenarios.toml"])
        .current_dir(repository())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(plan.stdout.take());
    let mut said = String::new();
    plan.stderr
        .take()
        .unwrap()
        .read_to_string(&mut said)
        .unwrap();
    let status = plan.wait().unwrap();
    assert_eq!((status.code(), status.signal()), (Some(0), None), "{said}");
    assert_eq!(said, "");
}

#[test]
fn only_takes_names_and_leaves_the_sweep_alone() {
    let folder = tempdir().unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_dtd"))
        .args(["generate", "--only", "1200-clear-r1,0099"])
        .arg(small_sweep())
        .arg("--out")
        .arg(folder.path().join("corpus"))
        .current_dir(repository())
        .output()
        .unwrap();
    let message = said(&output);
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(message.contains("no scenario 0099"), "{message}");
}

#[test]
fn the_kubernetes_job_is_one_that_kubernetes_takes_and_counts_its_shards_right() {
    let file = repository().join("deploy/k8s/generate-job.yaml");
    let judge = repository().join(".venv/bin/kubernetes-validate");
    assert!(
        judge.exists(),
        "run `bash scripts/setup.sh` first: {} is missing",
        judge.display()
    );
    let output = Command::new(judge)
        .args(["--strict", "--kubernetes-version", "1.33"])
        .arg(&file)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", said(&output));
    let text = fs::read_to_string(file).unwrap();
    let after = |key: &str| {
        let rest = text.split_once(key).unwrap().1;
        let digits = rest
            .trim_start_matches([' ', '"'])
            .split(|c: char| !c.is_ascii_digit());
        digits.into_iter().next().unwrap().to_owned()
    };
    let completions = after("\n  completions:");
    assert_eq!(
        completions,
        after("- name: DTD_SHARDS\n              value:")
    );
    assert_eq!(completions, after("\n  parallelism:"));
}
