//! Camera fit to labelled flights: damped, robust Gauss-Newton over all measurements, as in a bundle adjustment with known points (Triggs
//! et al., "Bundle Adjustment - A Modern Synthesis", 2000).
//!
//! Unknowns are scaled by their prior standard deviation, so that the prior is a ridge of 1. Residuals have Huber's loss, in deviations
//! that are estimated again before each step. A loss that ignored outliers would ignore whole scenarios where cameras differ between them.

use std::ops::Range;

use dataset::geometry::camera::Camera;
use dataset::numbers::least_squares::NormalEquations;
use glam::{DMat3, DVec2, DVec3};

use super::measured::{Deviations, Measured};
use crate::estimators::HUBER;
use dataset::geometry::camera::camera_adjustment::{Adjustment, UNKNOWNS};

/// Unknowns of the aircraft: the measured point ahead, right and up of the labelled position.
pub(super) const AIRCRAFT_UNKNOWNS: usize = 3;
/// Step for numerical derivatives, in prior standard deviations.
const STEP: f64 = 1e-4;
const MAX_STEPS: usize = 60;
const MAX_HALVINGS: u32 = 10;
/// Maximum move in the last step, in standard deviations.
const SETTLED: f64 = 1e-2;
/// Residual for a point behind the camera, pixels.
const BEHIND_PX: f64 = 1e5;

pub(super) struct Tick {
    /// Labelled position of the aircraft in ECEF, metres.
    pub(super) at_m: DVec3,
    /// Rotation from ahead, right and up along the landing course.
    pub(super) ecef_from_course: DMat3,
    pub(super) measured: Vec<Measured>,
}

/// Fit input.
pub(super) struct Bundle {
    /// Rig cameras per view.
    pub(super) rig: Vec<Camera>,
    /// Prior standard deviations: camera by camera, then the aircraft.
    pub(super) prior_sd: Vec<f64>,
    /// Fitted unknowns; the others stay.
    pub(super) free: Range<usize>,
    pub(super) ticks: Vec<Tick>,
}

/// Fitted unknowns with their uncertainty.
#[derive(Debug)]
pub(super) struct Solution {
    pub(super) unknowns: Vec<f64>,
    /// Standard deviations; 0 for unknowns that were not fitted.
    pub(super) sd: Vec<f64>,
    pub(super) deviations: Deviations,
}

/// Cameras and measured point for given unknowns.
struct Scene {
    cameras: Vec<Camera>,
    aircraft_m: DVec3,
}

impl Bundle {
    /// Fits the free unknowns from `start`; `None` if the equations are singular.
    pub(super) fn solve(&self, start: &[f64]) -> Option<Solution> {
        let mut x: Vec<f64> = start
            .iter()
            .zip(&self.prior_sd)
            .map(|(x, sd)| x / sd)
            .collect();
        for _ in 0..MAX_STEPS {
            let deviations = Deviations::of(&self.residuals(&x));
            let normal = self.normal(&x, &deviations);
            let step = normal.solve()?;
            let Some(next) = self.damped(&x, &step, &deviations) else {
                break;
            };
            let sd = deviations_of(&normal)?;
            let free = self.free.clone();
            let moves = next[free.clone()].iter().zip(&x[free]).zip(sd);
            let largest = moves
                .map(|((next, last), sd)| (next - last).abs() / sd)
                .fold(0.0, f64::max);
            x = next;
            if largest < SETTLED {
                break;
            }
        }
        let deviations = Deviations::of(&self.residuals(&x));
        let mut sd = vec![0.0; x.len()];
        sd[self.free.clone()].copy_from_slice(&deviations_of(&self.normal(&x, &deviations))?);
        let in_units = |values: Vec<f64>| -> Vec<f64> {
            values
                .iter()
                .zip(&self.prior_sd)
                .map(|(x, sd)| x * sd)
                .collect()
        };
        Some(Solution {
            unknowns: in_units(x),
            sd: in_units(sd),
            deviations,
        })
    }

    /// The longest halved step that reduces the cost; `None` without any.
    fn damped(&self, x: &[f64], step: &[f64], deviations: &Deviations) -> Option<Vec<f64>> {
        let before = self.cost(x, deviations);
        (0..MAX_HALVINGS).find_map(|halvings| {
            let part = 0.5_f64.powi(halvings as i32);
            let mut next = x.to_vec();
            for (value, step) in next[self.free.clone()].iter_mut().zip(step) {
                *value += part * step;
            }
            (self.cost(&next, deviations) < before).then_some(next)
        })
    }

