//! Draws the stand-in's pictures for the eye, and prints what a frame costs.
//!
//! `cargo run --release -p mock-xplane --example look -- out 1 3 6` writes, for every weather and time of day, the left picture of
//! the wide-baseline rig with the aircraft at 1, 3 and 6 nautical miles before touchdown, and an enlarged crop of the aircraft.

use std::path::PathBuf;
use std::time::Instant;

use dataset::camera::{Camera, CameraPose};
use dataset::conditions::{Clock, CloudKind, CloudLayer, Weather};
use dataset::geodesy::Geodetic;
use dataset::pose::{Controls, Pose};
use dataset::runway::Runway;
use image::RgbImage;
use image::imageops::{self, FilterType};
use mock_xplane::render::Scene;

const WIDTH: u32 = 1920;
const HEIGHT: u32 = 1280;
const NAUTICAL_MILE_M: f64 = 1_852.0;
/// The rig stands at Singapore, eight hours ahead of universal time.
const LOCAL_OFFSET_H: f64 = 8.0;
/// Width of the crop, pixels, and how much it is enlarged.
const CROP: (u32, u32, u32) = (80, 48, 10);

fn main() {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().unwrap_or_else(|| "look".into()));
    let distances: Vec<f64> = arguments
        .map(|text| {
            text.parse()
                .expect("distances are numbers of nautical miles")
        })
        .collect();
    let distances = if distances.is_empty() {
        vec![1.0, 3.0, 6.0]
    } else {
        distances
    };
    std::fs::create_dir_all(&folder).expect("the folder for pictures can be made");

    let runway = changi_02l();
    let camera = left_camera(&runway);
    for (name, weather) in weathers() {
        for hour in [6.0, 12.0, 18.0] {
            let zulu_time_s = ((hour - LOCAL_OFFSET_H) * 3600.0_f64).rem_euclid(86_400.0);
            let started = Instant::now();
            let scene = Scene::new(
                &camera,
                &runway,
                &weather,
                &Clock {
                    day_of_year: 80,
                    zulu_time_s,
                },
            );
            let prepared = started.elapsed();
            for &distance_nm in &distances {
                let mut rgb = vec![0; (WIDTH * HEIGHT * 3) as usize];
                let pose = on_glide_path(&runway, distance_nm * NAUTICAL_MILE_M);
                let controls = Controls {
                    flap_ratio: 0.75,
                    gear_ratio: f64::from(distance_nm < 7.0),
                };
                scene.render(&pose, &controls, 0.4, &mut rgb);
                let picture = RgbImage::from_raw(WIDTH, HEIGHT, rgb)
                    .expect("the buffer has the picture's size");
                let pixel = camera
                    .project(pose.position().to_ecef())
                    .expect("the aircraft is ahead of the camera");
                let stem = format!("{name}-{hour:02.0}h-{distance_nm}nm");
                save(&picture, folder.join(format!("{stem}.png")));
                save(
                    &enlarged(&picture, pixel.x, pixel.y),
                    folder.join(format!("{stem}-crop.png")),
                );
            }
            println!(
                "{name:8} {hour:2.0}h  scene {:5.0} ms  frame {:5.2} ms CPU",
                prepared.as_secs_f64() * 1e3,
                cpu_ms_per_frame(&scene, &runway)
            );
        }
    }
}

fn save(picture: &RgbImage, path: PathBuf) {
    picture
        .save(&path)
        .unwrap_or_else(|error| panic!("cannot write {}: {error}", path.display()));
}

/// The surroundings of a pixel, every pixel a square of ten.
fn enlarged(picture: &RgbImage, x: f64, y: f64) -> RgbImage {
    let (width, height, zoom) = CROP;
    let left = (x as u32).saturating_sub(width / 2).min(WIDTH - width);
    let top = (y as u32).saturating_sub(height / 2).min(HEIGHT - height);
    let crop = imageops::crop_imm(picture, left, top, width, height).to_image();
    imageops::resize(&crop, width * zoom, height * zoom, FilterType::Nearest)
}

/// Mean CPU time of all threads over a stretch of an approach at 30 frames a second, where the system can tell.
fn cpu_ms_per_frame(scene: &Scene, runway: &Runway) -> f64 {
    const FRAMES: u32 = 90;
    let mut rgb = vec![0; (WIDTH * HEIGHT * 3) as usize];
    let before = process_cpu_ms();
    for frame in 0..FRAMES {
        let time_s = 1.0 + f64::from(frame) / 30.0;
        let pose = on_glide_path(runway, 11_112.0 - 72.0 * time_s);
        scene.render(
            &pose,
            &Controls {
                flap_ratio: 0.75,
                gear_ratio: 1.0,
            },
            time_s,
            &mut rgb,
        );
    }
    (process_cpu_ms() - before) / f64::from(FRAMES)
}

