//! Synthetic flights with known motion and errors.

mod contradictory;
mod disturbed;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;

use super::*;
use crate::estimators::inverse_range::{Measurement, scale_m};

/// Fit with both views, and fits with one view each.
pub(super) const BOTH: usize = 0;
const ALONE: [usize; 2] = [1, 2];
/// Integration step, seconds.
const FINE_STEP_S: f64 = 0.05;

fn motion() -> Motion {
    Motion {
        mean_speed_mps: 70.0,
        speed_sd_mps: 8.0,
        acceleration_sd_mps2: 0.3,
        acceleration_time_s: 12.0,
    }
}

fn error(deviation: f64, new_share: f64, half_time_s: f64) -> CorrelatedError {
    CorrelatedError {
        distances_m: vec![1_000.0],
        deviations: vec![deviation],
        new_share,
        half_time_s,
    }
}

fn errors() -> Vec<CorrelatedError> {
    vec![
        error(2e-4, 0.5, 30.0),
        error(1e-2, 0.03, 8.0),
        error(1e-2, 0.03, 8.0),
    ]
}

pub(super) fn truth() -> FlightFilter {
    FlightFilter {
        motion: motion(),
        errors: errors(),
        tick_s: 2.0,
        kept: KeptInTraining::default(),
        filtered: HalfWidths::NORMAL,
        smoothed: HalfWidths::NORMAL,
    }
}

pub(super) fn normal(random: &mut ChaCha12Rng) -> f64 {
    let radius = (-2.0 * (1.0 - random.random::<f64>()).ln()).sqrt();
    radius * (std::f64::consts::TAU * random.random::<f64>()).cos()
}

/// A flight from 10 NM to 1 NM with its speeds, and all measurements at each tick.
pub(super) struct SyntheticFlight {
    pub(super) labelled: LabelledFlight,
    speeds_mps: Vec<f64>,
}

pub(super) fn fly(seed: u64, tick_s: f64) -> SyntheticFlight {
    fly_in(1.0, seed, tick_s)
}

/// A flight with errors larger by a factor.
pub(super) fn fly_in(severity: f64, seed: u64, tick_s: f64) -> SyntheticFlight {
    fly_as(severity, 0.0, seed, tick_s)
}

/// A flight that is initially faster than usual, m/s, and slows down within a minute or two.
fn fly_faster(faster_mps: f64, seed: u64) -> SyntheticFlight {
    fly_as(1.0, faster_mps, seed, 2.0)
}

fn fly_as(severity: f64, more_mps: f64, seed: u64, tick_s: f64) -> SyntheticFlight {
    let random = &mut ChaCha12Rng::seed_from_u64(seed);
    let (motion, errors) = (motion(), errors());
    let returning_per_s = {
        // The rate consistent with the speed's standard deviation.
        let fading_per_s = motion.acceleration_time_s.recip();
        let ratio = motion.acceleration_sd_mps2 / motion.speed_sd_mps;
        0.5 * ((fading_per_s.powi(2) + 4.0 * ratio.powi(2)).sqrt() - fading_per_s)
    };
    let mut distance_m = 18_500.0;
    let mut faster_mps = more_mps + motion.speed_sd_mps * normal(random);
    let mut acceleration_mps2 = motion.acceleration_sd_mps2 * normal(random);
    let rates: Vec<f64> = errors.iter().map(|e| e.variances()[1].sqrt()).collect();
    let mut smooth: Vec<[f64; 2]> = rates
        .iter()
        .map(|rate| [normal(random), rate * normal(random)])
        .collect();
    let mut flown = SyntheticFlight {
        labelled: LabelledFlight {
            flown: seed as usize,
            ticks: Vec::new(),
            distances_m: Vec::new(),
        },
        speeds_mps: Vec::new(),
    };
    let steps = (tick_s / FINE_STEP_S).round() as usize;
    while distance_m > 1_852.0 {
        let measurements = errors.iter().zip(&smooth).enumerate().map(|(fit, (e, s))| {
            let kept = (1.0 - e.new_share).sqrt() * s[0];
            let error = kept + e.new_share.sqrt() * normal(random);
            Measurement {
                fit,
                of_one_view: fit != BOTH,
                distance_m: distance_m + severity * error * e.deviations[0] * scale_m(distance_m),
                precision: 1.0,
                common_sd_m: 0.0,
            }
        });
        flown.labelled.ticks.push(Tick {
            time_s: flown.speeds_mps.len() as f64 * tick_s,
            measurements: measurements.collect(),
            rows: Vec::new(),
        });
        flown.labelled.distances_m.push(distance_m);
        flown.speeds_mps.push(motion.mean_speed_mps + faster_mps);
        for _ in 0..steps {
            let dt = FINE_STEP_S;
            distance_m -= (motion.mean_speed_mps + faster_mps) * dt;
            faster_mps += (acceleration_mps2 - returning_per_s * faster_mps) * dt;
            let kick = motion.acceleration_sd_mps2 * (2.0 * dt / motion.acceleration_time_s).sqrt();
            acceleration_mps2 +=
                -acceleration_mps2 / motion.acceleration_time_s * dt + kick * normal(random);
            for (s, rate) in smooth.iter_mut().zip(&rates) {
                let kick = (4.0 * rate.powi(3) * dt).sqrt();
                s[1] += (-2.0 * rate * s[1] - rate * rate * s[0]) * dt + kick * normal(random);
                s[0] += s[1] * dt;
            }
        }
    }
    flown
}

