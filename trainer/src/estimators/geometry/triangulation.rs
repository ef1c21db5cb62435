//! Triangulation: with known cameras, the point nearest to the rays through the box centres.
//!
//! Needs two views; a tick that one view missed gets no answer, as the number of samples shows. A box's centre is not the centre of
//! gravity: tail and gear shift it up or down by a fraction of the box's size, and a detector may have a constant bias. A fit on the
//! training side corrects both, per view and axis: `offset = constant + part * size`.
//!
//! A detector also reports objects other than aircraft: rays through boxes of different objects do not meet. Then the largest group of rays
//! that meet gives the answer; with two views there is none.

use dataset::geometry::camera::Camera;
use dataset::geometry::geodesy::Geodetic;
use dataset::geometry::rays::{Ray, meeting_point_m};
use dataset::numbers::least_squares::NormalEquations;
use dataset::tables::pixel_box::PixelBox;
use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use crate::samples::trusted_boxes::centre_and_size;
use crate::samples::{Observation, Sample, ScenarioSummary};

/// Maximum distance between rays to one aircraft, metres: its length.
const MEET_WITHIN_M: f64 = 40.0;

/// Position of the centre of gravity relative to the box.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(crate) struct CentreOffset {
    /// Right and down, pixels.
    pub constant_px: [f64; 2],
    /// Right relative to the width, down relative to the height.
    pub part_of_size: [f64; 2],
}

