//! The geometric answer: with known cameras, the point nearest to the rays through the box centres.
//!
//! Needs two views; a tick that one view missed gets no answer, and the number of samples says so. A box's centre is not the centre
//! of gravity: tail and gear pull it up or down by a part of the box's size, and a detector may be off by a constant. Both are
//! corrected by a fit on the training side: per view and axis, `offset = constant + part * size`.

use dataset::camera::Camera;
use dataset::geodesy::Geodetic;
use dataset::pixel_box::PixelBox;
use glam::{DMat3, DVec2, DVec3};
use serde::{Deserialize, Serialize};

use crate::samples::Sample;

/// Where in a view's box the centre of gravity is.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct CentreOffset {
    /// Right and down, pixels.
    pub constant_px: [f64; 2],
    /// Right as a part of the width, down as a part of the height.
    pub part_of_size: [f64; 2],
}

impl CentreOffset {
    /// Fits the offset of one view. Each sample weighs by the inverse square of its box's size, because a detector's errors grow with
    /// it. Too few samples leave the centre where it is.
    pub fn fit(view: usize, camera: &Camera, training: &[&Sample]) -> Self {
        let mut fitted = Self::default();
        for axis in 0..2 {
            let rows: Vec<[f64; 2]> = training
                .iter()
                .filter_map(|sample| {
                    let seen = sample.boxes[view]?;
                    let truth = camera.project(sample.position.to_ecef())?;
                    let (centre, size) = centre_and_size(&seen);
                    (size[axis] > 0.0).then(|| [size[axis], truth[axis] - centre[axis]])
                })
                .collect();
            if let Some((constant, part)) = weighted_line(&rows) {
                fitted.constant_px[axis] = constant;
                fitted.part_of_size[axis] = part;
            }
        }
        fitted
    }

    fn centre_of_gravity_px(&self, seen: &PixelBox) -> DVec2 {
        let (centre, size) = centre_and_size(seen);
        centre + DVec2::from_array(self.constant_px) + DVec2::from_array(self.part_of_size) * size
    }
}

fn centre_and_size(seen: &PixelBox) -> (DVec2, DVec2) {
    (
        DVec2::new(seen.cx_px, seen.cy_px),
        DVec2::new(seen.width_px, seen.height_px),
    )
}

/// `y = constant + part * x` with weights `1 / x^2`, that is `y / x = constant / x + part` unweighted; `None` if x does not vary.
fn weighted_line(rows: &[[f64; 2]]) -> Option<(f64, f64)> {
    let count = rows.len() as f64;
    let mean = |f: &dyn Fn(&[f64; 2]) -> f64| rows.iter().map(f).sum::<f64>() / count;
    let (mean_inverse, mean_ratio) = (mean(&|r| 1.0 / r[0]), mean(&|r| r[1] / r[0]));
    let spread = mean(&|r| (1.0 / r[0] - mean_inverse).powi(2));
    if rows.len() < 2 || spread <= f64::EPSILON * mean_inverse.powi(2) {
        return None;
    }
    let constant = mean(&|r| (1.0 / r[0] - mean_inverse) * (r[1] / r[0] - mean_ratio)) / spread;
    Some((constant, mean_ratio - constant * mean_inverse))
}

/// The point with the smallest sum of squared distances to rays `(origin, unit direction)`, weighted by the inverse square of the
/// distance along them, which makes it the smallest sum of squared angles. `None` for fewer than two rays or parallel ones.
pub fn nearest_point(rays: &[(DVec3, DVec3)]) -> Option<DVec3> {
    let &[(reference, _), _, ..] = rays else {
        return None;
    };
    let mut weights = vec![1.0; rays.len()];
    let mut point = None;
    for _ in 0..3 {
        let mut normal = DMat3::ZERO;
        let mut right = DVec3::ZERO;
        for (&(origin, direction), &weight) in rays.iter().zip(&weights) {
            let across = DMat3::IDENTITY
                - DMat3::from_cols(
                    direction * direction.x,
                    direction * direction.y,
                    direction * direction.z,
                );
            normal += across * weight;
            // Relative to the first camera: ECEF coordinates themselves would waste seven digits.
            right += across * (origin - reference) * weight;
        }
        let trace = normal.x_axis.x + normal.y_axis.y + normal.z_axis.z;
        if normal.determinant().abs() <= 1e-14 * trace.powi(3) {
            return None;
        }
        let found = reference + normal.inverse() * right;
        let nearest = rays
            .iter()
            .map(|(origin, _)| origin.distance(found))
            .fold(f64::INFINITY, f64::min);
        for (weight, (origin, _)) in weights.iter_mut().zip(rays) {
            *weight = (nearest / origin.distance(found)).powi(2);
        }
        point = Some(found);
    }
    point
}

