//! Faults of stores and of what they hold: each transfer ends within its timeout, and with a remedy that works.

use super::copies::LocalCopy;
use super::faulty_store::{Faults, FaultyStore};
use super::lost_objects::{Loss, lose};
use super::*;
use crate::corpus_files::CorpusFiles;
use object_store::local::LocalFileSystem;
use tokio::time::Instant;

/// A store whose content is kept apart, so that others can be put in front of it.
fn behind(inner: &Arc<InMemory>, faults: Faults) -> CorpusStore {
    over(FaultyStore::over(inner.clone(), faults))
}

const RECORD: &str = "detections/abc.json";
const SPLIT: &str =
    r#"{"by": "trajectory", "scenarios": {"a": {"trajectory": "x", "side": "train"}}}"#;

#[tokio::test(start_paused = true)]
async fn a_gateway_that_confirms_writes_and_keeps_nothing_ends_an_upload_in_time() {
    let (_ours, ours) = corpus_with_record();
    fs::write(ours.splits_path(), SPLIT).unwrap();
    detect(&ours, 0.5);
    for dropped in ["", "frames", "DONE.json", "splits.json", "abc.json"] {
        let faulty = FaultyStore::new(Faults {
            drops: Some(dropped),
            ..Faults::NONE
        });
        let mut store = over(faulty.clone());
        store.timeout = Duration::from_secs(5);
        let began = Instant::now();
        let mut report = MirrorReport::default();
        let pushed = at(&store).push(&ours, &NoSweeps, &mut report).await;
        let error = pushed.expect_err(dropped).to_string();
        assert!(
            began.elapsed() <= store.timeout,
            "{dropped}: {:?}",
            began.elapsed()
        );
        let puts = faulty.requests.puts.load(Ordering::Relaxed);
        assert!(puts < 50, "{dropped}: {puts}");
        for words in [
            "confirmed",
            "connect to the store itself",
            "run the same command again",
        ] {
            assert!(error.contains(words), "{dropped}: no {words:?} in {error}");
        }
    }
}

#[tokio::test(start_paused = true)]
async fn a_storm_of_503_is_waited_for_and_an_outage_ends_in_time() {
    let (_ours, ours) = corpus_with_record();
    detect(&ours, 0.5);
    for seed in 0..20 {
        let inner = Arc::new(InMemory::new());
        let store = behind(
            &inner,
            Faults {
                seed,
                unavailable_of: 10,
                ..Faults::NONE
            },
        );
        let report = push_all(&store, &ours).await;
        assert_eq!(
            (report.moved, report.detections.len()),
            (vec![ID.to_owned()], 1)
        );
        let folder = tempfile::tempdir().unwrap();
        let report = fetch_all(&store, folder.path()).await;
        assert_eq!(
            (report.moved, report.detections.len()),
            (vec![ID.to_owned()], 1)
        );
        let away = behind(
            &inner,
            Faults {
                unavailable_of: 1,
                ..Faults::NONE
            },
        );
        let began = Instant::now();
        let error = push(&away, &ours).await.unwrap_err();
        assert!(error.is_passing(), "{error}");
        assert!(began.elapsed() <= TIMEOUT);
    }
}

#[tokio::test(start_paused = true)]
async fn the_timeout_begins_anew_after_an_attempt_that_gets_further_than_all_before() {
    let store = in_memory();
    let cases: [(&[usize], usize); 5] = [
        (&[], 1),
        (&[5], 2),
        (&[5, 7], 3),
        (&[7, 7], 2),
        (&[7, 5, 9], 2),
    ];
    for (bytes, attempts) in cases {
        let connection = at(&store);
        let mut made = 0;
        // Every attempt takes as long as the timeout, and then breaks off.
        let asked = connection.ask(async || {
            connection.passed(bytes.get(made).copied().unwrap_or(0));
            made += 1;
            tokio::time::sleep(TIMEOUT).await;
            Err::<(), _>(store.away("read it", "503"))
        });
        assert!(asked.await.unwrap_err().is_passing());
        assert_eq!(made, attempts, "{bytes:?}");
    }
}

#[tokio::test]
async fn a_stray_key_is_named_at_once_with_a_remedy() {
    let store = over(FaultyStore::new(Faults {
        has_stray_key: true,
        ..Faults::NONE
    }));
    let error = at(&store).listing().await.unwrap_err();
    assert!(error.is_bad_input());
    let message = error.to_string();
    for words in ["a//b", "delete-object", "run the same command again"] {
        assert!(message.contains(words), "no {words:?} in {message}");
    }
}

