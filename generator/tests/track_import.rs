//! Tracks of receivers become recordings. They are made from recorded flights as a receiver would report them: late positions at full
//! seconds, repeated rows, altitudes in steps of 25 ft above another pressure.

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

use dataset::geometry::pose::FlightState;
use dataset::geometry::runway::{Runway, RunwayCoordinates};
use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;
use generator::airports;
use generator::recording::Recording;
use generator::tracks::{TrackImport, import_tracks};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use testkit::repository;

fn runway() -> Runway {
    airports::bundled("WSSS", "02L").unwrap()
}

fn recording(path: &Path) -> Recording {
    Recording::read(path, &runway(), f64::MAX, &[]).unwrap()
}

fn flight() -> Recording {
    recording(&repository().join("tests/data/flights/03_xwind_right_mod_turb.csv"))
}

/// Distance to go, offset to the right, height above the target, metres.
fn place(state: &FlightState) -> [f64; 3] {
    let runway = runway();
    let target = runway.touchdown_target();
    let at = RunwayCoordinates::of(state.pose.position(), target, runway.course_true_deg);
    [at.along_track_m, at.cross_track_m, at.height_over_target_m]
}

/// What a receiver reports.
#[derive(Clone)]
struct Report {
    time_s: f64,
    state: FlightState,
    /// Age of its position, seconds.
    age_s: f64,
}

fn reports(flight: &Recording) -> Vec<Report> {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let window = flight.trajectory.approach(&runway(), f64::MAX).unwrap();
    let first_s = window.start_s.ceil();
    let last_s = window.last_s;
    let mut all = Vec::new();
    let mut time_s = first_s;
    while time_s < last_s {
        let age_s = rng.random_range(0.0..0.5);
        all.push(Report {
            time_s,
            state: flight.trajectory.at(time_s - age_s),
            age_s,
        });
        time_s += 1.0;
    }
    all
}

/// In the columns of `traffic`, with each position repeated once.
fn csv(reports: &[Report], qnh_m: f64) -> String {
    let mut text =
        "timestamp,icao24,latitude,longitude,altitude,groundspeed,track,vertical_rate,onground\n"
            .to_owned();
    for report in reports {
        for repeat in 0..2 {
            let state = &report.state;
            let feet = ((state.pose.altitude_msl_m + qnh_m) / 0.3048 / 25.0).round() * 25.0;
            let knots = state.velocity_north_mps.hypot(state.velocity_east_mps) * 3_600.0 / 1_852.0;
            let track = state
                .velocity_east_mps
                .atan2(state.velocity_north_mps)
                .to_degrees();
            let altitude = if state.on_ground {
                String::new()
            } else {
                feet.to_string()
            };
            let milliseconds = (report.time_s * 1e3) as i64 + 500 * repeat + 1_600_000_000_000;
            let _ = writeln!(
                text,
                "{milliseconds},abc123,{},{},{altitude},{:.0},{},0,{}",
                state.pose.latitude_deg,
                state.pose.longitude_deg,
                knots.round(),
                track.rem_euclid(360.0),
                if state.on_ground { "True" } else { "False" }
            );
        }
    }
    text
}

fn import(folder: &Path, text: &str) -> TrackImport {
    let file = folder.join("track.csv");
    fs::write(&file, text).unwrap();
    let out = folder.join("flights");
    fs::create_dir_all(&out).unwrap();
    import_tracks(&[file], &runway(), &out).unwrap()
}

/// The only recording of an import.
fn only(import: &TrackImport) -> PathBuf {
    assert_eq!(import.refused, []);
    import.imported[0].recording.clone()
}

