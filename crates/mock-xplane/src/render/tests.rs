//! Invariants of every image: positions, contrasts, sub-pixel centres and bytes.

use dataset::conditions::{CloudKind, CloudLayer};
use dataset::geometry::camera::CameraPose;
use dataset::geometry::distortion::Distortion;
use dataset::geometry::imaging::{Degradation, Imaging, Seeing, Sensor, Sway};
pub(crate) use dataset::numbers::units::METERS_PER_NAUTICAL_MILE as NM_M;
pub(crate) use testkit::changi_02l;
use testkit::scenario::calm;

use super::*;

/// Focal length of 1920 pixels over ten degrees.
const FOCAL_PX: f64 = 10_972.8;
const SINGAPORE_S: f64 = 8.0 * 3600.0;

pub(crate) fn clear() -> Weather {
    calm(40_000.0)
}

pub(crate) fn clock_at_local(hours: f64) -> Clock {
    Clock {
        day_of_year: 80,
        zulu_time_s: (hours * 3600.0 - SINGAPORE_S).rem_euclid(86_400.0),
    }
}

/// A camera 1.5 km beyond touchdown and 300 m left of the axis, `width_px` wide at the scale of the wide baseline rig, that looks
/// at a point on the glide path.
fn camera_towards(distance_m: f64, width_px: u32, height_px: u32) -> Camera {
    let runway = changi_02l();
    let place = runway
        .point_on_approach(-1_500.0, -300.0)
        .at_altitude_m(16.71);
    let aim = on_glide_path(distance_m, 0.0).position();
    let ned = place.ecef_from_ned().transpose() * (aim.to_ecef() - place.to_ecef());
    let pose = Pose {
        latitude_deg: place.latitude_deg,
        longitude_deg: place.longitude_deg,
        altitude_msl_m: place.altitude_msl_m,
        heading_true_deg: ned.y.atan2(ned.x).to_degrees(),
        pitch_deg: (-ned.z).atan2(ned.x.hypot(ned.y)).to_degrees(),
        roll_deg: 0.0,
    };
    let hfov_deg = 2.0 * (f64::from(width_px) / 2.0 / FOCAL_PX).atan().to_degrees();
    Camera::from_pose(&CameraPose { pose, hfov_deg }, width_px, height_px)
}

pub(crate) fn small_camera(distance_m: f64) -> Camera {
    camera_towards(distance_m.max(NM_M), 320, 192)
}

fn on_glide_path(distance_m: f64, right_m: f64) -> Pose {
    let runway = changi_02l();
    let at = runway.point_on_approach(distance_m, right_m);
    Pose {
        latitude_deg: at.latitude_deg,
        longitude_deg: at.longitude_deg,
        altitude_msl_m: 6.71 + 3.2 + distance_m * 3.0_f64.to_radians().tan(),
        heading_true_deg: runway.course_true_deg,
        pitch_deg: 2.0,
        roll_deg: 0.0,
    }
}

/// A pose on the optical axis, flying towards the camera.
fn on_central_ray(scene: &Scene, range_m: f64) -> Pose {
    let camera = &scene.world.view.camera;
    let at = Geodetic::from_ecef(camera.center_ecef_m + camera.ray(camera.principal_px) * range_m);
    Pose {
        latitude_deg: at.latitude_deg,
        longitude_deg: at.longitude_deg,
        altitude_msl_m: at.altitude_msl_m,
        ..on_glide_path(range_m, 0.0)
    }
}

const LANDING: Controls = Controls {
    flap_ratio: 0.75,
    gear_ratio: 1.0,
};

pub(crate) fn scene(distance_m: f64, weather: &Weather) -> Scene {
    Scene::new(
        &small_camera(distance_m),
        &changi_02l(),
        weather,
        &clock_at_local(12.0),
    )
}

