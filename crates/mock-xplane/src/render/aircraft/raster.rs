//! Rasterises triangles: a z-buffer with many samples per pixel, box-filtered.
//!
//! Corners come in 64-bit pixel coordinates and samples are on a dense sub-pixel lattice, so that a small aircraft's centre is accurate to
//! a few hundredths of a pixel. Samples store the triangle that they show; light is looked up when they are averaged.

use glam::{DVec2, Vec4};

/// A triangle in the image.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ScreenTriangle {
    /// Corners, pixels; clockwise or counter-clockwise.
    pub(crate) pixels: [DVec2; 3],
    /// Nearness of the corners: any quantity that grows towards the camera and is linear in the image, such as 1/depth.
    pub(crate) nearness: [f64; 3],
    /// Contribution of every sample of the triangle.
    pub(crate) light: Vec4,
}

/// A rectangle of filtered pixels.
pub(crate) struct Patch {
    /// Leftmost column and topmost row.
    pub(crate) x: usize,
    pub(crate) y: usize,
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Part of each pixel that is covered, 0 to 1, row by row.
    pub(crate) coverage: Vec<f32>,
    /// Light of each pixel: the triangles' light times their share of the pixel.
    pub(crate) light: Vec<Vec4>,
}

/// Memory that is reused from frame to frame.
#[derive(Default)]
pub(crate) struct Scratch {
    nearness: Vec<f32>,
    triangle: Vec<u32>,
}

/// Maximum samples per patch; determines the density of the lattice.
const MAX_SAMPLES: f64 = 200_000.0;
/// Rows of samples are shifted against each other by this share of their spacing (the golden ratio spreads them evenly), so that
/// upright edges, of which an aircraft has many, fall between samples at different positions.
const ROW_SHIFT: f64 = 0.618_033_988_749_895;
/// Lattice of the smallest and of the largest aircraft, samples along a pixel's side.
const DENSEST: usize = 48;
const COARSEST: usize = 2;

/// Draws triangles into an image of this size; `None` if the image stays empty.
pub(crate) fn draw(
    triangles: &[ScreenTriangle],
    picture: (usize, usize),
    scratch: &mut Scratch,
) -> Option<Patch> {
    let (min, max) = triangles
        .iter()
        .flat_map(|t| t.pixels)
        .fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(min, max), p| {
            (min.min(p), max.max(p))
        });
    // Pixel n covers n - 0.5 to n + 0.5.
    let x0 = (min.x + 0.5).floor().max(0.0);
    let y0 = (min.y + 0.5).floor().max(0.0);
    let x1 = (max.x + 0.5).floor().min(picture.0 as f64 - 1.0);
    let y1 = (max.y + 0.5).floor().min(picture.1 as f64 - 1.0);
    if !(x0 <= x1 && y0 <= y1) {
        return None;
    }
    let (width, height) = ((x1 - x0) as usize + 1, (y1 - y0) as usize + 1);
    let lattice =
        ((MAX_SAMPLES / (width * height) as f64).sqrt() as usize).clamp(COARSEST, DENSEST);
    let mut samples = Samples::new(scratch, width * lattice, height * lattice);
    for (index, triangle) in triangles.iter().enumerate() {
        let corners = triangle
            .pixels
            .map(|p| (p - DVec2::new(x0, y0) + 0.5) * lattice as f64);
        samples.fill(corners, triangle.nearness, index as u32 + 1);
    }
    let (coverage, light) = samples.average(triangles, lattice);
    Some(Patch {
        x: x0 as usize,
        y: y0 as usize,
        width,
        height,
        coverage,
        light,
    })
}

struct Samples<'a> {
    width: usize,
    height: usize,
    nearness: &'a mut [f32],
    /// 0 for none, else the triangle's index + 1.
    triangle: &'a mut [u32],
}

impl<'a> Samples<'a> {
    fn new(scratch: &'a mut Scratch, width: usize, height: usize) -> Self {
        scratch.nearness.clear();
        scratch.nearness.resize(width * height, f32::NEG_INFINITY);
        scratch.triangle.clear();
        scratch.triangle.resize(width * height, 0);
        Self {
            width,
            height,
            nearness: &mut scratch.nearness,
            triangle: &mut scratch.triangle,
        }
    }