#[tokio::test]
async fn a_store_without_conditions_and_a_folder_without_hard_links_are_written() {
    let folder = tempfile::tempdir().unwrap();
    let files = LocalFileSystem::new_with_prefix(folder.path()).unwrap();
    // Creating a file that must be new takes a hard link there.
    let faults = Faults {
        is_conditional: false,
        ..Faults::NONE
    };
    let mut in_folder = over(FaultyStore::over(Arc::new(files), faults));
    in_folder.folder = Some(folder.path().to_owned());
    in_folder.root = ObjectPath::default();
    let (_ours, ours) = corpus_with_record();
    fs::write(ours.splits_path(), SPLIT).unwrap();
    detect(&ours, 0.5);
    for store in [in_folder, over(FaultyStore::new(faults))] {
        let report = push_all(&store, &ours).await;
        assert_eq!(
            (report.moved, report.refused),
            (vec![ID.to_owned()], vec![])
        );
        assert!(report.left_detections.is_empty());
        arrives(&store, &ours).await;
    }
}

#[tokio::test]
async fn a_changed_record_of_detections_shows_and_is_sent_again() {
    let (_folder, stores) = stores();
    for store in stores {
        let (_ours, ours) = corpus_with_record();
        detect(&ours, 0.5);
        push(&store, &ours).await.unwrap();
        let folder = ours.scenario(ID);
        push_detections(&store, &folder).await;
        let name = scenario_file(ID, "detections/abc.json");
        let whole = at(&store).read(&name).await.unwrap().unwrap();
        let digit = whole.iter().position(u8::is_ascii_digit).unwrap();
        for changed in [digit, whole.len() / 2] {
            let mut flipped = whole.clone();
            flipped[changed] ^= 1;
            put(&store, &name, flipped).await;
            let (_theirs, theirs) = empty();
            fetch(&store, ID, &theirs).await.unwrap();
            let there = theirs.scenario(ID);
            let fetched = fetch_detections(&store, &there).await;
            assert!(
                fetched.left_detections[0].1.contains("`dtd push`"),
                "{fetched:?}"
            );
            assert!(!there.detections_path("abc").exists());
            let pushed = push_detections(&store, &folder).await;
            assert_eq!(pushed.mended_detections, [MODEL], "{pushed:?}");
            let fetched = fetch_detections(&store, &there).await;
            assert_eq!(fetched.detections, [MODEL], "{fetched:?}");
        }
    }
}

#[tokio::test]
async fn different_detections_stay_on_both_sides_unless_the_stores_are_damaged() {
    let store = in_memory();
    let (_ours, ours) = corpus_with_record();
    let (_others, others) = corpus_with_record();
    detect(&ours, 0.5);
    detect(&others, 0.75);
    push(&store, &ours).await.unwrap();
    push_detections(&store, &ours.scenario(ID)).await;
    for left in [
        push_detections(&store, &others.scenario(ID)).await,
        fetch_detections(&store, &others.scenario(ID)).await,
    ] {
        assert!(left.detections.is_empty(), "{left:?}");
        assert!(
            left.left_detections[0]
                .1
                .contains("the store has different ones"),
            "{left:?}"
        );
    }
    let table = object_of(&store, "detections/abc.parquet").await;
    store.client.delete(&store.key(&table)).await.unwrap();
    let (_theirs, theirs) = empty();
    fetch(&store, ID, &theirs).await.unwrap();
    let left = fetch_detections(&store, &theirs.scenario(ID)).await;
    assert!(left.left_detections[0].1.contains("`dtd push`"), "{left:?}");
    let pushed = push_detections(&store, &ours.scenario(ID)).await;
    assert_eq!(pushed.mended_detections, [MODEL]);
    // Damaged locally: not uploaded, and repaired from the store.
    let local = ours.scenario(ID).detections_path("abc");
    let whole = fs::read(&local).unwrap();
    fs::write(&local, "damaged").unwrap();
    let left = push_detections(&store, &ours.scenario(ID)).await;
    assert!(
        left.left_detections[0].1.contains("hash differs"),
        "{left:?}"
    );
    let fetched = fetch_detections(&store, &ours.scenario(ID)).await;
    assert_eq!(fetched.mended_detections, [MODEL]);
    assert_eq!(fs::read(&local).unwrap(), whole);
    store.client.delete(&store.key(&table)).await.unwrap();
    let pushed = push_detections(&store, &others.scenario(ID)).await;
    assert_eq!(pushed.replaced_detections, [MODEL]);
    assert!(
        at(&store)
            .has_detections_of(&others.scenario(ID))
            .await
            .unwrap()
    );
}

#[tokio::test]
async fn exchanged_detections_are_not_taken_for_a_copy_of_the_local_ones_and_sent_again() {
    let store = in_memory();
    let (_ours, ours) = corpus_with_record();
    detect(&ours, 0.5);
    push(&store, &ours).await.unwrap();
    let folder = ours.scenario(ID);
    push_detections(&store, &folder).await;
    assert!(at(&store).has_detections_of(&folder).await.unwrap());
    lose(&store, "detections/abc.parquet", Loss::Exchanged).await;
    assert!(!at(&store).has_detections_of(&folder).await.unwrap());
    let pushed = push_detections(&store, &folder).await;
    assert_eq!(pushed.mended_detections, [MODEL]);
    assert!(at(&store).has_detections_of(&folder).await.unwrap());
}

