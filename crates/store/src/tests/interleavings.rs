//! Properties over random interleavings of uploads, late writes and lost objects.

use std::sync::Arc;

use dataset::corpus::Corpus;
use dataset::corpus::seal::{Seal, SealedFile};
use tokio::task::yield_now;

use super::copies::LocalCopy;
use super::faulty_store::{Faults, FaultyStore, Random};
use super::*;

const ROUNDS: u64 = 2_000;
/// One of so many rounds is downloaded into a folder, which takes longer than the round.
const DOWNLOADED: u64 = 50;

/// Uploads a copy until the store gives an answer.
async fn push_copy(store: &CorpusStore, copy: &LocalCopy) -> Pushed {
    for _ in 0..100 {
        match store.push_scenario(&copy.folder(), None, &UNWATCHED).await {
            Err(error) if error.is_passing() => yield_now().await,
            pushed => return pushed.unwrap(),
        }
    }
    panic!("the store never answers");
}

/// The seal of the scenario, after all its files were read and compared.
pub(super) async fn read_all(store: &CorpusStore) -> std::result::Result<Seal, String> {
    let found = store.found_seal(ID).await.unwrap();
    let stored = found.ok_or("not committed")?.stored;
    let stored = stored.map_err(|fault| fault.to_string())?;
    let there = store.objects(ID).await.unwrap();
    let files = store.their_files(ID, &stored, &there).await.unwrap();
    let files: Vec<SealedFile> = files.map_err(|fault| fault.to_string())?;
    for file in files {
        let (object, _) = there.locate(&file).ok_or(format!("no {}", file.name))?;
        let content = store.read(&scenario_file(ID, &object)).await.unwrap();
        let content = content.ok_or(format!("lost {object}"))?;
        if blake3::hash(&content).to_string() != file.blake3 {
            return Err(format!("{object} has another content"));
        }
    }
    let state = store.committed_state(ID, None).await.unwrap();
    assert_eq!(state, Committed::Whole(stored.seal.clone()));
    Ok(stored.seal)
}

fn copy_with<'a>(copies: &[&'a LocalCopy], seal: &Seal) -> &'a LocalCopy {
    let mut copies = copies.iter();
    copies
        .find(|copy| copy.seal == *seal)
        .expect("a copy that was pushed")
}

/// True if the result of one upload agrees with the final content of the store.
fn is_true(pushed: &Pushed, ours: &LocalCopy, last: &LocalCopy) -> bool {
    let is_same_recording = ours.recording == last.recording;
    match pushed {
        Pushed::Committed { .. } | Pushed::Same => is_same_recording && last.rank >= ours.rank,
        Pushed::Newer | Pushed::Labelled => is_same_recording && last.rank > ours.rank,
        Pushed::OtherRecording => !is_same_recording,
    }
}

fn shaken(seed: u64) -> Faults {
    Faults {
        seed,
        most_turns: 6,
        late_write_of: 8,
        is_conditional: true,
        cuts_content: false,
    }
}

async fn downloaded(store: &CorpusStore) -> Result<Fetched> {
    let folder = tempfile::tempdir().unwrap();
    let corpus = Corpus::create(folder.path()).unwrap();
    let fetched = store.fetch_scenario(ID, &corpus, None, &UNWATCHED).await;
    if let Ok(Fetched::Whole { .. }) = fetched {
        let faults = seal::faults(corpus.scenario(ID).root()).unwrap();
        assert_eq!(faults, Vec::<String>::new());
    }
    fetched
}

