//! Properties over random interleavings of uploads, late writes and lost objects.

use std::thread;

use dataset::corpus::seal::Seal;
use tokio::task::yield_now;

use super::copies::LocalCopy;
use super::faulty_store::{Faults, FaultyStore, Random};
use super::*;

const ROUNDS: u64 = 2_000;
/// Every fiftieth round is downloaded into a folder, which takes longer than the round.
const DOWNLOADED: u64 = 50;

async fn push_copy(store: &CorpusStore, copy: &LocalCopy) -> Pushed {
    push(store, &copy.corpus).await.unwrap()
}

/// Pushes a copy; an unlabelled one may be refused, where it would remove labels.
async fn push_or_refuse(store: &CorpusStore, copy: &LocalCopy) {
    let pushed = push(store, &copy.corpus).await;
    let is_refused = !copy.is_labelled && matches!(pushed, Err(StoreError::Damaged { .. }));
    assert!(is_refused || pushed.is_ok(), "{pushed:?}");
}

/// The seal of the scenario, after all its files were read and compared.
pub(super) async fn read_all(store: &CorpusStore) -> std::result::Result<Seal, String> {
    let connection = at(store);
    let found = connection.found_seal(ID).await.unwrap();
    let stored = found.ok_or("not committed")?.stored;
    let stored = stored.map_err(|fault| fault.to_string())?;
    let there = connection.objects(ID).await.unwrap();
    let manifest = connection.manifest(ID, &stored, &there).await.unwrap();
    let (_, files) = manifest.map_err(|fault| fault.to_string())?;
    for file in files {
        let (object, _) = there.locate(&file).ok_or(format!("no {}", file.name))?;
        let content = connection.read(&scenario_file(ID, &object)).await.unwrap();
        let content = content.ok_or(format!("lost {object}"))?;
        if blake3::hash(&content).to_string() != file.blake3 {
            return Err(format!("{object} has another content"));
        }
    }
    let state = connection.state(ID).await.unwrap();
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
    let is_labelled_since =
        ours.recording == last.recording && last.is_labelled && !ours.is_labelled;
    match pushed {
        Pushed::Committed { .. } | Pushed::Same => ours.seal == last.seal || is_labelled_since,
        Pushed::Labelled => is_labelled_since,
        Pushed::Other => ours.seal != last.seal,
    }
}

fn shaken(seed: u64) -> Faults {
    Faults {
        seed,
        most_turns: 6,
        late_write_of: 8,
        ..Faults::NONE
    }
}

async fn downloaded(store: &CorpusStore) -> Result<Fetched> {
    let folder = tempfile::tempdir().unwrap();
    let corpus = Corpus::create(folder.path()).unwrap();
    let fetched = fetch(store, ID, &corpus).await;
    if let Ok(Fetched::Whole { .. }) = fetched {
        let faults = seal::faults(corpus.scenario(ID).root()).unwrap();
        assert_eq!(faults, Vec::<String>::new());
    }
    fetched
}

#[tokio::test(start_paused = true)]
async fn whatever_the_order_of_uploads_the_store_is_whole_and_their_results_are_true() {
    let copies = LocalCopy::some();
    for seed in 0..ROUNDS {
        let random = Random::new(seed);
        let pick = || &copies[random.below(copies.len() as u64) as usize];
        let faulty = FaultyStore::new(shaken(seed));
        let store = over(faulty.clone());
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

#[tokio::test(start_paused = true)]
async fn whatever_the_store_loses_meanwhile_pushing_again_makes_it_whole() {
    let copies = LocalCopy::some();
    for seed in 0..ROUNDS {
        let random = Random::new(!seed);
        let pick = || &copies[random.below(3) as usize];
        let faulty = FaultyStore::new(shaken(seed));
        let store = over(faulty.clone());
        let picked = [pick(), pick()];
        let loses = async {
            for _ in 0..=random.below(3) {
                for _ in 0..random.below(120) {
                    yield_now().await;
                }
                faulty.lose_one(&random).await;
            }
        };
        let [one, other] = picked.map(|copy| push_or_refuse(&store, copy));
        tokio::join!(one, other, loses);
        faulty.settle().await;
        if seed % DOWNLOADED == 0
            && let Err(error) = downloaded(&store).await
        {
            let is_of_store = matches!(error, StoreError::Faulty { .. });
            assert!(is_of_store, "{seed}: {error}");
        }
        for copy in picked {
            push_or_refuse(&store, copy).await;
        }
        faulty.settle().await;
        let seal = read_all(&store).await;
        let seal = seal.unwrap_or_else(|fault| panic!("{seed}: {fault}"));
        let has_labels = picked.iter().any(|copy| copy.is_labelled);
        assert_eq!(copy_with(&picked, &seal).is_labelled, has_labels, "{seed}");
    }
}

#[tokio::test(start_paused = true)]
async fn a_store_that_cannot_compare_is_whole_all_the_same() {
    let copies = LocalCopy::some();
    for seed in 0..ROUNDS / 4 {
        let faults = Faults {
            is_conditional: false,
            ..shaken(seed)
        };
        let faulty = FaultyStore::new(faults);
        let store = over(faulty.clone());
        let [plain, labelled, ..] = &copies;
        tokio::join!(push_copy(&store, plain), push_copy(&store, labelled));
        faulty.settle().await;
        let whole = read_all(&store).await;
        assert!(whole.is_ok(), "{seed}: {whole:?}");
    }
}

#[test]
fn two_processes_share_a_folder_as_a_store() {
    let copies = LocalCopy::some();
    let folder = tempfile::tempdir().unwrap();
    let runtime = || {
        let mut builder = tokio::runtime::Builder::new_current_thread();
        builder.enable_all().build().unwrap()
    };
    for round in 0..20 {
        let root = folder.path().join(round.to_string());
        let url = format!("file://{}", root.display()).parse().unwrap();
        let push_one = |copy: &LocalCopy| {
            runtime().block_on(async {
                // Each process opens it for itself.
                let store = CorpusStore::open(&url, true, TIMEOUT).unwrap();
                push_copy(&store, copy).await
            })
        };
        let results = thread::scope(|scope| {
            let pushes = [&copies[0], &copies[1]].map(|copy| scope.spawn(move || push_one(copy)));
            pushes.map(|push| push.join().unwrap())
        });
        let store = CorpusStore::open(&url, false, TIMEOUT).unwrap();
        let seal = runtime().block_on(read_all(&store)).unwrap();
        assert_eq!(seal, copies[1].seal, "{round}");
        for (pushed, ours) in results.iter().zip(&copies) {
            assert!(is_true(pushed, ours, &copies[1]), "{round}: {pushed:?}");
        }
        assert!(!root.join("claims").exists());
    }
}