/// Flight ticks with some measurements missing.
fn without(flown: &SyntheticFlight, is_missing: impl Fn(usize, usize) -> bool) -> Vec<Tick> {
    let mut ticks = flown.labelled.ticks.clone();
    for (number, tick) in ticks.iter_mut().enumerate() {
        tick.measurements.retain(|m| !is_missing(number, m.fit));
    }
    ticks
}

/// A view is missing: neither its own fit nor the common one applies.
fn one_view_missing(fit: usize) -> bool {
    fit != ALONE[1]
}

/// Mean squared normalised error, coverage, and mean relative error in percent, for distances.
fn figures<'a>(answers: impl IntoIterator<Item = (&'a Estimate, f64)>) -> (f64, f64, f64) {
    let (mut squares, mut held, mut sizes, mut count) = (0.0, 0.0, 0.0, 0.0);
    for (estimate, distance_m) in answers {
        let Estimated {
            value,
            sd,
            interval: [from, to],
        } = estimate.distance_m;
        squares += ((value - distance_m) / sd).powi(2);
        held += f64::from(u8::from((from..=to).contains(&distance_m)));
        sizes += 100.0 * (value / distance_m - 1.0).abs();
        count += 1.0;
    }
    (squares / count, held / count, sizes / count)
}

fn of_flights(
    filter: &FlightFilter,
    flights: &[SyntheticFlight],
    knowing: Knowing,
    is_missing: impl Fn(usize, usize) -> bool,
) -> (f64, f64, f64) {
    let answers: Vec<(Estimate, f64)> = flights
        .iter()
        .flat_map(|flown| {
            let answers = filter.of_ticks(&without(flown, &is_missing), knowing);
            answers.into_iter().zip(&flown.labelled.distances_m)
        })
        .filter_map(|(answer, &distance_m)| Some((answer?, distance_m)))
        .collect();
    figures(
        answers
            .iter()
            .map(|(estimate, distance_m)| (estimate, *distance_m)),
    )
}

fn flights(seeds: std::ops::Range<u64>) -> Vec<SyntheticFlight> {
    seeds.map(|seed| fly(seed, 2.0)).collect()
}

#[test]
fn errors_are_as_large_as_the_true_model_states_with_all_views_and_with_gaps() {
    let flights = flights(0..24);
    let every_seventh = |tick: usize, fit| tick % 7 == 3 && one_view_missing(fit);
    let bursts = |tick: usize, fit| tick % 30 > 19 && one_view_missing(fit);
    let blind = |tick: usize, _| tick % 30 > 27;
    let mut all_views_pct = [0.0; 2];
    for (name, is_missing) in [
        (
            "all views",
            &(|_, _| false) as &dyn Fn(usize, usize) -> bool,
        ),
        ("one view missing now and then", &every_seventh),
        ("one view missing for 20 s", &bursts),
        ("no view for 4 s", &blind),
    ] {
        for (index, knowing) in [Knowing::Past, Knowing::All].into_iter().enumerate() {
            let (squares, held, error_pct) = of_flights(&truth(), &flights, knowing, is_missing);
            println!("{name}, {knowing:?}: {squares:.2}, {held:.3}, {error_pct:.4} %");
            assert!((0.7..1.4).contains(&squares), "{name}: {squares}");
            assert!((0.86..0.94).contains(&held), "{name}: {held}");
            if name == "all views" {
                all_views_pct[index] = error_pct;
            } else {
                assert!(
                    error_pct < 10.0 * all_views_pct[index],
                    "{name}: {error_pct} %"
                );
            }
        }
    }
    let [filtered_pct, smoothed_pct] = all_views_pct;
    let alone_pct = 100.0 * 2e-4 * (2.0 / std::f64::consts::PI).sqrt();
    assert!(smoothed_pct < filtered_pct && filtered_pct < 0.95 * alone_pct);
}

