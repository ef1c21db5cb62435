//! `self_calibrated`: cameras fitted to labelled flights, and triangulation with them.
//!
//! Each labelled tick gives the aircraft's position; its boxes and registered shifts give image positions ([`measured`]). The cameras that
//! best reconcile the two are fitted ([`bundle`]): pan, tilt, roll, focal length and position of each, and the position of the measured
//! point on the aircraft. The fit starts from the rig of the plan, with prior deviations from the settings; the scenarios' calibration,
//! which includes jitter and aims, is not read. Lens distortion is taken from the rig.
//!
//! At a tick, the same measurements give the position of the aircraft by weighted least squares, from at least two views. A single view
//! gives no answer.

mod bundle;
mod measured;
#[cfg(test)]
mod tests;

use dataset::corpus::calibration::CameraEntry;
use dataset::geometry::camera::Camera;
use dataset::geometry::geodesy::Geodetic;
use dataset::geometry::rays::{Ray, meeting_point_m};
use dataset::numbers::least_squares::NormalEquations;
use dataset::numbers::limits::{self, Check};
use dataset::tables::pixel_box::PixelBox;
use glam::{DMat3, DVec2, DVec3};
use serde::{Deserialize, Serialize};

use crate::config::SelfCalibrationConfig;
use crate::estimators::geometry::FittedCamera;
use crate::estimators::geometry::triangulation::of_one_aircraft;
use crate::samples::rig::Cameras;
use crate::samples::rig::moved_rig::Move;
use crate::samples::trusted_boxes::centre_and_size;
use crate::samples::{FARTHEST_M, Observation, Sample, ScenarioSummary};
use dataset::geometry::camera::camera_adjustment::{Adjustment, UNKNOWNS};

use bundle::{AIRCRAFT_UNKNOWNS, Bundle, Solution, Tick};
use measured::{Deviations, Measured};

/// Minimum number of ticks for fitting a view.
pub(crate) const MIN_TICKS: usize = 30;
/// Maximum number of ticks in a fit; more have little effect.
const MAX_TICKS: usize = 20_000;
/// Prior standard deviations of the measured point, metres: half the length of an airliner, its symmetry, its height.
const POINT_SD_M: [f64; AIRCRAFT_UNKNOWNS] = [10.0, 3.0, 5.0];
/// Maximum number of steps to a position, and the length of the last one, metres.
const MAX_STEPS: usize = 10;
const LAST_STEP_M: f64 = 1e-3;

/// Fitted cameras with their measurement errors.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct SelfCalibrated {
    /// Per view; `null` for a view that saw the aircraft too rarely.
    cameras: Vec<Option<FittedCamera>>,
    point: PointOnAircraft,
    point_sd: PointOnAircraft,
    /// Measurement errors.
    deviations: Deviations,
}

/// A point relative to the labelled position, along the landing course, metres.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
struct PointOnAircraft {
    ahead_m: f64,
    right_m: f64,
    up_m: f64,
}

impl PointOnAircraft {
    fn from_array([ahead_m, right_m, up_m]: [f64; AIRCRAFT_UNKNOWNS]) -> Self {
        Self {
            ahead_m,
            right_m,
            up_m,
        }
    }

    fn to_array(self) -> [f64; AIRCRAFT_UNKNOWNS] {
        [self.ahead_m, self.right_m, self.up_m]
    }
}

impl SelfCalibrated {
    /// Fits a rig's cameras in the order of the views; `None` if fewer than two views saw the aircraft often enough.
    pub(crate) fn fit(
        rig: &Cameras,
        scenarios: &[ScenarioSummary],
        training: &[&Sample],
        config: &SelfCalibrationConfig,
    ) -> Option<Self> {
        let ticks_of = |view: usize| {
            let seen = training.iter().filter(|s| s.best(view).is_some());
            seen.count()
        };
        let ticks: Vec<usize> = (0..rig.len()).map(ticks_of).collect();
        let is_fitted = |view: usize| ticks[view] >= MIN_TICKS;
        if (0..rig.len()).filter(|&view| is_fitted(view)).count() < 2 {
            return None;
        }
        let rig: Vec<CameraEntry> = rig.values().cloned().collect();
        let bundle = bundle(&rig, scenarios, training, config, is_fitted);
        let Solution {
            unknowns,
            sd,
            deviations,
        } = bundle.solve(&vec![0.0; bundle.prior_sd.len()])?;
        let camera = |(view, entry): (usize, &CameraEntry)| {
            is_fitted(view).then(|| FittedCamera {
                rig: entry.clone(),
                adjustment: Adjustment::from_array(part(&unknowns, view * UNKNOWNS)),
                sd: Adjustment::from_array(part(&sd, view * UNKNOWNS)),
                ticks: ticks[view],
            })
        };
        let of_aircraft = rig.len() * UNKNOWNS;
        Some(Self {
            cameras: rig.iter().enumerate().map(camera).collect(),
            point: PointOnAircraft::from_array(part(&unknowns, of_aircraft)),
            point_sd: PointOnAircraft::from_array(part(&sd, of_aircraft)),
            deviations,
        })
    }

