//! Synthetic images from a resting camera: ground, sky, clouds, rain, ripples, an aircraft, and four forms of covers.

use super::super::WorldTime;
use crate::pixels::Rectangle;

/// Changes from image to image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Sky {
    /// No changes.
    Clear,
    /// A constant level.
    Grainy,
    /// Water in the lowest quarter.
    Rippling,
    /// Forty things of 6 pixels swing in one to three seconds.
    Swinging {
        /// Brightness above the scene, levels.
        levels: u8,
    },
    /// Clouds drift.
    Cloudy,
    /// Light rain.
    Drizzle,
    /// Clouds drift and heavy rain falls.
    Storm,
}

impl Sky {
    pub(super) fn time(self) -> WorldTime {
        match self {
            Self::Clear | Self::Grainy | Self::Rippling | Self::Swinging { .. } => {
                WorldTime::Paused
            }
            Self::Cloudy | Self::Drizzle | Self::Storm => WorldTime::Runs,
        }
    }

    /// Images in which a scene is watched before it is judged, at 60 a second.
    pub(super) fn watched(self) -> u32 {
        match self {
            Self::Clear => 1,
            Self::Grainy | Self::Rippling | Self::Swinging { .. } => 192,
            Self::Cloudy | Self::Drizzle | Self::Storm => 0,
        }
    }

    fn rain_ratio(self) -> f64 {
        match self {
            Self::Drizzle => 0.2,
            Self::Storm => 1.0,
            _ => 0.0,
        }
    }
}

/// Reproducible random numbers.
pub(super) struct Random(u64);

impl Random {
    pub(super) fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x1234_5678_9abc_def1)
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ mixed >> 31
    }

    /// A number from 0 to just below 1.
    fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub(super) fn below(&mut self, end: u32) -> u32 {
        (self.unit() * f64::from(end)) as u32
    }
}

/// A random scene.
pub(super) struct Scenery {
    size: (u32, u32),
    sky: Sky,
    ground: Vec<u8>,
    /// Heights of clouds on a grid that repeats.
    clouds: Vec<f64>,
    drift_px: (f64, f64),
    wave: u64,
    aircraft: (f64, f64),
    random: Random,
}

const CLOUDS: usize = 32;
const CLOUD_PX: f64 = 22.0;

impl Scenery {
    pub(super) fn new(seed: u64, size: (u32, u32), sky: Sky) -> Self {
        let mut random = Random::new(seed);
        let horizon = 0.35 + 0.3 * random.unit();
        let (light, mut ground) = (60.0 + 140.0 * random.unit(), Vec::new());
        for y in 0..size.1 {
            let down = f64::from(y) / f64::from(size.1);
            for _ in 0..size.0 {
                let level = if down < horizon {
                    light * (0.8 + 0.4 * down)
                } else {
                    light * (0.35 + 0.25 * random.unit())
                };
                ground.extend([level * 0.9, level, level * 1.1].map(|level| level as u8));
            }
        }
        let clouds = (0..CLOUDS * CLOUDS).map(|_| random.unit()).collect();
        // Up to 1.5 pixels an image, 90 per second.
        let drift_px = (3.0 * random.unit() - 1.5, random.unit() - 0.5);
        Self {
            size,
            sky,
            ground,
            clouds,
            drift_px,
            wave: 0,
            aircraft: (
                f64::from(size.0) * random.unit(),
                f64::from(size.1) * random.unit(),
            ),
            random,
        }
    }

    /// Draws the next image; the aircraft's rectangle.
    pub(super) fn draw(&mut self, picture: u32, rgb: &mut Vec<u8>) -> Rectangle {
        rgb.clone_from(&self.ground);
        match self.sky {
            Sky::Grainy => {
                for value in rgb.iter_mut() {
                    *value = value.wrapping_add((self.random.next() & 1) as u8);
                }
            }
            Sky::Rippling => self.ripple(rgb),
            Sky::Swinging { levels } => self.swing(f64::from(picture) / 60.0, levels, rgb),
            Sky::Cloudy | Sky::Storm => self.draw_clouds(f64::from(picture), rgb),
            Sky::Clear | Sky::Drizzle => {}
        }
        let rectangle = self.draw_aircraft(rgb);
        self.draw_rain(rgb);
        rectangle
    }

    fn ripple(&mut self, rgb: &mut [u8]) {
        self.wave += 1 + self.random.next() % 3;
        let row_bytes = self.size.0 as usize * 3;
        let from = self.size.1 as usize * 3 / 4;
        for (row, values) in rgb.chunks_exact_mut(row_bytes).enumerate().skip(from) {
            let up = (row as u64 * 31 + self.wave * 17) % 61;
            for value in values {
                *value = value.saturating_add(up as u8 / 3);
            }
        }
    }

