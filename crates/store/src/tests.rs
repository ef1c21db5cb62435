//! Uploading and downloading a scenario, in memory and in a folder.

mod changed_seals;
mod copies;
mod faults;
mod faulty_store;
mod interleavings;
mod lost_objects;
mod places;

use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use dataset::corpus::claim::{Claim, Claimed};
use dataset::corpus::detections::{self, Detection, NewTables};
use dataset::corpus::model_identity::ModelIdentity;
use dataset::corpus::seal::{self, DONE, MANIFEST, seal_folder};
use dataset::corpus::splits::{Leak, Splits};
use dataset::corpus::{Corpus, ScenarioFolder};
use dataset::plan::Plan;
use dataset::tables::pixel_box::PixelBox;
use dataset::work::watch::{Silent, Watch};
use object_store::memory::InMemory;
use object_store::path::Path as ObjectPath;
use object_store::{ObjectStore, ObjectStoreExt};
use tempfile::TempDir;

use super::*;
use crate::client::scenario_file;
use crate::stored::file_name;

const ID: &str = "1200-clear-r1";
/// Name of the detections of the model `abc` in reports.
const MODEL: &str = "1200-clear-r1/abc";
/// Hash of the parameters in `tests/scenario.json`.
const CONFIG_HASH: &str = "985970a59798a068db8bc453403b79e51b260fdbb0b466acfa8fb960a5b84abb";
/// Bytes of a file that is sent in more than one part.
const LARGE: usize = 9 << 20;

/// A corpus with a sealed scenario of a small file and a large one.
fn corpus_with(table: &str) -> (TempDir, Corpus) {
    let folder = tempfile::tempdir().unwrap();
    let corpus = Corpus::create(folder.path()).unwrap();
    let root = corpus.scenario(ID).root().to_owned();
    fs::create_dir_all(root.join("views")).unwrap();
    fs::write(root.join("frames.parquet"), table).unwrap();
    let noise: Vec<u8> = (0..LARGE).map(|i| (i * i / 7) as u8).collect();
    fs::write(root.join("views/left.mp4"), noise).unwrap();
    seal_folder(&root, "config").unwrap();
    (folder, corpus)
}

/// A corpus whose scenario has a record too, which readers of detections need.
fn corpus_with_record() -> (TempDir, Corpus) {
    let (folder, corpus) = corpus_with("table");
    let root = corpus.scenario(ID).root().to_owned();
    let record = include_str!("tests/scenario.json");
    fs::write(root.join("scenario.json"), record).unwrap();
    seal_folder(&root, CONFIG_HASH).unwrap();
    (folder, corpus)
}

fn empty() -> (TempDir, Corpus) {
    let folder = tempfile::tempdir().unwrap();
    let corpus = Corpus::create(folder.path()).unwrap();
    (folder, corpus)
}

const TIMEOUT: Duration = Duration::from_secs(60);

/// A corpus in a store with this client.
fn over(client: Arc<dyn ObjectStore>) -> CorpusStore {
    CorpusStore {
        client,
        root: ObjectPath::from("corpora/small"),
        folder: None,
        name: "memory:///corpora/small".into(),
        timeout: TIMEOUT,
    }
}

fn in_memory() -> CorpusStore {
    over(Arc::new(InMemory::new()))
}

/// A store in memory and one in a folder, which is deleted with the first value.
fn stores() -> (TempDir, [CorpusStore; 2]) {
    let folder = tempfile::tempdir().unwrap();
    let url = format!("file://{}/a bucket", folder.path().display());
    let in_folder = CorpusStore::open(&url.parse().unwrap(), true, TIMEOUT).unwrap();
    (folder, [in_memory(), in_folder])
}

/// A connection without a watch.
fn at(store: &CorpusStore) -> Connection<'_> {
    store.watched(&Silent)
}

