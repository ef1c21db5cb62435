//! Units of the columns, compared with each other over the approach.

use dataset::geometry::pose::FlightState;
use dataset::numbers::spread::{median, median_of};
use dataset::numbers::units::Degrees;

use super::Implausible;

/// Ratios between units, with the wrong unit's name.
const LENGTH_RATIOS: [(f64, &str); 1] = [(3.280_84, "feet")];
const SPEED_RATIOS: [(f64, &str); 4] = [
    (1.943_84, "knots"),
    (3.280_84, "feet per second"),
    (3.6, "kilometres per hour"),
    (196.85, "feet per minute"),
];
/// Agreement with such a ratio.
const RATIO_TOLERANCE: f64 = 0.12;
/// Altitude and the integral of the vertical speed may differ by this much, metres, plus a part of the change of altitude.
const CLIMB_TOLERANCE_M: f64 = 30.0;
const CLIMB_TOLERANCE: f64 = 0.25;
/// Airspeed over ground speed.
const AIRSPEED_RATIOS: std::ops::RangeInclusive<f64> = 0.5..=1.7;
/// Velocities may point this far beside the way of the positions on average, degrees.
const DIRECTION_TOLERANCE_DEG: f64 = 15.0;
/// Slower states have no heading that has to agree with the track.
const MOVING_MPS: f64 = 30.0;
/// Largest median angle between heading and track: more than any crosswind causes.
const MAX_CRAB_DEG: f64 = 40.0;
/// Largest pitch and roll, as numbers, that look like radians. No airliner flies a whole approach within 0.2 degrees.
const MAX_RADIANS: f64 = 0.2;
/// Banks follow from turns over this time, seconds: gusts and steps of the track have no part in them.
const TURN_S: f64 = 4.0;
/// Turns tell the unit and the sign of the roll if their banks are larger on average (root mean square), degrees.
const TURNING_DEG: f64 = 0.4;
/// Minimum number of turns, a minute's worth: fewer may all be one gust.
const MIN_TURNS: u32 = 15;
/// Ratio of roll to a turn's bank: about 1 in degrees, 0.017 in radians.
const ROLL_IN_RADIANS: std::ops::RangeInclusive<f64> = 0.005..=0.04;
const ROLL_TO_THE_LEFT: f64 = -0.4;
/// Pitch and roll vary by more than this as numbers, unless they are made up.
const MIN_RANGE: f64 = 0.005;
pub(crate) const GRAVITY_MPS2: f64 = 9.81;

