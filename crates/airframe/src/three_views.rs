//! Drawings of a mesh from ahead, from the side and from above, without perspective: for people, and to compare silhouettes.

use glam::{DVec2, DVec3};

use crate::aircraft_type::AircraftType;
use crate::{Configuration, Material, Mesh};

/// Light of the drawings: from above, ahead and the left of the viewer, body axes.
const TO_LIGHT: DVec3 = DVec3::new(0.45, -0.35, -0.82);
const BACKGROUND: [u8; 3] = [236, 240, 245];
/// Samples along each side of a pixel.
const SAMPLES: usize = 3;
/// Space around a drawing, metres.
const MARGIN_M: f64 = 1.5;

/// Direction of a view.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum View {
    /// View from ahead.
    Ahead,
    /// View from the left side.
    Side,
    /// View from above.
    Above,
}

impl View {
    /// Position in the drawing (right and down) and depth, metres.
    fn place(self, body: DVec3) -> (DVec2, f64) {
        let DVec3 { x, y, z } = body;
        match self {
            Self::Ahead => (DVec2::new(-y, z), -x),
            Self::Side => (DVec2::new(-x, z), y),
            Self::Above => (DVec2::new(-x, -y), z),
        }
    }
}

/// An image in RGB, row by row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Drawing {
    /// Width, pixels.
    pub width_px: usize,
    /// Height, pixels.
    pub height_px: usize,
    /// Three bytes per pixel.
    pub rgb: Vec<u8>,
}

impl Drawing {
    fn blank(width_px: usize, height_px: usize) -> Self {
        Self {
            width_px,
            height_px,
            rgb: BACKGROUND.repeat(width_px * height_px),
        }
    }

    fn put(&mut self, other: &Self, left_px: usize, top_px: usize) {
        for (row, line) in other.rgb.chunks_exact(3 * other.width_px).enumerate() {
            let start = 3 * ((top_px + row) * self.width_px + left_px);
            self.rgb[start..start + line.len()].copy_from_slice(line);
        }
    }
}

/// The nearest face at each sample of a rectangle, lengths in metres; the rectangle is given by its corners in the view.
struct Samples {
    columns: usize,
    depth: Vec<f64>,
    color: Vec<Option<[f64; 3]>>,
}

impl Samples {
    fn of(mesh: &Mesh, view: View, (low, high): (DVec2, DVec2), step_m: f64) -> Self {
        let size = ((high - low) / step_m).ceil();
        let (columns, rows) = (size.x as usize, size.y as usize);
        let mut samples = Self {
            columns,
            depth: vec![f64::INFINITY; columns * rows],
            color: vec![None; columns * rows],
        };
        for triangle in &mesh.triangles {
            let corners = mesh.corners(triangle);
            let placed = corners.map(|corner| view.place(corner));
            let [a, b, c] = placed.map(|(at, _)| (at - low) / step_m - 0.5);
            let area = (b - a).perp_dot(c - a);
            if area == 0.0 {
                continue;
            }
            let normal = (corners[1] - corners[0])
                .cross(corners[2] - corners[0])
                .normalize_or_zero();
            let color = shade(triangle.material, normal);
            let (first, last) = (a.min(b).min(c).ceil(), a.max(b).max(c).floor());
            for row in first.y.max(0.0) as usize..=(last.y.max(0.0) as usize).min(rows - 1) {
                for column in
                    first.x.max(0.0) as usize..=(last.x.max(0.0) as usize).min(columns - 1)
                {
                    let at = DVec2::new(column as f64, row as f64);
                    let weights = [
                        (c - b).perp_dot(at - b) / area,
                        (a - c).perp_dot(at - c) / area,
                        (b - a).perp_dot(at - a) / area,
                    ];
                    if weights.iter().any(|weight| *weight < 0.0) {
                        continue;
                    }
                    let depth: f64 = weights.iter().zip(&placed).map(|(w, (_, d))| w * d).sum();
                    let index = row * columns + column;
                    if depth < samples.depth[index] {
                        samples.depth[index] = depth;
                        samples.color[index] = Some(color);
                    }
                }
            }
        }
        samples
    }
}

