//! The arrival in a track, in coordinates of the runway, or the reason why there is none.

use dataset::geometry::geodesy::{Geodetic, LatLon};
use dataset::geometry::runway::{Runway, RunwayCoordinates};
use dataset::numbers::spread::median;
use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;

use super::formats::{Fix, NEAR_M};
use crate::recording::{AFTER_TARGET_S, CORRIDOR_M, GO_AROUND_M};
use crate::trajectory::last_approach;

/// Fixes that an arrival needs at least, and the time that they cover, seconds. Some receivers report every eight seconds.
const MIN_FIXES: usize = 8;
const MIN_APPROACH_S: f64 = 60.0;
/// No aircraft on approach is faster, m/s: a position that implies it to both neighbours is wrong.
const FASTEST_MPS: f64 = 250.0;
/// Arrivals begin within this distance, metres.
pub(super) const FURTHEST_M: f64 = 25.0 * METERS_PER_NAUTICAL_MILE;
/// Slower aircraft taxi, m/s.
const FLYING_MPS: f64 = 40.0;
/// A track may end in the air within this distance.
const LATEST_END_M: f64 = 3_000.0;
/// Maximum gap between different positions, seconds: receivers have gaps of 13 s, and repeat a position for some seconds before and after.
/// Then the distances to go between which it applies.
const MAX_GAP_S: f64 = 20.0;
const GAPS_MATTER_M: (f64, f64) = (METERS_PER_NAUTICAL_MILE, 5.0 * METERS_PER_NAUTICAL_MILE);
/// Distance from the centreline within the last two kilometres, metres.
const OTHER_RUNWAY_M: f64 = 150.0;
const FINAL_M: f64 = 2_000.0;
/// An arrival begins in a corridor that widens less with distance than the one of recordings.
const CORRIDOR: f64 = 0.5;

/// Reason why a track is no arrival on the runway. The text is about the track: "it ..".
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(super) enum NoArrival {
    /// It does not land there.
    #[error("{0}")]
    Elsewhere(String),
    /// It may, but is not known well enough.
    #[error("{0}")]
    Unusable(String),
}

