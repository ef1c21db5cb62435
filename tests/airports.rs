//! Any built-in airport flies: a sweep names it, and local time, sun, heights, scenery and labels follow.

mod tiny;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;
use testkit::command::{Dtd, Ending, json, said};
use testkit::{program_of_venv, repository};
use tiny::{MODEL, Tiny};

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));

/// Airports in both hemispheres, on both sides of Greenwich, at 7 to 2,545 m.
const AIRPORTS: [(&str, &str); 9] = [
    ("BIKF", "19"),
    ("EGLL", "27L"),
    ("FIMP", "32"),
    ("HAAB", "25R"),
    ("KLAX", "25L"),
    ("LSZH", "14"),
    ("SBGR", "28L"),
    ("SKBO", "14R"),
    ("WSSS", "02L"),
];

fn sweep(folder: &Path, (airport, runway): (&str, &str), changes: &[(&str, &str)]) -> PathBuf {
    let mut text = fs::read_to_string(repository().join("tests/data/airport.toml")).unwrap();
    let airport_line = format!("airport = \"{airport}\"");
    let runway_line = format!("runway = \"{runway}\"");
    let own = [
        ("airport = \"LSZH\"", airport_line.as_str()),
        ("runway = \"14\"", runway_line.as_str()),
    ];
    for (from, to) in own.iter().chain(changes) {
        assert!(text.contains(from), "{from}");
        text = text.replace(from, to);
    }
    let path = folder.join(format!("{airport}.toml"));
    fs::write(&path, text).unwrap();
    path
}

fn plan(sweep: &Path) -> Value {
    let output = DTD.succeeds(&["plan", sweep.to_str().unwrap(), "--json"]);
    json(&output)
}