/// Name of the unit with this ratio to the expected one; the nearest if several match.
fn unit_of(ratio: f64, units: &[(f64, &'static str)]) -> Option<&'static str> {
    let off = |factor: f64| (ratio / factor - 1.0).abs();
    let nearest = units.iter().min_by(|a, b| off(a.0).total_cmp(&off(b.0)));
    nearest
        .filter(|(factor, _)| off(*factor) < RATIO_TOLERANCE)
        .map(|(_, name)| *name)
}

fn unit(
    column: &'static str,
    looks_like: &'static str,
    why: String,
    expected: &'static str,
) -> Result<(), Implausible> {
    Err(Implausible::Unit {
        column,
        looks_like,
        why,
        expected,
    })
}

fn contradiction(why: String, expected: &'static str) -> Result<(), Implausible> {
    Err(Implausible::Contradiction { why, expected })
}

fn ground_speed_mps(state: &FlightState) -> f64 {
    state.velocity_north_mps.hypot(state.velocity_east_mps)
}

pub(super) fn times(approach: &[FlightState]) -> Result<(), Implausible> {
    let (first_s, last_s) = (approach[0].time_s, approach[approach.len() - 1].time_s);
    if last_s > first_s {
        return Ok(());
    }
    contradiction(
        format!(
            "t_s goes from {first_s} to {last_s} in {} rows",
            approach.len()
        ),
        "seconds that increase from row to row",
    )
}

/// Directions of the velocities against the positions.
pub(super) fn directions(approach: &[FlightState]) -> Result<(), Implausible> {
    let beside_deg = |exchanged: bool| {
        let (mut along_m, mut aside_m) = (0.0, 0.0);
        for pair in approach.windows(2) {
            let [from, to] = [0, 1].map(|index| pair[index].pose.position().lat_lon());
            let [north, east] = if exchanged {
                [pair[1].velocity_east_mps, pair[1].velocity_north_mps]
            } else {
                [pair[1].velocity_north_mps, pair[1].velocity_east_mps]
            };
            let way_m = from.distance_m(to);
            if way_m > 0.0 {
                let off = from.azimuth_to_deg(to).to_radians() - east.atan2(north);
                along_m += way_m * off.cos();
                aside_m += way_m * off.sin();
            }
        }
        f64::atan2(aside_m, along_m).to_degrees().abs()
    };
    let as_it_is_deg = beside_deg(false);
    if as_it_is_deg < DIRECTION_TOLERANCE_DEG {
        return Ok(());
    }
    let looks_like = if as_it_is_deg > 180.0 - DIRECTION_TOLERANCE_DEG {
        "velocities of the opposite direction"
    } else if beside_deg(true) < DIRECTION_TOLERANCE_DEG {
        "velocities with north and east exchanged"
    } else {
        return contradiction(
            format!("velocities point {as_it_is_deg:.0} degrees beside the way of the positions"),
            "the same direction",
        );
    };
    unit(
        "v_north_mps and v_east_mps",
        looks_like,
        format!("they point {as_it_is_deg:.0} degrees beside the way of the positions"),
        "metres per second towards north and east",
    )
}

/// Way over ground by positions against velocities and times.
pub(super) fn speeds(approach: &[FlightState]) -> Result<(), Implausible> {
    let (mut way_m, mut flown_m, mut steps_s) = (0.0, 0.0, Vec::new());
    for pair in approach.windows(2) {
        let [before, after] = pair else { continue };
        let step_s = after.time_s - before.time_s;
        let (from, to) = (before.pose.position(), after.pose.position());
        way_m += from.lat_lon().distance_m(to.lat_lon());
        flown_m += step_s * (ground_speed_mps(before) + ground_speed_mps(after)) / 2.0;
        steps_s.push(step_s);
    }
    if way_m < 100.0 || flown_m <= 0.0 {
        return Ok(());
    }
    let why =
        format!("positions are {way_m:.0} m apart where velocities and times make {flown_m:.0} m");
    let ratio = flown_m / way_m;
    if let Some(looks_like) = unit_of(ratio, &SPEED_RATIOS) {
        return unit(
            "v_north_mps and v_east_mps",
            looks_like,
            why,
            "metres per second over ground",
        );
    }
    for (looks_like, factor) in [
        ("milliseconds", 1e3),
        ("microseconds", 1e6),
        ("minutes", 1.0 / 60.0),
    ] {
        if (ratio / factor - 1.0).abs() < RATIO_TOLERANCE {
            return unit("t_s", looks_like, why, "seconds");
        }
    }
    Ok(())
}

/// Altitude against vertical speed.
pub(super) fn climb(approach: &[FlightState]) -> Result<(), Implausible> {
    let integral = approach.windows(2).map(|pair| {
        let step_s = pair[1].time_s - pair[0].time_s;
        step_s * (pair[0].velocity_down_mps + pair[1].velocity_down_mps) / 2.0
    });
    let sinks_m: f64 = integral.sum();
    let altitude_m = |state: &FlightState| state.pose.altitude_msl_m;
    let falls_m = altitude_m(&approach[0]) - altitude_m(&approach[approach.len() - 1]);
    let allowed_m = CLIMB_TOLERANCE_M + CLIMB_TOLERANCE * falls_m.abs();
    if (falls_m - sinks_m).abs() <= allowed_m {
        return Ok(());
    }
    let why =
        format!("altitude_msl_m falls by {falls_m:.0} m where v_down_mps makes {sinks_m:.0} m");
    let ratio = falls_m / sinks_m;
    if let Some(looks_like) = unit_of(ratio, &LENGTH_RATIOS) {
        return unit(
            "altitude_msl_m",
            looks_like,
            why,
            "metres above mean sea level",
        );
    }
    let upwards = (falls_m + sinks_m).abs() <= allowed_m;
    let feet_per_minute = unit_of(ratio.recip().abs(), &SPEED_RATIOS[3..]);
    let feet_per_second = unit_of(ratio.recip().abs(), &LENGTH_RATIOS).map(|_| "feet per second");
    let looks_like = if upwards {
        Some("velocities upwards")
    } else {
        feet_per_minute.or(feet_per_second)
    };
    match looks_like {
        Some(looks_like) => unit(
            "v_down_mps",
            looks_like,
            why,
            "metres per second, downwards positive",
        ),
        None => contradiction(why, "both to agree"),
    }
}

/// Airspeed against ground speed.
pub(super) fn airspeed(approach: &[FlightState]) -> Result<(), Implausible> {
    let moving = approach
        .iter()
        .filter(|state| ground_speed_mps(state) > MOVING_MPS);
    let ratios = moving.map(|state| state.true_airspeed_mps / ground_speed_mps(state));
    let Some(ratio) = median_of(ratios) else {
        return Ok(());
    };
    if AIRSPEED_RATIOS.contains(&ratio) {
        return Ok(());
    }
    let why = format!("tas_mps is {ratio:.2} times the ground speed");
    match unit_of(ratio, &SPEED_RATIOS) {
        Some(looks_like) => unit("tas_mps", looks_like, why, "metres per second"),
        None => contradiction(why, "0.5 to 1.7 times"),
    }
}

/// Heading against track, and the size of pitch and roll.
pub(super) fn attitude(approach: &[FlightState]) -> Result<(), Implausible> {
    let moving: Vec<&FlightState> = approach
        .iter()
        .filter(|state| ground_speed_mps(state) > MOVING_MPS)
        .collect();
    if moving.is_empty() {
        return Ok(());
    }
    let crab_deg = |heading: &dyn Fn(&FlightState) -> f64| {
        let mut angles: Vec<f64> = moving
            .iter()
            .map(|state| {
                let track_deg = state
                    .velocity_east_mps
                    .atan2(state.velocity_north_mps)
                    .to_degrees();
                Degrees(heading(state) - track_deg).wrapped_180().0.abs()
            })
            .collect();
        median(&mut angles)
    };
    let heading_deg = |state: &FlightState| state.pose.heading_true_deg;
    let as_it_is_deg = crab_deg(&heading_deg);
    let is_small = |state: &&FlightState| heading_deg(state).abs() <= std::f64::consts::TAU;
    let as_radians_deg = crab_deg(&|state| heading_deg(state).to_degrees());
    let why = format!("heading and track differ by {as_it_is_deg:.0} degrees (median)");
    if moving.iter().all(is_small) && as_radians_deg + 5.0 < as_it_is_deg {
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
    let largest = |angle: &dyn Fn(&FlightState) -> f64| {
        approach
            .iter()
            .map(|state| angle(state).abs())
            .fold(0.0, f64::max)
    };
    let pitch = largest(&|state| state.pose.pitch_deg);
    let roll = largest(&|state| state.pose.roll_deg);
    let lasts_s = approach[approach.len() - 1].time_s - approach[0].time_s;
    let varies = |angle: &dyn Fn(&FlightState) -> f64| {
        let angles = approach.iter().map(angle);
        let (lowest, highest) = angles.fold((f64::MAX, f64::MIN), |(low, high), angle| {
            (low.min(angle), high.max(angle))
        });
        highest - lowest > MIN_RANGE
    };
    if varies(&|state| state.pose.pitch_deg) && pitch.max(roll) < MAX_RADIANS && lasts_s > 60.0 {
        let why =
            format!("no pitch is above {pitch:.3} and no roll above {roll:.3} in {lasts_s:.0} s");
        return unit("pitch_deg and roll_deg", "radians", why, "degrees");
    }
    let turns = roll_over_bank(approach);
    if let Some(slope) = turns.filter(|_| varies(&|state| state.pose.roll_deg)) {
        let why = format!("roll_deg is {slope:.3} times the bank that the turns need");
        let degrees = "degrees, right wing down positive";
        if ROLL_IN_RADIANS.contains(&slope) {
            return unit("roll_deg", "radians", why, degrees);
        }
        if slope < ROLL_TO_THE_LEFT {
            return unit("roll_deg", "rolls to the left", why, degrees);
        }
    }
    Ok(())
}

/// Slope of the roll over the bank in coordinated turns; `None` for flights without turns.
fn roll_over_bank(approach: &[FlightState]) -> Option<f64> {
    let track_rad = |state: &FlightState| state.velocity_east_mps.atan2(state.velocity_north_mps);
    let (mut products, mut squares, mut turns) = (0.0, 0.0, 0_u32);
    let mut from = 0;
    while from < approach.len() {
        let start = &approach[from];
        let ends = |state: &FlightState| state.time_s - start.time_s >= TURN_S;
        let Some(length) = approach[from..].iter().position(ends) else {
            break;
        };
        let part = &approach[from..=from + length];
        let end = &part[length];
        let turn_deg = (track_rad(end) - track_rad(start)).to_degrees();
        let rate_deg = Degrees(turn_deg).wrapped_180().0 / (end.time_s - start.time_s);
        let speed_mps = (ground_speed_mps(start) + ground_speed_mps(end)) / 2.0;
        let bank_deg = (speed_mps * rate_deg.to_radians() / GRAVITY_MPS2)
            .atan()
            .to_degrees();
        let rolls = part.iter().map(|state| state.pose.roll_deg);
        products += bank_deg * rolls.sum::<f64>() / part.len() as f64;
        squares += bank_deg * bank_deg;
        turns += 1;
        from += length;
    }
    let is_turning = squares > f64::from(turns) * TURNING_DEG * TURNING_DEG;
    (turns >= MIN_TURNS && is_turning).then(|| products / squares)
}