    /// Draws one triangle; sample (i, j) is at (i + shift, j + 0.5) with its row's shift between 0 and 1.
    fn fill(&mut self, corners: [DVec2; 3], nearness: [f64; 3], mark: u32) {
        let [a, b, c] = corners;
        let (ab, ac) = (b - a, c - a);
        let area = ab.perp_dot(ac);
        if area == 0.0 {
            return;
        }
        // Gradient of the nearness over the image.
        let (n_ab, n_ac) = (nearness[1] - nearness[0], nearness[2] - nearness[0]);
        let slope = DVec2::new(n_ab * ac.y - n_ac * ab.y, n_ac * ab.x - n_ab * ac.x) / area;
        let top = corners.iter().fold(f64::INFINITY, |y, p| y.min(p.y));
        let bottom = corners.iter().fold(f64::NEG_INFINITY, |y, p| y.max(p.y));
        let first = (top - 0.5).ceil().max(0.0) as usize;
        let end = ((bottom - 0.5).ceil().max(0.0) as usize).min(self.height);
        for row in first..end {
            let y = row as f64 + 0.5;
            let shift = (row as f64 * ROW_SHIFT).fract();
            let (mut left, mut right) = (f64::INFINITY, f64::NEG_INFINITY);
            for (p, q) in [(a, b), (b, c), (c, a)] {
                if (p.y <= y) != (q.y <= y) {
                    let x = p.x + (q.x - p.x) * ((y - p.y) / (q.y - p.y));
                    left = left.min(x);
                    right = right.max(x);
                }
            }
            let from = (left - shift).ceil().max(0.0) as usize;
            let to = ((right - shift).ceil().max(0.0) as usize).min(self.width);
            if from >= to {
                continue;
            }
            let start = (nearness[0] + slope.dot(DVec2::new(from as f64 + shift, y) - a)) as f32;
            let step = slope.x as f32;
            let span = row * self.width + from..row * self.width + to;
            let samples = self.nearness[span.clone()]
                .iter_mut()
                .zip(&mut self.triangle[span]);
            for (i, (nearest, shown)) in samples.enumerate() {
                let here = start + step * i as f32;
                if here > *nearest {
                    *nearest = here;
                    *shown = mark;
                }
            }
        }
    }

    fn average(&self, triangles: &[ScreenTriangle], lattice: usize) -> (Vec<f32>, Vec<Vec4>) {
        let width = self.width / lattice;
        let share = 1.0 / (lattice * lattice) as f32;
        let mut coverage = vec![0.0; self.triangle.len() / (lattice * lattice)];
        let mut light = vec![Vec4::ZERO; coverage.len()];
        for (row, line) in self.triangle.chunks_exact(self.width).enumerate() {
            let base = row / lattice * width;
            for (column, samples) in line.chunks_exact(lattice).enumerate() {
                // Neighbours mostly show the same triangle.
                for run in samples.chunk_by(|a, b| a == b).filter(|run| run[0] > 0) {
                    let part = share * run.len() as f32;
                    coverage[base + column] += part;
                    light[base + column] += triangles[run[0] as usize - 1].light * part;
                }
            }
        }
        (coverage, light)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(center: DVec2, half: f64, nearness: f64, light: f32) -> [ScreenTriangle; 2] {
        let corner = |x: f64, y: f64| center + DVec2::new(x, y) * half;
        let triangle = |pixels| ScreenTriangle {
            pixels,
            nearness: [nearness; 3],
            light: Vec4::splat(light),
        };
        [
            triangle([corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0)]),
            triangle([corner(-1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)]),
        ]
    }

    #[test]
    fn coverage_of_every_pixel_is_its_overlap_with_the_shape() {
        for shift in [0.0, 0.13, 0.25, 0.5, 0.77] {
            let center = DVec2::new(10.0 + shift, 8.0 - shift / 2.0);
            let patch = draw(
                &square(center, 1.3, 0.0, 1.0),
                (40, 30),
                &mut Scratch::default(),
            )
            .unwrap();
            let overlap = |pixel: usize, center: f64| {
                let (from, to) = (pixel as f64 - 0.5, pixel as f64 + 0.5);
                ((center + 1.3).min(to) - (center - 1.3).max(from)).max(0.0)
            };
            for (i, &found) in patch.coverage.iter().enumerate() {
                let (x, y) = (patch.x + i % patch.width, patch.y + i / patch.width);
                let expected = overlap(x, center.x) * overlap(y, center.y);
                assert!(
                    (f64::from(found) - expected).abs() < 0.015,
                    "{found} instead of {expected} at {x} {y}"
                );
            }
        }
    }

    #[test]
    fn the_nearer_triangle_hides_the_farther_in_any_order() {
        let center = DVec2::splat(10.0);
        let (near, far) = (square(center, 3.0, 2.0, 5.0), square(center, 3.0, 1.0, 7.0));
        for triangles in [[near, far].concat(), [far, near].concat()] {
            let patch = draw(&triangles, (20, 20), &mut Scratch::default()).unwrap();
            let middle = (10 - patch.y) * patch.width + 10 - patch.x;
            assert!(
                (patch.light[middle].x - 5.0).abs() < 1e-4,
                "{}",
                patch.light[middle]
            );
        }
    }

    #[test]
    fn triangles_beside_the_picture_leave_no_patch_and_half_of_them_half_a_patch() {
        assert!(
            draw(
                &square(DVec2::new(-9.0, 5.0), 2.0, 0.0, 1.0),
                (20, 20),
                &mut Scratch::default()
            )
            .is_none()
        );
        let patch = draw(
            &square(DVec2::new(0.0, 10.0), 3.0, 0.0, 1.0),
            (20, 20),
            &mut Scratch::default(),
        )
        .unwrap();
        assert_eq!((patch.x, patch.width), (0, 4));
    }
}
