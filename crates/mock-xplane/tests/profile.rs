//! Measurements by `dtd doctor` where reports disagree: with and without each disputed quirk, the answers differ.

use std::time::Duration;

use dataset::conditions::Conditions;
use dataset::geometry::pose::Pose;
use dataset::geometry::runway::Runway;
use mock_xplane::server::ServerOptions;
use testkit::changi_02l;
use testkit::short_flight::noon;
use testkit_simulator::client::{self, connected_without_web_api as connected, examined, level};
use testkit_simulator::{quiet, serving};
use tokio::time::timeout;
use xplane_bridge::CaptureRequest;
use xplane_bridge::datarefs::Generation;
use xplane_bridge::doctor::{Check, Measuring, Verdict};
use xplane_bridge::profile::{Finding, KnownProfile, Profile, WindUnit};
use xplane_bridge::udp::subscription::Subscription;

const PATIENCE: Duration = Duration::from_secs(20);

fn options(generation: Generation, quirks: &str) -> ServerOptions {
    ServerOptions {
        generation,
        quirks: quirks.parse().unwrap(),
        clock_rate: 20.0,
        ..quiet()
    }
}

/// An X-Plane 12 whose images are seen.
fn twelve(quirks: &str) -> ServerOptions {
    options(Generation::XPlane12, quirks)
}

/// An X-Plane 11 behind its plugin, which reads its frames back.
fn plugin(quirks: &str) -> ServerOptions {
    ServerOptions {
        link: testkit_simulator::plugin::link((96, 64)),
        ..options(Generation::XPlane11, quirks)
    }
}

