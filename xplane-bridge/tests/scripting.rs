//! A scenario's wire traffic, to X-Plane 11 and to X-Plane 12, and the reaction when settings do not hold.

mod fake_simulator;

use std::time::Duration;

use dataset::conditions::{Clock, CloudKind, CloudLayer, Conditions, Weather};
use dataset::geometry::approach_profile::ApproachProfile;
use dataset::geometry::geodesy::Geodetic;
use dataset::geometry::runway::Runway;
use fake_simulator::{Fake, FakeState};
use testkit::changi_02l;
use tokio::time::{Instant, sleep};
use xplane_bridge::datarefs;
use xplane_bridge::doctor::{DoctorOptions, Measuring, Verdict, examine};
use xplane_bridge::fly::{FlightStart, FlyRequest};
use xplane_bridge::link::Request;
use xplane_bridge::packet::PlaceAtStart;
use xplane_bridge::{Simulator, WebApiPlace};

const ELEVEN: f32 = 115_501.0;
const TWELVE: f32 = 124_311.0;
const REGENERATE: &str = "sim/operation/regen_weather";
const CLOUD_BASE_12: &str = "sim/weather/region/cloud_base_msl_m[0]";

fn conditions() -> Conditions {
    Conditions {
        time_of_day: "12:00".into(),
        clock: Clock {
            day_of_year: 172,
            zulu_time_s: 14_400.0,
        },
        weather_name: "cloudy".into(),
        weather: Weather {
            visibility_m: 16_093.44,
            clouds: vec![CloudLayer {
                kind: CloudKind::Stratus,
                cover_ratio: 0.75,
                base_msl_m: 600.0,
                top_msl_m: 1_200.0,
            }],
            rain_ratio: 0.25,
            wind_speed_mps: 5.144_444_4,
            wind_from_true_deg: 340.0,
            turbulence_ratio: 0.2,
        },
    }
}

fn runway() -> Runway {
    Runway {
        course_magnetic_deg: Some(22.7),
        ..changi_02l()
    }
}

fn flight() -> FlyRequest {
    FlyRequest {
        start: FlightStart {
            position: Geodetic {
                latitude_deg: 1.194_827_667,
                longitude_deg: 103.912_427_524,
                altitude_msl_m: 762.0,
            },
            heading_true_deg: 23.0,
            speed_mps: 80.0,
        },
        runway: runway(),
        profile: ApproachProfile::charted_step_down(0.0),
        seed: 1,
        time_limit_s: 600.0,
        already_started: false,
    }
}

async fn set_up_and_fly(fake: &Fake) -> Simulator {
    let mut simulator = fake.connect().await;
    simulator.set_aircraft("B737-800");
    simulator.set_conditions(&conditions()).await.unwrap();
    simulator.fly(&flight()).await.unwrap();
    simulator.freeze(&runway()).await.unwrap();
    simulator
}

fn assert_wrote(told: &FakeState, name: &str, value: f32) {
    let found = told.wrote(name);
    let found = found.unwrap_or_else(|| panic!("{name} was not written"));
    assert!(
        (found - value).abs() < 1e-3,
        "{name}: {found}, expected {value}"
    );
}

