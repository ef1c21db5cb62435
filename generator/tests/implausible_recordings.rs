//! Recordings that are no approach in the units of their columns are rejected with the reason, before anything is planned; unusual
//! approaches are not. All are made from the recorded flights of tests/data/flights.

mod implausible;

use std::fs;
use std::path::Path;

use generator::airports;
use generator::recording::{Allowed, Recording};

use implausible::mistakes::mistakes;
use implausible::odd::unusual;
use implausible::table::Table;

const FLIGHTS: [&str; 6] = [
    "01_calm_ils",
    "03_xwind_right_mod_turb",
    "04_storm_gusts",
    "05_step_down_1500",
    "07_loc_offset_intercept",
    "10_from_3000ft_cda",
];
const TEN_MILES_M: f64 = 18_520.0;

fn read(text: &str, allow: &[Allowed]) -> Result<Recording, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.csv");
    fs::write(&path, text).unwrap();
    read_file(&path, allow)
}

fn read_file(path: &Path, allow: &[Allowed]) -> Result<Recording, String> {
    let runway = airports::bundled("WSSS", "02L").unwrap();
    Recording::read(path, &runway, TEN_MILES_M, allow).map_err(|error| error.to_string())
}

#[test]
fn every_kind_of_mistake_is_rejected_with_its_reason() {
    let mut accepted = Vec::new();
    for flight in FLIGHTS {
        for (kind, table, words) in mistakes(&Table::of(flight)) {
            match read(&table.text(","), &[]) {
                Ok(_) => accepted.push(format!("{flight}, {kind}: accepted")),
                Err(message) if !message.contains(words) => {
                    accepted.push(format!("{flight}, {kind}: {message}"));
                }
                Err(_) => {}
            }
        }
    }
    assert!(accepted.is_empty(), "{}", accepted.join("\n"));
}

/// A flight that banks by up to ten degrees.
const TURNING: &str = "04_storm_gusts";

#[test]
fn turns_tell_the_unit_and_the_sign_of_the_roll() {
    type Change = fn(f64) -> f64;
    let changes: [(Change, &str); 2] = [
        (f64::to_radians, "roll_deg that look like radians"),
        (|deg| -deg, "roll_deg that look like rolls to the left"),
    ];
    for (change, words) in changes {
        let table = Table::of(TURNING).changed("roll_deg", change);
        let message = read(&table.text(","), &[]).unwrap_err();
        assert!(message.contains(words), "{message}");
    }
}

#[test]
fn climbs_and_descents_tell_the_sign_of_the_pitch() {
    for flight in FLIGHTS {
        let table = Table::of(flight).changed("pitch_deg", |deg| -deg);
        let message = read(&table.text(","), &[]).unwrap_err();
        assert!(message.contains("pitch_deg"), "{flight}: {message}");
    }
}

#[test]
fn a_pitch_that_never_changes_is_accepted() {
    let good = Table::of(FLIGHTS[0]);
    let made_up = good
        .changed("pitch_deg", |_| 0.1)
        .changed("roll_deg", |_| 0.0);
    read(&made_up.text(","), &[]).unwrap();
}

#[test]
fn unusual_approaches_are_accepted() {
    let mut refused = Vec::new();
    for flight in FLIGHTS {
        for (kind, text) in unusual(&Table::of(flight)) {
            if let Err(message) = read(&text, &[]) {
                refused.push(format!("{flight}, {kind}: {message}"));
            }
        }
    }
    assert!(refused.is_empty(), "{}", refused.join("\n"));
}

#[test]
fn flights_that_are_meant_are_allowed_by_kind() {
    let good = Table::of(FLIGHTS[0]);
    let high = good
        .clone()
        .changed("altitude_msl_m", |m| m + 2_000.0)
        .changed("on_ground", |_| 0.0)
        .text(",");
    let message = read(&high, &[]).unwrap_err();
    assert!(message.contains("allow = [\"overflight\"]"), "{message}");
    let message = read(&high, &[Allowed::Overflight]).unwrap_err();
    assert!(message.contains("allow = [\"outside\"]"), "{message}");
    read(&high, &[Allowed::Overflight, Allowed::Outside]).unwrap();
    let beside = good.moved(113.02, 1_500.0).text(",");
    read(&beside, &[Allowed::Offset]).unwrap();
}

#[test]
fn the_last_landing_of_a_recording_with_two_is_flown() {
    let good = Table::of(FLIGHTS[0]);
    let time = good.place("t_s");
    let mut twice = good.clone();
    let last_s = good.rows.last().unwrap()[time];
    for row in &good.rows {
        let mut row = row.clone();
        row[time] += last_s + 600.0;
        twice.rows.push(row);
    }
    let [one, both] = [good.text(","), twice.text(",")].map(|text| read(&text, &[]).unwrap());
    let landed = |recording: &Recording| recording.trajectory.touchdown().unwrap();
    assert_eq!(landed(&one), landed(&both));
    let runway = airports::bundled("WSSS", "02L").unwrap();
    let window =
        |recording: &Recording| recording.trajectory.approach(&runway, TEN_MILES_M).unwrap();
    let starts_later_s = window(&both).start_s - window(&one).start_s;
    assert!(
        (starts_later_s - last_s - 600.0).abs() < 1e-6,
        "{starts_later_s}"
    );
}
