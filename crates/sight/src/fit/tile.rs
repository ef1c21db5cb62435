//! Small parts of the reference image, and their places in other images.

use dataset::video::Luma;
use glam::{DVec2, DVec3};

use crate::ground::{self, Ground, UNKNOWNS};

/// Tile size, px: wide, because distant objects on the ground are flat in the image.
const WIDTH: usize = 32;
const HEIGHT: usize = 16;
/// Pixels around a tile that its blur and its slopes reach.
const BORDER: usize = 2;
/// Horizontal bands, each with its own best tiles.
const BANDS: usize = 8;
/// Number of tiles per band with the most structure across, and down.
const BEST_ACROSS: usize = 8;
const BEST_DOWN: usize = 5;
/// Minimum sum of squared slopes, in squares of the pixel noise: it shows a shift to a quarter of a pixel.
const MIN_STRUCTURE: f64 = 90.0;
/// Minimum ratio of the structures along both axes. An edge shows little along itself but its steps on the pixel grid, which do not move
/// with it.
const MIN_AXIS_RATIO: f64 = 0.1;
/// Number of neighbouring pixels that count as one, because they share blur and errors.
const SHARED: f64 = 4.0;
/// Minimum correlation with the tile.
const MIN_CORRELATION: f64 = 0.6;
/// No tile shows its place better than this, pixels.
const MIN_SD_PX: f64 = 0.06;

type Slopes = [[f64; UNKNOWNS]; 2];

/// A tile of the reference.
#[derive(Debug, Clone)]
pub(super) struct Tile {
    left: usize,
    top: usize,
    pub(super) middle_px: DVec2,
    pub(super) direction: DVec3,
    /// Derivatives of the place by the motion, right and down.
    pub(super) slopes: Slopes,
    /// Blurred light about its mean, and its slopes right and down without what gain and offset explain.
    light: Vec<[f32; 3]>,
    /// Sum of squared light.
    power: f64,
    /// Sums of slope products.
    structure: [f64; 3],
    /// Pixel noise, grey levels.
    noise_levels: f64,
    /// Information about a shift to the right and down in an image with little noise, 1 / square pixels.
    pub(super) tells: DVec2,
}

/// Measured tile position.
#[derive(Debug, Clone, Copy)]
pub(super) struct Told {
    best_px: DVec2,
    /// Directions of most and least structure, each with its certainty, 1 / square pixels.
    axes: [(DVec2, f64); 2],
}

impl Told {
    /// Two independent equations for a change of the motion: row, value and certainty.
    pub(super) fn equations(&self, slopes: &Slopes) -> [([f64; UNKNOWNS], f64, f64); 2] {
        self.axes.map(|(axis, certainty)| {
            let row = std::array::from_fn(|i| axis.x * slopes[0][i] + axis.y * slopes[1][i]);
            (row, axis.dot(self.best_px), certainty)
        })
    }

    /// Standard deviations between its own best step and the one that a change of the motion makes.
    pub(super) fn misfit(&self, slopes: &Slopes, step: &[f64; UNKNOWNS]) -> f64 {
        let squares = self.equations(slopes).map(|(row, value, certainty)| {
            let moved: f64 = row.iter().zip(step).map(|(row, step)| row * step).sum();
            certainty * (moved - value).powi(2)
        });
        squares.iter().sum::<f64>().sqrt()
    }
}

/// The tiles of the ground with the most structure.
pub(super) fn tiles_of(image: &Luma<'_>, ground: &Ground, noise_levels: f64) -> Vec<Tile> {
    let first_row = ground.top.max(BORDER + 1);
    let rows = (first_row..(image.height_px.saturating_sub(HEIGHT + BORDER + 1))).step_by(HEIGHT);
    let last_column = image.width_px.saturating_sub(WIDTH + BORDER + 1);
    let mut bands: Vec<Vec<(usize, usize, [f64; 2])>> = vec![Vec::new(); BANDS];
    for row in rows {
        for column in (BORDER + 1..last_column).step_by(WIDTH) {
            let band = column * BANDS / image.width_px;
            bands[band].push((column, row, rough_structure(image, column, row)));
        }
    }
    let mut chosen = Vec::new();
    for mut band in bands {
        for (axis, count) in [(0, BEST_ACROSS), (1, BEST_DOWN)] {
            band.sort_by(|a, b| b.2[axis].total_cmp(&a.2[axis]));
            let kept = band.iter().take(count);
            let enough = kept
                .filter(|(.., structure)| structure[axis] > MIN_STRUCTURE * noise_levels.powi(2));
            let places: Vec<_> = enough.map(|&(column, row, _)| (column, row)).collect();
            band.retain(|&(column, row, _)| !places.contains(&(column, row)));
            chosen.extend(places);
        }
    }
    let made = chosen.into_iter();
    made.filter_map(|place| Tile::of(image, place, ground, noise_levels))
        .collect()
}

