//! Tracks of receivers become recordings. They are made from recorded flights as a receiver would report them: late positions at full
//! seconds, repeated rows, altitudes in steps of 25 ft above a different pressure.

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

fn flight_of(name: &str) -> Recording {
    recording(&repository().join(format!("tests/data/flights/{name}.csv")))
}

fn flight() -> Recording {
    flight_of("03_xwind_right_mod_turb")
}

/// Distance to go, offset to the right, height above the target, metres.
fn place(state: &FlightState) -> [f64; 3] {
    let runway = runway();
    let target = runway.touchdown_target();
    let at = RunwayCoordinates::of(state.pose.position(), target, runway.course_true_deg);
    [at.along_track_m, at.cross_track_m, at.height_over_target_m]
}

#[derive(Clone)]
struct Report {
    time_s: f64,
    state: FlightState,
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
        });
        time_s += 1.0;
    }
    all
}

/// A table in the columns of `traffic`, with each position repeated once; the altitudes are `above_m` too high.
fn csv(reports: &[Report], above_m: f64) -> String {
    csv_with(reports, |altitude_msl_m| altitude_msl_m + above_m)
}

/// A table in the columns of `traffic`, with the altitude that the aircraft reports instead of its true one.
fn csv_with(reports: &[Report], reported_m: impl Fn(f64) -> f64) -> String {
    let mut text =
        "timestamp,icao24,latitude,longitude,altitude,groundspeed,track,vertical_rate,onground\n"
            .to_owned();
    for report in reports {
        for repeat in 0..2 {
            let state = &report.state;
            let feet = (reported_m(state.pose.altitude_msl_m) / 0.3048 / 25.0).round() * 25.0;
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
    import_tracks(&[file], &[], &runway(), &out).unwrap()
}

/// Fails unless the track is refused alone, with a reason that has these words.
fn assert_refused(text: &str, words: &str) {
    let folder = tempfile::tempdir().unwrap();
    let found = import(folder.path(), text);
    assert_eq!(found.imported, [], "{words}");
    let reason = &found.refused[0].reason;
    assert!(reason.contains(words), "{words}: {reason}");
    let flights = fs::read_dir(folder.path().join("flights"));
    assert_eq!(flights.unwrap().count(), 0, "{words}");
}

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
            let moved_m = 30.0;
            let off = [0, 1, 2].map(|axis| (here[axis] - truth[axis]).abs());
            assert!(off[0] < moved_m && off[1] < 8.0, "{off:?} at {truth:?}");
            if truth[0] < METERS_PER_NAUTICAL_MILE {
                assert!(off[2] < 6.0, "{off:?} at {truth:?}");
            }
            worst = [0, 1, 2].map(|axis| worst[axis].max(off[axis]));
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
    let elsewhere = moved(&|report| report.state.pose.latitude_deg += 5.0);
    let another_runway = moved(&|report| report.state.pose.longitude_deg += 0.005);
    let level = moved(&|report| report.state.pose.altitude_msl_m = 700.0);
    let (gap, early_end, taxiing) = (far(4_000.0, 6_000.0), far(-1e9, 5_000.0), far(-100.0, 1e9));
    let cases = [
        (elsewhere, "never comes near the runway"),
        (another_runway, "beside the centreline"),
        (gap, "no position for"),
        (early_end, "it ends"),
        (level, "descends at"),
        (taxiing, "never seen in the air near the runway"),
    ];
    for (reports, words) in cases {
        assert_refused(&csv(&reports, 0.0), words);
    }
    assert_refused("a,b\n1,2\n", "lacks the columns timestamp, latitude");
}

#[test]
fn wrong_altitudes_and_positions_are_left_out() {
    let flight = flight();
    let mut all = reports(&flight);
    let near = |all: &[Report], to_go_m: f64| {
        all.iter()
            .position(|report| place(&report.state)[0] < to_go_m)
            .unwrap()
    };
    let (high, beside) = (near(&all, 4_000.0), near(&all, 9_000.0));
    all[high].state.pose.altitude_msl_m = 10_500.0;
    all[beside].state.pose.latitude_deg += 0.1;
    let folder = tempfile::tempdir().unwrap();
    let found = import(folder.path(), &csv(&all, 0.0));
    let made = recording(&only(&found));
    assert_eq!(found.imported[0].outliers, 1);
    let first_s = all[0].time_s;
    for index in [high, beside] {
        let [_, right_m, height_m] = place(&made.trajectory.at(all[index].time_s - first_s));
        assert!(
            right_m.abs() < 60.0 && height_m < 700.0,
            "{right_m} m, {height_m} m"
        );
    }
}

#[test]
fn two_files_of_one_name_do_not_replace_each_other_and_dates_are_understood() {
    let flight = flight();
    let text = csv(&reports(&flight), 0.0);
    let dated: String = text
        .lines()
        .map(|line| match line.split_once(',') {
            Some((time, rest)) if time.starts_with('1') => {
                let seconds: i64 = time[..10].parse().unwrap();
                let minutes = (seconds - 1_600_000_000) / 60;
                let rest_s = (seconds - 1_600_000_000) % 60;
                format!(
                    "2020-09-13 12:{:02}:{rest_s:02}+00:00,{rest}\n",
                    26 + minutes
                )
            }
            _ => format!("{line}\n"),
        })
        .collect();
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("flights");
    fs::create_dir_all(&out).unwrap();
    let files = ["a", "b"].map(|name| {
        let file = folder.path().join(name).join("track.csv");
        fs::create_dir_all(file.parent().unwrap()).unwrap();
        fs::write(&file, &dated).unwrap();
        file
    });
    let found = import_tracks(&files, &[], &runway(), &out).unwrap();
    assert_eq!(found.imported.len(), 1, "{found:?}");
    assert!(
        found.refused[0].reason.contains("is the recording of"),
        "{found:?}"
    );
}

#[test]
fn messages_of_a_receiver_are_joined_to_tracks() {
    let flight = flight();
    let reports = reports(&flight);
    let mut text = String::new();
    for report in &reports {
        let state = &report.state;
        let head = format!(
            "{{\"timestamp\":{},\"frame\":\"8d\",\"df\":\"17\",\"icao24\":\"abc123\"",
            report.time_s
        );
        let knots = state.velocity_north_mps.hypot(state.velocity_east_mps) * 3_600.0 / 1_852.0;
        let track = state
            .velocity_east_mps
            .atan2(state.velocity_north_mps)
            .to_degrees();
        let feet = (state.pose.altitude_msl_m / 0.3048 / 25.0).round() * 25.0;
        let (bds, altitude) = if state.on_ground {
            ("06", "null".to_owned())
        } else {
            ("05", feet.to_string())
        };
        let (latitude, longitude) = (state.pose.latitude_deg, state.pose.longitude_deg);
        let _ = writeln!(
            text,
            "{head},\"bds\":\"09\",\"groundspeed\":{knots},\"track\":{track}}}"
        );
        let _ = writeln!(
            text,
            "{head},\"bds\":\"{bds}\",\"altitude\":{altitude},\"latitude\":{latitude},\"longitude\":{longitude}}}"
        );
    }
    let folder = tempfile::tempdir().unwrap();
    let found = import(folder.path(), &text);
    assert_eq!(found.imported[0].aircraft.as_deref(), Some("abc123"));
    let made = recording(&only(&found));
    let report = &reports[reports.len() / 2];
    let here = place(&made.trajectory.at(report.time_s - reports[0].time_s));
    let truth = place(&report.state);
    assert!(
        (here[1] - truth[1]).abs() < 8.0 && (here[2] - truth[2]).abs() < 10.0,
        "{here:?} {truth:?}"
    );
}

/// X-Plane's data output to disk: ten rows a second, with the names of the columns before them.
fn data_txt(flight: &Recording, altitude: &str) -> String {
    let mut text = format!(
        "\n  _real,_time |   _totl,_time |   Vtrue,_ktgs |   pitch,__deg |   _roll,__deg |   hding,_true |   __lat,__deg |   __lon,__deg |   {altitude} |   __alt,ftagl | \n"
    );
    for (time_s, state) in x_plane_rows(flight) {
        let knots = state.velocity_north_mps.hypot(state.velocity_east_mps) * 3_600.0 / 1_852.0;
        let pose = &state.pose;
        let above_ground_ft = if state.on_ground { 0.2 } else { 50.0 };
        let _ = write!(text, "{:13.5} |", 1_000.0 + 2.0 * time_s);
        for number in [
            time_s,
            knots,
            pose.pitch_deg,
            pose.roll_deg,
            pose.heading_true_deg,
            pose.latitude_deg,
            pose.longitude_deg,
            pose.altitude_msl_m / 0.3048,
            above_ground_ft,
        ] {
            let _ = write!(text, " {number:13.5} |");
        }
        text.push_str(" \n");
    }
    text
}

fn x_plane_rows(flight: &Recording) -> Vec<(f64, FlightState)> {
    let window = flight.trajectory.approach(&runway(), f64::MAX).unwrap();
    let rows = ((window.last_s - window.start_s) * 10.0) as usize;
    (0..rows)
        .map(|row| window.start_s + row as f64 / 10.0)
        .map(|time_s| (time_s, flight.trajectory.at(time_s)))
        .collect()
}

#[test]
fn the_data_output_of_x_plane_keeps_its_attitudes_and_heights() {
    let flight = flight();
    let rows = x_plane_rows(&flight);
    let first_s = rows[0].0;
    for altitude in ["__alt,ftmsl", "___CG,ftMSL"] {
        let text = data_txt(&flight, altitude);
        let folder = tempfile::tempdir().unwrap();
        let path = only(&import(folder.path(), &text));
        let made = recording(&path);
        for (time_s, state) in rows.iter().step_by(70) {
            let found = made.trajectory.at(time_s - first_s);
            let [truth, here] = [state, &found].map(place);
            if truth[0] < 200.0 || *time_s < first_s + 5.0 {
                continue;
            }
            for axis in 0..3 {
                let off_m = (here[axis] - truth[axis]).abs();
                assert!(off_m < 2.0, "{altitude}: {here:?} at {truth:?}");
            }
            let (truth, here) = (&state.pose, &found.pose);
            let heading_deg = (here.heading_true_deg - truth.heading_true_deg).abs();
            let is_near = (here.pitch_deg - truth.pitch_deg).abs() < 0.5
                && (here.roll_deg - truth.roll_deg).abs() < 1.5
                && heading_deg < 0.5;
            assert!(is_near, "{altitude}: {here:?} {truth:?}");
        }
        let text = fs::read_to_string(path).unwrap();
        assert!(text.contains(",measured,measured\n"), "{altitude}");
    }
}

#[test]
fn a_broken_recording_of_x_plane_is_refused_with_line_and_reason_and_pressure_altitudes_are_tied() {
    let flight = flight();
    let text = data_txt(&flight, "p-alt,ftMSL");
    let folder = tempfile::tempdir().unwrap();
    only(&import(folder.path(), &text));
    let broken = text.replacen("      0.20000 |", "        ?    |", 1);
    let without = text.replace("p-alt,ftMSL", "_gear,_pos1");
    for (text, words) in [
        (broken, "is \"?\"; expected a number"),
        (
            without,
            "no column for the altitude; its columns are real,_time, totl,_time",
        ),
    ] {
        assert_refused(&text, words);
    }
}

#[test]
fn a_file_with_two_flights_gives_two_recordings() {
    let flight = flight();
    let text = data_txt(&flight, "__alt,ftmsl");
    let folder = tempfile::tempdir().unwrap();
    let found = import(folder.path(), &format!("{text}{text}"));
    assert_eq!(found.refused, []);
    let flights: Vec<&str> = (found.imported.iter())
        .map(|track| track.aircraft.as_deref().unwrap())
        .collect();
    assert_eq!(flights, ["flight-1", "flight-2"]);
    let texts = found
        .imported
        .iter()
        .map(|track| fs::read_to_string(&track.recording).unwrap());
    let texts: Vec<String> = texts.collect();
    assert_eq!(texts[0], texts[1]);
}

#[test]
fn aircraft_without_a_position_are_counted() {
    let mut text = csv(&reports(&flight()), 0.0);
    text.push_str("1600000000000,def456,,,35000,450,90,0,False\n");
    let folder = tempfile::tempdir().unwrap();
    let found = import(folder.path(), &text);
    assert_eq!(found.imported.len(), 1);
    let silent = &found.refused[0];
    assert_eq!(silent.aircraft.as_deref(), Some("def456"));
    assert_eq!(silent.reason, "it has no positions");
}

/// Air of a pressure at sea level and a temperature above standard.
struct Air {
    qnh_hpa: f64,
    warmer_k: f64,
}

impl Air {
    /// The altitude that an altimeter at 1013.25 hPa shows (ICAO standard atmosphere).
    fn pressure_altitude_m(&self, altitude_msl_m: f64) -> f64 {
        const KELVIN: f64 = 288.15;
        const LAPSE_K_PER_M: f64 = 0.0065;
        const EXPONENT: f64 = 5.255_9;
        let ground_k = KELVIN + self.warmer_k;
        let hpa = self.qnh_hpa * (1.0 - LAPSE_K_PER_M * altitude_msl_m / ground_k).powf(EXPONENT);
        KELVIN / LAPSE_K_PER_M * (1.0 - (hpa / 1_013.25).powf(EXPONENT.recip()))
    }
}

#[test]
fn heights_follow_from_pressure_altitudes_in_air_of_unknown_pressure_and_temperature() {
    const FLIGHTS: usize = 300;
    const ON_GLIDE_PATH: [&str; 5] = [
        "01_calm_ils",
        "03_xwind_right_mod_turb",
        "04_storm_gusts",
        "07_loc_offset_intercept",
        "10_from_3000ft_cda",
    ];
    let usual = ON_GLIDE_PATH.map(|name| reports(&flight_of(name)));
    let stepping_down = reports(&flight_of("05_step_down_1500"));
    let mut rng = ChaCha8Rng::seed_from_u64(43);
    // At 1 and 5 NM: errors and half widths of their intervals.
    let mut found: [Vec<[f64; 2]>; 2] = [Vec::new(), Vec::new()];
    for number in 0..FLIGHTS {
        let air = Air {
            qnh_hpa: 1_013.25 + rng.random_range(-30.0..30.0),
            warmer_k: rng.random_range(-20.0..25.0),
        };
        // One flight in ten steps down, another is off 3.00 degrees.
        let mut flown = match number % 10 {
            0 => stepping_down.clone(),
            _ => usual[number % usual.len()].clone(),
        };
        if number % 10 == 1 {
            let angle_deg: f64 = rng.random_range(2.5..3.5);
            let steeper = angle_deg.to_radians().tan() / 3.0_f64.to_radians().tan();
            let ground_m = runway().touchdown_target().altitude_msl_m;
            for report in &mut flown {
                let altitude_m = &mut report.state.pose.altitude_msl_m;
                *altitude_m = ground_m + steeper * (*altitude_m - ground_m);
            }
        }
        let folder = tempfile::tempdir().unwrap();
        let text = csv_with(&flown, |altitude_m| air.pressure_altitude_m(altitude_m));
        let made = only(&import(folder.path(), &text));
        let heights = heights(&made);
        for (miles, found) in [1.0, 5.0].into_iter().zip(&mut found) {
            let there = flown
                .iter()
                .find(|report| place(&report.state)[0] < miles * METERS_PER_NAUTICAL_MILE)
                .unwrap();
            let passed_s = there.time_s - flown[0].time_s;
            let row = heights.partition_point(|row| row[0] < passed_s - 1e-6);
            let [_, altitude_m, half_width_m] = heights[row];
            let off_m = altitude_m - there.state.pose.altitude_msl_m;
            found.push([off_m, half_width_m]);
        }
    }
    for ((miles, limit_m), found) in [(1, 5.0), (5, 10.0)].into_iter().zip(found) {
        let squares: f64 = found.iter().map(|[off_m, _]| off_m * off_m).sum();
        let rms_m = (squares / FLIGHTS as f64).sqrt();
        let mut sizes: Vec<f64> = found.iter().map(|[off_m, _]| off_m.abs()).collect();
        sizes.sort_by(f64::total_cmp);
        let held = found
            .iter()
            .filter(|[off_m, half_m]| off_m.abs() <= *half_m);
        let held = held.count() as f64 / FLIGHTS as f64;
        println!(
            "{miles} NM: {rms_m:.1} m RMS, {:.1} m median, {:.1} m for 90 %; 90 % intervals hold {:.0} %",
            sizes[FLIGHTS / 2],
            sizes[FLIGHTS * 9 / 10],
            100.0 * held
        );
        assert!(rms_m < limit_m, "{rms_m} m at {miles} NM");
        assert!((0.85..=0.95).contains(&held), "{held} at {miles} NM");
    }
}

/// Times, altitudes and half widths of their intervals, of the rows of a recording.
fn heights(recording: &Path) -> Vec<[f64; 3]> {
    let text = fs::read_to_string(recording).unwrap();
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let columns = ["t_s", "altitude_msl_m", "altitude_90_m"]
        .map(|name| names.iter().position(|found| *found == name).unwrap());
    let row = |line: &str| {
        let fields: Vec<&str> = line.split(',').collect();
        columns.map(|column| fields[column].parse().unwrap())
    };
    lines.map(row).collect()
}
