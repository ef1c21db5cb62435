//! A `DONE.json` with any changed byte is damaged or says the same, and a whole copy replaces it.

use super::copies::LocalCopy;
use super::interleavings::read_all;
use super::*;

/// A store with a seal of which one byte after the other is changed.
struct Changed<'a> {
    store: CorpusStore,
    copy: &'a LocalCopy,
    done: Vec<u8>,
}

impl<'a> Changed<'a> {
    async fn of(store: CorpusStore, copy: &'a LocalCopy) -> Self {
        let done = at(&store).read(&scenario_file(ID, DONE)).await.unwrap();
        Self {
            done: done.unwrap(),
            store,
            copy,
        }
    }

    async fn change(&self, place: usize) -> String {
        let mut changed = self.done.clone();
        changed[place] ^= 1;
        let text = String::from_utf8_lossy(&changed).into_owned();
        put(&self.store, &scenario_file(ID, DONE), changed).await;
        text
    }

    /// Pushes the copy again; whether it found damage. The store is whole afterwards.
    async fn push_mends(&self, text: &str) -> bool {
        let pushed = push(&self.store, &self.copy.corpus).await.unwrap();
        let seal = read_all(&self.store).await.unwrap();
        assert_eq!(seal.config_hash, self.copy.seal.config_hash, "{text}");
        assert_eq!(seal.manifest_blake3, self.copy.seal.manifest_blake3);
        match pushed {
            Pushed::Committed {
                before: Before::Damaged(_),
                sent: 0,
                ..
            } => true,
            Pushed::Same => false,
            other => panic!("{other:?} for {text}"),
        }
    }
}

#[tokio::test]
async fn a_changed_byte_of_a_seal_is_damage_and_a_whole_copy_replaces_it() {
    let [_, labelled, ..] = LocalCopy::some();
    let store = in_memory();
    assert!(push(&store, &labelled.corpus).await.is_ok());
    let changed = Changed::of(store, &labelled).await;
    let store = &changed.store;
    let mut harmless = 0;
    for place in 0..changed.done.len() {
        let text = changed.change(place).await;
        match at(store).state(ID).await.unwrap() {
            // The name of the checksum was changed, so it is a field of another version.
            Committed::Whole(seal) => {
                harmless += 1;
                assert_eq!(seal, labelled.seal, "{text}");
                assert!(!changed.push_mends(&text).await, "{text}");
            }
            Committed::Damaged(faults) => {
                assert!(faults.0.iter().all(|it| it.file == DONE), "{faults}");
                let (_theirs, theirs) = empty();
                let fetched = fetch(store, ID, &theirs).await;
                let error = fetched.unwrap_err();
                assert!(matches!(error, StoreError::Faulty { .. }), "{error}");
                assert!(changed.push_mends(&text).await, "{text}");
            }
            Committed::No => panic!("not committed: {text}"),
        }
    }
    assert_eq!(harmless, "seal_blake3".len());
}

#[tokio::test]
async fn a_changed_byte_of_a_seal_of_an_earlier_version_is_damage_or_says_the_same() {
    let [plain, ..] = LocalCopy::some();
    let store = in_memory();
    put_as_before(&store, ID, &plain.folder()).await;
    let changed = Changed::of(store, &plain).await;
    for place in 0..changed.done.len() {
        let text = changed.change(place).await;
        let is_mended = changed.push_mends(&text).await;
        let of_parameters = text.contains("config_hash") && !text.contains("\"config\"");
        assert!(is_mended || !of_parameters, "{text}");
    }
}
