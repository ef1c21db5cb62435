//! Geodesic labels: distance and time to touchdown at every tick.
//!
//! Input: the ticks of `frames.parquet`, the touchdown target and the landing course. Output: [`TickLabels`] per tick.

use dataset::geometry::geodesy::Geodetic;
use dataset::geometry::runway::RunwayCoordinates;
use dataset::numbers::units::SimTime;
use dataset::tables::frames::{TickLabels, TickRow};

/// Labels of all ticks, in their order.
pub fn labels_of(ticks: &[TickRow], target: Geodetic, course_true_deg: f64) -> Vec<TickLabels> {
    let coordinates: Vec<_> = ticks
        .iter()
        .map(|tick| RunwayCoordinates::of(tick.pose.position(), target, course_true_deg))
        .collect();
    let passing_s = passing_time_s(ticks, &coordinates);
    ticks
        .iter()
        .zip(coordinates)
        .map(|(tick, at)| TickLabels {
            dtd_m: at.dtd_m,
            along_track_m: at.along_track_m,
            cross_track_m: at.cross_track_m,
            height_over_target_m: at.height_over_target_m,
            time_to_touchdown_s: passing_s
                .map(|passing_s| passing_s - SimTime(tick.time_ns).seconds()),
        })
        .collect()
}

/// Time at which the aircraft first passes abeam the target, seconds since tick 0: linear between the two ticks around it. There is no
/// extrapolation: missing if the recording starts past the target or ends before it.
fn passing_time_s(ticks: &[TickRow], coordinates: &[RunwayCoordinates]) -> Option<f64> {
    let after = coordinates.iter().position(|at| at.along_track_m <= 0.0)?;
    let to_go_after_m = coordinates[after].along_track_m;
    let time_after_s = SimTime(ticks[after].time_ns).seconds();
    if to_go_after_m == 0.0 {
        return Some(time_after_s);
    }
    let before = after.checked_sub(1)?;
    let to_go_before_m = coordinates[before].along_track_m;
    let time_before_s = SimTime(ticks[before].time_ns).seconds();
    let share = to_go_before_m / (to_go_before_m - to_go_after_m);
    Some(time_before_s + share * (time_after_s - time_before_s))
}

#[cfg(test)]
mod tests {
    use dataset::geometry::geodesy::LatLon;
    use testkit::approach::on_glide_path;
    use testkit::{changi_02l, short_corpus};

    use super::*;

    fn flight(along_track_m: &[f64]) -> Vec<TickLabels> {
        let runway = changi_02l();
        let ticks: Vec<_> = along_track_m
            .iter()
            .enumerate()
            .map(|(k, along)| short_corpus::frame(k as u32, on_glide_path(*along, 0.0)))
            .collect();
        labels_of(&ticks, runway.touchdown_target(), runway.course_true_deg)
    }

    fn times(along_track_m: &[f64]) -> Vec<Option<f64>> {
        flight(along_track_m)
            .iter()
            .map(|labels| labels.time_to_touchdown_s)
            .collect()
    }

    #[test]
    fn time_to_touchdown_is_interpolated_between_the_ticks_around_the_target() {
        // One tick a second: 30 of the remaining 40 m are flown in the last second, so the target is passed at 1.75 s.
        let times = times(&[100.0, 30.0, -10.0, -80.0]);
        for (found, expected) in times.iter().zip([1.75, 0.75, -0.25, -1.25]) {
            assert!((found.unwrap() - expected).abs() < 1e-6, "{times:?}");
        }
    }

    #[test]
    fn there_is_a_time_to_touchdown_if_ticks_are_on_both_sides_of_the_target() {
        assert_eq!(times(&[200.0, 100.0, 1.0]), [None, None, None]);
        assert!((times(&[60.0, -20.0])[0].unwrap() - 0.75).abs() < 1e-6);
        assert_eq!(times(&[-10.0, -80.0]), [None, None]);
    }

    #[test]
    fn labels_give_back_the_place_from_which_the_pose_was_made() {
        let labels = flight(&[9_260.0]);
        assert!((labels[0].dtd_m - 9_260.0).abs() < 1e-6);
        assert!((labels[0].along_track_m - 9_260.0).abs() < 1e-6);
        assert!(labels[0].cross_track_m.abs() < 1e-6);
        let glide_m = 9_260.0 * 3.0_f64.to_radians().tan();
        assert!((labels[0].height_over_target_m - glide_m).abs() < 1e-9);
    }

    #[test]
    fn distances_agree_with_published_geodesics() {
        let at = |latitude_deg: f64, longitude_deg: f64| LatLon {
            latitude_deg,
            longitude_deg,
        };
        let angle =
            |degrees: f64, minutes: f64, seconds: f64| degrees + minutes / 60.0 + seconds / 3_600.0;
        // Karney (2013), "Algorithms for geodesics", table 2 (direct problem): from 40 N along 30 degrees, 10 000 km.
        let (start, end) = (at(40.0, 0.0), at(41.793_310_205_06, 137.844_900_043_77));
        assert!((start.distance_m(end) - 10_000_000.0).abs() < 1e-3);
        assert!((start.azimuth_to_deg(end) - 30.0).abs() < 1e-9);
        // Vincenty (1975), line (a), on WGS-84 by GeographicLib: Flinders Peak to Buninyong, 54 972.271 m on GRS80.
        let flinders = at(-angle(37.0, 57.0, 3.720_30), angle(144.0, 25.0, 29.524_40));
        let buninyong = at(-angle(37.0, 39.0, 10.156_10), angle(143.0, 55.0, 35.383_90));
        assert!((flinders.distance_m(buninyong) - 54_972.271).abs() < 1e-3);
        let azimuth_deg = flinders.azimuth_to_deg(buninyong);
        assert!((azimuth_deg - angle(306.0, 52.0, 5.37)).abs() < 1e-5);
    }
}
