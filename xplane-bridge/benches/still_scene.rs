//! Cost of looking for covers in an image of 1920 x 1280: `cargo bench -p xplane-bridge --bench still_scene`.
//!
//! One core, the fastest and the mean of 50 images each: a paused world in which only the aircraft moves, one in which every row differs,
//! and running time with rain in every image.

use std::hint::black_box;
use std::time::Instant;

use xplane_bridge::pixels::Rectangle;
use xplane_bridge::pixels::still_scene::{StillScene, WorldTime};

const SIZE_PX: (u32, u32) = (1_920, 1_280);
const PICTURES: usize = 50;
const AIRCRAFT: Rectangle = Rectangle {
    x_px: 900,
    y_px: 600,
    width_px: 120,
    height_px: 60,
};

/// Ground of random brightness, the same in every image, with streaks that differ.
fn picture(number: u32, streaks: u32) -> Vec<u8> {
    let (width, height) = SIZE_PX;
    let mut random = 7_u64;
    let mut rgb: Vec<u8> = (0..width * height * 3)
        .map(|_| {
            random = random
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            40 + (random >> 57) as u8
        })
        .collect();
    for streak in 0..streaks {
        let x = (streak * 977 + number * 131) % width;
        let y = (streak * 613 + number * 71) % (height - 30);
        for down in 0..30 {
            rgb[(((y + down) * width + x) * 3) as usize] ^= 9;
        }
    }
    rgb
}

fn measure(what: &str, time: WorldTime, pictures: &[Vec<u8>]) {
    let mut scene = StillScene::new(SIZE_PX.0, SIZE_PX.1, time);
    let mut times_ms = Vec::new();
    for number in 0..PICTURES + 10 {
        let picture = &pictures[number % pictures.len()];
        let began = Instant::now();
        let found = black_box(scene.look(black_box(picture), &[AIRCRAFT]));
        times_ms.push(1e3 * began.elapsed().as_secs_f64());
        assert!(found.is_ok(), "{what}: {found:?}");
    }
    // The first ones learn.
    let times_ms = &times_ms[10..];
    let fastest = times_ms.iter().copied().fold(f64::INFINITY, f64::min);
    let mean = times_ms.iter().sum::<f64>() / times_ms.len() as f64;
    println!("{what}: {fastest:.2} ms, mean {mean:.2} ms");
}

fn main() {
    let still = [picture(0, 0)];
    let rain: Vec<Vec<u8>> = (0..8).map(|number| picture(number, 640)).collect();
    measure("paused, still", WorldTime::Paused, &still);
    measure("paused, every row differs", WorldTime::Paused, &rain);
    measure("time runs, rain", WorldTime::Runs, &rain);
}
