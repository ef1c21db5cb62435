//! Things that stand still, and arrivals that hardly move.

use dataset::geometry::camera::Camera;
use testkit::changi_02l;
use testkit::rig::{VIEWS, placed};

use super::*;

/// Times between two images, seconds.
const PERIODS_S: [f64; 3] = [2.0, 1.0, 1.0 / 30.0];
const MILE_M: f64 = 1_852.0;
/// Ground speeds of slow and usual arrivals, m/s.
const SPEEDS_MPS: [f64; 2] = [60.0, 82.0];

#[derive(Debug, Clone, Copy, PartialEq)]
enum Path {
    /// Down the 3 degree glide path.
    Descending,
    /// Level flight at 2,500 ft.
    Level,
}

/// A flight straight at a view's mast, one degree off the runway course, at this distance from touchdown.
fn straight_at(view: &str, path: Path, along_m: f64) -> PixelBox {
    const BEYOND_M: f64 = 1_500.0;
    let from_mast_m = along_m + BEYOND_M;
    let inward_m = from_mast_m * 1_f64.to_radians().sin();
    let right_m = if view == VIEWS[0] {
        -300.0 + inward_m
    } else {
        300.0 - inward_m
    };
    seen_from(view, path, along_m, right_m)
}

fn seen_from(view: &str, path: Path, along_m: f64, right_m: f64) -> PixelBox {
    let altitude_m = match path {
        Path::Descending => 6.7 + along_m * 3_f64.to_radians().tan(),
        Path::Level => 762.0,
    };
    let camera = Camera::from_pose(&placed(view), 1920, 1280);
    let place = changi_02l()
        .point_on_approach(along_m, right_m)
        .at_altitude_m(altitude_m)
        .to_ecef();
    let pixel = camera.project(place).unwrap();
    assert!((0.0..1920.0).contains(&pixel.x), "{view} {pixel}");
    at(
        pixel.x,
        pixel.y,
        35.8 * camera.focal_px / place.distance(camera.center_ecef_m),
    )
}

/// Motion within 40 s, px.
fn moves_px(seen: &dyn Fn(f64) -> PixelBox, along_m: f64, speed_mps: f64) -> f64 {
    let [before, after] = [along_m, along_m - 40.0 * speed_mps].map(seen);
    (after.cx_px - before.cx_px).hypot(after.cy_px - before.cy_px)
}

#[test]
fn every_arrival_within_13_nm_moves_by_more_than_what_stands_still() {
    let mut least_px = [f64::INFINITY; 3];
    for view in VIEWS {
        for miles in [13.0, 12.0, 11.0, 10.0, 8.0] {
            let along_m = miles * MILE_M;
            let flights: [&dyn Fn(f64) -> PixelBox; 3] = [
                &|along_m| straight_at(view, Path::Descending, along_m),
                &|along_m| straight_at(view, Path::Level, along_m),
                &|along_m| seen_from(view, Path::Descending, along_m, 0.0),
            ];
            for (least_px, flight) in least_px.iter_mut().zip(flights) {
                *least_px = least_px.min(moves_px(flight, along_m, SPEEDS_MPS[0]));
            }
        }
    }
    // The figures of `standing`.
    let [descending_px, level_px, centred_px] = least_px;
    assert!((1.7..2.2).contains(&descending_px), "{descending_px}");
    assert!((33.0..38.0).contains(&level_px), "{level_px}");
    assert!((12.0..15.0).contains(&centred_px), "{centred_px}");
}

#[test]
fn a_far_arrival_straight_at_a_mast_is_an_aircraft_at_any_picture_rate() {
    for period_s in PERIODS_S {
        for (view, seed) in VIEWS.into_iter().zip([7, 31]) {
            for path in [Path::Descending, Path::Level] {
                for speed_mps in SPEEDS_MPS {
                    let way_m = 3.0 * MILE_M;
                    let pictures: Vec<_> = (0..(way_m / speed_mps / period_s) as u32)
                        .map(|step| {
                            let along_m = 13.0 * MILE_M - speed_mps * period_s * f64::from(step);
                            vec![shaken(straight_at(view, path, along_m), seed, step)]
                        })
                        .collect();
                    let (tracks, counts) = track(period_s, &pictures);
                    let case = format!("{view} {path:?} {speed_mps} m/s, every {period_s} s");
                    assert!(tracks.iter().all(|tracks| *tracks == [0]), "{case}");
                    assert_eq!(counts, [true], "{case}");
                }
            }
        }
    }
}