/// A flight at ten times the usual rate, with new errors as rare as usual.
fn fly_at_a_higher_rate(seed: u64) -> SyntheticFlight {
    let mut flown = fly(seed, 0.2);
    let LabelledFlight {
        ticks, distances_m, ..
    } = &mut flown.labelled;
    for number in 0..ticks.len() {
        let usual = number / 10 * 10;
        let parts: Vec<f64> = ticks[usual]
            .measurements
            .iter()
            .map(|m| m.distance_m)
            .collect();
        for (measurement, part_m) in ticks[number].measurements.iter_mut().zip(parts) {
            let error = (part_m - distances_m[usual]) / scale_m(distances_m[usual]);
            if number != usual {
                measurement.distance_m = distances_m[number] + error * scale_m(distances_m[number]);
            }
        }
    }
    flown
}

#[test]
fn pictures_at_a_higher_rate_than_in_the_training_do_not_make_the_filter_too_sure() {
    let faster: Vec<SyntheticFlight> = (0..40).map(fly_at_a_higher_rate).collect();
    let unaware = FlightFilter {
        tick_s: 0.2,
        ..truth()
    };
    for knowing in [Knowing::Past, Knowing::All] {
        let of = |filter: &FlightFilter| of_flights(filter, &faster, knowing, |_, _| false);
        let ((squares, held, error_pct), (unaware_squares, _, unaware_pct)) =
            (of(&truth()), of(&unaware));
        println!(
            "{knowing:?}: {squares:.2}, {held:.3}, {error_pct:.4} %; unaware {unaware_squares:.2}, {unaware_pct:.4} %"
        );
        assert!(squares < 1.3, "{squares}");
        assert!(held > 0.87, "{held}");
        assert!(squares < 0.6 * unaware_squares, "{unaware_squares}");
        assert!(error_pct < unaware_pct, "{error_pct} {unaware_pct}");
    }
}

#[test]
fn an_error_that_all_ticks_share_widens_intervals_and_moves_no_answer() {
    const COMMON_SD_M: f64 = 6.0;
    let mut flown = fly(3, 2.0);
    let usual = flown.labelled.ticks.clone();
    for tick in &mut flown.labelled.ticks {
        for measurement in &mut tick.measurements {
            measurement.common_sd_m = COMMON_SD_M;
        }
    }
    let filter = truth();
    for knowing in [Knowing::Past, Knowing::All] {
        let [before, after] =
            [&usual, &flown.labelled.ticks].map(|ticks| filter.of_ticks(ticks, knowing));
        for (before, after) in before.iter().zip(&after) {
            let [before, after] = [before, after].map(|answer| answer.as_ref().unwrap());
            assert_eq!(before.distance_m.value, after.distance_m.value);
            let expected_m = before.distance_m.sd.hypot(COMMON_SD_M);
            // The smoother takes the maximum over both directions, at different distances.
            let part = after.distance_m.sd / expected_m;
            assert!((0.95..1.25).contains(&part), "{part}");
            assert!(after.ground_speed_mps.sd > before.ground_speed_mps.sd);
            let time_sd_s = |answer: &Estimate| answer.time_to_touchdown_s.unwrap().sd;
            assert!(time_sd_s(after) > time_sd_s(before));
        }
    }
    // A width that was fitted to filter errors does not apply to common errors.
    let mut wide = truth();
    wide.filtered.distance = 4.0;
    let answers = [&usual, &flown.labelled.ticks].map(|ticks| wide.of_ticks(ticks, Knowing::Past));
    for (before, after) in answers[0].iter().zip(&answers[1]) {
        let [before, after] = [before, after].map(|answer| answer.unwrap().distance_m);
        let common_m = (after.sd.powi(2) - before.sd.powi(2)).sqrt();
        let half_m = (after.interval[1] - after.interval[0]) / 2.0;
        let expected_m = (4.0 * before.sd).hypot(1.645 * common_m);
        assert!(
            (half_m / expected_m - 1.0).abs() < 1e-3,
            "{half_m}, expected {expected_m}"
        );
    }
    // Without the faulty view, and without any, the last ticks count: the state has the same error.
    let mut ticks = flown.labelled.ticks;
    ticks[20].measurements.retain(|m| m.fit == ALONE[0]);
    ticks[20].measurements[0].common_sd_m = 0.0;
    ticks[40].measurements.clear();
    let answers = filter.of_ticks(&ticks, Knowing::Past);
    for tick in [20, 40] {
        assert!(answers[tick].unwrap().distance_m.sd > 0.8 * COMMON_SD_M);
    }
}