/// Difference between the canvas with the airframe alone and the backdrop, per pixel, relative to the backdrop (contrast).
fn contrast(scene: &Scene, pose: &Pose) -> Vec<(DVec2, f64)> {
    let placed = Placed::new(&scene.world.view, pose, &LANDING);
    let clouds = CloudsBefore::new(&scene.world, &placed, 0.0);
    let patch = scene.draw_airframe(scene.aircraft, &placed, None);
    let sky = &scene.backdrop.still_sky();
    let canvas = scene
        .composite(
            patch.as_ref(),
            &[],
            &clouds,
            |x, y| scene.backdrop.light(sky, x, y),
            None,
        )
        .expect("the aircraft is in the image");
    canvas
        .light
        .iter()
        .enumerate()
        .filter(|(i, _)| canvas.touched[*i])
        .map(|(i, light)| {
            let (x, y) = (canvas.x + i % canvas.width, canvas.y + i / canvas.width);
            let behind = scene.backdrop.light(sky, x, y);
            (
                DVec2::new(x as f64, y as f64),
                f64::from((light.y - behind.y) / behind.y),
            )
        })
        .collect()
}

/// First and last columns and rows whose bytes change when the aircraft is there.
fn changed_box(scene: &Scene, pose: &Pose, controls: &Controls) -> [f64; 4] {
    let (width, height) = scene.size();
    let far_away = Pose {
        latitude_deg: 40.0,
        ..*pose
    };
    let draw = |pose: &Pose| {
        let mut rgb = vec![0; width * height * 3];
        // Lamps bloom over the tips.
        scene.draw_frame((pose, controls), &[], Instants::all(0.3), false, &mut rgb);
        rgb
    };
    let (with, without) = (draw(pose), draw(&far_away));
    let mut found = [
        f64::INFINITY,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::NEG_INFINITY,
    ];
    for (i, (a, b)) in with.chunks(3).zip(without.chunks(3)).enumerate() {
        if a != b {
            let (x, y) = ((i % width) as f64, (i / width) as f64);
            found = [
                found[0].min(x),
                found[1].min(y),
                found[2].max(x),
                found[3].max(y),
            ];
        }
    }
    found
}

/// Projected bounds of the mesh by the camera model that the labels use.
fn projected_box(camera: &Camera, pose: &Pose, controls: &Controls) -> [f64; 4] {
    let mesh = airframe::boeing_737_800(airframe::Configuration {
        flap_ratio: controls.flap_ratio,
        gear_ratio: controls.gear_ratio,
    });
    mesh.vertices
        .iter()
        .map(|&vertex| camera.project(pose.body_point_to_ecef(vertex)).unwrap())
        .fold(
            [
                f64::INFINITY,
                f64::INFINITY,
                f64::NEG_INFINITY,
                f64::NEG_INFINITY,
            ],
            |[a, b, c, d], p| [a.min(p.x), b.min(p.y), c.max(p.x), d.max(p.y)],
        )
}

/// A pixel changes when the outline crosses any part of it, so the first changed column is between half a pixel left and half a
/// pixel right of the outline's true end. Over many sub-pixel positions that averages out.
fn mean_offsets(distance_nm: f64) -> [f64; 4] {
    let camera = &small_camera(distance_nm * NM_M);
    // Air without haze: this is about geometry, and a distant winglet in haze does not change a byte.
    let weather = Weather {
        visibility_m: 1e6,
        ..clear()
    };
    let scene = Scene::new(camera, &changi_02l(), &weather, &clock_at_local(12.0));
    const STEPS: u32 = 16;
    let mut mean = [0.0; 4];
    for step in 0..STEPS {
        let pixel_m = (distance_nm * NM_M + 1_500.0) / FOCAL_PX;
        let part = (f64::from(step) + 0.5) / f64::from(STEPS);
        let mut pose = on_glide_path(distance_nm * NM_M, part * pixel_m);
        pose.altitude_msl_m += part * pixel_m;
        let found = changed_box(&scene, &pose, &LANDING);
        let expected = projected_box(camera, &pose, &LANDING);
        for (mean, (found, expected)) in mean.iter_mut().zip(found.into_iter().zip(expected)) {
            *mean += (found - expected) / f64::from(STEPS);
        }
    }
    mean
}

