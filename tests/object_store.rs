//! A corpus in a bucket of a real S3 server: made there by processes that are killed and cut off, brought back, and the same as in a folder.

#[path = "object_store/s3_server.rs"]
mod s3_server;

use std::fs;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::LazyLock;
use std::thread::sleep;
use std::time::{Duration, Instant};

use s3_server::{S3Server, Way};
use serde_json::Value;
use tempfile::{TempDir, tempdir};

const SCENARIOS: usize = 6;
/// Far longer than anything here takes.
const TOO_LONG: Duration = Duration::from_secs(180);

static SERVER: LazyLock<S3Server> = LazyLock::new(|| S3Server::start(&[]));

/// The corpus as a folder, made by one run, and how long that took.
static IN_A_FOLDER: LazyLock<(PathBuf, Duration)> = LazyLock::new(|| {
    let corpus = Path::new(env!("CARGO_TARGET_TMPDIR")).join("object-store-undisturbed");
    let _ = fs::remove_dir_all(&corpus);
    let began = Instant::now();
    let output = dtd(SERVER.address)
        .arg("generate")
        .arg("tests/data/small.toml")
        .arg("--out")
        .arg(&corpus)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", said(&output));
    (corpus, began.elapsed())
});

fn repository() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The command, with the environment of somebody who uses the server there.
fn dtd(server: SocketAddr) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_dtd"));
    command
        .current_dir(repository())
        .env("AWS_ENDPOINT_URL", format!("http://{server}"))
        .env("AWS_REGION", "us-east-1")
        .env("AWS_ACCESS_KEY_ID", "key")
        .env("AWS_SECRET_ACCESS_KEY", "secret")
        .env_remove("AWS_SESSION_TOKEN")
        .env_remove("AWS_ALLOW_HTTP")
        .env_remove("SLURM_ARRAY_TASK_ID")
        .env_remove("JOB_COMPLETION_INDEX");
    command
}

fn generate(server: SocketAddr, url: &str, stage: &Path) -> Command {
    let mut command = dtd(server);
    command
        .args(["generate", "tests/data/small.toml", "--json", "--out", url])
        .arg("--staging")
        .arg(stage);
    command
}