#[test]
fn a_less_certain_shift_adds_new_errors_and_a_formula_far_from_its_training_smooth_ones() {
    const DISTANCE_M: f64 = 10_000.0;
    let measurement = |precision: f64, of_one_view: bool| Measurement {
        fit: BOTH,
        of_one_view,
        distance_m: DISTANCE_M,
        precision,
        common_sd_m: 0.0,
    };
    let error = error(2e-4, 0.5, 30.0);
    let of =
        |precision, of_one_view| error.parts_m(&measurement(precision, of_one_view), DISTANCE_M);
    let half_m = 2.0 * 0.5_f64.sqrt();
    for (parts, expected) in [
        (of(1.0, false), [half_m; 2]),
        (of(0.5, false), [half_m, 14.0_f64.sqrt()]),
        (of(0.5, true), [2.0 * half_m; 2]),
    ] {
        for (part, expected) in parts.into_iter().zip(expected) {
            assert!((part - expected).abs() < 1e-9, "{parts:?}");
        }
    }
}

#[test]
fn speed_and_time_to_touchdown_are_in_their_intervals() {
    let flights = flights(0..24);
    let (mut speeds, mut times, mut count) = (0.0, 0.0, 0.0);
    for flown in &flights {
        let answers = truth().of_ticks(&flown.labelled.ticks, Knowing::Past);
        let last = flown.labelled.ticks.last().unwrap();
        for (tick, answer) in answers.iter().enumerate() {
            let answer = answer.unwrap();
            let holds = |estimated: Estimated, truth: f64| {
                let [from, to] = estimated.interval;
                f64::from(u8::from((from..=to).contains(&truth)))
            };
            speeds += holds(answer.ground_speed_mps, flown.speeds_mps[tick]);
            // After the last tick, at 1 NM, the flight ends; the rest takes 26 s.
            let rest_s =
                flown.labelled.distances_m.last().unwrap() / flown.speeds_mps.last().unwrap();
            let time_s = last.time_s - flown.labelled.ticks[tick].time_s + rest_s;
            times += holds(answer.time_to_touchdown_s.unwrap(), time_s);
            count += 1.0;
        }
    }
    let (speeds, times) = (speeds / count, times / count);
    println!("speed {speeds:.3}, time {times:.3}");
    assert!((0.85..0.95).contains(&speeds), "{speeds}");
    assert!((0.80..0.98).contains(&times), "{times}");
}

#[test]
fn a_view_alone_gives_its_own_precision_and_one_that_never_appears_changes_nothing() {
    let flights = flights(0..8);
    let only_left = |_, fit| one_view_missing(fit) || fit == ALONE[0];
    let (squares, _, error_pct) =
        of_flights(&truth(), &flights, Knowing::Past, |_, fit| fit != ALONE[0]);
    assert!((0.3..2.5).contains(&squares), "{squares}");
    assert!((0.1..1.5).contains(&error_pct), "{error_pct} %");
    // A filter for a rig with a third camera.
    let mut more = truth();
    more.errors.push(error(1e-3, 0.1, 8.0));
    let ticks = without(&flights[0], only_left);
    assert_eq!(
        more.of_ticks(&ticks, Knowing::All),
        truth().of_ticks(&ticks, Knowing::All)
    );
}

#[test]
fn uncertainty_grows_while_nothing_is_seen_until_there_is_no_answer() {
    let flown = fly(3, 2.0);
    let mut ticks = without(&flown, |tick, _| tick >= 20);
    let answers = truth().of_ticks(&ticks, Knowing::Past);
    let sds: Vec<f64> = answers[19..]
        .iter()
        .flatten()
        .map(|e| e.distance_m.sd)
        .collect();
    assert!(sds.len() > 10 && sds.is_sorted(), "{sds:?}");
    ticks.push(Tick {
        time_s: ticks.last().unwrap().time_s + 600.0,
        measurements: Vec::new(),
        rows: Vec::new(),
    });
    assert_eq!(truth().of_ticks(&ticks, Knowing::Past).last(), Some(&None));
    let blind = without(&flown, |tick, _| tick < 10);
    let answers = truth().of_ticks(&blind, Knowing::All);
    assert!(answers[..10].iter().all(Option::is_none) && answers[10].is_some());
}

