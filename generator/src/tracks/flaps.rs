//! Flaps on an approach as airliners are flown: half extended on the glide path, fully for the final speed.
//!
//! Speeds are multiples of the final one, from the A320's flight crew techniques: the S speed, where flaps follow the slats, and the F
//! speed, where they are set for landing. They are extended at S speed once the aircraft descends on the glide path, at 2,000 ft at the
//! latest, and for landing by 1,000 ft.

use dataset::numbers::units::{METERS_PER_FOOT, METERS_PER_NAUTICAL_MILE};

/// Airspeeds below which flaps are half and fully extended, in ratio to the final one.
const S_SPEED: f64 = 1.35;
const F_SPEED: f64 = 1.15;
/// Heights above the target for half and full flaps at the latest, metres.
const HALF_BY_M: f64 = 2_000.0 * METERS_PER_FOOT;
const FULL_BY_M: f64 = 1_000.0 * METERS_PER_FOOT;
/// A dot on the glide path indicator, degrees. Within a nautical mile of the runway the angle says little.
const DOT_DEG: f64 = 0.35;
/// Time from half to full, seconds.
const TRAVEL_S: f64 = 8.0;

#[derive(Debug, Clone, Copy)]
pub(super) struct Moment {
    pub(super) time_s: f64,
    pub(super) to_go_m: f64,
    pub(super) height_m: f64,
    /// Angle of the path, up positive, degrees.
    pub(super) climbs_deg: f64,
    /// Airspeed in ratio to the final one.
    pub(super) faster: f64,
}

/// Times when flaps begin to move, seconds.
#[derive(Debug, Clone, Copy)]
pub(super) struct FlapSchedule {
    half_s: f64,
    full_s: f64,
}

impl FlapSchedule {
    /// Schedule for an approach, by its moments in order of time.
    pub(super) fn of(moments: &[Moment], glide_path_deg: f64) -> Self {
        let is_off = |at: &Moment| {
            let angle_deg = at.height_m.atan2(at.to_go_m).to_degrees();
            let is_beside = (angle_deg - glide_path_deg).abs() > DOT_DEG;
            let descends = -at.climbs_deg > glide_path_deg / 2.0;
            at.to_go_m > METERS_PER_NAUTICAL_MILE && (is_beside || !descends)
        };
        let captured = moments.iter().rposition(is_off).map_or(0, |last| last + 1);
        let first = |from: usize, is_due: &dyn Fn(usize, &Moment) -> bool| {
            (from..moments.len()).find(|index| is_due(*index, &moments[*index]))
        };
        let half = first(0, &|index, at| {
            at.height_m < HALF_BY_M || (index >= captured && at.faster < S_SPEED)
        });
        let full = half.and_then(|half| {
            first(half, &|_, at| {
                at.height_m < FULL_BY_M || at.faster < F_SPEED
            })
        });
        // At the first moment they are extended already.
        let time_s = |index: Option<usize>| match index {
            None => f64::INFINITY,
            Some(0) => f64::NEG_INFINITY,
            Some(index) => moments[index].time_s,
        };
        Self {
            half_s: time_s(half),
            full_s: time_s(full),
        }
    }

    /// Extension at a time, 0 to 1.
    pub(super) fn at(self, time_s: f64) -> f64 {
        let moved = |from_s: f64| ((time_s - from_s) / TRAVEL_S).clamp(0.0, 1.0);
        (moved(self.half_s) + moved(self.full_s)) / 2.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Level at 800 m, then 3 degrees; slow at once or late.
    fn moments(slows_at_m: f64) -> Vec<Moment> {
        (0..400)
            .map(|second| {
                let to_go_m = 28_000.0 - 70.0 * f64::from(second);
                Moment {
                    time_s: f64::from(second),
                    to_go_m,
                    height_m: (to_go_m * 3.0_f64.to_radians().tan()).min(800.0),
                    climbs_deg: if to_go_m > 15_265.0 { 0.0 } else { -3.0 },
                    faster: if to_go_m < slows_at_m { 1.0 } else { 1.3 },
                }
            })
            .collect()
    }

    #[test]
    fn flaps_are_half_extended_on_the_glide_path_and_fully_when_it_is_slow_or_low() {
        let flaps = FlapSchedule::of(&moments(9_000.0), 3.0);
        let at_m = |to_go_m: f64| flaps.at((28_000.0 - to_go_m) / 70.0);
        assert_eq!(at_m(20_000.0), 0.0);
        assert_eq!(at_m(14_000.0), 0.5);
        assert_eq!(at_m(8_000.0), 1.0);
        let late = FlapSchedule::of(&moments(0.0), 3.0);
        assert_eq!(late.at((28_000.0 - 7_000.0) / 70.0), 0.5);
        assert_eq!(late.at((28_000.0 - 4_500.0) / 70.0), 1.0);
        let established = FlapSchedule::of(&moments(9_000.0)[300..], 3.0);
        assert_eq!(established.at(300.0), 1.0);
    }
}