fn same_files(a: &ScenarioFolder, b: &ScenarioFolder) {
    for name in ["frames.parquet", "views/left.mp4", MANIFEST, DONE] {
        let [a, b] = [a, b].map(|folder| fs::read(folder.root().join(name)).unwrap());
        assert!(a == b, "{name} differs");
    }
}

async fn push(store: &CorpusStore, corpus: &Corpus) -> Result<Pushed> {
    at(store).push_scenario(&corpus.scenario(ID)).await
}

async fn fetch(store: &CorpusStore, id: &str, corpus: &Corpus) -> Result<Fetched> {
    at(store).fetch_scenario(id, corpus).await
}

async fn push_detections(store: &CorpusStore, folder: &ScenarioFolder) -> MirrorReport {
    let mut report = MirrorReport::default();
    let pushed = at(store).push_detections(folder, &mut report).await;
    pushed.map(|()| report).unwrap()
}

async fn fetch_detections(store: &CorpusStore, folder: &ScenarioFolder) -> MirrorReport {
    let mut report = MirrorReport::default();
    let fetched = at(store).fetch_detections(folder, &mut report).await;
    fetched.map(|()| report).unwrap()
}

/// Splits are files that need no sweep.
struct NoSweeps;

impl SweepLanguage for NoSweeps {
    fn fault(&self, _: &[u8]) -> Option<String> {
        None
    }

    fn other_corpus(&self, _: &[u8], _: &Plan) -> Option<String> {
        None
    }

    fn split(&self, _: &[u8], _: &Plan) -> Option<std::result::Result<Splits, Leak>> {
        None
    }
}

async fn push_all(store: &CorpusStore, corpus: &Corpus) -> MirrorReport {
    let mut report = MirrorReport::default();
    let pushed = at(store).push(corpus, &NoSweeps, &mut report).await;
    pushed.map(|()| report).unwrap()
}

async fn fetch_all(store: &CorpusStore, folder: &Path) -> MirrorReport {
    let mut report = MirrorReport::default();
    let fetched = at(store).fetch(folder, &[], &NoSweeps, &mut report).await;
    fetched.map(|()| report).unwrap()
}

/// A store in memory that has the scenario of this corpus.
async fn pushed() -> (CorpusStore, TempDir, Corpus) {
    let store = in_memory();
    let (folder, ours) = corpus_with("table");
    push(&store, &ours).await.unwrap();
    (store, folder, ours)
}

/// Puts an object into a store.
async fn put(store: &CorpusStore, name: &str, bytes: impl Into<object_store::PutPayload>) {
    let key = store.key(name);
    store.client.put(&key, bytes.into()).await.unwrap();
}

/// The name of a file's object in the corpus.
async fn object_of(store: &CorpusStore, file: &str) -> String {
    let there = at(store).objects(ID).await.unwrap();
    let mut objects = there.0.into_keys();
    let object = objects.find(|object| file_name(object) == file).unwrap();
    scenario_file(ID, &object)
}

/// Puts a scenario into a store as a tool that copies folders does: under the names of the files, without notes.
async fn put_as_before(store: &CorpusStore, id: &str, folder: &ScenarioFolder) {
    let names = [
        "frames.parquet",
        "views/left.mp4",
        "boxes_truth.parquet",
        "scenario.json",
        MANIFEST,
        DONE,
    ];
    for name in names {
        if let Ok(bytes) = fs::read(folder.root().join(name)) {
            put(store, &format!("scenarios/{id}/{name}"), bytes).await;
        }
    }
}

/// The error of fetching a scenario; no part of it may be left in the folder afterwards.
async fn refusal(store: &CorpusStore, id: &str) -> String {
    let (_theirs, theirs) = empty();
    let fetched = fetch(store, id, &theirs).await;
    assert!(theirs.scenarios().unwrap().is_empty());
    fetched.unwrap_err().to_string()
}

