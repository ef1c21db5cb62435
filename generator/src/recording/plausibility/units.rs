//! Units of the columns, compared with each other over the approach.

use dataset::geometry::pose::FlightState;
use dataset::numbers::spread::median_of;

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
/// Airspeed less ground speed on approach, m/s: the wind. Stronger tailwinds are not landed with.
const HEADWIND_MPS: std::ops::RangeInclusive<f64> = -27.0..=50.0;
/// No airliner flies slower through the air, m/s: the slowest recorded approach has 72.
const MIN_AIRSPEED_MPS: f64 = 50.0;
/// Velocities may point this far beside the way of the positions on average, degrees.
const DIRECTION_TOLERANCE_DEG: f64 = 15.0;
/// Slower states have no heading that has to agree with the track.
pub(super) const MOVING_MPS: f64 = 30.0;
pub(crate) const GRAVITY_MPS2: f64 = 9.81;

/// Name of the unit with this ratio to the expected one; the nearest if several match.
fn unit_of(ratio: f64, units: &[(f64, &'static str)]) -> Option<&'static str> {
    let off = |factor: f64| (ratio / factor - 1.0).abs();
    let nearest = units.iter().min_by(|a, b| off(a.0).total_cmp(&off(b.0)));
    nearest
        .filter(|(factor, _)| off(*factor) < RATIO_TOLERANCE)
        .map(|(_, name)| *name)
}

pub(super) fn unit(
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

pub(super) fn contradiction(why: String, expected: &'static str) -> Result<(), Implausible> {
    Err(Implausible::Contradiction { why, expected })
}

pub(super) fn ground_speed_mps(state: &FlightState) -> f64 {
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
    let speeds: Vec<[f64; 2]> = moving
        .map(|state| [state.true_airspeed_mps, ground_speed_mps(state)])
        .collect();
    let median_by = |of: fn(&[f64; 2]) -> f64| median_of(speeds.iter().map(of));
    let (Some(ratio), Some(headwind_mps), Some(airspeed_mps)) = (
        median_by(|[air, ground]| air / ground),
        median_by(|[air, ground]| air - ground),
        median_by(|[air, _]| *air),
    ) else {
        return Ok(());
    };
    if HEADWIND_MPS.contains(&headwind_mps) && airspeed_mps >= MIN_AIRSPEED_MPS {
        return Ok(());
    }
    let why =
        format!("tas_mps is {ratio:.2} times the ground speed, {airspeed_mps:.0} m/s (medians)");
    match unit_of(ratio, &SPEED_RATIOS) {
        Some(looks_like) => unit("tas_mps", looks_like, why, "metres per second"),
        None => contradiction(
            why,
            "at least 50 m/s, at most 27 m/s of tailwind, and at most 50 m/s of headwind",
        ),
    }
}
