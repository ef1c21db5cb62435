//! A simulator whose weather at the aircraft differs from the written one: each quantity wrong in turn, by a relay that alters readings,
//! with and without a profile by `dtd doctor`. Correct weather must never be reported.

use std::collections::BTreeSet;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use dataset::conditions::{CloudKind, CloudLayer, Conditions, Weather};
use dataset::corpus::effective_weather::EffectiveQuantity;
use futures_util::future::join_all;
use mock_xplane::server::ServerOptions;
use testkit::short_flight::noon;
use testkit_simulator::client::{self, connected_without_web_api as connected};
use testkit_simulator::{altered, quiet, serving};
use xplane_bridge::BridgeError;
use xplane_bridge::doctor::Measuring;
use xplane_bridge::profile::{Finding, KnownProfile};

/// Wrong reports, one per quantity, under any weather in these tests.
const WRONG: [(EffectiveQuantity, &str, f32); 5] = [
    (
        EffectiveQuantity::Visibility,
        "sim/graphics/view/visibility_effective_m",
        2_000.0,
    ),
    (
        EffectiveQuantity::WindSpeed,
        "sim/weather/aircraft/wind_now_speed_msc",
        30.0,
    ),
    (
        EffectiveQuantity::WindDirection,
        "sim/weather/aircraft/wind_now_direction_degt",
        180.0,
    ),
    (
        EffectiveQuantity::Rain,
        "sim/weather/aircraft/precipitation_on_aircraft_ratio",
        0.3,
    ),
    (
        EffectiveQuantity::CloudCover,
        "sim/weather/aircraft/cloud_coverage_percent[1]",
        0.5,
    ),
];

fn conditions(name: &str, weather: Weather) -> Conditions {
    Conditions {
        weather_name: name.into(),
        weather,
        ..noon(1.0)
    }
}

fn cloud(kind: CloudKind, cover_ratio: f64) -> CloudLayer {
    CloudLayer {
        kind,
        cover_ratio,
        base_msl_m: 900.0,
        top_msl_m: 4_000.0,
    }
}

fn storm() -> Conditions {
    let weather = Weather {
        visibility_m: 20_000.0,
        clouds: vec![cloud(CloudKind::Cumulonimbus, 0.9)],
        rain_ratio: 0.6,
        wind_speed_mps: 10.0,
        wind_from_true_deg: 340.0,
        turbulence_ratio: 0.3,
    };
    conditions("stormy", weather)
}

/// A relay in front of a separate stand-in that falsifies a dataref.
async fn wrong_at(dataref: &'static str, wrong: f32) -> SocketAddr {
    let simulator = serving(quiet()).await;
    altered(
        simulator,
        move |path, value| if path == dataref { wrong } else { value },
    )
}

/// Examines a simulator and returns the profile that the next client gets.
async fn examined(address: SocketAddr) -> KnownProfile {
    client::examined(address, Measuring::Once).await;
    let simulator = connected(address).await;
    let profile = simulator.profile().clone();
    simulator.release().await.unwrap();
    profile
}