/// Fetches the scenario into an empty folder, where it has the files of this corpus.
async fn arrives(store: &CorpusStore, ours: &Corpus) {
    let (_theirs, theirs) = empty();
    let fetched = fetch(store, ID, &theirs).await;
    fetched.unwrap();
    same_files(&ours.scenario(ID), &theirs.scenario(ID));
}

/// Stops a transfer after this many files and parts of files.
struct StopAfter {
    limit: u64,
    asked: AtomicU64,
}

impl Watch for StopAfter {
    fn is_stopped(&self) -> bool {
        self.asked.fetch_add(1, Ordering::Relaxed) >= self.limit
    }
}

fn stop_after(limit: u64) -> StopAfter {
    StopAfter {
        limit,
        asked: AtomicU64::new(0),
    }
}

#[tokio::test]
async fn a_scenario_goes_there_and_comes_back_byte_for_byte() {
    let (_folder, stores) = stores();
    for store in stores {
        let (_ours, ours) = corpus_with("table");
        assert!(at(&store).listing().await.unwrap().committed().is_empty());
        let pushed = push(&store, &ours).await.unwrap();
        assert_eq!(
            pushed,
            Pushed::Committed {
                sent: 2,
                there: 0,
                before: Before::Nothing
            }
        );
        assert_eq!(push(&store, &ours).await.unwrap(), Pushed::Same);
        let committed = at(&store).listing().await.unwrap().committed();
        assert_eq!(committed.into_iter().collect::<Vec<_>>(), [ID]);
        let (_theirs, theirs) = empty();
        let fetch = || fetch(&store, ID, &theirs);
        assert_eq!(
            fetch().await.unwrap(),
            Fetched::Whole {
                brought: 2,
                there: 0
            }
        );
        assert_eq!(fetch().await.unwrap(), Fetched::Same);
        same_files(&ours.scenario(ID), &theirs.scenario(ID));
        assert!(!theirs.partial_scenario(ID).root().exists());
    }
}

#[tokio::test]
async fn an_upload_that_is_stopped_anywhere_commits_all_or_nothing_and_is_gone_on_with() {
    let (_ours, ours) = corpus_with("table");
    for limit in 0.. {
        let store = in_memory();
        let stop = stop_after(limit);
        let connection = store.watched(&stop);
        let pushed = connection.push_scenario(&ours.scenario(ID)).await;
        if pushed.is_ok() {
            assert!(limit > 10, "{limit}");
            break;
        }
        assert!(matches!(pushed, Err(StoreError::Stopped(_))), "{pushed:?}");
        let state = at(&store).state(ID).await.unwrap();
        assert!(!matches!(state, Committed::Damaged(_)), "{state:?}");
        let before = at(&store).objects(ID).await.unwrap().0.len();
        let pushed = push(&store, &ours).await.unwrap();
        match pushed {
            Pushed::Committed { sent, there, .. } => {
                assert_eq!((sent + there, there), (2, before.min(2)), "{limit}");
            }
            pushed => assert_eq!((pushed, before), (Pushed::Same, 4), "{limit}"),
        }
        arrives(&store, &ours).await;
    }
}

#[tokio::test]
async fn a_file_that_is_not_what_was_sealed_is_not_sent() {
    for name in ["frames.parquet", "views/left.mp4"] {
        let store = in_memory();
        let (_ours, ours) = corpus_with("table");
        let path = ours.scenario(ID).root().join(name);
        let mut bytes = fs::read(&path).unwrap();
        bytes[3] ^= 1;
        fs::write(&path, bytes).unwrap();
        let error = push(&store, &ours).await.unwrap_err();
        assert!(matches!(error, StoreError::Damaged { .. }), "{error}");
        assert!(error.to_string().contains(name), "{error}");
        let there = at(&store).objects(ID).await.unwrap();
        assert!(!there.0.keys().any(|object| file_name(object) == name));
        assert!(at(&store).listing().await.unwrap().committed().is_empty());
    }
}

