//! Attitude against the path: an aircraft's nose follows its climb, its heading the track, and its roll the turns.
//!
//! Each is one line through means over four seconds, recorded = a + b * needed, with b about 1 and a standard error that says how well the
//! flight tells. Recordings of 42 approaches have b + 3 errors above 0.9, and b - 3 errors below 1.8; a wrong unit or sign has b near 0 or
//! below.

use dataset::geometry::pose::FlightState;
use dataset::numbers::least_squares::{NormalEquations, dot};
use dataset::numbers::spread::median_of;
use dataset::numbers::units::Degrees;

use super::units::{MOVING_MPS, contradiction, ground_speed_mps, unit};
use super::{GRAVITY_MPS2, Implausible};

/// Largest median angle between heading and track: more than any crosswind causes.
const MAX_CRAB_DEG: f64 = 40.0;
/// A heading that is the same in every row is a constant; further from the track than this, degrees, it is a wrong one.
const MAX_CONSTANT_CRAB_DEG: f64 = 5.0;
/// Pitch less the angle of the path, degrees: airliners on approach have 3 to 9.
const ATTACK_DEG: std::ops::RangeInclusive<f64> = -3.0..=15.0;
/// The means are taken over this time, seconds: gusts and steps of the track have little part in them.
const PART_S: f64 = 4.0;
/// Minimum number of means, a minute's worth: fewer may all be one gust.
const MIN_PARTS: usize = 15;
/// Minimum standard deviation of the needed angles for a verdict, degrees.
const MIN_NEEDED_DEG: f64 = 0.1;
/// A slope that is outside by three standard errors is wrong.
const SLOPES: std::ops::RangeInclusive<f64> = 0.3..=2.0;
const ERRORS: f64 = 3.0;
/// Slopes of radians, and of the opposite sign.
const RADIANS: std::ops::RangeInclusive<f64> = 0.003..=0.04;
const OPPOSITE: f64 = -0.2;
/// Pitch and roll vary by more than this as numbers, unless they are made up.
const MIN_RANGE: f64 = 0.005;

type Angle = fn(&FlightState) -> f64;
/// A column, what it follows, its numbers, those that are needed in a part of the flight, and numbers of the opposite sign in words.
type Follower = (
    &'static str,
    &'static str,
    Angle,
    fn(&[FlightState]) -> f64,
    &'static str,
);

fn track_deg(state: &FlightState) -> f64 {
    let (north, east) = (state.velocity_north_mps, state.velocity_east_mps);
    east.atan2(north).to_degrees()
}

fn climb_deg(state: &FlightState) -> f64 {
    let climbs_mps = -state.velocity_down_mps;
    climbs_mps.atan2(ground_speed_mps(state)).to_degrees()
}

fn heading_deg(state: &FlightState) -> f64 {
    state.pose.heading_true_deg
}

