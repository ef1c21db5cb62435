//! Compares rendered images with a reference that shares no code with the renderer (`tests/judges/render_geometry.py`).

use std::f64::consts::TAU;
use std::fs;
use std::path::Path;
use std::process::Command;

use dataset::conditions::Clock;
use dataset::geometry::camera::{Camera, CameraPose};
use dataset::geometry::distortion::Distortion;
use dataset::geometry::geodesy::Geodetic;
use dataset::geometry::imaging::Imaging;
use dataset::geometry::pose::{Controls, Pose};
use mock_xplane::render::Scene;
use serde_json::{Value, json};
use testkit::changi_02l;
use testkit::scenario::calm;

const WIDTH_PX: u32 = 320;
const HEIGHT_PX: u32 = 192;
/// Focal length of 1920 pixels over ten degrees.
const FOCAL_PX: f64 = 10_972.8;
/// Poses at each distance and from each side, at different fractions of a pixel.
const STEPS: u32 = 16;

const DISTANCES_NM: [f64; 4] = [1.0, 3.0, 6.0, 9.0];
/// Distances for lens and refraction.
const BENT_DISTANCES_NM: [f64; 2] = [3.0, 9.0];

/// A lens that moves the aircraft by pixels, and typical refraction.
fn bent() -> Imaging {
    Imaging {
        distortion: Some(Distortion {
            k1: -250.0,
            k2: 9_000.0,
            p1: 0.4,
            p2: -0.3,
            k3: 100.0,
        }),
        refraction_coefficient: 0.13,
        degradation: None,
    }
}

const LANDING: Controls = Controls {
    flap_ratio: 0.75,
    gear_ratio: 1.0,
};

/// The pose on the glide path, and the left mast's camera, turned until it looks there.
fn placed(distance_m: f64) -> (Pose, CameraPose) {
    let runway = changi_02l();
    let target_msl_m = runway.touchdown_target().altitude_msl_m;
    let at = runway.point_on_approach(distance_m, 0.0).at_altitude_m(
        target_msl_m + airframe::WHEEL_HEIGHT_BELOW_CG_M + distance_m * 3.0_f64.to_radians().tan(),
    );
    let mast = runway
        .point_on_approach(-1_500.0, -300.0)
        .at_altitude_m(target_msl_m + 10.0);
    let ned = mast.ecef_from_ned().transpose() * (at.to_ecef() - mast.to_ecef());
    let bearing_deg = ned.y.atan2(ned.x).to_degrees();
    let pose = |place: Geodetic, heading_true_deg, pitch_deg| Pose {
        latitude_deg: place.latitude_deg,
        longitude_deg: place.longitude_deg,
        altitude_msl_m: place.altitude_msl_m,
        heading_true_deg,
        pitch_deg,
        roll_deg: 0.0,
    };
    let elevation_deg = (-ned.z).atan2(ned.x.hypot(ned.y)).to_degrees();
    let camera = CameraPose {
        pose: pose(mast, bearing_deg, elevation_deg),
        hfov_deg: 2.0 * (f64::from(WIDTH_PX) / 2.0 / FOCAL_PX).atan().to_degrees(),
    };
    (pose(at, bearing_deg + 180.0, 2.0), camera)
}

/// The pose moved by pixel fractions to the side and up.
fn moved(pose: Pose, distance_m: f64, step: u32) -> Pose {
    let pixel_m = (distance_m + 1_500.0) / FOCAL_PX;
    let part = f64::from(step) / f64::from(STEPS);
    // Fractions up have a different order than those to the side.
    let (side_m, up_m) = (part * pixel_m, (part * 7.0).fract() * pixel_m);
    let heading = pose.heading_true_deg.to_radians();
    let metres_per_degree = 6_371_000.0 * TAU / 360.0;
    Pose {
        latitude_deg: pose.latitude_deg - side_m * heading.sin() / metres_per_degree,
        longitude_deg: pose.longitude_deg + side_m * heading.cos() / metres_per_degree,
        altitude_msl_m: pose.altitude_msl_m + up_m,
        ..pose
    }
}

