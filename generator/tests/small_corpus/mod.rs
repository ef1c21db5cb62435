//! A sweep of four small scenarios, simulators in this process to record them, and helpers to run and compare.
#![allow(
    dead_code,
    missing_docs,
    unreachable_pub,
    reason = "each test file uses a part of it"
)]

use std::fs;
use std::net::SocketAddr;
use std::path::Path;
use std::sync::{Arc, LazyLock};
use std::time::Duration;

use generator::generate::{
    Cancel, Event, GenerateError, GenerateOptions, Outcome, Patience, SimulatorTarget, Simulators,
    generate,
};
use generator::sweep::Sweep;
use mock_xplane::server::Engine;
use testkit::repository;
use testkit::sweep::{FROM_2_NM, SmallSweep};
use testkit_simulator::{quiet, serving, serving_with};
use tokio::task::AbortHandle;

/// Four small scenarios from 2 NM: two fly live, two fly a recording.
pub fn sweep_toml() -> String {
    SmallSweep {
        name: "test",
        seed: 0,
        weathers: &["clear", "foggy"],
        repeats: 2,
        size_px: (96, 64),
        frame_rate: "1/2",
        tables: &format!(
            "{FROM_2_NM}{}",
            r#"
[[recorded]]
files = "flights/01_calm_ils.csv"
weathers = ["foggy"]

[weather.clear]
visibility_m = 30000
wind_speed_mps = 3
wind_from_true_deg = 60

[weather.foggy]
visibility_m = 9260
"#
        ),
    }
    .toml()
}

pub fn sweep_of(text: &str) -> Sweep {
    let data = repository().join("tests/data");
    Sweep::parse(Path::new("test.toml"), &data, text.to_owned()).unwrap()
}

pub fn small_sweep() -> &'static Sweep {
    static READ: LazyLock<Sweep> = LazyLock::new(|| sweep_of(&sweep_toml()));
    &READ
}

pub const IDS: [&str; 4] = [
    "1200-clear-r1",
    "1200-foggy-r1",
    "1200-clear-r2",
    "1200-foggy-r2",
];

/// The identifiers in the order of a listing.
pub fn sorted_ids() -> [&'static str; 4] {
    let mut ids = IDS;
    ids.sort_unstable();
    ids
}

/// Starts the stand-in in this process; it ends with the test's runtime.
pub async fn stand_in() -> SimulatorTarget {
    SimulatorTarget::Address(serving(quiet()).await)
}

/// Starts the stand-in with an engine; aborting the handle makes it disappear.
pub async fn stand_in_with(engine: Arc<dyn Engine>) -> (SocketAddr, AbortHandle) {
    let (addresses, server) = serving_with(quiet(), engine).await;
    (addresses.udp, server)
}

/// Options with short timeouts, so that failures show at once.
pub fn options(simulators: impl Into<Simulators>, only: &[&str]) -> GenerateOptions {
    GenerateOptions {
        only: only.iter().map(|id| (*id).to_owned()).collect(),
        patience: Patience {
            attempts: 2,
            first_pause: Duration::from_millis(10),
            simulator: Duration::from_secs(20),
            ..Patience::default()
        },
        ..GenerateOptions::new(simulators)
    }
}

pub async fn run(
    sweep: &Sweep,
    corpus: &Path,
    target: SimulatorTarget,
    only: &[&str],
) -> Result<Outcome, GenerateError> {
    run_until(sweep, corpus, &options(target, only), |_| false).await
}

/// Runs until `stop_at` is true for an event.
pub async fn run_until(
    sweep: &Sweep,
    corpus: &Path,
    options: &GenerateOptions,
    mut stop_at: impl FnMut(Event<'_>) -> bool + Send,
) -> Result<Outcome, GenerateError> {
    let cancel = Cancel::new();
    let switch = cancel.clone();
    let mut on_event = move |event: Event<'_>| {
        if stop_at(event) {
            switch.cancel();
        }
    };
    generate(sweep, corpus, options, &cancel, &mut on_event).await
}

/// Names of the scenarios' folders.
pub fn folders(corpus: &Path) -> Vec<String> {
    let mut names: Vec<String> = fs::read_dir(corpus.join("scenarios"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

/// Asserts that every file of every scenario has the same bytes in both corpora, and that neither contains anything else.
pub fn same_tables(one: &Path, other: &Path) {
    for corpus in [one, other] {
        assert_eq!(folders(corpus), sorted_ids());
        for left in ["claims", "failed"] {
            assert!(!corpus.join(left).exists(), "{left} is left");
        }
    }
    for id in IDS {
        for file in [
            "frames.parquet",
            "calibration.json",
            "scenario.json",
            "views/left.mp4",
            "views/right.mp4",
            "MANIFEST.b3",
            "DONE.json",
        ] {
            let [a, b] = [one, other]
                .map(|root| fs::read(root.join("scenarios").join(id).join(file)).unwrap());
            assert!(a == b, "{id}/{file} differs");
        }
    }
}