#[tokio::test]
async fn x_plane_11_is_told_its_own_datarefs_in_its_own_units() {
    let fake = Fake::start(ELEVEN, "C172", Some("dtd plugin")).await;
    set_up_and_fly(&fake).await.release().await.unwrap();
    let told = fake.told();
    for (name, value) in [
        ("sim/time/use_system_time", 0.0),
        ("sim/time/local_date_days", 171.0),
        ("sim/time/zulu_time_sec", 14_400.0),
        ("sim/weather/use_real_weather_bool", 0.0),
        ("sim/weather/visibility_reported_m", 16_093.44),
        ("sim/weather/cloud_type[0]", 5.0),
        ("sim/weather/cloud_base_msl_m[0]", 600.0),
        ("sim/weather/cloud_type[2]", 0.0),
        ("sim/weather/rain_percent", 0.25),
        ("sim/weather/thunderstorm_percent", 0.0),
        ("sim/weather/wind_speed_kt[2]", 10.0),
        ("sim/weather/wind_direction_degt[0]", 340.0),
        ("sim/cockpit/radios/nav1_freq_hz", 11_090.0),
        ("sim/cockpit/radios/nav1_obs_degm", 22.7),
        ("sim/cockpit2/autopilot/autopilot_electric_master", 1.0),
        ("sim/cockpit2/radios/actuators/HSI_source_select_pilot", 0.0),
    ] {
        assert_wrote(&told, name, value);
    }
    let foreign = told
        .writes
        .iter()
        .find(|(name, _)| name.contains("/region/"));
    assert_eq!(foreign, None, "a dataref of X-Plane 12");
    assert_eq!(
        told.wrote("sim/weather/cloud_coverage[0]"),
        None,
        "the sky of 11 is chosen by its types"
    );
    assert_eq!(
        told.commands, [""; 0],
        "time runs already, the weather of X-Plane 11 needs no command, and the autopilot is the simulator's to engage"
    );
    assert_eq!(told.loads.len(), 1);
    assert_eq!(
        told.loads[0].path,
        "Aircraft/Laminar Research/Boeing B737-800/b738.acf"
    );
    assert_eq!(told.starts, [], "the plugin puts the aircraft there");
}

#[tokio::test]
async fn x_plane_12_is_told_its_clouds_again_after_the_weather_was_regenerated() {
    let fake = Fake::start(TWELVE, "B738", None).await;
    set_up_and_fly(&fake).await.release().await.unwrap();
    let told = fake.told();
    for (name, value) in [
        ("sim/time/use_system_time", 0.0),
        ("sim/time/local_date_days", 171.0),
        ("sim/weather/region/change_mode", 3.0),
        ("sim/weather/region/variability_pct", 0.0),
        ("sim/weather/region/update_immediately", 1.0),
        ("sim/weather/region/visibility_reported_sm", 10.0),
        ("sim/weather/region/rain_percent", 0.25),
        ("sim/weather/region/cloud_type[0]", 1.0),
        ("sim/weather/region/cloud_coverage_percent[0]", 0.75),
        ("sim/weather/region/cloud_coverage_percent[2]", 0.0),
        (CLOUD_BASE_12, 600.0),
        ("sim/weather/region/wind_speed_msc[12]", 5.144_444_4),
        ("sim/weather/region/wind_direction_degt[12]", 340.0),
        ("sim/cockpit/radios/nav1_freq_hz", 11_090.0),
    ] {
        assert_wrote(&told, name, value);
    }
    let old = told.writes.iter().find(|(name, _)| {
        name.starts_with("sim/weather/") && !name.starts_with("sim/weather/region/")
    });
    assert_eq!(old, None, "a dataref of X-Plane 11");
    let bases = told
        .writes
        .iter()
        .filter(|(name, _)| name == CLOUD_BASE_12)
        .count();
    assert!(bases >= 2, "clouds were told {bases} times");
    // Once: each time stops X-Plane for seconds.
    assert_eq!(told.commands, [REGENERATE]);
    let at = |name: &str, value: f32| {
        let wanted = |(found, written): &(String, f32)| found == name && *written == value;
        told.writes.iter().position(wanted)
    };
    assert_eq!(
        at("sim/weather/region/weather_preset", 0.0),
        None,
        "the preset is for a sky without clouds"
    );
    assert!(
        at("sim/operation/override/override_planepath[0]", 1.0)
            < at("sim/weather/region/visibility_reported_sm", 10.0),
        "the aircraft is held while the weather settles"
    );
    assert_eq!(told.loads, [], "the aircraft is loaded already");
    // No plugin: the client puts the aircraft into the air.
    let [start] = &told.starts[..] else {
        panic!("{:?}", told.starts);
    };
    assert_eq!(
        (start.start_type, start.plane, start.speed_mps),
        (6, 0, 80.0)
    );
    assert_eq!(
        (start.latitude_deg, start.longitude_deg),
        (1.194_827_667, 103.912_427_524)
    );
    let flown = told.requests.iter().find_map(|request| match request {
        Request::Fly(flight) => Some(flight.already_started),
        _ => None,
    });
    assert_eq!(flown, Some(false));
}