    pub(crate) fn move_with(&mut self, motion: &Move) {
        for fitted in self.cameras.iter_mut().flatten() {
            fitted.move_with(motion);
        }
    }

    /// Copy with one camera fitted again to other flights, starting from `planned` or else from the old camera. All other numbers stay,
    /// including measurement errors. `None` if there is no camera to start from, or the view saw the aircraft too rarely.
    pub(crate) fn refitted(
        &self,
        view: usize,
        planned: Option<&CameraEntry>,
        scenarios: &[ScenarioSummary],
        flights: &[&Sample],
        config: &SelfCalibrationConfig,
    ) -> Option<Self> {
        let old = self.cameras[view].as_ref();
        let entry = planned.or(old.map(|old| &old.rig))?.clone();
        let ticks = flights.iter().filter(|s| s.best(view).is_some()).count();
        if ticks < MIN_TICKS {
            return None;
        }
        // A view without a camera has no measurements, so any camera will do.
        let rig: Vec<CameraEntry> = (self.cameras.iter().enumerate())
            .map(|(other, fitted)| match fitted {
                Some(fitted) if other != view => fitted.rig.clone(),
                _ => entry.clone(),
            })
            .collect();
        let is_used = |other: usize| other == view || self.cameras[other].is_some();
        let mut bundle = bundle(&rig, scenarios, flights, config, is_used);
        bundle.free = view * UNKNOWNS..(view + 1) * UNKNOWNS;
        let start_of = |(other, fitted): (usize, &Option<FittedCamera>)| {
            let fitted = fitted.as_ref().filter(|fitted| fitted.rig == rig[other]);
            fitted.map_or([0.0; UNKNOWNS], |fitted| fitted.adjustment.to_array())
        };
        let mut start: Vec<f64> = self.cameras.iter().enumerate().flat_map(start_of).collect();
        start.extend(self.point.to_array());
        let Solution { unknowns, sd, .. } = bundle.solve(&start)?;
        let mut refitted = self.clone();
        refitted.cameras[view] = Some(FittedCamera {
            rig: entry,
            adjustment: Adjustment::from_array(part(&unknowns, view * UNKNOWNS)),
            sd: Adjustment::from_array(part(&sd, view * UNKNOWNS)),
            ticks,
        });
        Some(refitted)
    }

    pub(crate) fn without(&self, view: usize) -> Self {
        let mut others = self.clone();
        others.cameras[view] = None;
        others
    }

    pub(crate) fn cameras(&self) -> Vec<Option<Camera>> {
        let camera = |fitted: &Option<FittedCamera>| fitted.as_ref().map(FittedCamera::camera);
        self.cameras.iter().map(camera).collect()
    }

    pub(crate) fn locator(&self) -> Locator<'_> {
        Locator {
            fitted: self,
            cameras: self.cameras(),
        }
    }

    pub(crate) fn is_of(&self, views: usize) -> bool {
        self.cameras.len() == views
    }

    /// Checks the cameras against the limits.
    pub(crate) fn check(&self, check: &mut Check) {
        for fitted in self.cameras.iter().flatten() {
            fitted.rig.check(check);
            let focal_px = fitted.camera().focal_px;
            check.number("fitted focal length", focal_px, limits::FOCAL_LENGTH_PX);
        }
    }
}

fn part<const N: usize>(numbers: &[f64], first: usize) -> [f64; N] {
    std::array::from_fn(|i| numbers[first + i])
}

/// Prepares the fit of all cameras and of the measured point.
fn bundle(
    rig: &[CameraEntry],
    scenarios: &[ScenarioSummary],
    training: &[&Sample],
    config: &SelfCalibrationConfig,
    is_fitted: impl Fn(usize) -> bool,
) -> Bundle {
    let of_camera = Adjustment {
        pan_deg: config.turn_sd_deg,
        tilt_deg: config.turn_sd_deg,
        roll_deg: config.turn_sd_deg,
        focal_pct: config.focal_sd_pct,
        north_m: config.position_sd_m,
        east_m: config.position_sd_m,
        up_m: config.position_sd_m,
    };
    let mut prior_sd = of_camera.to_array().repeat(rig.len());
    prior_sd.extend(POINT_SD_M);
    let tick = |sample: &&Sample| Tick {
        at_m: sample.position.to_ecef(),
        ecef_from_course: ecef_from_course(sample.position, &scenarios[sample.scenario]),
        measured: Measured::in_tick(sample, &is_fitted),
    };
    let step = training.len().div_ceil(MAX_TICKS).max(1);
    Bundle {
        rig: rig.iter().map(CameraEntry::camera).collect(),
        free: 0..prior_sd.len(),
        prior_sd,
        ticks: training.iter().step_by(step).map(tick).collect(),
    }
}

