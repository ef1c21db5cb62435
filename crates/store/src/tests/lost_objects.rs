//! Objects that a store lost are detected by one listing, and sent again.

use super::copies::LocalCopy;
use super::faulty_store::{Faults, FaultyStore};
use super::interleavings::read_all;
use super::*;
use object_store::PutOptions;

/// The files of a labelled copy, and the seal.
const FILES: [&str; 5] = [
    "frames.parquet",
    "boxes_truth.parquet",
    "views/left.mp4",
    MANIFEST,
    DONE,
];

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Loss {
    Deleted,
    Emptied,
    Cut,
    Flipped,
    /// Replaced by other bytes of the same size, with the metadata kept.
    Exchanged,
}

pub(super) async fn lose(store: &CorpusStore, file: &str, loss: Loss) {
    let name = object_of(store, file).await;
    let mut bytes = at(store).read(&name).await.unwrap().unwrap();
    let mut options = PutOptions::default();
    match loss {
        Loss::Deleted => return store.client.delete(&store.key(&name)).await.unwrap(),
        Loss::Emptied => bytes.clear(),
        Loss::Cut => bytes.truncate(bytes.len() / 2),
        Loss::Flipped => bytes[0] ^= 1,
        Loss::Exchanged => {
            options.attributes = store.attributes(&seal::hash_bytes(&bytes));
            bytes.fill(b'x');
        }
    }
    store.put(&name, &bytes, options).await.unwrap();
}

#[tokio::test]
async fn what_the_store_lost_is_sent_again_by_every_whole_copy() {
    let (_folder, stores) = stores();
    let [_, labelled, ..] = LocalCopy::some();
    for store in stores {
        assert!(push(&store, &labelled.corpus).await.is_ok());
        for file in FILES {
            for loss in [
                Loss::Deleted,
                Loss::Emptied,
                Loss::Cut,
                Loss::Flipped,
                Loss::Exchanged,
            ] {
                lose(&store, file, loss).await;
                let state = at(&store).state(ID).await.unwrap();
                assert!(
                    !matches!(state, Committed::Whole(_)),
                    "{file} {loss:?}: {state:?}"
                );
                if state != Committed::No {
                    let message = refusal(&store, ID).await;
                    assert!(message.contains(file), "{file} {loss:?}: {message}");
                }
                let pushed = push(&store, &labelled.corpus).await.unwrap();
                let Pushed::Committed { before, .. } = &pushed else {
                    panic!("{file} {loss:?}: {pushed:?}");
                };
                let is_said = match before {
                    Before::Damaged(faults) => faults.0.iter().any(|it| it.file == file),
                    before => *before == Before::Nothing && file == DONE && loss == Loss::Deleted,
                };
                assert!(is_said, "{file} {loss:?}: {before:?}");
                let (_theirs, theirs) = empty();
                fetch(&store, ID, &theirs).await.unwrap();
                assert_eq!(
                    seal::faults(theirs.scenario(ID).root()).unwrap(),
                    Vec::<String>::new()
                );
            }
        }
    }
}

#[tokio::test]
async fn a_damaged_copy_is_replaced_by_a_whole_one_and_an_unlabelled_one_by_labels() {
    let [plain, labelled, relabelled, other] = LocalCopy::some();
    let store = in_memory();
    assert!(push(&store, &labelled.corpus).await.is_ok());
    assert_eq!(push(&store, &plain.corpus).await.unwrap(), Pushed::Labelled);
    let is_mended = |pushed: Pushed| match pushed {
        Pushed::Committed { before, .. } => matches!(before, Before::Damaged(_)),
        _ => false,
    };
    // An unlabelled copy gives back a video and takes no labels.
    lose(&store, "views/left.mp4", Loss::Deleted).await;
    assert!(is_mended(push(&store, &plain.corpus).await.unwrap()));
    let whole = |copy: &LocalCopy| Committed::Whole(copy.seal.clone());
    assert_eq!(at(&store).state(ID).await.unwrap(), whole(&labelled));
    lose(&store, "boxes_truth.parquet", Loss::Deleted).await;
    for (copy, words) in [
        (&plain, "it has no labels"),
        (&other, "it is a different recording"),
    ] {
        let error = push(&store, &copy.corpus).await.unwrap_err();
        assert!(error.is_of_scenario() && error.to_string().contains(words));
    }
    assert!(is_mended(push(&store, &relabelled.corpus).await.unwrap()));
    assert_eq!(at(&store).state(ID).await.unwrap(), whole(&relabelled));
    lose(&store, DONE, Loss::Deleted).await;
    assert!(push(&store, &plain.corpus).await.is_ok());
    // A damaged labelled copy replaces nothing.
    let [_, damaged, ..] = LocalCopy::some();
    let table = damaged.folder().root().join("frames.parquet");
    fs::write(table, "damaged").unwrap();
    let refused = push(&store, &damaged.corpus).await.unwrap_err();
    assert!(refused.to_string().contains("frames.parquet"), "{refused}");
    // Only the lost table is sent: the others are still there.
    let pushed = push(&store, &labelled.corpus).await.unwrap();
    let expected = Pushed::Committed {
        sent: 1,
        there: 2,
        before: Before::Unlabelled,
    };
    assert_eq!(pushed, expected);
}

#[tokio::test]
async fn what_a_killed_upload_left_is_read_before_it_is_noted() {
    let (_folder, stores) = stores();
    let [_, labelled, ..] = LocalCopy::some();
    for store in stores {
        assert!(push(&store, &labelled.corpus).await.is_ok());
        for file in &FILES[..4] {
            lose(&store, file, Loss::Exchanged).await;
            lose(&store, DONE, Loss::Deleted).await;
            assert!(push(&store, &labelled.corpus).await.is_ok());
            let read = read_all(&store).await;
            assert_eq!(read.as_ref(), Ok(&labelled.seal), "{file}");
        }
    }
}

#[tokio::test]
async fn a_complete_scenario_costs_one_read_and_one_listing() {
    let [_, labelled, ..] = LocalCopy::some();
    let faulty = FaultyStore::new(Faults::NONE);
    let store = over(faulty.clone());
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
    // Four objects and the seal, with a listing before, between and after.
    assert!(push(&store, &labelled.corpus).await.is_ok());
    assert_eq!(count(), [3, 0, 2, 5]);
    assert_eq!(push(&store, &labelled.corpus).await.unwrap(), Pushed::Same);
    assert_eq!(count(), [1, 0, 1, 0]);
    let states = at(&store).states([ID.to_owned()]).await.unwrap();
    assert!(matches!(states[ID], Committed::Whole(_)));
    // With the listing of the scenarios.
    assert_eq!(count(), [2, 0, 1, 0]);
}

#[tokio::test(start_paused = true)]
async fn a_store_that_cuts_every_file_at_half_ends_a_download() {
    let [plain, ..] = LocalCopy::some();
    let faulty = FaultyStore::new(Faults {
        cuts_content: true,
        ..Faults::NONE
    });
    let store = over(faulty);
    assert!(push(&store, &plain.corpus).await.is_ok());
    let (_theirs, theirs) = empty();
    let fetched = fetch(&store, ID, &theirs).await;
    let error = fetched.unwrap_err();
    assert!(error.is_passing(), "{error}");
    assert!(error.to_string().contains("503"), "{error}");
}