/// A simulator whose clock runs 100 times as fast as ours and which delays clouds by this much, by its clock.
async fn with_late_clouds(take_s: f32) -> Fake {
    let fake = Fake::start(TWELVE, "B738", None).await;
    let mut told = fake.told();
    told.run_clock(100.0);
    told.clouds_take_s = take_s;
    for slot in 0..3 {
        told.set(&format!("sim/weather/region/cloud_type[{slot}]"), 2.0);
        told.set(
            &format!("sim/weather/region/cloud_coverage_percent[{slot}]"),
            0.5,
        );
    }
    drop(told);
    fake
}

#[tokio::test]
async fn clouds_that_read_back_late_are_waited_for_and_not_written_meanwhile() {
    let fake = with_late_clouds(55.0).await;
    let mut simulator = fake.connect().await;
    let mut clear = conditions();
    clear.weather.clouds.clear();
    for (conditions, cover) in [(conditions(), 0.75), (clear, 0.0)] {
        simulator.set_conditions(&conditions).await.unwrap();
        let told = fake.told();
        for (slot, wanted) in [cover, 0.0, 0.0].into_iter().enumerate() {
            let name = format!("sim/weather/region/cloud_coverage_percent[{slot}]");
            assert_eq!(told.datarefs[&name], wanted, "{name}");
        }
    }
    let preset = ("sim/weather/region/weather_preset".to_owned(), 0.0);
    assert!(
        fake.told().writes.contains(&preset),
        "without clouds the preset takes the old ones away"
    );
    simulator.confirm_conditions().await.unwrap();
}

#[tokio::test]
async fn weather_that_never_comes_is_an_error_that_names_the_habit_and_who_makes_the_weather() {
    let fake = with_late_clouds(f32::INFINITY).await;
    let mut simulator = fake.connect().await;
    let error = simulator.set_conditions(&conditions()).await.unwrap_err();
    let text = error.to_string();
    for words in [
        "cloud_",
        "70s later",
        "old clouds for up to a minute",
        "something holds it",
    ] {
        assert!(text.contains(words), "{words}: {text}");
    }
    let fake = Fake::start(TWELVE, "B738", None).await;
    fake.told().run_clock(100.0);
    fake.told().set(datarefs::WEATHER_SOURCE, 1.0);
    let error = fake.connect().await.set_conditions(&conditions()).await;
    let text = error.unwrap_err().to_string();
    assert!(text.contains("real weather is on"), "{text}");
}

#[tokio::test]
async fn a_temperature_that_slides_for_minutes_is_written_until_it_holds_and_clouds_are_left_alone()
{
    let fake = Fake::start(TWELVE, "B738", None).await;
    fake.told().run_clock(50.0);
    fake.told().temperature_slides_until_s = 150.0;
    let mut simulator = fake.connect().await;
    simulator.set_conditions(&conditions()).await.unwrap();
    let told = fake.told();
    assert_eq!(told.datarefs[datarefs::TEMPERATURE_C], 15.0);
    let times = |name: &str| told.writes.iter().filter(|(path, _)| path == name).count();
    let (temperature, cloud) = (times(datarefs::TEMPERATURE_C), times(CLOUD_BASE_12));
    assert!(temperature > cloud + 5, "{temperature} {cloud}");
}

#[tokio::test]
async fn a_temperature_that_never_holds_is_an_error_that_says_for_how_long_it_was_waited_for() {
    let fake = Fake::start(TWELVE, "B738", None).await;
    fake.told().run_clock(100.0);
    fake.told().temperature_slides_until_s = f32::INFINITY;
    let error = fake.connect().await.set_conditions(&conditions()).await;
    let text = error.unwrap_err().to_string();
    for words in ["sealevel_temperature_c", "reads 25 300s later"] {
        assert!(text.contains(words), "{words}: {text}");
    }
}

