//! One arrival in the forms in which other people keep it: each gives the same recording or is refused with the reason, never a different
//! one in silence.

use std::fmt::Write as _;
use std::fs;
use std::io::Write as _;
use std::path::Path;

use dataset::geometry::geodesy::LatLon;
use dataset::geometry::runway::{Runway, RunwayCoordinates};
use dataset::tables::columns::TableWriter;
use flate2::Compression;
use flate2::write::GzEncoder;
use generator::airports;
use generator::recording::Recording;
use generator::tracks::{NamedColumn, TrackImport, import_tracks};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};
use testkit::repository;

const START_S: f64 = 1_633_616_958.0;
/// Geometric altitudes are above a different datum.
const GEOMETRIC_FT: f64 = 525.0;

fn runway() -> Runway {
    airports::bundled("WSSS", "02L").unwrap()
}

/// A receiver's report in the units of aviation.
#[derive(Clone)]
struct Report {
    time_s: f64,
    place: LatLon,
    altitude_ft: f64,
    knots: f64,
    track_deg: f64,
    roll_deg: f64,
    on_ground: bool,
}

fn arrival() -> Vec<Report> {
    let path = repository().join("tests/data/flights/03_xwind_right_mod_turb.csv");
    let flight = Recording::read(&path, &runway(), f64::MAX, &[]).unwrap();
    let window = flight.trajectory.approach(&runway(), f64::MAX).unwrap();
    let seconds = (window.last_s - window.start_s) as usize;
    let report = |second: usize| {
        let state = flight.trajectory.at(window.start_s + second as f64);
        let speed_mps = state.velocity_north_mps.hypot(state.velocity_east_mps);
        let track = state.velocity_east_mps.atan2(state.velocity_north_mps);
        Report {
            time_s: START_S + second as f64,
            place: state.pose.position().lat_lon(),
            altitude_ft: (state.pose.altitude_msl_m / 0.3048 / 25.0).round() * 25.0 + 300.0,
            knots: speed_mps * 3_600.0 / 1_852.0,
            track_deg: track.to_degrees().rem_euclid(360.0),
            roll_deg: state.pose.roll_deg,
            on_ground: state.on_ground,
        }
    };
    (0..=seconds).map(report).collect()
}

const HEADER: &str = "timestamp,icao24,latitude,longitude,altitude,groundspeed,track,onground";

/// A table of `traffic`, with its times in this form.
fn table(reports: &[Report], time: impl Fn(f64) -> String) -> String {
    let mut text = HEADER.to_owned();
    for report in reports {
        let Report {
            place,
            knots,
            track_deg,
            on_ground,
            ..
        } = report;
        let altitude = if *on_ground {
            String::new()
        } else {
            report.altitude_ft.to_string()
        };
        let (
            time,
            LatLon {
                latitude_deg,
                longitude_deg,
            },
        ) = (time(report.time_s), place);
        let _ = write!(
            text,
            "\n{time},abc123,{latitude_deg},{longitude_deg},{altitude},{knots:.0},{track_deg},{on_ground}"
        );
    }
    text
}

fn traffic(reports: &[Report]) -> String {
    table(reports, |time_s| format!("{:.0}", time_s * 1e3))
}

fn rows(reports: &[Report], header: &str, row: impl Fn(&Report) -> String) -> Vec<u8> {
    let rows = reports.iter().map(|report| format!("\n{}", row(report)));
    format!("{header}{}", rows.collect::<String>()).into_bytes()
}

