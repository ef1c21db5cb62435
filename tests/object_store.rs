//! A corpus in a bucket of a real S3 server: uploaded by processes that are killed and cut off, downloaded again, and equal to one
//! in a folder.

#[path = "object_store/s3_server.rs"]
mod s3_server;
#[path = "object_store/ways_out.rs"]
mod ways_out;

use std::fs;
use std::net::SocketAddr;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::LazyLock;
use std::thread::sleep;
use std::time::{Duration, Instant};

use dataset::corpus::Corpus;
use dataset::corpus::claim::{Claim, Claimed};
use dataset::corpus::detections::{self, Detection, NewTables};
use dataset::corpus::model_identity::ModelIdentity;
use dataset::tables::pixel_box::PixelBox;
use s3_server::{S3Server, Way};
use serde_json::Value;
use tempfile::{TempDir, tempdir};
use testkit::command::{Dtd, Ending, json, said, text};
use testkit::files::{assert_same_contents, contents};
use testkit::{program_of_venv, repository};

const SCENARIOS: usize = 6;
/// What `kill` sends.
const SIGKILL: i32 = 9;
/// Far longer than anything here takes.
const TOO_LONG: Duration = Duration::from_secs(180);

static SERVER: LazyLock<S3Server> = LazyLock::new(|| S3Server::start(&[]));

/// The corpus as a folder, made by one run.
static IN_A_FOLDER: LazyLock<PathBuf> = LazyLock::new(|| {
    let corpus = Path::new(env!("CARGO_TARGET_TMPDIR")).join("object-store-undisturbed");
    let _ = fs::remove_dir_all(&corpus);
    dtd(SERVER.address)
        .arg("generate")
        .arg("tests/data/small.toml")
        .arg("--out")
        .arg(&corpus)
        .succeeds();
    corpus
});

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));

