//! Draws a sweep's weathers and times for visual inspection, without a simulator, and prints the cost of a frame.
//!
//! `cargo run --release -p dtd-generator --example look -- scenarios.toml OUT [NM ...]` writes, for every weather and time of the
//! sweep and every distance (6 NM if none is given), the image of the rig's first camera with an enlarged crop of the aircraft
//! as OUT/<weather>-<time>-<NM>nm.png and ...-crop.png, and all of a distance side by side as OUT/sheet-<NM>nm.jpg: a row for
//! each weather, a column for each time, the crop in the upper left corner.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::time::Instant;

use dataset::geometry::pose::{Controls, Pose};
use dataset::geometry::runway::Runway;
use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;
use dataset::plan::{Common, Parameters};
use generator::plan::expand;
use generator::sweep::Sweep;
use image::imageops::{self, FilterType};
use image::{Rgb, RgbImage};
use mock_xplane::render::Scene;
use testkit::processor_time;

/// Size of the crop, pixels, and how much it is enlarged.
const CROP: (u32, u32, u32) = (80, 48, 10);
/// Widths of images and crops in the sheet, pixels.
const SHEET: (u32, u32) = (640, 256);
const USAGE: &str = "usage: look SWEEP.toml OUT [NM ...]";

fn main() {
    let mut arguments = std::env::args().skip(1);
    let sweep = PathBuf::from(arguments.next().expect(USAGE));
    let folder = PathBuf::from(arguments.next().expect(USAGE));
    let mut distances_nm: Vec<f64> = arguments.map(|text| text.parse().expect(USAGE)).collect();
    if distances_nm.is_empty() {
        distances_nm.push(6.0);
    }
    std::fs::create_dir_all(&folder).expect("the folder for images can be made");

    let sweep = Sweep::read(&sweep).unwrap_or_else(|error| panic!("{error}"));
    let mut kinds: BTreeMap<(String, String), Parameters> = BTreeMap::new();
    let plan = expand(&sweep);
    for scenario in plan.scenarios {
        kinds
            .entry((scenario.weather, scenario.time_of_day))
            .or_insert(scenario.parameters);
    }
    let times: BTreeSet<&String> = kinds.keys().map(|(_, time)| time).collect();
    for distance_nm in distances_nm {
        let mut cells = Vec::new();
        for ((weather, time), parameters) in &kinds {
            let name = format!("{weather}-{}-{distance_nm}nm", time.replace(':', ""));
            let (picture, crop) = look(&name, &plan.common, parameters, distance_nm);
            save(&picture, &folder.join(format!("{name}.png")));
            save(&crop, &folder.join(format!("{name}-crop.png")));
            cells.push(cell(&picture, &crop));
        }
        let sheet = sheet(&cells, times.len() as u32);
        save(&sheet, &folder.join(format!("sheet-{distance_nm}nm.jpg")));
    }
}

/// Draws an image and its crop.
fn look(
    name: &str,
    common: &Common,
    parameters: &Parameters,
    distance_nm: f64,
) -> (RgbImage, RgbImage) {
    let (width, height) = (common.picture.width_px, common.picture.height_px);
    let conditions = &parameters.conditions;
    let (_, calibrated) = &parameters.cameras(common)[0];
    let camera = calibrated.camera();
    let started = Instant::now();
    let scene = Scene::new(
        &camera,
        &common.runway,
        &conditions.weather,
        &conditions.clock,
    );
    let scene = match &calibrated.degradation {
        None => scene,
        Some(degradation) => scene.degraded(degradation),
    };
    let prepared_ms = started.elapsed().as_secs_f64() * 1e3;
    let pose = on_glide_path(&common.runway, distance_nm * METERS_PER_NAUTICAL_MILE);
    let controls = Controls {
        flap_ratio: 0.75,
        gear_ratio: f64::from(distance_nm < 7.0),
    };
    let mut rgb = vec![0; (width * height * 3) as usize];
    scene.render(&pose, &controls, 0.4, &mut rgb);
    let picture = RgbImage::from_raw(width, height, rgb).expect("the buffer has the image's size");
    let pixel = camera
        .project(pose.position().to_ecef())
        .expect("the aircraft is ahead of the camera");
    let crop = enlarged(&picture, pixel.x, pixel.y);
    println!(
        "{name:24} scene {prepared_ms:5.0} ms  frame {:5.2} ms CPU",
        cpu_ms_per_frame(&scene, &common.runway, (width, height))
    );
    (picture, crop)
}

/// An image of the sheet with its crop in the corner.
fn cell(picture: &RgbImage, crop: &RgbImage) -> RgbImage {
    let (width, crop_width) = SHEET;
    let scaled = |picture: &RgbImage, width: u32| {
        let height = picture.height() * width / picture.width();
        imageops::resize(picture, width, height, FilterType::Triangle)
    };
    let (mut cell, crop) = (scaled(picture, width), scaled(crop, crop_width));
    let frame = RgbImage::from_pixel(crop.width() + 2, crop.height() + 2, Rgb([255; 3]));
    imageops::replace(&mut cell, &frame, 0, 0);
    imageops::replace(&mut cell, &crop, 0, 0);
    cell
}

fn sheet(cells: &[RgbImage], columns: u32) -> RgbImage {
    let (width, height) = cells[0].dimensions();
    let rows = (cells.len() as u32).div_ceil(columns);
    let mut sheet = RgbImage::new(columns * width, rows * height);
    for (index, cell) in (0..).zip(cells) {
        let (x, y) = (index % columns * width, index / columns * height);
        imageops::replace(&mut sheet, cell, i64::from(x), i64::from(y));
    }
    sheet
}

fn save(picture: &RgbImage, path: &Path) {
    picture
        .save(path)
        .unwrap_or_else(|error| panic!("cannot write {}: {error}", path.display()));
}

/// The surroundings of a pixel, every pixel a square of ten.
fn enlarged(picture: &RgbImage, x: f64, y: f64) -> RgbImage {
    let (width, height, zoom) = CROP;
    let corner =
        |center: f64, side: u32, end: u32| (center as u32).saturating_sub(side / 2).min(end - side);
    let left = corner(x, width, picture.width());
    let top = corner(y, height, picture.height());
    let crop = imageops::crop_imm(picture, left, top, width, height).to_image();
    imageops::resize(&crop, width * zoom, height * zoom, FilterType::Nearest)
}

/// Mean CPU time of all threads over a section of an approach at 30 frames a second.
fn cpu_ms_per_frame(scene: &Scene, runway: &Runway, (width, height): (u32, u32)) -> f64 {
    const FRAMES: u32 = 90;
    let landing = Controls {
        flap_ratio: 0.75,
        gear_ratio: 1.0,
    };
    let mut rgb = vec![0; (width * height * 3) as usize];
    let before = processor_time::own_and_children()[0];
    for frame in 0..FRAMES {
        let time_s = 1.0 + f64::from(frame) / 30.0;
        let pose = on_glide_path(runway, 6.0 * METERS_PER_NAUTICAL_MILE - 72.0 * time_s);
        scene.render(&pose, &landing, time_s, &mut rgb);
    }
    let took = processor_time::own_and_children()[0] - before;
    took.as_secs_f64() * 1e3 / f64::from(FRAMES)
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