/// `trace_full` of readsb; `source` and flags by the number of the row.
fn trace(reports: &[Report], source: &str, flags: impl Fn(usize) -> u64) -> Vec<u8> {
    let row = |(index, report): (usize, &Report)| {
        let altitude = if report.on_ground {
            json!("ground")
        } else {
            json!(report.altitude_ft)
        };
        let geometric_ft = report.altitude_ft + GEOMETRIC_FT;
        json!([
            report.time_s - START_S,
            report.place.latitude_deg,
            report.place.longitude_deg,
            altitude,
            report.knots,
            report.track_deg,
            flags(index),
            -700,
            null,
            source,
            geometric_ft,
            -700,
            140,
            report.roll_deg
        ])
    };
    let rows: Vec<Value> = reports.iter().enumerate().map(row).collect();
    serde_json::to_vec(&json!({"icao": "abc123", "timestamp": START_S, "trace": rows})).unwrap()
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

fn parquet(reports: &[Report], folder: &Path) -> Vec<u8> {
    let path = folder.join("table");
    let numbers = |number: fn(&Report) -> f64| reports.iter().map(number).collect::<Vec<_>>();
    TableWriter::new()
        .i64(
            "timestamp",
            reports
                .iter()
                .map(|report| report.time_s as i64 * 1_000_000_000),
        )
        .text("icao24", reports.iter().map(|_| "abc123"))
        .f64("latitude", numbers(|report| report.place.latitude_deg))
        .f64("longitude", numbers(|report| report.place.longitude_deg))
        .f64("altitude", numbers(|report| report.altitude_ft))
        .f64("groundspeed", numbers(|report| report.knots))
        .f64("track", numbers(|report| report.track_deg))
        .write(&path)
        .unwrap();
    fs::read(path).unwrap()
}

fn import(folder: &Path, name: &str, content: &[u8], columns: &str) -> TrackImport {
    let file = folder.join(name);
    fs::write(&file, content).unwrap();
    let columns = columns.split(',').filter(|column| !column.is_empty());
    let columns: Vec<NamedColumn> = columns.map(|column| column.parse().unwrap()).collect();
    import_tracks(&[file], &columns, &runway(), &folder.join("flights")).unwrap()
}

/// Distance to go, offset and height every ten seconds.
fn path_of(recording: &Path) -> Vec<[f64; 3]> {
    let made = Recording::read(recording, &runway(), f64::MAX, &[]).unwrap();
    let target = runway().touchdown_target();
    let place = |second: usize| {
        let position = made.trajectory.at(second as f64).pose.position();
        let at = RunwayCoordinates::of(position, target, runway().course_true_deg);
        [at.along_track_m, at.cross_track_m, at.height_over_target_m]
    };
    (20..)
        .step_by(10)
        .map(place)
        .take_while(|at| at[0] > 300.0)
        .collect()
}

/// Forms of the same arrival: name, content, and `--columns`.
fn same(all: &[Report], folder: &Path) -> Vec<(&'static str, Vec<u8>, &'static str)> {
    let plain = traffic(all);
    let iso = |pattern: &'static str| {
        move |time_s: f64| {
            chrono::DateTime::from_timestamp(time_s as i64, 0)
                .unwrap()
                .format(pattern)
                .to_string()
        }
    };
    let bytes = |text: String| text.into_bytes();
    let reversed: Vec<Report> = all.iter().rev().cloned().collect();
    let every = |n: usize| all.iter().step_by(n).cloned().collect::<Vec<_>>();
    let twice: Vec<Report> = all
        .iter()
        .flat_map(|report| [report.clone(), report.clone()])
        .collect();
    let mut other = all[0].clone();
    other.place.latitude_deg += 10.0;
    let with_other = plain.clone() + &traffic(&[other])[HEADER.len()..].replace("abc123", "def456");
    let quoted = HEADER
        .split(',')
        .map(|name| format!("\"{name}\""))
        .collect::<Vec<_>>()
        .join(",");
    let place = |report: &Report| {
        format!(
            "{},{}",
            report.place.latitude_deg, report.place.longitude_deg
        )
    };
    let tartan = |report: &Report| {
        let text = chrono::DateTime::from_timestamp(report.time_s as i64, 0).unwrap();
        let [time, date] = ["['%H', '%M', '%S.000']", "['%Y', '%m', '%d']"]
            .map(|form| text.format(form).to_string());
        let Report {
            altitude_ft,
            knots,
            track_deg,
            ..
        } = report;
        format!(
            "7,\"{time}\",\"{date}\",{altitude_ft},{knots},{track_deg},{},1.0,False",
            place(report)
        )
    };
    let tartan_header = "ID,Time,Date,Altitude,Speed,Heading,Lat,Lon,Age,AltisGNSS";
    let radar = |report: &Report| {
        let altitude_ft = if report.on_ground {
            0.0
        } else {
            report.altitude_ft
        };
        let Report {
            time_s,
            knots,
            track_deg,
            ..
        } = report;
        format!(
            "{time_s},2021-10-07T14:29:18Z,AFR1,\"{}\",{altitude_ft},{knots:.0},{track_deg:.0}",
            place(report)
        )
    };
    let radar_header = "Timestamp,UTC,Callsign,Position,Altitude,Speed,Direction";
    let open_sky = |is_geometric: bool| {
        move |report: &Report| {
            let [barometric, geometric] = if is_geometric {
                [
                    String::new(),
                    ((report.altitude_ft + GEOMETRIC_FT) * 0.3048).to_string(),
                ]
            } else {
                [(report.altitude_ft * 0.3048).to_string(), String::new()]
            };
            let Report {
                time_s,
                knots,
                track_deg,
                on_ground,
                ..
            } = report;
            let mps = knots * 1_852.0 / 3_600.0;
            format!(
                "{time_s},abc123,{},{mps},{track_deg},{on_ground},{barometric},{geometric}",
                place(report)
            )
        }
    };
    let open_sky_header = "time,icao24,lat,lon,velocity,heading,onground,baroaltitude,geoaltitude";
    let own = |report: &Report| {
        let height_m = report.altitude_ft * 0.3048;
        let Report {
            time_s,
            knots,
            track_deg,
            ..
        } = report;
        format!(
            "{time_s};{};{height_m};{};{track_deg}",
            place(report).replace(',', ";"),
            knots * 1.852
        )
    };
    let own_columns = "time=Zeit,latitude=Breite,longitude=L\u{e4}nge,altitude_m=H\u{f6}he,speed_kmh=v,track=Kurs";
    let own_header = "Zeit;Breite;L\u{e4}nge;H\u{f6}he;v;Kurs";
    let stale = {
        let mut rows = all.to_vec();
        for index in (50..rows.len()).step_by(40) {
            rows[index].place = rows[index - 30].place;
        }
        trace(&rows, "adsb_icao", |index| {
            u64::from(index >= 50 && (index - 50).is_multiple_of(40))
        })
    };
    vec![
        ("traffic", bytes(plain.clone()), ""),
        ("semicolons", bytes(plain.replace(',', ";")), ""),
        ("tabs", bytes(plain.replace(',', "\t")), ""),
        ("bars", bytes(plain.replace(',', "|")), ""),
        (
            "Windows",
            bytes(format!("\u{feff}{}", plain.replace('\n', "\r\n"))),
            "",
        ),
        ("quoted names", bytes(plain.replace(HEADER, &quoted)), ""),
        (
            "other case",
            bytes(plain.replace(HEADER, &HEADER.to_uppercase())),
            "",
        ),
        (
            "seconds",
            bytes(table(all, |time_s| time_s.to_string())),
            "",
        ),
        (
            "microseconds",
            bytes(table(all, |time_s| format!("{:.0}", time_s * 1e6))),
            "",
        ),
        (
            "nanoseconds",
            bytes(table(all, |time_s| format!("{:.0}", time_s * 1e9))),
            "",
        ),
        (
            "dates with zone",
            bytes(table(all, iso("%Y-%m-%d %H:%M:%S+00:00"))),
            "",
        ),
        (
            "dates with T and Z",
            bytes(table(all, iso("%Y-%m-%dT%H:%M:%SZ"))),
            "",
        ),
        (
            "dates without zone",
            bytes(table(all, iso("%Y-%m-%d %H:%M:%S"))),
            "",
        ),
        ("last row first", bytes(traffic(&reversed)), ""),
        ("each row twice", bytes(traffic(&twice)), ""),
        ("every third row", bytes(traffic(&every(3))), ""),
        ("beside another aircraft", bytes(with_other), ""),
        ("gzip", gzip(plain.as_bytes()), ""),
        ("OpenSky", rows(all, open_sky_header, open_sky(false)), ""),
        (
            "OpenSky, geometric altitude alone",
            rows(all, open_sky_header, open_sky(true)),
            "",
        ),
        ("Flightradar24", rows(&every(4), radar_header, radar), ""),
        ("TartanAviation", rows(all, tartan_header, tartan), ""),
        ("readsb", trace(all, "adsb_icao", |_| 0), ""),
        ("readsb, gzip", gzip(&trace(all, "adsb_icao", |_| 0)), ""),
        ("readsb with stale positions", stale, ""),
        ("Parquet", parquet(all, folder), ""),
        (
            "names of one's own",
            rows(all, own_header, own),
            own_columns,
        ),
    ]
}

