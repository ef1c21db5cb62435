//! Corpora recorded through our plugin from stand-ins with all habits of a live X-Plane at once, each alone, and some at random.
//! Recorded flights must give the images of a well-behaved simulator; live ones must be valid.
#![cfg(target_os = "linux")]

use std::env;
use std::sync::{LazyLock, Mutex};
use std::thread;

use dataset::corpus::Corpus;
use mock_xplane::quirks::{FACTS, Facts, OPEN, Quirks};
use testkit::command::{Dtd, said};
use testkit::pictures::{ALIKE, farthest, pictures};
use testkit_simulator::{PATIENCE, SWEEP, SimulatorProcess, plugin};
use tokio::time::timeout;
use verify::verify;
use xplane_bridge::datarefs::{self, Generation};
use xplane_bridge::udp::subscription::Subscription;

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));

/// The scenarios of the sweep: one flown live, and two that fly a recording.
const LIVE: &str = "1200-clear-r1";
const STORM: &str = "1200-stormy-r1";
const HAZE: &str = "1200-hazy-r1";
/// Simulators in parallel: they mostly wait.
const AT_ONCE: usize = 4;
/// Number of random combinations of habits, unless the environment overrides it: one for each generation, beside the two with all habits.
const COMBINATIONS_VARIABLE: &str = "DTD_QUIRK_COMBINATIONS";
const COMBINATIONS: usize = 2;

/// Images of storm and haze from well-behaved simulators, of X-Plane 11 and 12.
static WANTED: LazyLock<[[Vec<Vec<u8>>; 2]; 2]> = LazyLock::new(|| {
    ["11", "12"].map(|xplane| {
        let simulator = SimulatorProcess::start(DTD, xplane, Some("none"), &plugin::folder());
        let corpus = made(&simulator, &format!("{STORM},{HAZE}")).unwrap();
        [STORM, HAZE].map(|id| pictures(&corpus, id))
    })
});

fn wanted(xplane: &str, id: &str) -> &'static [Vec<u8>] {
    &WANTED[usize::from(xplane == "12")][usize::from(id == HAZE)]
}

/// Records scenarios, or returns why not.
fn made(simulator: &SimulatorProcess, only: &str) -> Result<std::path::PathBuf, String> {
    let corpus = simulator.folder().join("corpus");
    let output = simulator.generate(only, &corpus);
    if output.status.success() {
        Ok(corpus)
    } else {
        Err(said(&output))
    }
}

/// Faults in the scenarios of a simulator with some habits.
fn wrong_with(xplane: &str, quirks: Option<&str>, only: &str) -> Option<String> {
    let simulator = SimulatorProcess::start(DTD, xplane, quirks, &plugin::folder());
    let corpus = match made(&simulator, only) {
        Ok(corpus) => corpus,
        Err(said) => return Some(format!("{said}\nthe simulator: {}", simulator.log())),
    };
    let opened = Corpus::open(&corpus).unwrap();
    let report = verify(&opened);
    if !report.is_sound() {
        return Some(format!("{:#?}", report.findings));
    }
    let made: Vec<String> = opened
        .scenarios()
        .unwrap()
        .iter()
        .map(|s| s.id().to_owned())
        .collect();
    for id in [STORM, HAZE] {
        if made.iter().any(|made| made == id) {
            let apart = farthest(&pictures(&corpus, id), wanted(xplane, id));
            if apart > ALIKE {
                return Some(format!(
                    "{id}: images are {apart:.2} levels from those wanted"
                ));
            }
        }
    }
    None
}

/// Runs cases in parallel; returns the faults of each failing one.
fn all_of(cases: Vec<(String, &'static str, &'static str)>) -> Vec<String> {
    LazyLock::force(&WANTED);
    let cases = Mutex::new(cases);
    let wrong = Mutex::new(Vec::new());
    thread::scope(|scope| {
        for _ in 0..AT_ONCE {
            scope.spawn(|| {
                while let Some((quirks, xplane, only)) = { cases.lock().unwrap().pop() } {
                    if let Some(found) = wrong_with(xplane, Some(&quirks), only) {
                        let text = format!("X-Plane {xplane} with {quirks}: {found}");
                        wrong.lock().unwrap().push(text);
                    }
                }
            });
        }
    });
    wrong.into_inner().unwrap()
}