/// The command, with the environment for the server.
fn dtd(server: SocketAddr) -> Command {
    let mut command = DTD.command(&[""; 0]);
    command
        .env("AWS_ENDPOINT_URL", format!("http://{server}"))
        .env("AWS_REGION", "us-east-1")
        .env("AWS_ACCESS_KEY_ID", "key")
        .env("AWS_SECRET_ACCESS_KEY", "secret")
        .env_remove("AWS_SESSION_TOKEN")
        .env_remove("AWS_ALLOW_HTTP");
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

fn number(outcome: &Value, list: &str) -> usize {
    outcome[list].as_array().map_or(0, Vec::len)
}

/// A new bucket.
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

/// The corpus at the URL, downloaded, equals that of one run in a folder, and is valid.
fn assert_same(url: &str) {
    let (_folder, corpus, output) = fetch(url);
    assert!(output.status.success(), "{}", said(&output));
    assert_same_contents(&corpus, &IN_A_FOLDER);
    dtd(SERVER.address)
        .args(["verify", "--complete"])
        .arg(&corpus)
        .succeeds();
}

fn scenarios_on(stage: &Path) -> usize {
    fs::read_dir(stage.join("scenarios")).map_or(0, Iterator::count)
}

/// Key of a file's object of the scenario `1200-clear-r1`.
fn key_of(bucket: &str, ending: &str) -> String {
    let objects = SERVER.objects(bucket);
    let mut objects = objects.into_iter();
    let key = objects.find(|key| key.contains("/1200-clear-r1/") && key.ends_with(ending));
    format!("/{bucket}/{}", key.unwrap())
}

/// Deletes an object as if the store had lost it.
fn lose(key: &str) {
    let (status, answer) = SERVER.ask("DELETE", key, "");
    assert_eq!(status, 204, "{answer}");
}

/// Exchanges an object for one of equal size and metadata.
fn exchange(key: &str, scenario: &Path) {
    let (_, name) = key.split_once("/1200-clear-r1/").unwrap();
    let (stem, ending) = name.rsplit_once('.').unwrap();
    let (stem, hash) = stem.rsplit_once('.').unwrap();
    let whole = fs::read(scenario.join(format!("{stem}.{ending}"))).unwrap();
    let blake3 = dataset::corpus::seal::hash_bytes(&whole);
    assert!(blake3.starts_with(hash));
    let metadata = format!("x-amz-meta-blake3: {blake3}\r\n");
    let (status, answer) = SERVER.ask_with("PUT", key, &metadata, &"x".repeat(whole.len()));
    assert_eq!(status, 200, "{answer}");
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
    // Committed scenarios are complete, whatever else is there.
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
    let planned = dtd(SERVER.address)
        .args(["plan", "tests/data/small.toml", "--json", "--against", &url])
        .current_dir(repository())
        .output()
        .unwrap();
    let verified = dtd(SERVER.address)
        .args(["verify", "--complete", "--json", &url])
        .succeeds();
    let report = json(&verified);
    assert_eq!(report["scenarios"], SCENARIOS, "{report}");
    assert!(report["pictures"].as_u64() > Some(0), "{report}");
    dtd(SERVER.address)
        .args(["verify", &format!("{url}/elsewhere")])
        .ends_with(2, &["is the prefix right?"]);
    let against = &json(&planned)["against"];
    assert_eq!(number(against, "whole"), SCENARIOS, "{against}");
    assert_eq!(against["corpus"], url.as_str());
    assert_eq!(
        stages.each_ref().map(|stage| scenarios_on(stage.path())),
        [0, 0]
    );
}

#[test]
fn a_run_that_is_killed_again_and_again_goes_on_from_its_stage() {
    let url = bucket("killed");
    let stage = tempdir().unwrap();
    // Each run commits one more scenario; the first is killed at its first recording.
    for sent in 0..4 {
        let mut run = start(generate(SERVER.address, &url, stage.path()));
        until("a scenario is recorded", || scenarios_on(stage.path()) > 0);
        until("scenarios are committed", || committed("killed") >= sent);
        run.kill().unwrap();
        let status = run.wait().unwrap();
        assert_eq!(status.signal(), Some(SIGKILL), "{status}: not killed");
        assert!(committed("killed") < SCENARIOS, "killed after its work");
    }
    generate(SERVER.address, &url, stage.path()).succeeds();
    assert_same(&url);
    assert_eq!(scenarios_on(stage.path()), 0);
    let output = generate(SERVER.address, &url, stage.path())
        .output()
        .unwrap();
    assert_eq!(number(&json(&output), "skipped"), SCENARIOS);
}

#[test]
fn a_store_that_goes_away_leaves_what_is_made_on_the_stage_and_the_next_run_sends_it() {
    let url = bucket("away");
    let stage = tempdir().unwrap();
    let way = Way::to(SERVER.address);
    let mut command = generate(way.address, &url, stage.path());
    command.args(["--timeout", "1"]);
    let run = start(command);
    // With two, the answer for at least the first has arrived.
    until("two scenarios are committed", || committed("away") > 1);
    way.cut();
    let output = run.wait_with_output().unwrap();
    let message = said(&output);
    assert_eq!(output.status.code(), Some(1), "{message}");
    for words in [
        "does not answer",
        "retrying",
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
        let plan = fs::read_to_string(IN_A_FOLDER.join("plan.json")).unwrap();
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
        (
            SERVER.address,
            other_plan,
            2,
            "started from a different sweep",
        ),
        (SERVER.address, "http://host/corpus", 2, "s3://BUCKET"),
        (SERVER.address, "gs://host/corpus", 2, "file:///FOLDER"),
    ] {
        let stage = tempdir().unwrap();
        let began = Instant::now();
        let message = generate(server, url, stage.path()).ends_with(code, &[words]);
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
        vec!["detect", url],
        vec!["push", url, url],
        vec!["fetch", url, "--out", url],
    ] {
        dtd(SERVER.address)
            .args(&arguments)
            .current_dir(folder.path())
            .ends_with(2, &["dtd fetch s3://bucket/corpus --out FOLDER"]);
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn labels_go_back_to_the_bucket_and_another_mirror_gets_them() {
    let url = bucket("labels");
    let run = |arguments: &[&str]| dtd(SERVER.address).args(arguments).succeeds();
    let local = IN_A_FOLDER.to_str().unwrap();
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
    // A mirror that has them already transfers nothing; one with other content is not overwritten.
    let again = json(&run(&["fetch", &url, "--out", one, "--json"]));
    assert_eq!(number(&again, "unchanged"), SCENARIOS, "{again}");
    let output = dtd(SERVER.address)
        .args(["fetch", &url, "--json", "--out"])
        .arg(&*IN_A_FOLDER)
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(3), "{}", said(&output));
    assert_eq!(number(&json(&output), "different"), SCENARIOS);
    assert!(said(&output).contains("delete s3://"));
}

/// A copy of a corpus that may be changed.
fn copy_of(corpus: &Path) -> (TempDir, PathBuf) {
    let folder = tempdir().unwrap();
    let copy = folder.path().join("copy");
    for (name, bytes) in contents(corpus) {
        let path = copy.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    }
    (folder, copy)
}

fn push(corpus: &Path, url: &str) -> Output {
    dtd(SERVER.address)
        .arg("push")
        .arg(corpus)
        .args([url, "--json"])
        .output()
        .unwrap()
}

/// The corpus at the URL, downloaded.
fn mirror(url: &str) -> Vec<(PathBuf, Vec<u8>)> {
    let (_folder, corpus, output) = fetch(url);
    assert!(output.status.success(), "{}", said(&output));
    contents(&corpus)
}

#[test]
fn damaged_files_of_the_whole_corpus_go_neither_way() {
    let url = bucket("damaged-files");
    let (_folder, local) = copy_of(&IN_A_FOLDER);
    assert!(push(&local, &url).status.success());
    let whole = mirror(&url);
    for name in ["plan.json", "splits.json", "corpus.toml"] {
        let path = local.join(name);
        let good = fs::read(&path).unwrap();
        // In the middle of a name, where TOML cannot end.
        let middle = match good.windows(4).position(|text| text == b"[app") {
            Some(place) => place + 4,
            None => good.len() / 2,
        };
        let other_seed = String::from_utf8_lossy(&good)
            .replacen("seed = 3", "seed = 4", 1)
            .replacen("\"seed\":", "\"seed\":1", 1)
            .replacen("\"train\"", "\"test\"", 1);
        for damaged in [&b""[..], &good[..middle], other_seed.as_bytes()] {
            fs::write(&path, damaged).unwrap();
            let output = push(&local, &url);
            let message = said(&output);
            assert_eq!(output.status.code(), Some(2), "{name}: {message}");
            assert!(message.contains(name), "{message}");
            assert!(mirror(&url) == whole, "{name} was sent: {message}");
        }
        fs::write(&path, &good).unwrap();
        // Damaged locally, it is downloaded again, with a message.
        let (_other, other) = copy_of(&local);
        fs::write(other.join(name), "").unwrap();
        let output = dtd(SERVER.address)
            .args(["fetch", &url, "--out"])
            .arg(&other)
            .succeeds();
        assert!(said(&output).contains("damaged"), "{}", said(&output));
        assert!(fs::read(other.join(name)).unwrap() == good);
        // Damaged in the store, it is never downloaded; pushing an intact one repairs it.
        SERVER.put(&format!("/damaged-files/a/corpus/{name}"), "");
        let (_third, third) = copy_of(&local);
        dtd(SERVER.address)
            .args(["fetch", &url, "--out"])
            .arg(&third)
            .ends_with(1, &[]);
        assert!(fs::read(third.join(name)).unwrap() == good);
        let output = push(&local, &url);
        assert!(output.status.success(), "{}", said(&output));
        assert!(
            said(&output).contains("which was damaged"),
            "{}",
            said(&output)
        );
        assert!(mirror(&url) == whole);
    }
}

#[test]
fn a_lost_split_is_made_again_as_it_was_and_a_person_hears_of_it() {
    let url = bucket("lost-split");
    let (_folder, local) = copy_of(&IN_A_FOLDER);
    let split = local.join("splits.json");
    let good = fs::read(&split).unwrap();
    fs::remove_file(&split).unwrap();
    let output = push(&local, &url);
    assert!(output.status.success(), "{}", said(&output));
    assert!(said(&output).contains("regenerated"), "{}", said(&output));
    assert!(fs::read(&split).unwrap() == good);
    fs::remove_file(&split).unwrap();
    let output = push(&local, &url);
    assert!(
        said(&output).contains("the store keeps its own"),
        "{}",
        said(&output)
    );
    SERVER.ask("DELETE", "/lost-split/a/corpus/splits.json", "");
    let (_mirror, corpus, output) = fetch(&url);
    assert!(said(&output).contains("regenerated"), "{}", said(&output));
    assert!(fs::read(corpus.join("splits.json")).unwrap() == good);
}

/// Gives a scenario detections of the model `abc`, all with this score.
fn detect(corpus: &Path, score: f64) -> PathBuf {
    let corpus = Corpus::open(corpus).unwrap();
    let scenario = corpus.scenarios().unwrap().remove(0);
    let claimed = Claim::take(&corpus, &scenario.id()).unwrap();
    let Claimed::Mine(claim) = claimed else {
        panic!("nobody else is there");
    };
    let source = scenario.open().unwrap();
    let pixel_box = PixelBox {
        cx_px: 30.0,
        cy_px: 30.0,
        width_px: 4.0,
        height_px: 2.0,
    };
    let view = source.record().unwrap().views[0].clone();
    let model = "abc";
    let detector = ModelIdentity {
        model: None,
        model_blake3: format!("{model}{}", "0".repeat(61)),
        profile_blake3: None,
    };
    let found = vec![Detection::untracked(0, view, pixel_box, score, 0)].into();
    let tables = NewTables::unregistered(&found);
    detections::replace(&claim, &source, &detector, model, tables, |provenance| {
        provenance
    })
    .unwrap();
    scenario.detections_path(model)
}

#[test]
fn amazons_own_client_finds_the_files_that_the_manifest_lists() {
    let url = bucket("judged");
    let stage = tempdir().unwrap();
    generate(SERVER.address, &url, stage.path())
        .args(["--only", "1200-clear-r1", "--keep-staged"])
        .succeeds();
    let scenario = stage.path().join("scenarios/1200-clear-r1");
    let manifest = fs::read_to_string(scenario.join("MANIFEST.b3")).unwrap();
    let program = "
import boto3, sys
s3 = boto3.client('s3')
for line in sys.argv[1].splitlines():
    hash, name = line.split('  ')
    stem, ending = name.rsplit('.', 1)
    object = stem + '.' + hash[:32] + '.' + ending
    got = s3.get_object(Bucket='judged', Key='a/corpus/scenarios/1200-clear-r1/' + object)
    assert got['Metadata'] == {'blake3': hash}, got['Metadata']
    assert got['Body'].read() == open(sys.argv[2] + '/' + name, 'rb').read(), name
    print(name)
";
    let mut judge = Command::new(program_of_venv("python"));
    for (name, value) in dtd(SERVER.address).get_envs() {
        if let Some(value) = value {
            judge.env(name, value);
        }
    }
    let judged = judge
        .args(["-c", program, &manifest])
        .arg(&scenario)
        .succeeds();
    assert_eq!(said(&judged).lines().count(), manifest.lines().count());
}

#[test]
fn a_corpus_that_is_no_stage_is_left_alone_and_detections_keep_a_scenario_on_its_stage() {
    let url = bucket("no-stage");
    let (_copy, corpus) = copy_of(&IN_A_FOLDER);
    assert!(push(&corpus, &url).status.success());
    let table = detect(&corpus, 0.5);
    let before = contents(&corpus);
    generate(SERVER.address, &url, &corpus).ends_with(2, &["no stage.json"]);
    assert!(contents(&corpus) == before);

    // Detections made on a stage exist nowhere else.
    let mark = format!("{{\"corpus\": \"{url}\"}}");
    fs::write(corpus.join("stage.json"), mark).unwrap();
    let output = generate(SERVER.address, &url, &corpus).succeeds();
    assert!(said(&output).contains("dtd push"), "{}", said(&output));
    assert!(table.exists());
    assert_eq!(scenarios_on(&corpus), 1);
    assert!(push(&corpus, &url).status.success());
    generate(SERVER.address, &url, &corpus).succeeds();
    assert_eq!(scenarios_on(&corpus), 0);
}

#[test]
fn a_scenario_that_lost_a_file_or_is_not_the_planned_one_is_refused_and_the_others_are_sent() {
    let url = bucket("lost-a-file");
    let (_copy, corpus) = copy_of(&IN_A_FOLDER);
    let ids: Vec<String> = Corpus::open(&corpus)
        .unwrap()
        .scenarios()
        .unwrap()
        .iter()
        .map(|folder| folder.id())
        .collect();
    let folder = |number: usize| corpus.join("scenarios").join(&ids[number]);
    fs::remove_file(folder(0).join("frames.parquet")).unwrap();
    dataset::corpus::seal::seal_folder(&folder(1), "of another corpus").unwrap();
    let output = push(&corpus, &url);
    assert_eq!(output.status.code(), Some(3), "{}", said(&output));
    let outcome = json(&output);
    assert_eq!(number(&outcome, "pushed"), SCENARIOS - 2, "{outcome}");
    let refused = outcome["refused"].to_string();
    for words in [&ids[0], "frames.parquet", &ids[1], "of another corpus"] {
        assert!(refused.contains(words), "no {words} in {refused}");
    }
}

#[test]
fn what_the_store_lost_or_exchanged_stays_on_the_stage_until_it_is_sent_again() {
    let url = bucket("lost");
    let stage = tempdir().unwrap();
    let run = |arguments: &[&str]| {
        generate(SERVER.address, &url, stage.path())
            .args(arguments)
            .succeeds()
    };
    run(&["--keep-staged"]);
    exchange(
        &key_of("lost", ".mp4"),
        &stage.path().join("scenarios/1200-clear-r1"),
    );
    // Only the stage has that video now: it is sent again before it is removed from there.
    let output = run(&[]);
    let message = said(&output);
    assert!(message.contains("damaged in the store"), "{message}");
    assert_eq!(number(&json(&output), "committed"), 1, "{message}");
    assert_eq!(scenarios_on(stage.path()), 0);
    assert_same(&url);
    // With no copy left, it is recorded again.
    lose(&key_of("lost", ".mp4"));
    let planned = dtd(SERVER.address)
        .args(["plan", "tests/data/small.toml", "--json", "--against", &url])
        .current_dir(repository())
        .output()
        .unwrap();
    let against = &json(&planned)["against"];
    assert_eq!(number(against, "whole"), SCENARIOS - 1, "{against}");
    let output = run(&[]);
    assert_eq!(number(&json(&output), "committed"), 1, "{}", said(&output));
    assert_same(&url);
}

#[test]
fn a_damaged_split_or_sweep_of_a_store_is_replaced_from_the_stage_and_never_the_other_way() {
    let (store, stage) = (tempdir().unwrap(), tempdir().unwrap());
    let url = format!("file://{}", text(store.path()));
    let run = || {
        generate(SERVER.address, &url, stage.path())
            .arg("--keep-staged")
            .succeeds();
    };
    run();
    for name in ["splits.json", "corpus.toml"] {
        let whole = fs::read(stage.path().join(name)).unwrap();
        for damaged in [&whole[..whole.len() / 2], &[]] {
            fs::write(store.path().join(name), damaged).unwrap();
            run();
            assert_eq!(fs::read(stage.path().join(name)).unwrap(), whole, "{name}");
            assert_eq!(fs::read(store.path().join(name)).unwrap(), whole, "{name}");
        }
    }
}

#[test]
fn push_sends_what_the_store_lost_and_fetch_says_how() {
    let url = bucket("mended");
    assert!(push(&IN_A_FOLDER, &url).status.success());
    for ending in [".mp4", ".parquet", ".b3", "DONE.json"] {
        let key = key_of("mended", ending);
        match ending {
            "DONE.json" => SERVER.put(&key, "{"),
            ".mp4" => exchange(&key, &IN_A_FOLDER.join("scenarios/1200-clear-r1")),
            _ => lose(&key),
        }
        let (_folder, corpus, output) = fetch(&url);
        let message = said(&output);
        assert_eq!(output.status.code(), Some(3), "{ending}: {message}");
        assert!(message.contains("`dtd push`"), "{ending}: {message}");
        assert!(!corpus.join("scenarios/1200-clear-r1.partial").exists());
        let pushed = json(&push(&IN_A_FOLDER, &url));
        assert_eq!(number(&pushed, "mended"), 1, "{ending}: {pushed}");
        assert_eq!(number(&pushed, "unchanged"), SCENARIOS - 1, "{pushed}");
        assert_same(&url);
    }
}

#[test]
fn credentials_in_a_url_are_not_repeated() {
    let url = "s3://AKIDKEY:SEC/RET@bucket/corpus";
    let out = format!("--out={url}");
    for arguments in [
        vec!["push", "tests", url],
        vec!["fetch", url, "--out", "nowhere"],
        vec!["verify", url],
        vec!["generate", "tests/data/small.toml", &out],
        vec!["label", url],
    ] {
        let message = dtd(SERVER.address)
            .args(&arguments)
            .ends_with(2, &["s3://***@bucket/corpus"]);
        for secret in ["AKIDKEY", "SEC", "RET"] {
            assert!(!message.contains(secret), "{arguments:?}: {message}");
        }
    }
}
