//! Everything behind the aircraft, ready to be copied.
//!
//! Below the first row with a silhouette the picture stands still and is kept whole. Above it the sky is smooth: it is kept as
//! a coarse grid of display values, from which rows are interpolated. Without clouds that happens once; with clouds a grid is
//! computed for each of a series of instants so close together that the clouds drift by no more than a pixel from one to the next. An
//! instant that several pictures show has its rows interpolated once and copied.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

use crate::render::air::Air;
use crate::render::blur::Blur;
use crate::render::clouds::Clouds;
use crate::render::ground::{Ground, HIGHEST_SILHOUETTE_RAD};
use crate::render::lamps::Spot;
use crate::render::tone::{self, Tone};
use crate::render::view::View;

/// Pixels between grid nodes.
pub(crate) const CELL_PX: usize = 8;
/// Drift between two computed instants, pixels. A picture shows the clouds of the nearest instant: blending two would cost
/// twice as much at the low frame rates at which every picture needs new ones.
const DRIFT_PER_INSTANT_PX: f64 = 1.0;
/// Instants kept: frames are asked for in order, sometimes by several threads. Each may hold 5 MB of rows of a full-size picture.
const KEPT_INSTANTS: usize = 3;
/// Samples per pixel of the ground, across and down. Grazing views change faster downwards.
const GROUND_SAMPLES: (usize, usize) = (2, 4);

/// What a backdrop shows.
pub(crate) struct Surroundings {
    pub(crate) view: View,
    pub(crate) air: Air,
    pub(crate) clouds: Clouds,
    pub(crate) tone: Tone,
}

/// The cached picture of everything but the aircraft.
pub(crate) struct Backdrop {
    width: usize,
    /// Rows from the top that hold nothing but sky; a multiple of the cell size.
    sky_rows: usize,
    /// The whole picture at time 0, as bytes.
    still: Vec<u8>,
    /// Exposed light of the rows below the sky.
    ground: Vec<Vec3>,
    /// The sky at time 0.
    still_sky: Arc<SkyGrid>,
    /// Seconds between computed instants; `None` if nothing moves.
    instant_s: Option<f64>,
    instants: Mutex<BTreeMap<i64, Arc<SkyGrid>>>,
    /// When the last picture was, seconds.
    last_time_s: Mutex<f64>,
}

/// Display values (0 to 255) of the sky at every [`CELL_PX`]th pixel.
pub(crate) struct SkyGrid {
    columns: usize,
    values: Vec<Vec3>,
    /// The rows that [`Self::paint`] interpolates, if several pictures want them.
    rows: OnceLock<Vec<u8>>,
}

impl Backdrop {
    pub(crate) fn new(world: &Surroundings, ground: &Ground, lamps: &[Spot]) -> Self {
        let camera = &world.view.camera;
        let (width, height) = (camera.width_px as usize, camera.height_px as usize);
        let sky_rows = sky_rows(&world.view);
        let still_sky = Arc::new(SkyGrid::compute(world, sky_rows, 0.0));
        let mut still_ground: Vec<Vec3> = (sky_rows * width..height * width)
            .into_par_iter()
            .map(|i| ground_pixel(world, ground, (i % width) as f64, (i / width) as f64))
            .collect();
        for spot in lamps {
            add_spot(&mut still_ground, width, sky_rows, spot);
        }
        let mut still = vec![0; width * height * 3];
        still_sky.paint(width, &mut still[..sky_rows * width * 3]);
        still[sky_rows * width * 3..]
            .par_chunks_mut(3)
            .zip(&still_ground)
            .for_each(|(rgb, &light)| {
                rgb.copy_from_slice(&tone::to_bytes(tone::encode(light)));
            });

        let steepest_up = [0, width - 1].map(|x| world.view.ray(DVec2::new(x as f64, 0.0)).z);
        let speed_px_per_s = world
            .clouds
            .angular_speed_rad_per_s(steepest_up[0].max(steepest_up[1]))
            * world.view.camera.focal_px;
        let moves = !world.clouds.is_empty() && speed_px_per_s > 0.0 && sky_rows > 0;
        Self {
            width,
            sky_rows,
            still,
            ground: still_ground,
            still_sky,
            instant_s: moves.then(|| (DRIFT_PER_INSTANT_PX / speed_px_per_s).clamp(0.05, 10.0)),
            instants: Mutex::default(),
            last_time_s: Mutex::new(f64::NEG_INFINITY),
        }
    }

