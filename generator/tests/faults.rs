//! Faults during a long run: simulators that die, freeze or are several, scenarios that a second process holds or no simulator can fly.
//! Whatever happens, the corpus ends with the bytes of an undisturbed run. Kills, signals and runs at once: `tests/durability.rs`.

mod small_corpus;

use std::fs::{self, File};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::Duration;

use airframe::AircraftType;
use dataset::conditions::Weather;
use dataset::geometry::pose::{Controls, FlightState, Pose};
use generator::generate::{Event, Patience, Remote, SimulatorTarget, Simulators, Stopped};
use generator::sweep::Sweep;
use mock_xplane::server::{
    BuiltIn, Engine, Instants, NotFlown, OtherAircraft, SceneRenderer, SceneSetting,
};
use store::CorpusStore;
use tempfile::tempdir;
use tokio::sync::OnceCell;
use xplane_bridge::fly::FlyRequest;

use small_corpus::{
    IDS, folders, options, run, run_until, same_tables, small_sweep, sorted_ids, stand_in,
    stand_in_with, sweep_of, sweep_toml,
};

/// Records a new corpus without faults.
async fn make_corpus(corpus: &Path) {
    let made = run(small_sweep(), corpus, stand_in().await, &[]);
    assert_eq!(made.await.unwrap().committed, IDS);
}

/// The corpus without faults that all tests compare theirs with.
async fn undisturbed() -> &'static Path {
    static MADE: OnceCell<PathBuf> = OnceCell::const_new();
    let make = || async {
        let corpus = Path::new(env!("CARGO_TARGET_TMPDIR")).join("undisturbed");
        let _ = fs::remove_dir_all(&corpus);
        make_corpus(&corpus).await;
        corpus
    };
    MADE.get_or_init(make).await
}

/// Asserts that a run reported an earlier failure of one scenario.
fn assert_tried_again(warnings: &[String], id: &str) {
    let mut tried = warnings.iter().filter(|line| line.contains("tried again"));
    let line = tried.next().unwrap();
    assert!(
        line.starts_with(id) && line.contains("lost in the fog"),
        "{line}"
    );
    assert_eq!(tried.next(), None);
}

async fn two_stand_ins() -> Simulators {
    vec![stand_in().await, stand_in().await].into()
}