/// CPU time of this process so far; wall-clock time where there is no /proc.
fn process_cpu_ms() -> f64 {
    const TICKS_PER_S: f64 = 100.0;
    static START: std::sync::OnceLock<Instant> = std::sync::OnceLock::new();
    let wall_ms = START.get_or_init(Instant::now).elapsed().as_secs_f64() * 1e3;
    let Ok(stat) = std::fs::read_to_string("/proc/self/stat") else {
        return wall_ms;
    };
    // Fields 14 and 15 (utime, stime); the name in parentheses may hold spaces.
    let fields = stat
        .rsplit(") ")
        .next()
        .unwrap_or_default()
        .split(' ')
        .skip(11)
        .take(2);
    fields
        .filter_map(|ticks| ticks.parse::<f64>().ok())
        .sum::<f64>()
        / TICKS_PER_S
        * 1e3
}

fn weathers() -> Vec<(&'static str, Weather)> {
    let base = Weather {
        visibility_m: 40_000.0,
        clouds: vec![],
        rain_ratio: 0.0,
        wind_speed_mps: 3.0,
        wind_from_true_deg: 20.0,
        turbulence_ratio: 0.0,
    };
    let layer = |kind, cover_ratio, base_msl_m, top_msl_m| CloudLayer {
        kind,
        cover_ratio,
        base_msl_m,
        top_msl_m,
    };
    vec![
        ("clear", base.clone()),
        (
            "cloudy",
            Weather {
                visibility_m: 25_000.0,
                clouds: vec![layer(CloudKind::Cumulus, 0.6, 900.0, 2_000.0)],
                wind_speed_mps: 6.0,
                ..base.clone()
            },
        ),
        (
            "stormy",
            Weather {
                visibility_m: 18_000.0,
                clouds: vec![layer(CloudKind::Cumulonimbus, 0.9, 800.0, 4_000.0)],
                rain_ratio: 0.6,
                wind_speed_mps: 12.0,
                ..base.clone()
            },
        ),
        (
            "foggy",
            Weather {
                visibility_m: 9_260.0,
                clouds: vec![layer(CloudKind::Stratus, 1.0, 600.0, 1_200.0)],
                ..base
            },
        ),
    ]
}

fn changi_02l() -> Runway {
    Runway {
        airport: "WSSS".into(),
        name: "02L".into(),
        threshold: Geodetic {
            latitude_deg: 1.348_971_96,
            longitude_deg: 103.977_501_24,
            altitude_msl_m: 6.71,
        },
        course_true_deg: 23.02,
        glide_path_deg: 3.0,
        touchdown_past_threshold_m: 340.1,
        ils_frequency_mhz: Some(110.9),
        course_magnetic_deg: None,
    }
}

/// The left camera of the wide-baseline rig.
fn left_camera(runway: &Runway) -> Camera {
    let place = runway
        .point_on_approach(-1_500.0, -300.0)
        .at_altitude_m(runway.threshold.altitude_msl_m + 10.0);
    let pose = Pose {
        latitude_deg: place.latitude_deg,
        longitude_deg: place.longitude_deg,
        altitude_msl_m: place.altitude_msl_m,
        // Looking back down the approach from its left side, the axis lies to the left.
        heading_true_deg: runway.course_true_deg + 180.0 - 5.3,
        pitch_deg: 1.6,
        roll_deg: 0.0,
    };
    Camera::from_pose(
        &CameraPose {
            pose,
            hfov_deg: 10.0,
        },
        WIDTH,
        HEIGHT,
    )
}

fn on_glide_path(runway: &Runway, distance_m: f64) -> Pose {
    let at = runway.point_on_approach(distance_m, 0.0);
    Pose {
        latitude_deg: at.latitude_deg,
        longitude_deg: at.longitude_deg,
        altitude_msl_m: runway.threshold.altitude_msl_m
            + airframe::WHEEL_HEIGHT_BELOW_CG_M
            + distance_m * runway.glide_path_deg.to_radians().tan(),
        heading_true_deg: runway.course_true_deg,
        pitch_deg: 2.5,
        roll_deg: 0.0,
    }
}
