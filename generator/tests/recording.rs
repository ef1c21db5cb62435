//! Whole scenarios against the stand-in, over real sockets: made, skipped, stopped, resumed, refused.

use std::fs;
use std::net::Ipv4Addr;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use dataset::corpus::Corpus;
use dataset::verify::verify;
use generator::generate::{
    Cancel, Event, GenerateError, GenerateOptions, Outcome, SimulatorTarget, generate,
};
use generator::sweep::Sweep;
use mock_xplane::server::{ServerOptions, serve};

/// Four small scenarios from 2 NM: two fly live, two fly a recording.
const SWEEP: &str = r#"
[corpus]
name = "test"
seed = 0

[approach]
airport = "WSSS"
runway = "02L"
aircraft = "B737-800"
rig = "pair"

[grid]
times = ["12:00"]
weathers = ["clear", "foggy"]
repeats = 2
day_of_year = 172
utc_offset_h = 8

[picture]
width_px = 96
height_px = 64
frame_rate = "1/2"

[start]
dtd_nm = { min = 1.9, max = 2.1 }
cross_track_m = { mean = 0, sd = 20 }
speed_mps = 72
profiles = ["short"]

[profile.short]
kind = "glide_path"
level_altitude_msl_m = 200

[[recorded]]
files = "flights/01_calm_ils.csv"
weathers = ["foggy"]

[weather.clear]
visibility_m = 30000
wind_speed_mps = 3
wind_from_true_deg = 60

[weather.foggy]
visibility_m = 9260

[[rig.pair.cameras]]
id = "left"
beyond_touchdown_m = 1500
right_m = -300
height_m = 10
inward_deg = 5.3
pitch_deg = 1.6
hfov_deg = 10

[[rig.pair.cameras]]
id = "right"
beyond_touchdown_m = 1500
right_m = 300
height_m = 10
inward_deg = 5.3
pitch_deg = 1.6
hfov_deg = 10
"#;

fn sweep_of(text: &str) -> Sweep {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data");
    Sweep::parse(Path::new("test.toml"), &data, text.to_owned()).unwrap()
}

/// Starts the stand-in in this process; it ends with the test's runtime.
async fn stand_in() -> SimulatorTarget {
    stand_in_that_can_end().await.0
}

/// The same, with a way to make it disappear.
async fn stand_in_that_can_end() -> (SimulatorTarget, tokio::task::AbortHandle) {
    let (tell, told) = tokio::sync::oneshot::channel();
    let options = ServerOptions {
        bind: Ipv4Addr::LOCALHOST.into(),
        port: 0,
        beacon: false,
    };
    let server = tokio::spawn(async move {
        let ready = |addresses: mock_xplane::server::Addresses| tell.send(addresses.udp).unwrap();
        serve(options, ready).await.unwrap();
    });
    (
        SimulatorTarget::Address(told.await.unwrap()),
        server.abort_handle(),
    )
}

async fn run(
    sweep: &Sweep,
    corpus: &Path,
    target: SimulatorTarget,
    only: &[&str],
) -> Result<Outcome, GenerateError> {
    run_until(sweep, corpus, target, only, |_| false).await
}

/// Runs, and stops as soon as an event is the one that is waited for.
async fn run_until(
    sweep: &Sweep,
    corpus: &Path,
    target: SimulatorTarget,
    only: &[&str],
    mut stop_at: impl FnMut(Event<'_>) -> bool + Send,
) -> Result<Outcome, GenerateError> {
    let options = GenerateOptions {
        target,
        stand_in_program: PathBuf::from("unused"),
        only: only.iter().map(|id| (*id).to_owned()).collect(),
    };
    let cancel = Cancel::new();
    let switch = cancel.clone();
    let mut on_event = move |event: Event<'_>| {
        if stop_at(event) {
            switch.cancel();
        }
    };
    generate(sweep, corpus, &options, &cancel, &mut on_event).await
}