/// A lamp in the rain, with boxes of varying and growing size.
fn lamp(seconds: f64, step: u32) -> PixelBox {
    let flickering = 1.0 + 0.4 * jitter(9, seconds as u32 / 3);
    let length_px = (18.0 + 0.08 * seconds) * flickering;
    let exact = at(352.0, 961.0, length_px);
    shaken(exact, 3, step)
}

#[test]
fn a_lamp_whose_width_flickers_stands_still_by_its_place_at_any_picture_rate() {
    for period_s in PERIODS_S {
        let pictures: Vec<_> = (0..(240.0 / period_s) as u32)
            .map(|step| vec![lamp(f64::from(step) * period_s, step)])
            .collect();
        let (_, counts) = track(period_s, &pictures);
        assert!(!counts.contains(&true), "every {period_s} s: {counts:?}");
    }
}

#[test]
fn the_edge_of_a_cloud_at_four_places_in_turn_is_no_aircraft_at_any_picture_rate() {
    const DWELL_S: f64 = 75.0;
    for period_s in PERIODS_S {
        let pictures: Vec<_> = (0..(4.0 * DWELL_S / period_s) as u32)
            .map(|step| {
                let place = (f64::from(step) * period_s / DWELL_S).floor();
                vec![shaken(at(700.0 + 11.0 * place, 300.0, 60.0), 5, step)]
            })
            .collect();
        let (_, counts) = track(period_s, &pictures);
        assert_eq!(counts, [false; 4], "every {period_s} s");
    }
}

#[test]
fn a_track_that_goes_from_one_lamp_to_the_next_and_stays_there_is_no_aircraft() {
    let pictures: Vec<_> = (0..90)
        .map(|step| {
            let x_px = if step < 3 { 214.0 } else { 254.0 };
            let length_px = 22.0 + f64::from(step) / 10.0;
            vec![shaken(at(x_px, 1_008.0, length_px), 2, step)]
        })
        .collect();
    let (_, counts) = track(2.0, &pictures);
    assert!(!counts.contains(&true), "{counts:?}");
}

#[test]
fn a_track_that_goes_along_a_row_of_lamps_is_no_aircraft() {
    let lamps_px = [331.0, 275.0, 214.0, 147.0, 78.0];
    let going = |step: usize| at(lamps_px[step] + 0.3, 1_008.0, 20.0);
    let pictures: Vec<_> = (0..60)
        .map(|step: u32| {
            // Each lamp is clear for 40 seconds, twice; then a box goes along the row.
            let lamp = |at_px: f64, seed| shaken(at(at_px, 1_008.0, 20.0), seed, step);
            match step {
                0..20 => vec![lamp(331.0, 1), lamp(214.0, 2), lamp(78.0, 3)],
                20..40 => vec![lamp(275.0, 4), lamp(147.0, 5)],
                50..55 => vec![going(step as usize - 50)],
                _ => Vec::new(),
            }
        })
        .collect();
    let twice = [&pictures[..40], &pictures[..]].concat();
    let (_, counts) = track(2.0, &twice);
    assert!(!counts.contains(&true), "{counts:?}");
}

#[test]
fn a_box_off_its_place_does_not_end_the_track_of_a_far_arrival() {
    let pictures: Vec<_> = (0..90)
        .map(|step| {
            let along_m = 13.0 * MILE_M - 70.0 * f64::from(step);
            let mut seen = shaken(straight_at(VIEWS[0], Path::Descending, along_m), 1, step);
            seen.cx_px += if step == 40 { 5.0 } else { 0.0 };
            vec![seen]
        })
        .collect();
    let (tracks, counts) = track(1.0, &pictures);
    assert_eq!((&tracks[39], &tracks[41]), (&vec![0], &vec![0]));
    assert!(counts[0], "{counts:?}");
}