#[tokio::test]
async fn a_temperature_that_slides_for_longer_is_waited_for_as_long_as_it_takes_what_is_written() {
    let fake = Fake::start(TWELVE, "B738", None).await;
    fake.told().run_clock(100.0);
    // Beyond the patience with one that something else holds.
    fake.told().temperature_drifts_until_s = 500.0;
    let mut simulator = fake.connect().await;
    simulator.set_conditions(&conditions()).await.unwrap();
    let found_c = fake.told().datarefs[datarefs::TEMPERATURE_C];
    assert!((found_c - 15.0).abs() <= 1.0, "{found_c}");
}

#[tokio::test]
async fn a_start_without_a_plugin_is_asked_for_once_and_left_alone_until_it_has_loaded() {
    let fake = Fake::start(ELEVEN, "B738", None).await;
    fake.told().start_takes = Some((Duration::from_millis(1_500), Duration::from_millis(700)));
    let mut simulator = fake.connect().await;
    simulator.fly(&flight()).await.unwrap();
    let told = fake.told();
    assert_eq!(told.starts.len(), 1);
    assert!(told.hasty.is_empty(), "{:?}", told.hasty);
}

#[tokio::test]
async fn a_command_without_effect_is_an_error_about_the_command() {
    let fake = Fake::start(TWELVE, "B738", None).await;
    fake.told().set(datarefs::PAUSED, 1.0);
    fake.told().ignores_commands = true;
    let said = fake.connect().await.resume().await.unwrap_err().to_string();
    for words in [
        "command sim/operation/pause_off was sent 8 times",
        "sim/time/paused reads 1, expected 0",
    ] {
        assert!(said.contains(words), "{said}");
    }
}

#[tokio::test]
async fn a_pause_that_stays_is_no_menu_for_the_doctor() {
    let fake = Fake::start(TWELVE, "B738", None).await;
    fake.told().set(datarefs::PAUSED, 1.0);
    fake.told().ignores_commands = true;
    let options = DoctorOptions {
        listen: Duration::ZERO,
        wait: Duration::from_millis(300),
        web_api: WebApiPlace::Off,
        measuring: Measuring::Never,
        ..DoctorOptions::at(Some(fake.address))
    };
    let checks = examine(&options, &mut |_| ()).await;
    let menus = checks.iter().find(|check| check.name == "menus").unwrap();
    assert_eq!(menus.verdict, Verdict::Failed);
    assert!(menus.found.contains("sim/operation/pause_off"), "{menus:?}");
}

#[tokio::test]
async fn a_simulator_that_has_ended_is_not_called_one_that_never_answered() {
    let fake = Fake::start(TWELVE, "B738", None).await;
    let mut simulator = fake.connect().await;
    fake.end();
    let error = simulator.set_conditions(&conditions()).await.unwrap_err();
    assert!(error.to_string().contains("has probably ended"), "{error}");
}

#[tokio::test]
async fn weather_that_settles_a_little_elsewhere_is_the_weather_that_was_set() {
    let fake = Fake::start(TWELVE, "B738", None).await;
    let mut simulator = fake.connect().await;
    simulator.set_conditions(&conditions()).await.unwrap();
    for (name, value) in [
        (CLOUD_BASE_12, 607.0),
        (datarefs::VISIBILITY_SM, 9.4),
        (datarefs::TEMPERATURE_C, 14.3),
        ("sim/weather/region/wind_direction_degt[3]", 344.0),
    ] {
        fake.told().set(name, value);
    }
    // Longer than the watch takes an older value for a reordered one.
    sleep(Duration::from_millis(1_500)).await;
    simulator.confirm_conditions().await.unwrap();
    fake.told().set(datarefs::VISIBILITY_SM, 8.0);
    assert!(simulator.confirm_conditions().await.is_err());
}

/// The aircraft at a latitude, on the runway's longitude.
fn at_latitude(latitude_deg: f64) -> PlaceAtStart {
    PlaceAtStart {
        start_type: 6,
        plane: 0,
        airport: String::new(),
        runway: 0,
        runway_end: 0,
        latitude_deg,
        longitude_deg: 103.977_501_24,
        elevation_msl_m: 10.0,
        heading_true_deg: 0.0,
        speed_mps: 0.0,
    }
}

