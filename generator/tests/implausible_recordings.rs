//! Recordings that are no approach in the units of their columns are rejected with the reason, before anything is planned; unusual
//! approaches are not. All of them are made from the recorded flights of tests/data/flights.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use dataset::geometry::geodesy::LatLon;
use generator::airports;
use generator::recording::{Allowed, Recording};
use testkit::repository;

const FLIGHTS: [&str; 6] = [
    "01_calm_ils",
    "03_xwind_right_mod_turb",
    "04_storm_gusts",
    "05_step_down_1500",
    "07_loc_offset_intercept",
    "10_from_3000ft_cda",
];
const TEN_MILES_M: f64 = 18_520.0;

/// A recording as a table that can be changed.
#[derive(Clone)]
struct Table {
    columns: Vec<String>,
    rows: Vec<Vec<f64>>,
}

impl Table {
    fn of(flight: &str) -> Self {
        let path = repository().join(format!("tests/data/flights/{flight}.csv"));
        let text = fs::read_to_string(path).unwrap();
        let mut lines = text.lines();
        let columns = lines.next().unwrap().split(',').map(str::to_owned);
        let numbers = |line: &str| {
            line.split(',')
                .map(|field| field.parse().unwrap())
                .collect()
        };
        Self {
            columns: columns.collect(),
            rows: lines.map(numbers).collect(),
        }
    }

    fn place(&self, column: &str) -> usize {
        self.columns.iter().position(|name| name == column).unwrap()
    }

    fn changed(mut self, column: &str, change: impl Fn(f64) -> f64) -> Self {
        let place = self.place(column);
        for row in &mut self.rows {
            row[place] = change(row[place]);
        }
        self
    }

    /// Moves every position by metres towards an azimuth.
    fn moved(mut self, azimuth_deg: f64, metres: f64) -> Self {
        let [latitude, longitude] = [self.place("latitude_deg"), self.place("longitude_deg")];
        for row in &mut self.rows {
            let here = LatLon {
                latitude_deg: row[latitude],
                longitude_deg: row[longitude],
            };
            let there = here.destination(azimuth_deg, metres);
            (row[latitude], row[longitude]) = (there.latitude_deg, there.longitude_deg);
        }
        self
    }

    fn swapped(mut self, one: &str, other: &str) -> Self {
        let [one, other] = [self.place(one), self.place(other)];
        for row in &mut self.rows {
            row.swap(one, other);
        }
        self
    }

    fn text(&self, separator: &str) -> String {
        let mut text = self.columns.join(separator);
        for row in &self.rows {
            let fields: Vec<String> = row.iter().map(f64::to_string).collect();
            text += &format!("\n{}", fields.join(separator));
        }
        text
    }
}

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

