//! Scenarios recorded through the plugin's own Python: a recorded flight gives the same as the built-in link, live ones are valid.

mod small_corpus;

use std::path::Path;
use std::time::Duration;

use dataset::corpus::Corpus;
use dataset::corpus::scenario::Flight;
use dataset::tables::frames::TickRow;
use dataset::video::VideoReader;
use generator::generate::{Cancel, Event, GenerateOptions, SimulatorTarget, Stopped, generate};
use generator::sweep::Sweep;
use mock_xplane::server::{LinkServer, ServerOptions};
use testkit::repository;
use testkit::sweep::{SmallSweep, starting_from};
use testkit_simulator::{plugin, quiet, serving};
use verify::verify;
use xplane_bridge::Simulator;
use xplane_bridge::datarefs::Generation;
use xplane_bridge::doctor::{DoctorOptions, examine};
use xplane_bridge::profile::{Finding, KnownProfile, PacedBy, Profile};

/// A recorded flight from 1.5 NM, an image every four seconds.
fn sweep_toml() -> String {
    SmallSweep {
        name: "plugin",
        seed: 0,
        weathers: &["clear"],
        repeats: 1,
        size_px: (96, 64),
        frame_rate: "1/4",
        tables: &(starting_from(1.5, 1.5, 200)
            + r#"
[[recorded]]
files = "flights/01_calm_ils.csv"
weathers = ["clear"]

[weather.clear]
visibility_m = 30000
"#),
    }
    .toml()
}

/// Two live flights from 1.5 NM, one after the other in the same simulator: the second finds the autopilot as the first left it.
fn live_sweep_toml() -> String {
    SmallSweep {
        name: "plugin-live",
        seed: 3,
        weathers: &["clear"],
        repeats: 2,
        size_px: (64, 64),
        frame_rate: "1/4",
        tables: &(starting_from(1.5, 1.6, 150)
            + r#"
[weather.clear]
visibility_m = 30000
wind_speed_mps = 3
wind_from_true_deg = 60
"#),
    }
    .toml()
}

/// Maximum mean difference between images of the same pose, of 255.
const MEAN_LEVELS_APART: f64 = 0.25;

async fn stand_in(link: LinkServer) -> SimulatorTarget {
    let options = ServerOptions {
        generation: Generation::XPlane11,
        link,
        ..quiet()
    };
    let address = serving(options).await;
    // Python takes a while to start on a busy machine.
    let waiting = Simulator::connect(address, Duration::from_secs(60)).await;
    waiting.unwrap().release().await.unwrap();
    SimulatorTarget::Address(address)
}

/// Records scenarios; returns how many simulators had a profile.
async fn record(
    folder: &Path,
    target: SimulatorTarget,
    sweep: String,
    scenarios: usize,
    profiles: usize,
) -> Corpus {
    let data = repository().join("tests/data");
    let sweep = Sweep::parse(Path::new("test.toml"), &data, sweep).unwrap();
    let options = GenerateOptions::new(target);
    let mut told = Vec::new();
    let mut listen = |event: Event<'_>| {
        if let Event::Said(line) = event {
            told.push(line.to_owned());
        }
    };
    let outcome = generate(&sweep, folder, &options, &Cancel::new(), &mut listen)
        .await
        .unwrap();
    assert_eq!(told.len(), profiles, "once for each: {told:?}");
    for known in told {
        assert!(known.contains("its images were looked at now"), "{known}");
    }
    assert!(outcome.failed.is_empty(), "{:?}", outcome.failed);
    assert_eq!(outcome.committed.len(), scenarios);
    Corpus::open(folder).unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn tables_and_pictures_through_the_plugin_are_those_of_the_built_in_link() {
    let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let built_in = stand_in(LinkServer::BuiltIn).await;
    let built_in = record(folders[0].path(), built_in, sweep_toml(), 1, 0).await;
    let plugged = stand_in(plugin::link((96, 64))).await;
    let plugged = record(folders[1].path(), plugged, sweep_toml(), 1, 1).await;

    let report = verify(&plugged);
    assert!(report.is_sound(), "{:#?}", report.findings);
    assert!(report.ticks >= 8, "{} ticks", report.ticks);

    let [a, b] = [&built_in, &plugged].map(|corpus| corpus.scenarios().unwrap().remove(0));
    let [a_frames, b_frames] = [&a, &b].map(|scenario| scenario.open().unwrap().frames().unwrap());
    assert_eq!(a_frames.rows.len(), b_frames.rows.len());
    // Everything except what the simulator itself reports of each image.
    let told = |frame: &TickRow| TickRow {
        views: Vec::new(),
        ..frame.clone()
    };
    for (a, b) in a_frames.rows.iter().zip(&b_frames.rows) {
        assert_eq!(told(a), told(b));
    }
    assert!(
        b_frames
            .rows
            .iter()
            .any(|row| row.views[0].echoed_camera != a_frames.rows[0].views[0].echoed_camera),
        "the plugin's echo is a copy, not what 32-bit floats left"
    );

    for view in ["left", "right"] {
        let [mut a, mut b] =
            [&a, &b].map(|scenario| VideoReader::open(&scenario.video_path(view)).unwrap());
        let (mut pictures, mut a_rgb, mut b_rgb) = (0, Vec::new(), Vec::new());
        let mut worst = 0.0_f64;
        while a.next_frame(&mut a_rgb).unwrap().is_some()
            && b.next_frame(&mut b_rgb).unwrap().is_some()
        {
            let differences = a_rgb
                .iter()
                .zip(&b_rgb)
                .map(|(a, b)| f64::from(a.abs_diff(*b)));
            worst = worst.max(differences.sum::<f64>() / a_rgb.len() as f64);
            pictures += 1;
        }
        println!("{view}: images are up to {worst:.4} levels apart in the mean");
        assert!(worst < MEAN_LEVELS_APART, "{view}: {worst} levels apart");
        assert_eq!(pictures, a_frames.rows.len());
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn live_flights_through_the_plugin_make_a_sound_corpus() {
    let folder = tempfile::tempdir().unwrap();
    let target = stand_in(plugin::link((64, 64))).await;
    let corpus = record(folder.path(), target, live_sweep_toml(), 2, 1).await;
    let report = verify(&corpus);
    assert!(report.is_sound(), "{:#?}", report.findings);
    for scenario in corpus.scenarios().unwrap() {
        let record = scenario.open().unwrap().record().unwrap();
        assert_eq!(record.flight, Flight::Live);
        let frames = scenario.open().unwrap().frames().unwrap();
        let [first, .., last] = &frames.rows[..] else {
            panic!("{} frames", frames.rows.len());
        };
        // From 1.5 NM down to the touchdown target, 2.8 km at 72 m/s in images of four seconds.
        assert!(
            (9..=12).contains(&frames.rows.len()),
            "{}",
            frames.rows.len()
        );
        let sunk_m = first.pose.altitude_msl_m - last.pose.altitude_msl_m;
        assert!((110.0..160.0).contains(&sunk_m), "{sunk_m}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_profile_learns_from_the_first_scenario_of_a_run_how_long_recording_takes() {
    let target = stand_in(plugin::link((96, 64))).await;
    let SimulatorTarget::Address(address) = target else {
        panic!("it has an address");
    };
    let profile = async || {
        let simulator = Simulator::connect(address, Duration::from_secs(60)).await;
        let simulator = simulator.unwrap();
        let profile = simulator.profile().clone();
        simulator.release().await.unwrap();
        match profile {
            KnownProfile::Current(profile) => *profile,
            other => panic!("{other:?}"),
        }
    };
    examine(&DoctorOptions::at(Some(address)), &mut |_| {}).await;
    let before = profile().await;
    assert_eq!(before.pace.found().unwrap().measured_by, PacedBy::Doctor);

    let folder = tempfile::tempdir().unwrap();
    let sweep = Sweep::parse(
        Path::new("test.toml"),
        &repository().join("tests/data"),
        sweep_toml(),
    );
    let options = small_corpus::options(target, &[]);
    let made = small_corpus::run_until(&sweep.unwrap(), folder.path(), &options, |_| false).await;
    assert_eq!(made.unwrap().committed.len(), 1);
    let after = profile().await;
    let pace = after.pace.found().unwrap();
    assert_eq!(pace.measured_by, PacedBy::Generate);
    assert!(
        pace.pictures_per_s > 0.0 && pace.weather_s.is_some(),
        "{pace:?}"
    );
    // The flight was a recorded one.
    assert_eq!(pace.loading_s, None);
    let without_pace = |profile: &Profile| Profile {
        pace: Finding::NotMeasured(String::new()),
        ..profile.clone()
    };
    assert_eq!(without_pace(&after), without_pace(&before));
}

#[tokio::test(flavor = "multi_thread")]
async fn what_no_scenario_can_have_here_ends_the_run_at_once_with_what_to_change() {
    for (table, words) in [
        ("[imaging]\nrefraction_coefficient = 0.13", "take [imaging]"),
        (
            "[[traffic]]\nrole = \"parked\"",
            "X-Plane does not report where it drew one, so that no box could be proven. Take [[traffic]] out",
        ),
    ] {
        let target = stand_in(plugin::link((96, 64))).await;
        let folder = tempfile::tempdir().unwrap();
        let text = sweep_toml().replace("repeats = 1", "repeats = 3") + "\n" + table + "\n";
        let data = repository().join("tests/data");
        let sweep = Sweep::parse(Path::new("test.toml"), &data, text).unwrap();
        let mut attempts = 0;
        let options = small_corpus::options(target, &[]);
        let outcome = small_corpus::run_until(&sweep, folder.path(), &options, |event| {
            attempts += usize::from(matches!(event, Event::Started { .. }));
            false
        });
        let outcome = outcome.await.unwrap();
        assert!(
            matches!(&outcome.stopped, Some(Stopped::Setup { reason }) if reason.contains(words)),
            "{outcome:?}"
        );
        assert_eq!((attempts, outcome.not_made.len()), (1, 3));
        assert!(outcome.failed.is_empty() && !folder.path().join("failed").exists());
    }
}
