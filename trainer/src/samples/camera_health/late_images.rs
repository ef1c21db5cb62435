//! Correction for late images.
//!
//! `dtd detect` measures the lag of each view ([`dataset::tables::health::late_views`]). A late image shows where the aircraft was before,
//! so boxes and shifts are moved by the motion in this view during the lag. Where the motion is unknown, the view is ignored. Errors in the
//! motion make each shift less certain. An error in the lag is common to the whole flight, and so is the doubt about a lag that is only
//! likely.

use std::collections::BTreeMap;

use dataset::numbers::motion::{motion_at, scatter};
use dataset::tables::health::{LIKELY, Late, MIN_LAG_SD_MS, ViewHealth, ViewLag, late_views};
use glam::DVec2;

use crate::samples::camera_health::Corrections;
use crate::samples::trusted_boxes::centre_and_size;
use crate::samples::{CommonError, Observation};

/// Standard deviation of a barely likely lag, relative to the lag: one such lag in four is spurious. The share falls with the significance.
const DOUBT: f64 = 0.5;
/// A lag is the slope of distances over motions, and errors in the motions attenuate it: by a quarter where the sightings leave 0.05 s, in
/// fog, and not at all where they leave 0.015 s (health tables of scripts/disturbed-corpora.sh). The missing part grows with the square of
/// this standard deviation.
const ATTENUATING_SD_S: f64 = 0.1;

/// Lag per view.
pub(crate) fn lateness(views: &[String], health: &[ViewHealth]) -> Vec<Late> {
    let [likely, sure] =
        [ViewLag::is_likely, ViewLag::is_sure].map(|counts| late_views(health, counts));
    let of_view = |view: &String| {
        let [late, certain] = [&likely, &sure].map(|late| late.get(view.as_str()));
        let late = late.copied().unwrap_or_default();
        let of_sightings = (late.sd_s.powi(2) - (MIN_LAG_SD_MS / 1e3).powi(2)).max(0.0);
        let missing_s = late.seconds * of_sightings / ATTENUATING_SD_S.powi(2);
        let uncertain_s = (late.seconds - certain.map_or(0.0, |late| late.seconds)).abs();
        Late {
            sd_s: late
                .sd_s
                .hypot(missing_s)
                .hypot(doubt_s(uncertain_s, late.sd_s)),
            ..late
        }
    };
    views.iter().map(of_view).collect()
}

/// Standard deviation of a likely but uncertain lag, seconds.
fn doubt_s(lag_s: f64, sd_s: f64) -> f64 {
    if lag_s == 0.0 {
        return 0.0;
    }
    let beyond = ((lag_s / sd_s).powi(2) - LIKELY.powi(2)).max(0.0);
    DOUBT * lag_s * (-beyond / 4.0).exp()
}

/// Box centres per view and track, by time in seconds.
type Tracks = BTreeMap<(usize, Option<u32>), Vec<(f64, DVec2)>>;

/// Corrects a scenario's ticks for the lag of each view, and counts the changes.
pub(crate) fn in_time(
    observations: Vec<Observation>,
    late: &[Late],
    counts: &mut Corrections,
) -> Vec<Observation> {
    if late.iter().all(|late| *late == Late::default()) {
        return observations;
    }
    let mut tracks = Tracks::new();
    for observed in &observations {
        for (view, seen) in observed.boxes.iter().enumerate() {
            if let Some(seen) = seen
                && late[view] != Late::default()
            {
                let track = (view, observed.tracks[view]);
                let at = (observed.time_s(), centre_and_size(seen).0);
                tracks.entry(track).or_default().push(at);
            }
        }
    }
    let scatter_px: BTreeMap<_, DVec2> = (tracks.iter())
        .map(|(track, places)| (*track, scatter(places)))
        .collect();
    let moved = |observed: Observation| {
        let motion_px_s = |view: usize| {
            let track = (view, observed.tracks[view]);
            let motion = motion_at(tracks.get(&track)?, observed.time_s())?;
            Some([motion.per_s, motion.unit_sd_per_s * scatter_px[&track]])
        };
        // Motion per view, and its standard deviation.
        let motions: Vec<Option<[DVec2; 2]>> = (late.iter().enumerate())
            .map(|(view, late)| match motion_px_s(view) {
                None if late.seconds == 0.0 => Some([DVec2::ZERO; 2]),
                motion => motion,
            })
            .collect();
        for (view, seen) in observed.boxes.iter().enumerate() {
            if late[view].seconds == 0.0 || seen.is_none() {
                continue;
            }
            match motions[view] {
                Some(_) => counts.late += 1,
                None => counts.late_withheld += 1,
            }
        }
        observed
            .moved(|view, place_px| Some(place_px + late[view].seconds * motions[view]?[0]))
            .widened(|view| late[view].seconds * motions[view].unwrap_or_default()[1])
            .with_common((0..late.len()).map(|view| CommonError {
                view,
                sd_px: late[view].sd_s * motions[view].unwrap_or_default()[0],
            }))
    };
    observations.into_iter().map(moved).collect()
}

#[cfg(test)]
mod tests {
    use dataset::tables::health::{HealthState, ViewLag};

    use super::*;

    const LATE_S: f64 = 0.45;
    const LATE: [Late; 2] = [
        Late {
            seconds: 0.0,
            sd_s: 0.0,
        },
        Late {
            seconds: LATE_S,
            sd_s: 0.03,
        },
    ];