/// Sums of the squares of the slopes right and down.
fn rough_structure(image: &Luma<'_>, left: usize, top: usize) -> [f64; 2] {
    let mut sums = [0_u64; 2];
    for row in top..top + HEIGHT {
        let [above, here, below] = [row - 1, row, row + 1].map(|row| image.row(row));
        for column in left..left + WIDTH {
            let across = i32::from(here[column + 1]) - i32::from(here[column - 1]);
            let down = i32::from(below[column]) - i32::from(above[column]);
            sums[0] += (across * across) as u64;
            sums[1] += (down * down) as u64;
        }
    }
    sums.map(|sum| sum as f64 / 4.0)
}

impl Tile {
    fn of(
        image: &Luma<'_>,
        (left, top): (usize, usize),
        ground: &Ground,
        noise_levels: f64,
    ) -> Option<Self> {
        let (wide, high) = (WIDTH + 2, HEIGHT + 2);
        let around = blurred(image, [left as f64 - 1.0, top as f64 - 1.0], [wide, high])?;
        let at = |column: usize, row: usize| around[row * wide + column];
        let places = (0..HEIGHT).flat_map(|row| (0..WIDTH).map(move |column| (column, row)));
        let mut light: Vec<[f32; 3]> = places
            .map(|(x, y)| {
                [
                    at(x + 1, y + 1),
                    (at(x + 2, y + 1) - at(x, y + 1)) / 2.0,
                    (at(x + 1, y + 2) - at(x + 1, y)) / 2.0,
                ]
            })
            .collect();
        let count = light.len() as f32;
        let sums = light.iter().fold([0.0; 3], |sums: [f32; 3], values| {
            std::array::from_fn(|i| sums[i] + values[i])
        });
        for values in &mut light {
            for (value, sum) in values.iter_mut().zip(sums) {
                *value -= sum / count;
            }
        }
        let product = |light: &[[f32; 3]], i: usize, k: usize| -> f64 {
            let products = light.iter().map(|values| f64::from(values[i] * values[k]));
            products.sum()
        };
        let power = product(&light, 0, 0) + 1e-6;
        for slope in [1, 2] {
            let explained = (product(&light, 0, slope) / power) as f32;
            for values in &mut light {
                values[slope] -= explained * values[0];
            }
        }
        let structure = [(1, 1), (1, 2), (2, 2)].map(|(i, k)| product(&light, i, k));
        let variance = noise_levels * noise_levels * SHARED;
        let tells = certainties([structure[0], structure[2]], variance, noise_levels).into();
        let middle_px = DVec2::new(left as f64, top as f64)
            + DVec2::new(WIDTH as f64 - 1.0, HEIGHT as f64 - 1.0) / 2.0;
        let camera = &ground.camera;
        let direction = camera.image_of(middle_px).extend(1.0);
        let place_px = |motion| ground.place_px(direction, middle_px, &motion);
        let slopes = ground::slopes(camera, place_px);
        Some(Self {
            left,
            top,
            middle_px,
            direction,
            slopes: [slopes.map(|slope| slope.x), slopes.map(|slope| slope.y)],
            light,
            power,
            structure,
            noise_levels,
            tells,
        })
    }