#[test]
fn an_arrival_is_flown_where_it_was_measured_at_its_true_height() {
    let flight = flight();
    let reports = reports(&flight);
    for qnh_m in [-200.0, 0.0, 116.0] {
        let folder = tempfile::tempdir().unwrap();
        let found = import(folder.path(), &csv(&reports, qnh_m));
        let made = recording(&only(&found));
        assert!(found.imported[0].continued_s < 10.0, "{found:?}");
        let first_s = reports[0].time_s;
        let mut worst = [0.0_f64; 3];
        for report in &reports {
            let truth = place(&report.state);
            let here = place(&made.trajectory.at(report.time_s - first_s));
            if !(0.0..16_000.0).contains(&truth[0]) {
                continue;
            }
            // Positions are a quarter of a second old on average, which no receiver knows.
            let moved_m = 0.5 * 80.0;
            let off = [0, 1, 2].map(|axis| (here[axis] - truth[axis]).abs());
            assert!(off[0] < moved_m && off[1] < 8.0, "{off:?} at {truth:?}");
            if truth[0] < METERS_PER_NAUTICAL_MILE {
                assert!(off[2] < 6.0, "{off:?} at {truth:?}");
            }
            worst = [0, 1, 2].map(|axis| worst[axis].max(off[axis]));
            assert!(report.age_s < 0.5);
        }
        assert!(worst[2] < 25.0, "{worst:?}");
        assert!(made.trajectory.touchdown().is_some());
    }
}

#[test]
fn a_track_that_ends_in_the_air_is_continued_to_the_ground_and_says_so() {
    let flight = flight();
    let airborne: Vec<Report> = reports(&flight)
        .into_iter()
        .filter(|report| place(&report.state)[0] > 900.0)
        .collect();
    let folder = tempfile::tempdir().unwrap();
    let found = import(folder.path(), &csv(&airborne, 0.0));
    let path = only(&found);
    assert!(found.imported[0].continued_s > 8.0, "{found:?}");
    let touchdown = recording(&path).trajectory.touchdown().unwrap();
    let target = runway().touchdown_target();
    let off_m = target.lat_lon().distance_m(touchdown.lat_lon());
    assert!(off_m < 600.0, "{off_m} m");
    let text = fs::read_to_string(path).unwrap();
    assert!(text.lines().next().unwrap().ends_with(",position"));
    assert!(text.contains(",measured\n") && text.trim_end().ends_with(",derived"));
}

#[test]
fn a_track_that_is_no_arrival_is_refused_with_the_reason() {
    let flight = flight();
    let all = reports(&flight);
    let moved = |by: &dyn Fn(&mut Report)| {
        let mut changed = all.clone();
        changed.iter_mut().for_each(by);
        changed
    };
    let far = |from_m: f64, to_m: f64| {
        let kept = all.iter().filter(|report| {
            let to_go_m = place(&report.state)[0];
            !(from_m..to_m).contains(&to_go_m)
        });
        kept.cloned().collect::<Vec<_>>()
    };
    let cases: [(&str, Vec<Report>, &str); 6] = [
        (
            "elsewhere",
            moved(&|report| report.state.pose.latitude_deg += 5.0),
            "never approaches",
        ),
        (
            "another runway",
            moved(&|report| report.state.pose.longitude_deg += 0.005),
            "beside the centreline",
        ),
        ("a gap", far(4_000.0, 5_500.0), "no position for"),
        ("an early end", far(-1e9, 5_000.0), "it ends"),
        (
            "level",
            moved(&|report| report.state.pose.altitude_msl_m = 700.0),
            "descends at",
        ),
        ("taxiing", far(-100.0, 1e9), "never approaches"),
    ];
    for (kind, reports, words) in cases {
        let folder = tempfile::tempdir().unwrap();
        let found = import(folder.path(), &csv(&reports, 0.0));
        assert_eq!(found.imported, [], "{kind}");
        assert!(
            found.refused[0].reason.contains(words),
            "{kind}: {:?}",
            found.refused
        );
        assert_eq!(
            fs::read_dir(folder.path().join("flights")).unwrap().count(),
            0
        );
    }
    let folder = tempfile::tempdir().unwrap();
    let found = import(folder.path(), "a,b\n1,2\n");
    assert!(
        found.refused[0].reason.contains("no column for timestamp"),
        "{found:?}"
    );
}