/// Forms that are not the arrival, and words of the reason.
fn different(all: &[Report]) -> Vec<(&'static str, Vec<u8>, &'static str)> {
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let mut noisy = all.to_vec();
    for report in &mut noisy {
        let normal: f64 = (0..12).map(|_| rng.random_range(-0.5..0.5_f64)).sum();
        report.place = report
            .place
            .destination(rng.random_range(0.0..360.0), 80.0 * normal);
    }
    let late = |by_s: f64, aside_m: f64| {
        let moved = all.iter().map(|report| Report {
            time_s: report.time_s + by_s,
            place: report.place.destination(113.0, aside_m),
            ..report.clone()
        });
        let mut both: Vec<Report> = all.iter().cloned().chain(moved).collect();
        both.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        traffic(&both).into_bytes()
    };
    let changed = |change: &dyn Fn(&mut Report)| {
        let mut reports = all.to_vec();
        reports.iter_mut().for_each(change);
        traffic(&reports).into_bytes()
    };
    let outliers = "positions are not on one path";
    vec![
        ("two feeds, one 35 s old", late(35.4, 0.0), outliers),
        ("two feeds, one 5 s old", late(5.4, 0.0), outliers),
        ("two aircraft without names", late(0.4, 400.0), outliers),
        ("noise of 80 m", traffic(&noisy).into_bytes(), outliers),
        (
            "multilateration",
            trace(&noisy, "mlat", |_| 0),
            "positions from multilateration or radar",
        ),
        (
            "metres as feet",
            changed(&|report| report.altitude_ft *= 0.3048),
            "degrees between 0.7 and 4 NM",
        ),
        (
            "km/h as knots",
            changed(&|report| report.knots *= 1.852),
            outliers,
        ),
        (
            "m/s as knots",
            changed(&|report| report.knots *= 0.514_444),
            outliers,
        ),
        (
            "tracks of the other way",
            changed(&|report| report.track_deg = (report.track_deg + 180.0) % 360.0),
            outliers,
        ),
    ]
}