/// Heading against track, pitch against path, and whether the three angles follow.
pub(super) fn attitude(approach: &[FlightState]) -> Result<(), Implausible> {
    let moving = || {
        let states = approach.iter();
        states.filter(|state| ground_speed_mps(state) > MOVING_MPS)
    };
    let crab_deg = |heading: &dyn Fn(&FlightState) -> f64| {
        median_of(moving().map(|state| {
            let off = Degrees(heading(state) - track_deg(state));
            off.wrapped_180().0.abs()
        }))
    };
    let Some(as_it_is_deg) = crab_deg(&heading_deg) else {
        return Ok(());
    };
    let is_small = |state: &FlightState| heading_deg(state).abs() <= std::f64::consts::TAU;
    let is_near = |as_radians_deg: f64| as_radians_deg + 5.0 < as_it_is_deg;
    let why = format!("heading and track differ by {as_it_is_deg:.0} degrees (median)");
    if moving().all(is_small)
        && crab_deg(&|state| heading_deg(state).to_degrees()).is_some_and(is_near)
    {
        return unit("heading_true_deg", "radians", why, "degrees, 0 to 360");
    }
    if as_it_is_deg > 180.0 - MAX_CRAB_DEG {
        return unit(
            "heading_true_deg",
            "headings of an aircraft that flies backwards",
            why,
            "where the nose points",
        );
    }
    if as_it_is_deg > MAX_CRAB_DEG {
        return contradiction(why, "at most 40 degrees");
    }
    let first_deg = heading_deg(&approach[0]);
    if as_it_is_deg > MAX_CONSTANT_CRAB_DEG && moving().all(|at| heading_deg(at) == first_deg) {
        return contradiction(
            format!(
                "heading_true_deg is {first_deg} in every row, and the track {as_it_is_deg:.0} degrees beside it"
            ),
            "headings as they were flown",
        );
    }
    let attack_deg = median_of(moving().map(|state| state.pose.pitch_deg - climb_deg(state)));
    if let Some(attack_deg) = attack_deg.filter(|deg| !ATTACK_DEG.contains(deg)) {
        let why = format!("pitch_deg is {attack_deg:+.1} degrees above the path (median)");
        return contradiction(why, "-3 to 15 degrees, nose up positive");
    }
    let parts = parts_of(approach);
    let angles: [Follower; 3] = [
        (
            "pitch_deg",
            "climbs and descents",
            |state| state.pose.pitch_deg,
            |part| mean(part.iter().map(climb_deg)),
            "pitches down",
        ),
        (
            "roll_deg",
            "turns",
            |state| state.pose.roll_deg,
            bank_deg,
            "rolls to the left",
        ),
        (
            "heading_true_deg",
            "track",
            heading_deg,
            |part| mean_angle(part, track_deg),
            "headings to the left",
        ),
    ];
    for (column, what, recorded, needed, opposite) in angles {
        let numbers = || approach.iter().map(recorded);
        let (lowest, highest) = numbers().fold((f64::MAX, f64::MIN), |(low, high), number| {
            (low.min(number), high.max(number))
        });
        if highest - lowest <= MIN_RANGE {
            continue;
        }
        let points = parts
            .iter()
            .map(|part| [needed(part), mean_angle(part, recorded)]);
        let Some([slope, error]) = slope_of(points.collect()) else {
            continue;
        };
        let most = slope + ERRORS * error;
        if most >= *SLOPES.start() && slope - ERRORS * error <= *SLOPES.end() {
            continue;
        }
        let why = format!(
            "they follow the {what} with a slope of {slope:.3} (standard error {error:.3})"
        );
        if RADIANS.contains(&slope) {
            return unit(column, "radians", why, "degrees");
        }
        if slope < OPPOSITE {
            let expected = "degrees, nose up, right wing down and clockwise positive";
            return unit(column, opposite, why, expected);
        }
        return contradiction(
            format!("{column} against the path: {why}"),
            "a slope of about 1",
        );
    }
    Ok(())
}

/// Runs of states over [`PART_S`]; each shares its last state with the next one.
fn parts_of(approach: &[FlightState]) -> Vec<&[FlightState]> {
    let mut parts = Vec::new();
    let mut from = 0;
    while let Some(start) = approach.get(from) {
        let ends = |state: &FlightState| state.time_s - start.time_s >= PART_S;
        let Some(length) = approach[from..].iter().position(ends) else {
            break;
        };
        parts.push(&approach[from..=from + length]);
        from += length;
    }
    parts
}

fn mean(numbers: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = numbers.len() as f64;
    numbers.sum::<f64>() / count
}

/// Mean of an angle, near its first value: 359 and 1 give 360.
fn mean_angle(part: &[FlightState], angle: Angle) -> f64 {
    let first_deg = angle(&part[0]);
    first_deg
        + mean(
            part.iter()
                .map(|state| Degrees(angle(state) - first_deg).wrapped_180().0),
        )
}

/// Bank of a coordinated turn.
fn bank_deg(part: &[FlightState]) -> f64 {
    let (start, end) = (&part[0], &part[part.len() - 1]);
    let turn_deg = Degrees(track_deg(end) - track_deg(start)).wrapped_180().0;
    let rate_deg = turn_deg / (end.time_s - start.time_s);
    let speed_mps = (ground_speed_mps(start) + ground_speed_mps(end)) / 2.0;
    let aside_mps2 = speed_mps * rate_deg.to_radians();
    (aside_mps2 / GRAVITY_MPS2).atan().to_degrees()
}

/// Slope of the second numbers over the first, and its standard error; both are angles. `None` if the first hardly vary.
fn slope_of(points: Vec<[f64; 2]>) -> Option<[f64; 2]> {
    let first = *points.first()?;
    let count = points.len() as f64;
    let near = |point: &[f64; 2]| [0, 1].map(|at| Degrees(point[at] - first[at]).wrapped_180().0);
    let points: Vec<[f64; 2]> = points.iter().map(near).collect();
    let mut line = NormalEquations::new(2);
    for [first, second] in &points {
        line.add(&[1.0, *first], *second, 1.0);
    }
    let fitted: [f64; 2] = line.solve_for()?;
    let unit_variance = line.inverse()?[1][1];
    if points.len() < MIN_PARTS || 1.0 < unit_variance * count * MIN_NEEDED_DEG * MIN_NEEDED_DEG {
        return None;
    }
    let left = points
        .iter()
        .map(|[first, second]| second - dot(&[1.0, *first], &fitted));
    let variance = left.map(|left| left * left).sum::<f64>() / (count - 2.0);
    Some([fitted[1], (variance * unit_variance).sqrt()])
}