#[tokio::test]
async fn an_aircraft_that_is_far_away_or_another_one_travels_and_one_that_is_there_stays() {
    for (latitude_deg, icao, travels) in [
        (1.36, "B738", false),
        (9.5, "B738", true),
        (1.36, "C172", true),
    ] {
        let fake = Fake::start(TWELVE, icao, Some("dtd plugin")).await;
        fake.told().parked = Some(at_latitude(latitude_deg));
        let mut simulator = fake.connect().await;
        simulator.set_aircraft("B737-800");
        let start = flight().start;
        simulator
            .prepare(&conditions(), &start, false)
            .await
            .unwrap();
        let told = fake.told();
        let travelled = told.requests.iter().any(|request| {
            matches!(request, Request::Travel { start: to, already_started: false } if *to == start)
        });
        assert_eq!(travelled, travels, "{icao} at {latitude_deg}");
        assert_eq!(told.loads.len(), usize::from(icao != "B738"));
    }
}

#[tokio::test]
async fn an_aircraft_that_says_the_right_type_and_has_another_size_is_an_error_that_says_what_to_load()
 {
    for (width_m, message) in [(33.0, ""), (11.0, "11.0 m large")] {
        let fake = Fake::start(TWELVE, "B738", Some("dtd plugin")).await;
        fake.told().parked = Some(at_latitude(1.36));
        fake.told().set(datarefs::AIRCRAFT_WIDTH_M, width_m);
        fake.told().set(datarefs::AIRCRAFT_LENGTH_M, 39.5);
        let mut simulator = fake.connect().await;
        simulator.set_aircraft("B737-800");
        let start = flight().start;
        let prepared = simulator.prepare(&conditions(), &start, false).await;
        let text = prepared.map_or_else(|error| error.to_string(), |()| String::new());
        assert!(
            text.contains(message) && text.is_empty() == message.is_empty(),
            "{text}"
        );
        assert!(
            message.is_empty() || text.contains("Boeing 737-800/b738.acf in X-Plane"),
            "{text}"
        );
    }
}

#[tokio::test]
async fn a_live_flight_is_begun_once_and_flown_from_there() {
    let fake = Fake::start(TWELVE, "B738", Some("dtd plugin")).await;
    fake.told().parked = Some(at_latitude(1.36));
    let mut simulator = fake.connect().await;
    simulator.set_aircraft("B737-800");
    let request = flight();
    simulator
        .prepare(&conditions(), &request.start, true)
        .await
        .unwrap();
    simulator.set_conditions(&conditions()).await.unwrap();
    simulator.fly(&request).await.unwrap();
    let told = fake.told();
    let travels = told
        .requests
        .iter()
        .filter(|r| matches!(r, Request::Travel { .. }));
    assert_eq!(travels.count(), 1);
    let flown = told.requests.iter().find_map(|request| match request {
        Request::Fly(flight) => Some(flight.already_started),
        _ => None,
    });
    assert_eq!(flown, Some(true));
}

#[tokio::test]
async fn a_menu_is_left_once_and_one_that_stays_is_an_error_that_says_so() {
    for helps in [true, false] {
        let fake = Fake::start(TWELVE, "B738", Some("dtd plugin")).await;
        fake.told().parked = Some(at_latitude(1.36));
        fake.told().menu = Some(helps);
        let mut simulator = fake.connect().await;
        let prepared = simulator
            .prepare(&conditions(), &flight().start, false)
            .await;
        let toggled = |path: &&String| *path == datarefs::COMMAND_TOGGLE_MAIN_MENU;
        assert_eq!(fake.told().commands.iter().filter(toggled).count(), 1);
        match prepared {
            Ok(()) => assert!(helps),
            Err(error) => assert!(
                !helps && error.to_string().contains("Flight Configuration"),
                "{error}"
            ),
        }
    }
}