/// Distance to touchdown of a sample, metres; `None` if fewer than two views saw it.
pub fn predict(
    offsets: &[CentreOffset],
    cameras: &[Camera],
    sample: &Sample,
    touchdown: Geodetic,
) -> Option<f64> {
    let rays: Vec<_> = sample
        .boxes
        .iter()
        .zip(cameras.iter().zip(offsets))
        .filter_map(|(seen, (camera, offset))| {
            Some((
                camera.center_ecef_m,
                camera.ray(offset.centre_of_gravity_px(seen.as_ref()?)),
            ))
        })
        .collect();
    Some(
        Geodetic::from_ecef(nearest_point(&rays)?)
            .lat_lon()
            .distance_m(touchdown.lat_lon()),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::{DistanceRange, Samples};
    use crate::synthetic::SyntheticCorpus;
    use dataset::splits::Side;

    #[test]
    fn noise_free_boxes_give_the_exact_distance_of_held_out_trajectories() {
        let folder = tempfile::tempdir().unwrap();
        let corpus = SyntheticCorpus {
            centre_noise_px: 0.0,
            size_noise_px: 0.0,
            ..SyntheticCorpus::tiny()
        }
        .write(folder.path())
        .unwrap();
        let samples = Samples::read(
            &corpus,
            None,
            DistanceRange {
                min_nm: 0.05,
                max_nm: None,
            },
        )
        .unwrap();
        let training = samples.of_side(Side::Train);
        let offsets: Vec<_> = samples
            .cameras
            .iter()
            .enumerate()
            .map(|(v, camera)| CentreOffset::fit(v, camera, &training))
            .collect();
        // The stand-in's boxes are centred 1 m above the centre of gravity of a 12.5 m high aircraft.
        assert!(
            (offsets[0].part_of_size[1] - 1.0 / 12.5).abs() < 1e-9,
            "{offsets:?}"
        );
        let mut dual = 0;
        for sample in samples.of_side(Side::Test) {
            let touchdown = samples.scenarios[sample.scenario].touchdown;
            match predict(&offsets, &samples.cameras, sample, touchdown) {
                Some(found) => {
                    dual += 1;
                    assert!(
                        (found - sample.dtd_m).abs() < 1e-3,
                        "{found} {}",
                        sample.dtd_m
                    );
                }
                None => assert_eq!(sample.detections(), 1, "only a single view has no answer"),
            }
        }
        assert!(dual > 50, "{dual}");
    }

    #[test]
    fn parallel_rays_meet_nowhere() {
        let direction = DVec3::new(0.0, 0.6, 0.8);
        assert_eq!(
            nearest_point(&[(DVec3::ZERO, direction), (DVec3::X, direction)]),
            None
        );
        assert_eq!(nearest_point(&[(DVec3::ZERO, direction)]), None);
    }

    #[test]
    fn skew_rays_meet_halfway_when_both_origins_are_equally_far() {
        let rays = [
            (DVec3::new(-10.0, 0.0, 0.0), DVec3::X),
            (DVec3::new(0.0, -10.0, 2.0), DVec3::Y),
        ];
        let point = nearest_point(&rays).unwrap();
        assert!(
            point.abs_diff_eq(DVec3::new(0.0, 0.0, 1.0), 1e-9),
            "{point}"
        );
    }
}