#[test]
fn wing_tips_fin_and_belly_are_drawn_where_the_camera_model_projects_them() {
    for distance_nm in [1.0, 3.0, 6.0, 9.0] {
        let offsets = mean_offsets(distance_nm);
        assert!(
            offsets.iter().all(|offset| offset.abs() < 0.3),
            "{offsets:?} at {distance_nm} NM"
        );
    }
}

#[test]
fn contrast_falls_with_distance_as_koschmieder_says() {
    for visibility_m in [5_000.0, 10_000.0, 20_000.0, 40_000.0] {
        let weather = Weather {
            visibility_m,
            ..clear()
        };
        let scene = scene(6.0 * NM_M, &weather);
        // Along one ray and in one attitude towards it, only size and air change: the contrast summed over pixels, times the
        // distance squared, falls by the air alone.
        let intrinsic = |distance_nm: f64| {
            let range_m = distance_nm * NM_M;
            let pose = on_central_ray(&scene, range_m);
            let sum: f64 = contrast(&scene, &pose).iter().map(|(_, c)| c).sum();
            (sum * range_m * range_m, range_m)
        };
        let (near, near_m) = intrinsic(1.0);
        for distance_nm in 2..=10 {
            let distance_nm = f64::from(distance_nm);
            let (far, far_m) = intrinsic(distance_nm);
            let expected = (-3.912 / visibility_m * (far_m - near_m)).exp();
            if expected > 2e-3 {
                let ratio = far / near / expected;
                assert!(
                    (ratio - 1.0).abs() < 0.05,
                    "{ratio} of the formula at {distance_nm} NM, visibility {visibility_m} m"
                );
            }
        }
    }
}

/// Largest contrast of the airframe against the sky behind it.
fn strongest_contrast(scene: &Scene, pose: &Pose) -> f64 {
    contrast(scene, pose)
        .iter()
        .map(|(_, contrast)| contrast.abs())
        .fold(0.0, f64::max)
}

#[test]
fn fog_takes_the_airframe_where_the_formula_says() {
    let weather = Weather {
        visibility_m: 5.0 * NM_M,
        ..clear()
    };
    let scene = scene(6.0 * NM_M, &weather);
    // From three miles on, where the darkest parts fill pixels as they do farther away, the contrast falls by the air alone ...
    let near_m = 3.0 * NM_M;
    let near = strongest_contrast(&scene, &on_central_ray(&scene, near_m));
    // ... until it is less than one grey level of the sky on the central ray.
    let sky = &scene.backdrop.still_sky();
    let middle = scene.world.view.camera.principal_px;
    let behind = scene
        .backdrop
        .light(sky, middle.x as usize, middle.y as usize);
    let levels_per_contrast = f64::from(
        (imaging::tone::encode(behind) - imaging::tone::encode(behind * 0.99)).max_element(),
    ) / 0.01;
    let beta_per_m = 3.912 / weather.visibility_m;
    let lost_m = near_m + (near * levels_per_contrast).ln() / beta_per_m;
    assert!((9_000.0..16_000.0).contains(&lost_m), "{lost_m}");

    let largest_change = |range_m: f64| {
        let draw = |pose: &Pose| {
            let (width, height) = scene.size();
            let mut rgb = vec![0; width * height * 3];
            scene.draw_frame((pose, &LANDING), &[], Instants::all(0.0), false, &mut rgb);
            rgb
        };
        let pose = on_central_ray(&scene, range_m);
        let elsewhere = Pose {
            latitude_deg: pose.latitude_deg + 1.0,
            ..pose
        };
        let differences = draw(&pose).into_iter().zip(draw(&elsewhere));
        differences
            .map(|(with, without)| with.abs_diff(without))
            .max()
            .unwrap()
    };
    // Rounding may turn less than one level into one, never into two.
    assert!(largest_change(0.7 * lost_m) >= 2, "lost before {lost_m} m");
    assert!(largest_change(1.1 * lost_m) <= 1, "seen beyond {lost_m} m");
}