#[test]
fn one_tick_and_none_and_no_measurement_at_all() {
    let flown = fly(4, 2.0);
    for knowing in [Knowing::Past, Knowing::All] {
        let one = truth().of_ticks(&flown.labelled.ticks[..1], knowing);
        let distance_m = one[0].unwrap().distance_m;
        assert!((distance_m.value - 18_500.0).abs() < 4.0 * distance_m.sd);
        assert!((1.0..40.0).contains(&distance_m.sd), "{distance_m:?}");
        assert_eq!(truth().of_ticks(&[], knowing), []);
        let blind = without(&flown, |_, _| true);
        assert!(
            truth()
                .of_ticks(&blind, knowing)
                .iter()
                .all(Option::is_none)
        );
    }
}

#[test]
fn a_measurement_of_something_else_moves_nothing_and_several_begin_again() {
    let flown = fly(5, 2.0);
    let clean = truth().of_ticks(&flown.labelled.ticks, Knowing::Past);
    for wrong in [9_000.0, f64::NAN, f64::INFINITY] {
        let mut ticks = flown.labelled.ticks.clone();
        ticks[30].measurements.truncate(1);
        ticks[30].measurements[0].distance_m = wrong;
        let answers = truth().of_ticks(&ticks, Knowing::Past);
        let [found, expected] = [&answers, &clean].map(|a| a[40].unwrap().distance_m.value);
        assert!((found - expected).abs() < 2.0, "{found} {expected}");
    }
    // The track starts at a different object, 4 km too near.
    let mut ticks = flown.labelled.ticks.clone();
    for tick in &mut ticks[..4] {
        for measurement in &mut tick.measurements {
            measurement.distance_m -= 4_000.0;
        }
    }
    for knowing in [Knowing::Past, Knowing::All] {
        let answers = truth().of_ticks(&ticks, knowing);
        let found_m = answers[12].unwrap().distance_m.value;
        let error_m = found_m - flown.labelled.distances_m[12];
        assert!(error_m.abs() < 20.0, "{error_m}");
    }
}

#[test]
fn a_false_beginning_is_left_although_the_view_that_made_it_agrees_with_it_now_and_then() {
    for tick_s in [2.0, 0.2] {
        let flown = fly(3, tick_s);
        let mut ticks = without(&flown, |tick, fit| tick % 3 == 0 && one_view_missing(fit));
        for measurement in ticks.iter_mut().flat_map(|tick| &mut tick.measurements) {
            if measurement.fit == ALONE[1] {
                measurement.distance_m *= 1.2;
            }
        }
        let answers = truth().of_ticks(&ticks, Knowing::Past);
        let later = (30.0 / tick_s) as usize;
        let found_m = answers[later].unwrap().distance_m.value;
        let off = found_m / flown.labelled.distances_m[later] - 1.0;
        assert!(off.abs() < 0.01, "{off} at {tick_s} s");
    }
}

#[test]
fn steps_of_any_length_add_up() {
    let known = {
        let variances = [100.0, 9.0, 0.04, 1.0, 0.02];
        gaussian::Gaussian::independent(vec![5_000.0, -3.0, 0.2, 0.7, 0.05], &variances)
    };
    let after = |seconds: f64| {
        let mut step = gaussian::Step::zero(5);
        step.set_block(0, &motion().step(seconds));
        step.set_block(3, &errors()[1].step(seconds));
        step
    };
    let at_once = known.advanced(&after(6.0));
    let mut in_steps = known;
    for _ in 0..180 {
        in_steps = in_steps.advanced(&after(6.0 / 180.0));
    }
    let pairs = |a: &[f64], b: &[f64]| {
        for (a, b) in a.iter().zip(b) {
            assert!((a - b).abs() <= 1e-6 * a.abs().max(1e-3), "{a} {b}");
        }
    };
    pairs(&at_once.mean, &in_steps.mean);
    pairs(&at_once.covariance.values, &in_steps.covariance.values);
}

