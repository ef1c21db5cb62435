//! A crew's technique on the approach: speeds, flaps, gear and flare.
//!
//! Input: the flight's seed, the speed at the start, the headwind. Output: target speed, flaps and gear for a distance to the
//! threshold, and the numbers of the flare. The schedule follows the recorded flights; the seed varies it as crews differ, so that two
//! flights in the same calm air differ.

use dataset::geometry::pose::Controls;

use super::random::{self, Stream, uniform};

/// Speed schedule: distance before the threshold (metres), equivalent airspeed (metres per second) relative to the final one.
const SPEED_SCHEDULE: [(f64, f64); 4] = [
    (15_300.0, 21.3),
    (12_700.0, 3.8),
    (9_000.0, 0.8),
    (7_000.0, 0.0),
];
/// Part of the headwind at 10 m that is added to the final speed, and the largest addition (15 kt).
const HEADWIND_PART: f64 = 0.25;
const MAX_ADDITION_MPS: f64 = 7.7;
/// Flap schedule: distance before the threshold (metres), flap ratio from there on.
const FLAP_SCHEDULE: [(f64, f64); 4] = [
    (f64::INFINITY, 0.25),
    (15_000.0, 0.375),
    (13_000.0, 0.625),
    (12_000.0, 0.75),
];
const GEAR_DOWN_AT_M: f64 = 14_800.0;
/// A flight that starts slower than the schedule was slowed down early: everything happens this much earlier per metre per second,
/// metres.
const EARLIER_PER_MPS: f64 = 500.0;
/// Differences up to this are within the habits of crews, metres per second.
const HABITUAL_MPS: f64 = 4.0;
/// Flap ratio by excess over the final speed, metres per second: flaps and gear are out below it at any distance.
const FLAPS_NEEDED_BELOW_MPS: [(f64, f64); 3] = [(14.0, 0.375), (5.0, 0.625), (3.0, 0.75)];

/// Crew-specific numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Technique {
    start_speed_mps: f64,
    final_speed_mps: f64,
    earlier_m: f64,
    /// Wheel height at the beginning of the flare, metres.
    pub(crate) flare_height_m: f64,
    /// Rate of descent at the end of the flare, metres per second.
    pub(crate) touchdown_sink_mps: f64,
    /// Deceleration by brakes and reversers, metres per second squared.
    pub(crate) braking_mps2: f64,
}

impl Technique {
    /// Draws a crew. `approach_speed_mps` is the type's equivalent airspeed on final without wind, `start_speed_mps` that at the start,
    /// `headwind_mps` the wind at 10 m against the landing course (negative: tailwind).
    pub(crate) fn of(
        seed: u64,
        approach_speed_mps: f64,
        start_speed_mps: f64,
        headwind_mps: f64,
    ) -> Self {
        let mut generator = random::generator(seed, Stream::Technique);
        let addition_mps = (HEADWIND_PART * headwind_mps).clamp(0.0, MAX_ADDITION_MPS);
        let final_speed_mps =
            approach_speed_mps + addition_mps + uniform(&mut generator, -0.8, 0.8);
        let missing_mps =
            (SPEED_SCHEDULE[0].1 - (start_speed_mps - final_speed_mps) - HABITUAL_MPS).max(0.0);
        Self {
            start_speed_mps,
            final_speed_mps,
            earlier_m: uniform(&mut generator, -500.0, 500.0) + EARLIER_PER_MPS * missing_mps,
            flare_height_m: uniform(&mut generator, 14.0, 18.0),
            touchdown_sink_mps: uniform(&mut generator, 0.6, 1.7),
            braking_mps2: uniform(&mut generator, 0.9, 1.5),
        }
    }

    /// Target equivalent airspeed at a distance before the threshold, metres per second.
    pub(crate) fn speed_mps(&self, before_threshold_m: f64) -> f64 {
        let above_final = interpolate(&SPEED_SCHEDULE, before_threshold_m - self.earlier_m);
        self.start_speed_mps
            .min(self.final_speed_mps + above_final)
            .max(self.final_speed_mps)
    }