/// Centre of the patch's covered area, pixels.
fn covered_centre(patch: &Patch) -> DVec2 {
    let (sum, moment) =
        patch
            .coverage
            .iter()
            .enumerate()
            .fold((0.0, DVec2::ZERO), |(sum, moment), (i, &share)| {
                let pixel = DVec2::new(
                    (patch.x + i % patch.width) as f64,
                    (patch.y + i / patch.width) as f64,
                );
                (sum + f64::from(share), moment + pixel * f64::from(share))
            });
    moment / sum
}

#[test]
fn an_aircraft_moved_by_a_quarter_of_a_pixel_moves_its_centre_by_a_quarter_of_a_pixel() {
    for distance_nm in [3.0, 6.0, 10.0] {
        let scene = scene(distance_nm * NM_M, &clear());
        let centre = |right_m: f64| {
            let pose = on_glide_path(distance_nm * NM_M, right_m);
            let placed = Placed::new(&scene.world.view, &pose, &LANDING);
            let patch = scene.draw_airframe(scene.aircraft, &placed, None).unwrap();
            (
                covered_centre(&patch),
                scene
                    .world
                    .view
                    .camera
                    .project(pose.position().to_ecef())
                    .unwrap(),
            )
        };
        let pixel_m = (distance_nm * NM_M + 1_500.0) / FOCAL_PX;
        let (start, start_true) = centre(0.0);
        for quarter in 1..=4 {
            let (found, found_true) = centre(0.25 * f64::from(quarter) * pixel_m);
            let error = (found - start) - (found_true - start_true);
            assert!(
                error.abs().max_element() < 0.05,
                "{error} after {quarter} quarters at {distance_nm} NM"
            );
        }
    }
}

pub(crate) fn overcast() -> Weather {
    Weather {
        clouds: vec![CloudLayer {
            kind: CloudKind::Cumulus,
            cover_ratio: 0.6,
            base_msl_m: 900.0,
            top_msl_m: 2_000.0,
        }],
        visibility_m: 25_000.0,
        rain_ratio: 0.4,
        wind_speed_mps: 6.0,
        wind_from_true_deg: 340.0,
        turbulence_ratio: 0.0,
    }
}

/// All effects enabled.
fn all_effects() -> Imaging {
    Imaging {
        distortion: Some(Distortion {
            k1: -100.0,
            ..Distortion::default()
        }),
        refraction_coefficient: 0.13,
        degradation: Some(Degradation {
            blur_sigma_px: 0.9,
            sensor: Some(Sensor {
                full_well_electrons: 8_000.0,
                read_noise_electrons: 6.0,
                exposure_ev: 0.3,
            }),
            seeing: Some(Seeing {
                tilt_rms_arcsec: 12.0,
                blur_sigma_arcsec: 6.0,
                correlation_s: Some(0.05),
                crosswind: None,
            }),
            sway: Some(Sway {
                rms_px: 1.5,
                frequency_hz: 0.8,
            }),
            stream: None,
            seed: 77,
        }),
    }
}

fn imaged_scene(distance_m: f64, weather: &Weather, imaging: &Imaging) -> Scene {
    let camera = small_camera(distance_m).seen_through(imaging);
    let scene = Scene::new(&camera, &changi_02l(), weather, &clock_at_local(12.0));
    match &imaging.degradation {
        None => scene,
        Some(degradation) => scene.degraded(degradation),
    }
}

#[test]
fn the_same_inputs_give_the_same_bytes_whatever_the_number_of_threads() {
    for imaging in [Imaging::default(), all_effects()] {
        let draw = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| {
                let scene = imaged_scene(4.0 * NM_M, &overcast(), &imaging);
                let mut rgb = vec![0; 320 * 192 * 3];
                scene.render(&on_glide_path(4.0 * NM_M, 0.0), &LANDING, 12.34, &mut rgb);
                rgb
            })
        };
        let one = draw(1);
        assert!(
            one == draw(2) && one == draw(5),
            "images differ between thread counts with {imaging:?}"
        );
    }
}