fn no<T>(reason: String) -> Result<T, NoArrival> {
    Err(NoArrival::Unusable(reason))
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ArrivalFix {
    pub(super) fix: Fix,
    /// Distance to the target along the course, and offset to the right, metres.
    pub(super) to_go_m: f64,
    pub(super) right_m: f64,
}

/// Removes positions that no aircraft reaches from the one before and leaves for the next one; returns their number as well.
pub(super) fn without_jumps(fixes: &[Fix]) -> (Vec<Fix>, usize) {
    let jumps = |from: &Fix, to: &Fix| {
        from.place().distance_m(to.place()) / (to.time_s - from.time_s) > FASTEST_MPS
    };
    let mut kept: Vec<Fix> = Vec::with_capacity(fixes.len());
    for (index, fix) in fixes.iter().enumerate() {
        let is_alone = kept.is_empty() && index + 1 == fixes.len();
        let is_outlier = kept.last().is_none_or(|before| jumps(before, fix))
            && (fixes.get(index + 1)).is_none_or(|next| jumps(fix, next));
        if is_alone || !is_outlier {
            kept.push(*fix);
        }
    }
    let left_out = fixes.len() - kept.len();
    (kept, left_out)
}

/// The parts of a track in which the aircraft passes the target in the landing direction, each with the time past it that an arrival needs.
pub(super) fn passings(fixes: &[Fix], runway: &Runway) -> Vec<Vec<Fix>> {
    let target = runway.touchdown_target();
    let places: Vec<ArrivalFix> = fixes.iter().map(|fix| seen(*fix, target, runway)).collect();
    let (mut from, mut parts) = (0, Vec::new());
    for (index, pair) in places.windows(2).enumerate() {
        let passes = pair[0].to_go_m > 0.0 && pair[1].to_go_m <= 0.0;
        if passes && pair[1].right_m.abs() < FINAL_M {
            let last_s = pair[1].fix.time_s + AFTER_TARGET_S;
            let later = places[index + 1..].iter();
            let rolls = later
                .take_while(|at| at.fix.time_s <= last_s)
                .filter(|at| at.to_go_m <= 0.0);
            let part = places[from..=index].iter().chain(rolls);
            parts.push(part.map(|at| at.fix).collect());
            from = index + 1;
        }
    }
    parts
}

pub(super) fn arrival(fixes: &[Fix], runway: &Runway) -> Result<Vec<ArrivalFix>, NoArrival> {
    let target = runway.touchdown_target();
    let seen: Vec<ArrivalFix> = fixes.iter().map(|fix| seen(*fix, target, runway)).collect();
    if seen.is_empty() {
        return no("it has no positions".into());
    }
    let nearest_m = seen
        .iter()
        .map(|at| at.to_go_m.hypot(at.right_m))
        .fold(f64::INFINITY, f64::min);
    let to_go_m: Vec<f64> = seen.iter().map(|at| at.to_go_m).collect();
    let is_airborne = |index: usize| {
        let Fix {
            on_ground,
            ground_speed_mps,
            ..
        } = seen[index].fix;
        !on_ground && ground_speed_mps.is_none_or(|speed| speed > FLYING_MPS)
    };
    let elsewhere = || {
        let is_near = |at: &ArrivalFix| at.to_go_m.hypot(at.right_m) < FURTHEST_M;
        let flies = |index: usize| is_airborne(index) && is_near(&seen[index]);
        let why = if nearest_m >= FURTHEST_M {
            "never comes near the runway"
        } else if (0..seen.len()).any(flies) {
            "never flies towards the runway in the landing direction: it takes off, lands the other way, or passes by"
        } else {
            "is never seen in the air near the runway"
        };
        let swapped = LatLon {
            latitude_deg: fixes[0].longitude_deg,
            longitude_deg: fixes[0].latitude_deg,
        };
        let is_swapped = nearest_m >= FURTHEST_M && swapped.distance_m(target.lat_lon()) < NEAR_M;
        let nearest = if is_swapped {
            "latitude and longitude are swapped".to_owned()
        } else if nearest_m.is_finite() {
            format!("its nearest position is {nearest_m:.0} m from the touchdown target")
        } else {
            "its positions are not on earth".to_owned()
        };
        NoArrival::Elsewhere(format!("it {why}; {nearest}"))
    };
    let found = last_approach(&to_go_m, is_airborne, FURTHEST_M)
        .filter(|_| nearest_m < FURTHEST_M)
        .ok_or_else(elsewhere)?;
    let end = match found.passing {
        Some(passing) => {
            let last_s = seen[passing].fix.time_s + AFTER_TARGET_S;
            let later = seen[passing..].iter();
            passing + later.take_while(|at| at.fix.time_s <= last_s).count()
        }
        None => seen.len(),
    };
    let before_target = found.passing.unwrap_or(end);
    let first = beginning(&seen[..before_target], found.first);
    if !(first..before_target).any(is_airborne) {
        return Err(elsewhere());
    }
    let arrival = &seen[first..end];
    let approach = &seen[first..before_target];
    let flies_away = found.passing.is_none() && found.first + 1 >= seen.len();
    if flies_away {
        return Err(elsewhere());
    }
    let lasts_s = match approach {
        [first, .., last] => last.fix.time_s - first.fix.time_s,
        _ => 0.0,
    };
    if approach.len() < MIN_FIXES || lasts_s < MIN_APPROACH_S {
        let fixes = approach.len();
        return no(format!(
            "{fixes} different positions in {lasts_s:.0} s of approach, expected at least {MIN_FIXES} in {MIN_APPROACH_S} s"
        ));
    }
    if let Some(last) = approach
        .last()
        .filter(|last| found.passing.is_none() && last.to_go_m > LATEST_END_M)
    {
        return no(format!(
            "it ends {:.0} m before the touchdown target, expected at most {LATEST_END_M} m",
            last.to_go_m
        ));
    }
    let gap = arrival.windows(2).find(|pair| {
        let matters = pair[0].to_go_m > GAPS_MATTER_M.0 && pair[1].to_go_m < GAPS_MATTER_M.1;
        matters && pair[1].fix.time_s - pair[0].fix.time_s > MAX_GAP_S
    });
    if let Some(pair) = gap {
        return no(format!(
            "it has no position for {:.0} s, {:.0} m before the touchdown target; expected at most {MAX_GAP_S} s there",
            pair[1].fix.time_s - pair[0].fix.time_s,
            pair[0].to_go_m
        ));
    }
    let last_m = approach
        .iter()
        .rev()
        .take_while(|at| at.to_go_m < FINAL_M)
        .count()
        .max(5);
    let mut offsets: Vec<f64> = approach[approach.len() - last_m.min(approach.len())..]
        .iter()
        .map(|at| at.right_m)
        .collect();
    let offset_m = median(&mut offsets).abs();
    if offset_m > OTHER_RUNWAY_M {
        return Err(NoArrival::Elsewhere(format!(
            "it is {offset_m:.0} m beside the centreline at the end: another runway?"
        )));
    }
    let altitude_m = |at: &ArrivalFix| {
        let altitude_m = at.fix.altitude_m.or(at.fix.geometric_m);
        altitude_m.filter(|_| !at.fix.on_ground)
    };
    let at_target_m = approach.iter().rev().find_map(altitude_m);
    let highest_m = seen[before_target..end]
        .iter()
        .filter_map(altitude_m)
        .fold(f64::NEG_INFINITY, f64::max);
    if let Some(climbs_m) = at_target_m
        .map(|at_m| highest_m - at_m)
        .filter(|climbs_m| *climbs_m > GO_AROUND_M)
    {
        return Err(NoArrival::Elsewhere(format!(
            "it goes around: it climbs by {climbs_m:.0} m after the touchdown target"
        )));
    }
    Ok(arrival.to_vec())
}

fn seen(fix: Fix, target: Geodetic, runway: &Runway) -> ArrivalFix {
    let here = fix.place().at_altitude_m(target.altitude_msl_m);
    let place = RunwayCoordinates::of(here, target, runway.course_true_deg);
    ArrivalFix {
        fix,
        to_go_m: place.along_track_m,
        right_m: place.cross_track_m,
    }
}

/// The first fix after which the aircraft stays in the corridor and is seen without long gaps, until they matter.
fn beginning(approach: &[ArrivalFix], first: usize) -> usize {
    let leaves = |at: &ArrivalFix| at.right_m.abs() > CORRIDOR_M + CORRIDOR * at.to_go_m;
    let outside = approach[first..]
        .iter()
        .rposition(leaves)
        .map_or(first, |last| first + last + 1);
    let gap = approach[outside.min(approach.len())..]
        .windows(2)
        .rposition(|pair| {
            let is_long = pair[1].fix.time_s - pair[0].fix.time_s > MAX_GAP_S;
            is_long && pair[0].to_go_m >= GAPS_MATTER_M.1
        });
    gap.map_or(outside, |gap| outside + gap + 1)
        .min(approach.len())
}