    /// Blurs what stands still. The sky has no structure finer than its grid, so it stays.
    pub(crate) fn blur(&mut self, blur: &Blur) {
        // Light of the sky's last rows reaches the ground's first.
        let rim = blur.reach_px().min(self.sky_rows);
        let first = self.sky_rows - rim;
        let mut light: Vec<Vec3> = (first * self.width..self.sky_rows * self.width)
            .map(|i| tone::decode(self.still_sky.at(i % self.width, i / self.width)))
            .collect();
        light.extend_from_slice(&self.ground);
        blur.apply(&mut light, self.width);
        self.ground.copy_from_slice(&light[rim * self.width..]);
        self.still[self.sky_rows * self.width * 3..]
            .par_chunks_mut(3)
            .zip(&self.ground)
            .for_each(|(rgb, &light)| {
                rgb.copy_from_slice(&tone::to_bytes(tone::encode(light)));
            });
    }

    /// Copies the backdrop at a time into a picture and returns its sky, which [`Self::light`] wants.
    pub(crate) fn paint(&self, world: &Surroundings, time_s: f64, rgb: &mut [u8]) -> Arc<SkyGrid> {
        let Some(instant_s) = self.instant_s else {
            rgb.copy_from_slice(&self.still);
            return Arc::clone(&self.still_sky);
        };
        let sky = self.instant(world, (time_s / instant_s).round() as i64, instant_s);
        let (above, below) = rgb.split_at_mut(self.sky_rows * self.width * 3);
        let again = self.shows_an_instant_twice(time_s, instant_s);
        match sky.rows.get() {
            Some(rows) => above.copy_from_slice(rows),
            None => {
                sky.paint(self.width, above);
                if again {
                    // Somebody else may have been faster.
                    let _ = sky.rows.set(above.to_vec());
                }
            }
        }
        below.copy_from_slice(&self.still[self.sky_rows * self.width * 3..]);
        sky
    }

    /// Whether pictures follow each other so closely that most instants are shown by two at least.
    fn shows_an_instant_twice(&self, time_s: f64, instant_s: f64) -> bool {
        let mut last_s = self
            .last_time_s
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        let since_last_s = time_s - std::mem::replace(&mut *last_s, time_s);
        since_last_s.abs() <= instant_s / 2.0
    }

    /// The sky at time 0.
    #[cfg(test)]
    pub(crate) fn still_sky(&self) -> Arc<SkyGrid> {
        Arc::clone(&self.still_sky)
    }

    /// Exposed light of the backdrop at a pixel.
    pub(crate) fn light(&self, sky: &SkyGrid, x: usize, y: usize) -> Vec3 {
        if y < self.sky_rows {
            tone::decode(sky.at(x, y))
        } else {
            self.ground[(y - self.sky_rows) * self.width + x]
        }
    }

    fn instant(&self, world: &Surroundings, instant: i64, instant_s: f64) -> Arc<SkyGrid> {
        // The lock is not held while computing: a rayon worker that waits inside could pick up a job that wants the lock too.
        if let Some(grid) = self
            .instants
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .get(&instant)
        {
            return Arc::clone(grid);
        }
        let grid = Arc::new(SkyGrid::compute(
            world,
            self.sky_rows,
            instant as f64 * instant_s,
        ));
        let mut kept = self.instants.lock().unwrap_or_else(PoisonError::into_inner);
        kept.insert(instant, Arc::clone(&grid));
        while kept.len() > KEPT_INSTANTS {
            // The one farthest in time from what is asked for now.
            let farthest = kept
                .keys()
                .copied()
                .max_by_key(|&kept| (kept - instant).abs());
            farthest.and_then(|key| kept.remove(&key));
        }
        grid
    }
}

impl SkyGrid {
    fn compute(world: &Surroundings, sky_rows: usize, time_s: f64) -> Self {
        let columns = (world.view.camera.width_px as usize).div_ceil(CELL_PX) + 1;
        let rows = sky_rows / CELL_PX + 1;
        let values = (0..columns * rows)
            .into_par_iter()
            .map(|i| {
                let pixel = DVec2::new(
                    (i % columns * CELL_PX) as f64,
                    (i / columns * CELL_PX) as f64,
                );
                tone::encode(
                    world
                        .tone
                        .expose(sky_luminance(world, world.view.ray(pixel), time_s)),
                )
            })
            .collect();
        Self {
            columns,
            values,
            rows: OnceLock::new(),
        }
    }