fn start(mut command: Command) -> Child {
    command
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

fn number(outcome: &Value, list: &str) -> usize {
    outcome[list].as_array().map_or(0, Vec::len)
}

/// A bucket of its own.
fn bucket(name: &str) -> String {
    SERVER.make_bucket(name);
    format!("s3://{name}/a/corpus")
}

fn committed(bucket: &str) -> usize {
    let objects = SERVER.objects(bucket);
    objects
        .iter()
        .filter(|name| name.ends_with("/DONE.json"))
        .count()
}

fn until(what: &str, is_so: impl Fn() -> bool) {
    let began = Instant::now();
    while !is_so() {
        assert!(began.elapsed() < TOO_LONG, "never: {what}");
        sleep(Duration::from_millis(20));
    }
}

fn fetch(url: &str) -> (TempDir, PathBuf, Output) {
    let folder = tempdir().unwrap();
    let corpus = folder.path().join("corpus");
    let output = dtd(SERVER.address)
        .args(["fetch", url, "--json", "--out"])
        .arg(&corpus)
        .output()
        .unwrap();
    (folder, corpus, output)
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

/// What is at the URL, fetched, is what one run makes in a folder, and sound.
fn assert_same(url: &str) {
    let (_folder, corpus, output) = fetch(url);
    assert!(output.status.success(), "{}", said(&output));
    let [found, expected] = [corpus.as_path(), &IN_A_FOLDER.0].map(contents);
    let names = |all: &[(PathBuf, Vec<u8>)]| -> Vec<PathBuf> {
        all.iter().map(|(name, _)| name.clone()).collect()
    };
    assert_eq!(names(&found), names(&expected));
    for ((name, found), (_, expected)) in found.iter().zip(&expected) {
        assert!(found == expected, "{} differs", name.display());
    }
    let verified = dtd(SERVER.address)
        .args(["verify", "--complete"])
        .arg(&corpus)
        .output()
        .unwrap();
    assert!(verified.status.success(), "{}", said(&verified));
}

fn scenarios_on(stage: &Path) -> usize {
    fs::read_dir(stage.join("scenarios")).map_or(0, Iterator::count)
}

#[test]
fn two_shards_of_which_one_is_killed_make_the_corpus_of_one_run() {
    let url = bucket("two-shards");
    let stages = [tempdir().unwrap(), tempdir().unwrap()];
    let shard = |number: usize| {
        let mut command = generate(SERVER.address, &url, stages[number].path());
        command.args(["--shard", &format!("{number}/2")]);
        start(command)
    };
    let (mut killed, other) = (shard(0), shard(1));
    until("a scenario is committed", || committed("two-shards") > 0);
    killed.kill().unwrap();
    killed.wait().unwrap();
    // What counts is whole, whatever else lies there.
    let (_folder, corpus, output) = fetch(&url);
    assert!(output.status.success(), "{}", said(&output));
    let verified = dtd(SERVER.address).arg("verify").arg(&corpus).output();
    assert!(verified.unwrap().status.success());

    for run in [shard(0), other] {
        let output = run.wait_with_output().unwrap();
        assert!(output.status.success(), "{}", said(&output));
        let outcome = json(&output);
        let mine = number(&outcome, "committed") + number(&outcome, "skipped");
        assert_eq!(mine, SCENARIOS / 2, "{outcome}");
    }
    assert_eq!(committed("two-shards"), SCENARIOS);
    assert_same(&url);
    assert_eq!(
        stages.each_ref().map(|stage| scenarios_on(stage.path())),
        [0, 0]
    );
}

#[test]
fn a_run_that_is_killed_again_and_again_goes_on_from_its_stage() {
    let url = bucket("killed");
    let stage = tempdir().unwrap();
    let took = IN_A_FOLDER.1;
    for part in [0.3, 0.6, 0.45, 0.9] {
        let mut run = start(generate(SERVER.address, &url, stage.path()));
        sleep(took.mul_f64(part));
        run.kill().unwrap();
        run.wait().unwrap();
    }
    let output = generate(SERVER.address, &url, stage.path())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", said(&output));
    assert_same(&url);
    assert_eq!(scenarios_on(stage.path()), 0);
    let output = generate(SERVER.address, &url, stage.path())
        .output()
        .unwrap();
    assert_eq!(number(&json(&output), "skipped"), SCENARIOS);
}

#[test]
fn a_scenario_without_its_seal_is_not_taken_for_whole() {
    let url = bucket("half");
    let stage = tempdir().unwrap();
    // As a killed upload leaves it.
    let scenario = "/half/a/corpus/scenarios/1200-clear-r1";
    SERVER.put(&format!("{scenario}/frames.parquet"), "of another run");
    SERVER.put(&format!("{scenario}/MANIFEST.b3"), "");
    let (_folder, corpus, output) = fetch(&url);
    assert_eq!(output.status.code(), Some(2), "{}", said(&output));
    assert!(said(&output).contains("no committed scenario"));
    assert!(!corpus.exists());
    let output = generate(SERVER.address, &url, stage.path())
        .output()
        .unwrap();
    assert_eq!(
        number(&json(&output), "committed"),
        SCENARIOS,
        "{}",
        said(&output)
    );
    assert_same(&url);
}

#[test]
fn a_store_that_goes_away_leaves_what_is_made_on_the_stage_and_the_next_run_sends_it() {
    let url = bucket("away");
    let stage = tempdir().unwrap();
    let way = Way::to(SERVER.address);
    let mut command = generate(way.address, &url, stage.path());
    command.args(["--patience", "1"]);
    let run = start(command);
    until("a scenario is committed", || committed("away") > 0);
    way.cut();
    let output = run.wait_with_output().unwrap();
    let message = said(&output);
    assert_eq!(output.status.code(), Some(1), "{message}");
    for words in [
        "does not answer",
        "is waited for",
        stage.path().to_str().unwrap(),
        "run the same command again",
    ] {
        assert!(message.contains(words), "no {words:?} in {message}");
    }
    let outcome = json(&output);
    assert_eq!(outcome["stopped"]["cause"], "store", "{outcome}");
    assert_eq!(number(&outcome, "failed"), 0, "{outcome}");
    let (sent, staged) = (number(&outcome, "committed"), number(&outcome, "staged"));
    assert!(sent > 0 && staged > 0, "{outcome}");
    // One whose DONE.json arrived while its answer was cut off is committed all the same.
    assert!((sent..=sent + 1).contains(&committed("away")));

    way.mend();
    let before = fs::read_dir(stage.path().join("scenarios"))
        .unwrap()
        .flatten();
    let before: Vec<String> = before
        .map(|entry| entry.file_name().into_string().unwrap())
        .filter(|name| !name.ends_with(".partial"))
        .collect();
    let output = generate(way.address, &url, stage.path()).output().unwrap();
    let message = said(&output);
    assert!(output.status.success(), "{message}");
    assert!(message.contains("made before, and sent now"), "{message}");
    for id in before {
        let made = |line: &str| line.contains(&format!("{id}: ")) && line.contains(" ticks in ");
        assert!(!message.lines().any(made), "{id} was made again: {message}");
    }
    assert_same(&url);
}

#[test]
fn what_cannot_work_is_said_at_once_and_nothing_is_recorded() {
    let url = bucket("refusals");
    let strict = S3Server::start(&[("INITIAL_NO_AUTH_ACTION_COUNT", "1")]);
    strict.make_bucket("strict");
    let nobody = SocketAddr::from(([127, 0, 0, 1], 1));
    let other_plan = {
        SERVER.make_bucket("other-plan");
        let plan = fs::read_to_string(IN_A_FOLDER.0.join("plan.json")).unwrap();
        let key = "\"config_hash\":\"";
        let other = plan.replacen(key, &format!("{key}0ther"), 1);
        assert_ne!(plan, other);
        SERVER.put("/other-plan/plan.json", &other);
        "s3://other-plan"
    };
    for (server, url, code, words) in [
        (SERVER.address, "s3://no-such-bucket/a", 2, "NoSuchBucket"),
        (strict.address, "s3://strict/a", 2, "AWS_ACCESS_KEY_ID"),
        (nobody, url.as_str(), 1, "does not answer"),
        (SERVER.address, other_plan, 2, "begun with another plan"),
        (SERVER.address, "http://host/corpus", 2, "s3://BUCKET"),
        (SERVER.address, "ftp://host/corpus", 2, "gs://BUCKET"),
    ] {
        let stage = tempdir().unwrap();
        let began = Instant::now();
        let output = generate(server, url, stage.path()).output().unwrap();
        let message = said(&output);
        assert_eq!(output.status.code(), Some(code), "{url}: {message}");
        assert!(message.contains(words), "{url}: no {words:?} in {message}");
        assert!(
            began.elapsed() < Duration::from_secs(60),
            "{url}: {message}"
        );
        assert_eq!(scenarios_on(stage.path()), 0, "{url}");
    }
}

#[test]
fn verbs_that_work_on_folders_refuse_a_url_and_say_how_to_get_one() {
    let folder = tempdir().unwrap();
    let url = "s3://bucket/corpus";
    for arguments in [
        vec!["label", url],
        vec!["verify", url],
        vec!["detect", url],
        vec!["plan", "tests/data/small.toml", "--against", url],
        vec!["push", url, url],
        vec!["fetch", url, "--out", url],
    ] {
        let output = dtd(SERVER.address)
            .args(&arguments)
            .current_dir(if arguments[0] == "plan" {
                repository()
            } else {
                folder.path()
            })
            .output()
            .unwrap();
        let message = said(&output);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
        assert!(
            message.contains("dtd fetch s3://bucket/corpus --out FOLDER"),
            "{arguments:?}: {message}"
        );
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    let output = dtd(SERVER.address)
        .args([
            "generate",
            "tests/data/small.toml",
            "--keep-staged",
            "--out",
        ])
        .arg(folder.path())
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2), "{}", said(&output));
}

#[test]
fn labels_go_back_to_the_bucket_and_another_mirror_gets_them() {
    let url = bucket("labels");
    let run = |arguments: &[&str]| {
        let output = dtd(SERVER.address).args(arguments).output().unwrap();
        assert!(output.status.success(), "{arguments:?}: {}", said(&output));
        output
    };
    let local = IN_A_FOLDER.0.to_str().unwrap();
    let pushed = json(&run(&["push", local, &url, "--json"]));
    assert_eq!(number(&pushed, "pushed"), SCENARIOS, "{pushed}");
    let (_one, one, output) = fetch(&url);
    assert_eq!(number(&json(&output), "fetched"), SCENARIOS);
    let one = one.to_str().unwrap();
    run(&["label", one]);
    let pushed = json(&run(&["push", one, &url, "--json"]));
    assert_eq!(number(&pushed, "replaced"), SCENARIOS, "{pushed}");
    let pushed = json(&run(&["push", one, &url, "--json"]));
    assert_eq!(number(&pushed, "unchanged"), SCENARIOS, "{pushed}");
    let (_two, two, _) = fetch(&url);
    assert_eq!(contents(Path::new(one)), contents(&two));
    // A mirror that has them already moves nothing; one with other content is not overwritten.
    let again = json(&run(&["fetch", &url, "--out", one, "--json"]));
    assert_eq!(number(&again, "unchanged"), SCENARIOS, "{again}");
    let output = dtd(SERVER.address)
        .args(["fetch", &url, "--json", "--out"])
        .arg(&IN_A_FOLDER.0)
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(3), "{}", said(&output));
    assert_eq!(number(&json(&output), "different"), SCENARIOS);
}