#[tokio::test]
async fn a_record_of_detections_without_its_copy_gets_one() {
    let store = in_memory();
    let (_ours, ours) = corpus_with_record();
    detect(&ours, 0.5);
    push(&store, &ours).await.unwrap();
    let folder = ours.scenario(ID);
    push_detections(&store, &folder).await;
    let objects = async || at(&store).objects(ID).await.unwrap().0.into_keys();
    let is_copy = |name: &String| file_name(name) == RECORD && name != RECORD;
    let copy = objects().await.find(is_copy).unwrap();
    let key = store.key(&scenario_file(ID, &copy));
    store.client.delete(&key).await.unwrap();
    for expected in [vec![MODEL], vec![]] {
        let pushed = push_detections(&store, &folder).await;
        assert_eq!(pushed.mended_detections, expected);
        assert!(objects().await.any(|name| name == copy));
    }
}

#[tokio::test]
async fn an_object_that_rotted_in_place_is_named_and_sent_again_once_it_is_deleted() {
    let inner = Arc::new(InMemory::new());
    let store = behind(&inner, Faults::NONE);
    let [_, labelled, ..] = LocalCopy::some();
    push(&store, &labelled.corpus).await.unwrap();
    let object = object_of(&store, "views/left.mp4").await;
    let rotten = behind(
        &inner,
        Faults {
            rots: Some("left"),
            ..Faults::NONE
        },
    );
    // Size and ETag are right, so only a reader notices.
    assert_eq!(push(&rotten, &labelled.corpus).await.unwrap(), Pushed::Same);
    let message = refusal(&rotten, ID).await;
    let advice = format!("delete {}/{object}", store.name());
    assert!(message.contains(&advice), "{message}");
    store.client.delete(&store.key(&object)).await.unwrap();
    let pushed = push(&store, &labelled.corpus).await.unwrap();
    assert!(
        matches!(pushed, Pushed::Committed { sent: 1, .. }),
        "{pushed:?}"
    );
    let (_theirs, theirs) = empty();
    fetch(&store, ID, &theirs).await.unwrap();
}

#[tokio::test]
async fn one_damaged_scenario_stops_no_other() {
    let (store, _ours, ours) = pushed().await;
    // Neither a seal nor a manifest that is usable, and a name that no folder can have.
    for (id, done) in [
        ("broken", "{"),
        (
            "lost",
            "{\"config_hash\": \"\", \"manifest_blake3\": \"0\"}",
        ),
    ] {
        put(&store, &format!("scenarios/{id}/{DONE}"), done).await;
    }
    put(
        &store,
        &format!("scenarios/{}/{DONE}", "a".repeat(300)),
        "{}",
    )
    .await;
    let folder = tempfile::tempdir().unwrap();
    let report = fetch_all(&store, folder.path()).await;
    assert_eq!(report.moved, [ID]);
    let refused: Vec<&str> = report
        .refused
        .iter()
        .map(|(what, _)| what.as_str())
        .collect();
    assert_eq!(refused[1..], [Corpus::PLAN, "broken", "lost"]);
    let done = folder.path().join("scenarios").join(ID).join(DONE);
    fs::write(done, "{").unwrap();
    let report = fetch_all(&store, folder.path()).await;
    assert!(report.refused.iter().any(|(what, _)| what == ID));
    // In the folder alike.
    let copy = ours.scenario("copy");
    fs::create_dir_all(copy.root()).unwrap();
    fs::write(copy.root().join(DONE), "{").unwrap();
    fs::write(copy.root().join(MANIFEST), "").unwrap();
    let report = push_all(&store, &ours).await;
    assert_eq!(
        (report.unchanged, report.refused.len()),
        (vec![ID.to_owned()], 1)
    );
}

#[tokio::test(start_paused = true)]
async fn of_two_processes_that_write_the_files_of_the_corpus_one_is_first() {
    for seed in 0..200 {
        let faults = Faults {
            seed,
            most_turns: 6,
            late_write_of: 8,
            ..Faults::NONE
        };
        let faulty = FaultyStore::new(faults);
        let store = over(faulty.clone());
        let files = ["train", "test"].map(|side| {
            let content = SPLIT.replace("train", side).into_bytes();
            let files = CorpusFiles::parse([(Corpus::SPLITS, content)].into(), &NoSweeps);
            files.ok().unwrap()
        });
        let (one, other) = (at(&store), at(&store));
        let (first, second) = tokio::join!(
            one.settle(&files[0], &NoSweeps),
            other.settle(&files[1], &NoSweeps)
        );
        faulty.settle().await;
        let there = at(&store).read(Corpus::SPLITS).await.unwrap();
        let is_there = files
            .each_ref()
            .map(|files| files.contents.get(Corpus::SPLITS) == there.as_ref());
        assert_eq!([first.is_ok(), second.is_ok()], is_there, "{seed}");
    }
}