/// The profile that the next client receives from an examined simulator.
async fn measured(options: ServerOptions) -> (Profile, Vec<Check>) {
    let address = serving(options).await;
    let checks = examined(address, Measuring::Once).await;
    let simulator = connected(address).await;
    let profile = simulator.profile().clone();
    simulator.release().await.unwrap();
    match profile {
        KnownProfile::Current(profile) => (*profile, checks),
        other => panic!("{other:?} {checks:#?}"),
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_unit_of_the_wind_is_measured_and_how_long_the_weather_takes() {
    for (quirk, unit) in [
        ("none", WindUnit::MetersPerSecond),
        ("wind_in_knots", WindUnit::Knots),
    ] {
        let (profile, checks) = measured(twelve(quirk)).await;
        assert_eq!(profile.wind_unit, Finding::Found(unit), "{checks:#?}");
        let pace = profile.pace.found().unwrap();
        assert!(
            pace.weather_s.is_some_and(|took_s| took_s > 0.0),
            "{pace:?}"
        );
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn what_a_pause_shows_is_measured() {
    for (quirk, shows, moves) in [
        ("none", true, false),
        ("pause_keeps_pose", false, false),
        ("water_moves", true, true),
    ] {
        let (profile, checks) = measured(plugin(quirk)).await;
        assert_eq!(
            [&profile.pause_shows_poses, &profile.still_pictures_move],
            [&Finding::Found(shows), &Finding::Found(moves)],
            "{quirk}: {checks:#?}"
        );
        // Either can be recorded.
        let failed: Vec<&Check> = checks
            .iter()
            .filter(|check| check.verdict == Verdict::Failed)
            .collect();
        assert!(failed.is_empty(), "{quirk}: {failed:#?}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn how_many_frames_a_picture_takes_is_measured() {
    let frames = |finding: Finding<u32>| finding.found().copied().unwrap_or(u32::MAX);
    let (sound, checks) = measured(plugin("none")).await;
    assert_eq!(frames(sound.frames_until_settled), 1, "{checks:#?}");
    let (slow, checks) = measured(plugin("slow_exposure")).await;
    let settled = frames(slow.frames_until_settled);
    assert!((12..=32).contains(&settled), "{checks:#?}");

    let [sound, slow] = [sound.pace, slow.pace].map(|pace| *pace.found().expect("it is measured"));
    assert_eq!(slow.settle_frames, settled);
    assert!(sound.settle_frames < settled && sound.pictures_per_s > 0.0);
    // No flight was started; X-Plane 11 is given a fixed time for its weather.
    assert_eq!(sound.loading_s, None);
    assert!(sound.weather_s.is_some() && !sound.in_blocks);
}

fn windy_noon() -> Conditions {
    let mut conditions = noon(30_000.0);
    conditions.weather.wind_speed_mps = 10.0;
    conditions.weather.wind_from_true_deg = 60.0;
    conditions
}

#[tokio::test(flavor = "multi_thread")]
async fn winds_are_written_in_the_unit_that_was_measured() {
    let address = serving(ServerOptions {
        clock_rate: 1.0,
        ..twelve("wind_in_knots")
    })
    .await;
    let gauge = "sim/cockpit2/gauges/indicators/wind_speed_kts".to_owned();
    let mut watch = Subscription::start(address, [gauge], 20).await.unwrap();
    for (measured, knots) in [(false, 10.0), (true, 19.44)] {
        if measured {
            examined(address, Measuring::Once).await;
        }
        let mut simulator = connected(address).await;
        simulator.set_conditions(&windy_noon()).await.unwrap();
        let shown = async {
            while watch.readings()[0].is_none_or(|found| (found.value - knots).abs() > 0.05) {
                watch.changed().await;
            }
        };
        let shown = timeout(PATIENCE, shown).await.is_ok();
        assert!(shown, "{measured}: {:?}", watch.readings());
        simulator.release().await.unwrap();
    }
    watch.end().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn where_a_pause_keeps_its_picture_pictures_are_taken_while_time_runs() {
    let address = serving(ServerOptions {
        clock_rate: 1.0,
        ..plugin("pause_keeps_pose")
    })
    .await;
    for measured in [false, true] {
        if measured {
            examined(address, Measuring::Once).await;
        }
        let mut simulator = connected(address).await;
        simulator.set_conditions(&windy_noon()).await.unwrap();
        simulator.freeze(&runway()).await.unwrap();
        let mut pictures = Vec::new();
        for tick in 0..2 {
            simulator.send_capture(&capture(tick)).await.unwrap();
            pictures.push(simulator.receive_frame().await.unwrap().rgb);
        }
        assert_eq!(pictures[0] != pictures[1], measured);
        simulator.release().await.unwrap();
    }
}

fn pose(latitude_deg: f64, heading_true_deg: f64) -> Pose {
    level(latitude_deg, 103.98, 300.0, heading_true_deg)
}

fn runway() -> Runway {
    Runway {
        threshold: pose(1.35, 0.0).position(),
        ..changi_02l()
    }
}

fn capture(tick: u32) -> CaptureRequest {
    let camera = pose(1.34, 90.0 * f64::from(tick));
    client::capture(tick, pose(1.35, 0.0), (camera, 40.0), (96, 64))
}

#[tokio::test(flavor = "multi_thread")]
async fn an_installation_is_measured_once_unless_asked_and_left_as_it_was() {
    let address = serving(twelve("none")).await;
    let names = [
        "sim/weather/region/visibility_reported_sm",
        "sim/weather/region/cloud_coverage_percent[0]",
        "sim/weather/region/wind_speed_msc[0]",
        "sim/weather/region/change_mode",
        "sim/time/paused",
        "sim/operation/override/override_planepath[0]",
    ];
    let mut watch = Subscription::start(address, names.map(str::to_owned), 20)
        .await
        .unwrap();
    let values = |watch: &Subscription| -> Option<Vec<f32>> {
        let readings = watch.readings().into_iter();
        readings.map(|found| Some(found?.value)).collect()
    };
    let before = loop {
        if let Some(values) = values(&watch) {
            break values;
        }
        watch.changed().await;
    };
    let first = examined(address, Measuring::Once).await;
    let profile_of = |checks: &[Check]| {
        let found = checks.iter().find(|check| check.name == "profile");
        found.unwrap().found.clone()
    };
    assert!(
        profile_of(&first).contains("kept by the plugin"),
        "{first:#?}"
    );
    assert!(first.iter().any(|check| check.name == "wind unit"));
    let second = examined(address, Measuring::Once).await;
    assert!(profile_of(&second).contains("--measure measures again"));
    assert!(!second.iter().any(|check| check.name == "wind unit"));
    let never = examined(address, Measuring::Never).await;
    assert!(profile_of(&never).contains("which is used"), "{never:#?}");
    let again = examined(address, Measuring::Again).await;
    assert!(again.iter().any(|check| check.name == "wind unit"));
    let given_back = async {
        while values(&watch) != Some(before.clone()) {
            watch.changed().await;
        }
    };
    let given_back = timeout(PATIENCE, given_back).await.is_ok();
    assert!(given_back, "{before:?} {:?}", values(&watch));
    watch.end().await;
    let next = again.last().unwrap();
    assert_eq!(next.name, "next");
    assert_eq!(
        next.found,
        format!("dtd generate SWEEP.toml --out corpus --sim {address}")
    );
}
