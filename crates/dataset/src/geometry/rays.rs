//! Lines of sight, and where they meet.

mod epipolar_line;

use glam::{DMat3, DVec2, DVec3};

use crate::geometry::camera::Camera;

pub use epipolar_line::{EpipolarLine, LAG_STEP_S, across_sd_px};

/// A line of sight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Origin, metres.
    pub origin_m: DVec3,
    /// Unit vector along it.
    pub direction: DVec3,
}

impl Ray {
    /// From a camera through a pixel: where light arrives from.
    pub fn through(camera: &Camera, pixel: DVec2) -> Self {
        Self {
            origin_m: camera.center_ecef_m,
            direction: camera.ray(pixel),
        }
    }

    /// Position of the point along the ray, metres; negative behind its origin.
    pub fn along_m(&self, point_m: DVec3) -> f64 {
        (point_m - self.origin_m).dot(self.direction)
    }

    /// Distance of the point from the ray's line, metres.
    pub fn off_m(&self, point_m: DVec3) -> f64 {
        (point_m - self.origin_m).cross(self.direction).length()
    }
}

/// The point with the smallest sum of squared distances to the rays, weighted by the inverse square of the distance along them, which makes
/// it the smallest sum of squared angles. `None` for fewer than two rays, for parallel ones, and where the lines meet behind a ray's
/// origin, which a camera cannot see.
pub fn meeting_point_m(rays: &[Ray]) -> Option<DVec3> {
    let &[reference, _, ..] = rays else {
        return None;
    };
    let mut weights = vec![1.0; rays.len()];
    let mut point_m = reference.origin_m;
    for _ in 0..3 {
        let mut normal = DMat3::ZERO;
        let mut right = DVec3::ZERO;
        for (ray, &weight) in rays.iter().zip(&weights) {
            let direction = ray.direction;
            let across = DMat3::IDENTITY
                - DMat3::from_cols(
                    direction * direction.x,
                    direction * direction.y,
                    direction * direction.z,
                );
            normal += across * weight;
            // Relative to the first origin: ECEF coordinates themselves would waste seven digits.
            right += across * (ray.origin_m - reference.origin_m) * weight;
        }
        let trace = normal.x_axis.x + normal.y_axis.y + normal.z_axis.z;
        if normal.determinant().abs() <= 1e-14 * trace.powi(3) {
            return None;
        }
        point_m = reference.origin_m + normal.inverse() * right;
        let nearest_m = rays
            .iter()
            .map(|ray| ray.origin_m.distance(point_m))
            .fold(f64::INFINITY, f64::min);
        for (weight, ray) in weights.iter_mut().zip(rays) {
            *weight = (nearest_m / ray.origin_m.distance(point_m)).powi(2);
        }
    }
    // NaN is not in front, either.
    let in_front = rays.iter().all(|ray| ray.along_m(point_m) > 0.0);
    in_front.then_some(point_m)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ray(origin_m: [f64; 3], direction: [f64; 3]) -> Ray {
        Ray {
            origin_m: origin_m.into(),
            direction: DVec3::from(direction).normalize(),
        }
    }

    #[test]
    fn parallel_rays_and_a_single_one_meet_nowhere() {
        let [a, b] = [[0.0; 3], [1.0, 0.0, 0.0]].map(|origin| ray(origin, [0.0, 0.6, 0.8]));
        assert_eq!(meeting_point_m(&[a, b]), None);
        assert_eq!(meeting_point_m(&[a]), None);
    }

    #[test]
    fn skew_rays_meet_halfway_when_both_origins_are_equally_far() {
        let rays = [
            ray([-10.0, 0.0, 0.0], [1.0, 0.0, 0.0]),
            ray([0.0, -10.0, 2.0], [0.0, 1.0, 0.0]),
        ];
        let point_m = meeting_point_m(&rays).unwrap();
        assert!(
            point_m.abs_diff_eq(DVec3::new(0.0, 0.0, 1.0), 1e-9),
            "{point_m}"
        );
        assert!((rays[0].along_m(point_m) - 10.0).abs() < 1e-9);
        assert!((rays[0].off_m(point_m) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn rays_that_part_meet_behind_their_origins_and_so_nowhere() {
        let apart = [
            ray([-300.0, 0.0, 0.0], [-0.01, 1.0, 0.0]),
            ray([300.0, 0.0, 0.0], [0.01, 1.0, 0.0]),
        ];
        assert_eq!(meeting_point_m(&apart), None);
        let together = [
            ray([-300.0, 0.0, 0.0], [0.01, 1.0, 0.0]),
            ray([300.0, 0.0, 0.0], [-0.01, 1.0, 0.0]),
        ];
        let point_m = meeting_point_m(&together).unwrap();
        assert!((point_m.y - 30_000.0).abs() < 1e-6, "{point_m}");
    }
}