    /// Measures the tile from its place moved by `shift_px`; `None` beyond the image's edge, or if the image does not resemble the tile
    /// there.
    pub(super) fn told(&self, image: &Luma<'_>, shift_px: DVec2) -> Option<Told> {
        let place = [self.left as f64 + shift_px.x, self.top as f64 + shift_px.y];
        let found = blurred(image, place, [WIDTH, HEIGHT])?;
        // Sums of the light there, of the squared light, and of the products with the tile.
        let mut sums = [0.0_f32; 5];
        let mean = found.iter().sum::<f32>() / found.len() as f32;
        for (found, tile) in found.iter().zip(&self.light) {
            let found = found - mean;
            sums[1] += found * found;
            for (sum, value) in sums[2..].iter_mut().zip(tile) {
                *sum += found * value;
            }
        }
        let [_, square, with_light, across, down] = sums.map(f64::from);
        let gain = with_light / self.power;
        let correlation = with_light / (self.power * square + 1e-6).sqrt();
        if correlation < MIN_CORRELATION {
            return None;
        }
        // found = gain (light - step . slope): after a motion by `step`, a pixel has the light from `step` before it.
        let [xx, xy, yy] = self.structure;
        let ridge = 1e-3 * (xx + yy) + 1e-9;
        let pull = DVec2::new(-across, -down) / gain;
        let determinant = (xx + ridge) * (yy + ridge) - xy * xy;
        let best_px = DVec2::new(
            (yy + ridge) * pull.x - xy * pull.y,
            (xx + ridge) * pull.y - xy * pull.x,
        ) / determinant;
        let explained = gain * gain * (self.power + pull.dot(best_px));
        let rest = (square - explained).max(0.0) / (found.len() - 4) as f64;
        let variance = rest.max(self.noise_levels.powi(2)) * SHARED / (gain * gain);
        let axis = DVec2::from_angle(0.5 * (2.0 * xy).atan2(xx - yy));
        let axes = [axis, axis.perp()];
        let along =
            |axis: DVec2| axis.x * axis.x * xx + 2.0 * axis.x * axis.y * xy + axis.y * axis.y * yy;
        let [first, second] = certainties(axes.map(along), variance, self.noise_levels);
        Some(Told {
            best_px,
            axes: [(axes[0], first), (axes[1], second)],
        })
    }
}

/// Certainties along two axes with this structure, for a pixel variance, 1 / square pixels.
fn certainties(structures: [f64; 2], variance: f64, noise_levels: f64) -> [f64; 2] {
    let most = structures[0].max(structures[1]);
    structures.map(|structure| {
        // Noise and compression have such slopes too.
        if structure < (MIN_STRUCTURE / 2.0 * noise_levels.powi(2)).max(MIN_AXIS_RATIO * most) {
            0.0
        } else {
            (variance / structure + MIN_SD_PX * MIN_SD_PX).recip()
        }
    })
}

/// An image part with subpixel origin, blurred by one, two, one quarters both ways; `None` beyond the edge.
fn blurred(
    image: &Luma<'_>,
    [left, top]: [f64; 2],
    [width, height]: [usize; 2],
) -> Option<Vec<f32>> {
    let reach = 1.0;
    let inside = left >= reach
        && top >= reach
        && left + (width + 2) as f64 <= image.width_px as f64
        && top + (height + 2) as f64 <= image.height_px as f64;
    if !inside {
        return None;
    }
    // Interpolation and blur together: four taps.
    let taps = |part: f64| {
        let part = part as f32;
        [
            (1.0 - part) / 4.0,
            (2.0 - part) / 4.0,
            (1.0 + part) / 4.0,
            part / 4.0,
        ]
    };
    let (column, row) = (left as usize - 1, top as usize - 1);
    let [a, b, c, d] = taps(left.fract());
    let mut across = Vec::with_capacity(width * (height + 3));
    for row in row..row + height + 3 {
        let line = &image.row(row)[column..column + width + 3];
        across.extend(line.windows(4).map(|pixels| {
            let [p, q, r, s] = [0, 1, 2, 3].map(|i| f32::from(pixels[i]));
            a * p + b * q + c * r + d * s
        }));
    }
    let [a, b, c, d] = taps(top.fract());
    let mut both = Vec::with_capacity(width * height);
    for row in 0..height {
        let line = |i: usize| &across[(row + i) * width..(row + i + 1) * width];
        let lines = line(0).iter().zip(line(1)).zip(line(2)).zip(line(3));
        both.extend(lines.map(|(((p, q), r), s)| a * p + b * q + c * r + d * s));
    }
    Some(both)
}