#[tokio::test]
async fn another_recording_is_kept_and_other_parameters_are_refused() {
    let (store, _first, first) = pushed().await;
    let (_second, second) = corpus_with("another table");
    assert_eq!(push(&store, &second).await.unwrap(), Pushed::Other);
    let seal = first.scenario(ID).seal().unwrap().unwrap();
    let state = at(&store).state(ID).await.unwrap();
    assert_eq!(state, Committed::Whole(seal));
    seal_folder(second.scenario(ID).root(), "other config").unwrap();
    let error = push(&store, &second).await.unwrap_err().to_string();
    assert!(error.contains("other parameters"), "{error}");
}

#[tokio::test]
async fn a_mirror_goes_on_where_it_stopped_and_leaves_other_content_alone() {
    let (store, _ours, ours) = pushed().await;
    let (_theirs, theirs) = empty();
    let partial = theirs.partial_scenario(ID).root().to_owned();
    fs::create_dir_all(partial.join("views")).unwrap();
    fs::write(partial.join("frames.parquet"), "table").unwrap();
    fs::write(partial.join("views/left.mp4"), "half").unwrap();
    let fetched = fetch(&store, ID, &theirs).await.unwrap();
    assert_eq!(
        fetched,
        Fetched::Whole {
            brought: 1,
            there: 1
        }
    );
    same_files(&ours.scenario(ID), &theirs.scenario(ID));

    let (_labelled, labelled) = corpus_with("table with labels");
    let fetched = fetch(&store, ID, &labelled).await.unwrap();
    assert_eq!(fetched, Fetched::Other);
    let table = labelled.scenario(ID).root().join("frames.parquet");
    assert_eq!(fs::read(table).unwrap(), b"table with labels");
}

#[tokio::test]
async fn a_manifest_that_names_a_file_outside_or_of_a_seal_is_refused() {
    for (name, words) in [
        ("../../escaped", "outside"),
        ("DONE.json.new", "no file of a scenario"),
    ] {
        refuse_manifest(name, words).await;
    }
}

/// Asserts that a scenario with a file of this name is refused, with these words.
async fn refuse_manifest(name: &str, words: &str) {
    let store = in_memory();
    let manifest = format!("{}  {name}\n", "0".repeat(64));
    let seal = format!(
        "{{\"config_hash\": \"\", \"manifest_blake3\": \"{}\"}}",
        blake3::hash(manifest.as_bytes())
    );
    for (name, text) in [(MANIFEST, manifest), (DONE, seal)] {
        put(&store, &format!("scenarios/{ID}/{name}"), text).await;
    }
    let message = refusal(&store, ID).await;
    assert!(message.contains(words), "{message}");
}

/// A detection of the model `abc`.
fn detection(score: f64) -> Detection {
    let pixel_box = PixelBox::from_edges(28.0, 29.0, 32.0, 31.0);
    Detection::untracked(0, "left", pixel_box, score, 0)
}

/// Gives a claimed scenario this detection as its only one.
fn write_detection(claim: &Claim, folder: &ScenarioFolder, detection: Detection) {
    let source = folder.open().unwrap();
    let detector = ModelIdentity {
        model: None,
        model_blake3: format!("abc{}", "0".repeat(61)),
        profile_blake3: None,
    };
    let record = |provenance| provenance;
    let tables = NewTables {
        detections: &vec![detection].into(),
        // The scenario has one view; a table without rows travels like any other.
        registrations: Some(&[]),
        health: Some(&[]),
        backgrounds: Some(&[]),
    };
    detections::replace(claim, &source, &detector, "abc", tables, record).unwrap();
}

/// Gives the scenario a detection with this score.
fn detect(corpus: &Corpus, score: f64) {
    let Claimed::Mine(claim) = Claim::take(corpus, ID).unwrap() else {
        panic!("nobody else is there");
    };
    write_detection(&claim, &corpus.scenario(ID), detection(score));
}

