//! Everything behind the aircraft, cached for copying.
//!
//! Below the first row with a silhouette the image is static and is cached completely. Above it the sky is smooth: it is stored as a coarse
//! grid of display values, from which rows are interpolated. Without clouds that happens once; with clouds a grid is computed at successive
//! instants so close together that the clouds drift by at most a pixel between two (`drift.rs` tracks them). If several images show an
//! instant, its rows are interpolated once and copied.

pub(crate) mod clouds;
mod drift;
pub(crate) mod ground;
pub(crate) mod noise;
mod ships;

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

use crate::render::air::Air;
use crate::render::imaging::blur::Blur;
use crate::render::imaging::tone::{self, Tone};
use crate::render::instant_cache::InstantCache;
use crate::render::lamps::Spot;
use crate::render::view::CELL_PX;
use crate::render::view::View;
use clouds::Clouds;
use drift::{DriftingLayer, Moved};
use ground::{Ground, MAX_SILHOUETTE_RAD};

/// Drift between two computed instants, pixels. An image shows the clouds of the nearest instant: blending two would double the
/// cost at low frame rates, where every image needs new ones.
const DRIFT_PER_INSTANT_PX: f64 = 1.0;
/// Samples per pixel of the ground, across and down. Grazing views change faster downwards.
const GROUND_SAMPLES: (usize, usize) = (2, 4);

pub(crate) struct Surroundings {
    pub(crate) view: View,
    pub(crate) air: Air,
    pub(crate) clouds: Clouds,
    pub(crate) tone: Tone,
}

/// The cached image of everything but the aircraft.
pub(crate) struct Backdrop {
    width: usize,
    /// Number of top rows that contain only sky; a multiple of the cell size.
    sky_rows: usize,
    /// The sky without clouds.
    clear: ClearSky,
    /// Clouds in front of it, nearest first.
    layers: Vec<DriftingLayer>,
    /// The whole image at time 0, as bytes.
    still: Vec<u8>,
    /// Exposed light of the rows below the sky.
    ground: Vec<Vec3>,
    /// The sky at time 0.
    still_sky: Arc<SkyGrid>,
    /// Seconds between computed instants; `None` if the backdrop is static.
    instant_s: Option<f64>,
    instants: InstantCache<SkyGrid>,
    /// Time of the last image, seconds.
    last_time_s: Mutex<f64>,
}

/// Grid on which the sky is computed: every [`CELL_PX`]th pixel across and down.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Nodes {
    pub(crate) columns: usize,
    rows: usize,
}

/// The sky behind all clouds.
struct ClearSky {
    nodes: Nodes,
    /// Luminance at the nodes, cd/m2.
    luminance: Vec<Vec3>,
    /// Part of the clouds that is drawn there ([`Clouds::share`]).
    cloud_share: Vec<f32>,
}

/// Display values (0 to 255) of the sky at the nodes.
pub(crate) struct SkyGrid {
    columns: usize,
    values: Vec<Vec3>,
    /// The rows that [`Self::paint`] interpolates, if several images need them.
    rows: OnceLock<Vec<u8>>,
}

impl Backdrop {
    pub(crate) fn new(world: &Surroundings, ground: &Ground, lamps: &[Spot]) -> Self {
        let camera = &world.view.camera;
        let (width, height) = (camera.width_px as usize, camera.height_px as usize);
        let sky_rows = sky_rows(&world.view);
        let clear = ClearSky::new(world, sky_rows);
        let layers: Vec<_> = (0..world.clouds.layers().len())
            .map(|index| DriftingLayer::new(world, &clear.nodes, index))
            .collect();
        let still_sky = Arc::new(SkyGrid::compute(world, &clear, &layers, 0.0));
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

        let speed_px_per_s = layers
            .iter()
            .map(DriftingLayer::speed_px_per_s)
            .fold(0.0, f64::max);
        let moves = speed_px_per_s > 0.0 && sky_rows > 0;
        Self {
            width,
            sky_rows,
            clear,
            layers,
            still,
            ground: still_ground,
            still_sky,
            instant_s: moves.then(|| (DRIFT_PER_INSTANT_PX / speed_px_per_s).clamp(0.05, 10.0)),
            instants: InstantCache::default(),
            last_time_s: Mutex::new(f64::NEG_INFINITY),
        }
    }

