//! Simulated series at an image every two seconds.

use dataset::numbers::noise_hash::unit_hash;

use super::*;

const TICKS: u32 = 150;
const STEP_S: f64 = 2.0;
const SD_PX: f64 = 0.03;
const HALF_PX: f64 = 960.0;

/// A normally distributed number.
fn normal(tick: u32, series: u32) -> f64 {
    let parts = (0..12).map(|part| f64::from(unit_hash(tick, series, part)));
    parts.sum::<f64>() - 6.0
}

fn time_s(tick: u32) -> f64 {
    STEP_S * f64::from(tick)
}

/// Result of [`smoothed`] for measurements of a direction, right and down, at the ticks that show it.
fn of_measured(
    series: u32,
    truth: impl Fn(u32) -> DVec2,
    shows: impl Fn(u32) -> bool,
) -> Vec<Turned> {
    let measured = |tick: u32| {
        let noise = DVec2::new(normal(tick, 2 * series), normal(tick, 2 * series + 1));
        shows(tick).then(|| Measured {
            turn: Motion {
                shift_px: truth(tick) + SD_PX * noise,
                roll_rad: 0.0,
                ..Motion::default()
            },
            sd_px: SD_PX,
        })
    };
    let (times_s, measured): (Vec<_>, Vec<_>) = (0..TICKS)
        .map(|tick| (time_s(tick), measured(tick)))
        .unzip();
    smoothed(&times_s, &measured, HALF_PX).unwrap()
}

/// Errors in their stated standard deviations, of both axes.
fn errors(turned: &[Turned], truth: impl Fn(u32) -> DVec2) -> Vec<f64> {
    let errors = (0..)
        .zip(turned)
        .flat_map(|(tick, of)| ((of.turn.shift_px - truth(tick)) / of.sd_px).to_array());
    errors.collect()
}

fn share_within(errors: &[f64], deviations: f64) -> f64 {
    let within = errors.iter().filter(|error| error.abs() < deviations);
    within.count() as f64 / errors.len() as f64
}

/// A random walk of this rate per root second.
fn walk(series: u32, rate: f64) -> Vec<DVec2> {
    let steps = (0..TICKS).scan(DVec2::ZERO, |at, tick| {
        let step = DVec2::new(normal(tick, 2 * series), normal(tick, 2 * series + 1));
        *at += rate * STEP_S.sqrt() * step;
        Some(*at)
    });
    steps.collect()
}

#[test]
fn a_camera_that_stands_still_looks_in_the_mean_direction() {
    let centre = DVec2::new(0.3, -1.0);
    let mut errors_sd = Vec::new();
    for series in 0..40 {
        let turned = of_measured(series, |_| centre, |_| true);
        errors_sd.push(errors(&turned, |_| centre)[2 * 70]);
        assert!(turned[70].turn.shift_px.distance(centre) < 0.02);
    }
    let share = share_within(&errors_sd, 2.0);
    assert!(share >= 0.85, "{share}");
    // Of the mean of 150.
    let sds_px = (0..40).map(|series| of_measured(series, |_| centre, |_| true)[70].sd_px.x);
    let still = sds_px
        .filter(|sd_px| (*sd_px - 0.00245).abs() < 1e-5)
        .count();
    assert!(still >= 30, "{still}");
}

#[test]
fn a_drift_and_a_shake_are_followed_to_the_stated_deviation() {
    let drift = |tick: u32| DVec2::new(0.0635 * time_s(tick), 0.0);
    let shake = |tick: u32| 2.0 * DVec2::new(normal(tick, 900), normal(tick, 901));
    let shaken: Vec<DVec2> = (0..TICKS).map(shake).collect();
    let drifting: Vec<DVec2> = (0..TICKS).map(drift).collect();
    for truth in [drifting, shaken, walk(450, 0.01), walk(460, 0.3)] {
        let mut all = Vec::new();
        for series in 0..10 {
            let turned = of_measured(series, |tick| truth[tick as usize], |_| true);
            let most_px = turned.iter().map(|of| of.sd_px.max_element());
            assert!(most_px.fold(0.0, f64::max) < 1.01 * SD_PX);
            all.extend(errors(&turned, |tick| truth[tick as usize]));
        }
        let share = share_within(&all, 1.645);
        assert!((0.82..0.98).contains(&share), "{share}");
    }
}

#[test]
fn while_nothing_is_measured_a_walk_is_uncertain_by_its_rate() {
    let hidden = 60..80;
    let mut all = Vec::new();
    for series in 0..30 {
        let truth = walk(series + 200, 0.1);
        let turned = of_measured(
            series,
            |tick| truth[tick as usize],
            |tick| !hidden.contains(&tick),
        );
        let sd_px = turned[70].sd_px.x;
        assert!((0.1..0.7).contains(&sd_px), "{sd_px}");
        let all_of_it = errors(&turned, |tick| truth[tick as usize]);
        all.extend(&all_of_it[2 * 60..2 * 80]);
    }
    let share = share_within(&all, 1.645);
    assert!((0.8..0.97).contains(&share), "{share}");
    let nothing: [Option<Measured>; 3] = [None; 3];
    assert_eq!(smoothed(&[0.0, 2.0, 4.0], &nothing, HALF_PX), None);
}

#[test]
fn a_step_blurs_nothing_and_one_that_is_hidden_may_have_been_at_any_time() {
    let step = |tick: u32| DVec2::new(if tick < 60 { 0.0 } else { 9.0 }, 0.0);
    let turned = of_measured(1, step, |_| true);
    for (tick, of) in (0..).zip(&turned) {
        let off_px = of.turn.shift_px.distance(step(tick));
        assert!(off_px < 0.02, "{tick}: {off_px}");
        assert!(of.sd_px.max_element() < 0.015, "{tick}: {of:?}");
    }
    let hidden = of_measured(1, step, |tick| !(50..70).contains(&tick));
    for (tick, of) in (0..).zip(&hidden) {
        let off_px = (of.turn.shift_px - step(tick)).x.abs();
        assert!(off_px < 3.0 * of.sd_px.x + 0.01, "{tick}: {of:?}");
    }
    assert!(hidden[60].sd_px.x > 3.0 && hidden[49].sd_px.x < 0.015);
}

#[test]
fn one_wild_measurement_spoils_its_image_alone() {
    let jolt = |tick: u32| DVec2::new(if tick == 60 { 5.0 } else { 0.0 }, 0.0);
    let turned = of_measured(1, jolt, |_| true);
    for (tick, of) in (0..).zip(&turned) {
        assert!(of.turn.shift_px.length() < 0.02, "{tick}: {of:?}");
        let is_known = of.sd_px.x < 0.015;
        assert_eq!(is_known, tick != 60, "{tick}: {of:?}");
    }
    assert!((4.9..5.1).contains(&turned[60].sd_px.x));
}
