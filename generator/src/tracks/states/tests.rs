//! The derived attitude against the one that an A320 recorded (tests/data/a320-descent). Its path is the integral of ground speed and
//! track, reported as a receiver would: up to half a second late, 2 m to the side, altitudes in steps of 25 ft.

use std::fs;
use std::path::Path as File;

use dataset::numbers::units::{METERS_PER_FOOT, MPS_PER_KNOT};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;

const ACROSS_SD_M: f64 = 2.0;

struct Recorded {
    altitude_ft: f64,
    ground_speed_mps: f64,
    track_deg: f64,
    cas_kt: f64,
    pitch_deg: f64,
    roll_deg: f64,
}

fn recorded() -> Vec<Recorded> {
    let path = File::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/a320-descent/descent.csv");
    let text = fs::read_to_string(path).unwrap();
    let row = |line: &str| {
        let numbers: Vec<f64> = line
            .split(',')
            .map(|field| field.parse().unwrap())
            .collect();
        Recorded {
            altitude_ft: numbers[1],
            ground_speed_mps: numbers[2] * MPS_PER_KNOT,
            track_deg: numbers[3],
            cas_kt: numbers[4],
            pitch_deg: numbers[5],
            roll_deg: numbers[6],
        }
    };
    text.lines().skip(1).map(row).collect()
}

/// Reports on an approach that ends at the touchdown target.
fn reported(flight: &[Recorded], runway: &Runway) -> Vec<ArrivalFix> {
    let turned_deg = runway.course_true_deg - flight[flight.len() - 1].track_deg;
    let mut places = vec![[0.0, 0.0]];
    for pair in flight.windows(2).rev() {
        let speed_mps = (pair[0].ground_speed_mps + pair[1].ground_speed_mps) / 2.0;
        let turn_deg = Degrees(pair[1].track_deg - pair[0].track_deg)
            .wrapped_180()
            .0;
        let off =
            (pair[0].track_deg + turn_deg / 2.0 + turned_deg - runway.course_true_deg).to_radians();
        let [to_go_m, right_m] = places[places.len() - 1];
        places.push([
            to_go_m + speed_mps * off.cos(),
            right_m - speed_mps * off.sin(),
        ]);
    }
    places.reverse();
    let mut rng = ChaCha8Rng::seed_from_u64(320);
    let mut seen = Vec::new();
    for (second, state) in flight.iter().enumerate().skip(1) {
        let age_s = rng.random_range(0.0..0.5);
        let normal: f64 = (0..12).map(|_| rng.random_range(-0.5..0.5_f64)).sum();
        let [to_go_m, right_m] = [0, 1].map(|axis| {
            places[second][axis] + age_s * (places[second - 1][axis] - places[second][axis])
        });
        let right_m = right_m + ACROSS_SD_M * normal;
        let here = runway.point_on_approach(to_go_m, right_m);
        seen.push(ArrivalFix {
            fix: Fix {
                time_s: second as f64,
                latitude_deg: here.latitude_deg,
                longitude_deg: here.longitude_deg,
                altitude_m: Some((state.altitude_ft / 25.0).round() * 25.0 * METERS_PER_FOOT),
                ground_speed_mps: Some(state.ground_speed_mps),
                track_deg: Some(state.track_deg + turned_deg),
                ..Fix::default()
            },
            to_go_m,
            right_m,
        });
    }
    seen
}

fn root_mean_square(errors: &[f64]) -> f64 {
    let squares = errors.iter().map(|error| error * error);
    (squares.sum::<f64>() / errors.len() as f64).sqrt()
}

/// Airspeeds for which the pitch level is not judged.
fn band(cas_kt: f64) -> usize {
    usize::from(cas_kt <= 210.0) + usize::from(cas_kt <= 160.0)
}

#[test]
fn derived_roll_and_pitch_are_near_those_that_an_a320_recorded() {
    let runway = crate::airports::bundled("WSSS", "02L").unwrap();
    let flight = recorded();
    let seen = reported(&flight, &runway);
    let datum = Datum::of(&seen, &runway).unwrap();
    let (path, _) = Path::through(&seen, datum, &runway);
    let mut rolls = Vec::new();
    let mut pitches = [(); 3].map(|()| Vec::new());
    for (second, state) in flight.iter().enumerate().skip(2) {
        let row = path.row(second as f64, 0.0, &seen);
        if row.on_ground {
            break;
        }
        rolls.push(row.numbers[4] - state.roll_deg);
        // The recorded number is twice the pitch.
        pitches[band(state.cas_kt)].push(row.numbers[3] - state.pitch_deg / 2.0);
    }
    assert!(rolls.len() > 560, "{} s", rolls.len());
    let levels_deg = pitches
        .each_ref()
        .map(|errors| mean_and_deviation(errors.iter().copied())[0]);
    let shapes: Vec<f64> = (pitches.iter().zip(levels_deg))
        .flat_map(|(errors, level_deg)| errors.iter().map(move |error| error - level_deg))
        .collect();
    let (roll_deg, pitch_deg) = (root_mean_square(&rolls), root_mean_square(&shapes));
    println!(
        "roll {roll_deg:.2} degrees RMS, pitch {pitch_deg:.2} degrees RMS, level {levels_deg:.2?}"
    );
    assert!(roll_deg < 1.5, "roll is off by {roll_deg} degrees RMS");
    assert!(pitch_deg < 1.0, "pitch is off by {pitch_deg} degrees RMS");
    for level_deg in levels_deg {
        assert!(
            level_deg.abs() < 2.5,
            "pitch is off by {levels_deg:?} degrees"
        );
    }
}

#[test]
fn a_report_in_mid_flight_that_claims_the_ground_is_no_touchdown() {
    let runway = crate::airports::bundled("WSSS", "02L").unwrap();
    let mut seen = reported(&recorded(), &runway);
    let datum = Datum::of(&seen, &runway).unwrap();
    let lands_s = |seen: &[ArrivalFix]| Path::through(seen, datum, &runway).0.touchdown_s;
    let expected_s = lands_s(&seen);
    let middle = seen.len() / 2;
    seen[middle].fix.on_ground = true;
    let found_s = lands_s(&seen);
    assert!(
        (found_s - expected_s).abs() < 1.0,
        "{found_s} s instead of {expected_s} s"
    );
    let last = seen.len() - 1;
    seen[last].fix.on_ground = true;
    assert!(lands_s(&seen) <= seen[last].fix.time_s);
}
