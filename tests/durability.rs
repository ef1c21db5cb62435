//! `dtd generate` as a scheduler treats it: killed, stopped, started twice, with a full disk or an unusable one.

use std::fs;
use std::io::Read;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::LazyLock;
use std::thread::sleep;
use std::time::{Duration, Instant};

use tempfile::tempdir;
use testkit::command::{Dtd, Ending, json, said, text};
use testkit::files::assert_same_contents;
use testkit::{program_of_venv, repository};

/// Signal of `kill`.
const SIGKILL: i32 = 9;
/// Far longer than anything here takes.
const TOO_LONG: Duration = Duration::from_secs(180);
const POLL: Duration = Duration::from_millis(2);

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));

fn small_sweep() -> PathBuf {
    repository().join("tests/data/small.toml")
}

fn generate(corpus: &Path) -> Command {
    let mut command = DTD.command(&["generate", "--json"]);
    command.arg(small_sweep()).arg("--out").arg(corpus);
    command
}

fn start(corpus: &Path) -> Child {
    generate(corpus)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

fn assert_same(corpus: &Path) {
    assert_same_contents(corpus, &UNDISTURBED);
}

/// A corpus without disturbances, made once.
static UNDISTURBED: LazyLock<PathBuf> = LazyLock::new(|| {
    let corpus = Path::new(env!("CARGO_TARGET_TMPDIR")).join("undisturbed");
    let _ = fs::remove_dir_all(&corpus);
    let output = generate(&corpus).succeeds();
    assert_eq!(json(&output)["committed"].as_array().unwrap().len(), 6);
    corpus
});

/// Committed scenarios, and those in work with existing files.
fn made_and_begun(corpus: &Path, what: &str) -> (usize, usize) {
    let folders = fs::read_dir(corpus.join("scenarios")).into_iter().flatten();
    let (mut made, mut begun) = (0, 0);
    for folder in folders.map(|entry| entry.unwrap().path()) {
        if !folder.to_string_lossy().ends_with(".partial") {
            made += 1;
        } else if folder.join(what).exists() {
            begun += 1;
        }
    }
    (made, begun)
}

/// Waits until a run has made this many scenarios and has files of a further one.
fn until_at_work(run: &mut Child, corpus: &Path, wanted: usize, what: &str) {
    let began = Instant::now();
    loop {
        let (made, begun) = made_and_begun(corpus, what);
        if made >= wanted && begun > 0 {
            return;
        }
        let ended = run.try_wait().unwrap();
        assert!(ended.is_none(), "it ended by itself: {ended:?}");
        assert!(began.elapsed() < TOO_LONG, "{made} made, {begun} begun");
        sleep(POLL);
    }
}

#[test]
fn a_run_that_is_killed_again_and_again_ends_with_the_bytes_of_an_undisturbed_one() {
    let folder = tempdir().unwrap();
    let corpus = folder.path().join("corpus");
    // Each run makes one more, so that leftovers of the last one are gone; some are killed as soon as they have a folder, some while they
    // record.
    for (made, what) in [
        (0, ""),
        (1, "views/left.mp4"),
        (2, "views/right.mp4"),
        (3, ""),
        (4, "views/left.mp4"),
    ] {
        let mut run = start(&corpus);
        until_at_work(&mut run, &corpus, made, what);
        run.kill().unwrap();
        let status = run.wait().unwrap();
        assert_eq!(status.signal(), Some(SIGKILL), "{status}: not killed");
        let (whole, _) = made_and_begun(&corpus, "");
        assert!(whole < 6, "killed after its work");
    }
    generate(&corpus).succeeds();
    assert_same(&corpus);
}

#[test]
fn sigterm_ends_a_run_in_good_order_and_the_same_command_goes_on() {
    let folder = tempdir().unwrap();
    let corpus = folder.path().join("corpus");
    let mut run = start(&corpus);
    until_at_work(&mut run, &corpus, 0, "");
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
    assert!(whole < 6, "it was done before the signal came: {outcome}");
    assert_eq!(
        fs::read_dir(corpus.join("scenarios")).unwrap().count(),
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
    let mut made = Vec::new();
    for run in runs {
        let output = run.wait_with_output().unwrap();
        assert!(output.status.success(), "{}", said(&output));
        let outcome = json(&output);
        let count = |list: &str| outcome[list].as_array().unwrap().len();
        assert_eq!(count("committed") + count("skipped"), 6);
        made.push(count("committed"));
    }
    assert!(
        made.iter().sum::<usize>() == 6 && !made.contains(&0),
        "{made:?}"
    );
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

    generate(&corpus)
        .env("JOB_COMPLETION_INDEX", "0")
        .ends_with(2, &["DTD_SHARDS"]);
}

#[test]
fn a_disk_that_takes_no_more_ends_the_run_and_nothing_half_written_counts() {
    let folder = tempdir().unwrap();
    let corpus = folder.path().join("corpus");
    generate(&corpus)
        .args(["--only", "1200-clear-r1"])
        .succeeds();
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
    DTD.succeeds(&["verify", text(&corpus)]);
    let whole = ["committed", "skipped"].map(|list| outcome[list].as_array().unwrap().len());
    let left = fs::read_dir(corpus.join("scenarios")).unwrap().count();
    assert_eq!((whole, left), ([0, 1], 1));

    generate(&corpus).succeeds();
    assert_same(&corpus);
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
fn a_reader_that_goes_away_ends_nothing_in_a_panic() {
    let mut plan = DTD
        .command(&["plan", "scenarios.toml"])
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
fn the_kubernetes_job_is_one_that_kubernetes_takes_and_counts_its_shards_right() {
    let file = repository().join("deploy/k8s/generate-job.yaml");
    Command::new(program_of_venv("kubernetes-validate"))
        .args(["--strict", "--kubernetes-version", "1.33"])
        .arg(&file)
        .succeeds();
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