    /// The display value at a pixel.
    fn at(&self, x: usize, y: usize) -> Vec3 {
        let (column, row) = (x / CELL_PX, y / CELL_PX);
        let part = |n: usize| (n % CELL_PX) as f32 / CELL_PX as f32;
        let node = row * self.columns + column;
        let across = |node: usize| self.values[node].lerp(self.values[node + 1], part(x));
        across(node).lerp(across(node + self.columns), part(y))
    }

    /// Interpolates rows of pixels from the top.
    fn paint(&self, width: usize, rgb: &mut [u8]) {
        /// One display level in fixed-point numbers.
        const ONE: f32 = 65_536.0;
        rgb.par_chunks_mut(width * 3)
            .enumerate()
            .with_min_len(16)
            .for_each(|(y, line)| {
                let part = (y % CELL_PX) as f32 / CELL_PX as f32;
                let above = &self.values[y / CELL_PX * self.columns..][..self.columns];
                // In the last line of cells there is a row below, too: the grid has one row more than cells.
                let below = &self.values[(y / CELL_PX + 1) * self.columns..][..self.columns];
                let node = |column: usize| {
                    ((above[column].lerp(below[column], part) + 0.5) * ONE).as_ivec3()
                };
                let mut left = node(0);
                for (column, cell) in line.chunks_mut(CELL_PX * 3).enumerate() {
                    let right = node(column + 1);
                    let step = (right - left) / CELL_PX as i32;
                    let mut value = left;
                    for pixel in cell.chunks_exact_mut(3) {
                        pixel[0] = (value.x >> 16) as u8;
                        pixel[1] = (value.y >> 16) as u8;
                        pixel[2] = (value.z >> 16) as u8;
                        value += step;
                    }
                    left = right;
                }
            });
    }
}

fn sky_luminance(world: &Surroundings, ray: DVec3, time_s: f64) -> Vec3 {
    let sky = world.air.sky(ray);
    if world.clouds.is_empty() {
        return sky;
    }
    world
        .clouds
        .along(
            &world.view,
            &world.air,
            ray,
            Clouds::farthest_seen_m(&world.air),
            time_s,
        )
        .over(sky)
}

fn ground_pixel(world: &Surroundings, ground: &Ground, x: f64, y: f64) -> Vec3 {
    let middle = world.view.ray(DVec2::new(x, y));
    // Rows of a rolled camera may mix ground and high sky; the clouds there keep the shape that they have at time 0.
    if middle.z > 2.0 * HIGHEST_SILHOUETTE_RAD {
        return world.tone.expose(sky_luminance(world, middle, 0.0));
    }
    let (across, down) = GROUND_SAMPLES;
    let mut sum = Vec3::ZERO;
    for j in 0..down {
        for i in 0..across {
            let offset = DVec2::new(
                (i as f64 + 0.5) / across as f64,
                (j as f64 + 0.5) / down as f64,
            ) - 0.5;
            let ray = world.view.ray(DVec2::new(x, y) + offset);
            sum += ground
                .seen(ray)
                .unwrap_or_else(|| sky_luminance(world, ray, 0.0));
        }
    }
    world.tone.expose(sum / (across * down) as f32)
}

fn add_spot(light: &mut [Vec3], width: usize, first_row: usize, spot: &Spot) {
    let height = first_row + light.len() / width;
    let reach = spot.reach_px();
    let range = |center: f64, end: usize| {
        ((center - reach).ceil().max(0.0) as i64)
            ..=((center + reach).floor().min(end as f64 - 1.0) as i64)
    };
    for y in range(spot.pixel.y, height).filter(|&y| y >= first_row as i64) {
        for x in range(spot.pixel.x, width) {
            light[(y as usize - first_row) * width + x as usize] += spot.on(x, y);
        }
    }
}

/// Rows from the top in which no ray comes near the horizon.
fn sky_rows(view: &View) -> usize {
    let (width, height) = (
        view.camera.width_px as usize,
        view.camera.height_px as usize,
    );
    let open_sky = |y: usize| {
        (0..=16).all(|i| {
            view.ray(DVec2::new(
                (width - 1) as f64 * f64::from(i) / 16.0,
                y as f64,
            ))
            .z > 1.2 * HIGHEST_SILHOUETTE_RAD
        })
    };
    let rows = (0..height).take_while(|&y| open_sky(y)).count();
    rows / CELL_PX * CELL_PX
}
