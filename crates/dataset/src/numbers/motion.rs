//! The motion of something in an image at a time, from its places around that time.

use glam::DVec2;

use crate::numbers::least_squares::NormalEquations;
use crate::numbers::spread::deviation_from_zero;

/// Places that count: within these seconds, or else this number of the nearest ones ... A parabola through six seconds on both sides
/// smooths the beginning of the glide path so much that lags came out too large by up to a seventh.
const AROUND_S: f64 = 4.0;
const MIN_PLACES: usize = 5;
/// ... but none that are farther away than this, seconds.
pub const MAX_DISTANCE_S: f64 = 15.0;
/// Places whose distance from the cubic is measured for the scatter; more do not change it.
const MAX_SCATTERED: usize = 1_000;
/// A place counts in the scatter if this share of the variance remains beside the cubic; at the ends cubics follow places too closely.
const MIN_FREE_VARIANCE: f64 = 0.05;

/// Motion of something at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Change of place per second, in the unit of the places.
    pub per_s: DVec2,
    /// Standard deviation of each coordinate of that, for places with a standard deviation of 1.
    pub unit_sd_per_s: f64,
    /// Place at that time by the fitted cubic.
    pub place: DVec2,
    /// Variance of each coordinate of that, for places with a variance of 1.
    pub unit_variance: f64,
}

/// Place and slope at a time of the cubic that fits the places best; `None` of too few. `places`: by time, seconds.
pub fn motion_at(places: &[(f64, DVec2)], at_s: f64) -> Option<Motion> {
    let near = near(places, at_s)?;
    let powers = |time_s: f64| [0, 1, 2, 3].map(|power| (time_s - at_s).powi(power));
    let mut normal = NormalEquations::new(4);
    for (time_s, _) in near {
        normal.add(&powers(*time_s), 0.0, 1.0);
    }
    let inverse = normal.inverse()?;
    let coefficient = |number: usize| -> DVec2 {
        let factor = |time_s: f64| -> f64 {
            let terms = inverse[number].iter().zip(powers(time_s));
            terms.map(|(of_power, power)| of_power * power).sum()
        };
        (near.iter().map(|(time_s, place)| factor(*time_s) * *place)).sum()
    };
    Some(Motion {
        per_s: coefficient(1),
        unit_sd_per_s: inverse[1][1].sqrt(),
        place: coefficient(0),
        unit_variance: inverse[0][0],
    })
}

/// Robust standard deviation of places from the cubics through those around them, along both axes; 0 of too few. `places`: by time,
/// seconds.
pub fn scatter(places: &[(f64, DVec2)]) -> DVec2 {
    let step = places.len().div_ceil(MAX_SCATTERED).max(1);
    let off = places.iter().step_by(step).filter_map(|(time_s, place)| {
        let Motion {
            place: expected,
            unit_variance,
            ..
        } = motion_at(places, *time_s)?;
        let expected_square = 1.0 - unit_variance;
        (expected_square > MIN_FREE_VARIANCE).then(|| (*place - expected) / expected_square.sqrt())
    });
    let off: Vec<DVec2> = off.collect();
    let along = |axis: DVec2| deviation_from_zero(off.iter().map(|off| off.dot(axis)));
    DVec2::new(along(DVec2::X), along(DVec2::Y))
}

/// The places around a time.
fn near(places: &[(f64, DVec2)], at_s: f64) -> Option<&[(f64, DVec2)]> {
    let from = |time_s: f64| places.partition_point(|(of_s, _)| *of_s < time_s);
    let (mut first, mut end) = (from(at_s - AROUND_S), from(at_s + AROUND_S));
    let away_s = |index: usize| {
        let (of_s, _) = places.get(index)?;
        Some((of_s - at_s).abs()).filter(|away_s| *away_s <= MAX_DISTANCE_S)
    };
    while end - first < MIN_PLACES {
        let before_s = first.checked_sub(1).and_then(away_s);
        let after_s = away_s(end);
        match (before_s, after_s) {
            (Some(before_s), Some(after_s)) if before_s <= after_s => first -= 1,
            (_, Some(_)) => end += 1,
            (Some(_), None) => first -= 1,
            (None, None) => return None,
        }
    }
    Some(&places[first..end])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn places(step_s: f64, ticks: u32) -> Vec<(f64, DVec2)> {
        let place = |tick: u32| {
            let time_s = step_s * f64::from(tick);
            (
                time_s,
                DVec2::new(3.0 * time_s, 0.01 * time_s.powi(3) - 0.5 * time_s.powi(2)),
            )
        };
        (0..ticks).map(place).collect()
    }

    #[test]
    fn a_bend_four_seconds_away_does_not_count() {
        let place = |tick: u32| {
            let time_s = f64::from(tick);
            (time_s, DVec2::new(3.0 * time_s, (time_s - 20.0).max(0.0)))
        };
        let places: Vec<(f64, DVec2)> = (0..40).map(place).collect();
        for (at_s, down) in [(16.0, 0.0), (24.0, 1.0)] {
            let motion = motion_at(&places, at_s).unwrap().per_s;
            assert!((motion - DVec2::new(3.0, down)).length() < 1e-6, "{motion}");
        }
    }

    #[test]
    fn a_cubic_has_its_slope_at_any_rate_and_at_its_ends() {
        for step_s in [0.1, 1.0, 2.0, 3.3] {
            let places = places(step_s, 20);
            for at_s in [0.0, 7.0 * step_s, 19.0 * step_s] {
                let motion = motion_at(&places, at_s).unwrap().per_s;
                let true_motion = DVec2::new(3.0, 0.03 * at_s * at_s - at_s);
                assert!((motion - true_motion).length() < 1e-6, "{motion}");
            }
        }
    }

    #[test]
    fn a_motion_is_known_better_in_the_middle_than_at_the_ends() {
        let places = places(1.0, 20);
        let sd = |at_s| motion_at(&places, at_s).unwrap().unit_sd_per_s;
        // Savitzky and Golay: a cubic through eight places.
        assert!((sd(9.5) - 0.410).abs() < 1e-3, "{}", sd(9.5));
        assert!(sd(0.0) > 3.0 * sd(9.5));
        // Of four places before it, itself, and three after it.
        let middle = motion_at(&places, 9.0).unwrap();
        assert!((middle.unit_variance - 145.0 / 462.0).abs() < 1e-9);
        assert!(middle.place.distance(places[9].1) < 1e-9);
    }

    #[test]
    fn few_places_and_those_that_are_far_away_have_none() {
        assert_eq!(motion_at(&places(1.0, 4), 2.0), None);
        assert_eq!(motion_at(&places(1.0, 20), 40.0), None);
        assert_eq!(motion_at(&[], 0.0), None);
    }
}
