//! A bad network and a simulator that restarts in the middle of a scenario: the tables equal an undisturbed run's.

mod small_corpus;

use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use generator::generate::{Cancel, Event, Outcome, SimulatorTarget, generate};
use mock_xplane::server::{Faults, ServerOptions};
use testkit::sweep::{FROM_2_NM, SmallSweep};
use testkit_simulator::{Running, quiet};

/// A scenario that flies live from 2 NM under clouds, two small views.
fn sweep_toml() -> String {
    SmallSweep {
        name: "faults",
        seed: 3,
        weathers: &["cloudy"],
        repeats: 1,
        size_px: (96, 64),
        frame_rate: "1/2",
        tables: &format!(
            "{FROM_2_NM}{}",
            r#"
[weather.cloudy]
visibility_m = 30000
wind_speed_mps = 6
wind_from_true_deg = 60
turbulence_ratio = 0.3
clouds = [{ kind = "cumulus", cover_ratio = 0.5, base_msl_m = 900, top_msl_m = 1500 }]
"#
        ),
    }
    .toml()
}

/// Records the sweep's scenario with a stand-in that has these faults; returns what happened and how often it was started.
async fn made(corpus: &Path, faults: &str) -> (Outcome, usize) {
    let faulty = ServerOptions {
        faults: faults.parse::<Faults>().unwrap(),
        ..quiet()
    };
    let running = Running::start(faulty).await;
    let options = small_corpus::options(SimulatorTarget::Address(running.addresses.udp), &[]);
    let sweep = small_corpus::sweep_of(&sweep_toml());
    let begun = Arc::new(AtomicUsize::new(0));
    let count = begun.clone();
    let mut on_event = move |event: Event<'_>| {
        if matches!(event, Event::Started { .. }) {
            count.fetch_add(1, Ordering::Relaxed);
        }
    };
    let outcome = generate(&sweep, corpus, &options, &Cancel::new(), &mut on_event)
        .await
        .unwrap();
    (outcome, begun.load(Ordering::Relaxed))
}

fn tables(corpus: &Path, id: &str) -> [Vec<u8>; 3] {
    ["frames.parquet", "scenario.json", "calibration.json"]
        .map(|file| fs::read(corpus.join("scenarios").join(id).join(file)).unwrap())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_bad_network_and_a_restart_in_the_middle_change_no_byte_of_the_tables() {
    let [calm, disturbed] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let (undisturbed, begun) = made(calm.path(), "").await;
    assert_eq!(undisturbed.committed.len(), 1, "{undisturbed:?}");
    assert_eq!(begun, 1);

    // The restart comes with the 21st image, some ten ticks into the recording.
    let faults = "loss=0.2,dup=0.1,reorder=0.1,seed=11,restart=captures:21:0.5";
    let (outcome, begun) = made(disturbed.path(), faults).await;
    assert_eq!(outcome.committed, undisturbed.committed, "{outcome:?}");
    assert_eq!(begun, 2, "the scenario is redone once");

    let id = &undisturbed.committed[0];
    let (found, expected) = (tables(disturbed.path(), id), tables(calm.path(), id));
    for (file, (found, expected)) in ["frames.parquet", "scenario.json", "calibration.json"]
        .into_iter()
        .zip(found.into_iter().zip(expected))
    {
        assert!(found == expected, "{file} differs");
    }
}