/// Kinds of mistakes, and words of the reason.
fn mistakes(good: &Table) -> BTreeMap<&'static str, (Table, &'static str)> {
    let course_deg = 23.02;
    let scaled = |column: &str, factor: f64| good.clone().changed(column, |value| value * factor);
    let velocities = |factor: f64| {
        let north = scaled("v_north_mps", factor);
        north.changed("v_east_mps", |value| value * factor)
    };
    let radians = |columns: &[&str]| {
        columns.iter().fold(good.clone(), |table, column| {
            table.changed(column, f64::to_radians)
        })
    };
    BTreeMap::from([
        (
            "pressure altitude of a low",
            (
                good.clone().changed("altitude_msl_m", |m| m - 123.0),
                "below the runway",
            ),
        ),
        (
            "pressure altitude of a high",
            (
                good.clone().changed("altitude_msl_m", |m| m + 123.0),
                "pressure altitude",
            ),
        ),
        (
            "flight level",
            (
                good.clone().changed("altitude_msl_m", |m| m + 10_900.0),
                "pressure altitude",
            ),
        ),
        (
            "altitude in feet",
            (
                scaled("altitude_msl_m", 3.280_84),
                "altitude_msl_m that look like feet",
            ),
        ),
        (
            "climb instead of sink",
            (
                scaled("v_down_mps", -1.0),
                "v_down_mps that look like velocities upwards",
            ),
        ),
        (
            "sink in feet per minute",
            (scaled("v_down_mps", 19.685), "v_down_mps"),
        ),
        ("no sink", (scaled("v_down_mps", 0.0), "v_down_mps")),
        (
            "velocities in knots",
            (
                velocities(1.943_84),
                "v_north_mps and v_east_mps that look like knots",
            ),
        ),
        (
            "velocities in km/h",
            (velocities(3.6), "look like kilometres per hour"),
        ),
        (
            "airspeed in knots",
            (scaled("tas_mps", 1.943_84), "tas_mps"),
        ),
        (
            "airspeed in km/h",
            (scaled("tas_mps", 3.6 * 0.55), "tas_mps"),
        ),
        (
            "no airspeed",
            (scaled("tas_mps", 0.0), "tas_mps is 0.00 times"),
        ),
        (
            "places in radians",
            (
                radians(&["latitude_deg", "longitude_deg"]),
                "look like radians",
            ),
        ),
        (
            "heading in radians",
            (
                radians(&["heading_true_deg"]),
                "heading_true_deg that look like radians",
            ),
        ),
        (
            "attitude in radians",
            (
                radians(&["pitch_deg", "roll_deg"]),
                "pitch_deg and roll_deg that look like radians",
            ),
        ),
        (
            "latitude and longitude swapped",
            (
                good.clone().swapped("latitude_deg", "longitude_deg"),
                "swapped coordinates",
            ),
        ),
        (
            "southern latitude",
            (scaled("latitude_deg", -1.0), "southern latitudes"),
        ),
        (
            "western longitude",
            (scaled("longitude_deg", -1.0), "western longitudes"),
        ),
        (
            "flying backwards",
            (
                good.clone()
                    .changed("heading_true_deg", |deg| (deg + 180.0) % 360.0),
                "flies backwards",
            ),
        ),
        (
            "flying sideways",
            (
                good.clone()
                    .changed("heading_true_deg", |deg| (deg + 90.0) % 360.0),
                "heading and track differ",
            ),
        ),
        (
            "north and east swapped",
            (good.clone().swapped("v_north_mps", "v_east_mps"), ""),
        ),
        (
            "parallel runway",
            (
                good.clone().moved(course_deg + 90.0, 1_500.0),
                "m right of the centreline",
            ),
        ),
        (
            "far to the side",
            (
                good.clone().moved(course_deg - 90.0, 20_000.0),
                "m left of the centreline",
            ),
        ),
        (
            "times in milliseconds",
            (scaled("t_s", 1e3), "t_s that look like milliseconds"),
        ),
        (
            "times in minutes",
            (scaled("t_s", 1.0 / 60.0), "t_s that look like minutes"),
        ),
        (
            "always on the ground",
            (good.clone().changed("on_ground", |_| 1.0), "on_ground"),
        ),
        ("two rows", {
            let mut table = good.clone();
            let last = table.rows.len() - 1;
            let passing =
                (0..last).find(|&row| table.rows[row][table.place("latitude_deg")] > 1.3518);
            let passing = passing.unwrap();
            table.rows = table.rows[passing - 1..=passing].to_vec();
            (table, "allow = [\"part\"]")
        }),
        ("half an approach", {
            let mut table = good.clone();
            let rows = table.rows.len();
            table.rows.truncate(rows / 2);
            (
                table,
                "m before the touchdown target of WSSS 02L; if this is meant, add `allow = [\"part\"]`",
            )
        }),
        ("time that stands still", (scaled("t_s", 0.0), "")),
        ("time that runs backwards", (scaled("t_s", -1.0), "")),
    ])
}

#[test]
fn every_kind_of_mistake_is_rejected_with_its_reason() {
    let mut accepted = Vec::new();
    for flight in FLIGHTS {
        for (kind, (table, words)) in mistakes(&Table::of(flight)) {
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
    let good = Table::of(TURNING);
    let radians = good.clone().changed("roll_deg", f64::to_radians);
    let message = read(&radians.text(","), &[]).unwrap_err();
    assert!(
        message.contains("roll_deg that look like radians"),
        "{message}"
    );
    let left = good.clone().changed("roll_deg", |deg| -deg);
    let message = read(&left.text(","), &[]).unwrap_err();
    assert!(
        message.contains("roll_deg that look like rolls to the left"),
        "{message}"
    );
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
    let course_deg = 23.02;
    let mut refused = Vec::new();
    for flight in FLIGHTS {
        let good = Table::of(flight);
        let later = {
            let mut table = good.clone();
            // A fault an hour before the approach.
            let mut early = table.rows[0].clone();
            early[0] -= 3_600.0;
            early[table.place("pitch_deg")] = 400.0;
            table.rows.insert(0, early);
            table
        };
        let kinds = [
            ("as it is", good.text(",")),
            ("semicolons", good.text(";")),
            ("tabs", good.text("\t")),
            (
                "half a runway's width to the side",
                good.clone().moved(course_deg + 90.0, 25.0).text(","),
            ),
            (
                "ten metres higher",
                good.clone()
                    .changed("altitude_msl_m", |m| m + 10.0)
                    .text(","),
            ),
            ("a fault an hour before", later.text(",")),
            (
                "level wings and nose",
                good.clone()
                    .changed("pitch_deg", |_| 0.0)
                    .changed("roll_deg", |_| 0.0)
                    .text(","),
            ),
            (
                "clock time in seconds",
                good.clone().changed("t_s", |s| s + 1.7e9).text(","),
            ),
            (
                "a crab of 20 degrees",
                good.clone()
                    .changed("heading_true_deg", |deg| (deg + 20.0) % 360.0)
                    .text(","),
            ),
            (
                "a tailwind of 15 m/s",
                good.clone()
                    .changed("tas_mps", |mps| (mps - 15.0).max(0.0))
                    .text(","),
            ),
            (
                "words for the ground",
                good.text(",")
                    .replace(",0\n", ",False\n")
                    .replace(",1\n", ",True\n"),
            ),
        ];
        for (kind, text) in kinds {
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