#[test]
fn every_form_of_an_arrival_gives_the_same_recording() {
    let all = arrival();
    let folder = tempfile::tempdir().unwrap();
    let mut expected: Option<Vec<[f64; 3]>> = None;
    for (number, (form, content, columns)) in same(&all, folder.path()).into_iter().enumerate() {
        let found = import(folder.path(), &format!("form-{number}"), &content, columns);
        assert_eq!(found.imported.len(), 1, "{form}: {found:?}");
        let path = path_of(&found.imported[0].recording);
        let expected = expected.get_or_insert_with(|| path.clone());
        assert!(path.len().abs_diff(expected.len()) < 2, "{form}");
        for (here, there) in path.iter().zip(expected) {
            // Positions every four seconds say less about gusts, and geometric altitudes are not stretched to the glide path.
            let off_m = [0, 1, 2].map(|axis| (here[axis] - there[axis]).abs());
            assert!(
                off_m[0] < 25.0 && off_m[1] < 8.0 && off_m[2] < 12.0,
                "{form}: {here:?} instead of {there:?}"
            );
        }
    }
}

#[test]
fn what_is_not_one_arrival_is_refused_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    for (form, content, words) in different(&arrival()) {
        let found = import(folder.path(), "track.csv", &content, "");
        assert_eq!(found.imported, [], "{form}");
        let reason = &found.refused[0].reason;
        assert!(reason.contains(words), "{form}: {reason}");
    }
}

#[test]
fn each_arrival_of_an_aircraft_gives_a_recording_and_a_second_call_changes_nothing() {
    let all = arrival();
    let mut day = all.clone();
    day.extend(all.iter().map(|report| Report {
        time_s: report.time_s + 7_200.0,
        ..report.clone()
    }));
    let folder = tempfile::tempdir().unwrap();
    let found = import(folder.path(), "day.csv", traffic(&day).as_bytes(), "");
    let names: Vec<_> = found
        .imported
        .iter()
        .map(|track| track.recording.file_name().unwrap())
        .collect();
    assert_eq!(names, ["day-1.csv", "day-2.csv"], "{found:?}");
    let [first, second] = [0, 1].map(|number| path_of(&found.imported[number].recording));
    for (first, second) in first.iter().flatten().zip(second.iter().flatten()) {
        assert!((first - second).abs() < 0.01, "{first} {second}");
    }
    let again = import(folder.path(), "day.csv", traffic(&day).as_bytes(), "");
    assert_eq!(again, found);
    fs::write(&found.imported[0].recording, "a person's").unwrap();
    let again = import(folder.path(), "day.csv", traffic(&day).as_bytes(), "");
    assert_eq!((again.imported.len(), again.refused.len()), (1, 1));
    assert!(
        again.refused[0]
            .reason
            .contains("exists already with other content")
    );
    assert_eq!(
        fs::read_to_string(&found.imported[0].recording).unwrap(),
        "a person's"
    );
}

#[test]
fn reported_rolls_are_kept_and_marked() {
    let all = arrival();
    let folder = tempfile::tempdir().unwrap();
    let found = import(
        folder.path(),
        "trace.json",
        &trace(&all, "adsb_icao", |_| 0),
        "",
    );
    let path = &found.imported[0].recording;
    assert!(
        fs::read_to_string(path)
            .unwrap()
            .contains(",roll,measured\n")
    );
    let made = Recording::read(path, &runway(), f64::MAX, &[]).unwrap();
    for report in all.iter().skip(30).take(100) {
        let roll_deg = made.trajectory.at(report.time_s - START_S).pose.roll_deg;
        assert!(
            (roll_deg - report.roll_deg).abs() < 0.5,
            "{roll_deg} {}",
            report.roll_deg
        );
    }
}