#[test]
fn effects_that_are_off_change_no_byte_and_each_one_that_is_on_does() {
    let draw = |imaging: &Imaging| {
        let scene = imaged_scene(4.0 * NM_M, &overcast(), imaging);
        let mut rgb = vec![0; 320 * 192 * 3];
        scene.render(&on_glide_path(4.0 * NM_M, 0.0), &LANDING, 12.34, &mut rgb);
        rgb
    };
    let ideal = draw(&Imaging::default());
    let off = Imaging {
        distortion: Some(Distortion::default()),
        degradation: Some(Degradation::default()),
        ..Imaging::default()
    };
    // A lens without coefficients is a pinhole to within rounding.
    let differing = draw(&off)
        .iter()
        .zip(&ideal)
        .filter(|(a, b)| a.abs_diff(**b) > 1)
        .count();
    assert_eq!(differing, 0);
    let unspoiled = Imaging {
        degradation: Some(Degradation::default()),
        ..Imaging::default()
    };
    assert!(draw(&unspoiled) == ideal);
    let all = all_effects();
    let degradation = all.degradation.unwrap();
    let only = |change: &dyn Fn(&mut Degradation)| {
        let mut only = Degradation::default();
        change(&mut only);
        Imaging {
            degradation: Some(only),
            ..Imaging::default()
        }
    };
    for imaging in [
        Imaging {
            distortion: all.distortion,
            ..Imaging::default()
        },
        Imaging {
            refraction_coefficient: 0.13,
            ..Imaging::default()
        },
        only(&|d| d.blur_sigma_px = degradation.blur_sigma_px),
        only(&|d| d.sensor = degradation.sensor),
        only(&|d| d.seeing = degradation.seeing),
        only(&|d| d.sway = degradation.sway),
    ] {
        assert!(draw(&imaging) != ideal, "{imaging:?} changes nothing");
    }
}

/// Sum, centre and variance along the columns of the airframe's change to an image's linear light.
fn moments(scene: &Scene, pose: &Pose, time_s: f64) -> (f64, DVec2, f64) {
    let placed = Placed::new(&scene.world.view, pose, &LANDING);
    let clouds = CloudsBefore::new(&scene.world, &placed, time_s);
    let shift_px = scene.spoiled.shift_px(placed.distance_m(), time_s);
    let patch = scene.draw_airframe(scene.aircraft, &placed, shift_px);
    let blur = scene.spoiled.blur(placed.distance_m());
    let sky = &scene.backdrop.still_sky();
    let canvas = scene
        .composite(
            patch.as_ref(),
            &[],
            &clouds,
            |x, y| scene.backdrop.light(sky, x, y),
            blur.as_ref(),
        )
        .expect("the aircraft is in the image");
    let changes: Vec<(DVec2, f64)> = (0..canvas.light.len())
        .filter(|&i| canvas.touched[i])
        .map(|i| {
            let (x, y) = (canvas.x + i % canvas.width, canvas.y + i / canvas.width);
            let change = canvas.light[i] - scene.backdrop.light(sky, x, y);
            (DVec2::new(x as f64, y as f64), f64::from(change.y))
        })
        .collect();
    let sum: f64 = changes.iter().map(|(_, c)| c).sum();
    let centre = changes.iter().map(|(at, c)| *at * *c).sum::<DVec2>() / sum;
    let variance = changes
        .iter()
        .map(|(at, c)| (at.x - centre.x).powi(2) * c)
        .sum::<f64>()
        / sum;
    (sum, centre, variance)
}