    /// Ticks from two views; the second is late.
    fn flight(late_s: f64) -> Vec<Observation> {
        let tick = |tick: u32| {
            let time_s = f64::from(tick);
            let columns = [300.0 + 4.0 * time_s, 500.0 + 20.0 * (time_s - late_s)];
            Observation::registered(tick, columns)
        };
        (0..20).map(tick).collect()
    }

    #[test]
    fn boxes_and_shifts_of_a_late_view_are_moved_to_where_it_would_have_seen_them() {
        let mut counts = Corrections::default();
        let moved = in_time(flight(LATE_S), &LATE, &mut counts);
        for (moved, expected) in moved.iter().zip(flight(0.0)) {
            let at = |observed: &Observation| observed.boxes[1].unwrap().cx_px;
            assert!((at(moved) - at(&expected)).abs() < 1e-6);
            let shift = |observed: &Observation| observed.shifts[1].unwrap().shift_px;
            assert!((shift(moved) - shift(&expected)).length() < 1e-6);
            // The motion is known exactly: 20 pixels per second to the right.
            let sd_px = moved.shifts[1].unwrap().sd_px;
            assert!((sd_px - DVec2::new(0.03, 0.04)).length() < 1e-6, "{sd_px}");
            let [CommonError { view: 1, sd_px }] = moved.common_errors[..] else {
                panic!("{:?}", moved.common_errors);
            };
            assert!((sd_px - DVec2::new(0.6, 0.0)).length() < 1e-6, "{sd_px}");
            assert_eq!(moved.boxes[0], expected.boxes[0]);
        }
        assert_eq!((counts.late, counts.late_withheld), (20, 0));
        let none = [Late::default(); 2];
        assert_eq!(in_time(flight(0.0), &none, &mut counts), flight(0.0));
    }

    #[test]
    fn a_lag_that_is_not_certain_stays_in_doubt_and_a_certain_one_has_the_part_that_errors_of_motions_hide()
     {
        let views = ["left".to_owned(), "right".to_owned()];
        let late = |lag_ms: f64, lag_sd_ms: f64| {
            let row = |view: &String, lag: Option<ViewLag>| ViewHealth {
                tick: 0,
                view: view.clone(),
                state: HealthState::Unknown,
                motion: None,
                state_live: HealthState::Unknown,
                lag,
                vertical_px: None,
            };
            let lag = ViewLag { lag_ms, lag_sd_ms };
            let [left, right] = &views;
            lateness(&views, &[row(left, None), row(right, Some(lag))])
        };
        let none = Late::default();
        assert_eq!(late(35.0, 50.0), [none; 2]);
        // The first view is the late one.
        let of_views = late(-490.0, 25.0);
        assert_eq!((of_views[0].seconds, of_views[1]), (0.49, none));
        assert_eq!(late(110.0, 50.0), [none; 2]);
        let likely = late(-200.0, 60.0);
        assert_eq!((likely[0].seconds, likely[1]), (0.2, none));
        assert!((0.09..0.14).contains(&likely[0].sd_s), "{:?}", likely[0]);
        for (sd_ms, least_s, most_s) in [(25.0, 0.025, 0.04), (60.0, 0.15, 0.19)] {
            let sure = late(490.0, sd_ms)[1];
            assert_eq!(sure.seconds, 0.49);
            assert!((least_s..most_s).contains(&sure.sd_s), "{sure:?}");
        }
        // At 20 pixels per second.
        let likely = late(200.0, 78.0);
        let mut counts = Corrections::default();
        let moved = in_time(flight(0.2), &likely, &mut counts);
        for (moved, expected) in moved.iter().zip(flight(0.0)) {
            let at = |observed: &Observation| observed.boxes[1].unwrap().cx_px;
            assert!((at(moved) - at(&expected)).abs() < 1e-6);
            let common_px = moved.common_errors[0].sd_px.x;
            assert!((2.5..4.5).contains(&common_px), "{common_px}");
        }
    }

    #[test]
    fn the_motion_is_as_uncertain_as_the_places_scatter() {
        const NOISE_PX: f64 = 0.5;
        let mut noisy = flight(LATE_S);
        for (number, observed) in noisy.iter_mut().enumerate() {
            // Alternating, so that no cubic follows.
            let off_px = if number % 2 == 0 { NOISE_PX } else { -NOISE_PX };
            observed.boxes[1].as_mut().unwrap().cx_px += off_px;
        }
        let mut counts = Corrections::default();
        let widened = in_time(noisy, &LATE, &mut counts);
        // A cubic through eight positions one second apart determines the slope in the middle to 0.41 of their deviation.
        let expected_px = 0.03_f64.hypot(LATE_S * 0.41 * NOISE_PX);
        let sd_px = widened[10].shifts[1].unwrap().sd_px;
        // A median overestimates errors that all have the same size.
        assert!((1.0..1.8).contains(&(sd_px.x / expected_px)), "{sd_px}");
        assert!(
            sd_px.x > 2.0 * 0.03 && (sd_px.y - 0.04).abs() < 1e-6,
            "{sd_px}"
        );
    }

    #[test]
    fn a_late_view_does_not_count_where_its_motion_is_unknown() {
        let mut counts = Corrections::default();
        let few = flight(LATE_S).into_iter().take(3).collect();
        let moved = in_time(few, &LATE, &mut counts);
        assert!(
            moved
                .iter()
                .all(|tick| tick.boxes[1].is_none() && tick.boxes[0].is_some())
        );
        assert_eq!((counts.late, counts.late_withheld), (0, 3));
    }
}