    /// Target flaps and gear at a distance before the threshold and an equivalent airspeed. They never retract.
    pub(crate) fn controls(
        &self,
        before_threshold_m: f64,
        speed_mps: f64,
        now: Controls,
    ) -> Controls {
        let distance_m = before_threshold_m - self.earlier_m;
        let by_distance = FLAP_SCHEDULE
            .iter()
            .filter(|(from_m, _)| distance_m <= *from_m)
            .map(|(_, flap)| *flap);
        let by_speed = FLAPS_NEEDED_BELOW_MPS
            .iter()
            .filter(|(above_final, _)| speed_mps < self.final_speed_mps + above_final)
            .map(|(_, flap)| *flap);
        let flap_ratio = by_distance.chain(by_speed).fold(now.flap_ratio, f64::max);
        let needs_gear = distance_m <= GEAR_DOWN_AT_M || flap_ratio > 0.3;
        Controls {
            flap_ratio,
            gear_ratio: if needs_gear { 1.0 } else { now.gear_ratio },
        }
    }
}

/// Linear between the points, constant beyond them. Distances fall along the table.
fn interpolate(table: &[(f64, f64)], at: f64) -> f64 {
    let after = table.partition_point(|(from, _)| *from > at);
    match (after.checked_sub(1).map(|i| &table[i]), table.get(after)) {
        (Some((x0, y0)), Some((x1, y1))) => y0 + (y1 - y0) * (at - x0) / (x1 - x0),
        (None, Some((_, y))) | (Some((_, y)), None) => *y,
        (None, None) => f64::NAN,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The 737's, 138 kt.
    const APPROACH_SPEED_MPS: f64 = 71.2;

    #[test]
    fn speed_falls_from_the_start_to_the_final_one_and_never_rises() {
        let crew = Technique::of(5, APPROACH_SPEED_MPS, 92.5, 0.0);
        let speeds: Vec<f64> = (0..200)
            .map(|i| crew.speed_mps(20_000.0 - 100.0 * f64::from(i)))
            .collect();
        assert!(speeds.windows(2).all(|pair| pair[1] <= pair[0] + 1e-12));
        assert_eq!(speeds[0], 92.5_f64.min(crew.final_speed_mps + 21.3));
        assert!((70.4..=72.0).contains(speeds.last().unwrap()));
    }

    #[test]
    fn headwind_makes_the_approach_faster_and_tailwind_does_not_make_it_slower() {
        let calm = Technique::of(5, APPROACH_SPEED_MPS, 92.5, 0.0).speed_mps(2_000.0);
        assert!(Technique::of(5, APPROACH_SPEED_MPS, 92.5, 8.0).speed_mps(2_000.0) > calm + 1.5);
        assert_eq!(
            Technique::of(5, APPROACH_SPEED_MPS, 92.5, -8.0).speed_mps(2_000.0),
            calm
        );
    }

    #[test]
    fn flaps_and_gear_come_out_step_by_step_and_stay_out() {
        let crew = Technique::of(0, APPROACH_SPEED_MPS, 92.5, 0.0);
        let mut now = Controls {
            flap_ratio: 0.0,
            gear_ratio: 0.0,
        };
        let mut seen = vec![];
        for i in 0..200 {
            let distance_m = 20_000.0 - 100.0 * f64::from(i);
            let next = crew.controls(distance_m, crew.speed_mps(distance_m), now);
            assert!(next.flap_ratio >= now.flap_ratio && next.gear_ratio >= now.gear_ratio);
            if seen.last() != Some(&next.flap_ratio) {
                seen.push(next.flap_ratio);
            }
            now = next;
        }
        assert_eq!(
            now,
            Controls {
                flap_ratio: 0.75,
                gear_ratio: 1.0
            }
        );
        assert!(seen.len() >= 3 && seen[0] == 0.25, "{seen:?}");
    }

    #[test]
    fn a_flight_that_starts_slow_starts_with_flaps_and_gear_out() {
        let crew = Technique::of(0, APPROACH_SPEED_MPS, 80.0, 0.0);
        let up = Controls {
            flap_ratio: 0.0,
            gear_ratio: 0.0,
        };
        let controls = crew.controls(18_520.0, 80.0, up);
        assert!(
            controls.flap_ratio >= 0.375 && controls.gear_ratio == 1.0,
            "{controls:?}"
        );
    }
}