#[test]
fn x_plane_12_as_awkward_as_it_is_by_default_gives_a_whole_corpus() {
    assert_eq!(wrong_with("12", None, ""), None);
}

#[test]
fn x_plane_11_as_awkward_as_it_is_by_default_gives_a_whole_corpus() {
    assert_eq!(wrong_with("11", None, ""), None);
}

#[test]
fn each_awkward_habit_alone_gives_the_pictures_of_a_well_behaved_simulator() {
    let cases = habits().map(|facts| {
        // Some affect only live flights, some clouds and rain.
        let only = match facts.name {
            "dropped_start"
            | "restarting_start"
            | "late_start_crashes"
            | "altitude_hold_captures"
            | "electric_master_off" => LIVE,
            "late_clouds"
            | "cloud_base_off"
            | "regeneration_restores_preset"
            | "paused_weather"
            | "particles_stop_when_paused" => STORM,
            _ => HAZE,
        };
        (facts.name.to_owned(), "12", only)
    });
    let wrong = all_of(cases.collect());
    assert!(wrong.is_empty(), "{}", wrong.join("\n\n"));
}

#[test]
fn awkward_habits_at_random_give_the_pictures_of_a_well_behaved_simulator() {
    let number = env::var(COMBINATIONS_VARIABLE).map_or(COMBINATIONS, |text| text.parse().unwrap());
    let cases = (0..number).map(|seed| {
        let (xplane, generation) = match seed % 2 {
            0 => ("12", Generation::XPlane12),
            _ => ("11", Generation::XPlane11),
        };
        (drawn(seed).of(generation).to_string(), xplane, "")
    });
    let wrong = all_of(cases.collect());
    assert!(wrong.is_empty(), "{}", wrong.join("\n\n"));
}

/// All that a client handles without preparation. For those that reports disagree on it checks images itself; the weather needs
/// `dtd doctor` first (crates/mock-xplane/tests/profile.rs).
fn habits() -> impl Iterator<Item = &'static Facts> {
    const LOOKED_AT: [&str; 2] = ["pause_keeps_pose", "slow_exposure"];
    FACTS
        .iter()
        .filter(|facts| !OPEN.contains(&facts.quirk) || LOOKED_AT.contains(&facts.name))
}

/// A coin toss per habit, from a seed.
fn drawn(seed: usize) -> Quirks {
    let coins = blake3::hash(&seed.to_le_bytes());
    habits()
        .zip(coins.as_bytes())
        .filter(|(_, coin)| *coin % 2 == 0)
        .fold(Quirks::NONE, |set, (facts, _)| set.with(facts.quirk))
}

#[test]
fn a_start_whose_connection_the_web_api_drops_is_found_by_where_the_aircraft_is_and_asked_for_once()
{
    let habits = "dropped_start,restarting_start,far_away,slow_scenery";
    let simulator = SimulatorProcess::start(DTD, "12", Some(habits), &plugin::folder());
    let output = simulator.generate(LIVE, &simulator.folder().join("corpus"));
    let said = said(&output);
    assert!(output.status.success(), "{said}");
    let times = |words: &str| said.matches(words).count();
    assert_eq!(times("a flight begins by_web_api=true"), 1, "{said}");
    assert_eq!(times("seen by where the aircraft is"), 1, "{said}");
}

#[test]
fn a_storm_leaves_no_cloud_in_the_haze_after_it() {
    let storm_from_haze = farthest(wanted("12", STORM), wanted("12", HAZE));
    assert!(storm_from_haze > 4.0, "{storm_from_haze}");
    let habits = "late_clouds,regeneration_restores_preset,paused_weather,cloud_base_off";
    let simulator = SimulatorProcess::start(DTD, "12", Some(habits), &plugin::folder());
    for id in [STORM, HAZE] {
        let corpus = made(&simulator, id).unwrap();
        let apart = farthest(&pictures(&corpus, id), wanted("12", id));
        assert!(apart < ALIKE, "{id}: {apart} levels");
    }
}

