//! Visible part of a silhouette: convex polygons, clipped in space and counted on a sample grid.

use glam::{DVec2, DVec3};

/// A half-space in camera axes: the points `p` with `normal . p >= offset`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct HalfSpace {
    /// Unit normal that points to the inside.
    pub(crate) normal: DVec3,
    /// Distance of the bounding plane from the camera along the normal, metres.
    pub(crate) offset_m: f64,
}

impl HalfSpace {
    /// Height over the bounding plane, m; negative outside.
    pub(crate) fn height_m(&self, point: DVec3) -> f64 {
        self.normal.dot(point) - self.offset_m
    }

    /// Clips a convex polygon (Sutherland and Hodgman 1974); empty if no part is inside.
    pub(crate) fn clip(&self, polygon: &[DVec3]) -> Vec<DVec3> {
        let mut kept = Vec::with_capacity(polygon.len() + 1);
        for (k, &from) in polygon.iter().enumerate() {
            let to = polygon[(k + 1) % polygon.len()];
            let (height_from, height_to) = (self.height_m(from), self.height_m(to));
            if height_from >= 0.0 {
                kept.push(from);
            }
            if (height_from >= 0.0) != (height_to >= 0.0) {
                kept.push(from.lerp(to, height_from / (height_from - height_to)));
            }
        }
        kept
    }
}

/// A grid of samples over a rectangle of the image plane. Each sample collects marks from the polygons that cover it.
pub(crate) struct SampleGrid {
    origin_px: DVec2,
    step_px: f64,
    columns: usize,
    marks: Vec<u8>,
}

impl SampleGrid {
    /// A grid over the rectangle from `low` to `high` with `longer_side` samples along its longer side.
    pub(crate) fn over(low: DVec2, high: DVec2, longer_side: usize) -> Self {
        let size = high - low;
        let step_px = size.max_element() / longer_side as f64;
        let samples = |length: f64| ((length / step_px).ceil() as usize).clamp(1, longer_side);
        let (columns, rows) = (samples(size.x), samples(size.y));
        Self {
            origin_px: low,
            step_px,
            columns,
            marks: vec![0; columns * rows],
        }
    }

    /// Adds `mark` (a set of bits) to all samples inside a convex polygon.
    pub(crate) fn fill(&mut self, polygon: &[DVec2], mark: u8) {
        let row_of = |y: f64| {
            ((y - self.origin_px.y) / self.step_px - 0.5)
                .ceil()
                .max(0.0) as usize
        };
        let heights = || polygon.iter().map(|corner| corner.y);
        let first_row = row_of(heights().fold(f64::INFINITY, f64::min));
        let end_row = row_of(heights().fold(f64::NEG_INFINITY, f64::max)).saturating_add(1);
        let lines = self.marks.chunks_exact_mut(self.columns).enumerate();
        for (row, line) in lines.take(end_row).skip(first_row) {
            let y = self.origin_px.y + (row as f64 + 0.5) * self.step_px;
            let Some((left, right)) = span_at(polygon, y) else {
                continue;
            };
            let column = |x: f64| {
                let exact = (x - self.origin_px.x) / self.step_px - 0.5;
                (exact.ceil().max(0.0) as usize).min(line.len())
            };
            let (first, end) = (column(left), column(right));
            for sample in &mut line[first..end.max(first)] {
                *sample |= mark;
            }
        }
    }

    /// Number of samples whose position and marks satisfy `counts`.
    pub(crate) fn count(&self, counts: impl Fn(DVec2, u8) -> bool) -> usize {
        let place = |index: usize| {
            let (row, column) = (index / self.columns, index % self.columns);
            self.origin_px + (DVec2::new(column as f64, row as f64) + 0.5) * self.step_px
        };
        self.marks
            .iter()
            .enumerate()
            .filter(|(index, mark)| counts(place(*index), **mark))
            .count()
    }
}

/// Points where the line at height `y` enters and leaves a convex polygon.
fn span_at(polygon: &[DVec2], y: f64) -> Option<(f64, f64)> {
    let mut span: Option<(f64, f64)> = None;
    for (k, from) in polygon.iter().enumerate() {
        let to = polygon[(k + 1) % polygon.len()];
        if (from.y <= y) != (to.y <= y) {
            let x = from.x + (to.x - from.x) * (y - from.y) / (to.y - from.y);
            span = Some(span.map_or((x, x), |(left, right)| (left.min(x), right.max(x))));
        }
    }
    span
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_triangle_covers_half_of_its_box() {
        let (low, high) = (DVec2::new(-3.0, 2.0), DVec2::new(7.0, 12.0));
        let mut grid = SampleGrid::over(low, high, 400);
        grid.fill(&[low, DVec2::new(high.x, low.y), high], 1);
        let share = grid.count(|_, mark| mark == 1) as f64 / grid.count(|_, _| true) as f64;
        assert!((share - 0.5).abs() < 0.002, "{share}");
    }

    #[test]
    fn overlapping_polygons_are_counted_once_and_neighbours_leave_no_gap() {
        let corners =
            [(0.0, 0.0), (8.0, 0.0), (8.0, 4.0), (0.0, 4.0)].map(|(x, y)| DVec2::new(x, y));
        let mut grid = SampleGrid::over(corners[0], corners[2], 64);
        grid.fill(&corners[..3], 1);
        grid.fill(&[corners[0], corners[2], corners[3]], 1);
        grid.fill(&corners, 1);
        assert_eq!(grid.count(|_, mark| mark == 1), 64 * 32);
    }

    #[test]
    fn clipping_keeps_what_is_above_the_plane() {
        let above = HalfSpace {
            normal: DVec3::Z,
            offset_m: 1.0,
        };
        let triangle = [
            DVec3::ZERO,
            DVec3::new(1.0, 0.0, 2.0),
            DVec3::new(-1.0, 0.0, 2.0),
        ];
        let kept = above.clip(&triangle);
        assert_eq!(kept.len(), 4);
        assert!(
            kept.iter().all(|point| above.height_m(*point) > -1e-12),
            "{kept:?}"
        );
        assert!(
            above
                .clip(&triangle.map(|point| point - DVec3::Z * 3.0))
                .is_empty()
        );
    }
}