/// Rotation from ahead (landing course), right and up.
fn ecef_from_course(at: Geodetic, scenario: &ScenarioSummary) -> DMat3 {
    let (sin, cos) = scenario.runway.course_true_deg.to_radians().sin_cos();
    let ned_from_course = DMat3::from_cols(
        DVec3::new(cos, sin, 0.0),
        DVec3::new(-sin, cos, 0.0),
        DVec3::NEG_Z,
    );
    at.ecef_from_ned() * ned_from_course
}

/// Triangulation with fitted cameras.
pub(crate) struct Locator<'a> {
    fitted: &'a SelfCalibrated,
    cameras: Vec<Option<Camera>>,
}

impl Locator<'_> {
    /// Distance to touchdown, metres; `None` unless at least two fitted views saw the same object.
    pub(crate) fn distance_m(
        &self,
        observed: &Observation,
        scenario: &ScenarioSummary,
    ) -> Option<f64> {
        let (point_m, _) = self.seen_point_m(observed)?;
        let course = ecef_from_course(Geodetic::from_ecef(point_m), scenario);
        let aircraft_m = point_m - course * DVec3::from_array(self.fitted.point.to_array());
        let distance_m = Geodetic::from_ecef(aircraft_m)
            .lat_lon()
            .distance_m(scenario.touchdown.lat_lon());
        (0.0..=FARTHEST_M)
            .contains(&distance_m)
            .then_some(distance_m)
    }

    /// Position at the centre of the boxes, and its standard deviation (root of the sum over the axes, metres); `None` unless at least two
    /// fitted views saw the same object. No runway is needed.
    pub(crate) fn place(&self, observed: &Observation) -> Option<(Geodetic, f64)> {
        let (point_m, normal) = self.seen_point_m(observed)?;
        let covariance = normal.inverse()?;
        let variance_m2: f64 = (0..3).map(|axis| covariance[axis][axis]).sum();
        Some((Geodetic::from_ecef(point_m), variance_m2.sqrt()))
    }

    fn seen_point_m(&self, observed: &Observation) -> Option<(DVec3, NormalEquations)> {
        let ray = |(view, seen): (usize, &PixelBox)| {
            let (centre, _) = centre_and_size(seen);
            Some((view, Ray::through(self.cameras[view].as_ref()?, centre)))
        };
        let (views, rays): (Vec<usize>, Vec<Ray>) = observed.seen().filter_map(ray).unzip();
        let agreeing = of_one_aircraft(&rays)?;
        let (views, rays): (Vec<usize>, Vec<Ray>) =
            agreeing.iter().map(|&i| (views[i], rays[i])).unzip();
        let measured = Measured::in_tick(observed, |view| views.contains(&view));
        self.best_point_m(&measured, meeting_point_m(&rays)?)
    }

    /// Best point by Gauss-Newton from a nearby start, with the last equations.
    fn best_point_m(
        &self,
        measured: &[Measured],
        mut point_m: DVec3,
    ) -> Option<(DVec3, NormalEquations)> {
        for _ in 0..MAX_STEPS {
            let places_px = self.places_px(point_m);
            let moved: Vec<_> = DMat3::IDENTITY
                .to_cols_array_2d()
                .map(|axis_m| self.places_px(point_m + DVec3::from_array(axis_m)))
                .into();
            let mut normal = NormalEquations::new(3);
            for measured in measured {
                let residual = measured.residual(&places_px)?;
                let slope = |moved: &Vec<Option<DVec2>>| {
                    // Per metre.
                    let in_view = |view: usize| Some(moved[view]? - places_px[view]?);
                    measured.slope(|view| in_view(view).unwrap_or(DVec2::NAN))
                };
                let slopes: Vec<DVec2> = moved.iter().map(slope).collect();
                let deviation = measured.deviation(&self.fitted.deviations);
                for axis in 0..2 {
                    let weight = deviation[axis].powi(-2);
                    let row = [slopes[0][axis], slopes[1][axis], slopes[2][axis]];
                    normal.add(&row, -residual[axis], weight);
                }
            }
            let step_m = DVec3::from_array(normal.solve_for()?);
            point_m += step_m;
            if step_m.length() < LAST_STEP_M {
                return Some((point_m, normal));
            }
        }
        None
    }

    fn places_px(&self, point_m: DVec3) -> Vec<Option<DVec2>> {
        let place = |camera: &Option<Camera>| camera.as_ref()?.project(point_m);
        self.cameras.iter().map(place).collect()
    }
}