/// A simulator whose time flies, so that an examination does not take minutes.
fn fast() -> ServerOptions {
    ServerOptions {
        clock_rate: 20.0,
        ..quiet()
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn without_a_profile_each_quantity_that_is_wrong_marks_the_scenario_and_no_other() {
    let cases = WRONG.map(|(quantity, dataref, wrong)| async move {
        let mut simulator = connected(wrong_at(dataref, wrong).await).await;
        simulator.set_conditions(&storm()).await.unwrap();
        let shown = simulator.effective_weather().unwrap().clone();
        assert_eq!(shown.differing, BTreeSet::from([quantity]), "{shown:?}");
        simulator.release().await.unwrap();
    });
    join_all(cases).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn with_a_profile_each_quantity_that_is_wrong_fails_the_attempt_and_is_named() {
    let profile = &examined(serving(fast()).await).await;
    let found = profile.current().unwrap();
    for quantity in EffectiveQuantity::ALL {
        assert_eq!(
            found.weather_follows[&quantity],
            Finding::Found(true),
            "{quantity}"
        );
    }
    let cases = WRONG.map(|(quantity, dataref, wrong)| async move {
        let mut simulator = connected(wrong_at(dataref, wrong).await).await;
        simulator.use_profile(profile.clone());
        let error = simulator.set_conditions(&storm()).await.unwrap_err();
        let BridgeError::OtherWeatherShows { difference, .. } = &error else {
            panic!("{quantity}: {error}");
        };
        assert_eq!(difference.quantity, quantity);
        assert!(error.to_string().contains(&quantity.to_string()), "{error}");
        // Once it is known not to be followed, the same scenario is recorded with a mark.
        simulator.set_not_followed([quantity].into());
        simulator.set_conditions(&storm()).await.unwrap();
        let shown = simulator.effective_weather().unwrap();
        assert_eq!(shown.differing, BTreeSet::from([quantity]), "{shown:?}");
        simulator.release().await.unwrap();
    });
    join_all(cases).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_quantity_that_changes_while_pictures_are_taken_is_noticed_after_them() {
    let profile = &examined(serving(fast()).await).await;
    let cases = WRONG.map(|(quantity, dataref, wrong)| async move {
        let has_changed = Arc::new(AtomicBool::new(false));
        let changed = has_changed.clone();
        let change = move |path: &str, value| {
            if path == dataref && changed.load(Ordering::Relaxed) {
                wrong
            } else {
                value
            }
        };
        let mut simulator = connected(altered(serving(quiet()).await, change)).await;
        simulator.set_conditions(&storm()).await.unwrap();
        simulator.confirm_conditions().await.unwrap();
        assert_eq!(
            simulator.effective_weather().unwrap().differing,
            BTreeSet::new()
        );
        has_changed.store(true, Ordering::Relaxed);
        simulator.confirm_conditions().await.unwrap();
        let shown = simulator.effective_weather().unwrap();
        assert_eq!(shown.differing, BTreeSet::from([quantity]), "{shown:?}");
        let marked: Vec<EffectiveQuantity> = shown
            .marks(&storm().weather)
            .iter()
            .map(|mark| mark.quantity)
            .collect();
        assert_eq!(marked, [quantity]);
        // The same where it was measured to follow.
        simulator.use_profile(profile.clone());
        let error = simulator.confirm_conditions().await.unwrap_err();
        assert!(error.to_string().contains(&quantity.to_string()), "{error}");
        simulator.release().await.unwrap();
    });
    join_all(cases).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_doctor_finds_which_quantity_does_not_follow() {
    let cases = WRONG.map(|(quantity, dataref, stuck)| async move {
        let simulator = serving(fast()).await;
        let relay = altered(
            simulator,
            move |path, value| if path == dataref { stuck } else { value },
        );
        let profile = examined(relay).await;
        let follows = &profile.current().unwrap().weather_follows;
        for measured in EffectiveQuantity::ALL {
            let expected = Finding::Found(measured != quantity);
            assert_eq!(
                follows[&measured], expected,
                "{measured} while {quantity} is stuck"
            );
        }
    });
    join_all(cases).await;
}

/// Ten scenarios of each of four weathers, with other numbers each.
fn forty_scenarios() -> Vec<Conditions> {
    let calm = Weather {
        visibility_m: 80_000.0,
        clouds: Vec::new(),
        rain_ratio: 0.0,
        wind_speed_mps: 3.0,
        wind_from_true_deg: 60.0,
        turbulence_ratio: 0.0,
    };
    let of_number = |number: u32| {
        let part = f64::from(number) / 10.0;
        let clear = Weather {
            wind_speed_mps: 10.0 * part,
            wind_from_true_deg: 359.0 * part,
            ..calm.clone()
        };
        let cloudy = Weather {
            visibility_m: 50_000.0 - 20_000.0 * part,
            clouds: vec![
                cloud(CloudKind::Cumulus, 0.3 + 0.5 * part),
                cloud(CloudKind::Cirrus, part),
            ],
            ..clear.clone()
        };
        let foggy = Weather {
            visibility_m: 1_000.0 + 8_000.0 * part,
            wind_speed_mps: 0.0,
            ..calm.clone()
        };
        let stormy = Weather {
            visibility_m: 35_000.0 - 20_000.0 * part,
            clouds: vec![cloud(CloudKind::Cumulonimbus, 1.0 - 0.3 * part)],
            rain_ratio: 0.3 + 0.7 * part,
            wind_speed_mps: 8.0 + 8.0 * part,
            ..clear.clone()
        };
        [
            conditions("clear", clear),
            conditions("cloudy", cloudy),
            conditions("foggy", foggy),
            conditions("stormy", stormy),
        ]
    };
    (0..10).flat_map(of_number).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn of_forty_right_scenarios_in_all_weathers_none_is_marked() {
    let scenarios = forty_scenarios();
    assert_eq!(scenarios.len(), 40);
    let parts = scenarios.chunks(10).map(|part| async move {
        let address = serving(quiet()).await;
        for conditions in part {
            let mut simulator = connected(address).await;
            simulator.set_conditions(conditions).await.unwrap();
            let shown = simulator.effective_weather().unwrap();
            assert!(!shown.is_marked(), "{conditions:?}: {shown:?}");
            simulator.release().await.unwrap();
        }
    });
    join_all(parts).await;
}