    /// Blurs the static part. The sky has no structure finer than its grid, so it stays.
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

    /// Copies the backdrop at a time into an image and returns its sky, which [`Self::light`] needs.
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
                    // A different thread may have been faster.
                    let _ = sky.rows.set(above.to_vec());
                }
            }
        }
        below.copy_from_slice(&self.still[self.sky_rows * self.width * 3..]);
        sky
    }

    /// True if images follow each other so closely that most instants are shown by at least two.
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
        self.instants.get(instant, || {
            let time_s = instant as f64 * instant_s;
            SkyGrid::compute(world, &self.clear, &self.layers, time_s)
        })
    }
}

impl Nodes {
    /// Computes something at every node, row by row; takes the pixel.
    pub(crate) fn map<T: Send>(&self, at: impl Fn(DVec2) -> T + Sync + Send) -> Vec<T> {
        (0..self.columns * self.rows)
            .into_par_iter()
            .map(|i| {
                at(
                    DVec2::new((i % self.columns) as f64, (i / self.columns) as f64)
                        * CELL_PX as f64,
                )
            })
            .collect()
    }
}

impl ClearSky {
    fn new(world: &Surroundings, sky_rows: usize) -> Self {
        let nodes = Nodes {
            columns: (world.view.camera.width_px as usize).div_ceil(CELL_PX) + 1,
            rows: sky_rows / CELL_PX + 1,
        };
        Self {
            nodes,
            luminance: nodes.map(|pixel| world.air.sky(world.view.ray(pixel))),
            cloud_share: nodes.map(|pixel| Clouds::share(world.view.ray(pixel))),
        }
    }
}

impl SkyGrid {
    fn compute(
        world: &Surroundings,
        clear: &ClearSky,
        layers: &[DriftingLayer],
        time_s: f64,
    ) -> Self {
        let nodes = &clear.nodes;
        let layers: Vec<Moved<'_>> = layers
            .iter()
            .map(|layer| layer.at(world, nodes, time_s))
            .collect();
        let at = |node: usize| {
            let mut luminance = clear.luminance[node];
            // From the farthest to the nearest.
            for layer in layers.iter().rev() {
                let (light, opacity) = layer.at(nodes, node);
                let share = clear.cloud_share[node];
                luminance = light * share + luminance * (1.0 - opacity * share);
            }
            tone::encode(world.tone.expose(luminance))
        };
        Self {
            columns: nodes.columns,
            values: (0..clear.luminance.len())
                .into_par_iter()
                .with_min_len(1024)
                .map(at)
                .collect(),
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

    /// Interpolates rows of pixels from the top, a multiple of [`CELL_PX`].
    fn paint(&self, width: usize, rgb: &mut [u8]) {
        let line_bytes = width * 3;
        rgb.par_chunks_mut(line_bytes * CELL_PX * CELLS_AT_ONCE)
            .enumerate()
            .for_each(|(job, lines)| {
                let mut above = vec![0; line_bytes];
                let mut below = vec![0; line_bytes];
                self.widen(job * CELLS_AT_ONCE, &mut below);
                for (row, cell) in lines.chunks_mut(line_bytes * CELL_PX).enumerate() {
                    std::mem::swap(&mut above, &mut below);
                    // Below the last line of cells there is one more row of nodes.
                    self.widen(job * CELLS_AT_ONCE + row + 1, &mut below);
                    for (y, line) in cell.chunks_exact_mut(line_bytes).enumerate() {
                        blend(&above, &below, y as u16, line);
                    }
                }
            });
    }

    /// Expands a row of nodes to a line of pixels, in 1/[`LEVEL`] of a display level.
    fn widen(&self, row: usize, line: &mut [u16]) {
        let nodes = &self.values[row * self.columns..][..self.columns];
        for (pair, cell) in nodes.windows(2).zip(line.chunks_mut(CELL_PX * 3)) {
            let (mut value, step) = (
                pair[0] * LEVEL + 0.5,
                (pair[1] - pair[0]) * (LEVEL / CELL_PX as f32),
            );
            for pixel in cell.chunks_exact_mut(3) {
                pixel[0] = value.x as u16;
                pixel[1] = value.y as u16;
                pixel[2] = value.z as u16;
                value += step;
            }
        }
    }
}

/// Rows of cells per thread at a time.
const CELLS_AT_ONCE: usize = 4;
/// Fractions of a display level kept between the two directions of interpolation. With them a whole cell of levels still fits into
/// 16 bits, of which processors multiply and add many at once.
const LEVEL: f32 = 16.0;

fn blend(above: &[u16], below: &[u16], y: u16, line: &mut [u8]) {
    const CELL: u16 = CELL_PX as u16;
    const HALF: u16 = LEVEL as u16 * CELL / 2;
    for ((above, below), shown) in above.iter().zip(below).zip(line) {
        *shown = ((above * (CELL - y) + below * y + HALF) / (2 * HALF)) as u8;
    }
}

fn sky_luminance(world: &Surroundings, ray: DVec3, time_s: f64) -> Vec3 {
    let range_m = Clouds::farthest_seen_m(&world.air);
    world
        .clouds
        .along(&world.view, &world.air, ray, range_m, time_s)
        .over(world.air.sky(ray))
}

fn ground_pixel(world: &Surroundings, ground: &Ground, x: f64, y: f64) -> Vec3 {
    let middle = world.view.ray(DVec2::new(x, y));
    // Rows of a rolled camera may mix ground and high sky; the clouds there keep their shape at time 0.
    if middle.z > 2.0 * MAX_SILHOUETTE_RAD {
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

/// Number of top rows in which no ray comes near the horizon.
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
            .z > 1.2 * MAX_SILHOUETTE_RAD
        })
    };
    let rows = (0..height).take_while(|&y| open_sky(y)).count();
    rows / CELL_PX * CELL_PX
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::tests::{NM_M, overcast, scene};