#[tokio::test]
async fn detections_go_along_and_only_new_ones_are_sent() {
    let (_folder, stores) = stores();
    for store in stores {
        let (_ours, ours) = corpus_with_record();
        push(&store, &ours).await.unwrap();
        detect(&ours, 0.5);
        let folder = ours.scenario(ID);
        for expected in [vec![MODEL], vec![]] {
            assert_eq!(push_detections(&store, &folder).await.detections, expected);
        }
        let (_theirs, theirs) = empty();
        fetch(&store, ID, &theirs).await.unwrap();
        let there = theirs.scenario(ID);
        for expected in [vec![MODEL], vec![]] {
            let fetched = fetch_detections(&store, &there).await;
            assert_eq!(fetched.detections, expected);
        }
        for name in [
            "detections/abc.parquet",
            "detections/abc.json",
            "registrations/abc.parquet",
            "health/abc.parquet",
            "backgrounds/abc.parquet",
        ] {
            let [a, b] =
                [&folder, &there].map(|folder| fs::read(folder.root().join(name)).unwrap());
            assert!(a == b, "{name}");
        }
        assert!(seal::faults(there.root()).unwrap().is_empty());
        // Half of them counts as none.
        store
            .client
            .delete(&store.key(&format!("scenarios/{ID}/detections/abc.json")))
            .await
            .unwrap();
        let (_third, third) = empty();
        fetch(&store, ID, &third).await.unwrap();
        let left = fetch_detections(&store, &third.scenario(ID))
            .await
            .left_detections;
        assert!(left[0].1.contains("their record is missing"), "{left:?}");
        assert!(!third.scenario(ID).detections_path("abc").exists());
    }
}

#[tokio::test]
async fn a_folder_that_is_not_there_is_said_before_it_is_read() {
    let url = format!("file://{}/none", Path::new("/no/such").display());
    let error = CorpusStore::open(&url.parse().unwrap(), false, TIMEOUT).unwrap_err();
    assert!(error.is_bad_input());
    assert!(error.to_string().contains("no such folder"), "{error}");
}

#[tokio::test]
async fn a_fifo_in_a_folder_is_no_object_and_is_not_waited_for() {
    let (_here, corpus) = corpus_with("table");
    let (folder, [_, store]) = stores();
    push(&store, &corpus).await.unwrap();
    let name = object_of(&store, "frames.parquet").await;
    let object = folder.path().join("a bucket").join(name);
    fs::remove_file(&object).unwrap();
    rustix::fs::mknodat(
        rustix::fs::CWD,
        &object,
        rustix::fs::FileType::Fifo,
        rustix::fs::Mode::RUSR | rustix::fs::Mode::WUSR,
        0,
    )
    .unwrap();
    let message = refusal(&store, ID).await;
    assert!(message.contains("frames.parquet is missing"), "{message}");
}

#[tokio::test]
async fn an_interrupted_download_of_detections_resumes_and_replaces_no_other_table() {
    let store = in_memory();
    let (_ours, ours) = corpus_with_record();
    push(&store, &ours).await.unwrap();
    detect(&ours, 0.5);
    let scenario = ours.scenario(ID);
    push_detections(&store, &scenario).await;
    // The record is written last.
    fs::remove_file(detections::record_path(&scenario, "abc")).unwrap();
    let fetched = fetch_detections(&store, &scenario).await;
    assert_eq!(fetched.detections, [MODEL]);
    assert_eq!(
        scenario
            .open()
            .unwrap()
            .detections("abc")
            .unwrap()
            .boxes
            .len(),
        1
    );

    fs::remove_file(detections::record_path(&scenario, "abc")).unwrap();
    let table = scenario.detections_path("abc");
    fs::write(&table, "another table").unwrap();
    let fetched = fetch_detections(&store, &scenario).await;
    assert!(fetched.left_detections[0].1.contains("without its record"));
    assert_eq!(fs::read(&table).unwrap(), b"another table");
}