    fn scene(&self, x: &[f64]) -> Scene {
        let unknown = |index: usize| x[index] * self.prior_sd[index];
        let camera = |(view, rig): (usize, &Camera)| {
            let numbers = std::array::from_fn(|i| unknown(view * UNKNOWNS + i));
            Adjustment::from_array(numbers).applied_to(rig)
        };
        let of_aircraft = self.rig.len() * UNKNOWNS;
        Scene {
            cameras: self.rig.iter().enumerate().map(camera).collect(),
            aircraft_m: DVec3::from_array(std::array::from_fn(|i| unknown(of_aircraft + i))),
        }
    }

    fn residuals(&self, x: &[f64]) -> Vec<(Measured, DVec2)> {
        let scene = self.scene(x);
        let of_tick = |tick: &Tick| {
            let places_px = scene.places_px(tick);
            let residual = move |&measured: &Measured| {
                let residual = measured.residual(&places_px);
                (measured, residual.unwrap_or(DVec2::splat(BEHIND_PX)))
            };
            tick.measured.iter().map(residual).collect::<Vec<_>>()
        };
        self.ticks.iter().flat_map(of_tick).collect()
    }

    fn cost(&self, x: &[f64], deviations: &Deviations) -> f64 {
        let residuals = self.residuals(x);
        let loss = |size: f64| {
            if size <= HUBER {
                size * size
            } else {
                HUBER * (2.0 * size - HUBER)
            }
        };
        let of_residual = |(measured, residual): &(Measured, DVec2)| {
            let [right, down] = measured.deviation(deviations);
            loss(residual.x.abs() / right) + loss(residual.y.abs() / down)
        };
        let prior: f64 = x[self.free.clone()].iter().map(|x| x * x).sum();
        prior + residuals.iter().map(of_residual).sum::<f64>()
    }

    /// Normal equations for a step of the free unknowns.
    fn normal(&self, x: &[f64], deviations: &Deviations) -> NormalEquations {
        let scene = self.scene(x);
        let moved: Vec<Scene> = self
            .free
            .clone()
            .map(|unknown| {
                let mut moved = x.to_vec();
                moved[unknown] += STEP;
                self.scene(&moved)
            })
            .collect();
        let mut normal = NormalEquations::new(self.free.len());
        for tick in &self.ticks {
            let places_px = scene.places_px(tick);
            let slopes: Vec<Vec<DVec2>> = moved
                .iter()
                .map(|moved| slopes(&places_px, &moved.places_px(tick)))
                .collect();
            for measured in &tick.measured {
                let Some(residual) = measured.residual(&places_px) else {
                    continue;
                };
                let of_unknowns: Vec<DVec2> = slopes
                    .iter()
                    .map(|slopes| measured.slope(|view| slopes[view]))
                    .collect();
                let deviation = measured.deviation(deviations);
                for axis in 0..2 {
                    let size = residual[axis].abs() / deviation[axis];
                    let weight = (HUBER / size).min(1.0) / deviation[axis].powi(2);
                    let row: Vec<f64> = of_unknowns.iter().map(|slope| slope[axis]).collect();
                    normal.add(&row, -residual[axis], weight);
                }
            }
        }
        for (row, unknown) in self.free.clone().enumerate() {
            let mut unit = vec![0.0; self.free.len()];
            unit[row] = 1.0;
            normal.add(&unit, -x[unknown], 1.0);
        }
        normal
    }
}

impl Scene {
    fn places_px(&self, tick: &Tick) -> Vec<Option<DVec2>> {
        let point_m = tick.at_m + tick.ecef_from_course * self.aircraft_m;
        self.cameras
            .iter()
            .map(|camera| camera.project(point_m))
            .collect()
    }
}

/// Derivatives of the positions per view; 0 where there is none.
fn slopes(places_px: &[Option<DVec2>], moved_px: &[Option<DVec2>]) -> Vec<DVec2> {
    let slope = |(place, moved): (&Option<DVec2>, &Option<DVec2>)| match (place, moved) {
        (Some(place), Some(moved)) => (*moved - *place) / STEP,
        _ => DVec2::ZERO,
    };
    places_px.iter().zip(moved_px).map(slope).collect()
}

/// Standard deviations for values with a variance of 1.
fn deviations_of(normal: &NormalEquations) -> Option<Vec<f64>> {
    let covariance = normal.inverse()?;
    Some(
        (0..covariance.len())
            .map(|i| covariance[i][i].sqrt())
            .collect(),
    )
}