#[test]
fn what_is_fitted_is_what_the_flights_were_made_with_and_its_intervals_hold_nine_in_ten() {
    let training = flights(100..116);
    let labelled: Vec<LabelledFlight> = training.iter().map(|f| f.labelled.clone()).collect();
    let fitted = FlightFilter::fit_to(&labelled, [1.0; 3].into_iter());
    println!("{fitted:#?}");
    assert!((fitted.motion.mean_speed_mps - 70.0).abs() < 5.0);
    assert!((0.2..0.45).contains(&fitted.motion.acceleration_sd_mps2));
    let [both, alone, _] = &fitted.errors[..] else {
        panic!("three fits")
    };
    assert!((1.6e-4..2.4e-4).contains(&both.deviation_at(9_000.0)));
    assert!((0.3..=0.7).contains(&both.new_share), "{both:?}");
    assert!((0.8e-2..1.2e-2).contains(&alone.deviation_at(5_000.0)));
    assert!(alone.new_share <= 0.1 && (4.0..=16.0).contains(&alone.half_time_s));
    let others = flights(200..224);
    for knowing in [Knowing::Past, Knowing::All] {
        let (_, held, _) = of_flights(&fitted, &others, knowing, |_, _| false);
        println!("{knowing:?}: {held:.3}");
        assert!((0.86..0.94).contains(&held), "{knowing:?}: {held}");
    }
}

#[test]
fn intervals_hold_nine_in_ten_of_other_flights_however_few_are_known() {
    const DRAWS: u64 = 12;
    // Calm and stormy flights.
    let fly = |seed: u64| {
        let random = &mut ChaCha12Rng::seed_from_u64(seed);
        fly_in((0.4 * normal(random)).exp(), seed, 2.0)
    };
    for known in [3, 6, 12] {
        let mut held = [0.0; 2];
        for draw in 0..DRAWS {
            let seeds = 1_000 * (draw + 1)..;
            let training: Vec<LabelledFlight> = (seeds.clone().take(known))
                .map(|seed| fly(seed).labelled)
                .collect();
            let fitted = FlightFilter::fit_to(&training, [1.0; 3].into_iter());
            let others: Vec<SyntheticFlight> = seeds.skip(known).take(8).map(fly).collect();
            for (held, knowing) in held.iter_mut().zip([Knowing::Past, Knowing::All]) {
                let (_, of_draw, _) = of_flights(&fitted, &others, knowing, |_, _| false);
                *held += of_draw / DRAWS as f64;
            }
        }
        println!("{known} flights: {held:.3?}");
        assert!(
            held.iter().all(|held| (0.87..0.93).contains(held)),
            "{known} flights: {held:?}"
        );
    }
}

#[test]
fn a_flight_that_is_faster_than_all_of_the_training_is_followed_with_one_view_better_than_by_the_view_itself()
 {
    let training: Vec<LabelledFlight> = (100..109).map(|seed| fly(seed, 2.0).labelled).collect();
    let fitted = FlightFilter::fit_to(&training, [1.0; 3].into_iter());
    // Initially faster than any training flight, as approaches from far out are.
    let others: Vec<SyntheticFlight> = (300..312).map(|seed| fly_faster(25.0, seed)).collect();
    let alone = |_, fit: usize| fit != ALONE[0];
    let (_, _, filtered_pct) = of_flights(&fitted, &others, Knowing::Past, alone);
    let measured = others.iter().flat_map(|flown| {
        let ticks = flown.labelled.ticks.iter().zip(&flown.labelled.distances_m);
        ticks.map(|(tick, &distance_m)| {
            let measured_m = tick.measurements[ALONE[0]].distance_m;
            (100.0 * (measured_m / distance_m - 1.0).abs(), 1.0)
        })
    });
    let (sum, count) = measured.fold((0.0, 0.0), |(a, b), (c, d)| (a + c, b + d));
    let alone_pct = sum / count;
    // With the spread over a few training flights as the prior for speed.
    let mut narrow = fitted.clone();
    narrow.motion.speed_sd_mps = 6.0;
    let (_, _, narrow_pct) = of_flights(&narrow, &others, Knowing::Past, alone);
    println!("filtered {filtered_pct:.3} %, by itself {alone_pct:.3} %, narrow {narrow_pct:.3} %");
    assert!(filtered_pct < alone_pct && filtered_pct < narrow_pct);
}

#[test]
fn without_any_flight_there_is_a_filter_of_usual_approaches() {
    let fitted = FlightFilter::fit_to(&[], [2e-4, 1e-2].into_iter());
    assert_eq!(fitted.errors[1].deviation_at(3_000.0), 1e-2);
    let written = serde_json::to_string(&fitted).unwrap();
    assert_eq!(
        serde_json::from_str::<FlightFilter>(&written).unwrap(),
        fitted
    );
    assert!(fitted.constants().all(|number| number > 0.0));
}
