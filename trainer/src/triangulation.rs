//! The geometric solution: with known cameras, the point nearest to the rays through the box centres.
//!
//! Needs two views; a tick that one view missed gets no answer, which the number of samples shows. A box's centre is not the centre
//! of gravity: tail and gear shift it up or down by a part of the box's size, and a detector may have a constant bias. Both are
//! corrected by a fit on the training side: per view and axis, `offset = constant + part * size`.
//!
//! A detector also finds things other than aircraft: rays through boxes of different things do not meet, and then there is no
//! answer either.

use dataset::camera::Camera;
use dataset::geodesy::Geodetic;
use dataset::pixel_box::PixelBox;
use glam::{DMat3, DVec2, DVec3};
use serde::{Deserialize, Serialize};

use crate::samples::{Sample, ScenarioSummary};
use crate::trusted_boxes::centre_and_size;

/// Rays that pass each other farther than this are not of one aircraft, metres: its length.
const MEET_WITHIN_M: f64 = 40.0;

/// Position of the centre of gravity in a view's box.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(crate) struct CentreOffset {
    /// Right and down, pixels.
    pub constant_px: [f64; 2],
    /// Right as a part of the width, down as a part of the height.
    pub part_of_size: [f64; 2],
}

impl CentreOffset {
    /// Fits the offset of one view to samples whose boxes contain the aircraft. Each sample is weighted by the inverse square of
    /// its box's size, because a detector's errors grow with it. With too few samples the centre stays where it is.
    pub(crate) fn fit(view: usize, scenarios: &[ScenarioSummary], training: &[&Sample]) -> Self {
        let mut fitted = Self::default();
        for axis in 0..2 {
            let rows: Vec<[f64; 2]> = training
                .iter()
                .filter_map(|sample| {
                    let seen = sample.boxes[view]?;
                    let camera = &scenarios[sample.scenario].cameras[view];
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
pub(crate) fn nearest_point(rays: &[(DVec3, DVec3)]) -> Option<DVec3> {
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

/// Distance to touchdown of a sample, metres; `None` if fewer than two views saw it, or if they did not see the same object.
pub(crate) fn predict(
    offsets: &[CentreOffset],
    cameras: &[Camera],
    sample: &Sample,
    touchdown: Geodetic,
) -> Option<f64> {
    let seen: Vec<(&Camera, DVec2)> = sample
        .boxes
        .iter()
        .zip(cameras.iter().zip(offsets))
        .filter_map(|(seen, (camera, offset))| {
            Some((camera, offset.centre_of_gravity_px(seen.as_ref()?)))
        })
        .collect();
    let along = |ray: &dyn Fn(&Camera, DVec2) -> DVec3| -> Vec<(DVec3, DVec3)> {
        seen.iter()
            .map(|(camera, pixel)| (camera.center_ecef_m, ray(camera, *pixel)))
            .collect()
    };
    let mut rays = along(&|camera, pixel| camera.ray(pixel));
    let mut point = nearest_point(&rays)?;
    if cameras.iter().any(|camera| camera.refraction.is_some()) {
        // The correction for refraction depends on the distance, for which the first solution is accurate enough.
        rays = along(&|camera, pixel| camera.ray_to(pixel, camera.center_ecef_m.distance(point)));
        point = nearest_point(&rays)?;
    }
    let passes_by_m =
        |&(origin, direction): &(DVec3, DVec3)| (point - origin).cross(direction).length();
    let meet = rays.iter().map(passes_by_m).fold(0.0, f64::max) <= MEET_WITHIN_M / 2.0;
    meet.then(|| {
        Geodetic::from_ecef(point)
            .lat_lon()
            .distance_m(touchdown.lat_lon())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::{DistanceRange, Samples};
    use dataset::distortion::Distortion;
    use dataset::imaging::Imaging;
    use dataset::splits::Side;
    use testkit::synthetic::SyntheticCorpus;

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
        let offsets: Vec<_> = (0..samples.views.len())
            .map(|view| CentreOffset::fit(view, &samples.scenarios, &training))
            .collect();
        // The stand-in's boxes are centred 1 m above the centre of gravity of a 12.5 m high aircraft.
        assert!(
            (offsets[0].part_of_size[1] - 1.0 / 12.5).abs() < 1e-9,
            "{offsets:?}"
        );
        let mut dual = 0;
        for sample in samples.of_side(Side::Test) {
            let scenario = &samples.scenarios[sample.scenario];
            match predict(&offsets, &scenario.cameras, sample, scenario.touchdown) {
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
    fn lenses_bent_light_and_turned_cameras_leave_the_distance_of_noise_free_boxes_exact() {
        let folder = tempfile::tempdir().unwrap();
        let corpus = SyntheticCorpus {
            centre_noise_px: 0.0,
            size_noise_px: 0.0,
            turned_deg: 0.2,
            imaging: Imaging {
                distortion: Some(Distortion {
                    k1: -2.0,
                    p1: 0.002,
                    ..Distortion::default()
                }),
                refraction_coefficient: 0.13,
                degradation: None,
            },
            ..SyntheticCorpus::tiny()
        }
        .write(folder.path())
        .unwrap();
        let range = DistanceRange {
            min_nm: 0.5,
            max_nm: None,
        };
        let samples = Samples::read(&corpus, None, range).unwrap();
        assert!(samples.scenarios[0].cameras[0].refraction.is_some());
        let training = samples.of_side(Side::Train);
        let offsets: Vec<_> = (0..samples.views.len())
            .map(|view| CentreOffset::fit(view, &samples.scenarios, &training))
            .collect();
        let straight = |camera: &Camera| Camera {
            refraction: None,
            ..*camera
        };
        let pinhole = |camera: &Camera| Camera {
            distortion: None,
            ..*camera
        };
        let worst = |change: &dyn Fn(&Camera) -> Camera| {
            let mut worst_m: f64 = 0.0;
            for sample in samples.of_side(Side::Test) {
                let scenario = &samples.scenarios[sample.scenario];
                let cameras: Vec<Camera> = scenario.cameras.iter().map(change).collect();
                if let Some(found) = predict(&offsets, &cameras, sample, scenario.touchdown) {
                    worst_m = worst_m.max((found - sample.dtd_m).abs());
                }
            }
            worst_m
        };
        let (exact_m, no_refraction_m, no_lens_m) =
            (worst(&|camera| *camera), worst(&straight), worst(&pinhole));
        println!(
            "worst: {exact_m:.6} m; without refraction {no_refraction_m:.6} m, without the lens {no_lens_m:.0} m"
        );
        assert!(exact_m < 0.5, "{exact_m}");
        // Distance comes from horizontal directions, which refraction does not change; a lens does.
        assert!(
            no_refraction_m < 5.0 && no_lens_m > 100.0,
            "{no_refraction_m} {no_lens_m}"
        );
    }

    #[test]
    fn a_box_of_something_else_neither_moves_the_fit_nor_gives_an_answer() {
        let folder = tempfile::tempdir().unwrap();
        let corpus = SyntheticCorpus {
            centre_noise_px: 0.0,
            size_noise_px: 0.0,
            ..SyntheticCorpus::tiny()
        }
        .write(folder.path())
        .unwrap();
        let range = DistanceRange {
            min_nm: 0.05,
            max_nm: None,
        };
        let mut samples = Samples::read(&corpus, None, range).unwrap();
        let fit = |samples: &Samples| -> Vec<CentreOffset> {
            let training = samples.with_true_boxes(Side::Train);
            let training: Vec<_> = training.iter().collect();
            (0..samples.views.len())
                .map(|view| CentreOffset::fit(view, &samples.scenarios, &training))
                .collect()
        };
        let undisturbed = fit(&samples);
        let both = |sample: &Sample| sample.boxes.iter().all(Option::is_some);
        let index = samples.samples.iter().position(both).unwrap();
        let answer = |samples: &Samples| {
            let sample = &samples.samples[index];
            let scenario = &samples.scenarios[sample.scenario];
            predict(&undisturbed, &scenario.cameras, sample, scenario.touchdown)
        };
        assert!(answer(&samples).is_some());
        for sample in samples
            .samples
            .iter_mut()
            .filter(|sample| both(sample))
            .take(3)
        {
            let elsewhere = sample.boxes[1].as_mut().unwrap();
            elsewhere.cx_px += 300.0;
            elsewhere.cy_px += 200.0;
        }
        for (fitted, before) in fit(&samples).iter().zip(&undisturbed) {
            for axis in 0..2 {
                let constant_px = fitted.constant_px[axis] - before.constant_px[axis];
                let part = fitted.part_of_size[axis] - before.part_of_size[axis];
                assert!(constant_px.abs() < 1e-9 && part.abs() < 1e-9, "{fitted:?}");
            }
        }
        assert_eq!(answer(&samples), None);
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
