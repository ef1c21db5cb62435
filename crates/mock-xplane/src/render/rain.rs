//! Streaks of rain near the camera.

use crate::render::backdrop::noise::{hash, unit_hash};

/// Streaks per million pixels in the heaviest rain.
const STREAKS_PER_MEGAPIXEL: f64 = 260.0;
/// Strength with which streaks pull a pixel towards the grey of the rain.
const STRENGTH: f32 = 0.10;

/// Draws the streaks at an instant. `grey` is the display value of lit drops; `seed` distinguishes cameras.
pub(crate) fn draw(
    rgb: &mut [u8],
    size: (usize, usize),
    rain_ratio: f64,
    grey: [f32; 3],
    time_s: f64,
    seed: u32,
) {
    let (width, height) = size;
    let count =
        (STREAKS_PER_MEGAPIXEL * rain_ratio.clamp(0.0, 1.0) * (width * height) as f64 / 1e6) as u32;
    // Drops cross the image faster than the frame rate: every instant has its own streaks.
    let bits = time_s.to_bits();
    let instant = hash(bits as u32, (bits >> 32) as u32, seed);
    for streak in 0..count {
        let random = |what: u32| unit_hash(instant, streak, what);
        let near = random(0);
        let length = 12.0 + 60.0 * near * near;
        let (x, y) = (
            random(1) * width as f32,
            random(2) * (height as f32 + length) - length,
        );
        let slant = 0.06 + 0.04 * random(3);
        let strength = STRENGTH * (0.4 + 0.6 * near);
        for step in 0..length as i32 {
            let (px, py) = ((x + slant * step as f32) as i64, y as i64 + i64::from(step));
            if (0..width as i64).contains(&px) && (0..height as i64).contains(&py) {
                let pixel = &mut rgb[(py as usize * width + px as usize) * 3..][..3];
                for (channel, grey) in pixel.iter_mut().zip(grey) {
                    let value = f32::from(*channel);
                    *channel = (value + (grey - value) * strength + 0.5) as u8;
                }
            }
        }
    }
}