#[tokio::test]
async fn detections_that_somebody_finished_while_they_were_waited_for_stay() {
    let store = in_memory();
    let (_ours, ours) = corpus_with_record();
    push(&store, &ours).await.unwrap();
    detect(&ours, 0.5);
    push_detections(&store, &ours.scenario(ID)).await;
    let (_theirs, theirs) = empty();
    fetch(&store, ID, &theirs).await.unwrap();
    let there = theirs.scenario(ID);
    // Another process detects there, and finishes while the fetch is waiting.
    let claim = there.claim().unwrap();
    let detecting = async {
        // A store in memory answers at once, so the claim is the only thing to wait for.
        for _ in 0..100 {
            tokio::task::yield_now().await;
        }
        write_detection(&claim, &there, detection(0.9));
        drop(claim);
    };
    let (fetched, ()) = tokio::join!(fetch_detections(&store, &there), detecting);
    assert_eq!(fetched.left_detections.len(), 1, "{fetched:?}");
    let kept = there.open().unwrap().detections("abc").unwrap().boxes;
    assert_eq!(kept, [detection(0.9)]);
}

#[tokio::test]
async fn a_scenario_that_lost_a_file_is_damaged_and_says_which() {
    let store = in_memory();
    let (_ours, ours) = corpus_with("table");
    for name in ["views/left.mp4", MANIFEST] {
        fs::remove_file(ours.scenario(ID).root().join(name)).unwrap();
        let error = push(&store, &ours).await.unwrap_err();
        assert!(matches!(error, StoreError::Damaged { .. }), "{error:?}");
        assert!(error.to_string().contains(name), "{error}");
    }
}

#[tokio::test]
async fn a_scenario_under_another_name_or_of_other_parameters_is_neither_sent_nor_brought() {
    let store = in_memory();
    let (_ours, ours) = corpus_with_record();
    push(&store, &ours).await.unwrap();
    // A copy within the store.
    put_as_before(&store, "copy", &ours.scenario(ID)).await;
    let message = refusal(&store, "copy").await;
    assert!(message.contains("expected \"copy\""), "{message}");
    let (_theirs, theirs) = empty();
    let fetched = fetch(&store, "copy", &theirs).await;
    assert!(fetched.is_err() && !theirs.partial_scenario("copy").root().exists());
    let copy = ours.scenario("copy");
    fs::rename(ours.scenario(ID).root(), copy.root()).unwrap();
    let pushed = at(&store).push_scenario(&copy).await;
    let error = pushed.unwrap_err();
    assert!(matches!(error, StoreError::Damaged { .. }), "{error:?}");
    assert!(error.to_string().contains("expected \"copy\""), "{error}");
}

#[tokio::test]
async fn strangers_in_an_unfinished_folder_never_become_a_part_of_the_scenario() {
    let (store, _ours, ours) = pushed().await;
    let (_theirs, theirs) = empty();
    let partial = theirs.partial_scenario(ID).root().to_owned();
    fs::create_dir_all(partial.join("views")).unwrap();
    // Leftovers of our own verbs are cleared.
    for name in [
        "views/left.mp4",
        "boxes_truth.parquet",
        "DONE.json.new",
        "MANIFEST.b3",
    ] {
        fs::write(partial.join(name), "of another attempt").unwrap();
    }
    for name in ["thesis.tex", "views/photo.jpg", "detections"] {
        match name {
            "detections" => fs::create_dir(partial.join(name)).unwrap(),
            _ => fs::write(partial.join(name), "mine").unwrap(),
        }
        let error = fetch(&store, ID, &theirs).await.unwrap_err();
        assert!(
            error.to_string().contains(&format!("holds {name}")),
            "{error}"
        );
        assert!(theirs.scenarios().unwrap().is_empty());
        match name {
            "detections" => fs::remove_dir(partial.join(name)).unwrap(),
            _ => fs::remove_file(partial.join(name)).unwrap(),
        }
    }
    fetch(&store, ID, &theirs).await.unwrap();
    let folder = theirs.scenario(ID);
    assert_eq!(seal::faults(folder.root()).unwrap(), Vec::<String>::new());
    same_files(&ours.scenario(ID), &folder);
}