    fn swing(&self, time_s: f64, levels: u8, rgb: &mut [u8]) {
        let mut random = Random::new(7);
        for _ in 0..40 {
            let period_s = 1.0 + 2.0 * random.unit();
            let sway_px = 6.0 * (std::f64::consts::TAU * (time_s / period_s + random.unit())).sin();
            let left = 8.0 + (f64::from(self.size.0) - 24.0) * random.unit() + sway_px;
            let top = random.below(self.size.1 - 6);
            for y in top..top + 6 {
                for x in left as u32..=(left + 6.0) as u32 {
                    let share = (left + 6.0).min(f64::from(x) + 1.0) - left.max(f64::from(x));
                    let more = (f64::from(levels) * share.clamp(0.0, 1.0)).round() as u8;
                    let first = (y * self.size.0 + x) as usize * 3;
                    for value in &mut rgb[first..first + 3] {
                        *value = value.saturating_add(more);
                    }
                }
            }
        }
    }

    /// Over the upper half.
    fn draw_clouds(&self, time: f64, rgb: &mut [u8]) {
        let (across, down) = (self.drift_px.0 * time, self.drift_px.1 * time);
        let at = |column: f64, row: f64| {
            let wrapped = |at: f64| at.rem_euclid(CLOUDS as f64) as usize;
            self.clouds[wrapped(row) * CLOUDS + wrapped(column)]
        };
        for y in 0..self.size.1 / 2 {
            for x in 0..self.size.0 {
                let (u, v) = (
                    (f64::from(x) - across) / CLOUD_PX,
                    (f64::from(y) - down) / CLOUD_PX,
                );
                let (column, row) = (u.floor(), v.floor());
                let (p, q) = (u - column, v - row);
                let top = at(column, row) * (1.0 - p) + at(column + 1.0, row) * p;
                let bottom = at(column, row + 1.0) * (1.0 - p) + at(column + 1.0, row + 1.0) * p;
                let opacity = ((top * (1.0 - q) + bottom * q) * 2.0 - 0.8).clamp(0.0, 1.0);
                let first = (y * self.size.0 + x) as usize * 3;
                for value in &mut rgb[first..first + 3] {
                    *value = blended(*value, 190, opacity);
                }
            }
        }
    }

    /// A dark blob that moves by up to two pixels.
    fn draw_aircraft(&mut self, rgb: &mut [u8]) -> Rectangle {
        let (half_width, half_height) = (14.0, 6.0);
        let mut walk =
            |at: f64, most: f64| (at + 4.0 * self.random.unit() - 2.0).clamp(20.0, most - 20.0);
        self.aircraft = (
            walk(self.aircraft.0, self.size.0.into()),
            walk(self.aircraft.1, self.size.1.into()),
        );
        let (x, y) = self.aircraft;
        let rectangle = Rectangle::between(
            (x - half_width - 1.0) as u32,
            (y - half_height - 1.0) as u32,
            (x + half_width + 2.0) as u32,
            (y + half_height + 2.0) as u32,
        );
        for row in rectangle.y_px..rectangle.bottom_px() {
            for column in rectangle.x_px..rectangle.right_px() {
                let across = (f64::from(column) - x) / half_width;
                let down = (f64::from(row) - y) / half_height;
                if across.hypot(down) < 1.0 {
                    let first = (row * self.size.0 + column) as usize * 3;
                    rgb[first..first + 3].fill(25);
                }
            }
        }
        rectangle
    }

    /// Draws rain as dense, long and strong as the stand-in's, with different streaks in every image.
    fn draw_rain(&mut self, rgb: &mut [u8]) {
        let (width, height) = (f64::from(self.size.0), f64::from(self.size.1));
        let count = 260.0 * self.sky.rain_ratio() * width * height / 1e6;
        for _ in 0..count as u32 {
            let near = self.random.unit();
            let length = 12.0 + 60.0 * near * near;
            let left = self.random.unit() * width;
            let top = self.random.unit() * (height + length) - length;
            let slant = 0.06 + 0.04 * self.random.unit();
            for step in 0..length as u32 {
                let (x, y) = (left + slant * f64::from(step), top + f64::from(step));
                if x < width && (0.0..height).contains(&y) {
                    let first = (y as u32 * self.size.0 + x as u32) as usize * 3;
                    for value in &mut rgb[first..first + 3] {
                        *value = blended(*value, 200, 0.1 * (0.4 + 0.6 * near));
                    }
                }
            }
        }
    }
}