#[test]
fn blur_keeps_an_aircrafts_light_and_centre_and_adds_its_variance() {
    let distance_m = 6.0 * NM_M;
    let sharp = imaged_scene(distance_m, &clear(), &Imaging::default());
    let pose = on_glide_path(distance_m, 0.0);
    let (sum, centre, variance) = moments(&sharp, &pose, 0.0);
    for sigma_px in [0.4, 0.8, 2.0] {
        let degradation = Degradation {
            blur_sigma_px: sigma_px,
            ..Degradation::default()
        };
        let imaging = Imaging {
            degradation: Some(degradation),
            ..Imaging::default()
        };
        let blurred = imaged_scene(distance_m, &clear(), &imaging);
        let (found_sum, found_centre, found_variance) = moments(&blurred, &pose, 0.0);
        assert!((found_sum / sum - 1.0).abs() < 2e-3, "{found_sum} {sum}");
        assert!(
            found_centre.distance(centre) < 0.01,
            "{found_centre} {centre}"
        );
        let added = (found_variance - variance).sqrt();
        assert!(
            (added / sigma_px - 1.0).abs() < 0.03,
            "{added} for {sigma_px}"
        );
    }
}

#[test]
fn seeing_moves_the_aircraft_by_what_the_turbulence_says_and_not_the_backdrop() {
    let distance_m = 6.0 * NM_M;
    let seeing = Seeing {
        tilt_rms_arcsec: 20.0,
        blur_sigma_arcsec: 0.0,
        correlation_s: Some(0.1),
        crosswind: None,
    };
    let imaging = Imaging {
        degradation: Some(Degradation {
            seeing: Some(seeing),
            seed: 3,
            ..Degradation::default()
        }),
        ..Imaging::default()
    };
    let (still, shaken) = (
        imaged_scene(distance_m, &clear(), &Imaging::default()),
        imaged_scene(distance_m, &clear(), &imaging),
    );
    let pose = on_glide_path(distance_m, 0.0);
    let centre_at = |scene: &Scene, time_s: f64| {
        let placed = Placed::new(&scene.world.view, &pose, &LANDING);
        let shift_px = scene.spoiled.shift_px(placed.distance_m(), time_s);
        let patch = scene.draw_airframe(scene.aircraft, &placed, shift_px);
        covered_centre(&patch.unwrap())
    };
    let centre = centre_at(&still, 0.0);
    let range_m = Placed::new(&still.world.view, &pose, &LANDING).distance_m();
    let turbulence = Turbulence::new(&seeing, still.world.view.camera.focal_px, 3);
    let mut farthest: f64 = 0.0;
    for time_s in [0.0, 0.5, 1.0, 7.3] {
        let expected = turbulence.shift_px(range_m, time_s);
        let error = centre_at(&shaken, time_s) - centre - expected;
        assert!(error.abs().max_element() < 0.05, "{error} of {expected}");
        farthest = farthest.max(expected.length());
    }
    assert!(farthest > 0.5, "{farthest}");
    let far_away = Pose {
        latitude_deg: 40.0,
        ..pose
    };
    let draw = |time_s: f64| {
        let mut rgb = vec![0; 320 * 192 * 3];
        shaken.render(&far_away, &LANDING, time_s, &mut rgb);
        rgb
    };
    assert!(draw(0.0) == draw(0.5), "the backdrop moves");
}

#[test]
fn the_order_in_which_frames_are_asked_for_does_not_matter() {
    let scene = scene(4.0 * NM_M, &overcast());
    let draw = |time_s: f64| {
        let mut rgb = vec![0; 320 * 192 * 3];
        scene.render(&on_glide_path(4.0 * NM_M, 0.0), &LANDING, time_s, &mut rgb);
        rgb
    };
    let first = draw(3.0);
    // From the second image of an instant on its rows are cached, from the third on they are copied.
    for _ in 0..3 {
        assert!(
            first == draw(3.0),
            "kept rows are not those that were drawn"
        );
    }
    for time_s in [400.0, 0.0, 77.7, 1_000.0, 5.0, 50.0, 60.0] {
        draw(time_s);
    }
    assert!(
        first == draw(3.0),
        "a frame changed after others were drawn"
    );
    assert!(first != draw(40.0), "clouds stand still");
}