impl CentreOffset {
    /// Fits one view's offset to samples with true boxes. Samples are weighted by the inverse square of the box size, because a detector's
    /// errors grow with it. With too few samples the offset is zero.
    pub(crate) fn fit(view: usize, scenarios: &[ScenarioSummary], training: &[&Sample]) -> Self {
        let mut fitted = Self::default();
        for axis in 0..2 {
            let mut line = NormalEquations::new(2);
            for sample in training {
                let Some(seen) = sample.best(view) else {
                    continue;
                };
                let camera = &scenarios[sample.scenario].cameras[view];
                let (centre, size) = centre_and_size(seen);
                if let Some(truth) = camera.project(sample.position.to_ecef())
                    && size[axis] > 0.0
                {
                    let weight = size[axis].powi(-2);
                    line.add(&[1.0, size[axis]], truth[axis] - centre[axis], weight);
                }
            }
            if let Some([constant, part]) = line.solve_for() {
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

/// Meeting point of rays to one aircraft; `None` if a ray misses it by too much.
fn common_point_m(rays: &[Ray]) -> Option<DVec3> {
    let point_m = meeting_point_m(rays)?;
    let meets = |ray: &Ray| ray.off_m(point_m) <= MEET_WITHIN_M / 2.0;
    rays.iter().all(meets).then_some(point_m)
}

/// Indices of the rays to one aircraft: all rays, or else the largest group that meets. `None` if no two rays meet, or if two different
/// groups are equally large, so that either may be right.
pub(crate) fn of_one_aircraft(rays: &[Ray]) -> Option<Vec<usize>> {
    if common_point_m(rays).is_some() {
        return Some((0..rays.len()).collect());
    }
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for first in 0..rays.len() {
        for second in first + 1..rays.len() {
            let Some(point_m) = common_point_m(&[rays[first], rays[second]]) else {
                continue;
            };
            let meets =
                |ray: &Ray| ray.along_m(point_m) > 0.0 && ray.off_m(point_m) <= MEET_WITHIN_M / 2.0;
            let group: Vec<usize> = (0..rays.len()).filter(|&i| meets(&rays[i])).collect();
            if !groups.contains(&group) {
                groups.push(group);
            }
        }
    }
    let largest = groups.iter().map(Vec::len).max()?;
    groups.retain(|group| group.len() == largest);
    (groups.len() == 1).then(|| groups.remove(0))
}

/// Distance to touchdown, metres; `None` unless at least two views saw the same object.
pub(crate) fn predict(
    offsets: &[CentreOffset],
    cameras: &[Camera],
    observed: &Observation,
    touchdown: Geodetic,
) -> Option<f64> {
    let mut seen: Vec<(&Camera, DVec2)> = observed
        .seen()
        .map(|(view, seen)| (&cameras[view], offsets[view].centre_of_gravity_px(seen)))
        .collect();
    let mut rays: Vec<Ray> = seen
        .iter()
        .map(|(camera, pixel)| Ray::through(camera, *pixel))
        .collect();
    let agreeing = of_one_aircraft(&rays)?;
    (seen, rays) = agreeing.iter().map(|&i| (seen[i], rays[i])).unzip();
    let mut point_m = meeting_point_m(&rays)?;
    if cameras.iter().any(|camera| camera.refraction.is_some()) {
        // Refraction depends on the distance, for which the first solution is accurate enough.
        for (ray, (camera, pixel)) in rays.iter_mut().zip(seen) {
            ray.direction = camera.ray_to(pixel, camera.center_ecef_m.distance(point_m));
        }
        point_m = common_point_m(&rays)?;
    }
    let distance_m = Geodetic::from_ecef(point_m)
        .lat_lon()
        .distance_m(touchdown.lat_lon());
    Some(distance_m)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Samples;
    use dataset::corpus::splits::Side;
    use dataset::geometry::distortion::Distortion;
    use dataset::geometry::imaging::Imaging;
    use testkit::synthetic::SyntheticCorpus;

    #[test]
    fn noise_free_boxes_give_the_exact_distance_of_held_out_trajectories() {
        let samples = Samples::synthetic(
            &SyntheticCorpus {
                centre_noise_px: 0.0,
                size_noise_px: 0.0,
                ..SyntheticCorpus::tiny()
            },
            0.05,
        );
        let training = samples.of_side(Side::Train);
        let offsets: Vec<_> = (0..samples.views.len())
            .map(|view| CentreOffset::fit(view, &samples.scenarios, &training))
            .collect();
        // The simulated boxes are centred 1 m above the centre of gravity of a 12.5 m high aircraft.
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
        let samples = Samples::synthetic(
            &SyntheticCorpus {
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
            },
            0.5,
        );
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
        let mut samples = Samples::synthetic(
            &SyntheticCorpus {
                centre_noise_px: 0.0,
                size_noise_px: 0.0,
                ..SyntheticCorpus::tiny()
            },
            0.05,
        );
        let fit = |samples: &Samples| -> Vec<CentreOffset> {
            let training = samples.with_true_boxes();
            let training: Vec<_> = training.iter().collect();
            (0..samples.views.len())
                .map(|view| CentreOffset::fit(view, &samples.scenarios, &training))
                .collect()
        };
        let undisturbed = fit(&samples);
        let both = |sample: &Sample| sample.detections() == 2;
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
            let elsewhere = sample.observed.best_mut(1).unwrap();
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

    /// Rays from masts side by side, metres apart, to positions of the aircraft.
    fn rays(seen: &[(f64, [f64; 3])]) -> Vec<Ray> {
        let ray = |&(right_m, place): &(f64, [f64; 3])| {
            let origin_m = DVec3::new(right_m, 0.0, 0.0);
            Ray {
                origin_m,
                direction: (DVec3::from(place) - origin_m).normalize(),
            }
        };
        seen.iter().map(ray).collect()
    }

    const AIRCRAFT: [f64; 3] = [20.0, 9_000.0, 500.0];

    #[test]
    fn of_three_views_one_that_saw_something_else_is_left_out() {
        let elsewhere = [-700.0, 9_000.0, 100.0];
        for wrong in 0..3 {
            let mut seen = [-300.0, 0.0, 300.0].map(|right_m| (right_m, AIRCRAFT));
            seen[wrong].1 = elsewhere;
            let right: Vec<_> = (0..3).filter(|&view| view != wrong).collect();
            assert_eq!(of_one_aircraft(&rays(&seen)), Some(right));
        }
        let all = rays(&[(-300.0, AIRCRAFT), (0.0, AIRCRAFT), (300.0, AIRCRAFT)]);
        assert_eq!(of_one_aircraft(&all), Some(vec![0, 1, 2]));
    }

    #[test]
    fn where_nothing_says_which_views_are_right_there_is_no_answer() {
        // Level with the aircraft, so that the third ray meets each of the others, at two points.
        let level = [-100.0, 9_000.0, 500.0];
        let seen = rays(&[(-300.0, AIRCRAFT), (0.0, AIRCRAFT), (300.0, level)]);
        assert_eq!(of_one_aircraft(&seen), None);
        let two = rays(&[(-300.0, AIRCRAFT), (300.0, [0.0, 9_000.0, 100.0])]);
        assert_eq!(of_one_aircraft(&two), None);
    }

    #[test]
    fn rays_that_part_are_of_no_aircraft_though_their_lines_meet_behind_the_cameras() {
        let apart = [
            (-300.0, [-600.0, 9_000.0, 0.0]),
            (300.0, [600.0, 9_000.0, 0.0]),
        ];
        assert_eq!(of_one_aircraft(&rays(&apart)), None);
    }
}