#[tokio::test]
async fn rain_is_captured_while_time_runs_and_a_dry_scenario_in_a_pause() {
    for rain_ratio in [0.25, 0.0] {
        let fake = Fake::start(TWELVE, "B738", Some("dtd plugin")).await;
        let mut simulator = fake.connect().await;
        let mut conditions = conditions();
        conditions.weather.rain_ratio = rain_ratio;
        simulator.set_conditions(&conditions).await.unwrap();
        simulator.freeze(&runway()).await.unwrap();
        let told = fake.told();
        let running_at = told.requests.iter().find_map(|request| match request {
            Request::Freeze { running_at, .. } => Some(*running_at),
            _ => None,
        });
        let expected = (rain_ratio > 0.0).then_some(conditions.clock);
        assert_eq!(running_at, Some(expected));
    }
}

#[tokio::test]
async fn time_that_stands_still_runs_again_and_one_that_runs_is_left_alone() {
    let fake = Fake::start(TWELVE, "B738", None).await;
    let mut simulator = fake.connect().await;
    simulator.resume().await.unwrap();
    assert_eq!(fake.told().commands, [""; 0]);
    fake.told().set(datarefs::PAUSED, 1.0);
    simulator.resume().await.unwrap();
    assert_eq!(fake.told().commands, ["sim/operation/pause_off"]);
}

#[tokio::test]
async fn a_setting_that_is_lost_while_recording_is_noticed() {
    let fake = Fake::start(TWELVE, "B738", None).await;
    let mut simulator = set_up_and_fly(&fake).await;
    simulator.confirm_conditions().await.unwrap();
    fake.told().set(CLOUD_BASE_12, 0.0);
    let error = simulator.confirm_conditions().await.unwrap_err();
    let text = error.to_string();
    assert!(
        text.contains(CLOUD_BASE_12) && text.contains("set to 600") && text.contains("reads 0"),
        "{text}"
    );
}

#[tokio::test]
async fn a_restarted_simulator_is_noticed_although_its_settings_are_the_same() {
    const RUNNING: &str = "sim/time/total_running_time_sec";
    let fake = Fake::start(TWELVE, "B738", None).await;
    fake.told().set(RUNNING, 500.0);
    let mut simulator = set_up_and_fly(&fake).await;
    let deadline = Instant::now() + Duration::from_secs(10);
    // The time it runs is known once it came for the first time.
    sleep(Duration::from_millis(200)).await;
    simulator.confirm_conditions().await.unwrap();
    fake.told().set(RUNNING, 4.0);
    let error = loop {
        match simulator.confirm_conditions().await {
            Err(error) => break error,
            Ok(()) => assert!(Instant::now() < deadline, "never noticed"),
        }
    };
    assert!(error.to_string().contains("was restarted"), "{error}");
}

#[tokio::test]
async fn whoever_leaves_leaves_nothing_subscribed() {
    let fake = Fake::start(TWELVE, "B738", None).await;
    let simulator = set_up_and_fly(&fake).await;
    assert!(fake.told().subscriptions() > 50, "the settings are watched");
    simulator.release().await.unwrap();
    until_nothing_is_subscribed(&fake).await;
    // Also after a failure.
    drop(set_up_and_fly(&fake).await);
    until_nothing_is_subscribed(&fake).await;
}

async fn until_nothing_is_subscribed(fake: &Fake) {
    let end = Instant::now() + Duration::from_secs(20);
    while fake.told().subscriptions() > 0 {
        assert!(Instant::now() < end, "{}", fake.told().subscriptions());
        sleep(Duration::from_millis(5)).await;
    }
}

#[tokio::test]
async fn a_time_that_is_not_finite_or_impossible_is_not_waited_for_and_ends_in_no_panic() {
    for strange in [f32::NAN, f32::INFINITY, -1.0, f32::MAX] {
        let fake = Fake::start(TWELVE, "B738", None).await;
        fake.told().set(datarefs::WEATHER_SETTLE_S, strange);
        fake.told().set(datarefs::RUNNING_TIME_S, strange);
        let simulator = fake.connect().await;
        assert_eq!(simulator.description().name, "fake", "{strange}");
    }
}