#[test]
fn a_closed_layer_hides_an_aircraft_above_it_and_not_one_below() {
    let weather = Weather {
        clouds: vec![CloudLayer {
            kind: CloudKind::Stratus,
            cover_ratio: 1.0,
            base_msl_m: 400.0,
            top_msl_m: 900.0,
        }],
        ..clear()
    };
    let seen = |distance_m: f64| {
        let scene = scene(distance_m, &weather);
        let sum: f64 = contrast(&scene, &on_glide_path(distance_m, 0.0))
            .iter()
            .map(|(_, c)| c.abs())
            .sum();
        sum
    };
    assert!(seen(6_000.0) > 5.0, "below the base: {}", seen(6_000.0));
    // The remainder, far below a grey level, is the grid of the sky against the cloud in front of the aircraft.
    assert!(seen(14_000.0) < 0.2, "inside the layer: {}", seen(14_000.0));
}

#[test]
fn lamps_do_not_shine_through_a_closed_layer_in_poor_visibility() {
    let weather = Weather {
        clouds: vec![CloudLayer {
            kind: CloudKind::Stratus,
            cover_ratio: 1.0,
            base_msl_m: 500.0,
            top_msl_m: 1_200.0,
        }],
        visibility_m: 9_260.0,
        ..clear()
    };
    let range_m = 9.0 * NM_M;
    let scene = Scene::new(
        &small_camera(range_m),
        &changi_02l(),
        &weather,
        &clock_at_local(6.0),
    );
    let pose = on_glide_path(range_m, 0.0);
    let placed = Placed::new(&scene.world.view, &pose, &LANDING);
    let clouds = CloudsBefore::new(&scene.world, &placed, 0.0);
    let brightest = scene
        .visible_lamps(scene.aircraft, &placed, &clouds, 0.3)
        .iter()
        .map(|spot| spot.energy.max_element())
        .fold(0.0, f32::max);
    assert!(
        brightest < 1e-3,
        "{brightest} of exposed light comes through"
    );
}

#[test]
fn landing_lights_are_brighter_than_the_twilight_around_them() {
    let scene = Scene::new(
        &small_camera(6.0 * NM_M),
        &changi_02l(),
        &clear(),
        &clock_at_local(6.0),
    );
    let mut rgb = vec![0; 320 * 192 * 3];
    scene.render(&on_glide_path(6.0 * NM_M, 0.0), &LANDING, 0.3, &mut rgb);
    let brightest = rgb.iter().max().unwrap();
    let corner = rgb[0];
    assert!(
        *brightest > 240 && corner < 130,
        "brightest {brightest}, sky {corner}"
    );
}

#[test]
fn a_nearer_aircraft_hides_a_farther_one_whichever_is_the_first_and_both_are_drawn_beside_each_other()
 {
    let scene = scene(2.0 * NM_M, &clear());
    let small = AircraftType::named("C750").unwrap();
    let drawn = |first: &Pose, others: &[(&'static AircraftType, &Pose, &Controls)]| {
        let (width, height) = scene.size();
        let mut rgb = vec![0; width * height * 3];
        let instants = Instants::all(0.3);
        scene.draw_frame((first, &LANDING), others, instants, false, &mut rgb);
        rgb
    };
    let (near, far) = (
        on_central_ray(&scene, 2_000.0),
        on_central_ray(&scene, 12_000.0),
    );
    let alone = drawn(&near, &[]);
    // The business jet is six times as far, behind the middle of the 737's fuselage.
    assert!(drawn(&near, &[(small, &far, &LANDING)]) == alone);

    let aside = on_central_ray(&scene, 4_000.0);
    let beside = scene.world.view.camera.ecef_from_camera * DVec3::new(0.0, -22.0, 0.0);
    let above = Geodetic::from_ecef(aside.position().to_ecef() + beside);
    let aside = aside.moved_to(above);
    let type_of_scene = scene.aircraft;
    let both = drawn(&near, &[(type_of_scene, &aside, &LANDING)]);
    assert!(both == drawn(&aside, &[(type_of_scene, &near, &LANDING)]));
    let changed = |other: &[u8]| both.iter().zip(other).filter(|(a, b)| a != b).count();
    assert!(changed(&alone) > 100 && changed(&drawn(&aside, &[])) > 100);
}