#[test]
fn the_sun_is_within_a_tenth_of_a_degree_of_an_almanac_also_across_changes_of_daylight_saving() {
    let folder = tempfile::tempdir().unwrap();
    let mut plans = Vec::new();
    for airport in AIRPORTS {
        // Clocks change in Europe between days 84 and 85 and back between 301 and 302, in California between 70 and 71.
        for day in [1, 70, 71, 84, 85, 172, 301, 302, 355] {
            let day_of_year = format!("day_of_year = {day}");
            let times = r#"times = ["sunrise", "09:00", "12:30", "sunset-00:20", "dusk"]"#;
            let changes = [
                ("day_of_year = 172", day_of_year.as_str()),
                (r#"times = ["sunset-00:40", "12:00"]"#, times),
            ];
            // Above Iceland the night of midsummer has no dusk.
            if airport.0 == "BIKF" && day == 172 {
                continue;
            }
            let document = plan(&sweep(folder.path(), airport, &changes));
            let path = folder.path().join(format!("{}-{day}.json", airport.0));
            fs::write(&path, document.to_string()).unwrap();
            plans.push(path);
        }
    }
    let judged = Command::new(program_of_venv("python"))
        .arg(repository().join("tests/judges/sun.py"))
        .args(&plans)
        .succeeds();
    let verdict = json(&judged);
    assert_eq!(verdict["airports"], AIRPORTS.len());
    assert_eq!(verdict["rows"], 5 * (9 * AIRPORTS.len() - 1));
}

#[test]
fn a_time_by_the_sun_has_the_elevation_that_it_asks_for_and_names_its_scenario_by_the_clock() {
    let folder = tempfile::tempdir().unwrap();
    let times = r#"times = [{ sun_elevation_deg = -4, in = "evening" }, { sun_elevation_deg = 30, in = "morning" }]"#;
    let changes = [(r#"times = ["sunset-00:40", "12:00"]"#, times)];
    for airport in [("LSZH", "14"), ("SBGR", "28L")] {
        let document = plan(&sweep(folder.path(), airport, &changes));
        for (scenario, wanted_deg) in document["scenarios"]
            .as_array()
            .unwrap()
            .iter()
            .zip([-4.0, 30.0])
        {
            let found_deg = scenario["sun_elevation_deg"].as_f64().unwrap();
            assert!((found_deg - wanted_deg).abs() < 0.13, "{scenario}");
            let time = scenario["time_of_day"].as_str().unwrap().replace(':', "");
            assert_eq!(scenario["id"], format!("{time}-clear-r1"));
        }
    }
}

#[test]
fn a_time_that_the_sun_does_not_have_and_another_places_clock_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |airport, changes: &[(&str, &str)]| {
        let path = sweep(folder.path(), airport, changes);
        let output = DTD.run(&["plan", path.to_str().unwrap()]);
        assert_eq!(output.status.code(), Some(2));
        said(&output)
    };
    let dusk = [("\"sunset-00:40\"", "\"dusk\"")];
    let message = refused(("BIKF", "19"), &dusk);
    assert!(
        message.contains("does not pass -6 degrees in the evening of day 172"),
        "{message}"
    );
    let own_zone =
        "day_of_year = 172\nutc_offset_h = 1\n[airport.LSZH]\ntime_zone = \"Europe/Zurich\"\n";
    let message = refused(("LSZH", "14"), &[("day_of_year = 172", own_zone)]);
    assert!(
        message.contains("(Europe/Zurich) are 2 h ahead of UTC on day 172"),
        "{message}"
    );
    // Against the built-in time zone it is only said.
    let winter_time = [("day_of_year = 172", "day_of_year = 172\nutc_offset_h = 1")];
    let path = sweep(folder.path(), ("LSZH", "14"), &winter_time);
    let output = DTD.succeeds(&["plan", path.to_str().unwrap()]);
    let words = "2 h by the time zone of LSZH on day 172";
    assert!(said(&output).contains(words), "{}", said(&output));
}

#[test]
fn two_airports_of_both_hemispheres_are_recorded_and_verified_and_the_plan_says_where_views_see_the_aircraft()
 {
    let folder = tempfile::tempdir().unwrap();
    let small = [
        ("width_px = 960", "width_px = 480"),
        ("height_px = 640", "height_px = 320"),
        (
            "kind = \"cumulus\", cover_ratio = 0.3",
            "kind = \"cumulus\", cover_ratio = 0.1",
        ),
    ];
    for airport in [("FIMP", "32"), ("SKBO", "14R")] {
        let sweep = sweep(folder.path(), airport, &small);
        let document = plan(&sweep);
        let profile_m =
            document["outlook"]["profiles_above_runway_m"]["level-then-glide-path"].as_f64();
        assert!((profile_m.unwrap() - 755.3).abs() < 0.1, "{document}");
        for view in document["outlook"]["views"].as_array().unwrap() {
            let enters_nm = view["enters_nm"][1].as_f64().unwrap();
            let leaves_nm = view["leaves_nm"][0].as_f64().unwrap();
            assert!(enters_nm > 2.0 && leaves_nm < 1.0, "{view}");
        }
        let corpus = folder.path().join(airport.0);
        let (sweep, corpus) = (sweep.to_str().unwrap(), corpus.to_str().unwrap());
        for command in [
            &["generate", sweep, "--sim", "mock", "--out", corpus][..],
            &["label", corpus],
            &["verify", corpus],
        ] {
            DTD.succeeds(command);
        }
    }
}

#[test]
fn a_run_is_judged_at_another_airport_with_the_same_rig_and_refused_with_another() {
    let tiny = Tiny::made();
    let folder = tempfile::tempdir().unwrap();
    let text = fs::read_to_string(tiny.path("sweep.toml")).unwrap();
    let elsewhere = text
        .replace("airport = \"WSSS\"", "airport = \"FIMP\"")
        .replace("runway = \"02L\"", "runway = \"32\"")
        .replace("utc_offset_h = 8\n", "")
        .replace("repeats = 5", "repeats = 2")
        .replace("name = \"tiny\"", "name = \"elsewhere\"");
    assert!(elsewhere.contains("\"FIMP\"") && !elsewhere.contains("\"02L\""));
    let cases = [
        ("same", elsewhere.clone(), true),
        (
            "turned",
            elsewhere.replace("rig = \"wide-baseline\"", "rig = \"seed\""),
            false,
        ),
    ];
    for (name, text, is_judged) in cases {
        let sweep = folder.path().join(format!("{name}.toml"));
        fs::write(&sweep, text).unwrap();
        let [corpus, judged] =
            ["corpus", "judged"].map(|what| folder.path().join(format!("{name}-{what}")));
        let (sweep, corpus) = (sweep.to_str().unwrap(), corpus.to_str().unwrap());
        for command in [
            &["generate", sweep, "--sim", "mock", "--out", corpus][..],
            &["label", corpus],
            &["detect", corpus, "--model", MODEL],
        ] {
            tiny.dtd(command).succeeds();
        }
        let evaluate = [
            "evaluate", "run", "--corpus", corpus, "--side", "all", "--out",
        ];
        let command = [&evaluate[..], &[judged.to_str().unwrap()]].concat();
        let output = tiny.dtd(&command).output().unwrap();
        if is_judged {
            assert!(output.status.success(), "{}", said(&output));
            let metrics: Value =
                serde_json::from_str(&fs::read_to_string(judged.join("metrics.json")).unwrap())
                    .unwrap();
            let ticks = metrics["ticks"]["there"].as_u64();
            assert!(ticks.is_some_and(|ticks| ticks > 0), "{metrics}");
        } else {
            assert_eq!(output.status.code(), Some(2), "{}", said(&output));
            assert!(said(&output).contains("camera"), "{}", said(&output));
        }
    }
}