#[test]
fn amazons_own_client_finds_the_files_that_the_manifest_lists() {
    let url = bucket("judged");
    let stage = tempdir().unwrap();
    let output = generate(SERVER.address, &url, stage.path())
        .args(["--only", "1200-clear-r1", "--keep-staged"])
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", said(&output));
    let scenario = stage.path().join("scenarios/1200-clear-r1");
    let manifest = fs::read_to_string(scenario.join("MANIFEST.b3")).unwrap();
    let program = "
import boto3, sys
s3 = boto3.client('s3')
for line in sys.argv[1].splitlines():
    hash, name = line.split('  ')
    got = s3.get_object(Bucket='judged', Key='a/corpus/scenarios/1200-clear-r1/' + name)
    assert got['Metadata'] == {'blake3': hash}, got['Metadata']
    assert got['Body'].read() == open(sys.argv[2] + '/' + name, 'rb').read(), name
    print(name)
";
    let mut judge = Command::new(repository().join(".venv/bin/python"));
    for (name, value) in dtd(SERVER.address).get_envs() {
        if let Some(value) = value {
            judge.env(name, value);
        }
    }
    let judged = judge
        .args(["-c", program, &manifest])
        .arg(&scenario)
        .output()
        .unwrap();
    assert!(judged.status.success(), "{}", said(&judged));
    assert_eq!(said(&judged).lines().count(), manifest.lines().count());
}