/// Waits until datarefs read so; `None` matches anything.
async fn until_read(watch: &mut Subscription, wanted: &[Option<f32>]) {
    let right = |watch: &Subscription| {
        let readings = watch.readings();
        let pairs = readings.iter().zip(wanted);
        pairs.clone().all(|(reading, wanted)| {
            wanted.is_none_or(|wanted| reading.is_some_and(|reading| reading.value == wanted))
        })
    };
    let seen = async {
        while !right(watch) {
            watch.changed().await;
        }
    };
    let seen = timeout(PATIENCE, seen).await;
    assert!(seen.is_ok(), "{wanted:?}: {:?}", watch.readings());
}

#[tokio::test(flavor = "multi_thread")]
async fn x_plane_is_as_it_was_found_after_a_dtd_that_was_killed_and_the_next_one_goes_on() {
    let simulator = SimulatorProcess::start(DTD, "12", None, &plugin::folder());
    let names = [
        datarefs::OVERRIDE_FLIGHT_MODEL,
        datarefs::PAUSED,
        "sim/graphics/view/view_is_external",
        "sim/graphics/view/field_of_view_deg",
        datarefs::CHANGE_MODE,
        datarefs::USE_SYSTEM_TIME,
    ];
    let mut watch = Subscription::start(simulator.udp(), names.map(str::to_owned), 20)
        .await
        .unwrap();
    // In a cockpit, with real weather, following the computer's clock.
    let found = [0.0, 0.0, 0.0, 60.0, 7.0, 1.0].map(Some);
    until_read(&mut watch, &found).await;
    let corpus = simulator.folder().join("corpus");
    let arguments = [
        "generate",
        SWEEP,
        "--only",
        HAZE,
        "--out",
        corpus.to_str().unwrap(),
    ];
    let mut making = simulator.dtd(&arguments).spawn().unwrap();
    let capturing = [Some(1.0), Some(1.0), Some(1.0), None, Some(3.0), Some(0.0)];
    until_read(&mut watch, &capturing).await;
    // SIGKILL.
    making.kill().unwrap();
    making.wait().unwrap();
    until_read(&mut watch, &found).await;
    simulator.dtd(&["doctor"]).output().unwrap();
    until_read(&mut watch, &found).await;
    made(&simulator, HAZE).unwrap();
    until_read(&mut watch, &found).await;
    assert!(farthest(&pictures(&corpus, HAZE), wanted("12", HAZE)) < ALIKE);
    watch.end().await;
}

/// Fails unless the haze's images differ from the expected ones when the plugin lacks its remedy for a habit.
fn assert_seen_without_remedy(quirk: &str, change: (&str, &str, &str)) {
    let folder = tempfile::tempdir().unwrap();
    let plugin = plugin::with(folder.path(), &[change]);
    let simulator = SimulatorProcess::start(DTD, "12", Some(quirk), &plugin);
    let corpus = made(&simulator, HAZE).unwrap();
    let apart = farthest(&pictures(&corpus, HAZE), wanted("12", HAZE));
    assert!(apart > ALIKE, "{apart}");
}

#[test]
fn the_comparison_of_pictures_sees_a_cockpit() {
    let remedy = "return self._datarefs.get_or(names.VIEW_IS_EXTERNAL, 1.0) != 0";
    assert_seen_without_remedy("cockpit_view", ("stage.py", remedy, "return True"));
}

#[test]
fn the_comparison_of_pictures_sees_a_pop_up() {
    let start = "by a command or a dataref.\"\"\"\n";
    let blind = format!("{start}        return\n");
    assert_seen_without_remedy("pop_ups", ("stage.py", start, &blind));
}

#[test]
fn the_comparison_of_pictures_sees_a_stale_frame() {
    let [remedy, blind] = ["frames", "1"].map(|n| format!("while stage.written - first < {n}:"));
    assert_seen_without_remedy("stale_frames", ("capture.py", &remedy, &blind));
}