fn folders(corpus: &Path) -> Vec<String> {
    let mut names: Vec<String> = fs::read_dir(corpus.join("scenarios"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

const IDS: [&str; 4] = [
    "0001-1200-clear-r1",
    "0002-1200-foggy-r1",
    "0003-1200-clear-r2",
    "0004-1200-foggy-r2",
];

#[tokio::test(flavor = "multi_thread")]
async fn a_sweep_becomes_a_sound_corpus_and_a_second_run_has_nothing_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let sweep = sweep_of(SWEEP);
    let target = stand_in().await;
    let made = run(&sweep, folder.path(), target, &[]).await.unwrap();
    assert_eq!(made.committed, IDS);
    assert_eq!(
        (made.failed.as_slice(), made.interrupted),
        ([].as_slice(), false)
    );
    assert_eq!(folders(folder.path()), IDS);

    let corpus = Corpus::open(folder.path()).unwrap();
    let report = verify(&corpus);
    assert!(report.is_sound(), "{:#?}", report.findings);
    assert_eq!(report.pictures, 2 * report.ticks);
    assert!(report.ticks > 4 * 20, "{} ticks", report.ticks);

    for scenario in corpus.scenarios().unwrap() {
        let (record, frames) = (scenario.record().unwrap(), scenario.frames().unwrap());
        let target = record.touchdown.lat_lon();
        let dtd = |row: usize| target.distance_m(frames.rows[row].pose.position().lat_lon());
        assert!(
            (1.89 * 1_852.0..2.11 * 1_852.0).contains(&dtd(0)),
            "{} starts at {} m",
            record.id,
            dtd(0)
        );
        assert!(
            dtd(frames.rows.len() - 1) < 300.0,
            "{} ends at {} m",
            record.id,
            dtd(frames.rows.len() - 1)
        );
        assert!(record.flight_touchdown.is_some());
    }

    let again = run(&sweep, folder.path(), target, &[]).await.unwrap();
    assert_eq!((again.committed.len(), again.skipped.len()), (0, 4));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stopped_run_is_resumed_and_ends_with_the_same_tables_as_an_undisturbed_one() {
    let [stopped, whole] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let sweep = sweep_of(SWEEP);
    let target = stand_in().await;
    let mut committed = 0;
    let outcome = run_until(&sweep, stopped.path(), target, &[], |event| {
        committed += usize::from(matches!(event, Event::Committed { .. }));
        committed == 1 && matches!(event, Event::Captured { done: 3.. })
    });
    let outcome = outcome.await.unwrap();
    assert!(outcome.interrupted);
    assert_eq!(outcome.committed, IDS[..1]);
    assert_eq!(
        folders(stopped.path()),
        IDS[..1],
        "a stopped scenario leaves nothing"
    );

    // As a killed process would leave it.
    let partial = stopped
        .path()
        .join("scenarios")
        .join(format!("{}.partial", IDS[1]));
    fs::create_dir_all(partial.join("views")).unwrap();
    fs::write(partial.join("views/left.mp4"), "half").unwrap();

    let resumed = run(&sweep, stopped.path(), target, &[]).await.unwrap();
    assert_eq!(
        (resumed.skipped.as_slice(), resumed.committed.len()),
        (&[IDS[0].to_owned()][..], 3)
    );
    run(&sweep, whole.path(), stand_in().await, &[])
        .await
        .unwrap();
    for id in IDS {
        for file in [
            "frames.parquet",
            "calibration.json",
            "scenario.json",
            "views/left.mp4",
            "views/right.mp4",
        ] {
            let [a, b] = [&stopped, &whole]
                .map(|root| fs::read(root.path().join("scenarios").join(id).join(file)).unwrap());
            assert!(a == b, "{id}/{file} differs");
        }
    }
    assert_eq!(folders(stopped.path()), IDS);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_corpus_takes_more_repeats_but_no_other_plan() {
    let folder = tempfile::tempdir().unwrap();
    let target = stand_in().await;
    let one = SWEEP
        .replace(
            "weathers = [\"clear\", \"foggy\"]\nrepeats = 2",
            "weathers = [\"clear\"]\nrepeats = 1",
        )
        .replace(
            "[[recorded]]\nfiles = \"flights/01_calm_ils.csv\"\nweathers = [\"foggy\"]\n",
            "",
        );
    run(&sweep_of(&one), folder.path(), target, &[])
        .await
        .unwrap();
    let plan = fs::read(folder.path().join("plan.json")).unwrap();

    let other = sweep_of(&one.replace("visibility_m = 30000", "visibility_m = 20000"));
    let error = run(&other, folder.path(), target, &[]).await.unwrap_err();
    assert!(error.is_bad_input(), "{error}");
    assert!(
        error
            .to_string()
            .contains("visibility_m was 30000.0, now is 20000.0"),
        "{error}"
    );
    assert_eq!(
        fs::read(folder.path().join("plan.json")).unwrap(),
        plan,
        "the frozen plan was touched"
    );

    let more = sweep_of(&one.replace("repeats = 1", "repeats = 2"));
    let outcome = run(&more, folder.path(), target, &["0002-1200-clear-r2"])
        .await
        .unwrap();
    assert_eq!(
        (outcome.committed.as_slice(), outcome.skipped.len()),
        (&["0002-1200-clear-r2".to_owned()][..], 0)
    );
    assert!(verify(&Corpus::open(folder.path()).unwrap()).is_sound());
}

#[tokio::test(flavor = "multi_thread")]
async fn what_cannot_begin_is_said_at_once_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let corpus = folder.path().join("corpus");
    let sweep = sweep_of(SWEEP);

    // A port that was free a moment ago.
    let nobody = std::net::UdpSocket::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap();
    let began = Instant::now();
    let error = run(&sweep, &corpus, SimulatorTarget::Address(nobody), &[])
        .await
        .unwrap_err();
    assert!(
        began.elapsed() < Duration::from_secs(6),
        "{:?}",
        began.elapsed()
    );
    assert!(
        matches!(error, GenerateError::Bridge(_)) && !error.is_bad_input(),
        "{error}"
    );
    assert!(!corpus.exists());

    let error = run(
        &sweep,
        &corpus,
        SimulatorTarget::Address(nobody),
        &["0099-nowhere"],
    )
    .await
    .unwrap_err();
    assert!(
        error.is_bad_input() && error.to_string().contains("0001-1200-clear-r1"),
        "{error}"
    );
    assert!(!corpus.exists());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_simulator_that_goes_away_costs_scenarios_but_not_the_corpus() {
    let folder = tempfile::tempdir().unwrap();
    let sweep = sweep_of(SWEEP);
    let (target, server) = stand_in_that_can_end().await;
    let outcome = run_until(&sweep, folder.path(), target, &IDS[..1], |event| {
        if matches!(event, Event::Captured { done: 5 }) {
            server.abort();
        }
        false
    });
    let outcome = outcome.await.unwrap();
    assert_eq!(outcome.failed.len(), 1);
    assert_eq!(outcome.failed[0].id, IDS[0]);
    assert!(!outcome.failed[0].reason.is_empty());
    assert_eq!(folders(folder.path()), Vec::<String>::new());
}