#[tokio::test(flavor = "multi_thread")]
async fn two_simulators_share_the_work_and_the_tables_do_not_tell_which() {
    let corpus = tempdir().unwrap();
    let mut at_once = 0;
    let mut most_at_once = 0;
    let options = options(two_stand_ins().await, &[]);
    let made = run_until(small_sweep(), corpus.path(), &options, |event| {
        match event {
            Event::Started { .. } => at_once += 1,
            Event::Committed { .. } => at_once -= 1,
            _ => {}
        }
        most_at_once = most_at_once.max(at_once);
        false
    });
    assert_eq!(made.await.unwrap().committed, IDS);
    assert_eq!(most_at_once, 2);
    same_tables(corpus.path(), undisturbed().await);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_simulator_that_dies_leaves_its_work_to_the_others() {
    let corpus = tempdir().unwrap();
    let (dying, server) = stand_in_with(Arc::new(BuiltIn)).await;
    let both = vec![SimulatorTarget::Address(dying), stand_in().await];
    let mut options = options(both, &[]);
    options.patience.simulator = Duration::from_millis(50);
    // On a busy machine it may accept a second connection before it is dead, which costs its scenario one more attempt.
    options.patience.attempts = 4;
    let mut gone = Vec::new();
    let made = run_until(small_sweep(), corpus.path(), &options, |event| {
        match event {
            Event::Captured { done: 3, .. } => server.abort(),
            Event::Warned(line) if line.starts_with("giving up") => gone.push(line.to_owned()),
            _ => {}
        }
        false
    });
    let made = made.await.unwrap();
    assert_eq!((made.committed.len(), made.stopped), (4, None));
    let [line] = &gone[..] else {
        panic!("{gone:?}")
    };
    assert!(line.contains(&dying.to_string()), "{line}");
    same_tables(corpus.path(), undisturbed().await);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_simulator_that_is_gone_for_good_ends_the_run_early_and_the_next_one_goes_on() {
    let corpus = tempdir().unwrap();
    let (address, server) = stand_in_with(Arc::new(BuiltIn)).await;
    let mut options = options(SimulatorTarget::Address(address), &[]);
    options.patience.simulator = Duration::from_millis(50);
    let stopped = run_until(small_sweep(), corpus.path(), &options, |event| {
        if matches!(event, Event::Captured { done: 5, .. }) {
            server.abort();
        }
        false
    });
    let stopped = stopped.await.unwrap();
    assert!(
        matches!(&stopped.stopped, Some(Stopped::NoSimulator { reason }) if reason.contains(&address.to_string())),
        "{stopped:?}"
    );
    assert_eq!(
        (stopped.failed.as_slice(), stopped.not_made.len()),
        (&[][..], 4)
    );
    assert_eq!(folders(corpus.path()), Vec::<String>::new());
    assert!(!corpus.path().join("failed").exists());

    run(small_sweep(), corpus.path(), stand_in().await, &[])
        .await
        .unwrap();
    same_tables(corpus.path(), undisturbed().await);
}

/// The built-in engine with faults that can be switched.
#[derive(Default)]
struct Faulty {
    /// Flights in fog are refused.
    lost_in_fog: AtomicBool,
    /// Number of images before the one that takes a long time.
    freeze_in: AtomicU32,
}

struct FaultyEngine(Arc<Faulty>);

impl Engine for FaultyEngine {
    fn fly(
        &self,
        request: &FlyRequest,
        aircraft: &AircraftType,
        weather: &Weather,
    ) -> Result<Vec<FlightState>, NotFlown> {
        if weather.visibility_m < 10_000.0 && self.0.lost_in_fog.load(Ordering::SeqCst) {
            return Err(NotFlown::Because("lost in the fog"));
        }
        BuiltIn.fly(request, aircraft, weather)
    }

    fn prepare(&self, scene: &SceneSetting<'_>) -> Box<dyn SceneRenderer> {
        Box::new(FaultyPicture {
            faults: self.0.clone(),
            picture: BuiltIn.prepare(scene),
        })
    }
}

struct FaultyPicture {
    faults: Arc<Faulty>,
    picture: Box<dyn SceneRenderer>,
}

impl SceneRenderer for FaultyPicture {
    fn draw(
        &self,
        first: (&Pose, &Controls),
        others: &[OtherAircraft],
        instants: Instants,
        rgb: &mut [u8],
    ) {
        let left = &self.faults.freeze_in;
        let down = |left: u32| left.checked_sub(1);
        if left.fetch_update(Ordering::SeqCst, Ordering::SeqCst, down) == Ok(1) {
            std::thread::sleep(Duration::from_millis(1_500));
        }
        self.picture.draw(first, others, instants, rgb);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_simulator_that_freezes_is_noticed_and_its_scenario_made_again() {
    let corpus = tempdir().unwrap();
    let faults = Arc::new(Faulty::default());
    faults.freeze_in.store(60, Ordering::SeqCst);
    let (address, _) = stand_in_with(Arc::new(FaultyEngine(faults))).await;
    let mut options = options(SimulatorTarget::Address(address), &[]);
    options.patience.answer = Duration::from_millis(500);
    let mut reasons = Vec::new();
    let made = run_until(small_sweep(), corpus.path(), &options, |event| {
        if let Event::Retrying { reason, .. } = event {
            reasons.push(reason.to_owned());
        }
        false
    });
    assert_eq!(made.await.unwrap().committed, IDS);
    assert!(
        reasons.len() == 1 && reasons[0].contains("frozen"),
        "{reasons:?}"
    );
    same_tables(corpus.path(), undisturbed().await);
}

/// A sweep whose last flight a simulator loses in the fog.
async fn lost_in_fog() -> (Sweep, Arc<Faulty>, SocketAddr) {
    let sweep = sweep_of(&sweep_toml().replace(
        "weathers = [\"foggy\"]\n\n[weather",
        "repeats = [1]\n\n[weather",
    ));
    let faults = Arc::new(Faulty::default());
    faults.lost_in_fog.store(true, Ordering::SeqCst);
    let (address, _) = stand_in_with(Arc::new(FaultyEngine(faults.clone()))).await;
    (sweep, faults, address)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_scenario_that_can_never_be_flown_is_set_aside_after_one_attempt_and_tried_by_the_next_run()
 {
    let corpus = tempdir().unwrap();
    let (sweep, faults, address) = lost_in_fog().await;
    let options = options(SimulatorTarget::Address(address), &[]);
    let foggy = IDS[3];

    let first = run_until(&sweep, corpus.path(), &options, |_| false);
    let first = first.await.unwrap();
    assert_eq!(first.committed, IDS[..3]);
    assert_eq!((first.failed.len(), first.stopped), (1, None));
    assert_eq!(first.failed[0].id, foggy);
    assert!(first.failed[0].reason.contains("lost in the fog"));
    let record = corpus.path().join("failed").join(format!("{foggy}.json"));
    let text = fs::read_to_string(&record).unwrap();
    assert_eq!(text.matches("lost in the fog").count(), 1, "{text}");

    faults.lost_in_fog.store(false, Ordering::SeqCst);
    let mut before = Vec::new();
    let second = run_until(&sweep, corpus.path(), &options, |event| {
        if let Event::Warned(line) = event {
            before.push(line.to_owned());
        }
        false
    });
    assert_eq!(second.await.unwrap().committed, [foggy]);
    assert_tried_again(&before, foggy);
    assert!(!record.exists());
    assert_eq!(folders(corpus.path()), sorted_ids());
}

#[tokio::test(flavor = "multi_thread")]
async fn why_a_scenario_failed_is_in_the_store_until_it_is_made_from_whatever_stage() {
    let (sweep, faults, address) = lost_in_fog().await;
    let bucket = tempdir().unwrap();
    let url = format!("file://{}", bucket.path().display());
    let foggy = IDS[3];
    let only_foggy = {
        let mut options = options(SimulatorTarget::Address(address), &[foggy]);
        options.remote = Some(Remote {
            store: CorpusStore::open(&url.parse().unwrap(), true, Duration::from_secs(60)).unwrap(),
            keep_staged: false,
        });
        options
    };
    let record = bucket.path().join("failed").join(format!("{foggy}.json"));
    let reasons = || {
        let text = fs::read_to_string(&record).unwrap();
        text.matches("lost in the fog").count()
    };

    let stage = tempdir().unwrap();
    let first = run_until(&sweep, stage.path(), &only_foggy, |_| false);
    assert_eq!(first.await.unwrap().failed.len(), 1);
    assert_eq!(reasons(), 1);

    // A second machine reads it, and adds its own reasons.
    let elsewhere = tempdir().unwrap();
    let mut before = Vec::new();
    let second = run_until(&sweep, elsewhere.path(), &only_foggy, |event| {
        if let Event::Warned(line) = event {
            before.push(line.to_owned());
        }
        false
    });
    assert_eq!(second.await.unwrap().failed.len(), 1);
    assert_tried_again(&before, foggy);
    assert_eq!(reasons(), 2);

    faults.lost_in_fog.store(false, Ordering::SeqCst);
    let third = run_until(&sweep, stage.path(), &only_foggy, |_| false);
    assert_eq!(third.await.unwrap().committed, [foggy]);
    assert!(!record.exists());

    // A run that was killed between the last file and the record leaves one, which the next run removes.
    fs::create_dir_all(record.parent().unwrap()).unwrap();
    fs::write(&record, "{}").unwrap();
    let fourth = run_until(&sweep, stage.path(), &only_foggy, |_| false);
    assert_eq!(fourth.await.unwrap().skipped, [foggy]);
    assert!(!record.exists());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_run_waits_for_what_another_process_makes_and_takes_over_what_it_lets_go() {
    let corpus = tempdir().unwrap();
    let claims = corpus.path().join("claims");
    fs::create_dir_all(&claims).unwrap();
    let path = claims.join(IDS[2]);
    fs::write(&path, r#"{"host": "elsewhere", "pid": 7}"#).unwrap();
    let mut theirs = Some(File::open(&path).unwrap());
    theirs.as_ref().unwrap().lock().unwrap();

    let mut waited_for = None;
    let options = options(stand_in().await, &[]);
    let made = run_until(small_sweep(), corpus.path(), &options, |event| {
        if let Event::Said(line) = event
            && line.starts_with("waiting for")
        {
            waited_for = Some(line.to_owned());
            // As if the other process had been killed.
            theirs.take();
        }
        false
    });
    assert_eq!(made.await.unwrap().committed, IDS);
    let expected = "waiting for 1 scenario that others make (process 7 on elsewhere)";
    assert_eq!(waited_for.as_deref(), Some(expected));
    same_tables(corpus.path(), undisturbed().await);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_scenario_killed_between_seal_and_renaming_is_not_made_again_unless_it_was_damaged() {
    let corpus = tempdir().unwrap();
    make_corpus(corpus.path()).await;
    let scenarios = corpus.path().join("scenarios");
    for id in &IDS[..2] {
        fs::rename(scenarios.join(id), scenarios.join(format!("{id}.partial"))).unwrap();
    }
    let damaged = scenarios.join(format!("{}.partial/views/left.mp4", IDS[1]));
    fs::write(&damaged, "half").unwrap();
    let mut captured = Vec::new();
    let options = options(stand_in().await, &[]);
    let made = run_until(small_sweep(), corpus.path(), &options, |event| {
        if let Event::Captured { done: 1, id } = event {
            captured.push(id.to_owned());
        }
        false
    });
    assert_eq!(made.await.unwrap().committed, IDS[..2]);
    assert_eq!(captured, IDS[1..2]);
    same_tables(corpus.path(), undisturbed().await);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_whole_scenario_whose_table_was_damaged_is_refused_by_name() {
    let corpus = tempdir().unwrap();
    make_corpus(corpus.path()).await;
    let table = format!("scenarios/{}/frames.parquet", IDS[1]);
    fs::write(corpus.path().join(&table), "not a table").unwrap();
    let outcome = run(small_sweep(), corpus.path(), stand_in().await, &[])
        .await
        .unwrap();
    let [failed] = &outcome.failed[..] else {
        panic!("{outcome:?}");
    };
    assert_eq!(failed.id, IDS[1]);
    assert!(
        failed.reason.contains("frames.parquet"),
        "{}",
        failed.reason
    );
}

#[test]
fn the_defaults_wait_long_enough_for_a_simulator_to_be_started_again() {
    let patience = Patience::default();
    assert!(patience.simulator >= Duration::from_secs(120) && patience.attempts >= 2);
}