/// Something that covers a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum CoverForm {
    /// X-Plane's: an opaque box with text.
    Message,
    /// A plugin's: half transparent, with a frame.
    Window,
    /// The desktop's: opaque, rounded, at a corner.
    Notification,
    /// A pointer with its hint.
    Pointer,
}

impl CoverForm {
    pub(super) const ALL: [Self; 4] = [
        Self::Message,
        Self::Window,
        Self::Notification,
        Self::Pointer,
    ];

    /// Draws it somewhere; it covers a share of the image.
    pub(super) fn draw(self, rgb: &mut [u8], size: (u32, u32), share: f64, random: &mut Random) {
        let area = share * f64::from(size.0) * f64::from(size.1);
        let height = (area / 3.0).sqrt().round();
        let (width_px, height_px) = ((area / height).round() as u32, height as u32);
        let (x_px, y_px) = match self {
            Self::Notification => (size.0 - width_px - 6, 6),
            _ => (
                random.below(size.0 - width_px),
                random.below(size.1 - height_px),
            ),
        };
        let place = Rectangle {
            x_px,
            y_px,
            width_px,
            height_px,
        };
        match self {
            Self::Message => {
                fill(rgb, size.0, place, [18, 18, 22], 1.0);
                text(rgb, size.0, place, [235, 235, 235]);
            }
            Self::Window => {
                fill(rgb, size.0, place, [200, 205, 210], 0.5);
                fill(rgb, size.0, place.inside(2), [30, 34, 40], 0.55);
                text(rgb, size.0, place, [120, 230, 120]);
            }
            Self::Notification => {
                // Without its corners.
                let [across, down] = [(3, 0), (0, 3)].map(|(x, y)| {
                    let (left, top) = (place.x_px + x, place.y_px + y);
                    Rectangle::between(left, top, place.right_px() - x, place.bottom_px() - y)
                });
                fill(rgb, size.0, across, [246, 245, 244], 1.0);
                fill(rgb, size.0, down, [246, 245, 244], 1.0);
                text(rgb, size.0, place, [50, 50, 50]);
            }
            Self::Pointer => {
                for row in 0..16.min(place.height_px) {
                    let (x, y) = (place.x_px, place.y_px + row);
                    fill(
                        rgb,
                        size.0,
                        Rectangle::between(x, y, x + row * 2 / 3 + 1, y + 1),
                        [0; 3],
                        1.0,
                    );
                }
                let hint = Rectangle::between(
                    place.x_px + 8,
                    place.y_px + 4,
                    place.right_px(),
                    place.bottom_px(),
                );
                fill(rgb, size.0, hint, [40, 40, 40], 1.0);
                fill(rgb, size.0, hint.inside(1), [255, 255, 225], 1.0);
                text(rgb, size.0, hint, [20, 20, 20]);
            }
        }
    }
}

/// Lines of dashes.
fn text(rgb: &mut [u8], width_px: u32, place: Rectangle, colour: [u8; 3]) {
    let inside = place.inside(4);
    for y in (inside.y_px..inside.bottom_px()).step_by(6) {
        for x in (inside.x_px..inside.right_px()).step_by(5) {
            let letter = Rectangle::between(x, y, (x + 3).min(inside.right_px()), y + 1);
            fill(rgb, width_px, letter, colour, 1.0);
        }
    }
}

/// Fills a rectangle in an image with this width, more or less opaque.
pub(super) fn fill(rgb: &mut [u8], width_px: u32, place: Rectangle, colour: [u8; 3], opacity: f64) {
    for y in place.y_px..place.bottom_px() {
        for x in place.x_px..place.right_px() {
            let first = (y * width_px + x) as usize * 3;
            for (value, wanted) in rgb[first..first + 3].iter_mut().zip(colour) {
                *value = blended(*value, wanted, opacity);
            }
        }
    }
}

/// Makes a rectangle brighter, or darker where it would be too bright.
pub(super) fn brighten(rgb: &mut [u8], width_px: u32, place: Rectangle, levels: u8) {
    for y in place.y_px..place.bottom_px() {
        for x in place.x_px..place.right_px() {
            let first = (y * width_px + x) as usize * 3;
            for value in &mut rgb[first..first + 3] {
                *value = value.checked_add(levels).unwrap_or_else(|| *value - levels);
            }
        }
    }
}

fn blended(value: u8, wanted: u8, opacity: f64) -> u8 {
    (f64::from(value) + (f64::from(wanted) - f64::from(value)) * opacity).round() as u8
}