/// Draws all images of the comparison into a folder, with a scenes.json that describes them.
fn draw_scenes(folder: &Path) {
    // Air without haze: this is about geometry, and a distant winglet in haze does not change a byte.
    let weather = calm(1e6);
    let noon = Clock {
        day_of_year: 172,
        zulu_time_s: 4.0 * 3_600.0,
    };
    let mut frames: Vec<Value> = vec![];
    let ideal = DISTANCES_NM.map(|distance_nm| (distance_nm, "", Imaging::default()));
    let bent = BENT_DISTANCES_NM.map(|distance_nm| (distance_nm, ", bent", bent()));
    for (distance_nm, through, imaging) in ideal.into_iter().chain(bent) {
        let distance_m = distance_nm * 1_852.0;
        let (pose, mut camera) = placed(distance_m);
        if !imaging.is_ideal() {
            // Off the centre, where a lens has no effect.
            camera.pose.heading_true_deg += 0.5;
            camera.pose.pitch_deg += 0.2;
        }
        let pinhole = Camera::from_pose(&camera, WIDTH_PX, HEIGHT_PX).seen_through(&imaging);
        let scene = Scene::new(&pinhole, &changi_02l(), &weather, &noon);
        let draw = |name: &str, pose: &Pose| {
            let mut rgb = vec![0; (WIDTH_PX * HEIGHT_PX * 3) as usize];
            scene.render(pose, &LANDING, 0.0, &mut rgb);
            fs::write(folder.join(name), rgb).unwrap();
        };
        let empty = format!("{distance_nm}{through}-empty.rgb");
        let elsewhere = Pose {
            latitude_deg: pose.latitude_deg + 1.0,
            ..pose
        };
        draw(&empty, &elsewhere);
        // Seen by the camera, an aircraft that has turned right from flying towards it flies to the left.
        for (seen_from, turn_deg) in [
            ("ahead", 0.0),
            ("flying left", 90.0),
            ("flying right", -90.0),
        ] {
            for step in 0..STEPS {
                let pose = moved(pose, distance_m, step);
                let pose = Pose {
                    heading_true_deg: pose.heading_true_deg + turn_deg,
                    ..pose
                };
                let picture = format!("{distance_nm}{through}-{seen_from}-{step}.rgb");
                draw(&picture, &pose);
                let camera = json!({
                    "latitude_deg": camera.pose.latitude_deg,
                    "longitude_deg": camera.pose.longitude_deg,
                    "altitude_msl_m": camera.pose.altitude_msl_m,
                    "heading_true_deg": camera.pose.heading_true_deg,
                    "pitch_deg": camera.pose.pitch_deg,
                    "roll_deg": camera.pose.roll_deg,
                    "hfov_deg": camera.hfov_deg,
                    "distortion": imaging.distortion.unwrap_or_default().coefficients(),
                    "refraction_coefficient": imaging.refraction_coefficient,
                });
                frames.push(json!({
                    "distance_nm": distance_nm, "through": through, "seen_from": seen_from, "picture": picture, "empty": empty,
                    "pose": pose, "camera": camera,
                }));
            }
        }
    }
    let scenes = json!({ "width_px": WIDTH_PX, "height_px": HEIGHT_PX, "frames": frames });
    fs::write(folder.join("scenes.json"), scenes.to_string()).unwrap();
}

#[test]
fn wheels_wing_tips_and_nose_lie_where_an_independent_camera_model_puts_them() {
    let repository = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let python = repository.join(".venv/bin/python");
    assert!(
        python.exists(),
        "run `bash scripts/setup.sh` first: {} is missing",
        python.display()
    );
    let folder = tempfile::tempdir().unwrap();
    draw_scenes(folder.path());
    let output = Command::new(python)
        .arg(repository.join("tests/judges/render_geometry.py"))
        .arg(folder.path())
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    println!("{said}");
    assert!(
        output.status.success(),
        "{said}{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let verdict: Value = serde_json::from_str(&said).unwrap();
    let scenes = (DISTANCES_NM.len() + BENT_DISTANCES_NM.len()) as u32;
    assert_eq!(verdict["frames"], scenes * 3 * STEPS);
}