#[tokio::test]
async fn whatever_the_order_of_uploads_the_store_is_whole_and_has_the_copy_that_goes_first() {
    let copies = LocalCopy::some();
    for seed in 0..ROUNDS {
        let random = Random::new(seed);
        let pick = || &copies[random.below(copies.len() as u64) as usize];
        let faulty = FaultyStore::new(shaken(seed));
        let store = CorpusStore::over(faulty.clone());
        let picked = [pick(), pick()];
        let pushes = picked.map(|copy| push_copy(&store, copy));
        let [one, other] = pushes;
        let reader = async {
            if seed % DOWNLOADED == 0 {
                match downloaded(&store).await {
                    Ok(_) => {}
                    Err(error) => panic!("{seed}: {error}"),
                }
            }
        };
        let (one, other, ()) = tokio::join!(one, other, reader);
        faulty.settle().await;
        let seal = read_all(&store).await;
        let seal = seal.unwrap_or_else(|fault| panic!("{seed}: {fault}"));
        let last = copy_with(&picked, &seal);
        for (pushed, ours) in [(&one, picked[0]), (&other, picked[1])] {
            assert!(is_true(pushed, ours, last), "{seed}: {one:?} {other:?}");
        }
    }
}

#[tokio::test]
async fn whatever_the_store_loses_meanwhile_pushing_again_makes_it_whole() {
    let copies = LocalCopy::some();
    for seed in 0..ROUNDS {
        let random = Random::new(!seed);
        let pick = || &copies[random.below(3) as usize];
        let faulty = FaultyStore::new(shaken(seed));
        let store = CorpusStore::over(faulty.clone());
        let picked = [pick(), pick()];
        let loses = async {
            for _ in 0..=random.below(3) {
                for _ in 0..random.below(120) {
                    yield_now().await;
                }
                faulty.lose_one(&random).await;
            }
        };
        let [one, other] = picked.map(|copy| push_copy(&store, copy));
        tokio::join!(one, other, loses);
        faulty.settle().await;
        if seed % DOWNLOADED == 0
            && let Err(error) = downloaded(&store).await
        {
            let is_of_store = matches!(error, StoreError::Faulty { .. });
            assert!(is_of_store, "{seed}: {error}");
        }
        for copy in picked {
            push_copy(&store, copy).await;
        }
        faulty.settle().await;
        let seal = read_all(&store).await;
        let seal = seal.unwrap_or_else(|fault| panic!("{seed}: {fault}"));
        let first = picked.map(|copy| copy.rank).into_iter().max();
        assert_eq!(Some(copy_with(&picked, &seal).rank), first, "{seed}");
    }
}

#[tokio::test]
async fn a_store_that_cannot_compare_is_whole_all_the_same() {
    let copies = LocalCopy::some();
    for seed in 0..ROUNDS / 4 {
        let faults = Faults {
            is_conditional: false,
            ..shaken(seed)
        };
        let faulty = FaultyStore::new(faults);
        let store = CorpusStore::over(faulty.clone());
        let [plain, labelled, ..] = &copies;
        tokio::join!(push_copy(&store, plain), push_copy(&store, labelled));
        faulty.settle().await;
        let whole = read_all(&store).await;
        assert!(whole.is_ok(), "{seed}: {whole:?}");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn two_processes_share_a_folder_as_a_store() {
    let copies: Arc<[LocalCopy; 4]> = Arc::new(LocalCopy::some());
    let folder = tempfile::tempdir().unwrap();
    for round in 0..20 {
        let root = folder.path().join(round.to_string());
        let url = format!("file://{}", root.display()).parse().unwrap();
        let ids = BTreeSet::from([ID.to_owned()]);
        let pushes: Vec<_> = (0..3)
            .map(|copy| {
                // Each process opens it for itself.
                let store = CorpusStore::open(&url, true).unwrap();
                let (copies, ids) = (copies.clone(), ids.clone());
                tokio::spawn(async move {
                    store.clear_unfinished(&ids).await.unwrap();
                    let pushed = store
                        .push_scenario(&copies[copy].folder(), None, &UNWATCHED)
                        .await;
                    pushed.map(|pushed| is_true(&pushed, &copies[copy], &copies[2]))
                })
            })
            .collect();
        for pushed in pushes {
            assert!(pushed.await.unwrap().unwrap(), "{round}");
        }
        let store = CorpusStore::open(&url, false).unwrap();
        let seal = read_all(&store).await;
        assert_eq!(seal.as_ref(), Ok(&copies[2].seal), "{round}");
        assert!(!root.join("claims").exists());
    }
}