/// Linear colour of a face.
fn shade(material: Material, normal: DVec3) -> [f64; 3] {
    let light = 0.35 + 0.65 * normal.dot(TO_LIGHT.normalize()).max(0.0);
    material
        .reflectance()
        .map(|reflectance| f64::from(reflectance) * light)
}

/// The rectangle that a mesh fills in a view, metres from the centre of gravity.
fn extent(mesh: &Mesh, view: View) -> (DVec2, DVec2) {
    let places = mesh.vertices.iter().map(|&vertex| view.place(vertex).0);
    places.fold(
        (DVec2::INFINITY, DVec2::NEG_INFINITY),
        |(low, high), place| (low.min(place), high.max(place)),
    )
}

/// Draws a mesh at `px_per_m` pixels per metre, with a margin.
pub fn draw(mesh: &Mesh, view: View, px_per_m: f64) -> Drawing {
    let (low, high) = extent(mesh, view);
    let (low, high) = (low - MARGIN_M, high + MARGIN_M);
    let size = ((high - low) * px_per_m).ceil();
    let (width_px, height_px) = (size.x as usize, size.y as usize);
    let step_m = 1.0 / (px_per_m * SAMPLES as f64);
    let whole = (low, low + size / px_per_m);
    let samples = Samples::of(mesh, view, whole, step_m);
    let background = BACKGROUND.map(|value| (f64::from(value) / 255.0).powf(2.2));
    let mut drawing = Drawing::blank(width_px, height_px);
    for (index, pixel) in drawing.rgb.chunks_exact_mut(3).enumerate() {
        let (row, column) = (index / width_px, index % width_px);
        let mut sum = [0.0; 3];
        for sample in 0..SAMPLES * SAMPLES {
            let at = (row * SAMPLES + sample / SAMPLES) * samples.columns
                + column * SAMPLES
                + sample % SAMPLES;
            let color = samples.color.get(at).copied().flatten();
            for (sum, value) in sum.iter_mut().zip(color.unwrap_or(background)) {
                *sum += value;
            }
        }
        for (byte, sum) in pixel.iter_mut().zip(sum) {
            let mean: f64 = sum / (SAMPLES * SAMPLES) as f64;
            *byte = (mean.powf(1.0 / 2.2) * 255.0).round() as u8;
        }
    }
    drawing
}

/// Three views of types side by side at one scale, a row per type: from ahead and from the left, and from above.
pub fn three_views(
    types: &[&AircraftType],
    configuration: Configuration,
    px_per_m: f64,
) -> Drawing {
    let rows: Vec<[Drawing; 3]> = types
        .iter()
        .map(|of| {
            let mesh = of.mesh(configuration);
            [View::Ahead, View::Side, View::Above].map(|view| draw(&mesh, view, px_per_m))
        })
        .collect();
    let widest = |view: usize| rows.iter().map(|row| row[view].width_px).max().unwrap_or(0);
    let widths = [widest(0), widest(1), widest(2)];
    let height_of = |row: &[Drawing; 3]| row.iter().map(|one| one.height_px).max().unwrap_or(0);
    let mut drawing = Drawing::blank(widths.iter().sum(), rows.iter().map(height_of).sum());
    let mut top_px = 0;
    for row in &rows {
        let height_px = height_of(row);
        let mut left_px = 0;
        for (view, width_px) in row.iter().zip(widths) {
            drawing.put(
                view,
                left_px + (width_px - view.width_px) / 2,
                top_px + (height_px - view.height_px) / 2,
            );
            left_px += width_px;
        }
        top_px += height_px;
    }
    drawing
}

/// Intersection over union of two meshes' silhouettes in a view, sampled every `step_m` metres.
#[cfg(test)]
pub(crate) fn overlap(one: &Mesh, other: &Mesh, view: View, step_m: f64) -> f64 {
    let (low, high) = extent(one, view);
    let (other_low, other_high) = extent(other, view);
    let whole = (low.min(other_low), high.max(other_high));
    let [one, other] = [one, other].map(|mesh| Samples::of(mesh, view, whole, step_m).color);
    let (mut both, mut either) = (0.0, 0.0);
    for (one, other) in one.iter().zip(&other) {
        both += f64::from(u8::from(one.is_some() && other.is_some()));
        either += f64::from(u8::from(one.is_some() || other.is_some()));
    }
    both / either
}