    #[test]
    fn clouds_between_two_keys_are_where_a_march_at_that_time_finds_them() {
        let scene = scene(4.0 * NM_M, &overcast());
        let (world, backdrop) = (&scene.world, &scene.backdrop);
        let nodes = &backdrop.clear.nodes;
        let marched = |time_s: f64| {
            nodes.map(|pixel| {
                let ray = world.view.ray(pixel);
                tone::encode(world.tone.expose(sky_luminance(world, ray, time_s)))
            })
        };
        let followed =
            |time_s: f64| SkyGrid::compute(world, &backdrop.clear, &backdrop.layers, time_s).values;
        let mean_difference = |a: &[Vec3], b: &[Vec3]| {
            a.iter().zip(b).map(|(a, b)| (*a - *b).abs().y).sum::<f32>() / a.len() as f32
        };
        assert!(followed(0.0) == marched(0.0), "the first key");
        let (mut missed, mut moved) = (0.0, 0.0);
        for second in 1..20 {
            let time_s = 0.77 * f64::from(second);
            let truth = marched(time_s);
            missed += mean_difference(&truth, &followed(time_s)) / 19.0;
            // Motion that would be missed by holding still from key to key.
            let key_s = backdrop.layers[0].key_s().unwrap();
            moved += mean_difference(&truth, &marched(time_s - key_s)) / 19.0;
        }
        assert!(
            missed < 0.3 * moved && missed < 0.2,
            "{missed} of {moved} grey levels"
        );
    }

    #[test]
    fn a_painted_line_meets_its_nodes_and_goes_straight_between_them() {
        let columns = 4;
        let value = |i: usize| Vec3::new(10.0 * i as f32, 255.0, 17.3 + 1.5 * (i * i) as f32);
        let grid = SkyGrid {
            columns,
            values: (0..columns * 3).map(value).collect(),
            rows: OnceLock::new(),
        };
        // A width that ends within a cell.
        let width = 2 * CELL_PX + 5;
        let mut rgb = vec![0; width * 3 * 2 * CELL_PX];
        grid.paint(width, &mut rgb);
        for (i, shown) in rgb.chunks_exact(3).enumerate() {
            let expected = grid.at(i % width, i / width);
            for (shown, expected) in shown.iter().zip(expected.to_array()) {
                let error = f32::from(*shown) - expected;
                assert!(
                    error.abs() < 0.6,
                    "{shown} instead of {expected} at pixel {i}"
                );
            }
        }
    }
}
