//! Objects that a store lost are detected by one listing, and sent again.

use super::copies::LocalCopy;
use super::faulty_store::{Faults, FaultyStore};
use super::*;

/// The files of a labelled copy, and the seal.
const FILES: [&str; 5] = [
    "frames.parquet",
    "boxes_truth.parquet",
    "views/left.mp4",
    MANIFEST,
    DONE,
];

#[derive(Debug, Clone, Copy, PartialEq)]
enum Loss {
    Deleted,
    Flipped,
    Cut,
}

async fn lose(store: &CorpusStore, file: &str, loss: Loss) {
    let name = object_of(store, file).await;
    let mut bytes = store.read(&name).await.unwrap().unwrap();
    match loss {
        Loss::Deleted => return store.store.delete(&store.key(&name)).await.unwrap(),
        Loss::Flipped => bytes[0] ^= 1,
        Loss::Cut => bytes.truncate(bytes.len() / 2),
    }
    put(store, &name, bytes).await;
}

#[tokio::test]
async fn what_the_store_lost_is_sent_again_by_every_whole_copy() {
    let (_folder, stores) = stores();
    let [_, labelled, ..] = LocalCopy::some();
    for store in stores {
        assert!(push(&store, &labelled.corpus).await.is_ok());
        for file in FILES {
            for loss in [Loss::Deleted, Loss::Flipped, Loss::Cut] {
                lose(&store, file, loss).await;
                let state = store.committed_state(ID, None).await.unwrap();
                assert!(
                    !matches!(state, Committed::Whole(_)),
                    "{file} {loss:?}: {state:?}"
                );
                let pushed = push(&store, &labelled.corpus).await.unwrap();
                let Pushed::Committed { before, .. } = &pushed else {
                    panic!("{file} {loss:?}: {pushed:?}");
                };
                let is_said = match before {
                    Before::Damaged(faults) => faults.0.iter().any(|it| it.file() == file),
                    before => *before == Before::Nothing && file == DONE && loss == Loss::Deleted,
                };
                assert!(is_said, "{file} {loss:?}: {before:?}");
                let (_theirs, theirs) = empty();
                store
                    .fetch_scenario(ID, &theirs, None, &UNWATCHED)
                    .await
                    .unwrap();
                assert_eq!(
                    seal::faults(theirs.scenario(ID).root()).unwrap(),
                    Vec::<String>::new()
                );
            }
        }
    }
}

#[tokio::test]
async fn an_unlabelled_copy_gives_back_a_video_and_takes_no_labels() {
    let [plain, labelled, ..] = LocalCopy::some();
    let faulty = FaultyStore::new(Faults::NONE);
    let store = CorpusStore::over(faulty.clone());
    assert!(push(&store, &labelled.corpus).await.is_ok());
    lose(&store, "views/left.mp4", Loss::Deleted).await;
    assert_eq!(push(&store, &plain.corpus).await.unwrap(), Pushed::Labelled);
    // The seal notes the new object, so its hash need not be looked up.
    faulty.requests.heads.store(0, Ordering::Relaxed);
    let state = store.committed_state(ID, None).await.unwrap();
    assert_eq!(state, Committed::Whole(labelled.seal.clone()));
    assert_eq!(faulty.requests.heads.load(Ordering::Relaxed), 0);
    // The labelled copy's additional file is gone: a whole copy goes before a damaged one, whatever its labels.
    lose(&store, "boxes_truth.parquet", Loss::Deleted).await;
    let pushed = push(&store, &plain.corpus).await.unwrap();
    assert!(matches!(
        pushed,
        Pushed::Committed {
            before: Before::Damaged(_),
            ..
        }
    ));
    let pushed = push(&store, &labelled.corpus).await.unwrap();
    assert!(matches!(
        pushed,
        Pushed::Committed {
            before: Before::Other,
            sent: 0 | 1,
            ..
        }
    ));
}

#[tokio::test]
async fn a_mended_seal_of_an_earlier_version_is_no_newer_than_before() {
    let [_, first, second, _] = LocalCopy::some();
    let store = CorpusStore::in_memory();
    put_as_before(&store, ID, &second.folder()).await;
    let sealed_ms = async || {
        let found = store.found_seal(ID).await.unwrap().unwrap();
        crate::scenario::unix_ms(found.sealed())
    };
    let before = sealed_ms().await;
    lose(&store, "views/left.mp4", Loss::Deleted).await;
    tokio::time::sleep(std::time::Duration::from_millis(5)).await;
    assert_eq!(push(&store, &first.corpus).await.unwrap(), Pushed::Newer);
    assert_eq!(sealed_ms().await, before);
    let state = store.committed_state(ID, None).await.unwrap();
    assert_eq!(state, Committed::Whole(second.seal.clone()));
}

#[tokio::test]
async fn a_complete_scenario_costs_one_read_and_no_listing_of_its_own() {
    let [_, labelled, ..] = LocalCopy::some();
    let faulty = FaultyStore::new(Faults::NONE);
    let store = CorpusStore::over(faulty.clone());
    let count = || {
        let requests = &faulty.requests;
        [
            &requests.lists,
            &requests.heads,
            &requests.gets,
            &requests.puts,
        ]
        .map(|counter| counter.swap(0, Ordering::Relaxed))
    };
    // As a run does right after the recording: four objects and the seal; then one listing confirms them.
    let nothing = Objects::default();
    let folder = labelled.folder();
    let pushed = store
        .push_scenario(&folder, Some(&nothing), &UNWATCHED)
        .await;
    // The manifest is not counted as a file.
    let expected = Pushed::Committed {
        sent: 3,
        there: 0,
        before: Before::Nothing,
    };
    assert_eq!(pushed.unwrap(), expected);
    assert_eq!(count(), [1, 0, 2, 5]);
    let listing = store.listing().await.unwrap();
    assert_eq!(count(), [1, 0, 0, 0]);
    let seen = listing.of(ID);
    let pushed = store.push_scenario(&folder, Some(&seen), &UNWATCHED).await;
    assert_eq!(pushed.unwrap(), Pushed::Same);
    assert_eq!(count(), [0, 0, 1, 0]);
    let states = store.states(&listing, [ID.to_owned()]).await.unwrap();
    assert!(matches!(states[ID], Committed::Whole(_)));
    assert_eq!(count(), [0, 0, 1, 0]);
}

#[tokio::test]
async fn a_store_that_cuts_every_file_at_half_ends_a_download() {
    let [plain, ..] = LocalCopy::some();
    let faulty = FaultyStore::new(Faults {
        cuts_content: true,
        ..Faults::NONE
    });
    let store = CorpusStore::over(faulty);
    assert!(push(&store, &plain.corpus).await.is_ok());
    let (_theirs, theirs) = empty();
    let patience = Patience(std::time::Duration::from_millis(600));
    let transfer = Transfer::new(&Silent);
    let fetched = patience
        .with(&transfer, async || {
            store.fetch_scenario(ID, &theirs, None, &transfer).await
        })
        .await;
    let error = fetched.unwrap_err();
    assert!(error.is_passing(), "{error}");
    assert!(error.to_string().contains("503"), "{error}");
}