#[tokio::test]
async fn a_linked_folder_in_a_store_is_neither_written_through_nor_read() {
    let (_here, corpus) = corpus_with("table");
    let (folder, [_, store]) = stores();
    let outside = tempfile::tempdir().unwrap();
    let scenarios = folder.path().join("a bucket/scenarios");
    fs::create_dir_all(&scenarios).unwrap();
    std::os::unix::fs::symlink(outside.path(), scenarios.join(ID)).unwrap();
    let error = push(&store, &corpus).await.unwrap_err();
    assert!(error.to_string().contains("is a symbolic link"), "{error}");
    assert_eq!(fs::read_dir(outside.path()).unwrap().count(), 0);
    for name in [MANIFEST, DONE] {
        fs::copy(
            corpus.scenario(ID).root().join(name),
            outside.path().join(name),
        )
        .unwrap();
    }
    let message = refusal(&store, ID).await;
    assert!(message.contains("is a symbolic link"), "{message}");
}

#[tokio::test]
async fn a_manifest_larger_than_readers_take_is_not_brought() {
    let store = in_memory();
    let (_ours, ours) = corpus_with("table");
    put_as_before(&store, ID, &ours.scenario(ID)).await;
    let name = format!("scenarios/{ID}/{MANIFEST}");
    put(&store, &name, vec![b'\n'; (16 << 20) + 1]).await;
    let message = refusal(&store, ID).await;
    assert!(message.contains("at most 16777216"), "{message}");
}

#[tokio::test]
async fn stores_that_another_tool_copied_are_read_and_added_to() {
    let (_folder, stores) = stores();
    for store in stores {
        let (_ours, ours) = corpus_with("table");
        put_as_before(&store, ID, &ours.scenario(ID)).await;
        let state = at(&store).state(ID).await.unwrap();
        assert!(matches!(state, Committed::Whole(_)), "{state:?}");
        arrives(&store, &ours).await;
        assert_eq!(push(&store, &ours).await.unwrap(), Pushed::Same);
        // An object that the store lost is sent again, the others are not.
        let table = store.key(&scenario_file(ID, "frames.parquet"));
        store.client.delete(&table).await.unwrap();
        let pushed = push(&store, &ours).await.unwrap();
        let before = Before::Damaged(Fault::missing("frames.parquet").into());
        assert_eq!(
            pushed,
            Pushed::Committed {
                sent: 1,
                there: 1,
                before
            }
        );
        arrives(&store, &ours).await;
    }
}

#[tokio::test]
async fn a_local_scenario_that_lost_a_file_is_not_there_already() {
    let (store, _ours, ours) = pushed().await;
    let video = ours.scenario(ID).root().join("views/left.mp4");
    fs::remove_file(video).unwrap();
    let fetched = fetch(&store, ID, &ours).await;
    let message = fetched.unwrap_err().to_string();
    assert!(message.contains("move it away"), "{message}");
}

#[tokio::test]
async fn names_that_no_folder_can_have_are_listed_as_foreign() {
    let (store, ..) = pushed().await;
    let long = "a".repeat(300);
    for id in [long.as_str(), "thesis.tex"] {
        put(&store, &format!("scenarios/{id}/{DONE}"), "{}").await;
    }
    let listing = at(&store).listing().await.unwrap();
    assert_eq!(listing.committed().into_iter().collect::<Vec<_>>(), [ID]);
    let foreign: Vec<_> = listing.foreign().map(|(id, _)| id).collect();
    assert_eq!(foreign, [long.as_str(), "thesis.tex"]);
    let message = refusal(&store, &long).await;
    assert!(message.contains("at most 200 characters"), "{message}");
}
