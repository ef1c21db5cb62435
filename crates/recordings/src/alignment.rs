//! Clocks, cameras and tracks that agree best with the boxes: one robust least squares.
//!
//! Unknowns: of each camera the offset and drift of its clock and its [`Adjustment`]; of each arrival the delay of its track and an error
//! of its heights that lasts for the flight; and the height of the boxes' centres above the tracks' point. Each has a prior deviation;
//! without one it is fixed. A box counts by the deviation of its centre, and of the track as seen by the camera; errors of both last for
//! seconds, and the track's are common to all cameras, so that many boxes are less certain than independent ones.

use dataset::geometry::camera::Camera;
use dataset::geometry::camera::camera_adjustment::{Adjustment, UNKNOWNS};
use dataset::numbers::least_squares::NormalEquations;
use dataset::numbers::spread::{deviation_from_zero, median_of};
use glam::DVec2;

use crate::flight_path::FlightPath;
use crate::sightings::Sighting;

/// Unknowns of a camera: offset (s), drift (ppm), and its adjustment.
pub(crate) const OF_CAMERA: usize = 2 + UNKNOWNS;
/// Unknowns of an arrival: delay (s) and error of its heights (m).
const OF_FLIGHT: usize = 2;
/// Steps of numeric derivatives in the units of the unknowns: degrees, percent, metres; far above rounding, far below curvature.
const CAMERA_STEPS: [f64; UNKNOWNS] = [1e-3, 1e-3, 1e-3, 1e-3, 0.01, 0.01, 0.01];
const TIME_STEP_S: f64 = 0.01;
/// Prior deviation of the height of boxes' centres above the tracked point, metres: half the height of an airliner's fuselage and fin.
const UP_SD_M: f64 = 3.0;
/// Least deviation of box centres, pixels: the detector's is 0.5 px per view (docs/results.md), the codec's 0.05 px.
const MIN_BOX_SD_PX: f64 = 0.3;
/// Deviation of box centres before any fit, pixels.
pub(crate) const FIRST_BOX_SD_PX: f64 = 2.0;
/// A box's centre is off the tracked point by this part of the width as well: crab angle and perspective.
const OF_WIDTH: f64 = 0.02;
/// Errors of boxes last for two seconds: autocorrelation 0.3 after that time.
const BOX_ERRORS_LAST_S: f64 = 2.0;
/// Errors of smoothed ADS-B last for twice the time over which it is smoothed.
const TRACK_ERRORS_LAST_S: f64 = 14.0;
/// White part of the error of a smoothed barometric height, metres: steps of 25 ft.
const WHITE_HEIGHT_SD_M: f64 = 1.0;
/// Residual with half the weight, in standard deviations.
const HALF_WEIGHT: f64 = 2.0;
/// Residual from which on a box shows something else, in standard deviations.
pub(crate) const OTHER: f64 = 6.0;
/// Maximum change of a time in one round, seconds.
const MAX_TIME_STEP_S: f64 = 3.0;

/// A camera in the fit.
#[derive(Debug, Clone)]
pub(crate) struct CameraModel {
    pub(crate) given: Camera,
    /// Coarse offset, to which the fitted one is added, seconds.
    pub(crate) coarse_s: f64,
    /// Time at which the drift is 0, seconds.
    pub(crate) reference_s: f64,
    pub(crate) prior_sd: [f64; OF_CAMERA],
    pub(crate) values: [f64; OF_CAMERA],
    pub(crate) box_sd_px: f64,
    /// Boxes per second while an aircraft is in sight, of those in the fit.
    pub(crate) boxes_per_s: f64,
}

impl CameraModel {
    pub(crate) fn new(
        given: Camera,
        prior_sd: [f64; OF_CAMERA],
        reference_s: f64,
        boxes_per_s: f64,
    ) -> Self {
        Self {
            given,
            coarse_s: 0.0,
            reference_s,
            prior_sd,
            values: [0.0; OF_CAMERA],
            box_sd_px: FIRST_BOX_SD_PX,
            boxes_per_s,
        }
    }

    /// Starts again at a coarse offset, and turned so that the scene moves by `shift_px`.
    pub(crate) fn started_at(&self, coarse_s: f64, shift_px: DVec2) -> Self {
        let mut started = self.clone();
        started.coarse_s = coarse_s;
        started.values = [0.0; OF_CAMERA];
        if started.prior_sd[2] > 0.0 {
            let turn_deg =
                (shift_px / self.given.focal_px).map(|tangent| tangent.atan().to_degrees());
            (started.values[2], started.values[3]) = (-turn_deg.x, turn_deg.y);
        }
        started
    }

    pub(crate) fn adjustment(&self) -> Adjustment {
        Adjustment::from_array(std::array::from_fn(|i| self.values[2 + i]))
    }

    pub(crate) fn camera(&self) -> Camera {
        if self.values[2..].iter().all(|value| *value == 0.0) {
            return self.given;
        }
        self.adjustment().applied_to(&self.given)
    }

    /// Time of an image by the tracks' clock, without the delay of a track.
    pub(crate) fn corrected_s(&self, time_s: f64) -> f64 {
        time_s + self.coarse_s + self.values[0] + self.drifted_s(time_s) * self.values[1]
    }

    /// Seconds that a drift of 1 ppm makes.
    fn drifted_s(&self, time_s: f64) -> f64 {
        1e-6 * (time_s - self.reference_s)
    }
}

/// An arrival in the fit.
#[derive(Debug, Clone)]
pub(crate) struct FlightModel<'a> {
    pub(crate) path: &'a FlightPath,
    prior_sd: [f64; OF_FLIGHT],
    pub(crate) values: [f64; OF_FLIGHT],
}

/// A box that seems to show an arrival, by their numbers.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Assigned {
    pub(crate) camera: usize,
    pub(crate) flight: usize,
    pub(crate) seen: Sighting,
}

/// Difference of a box from a track.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Residual {
    pub(crate) off_px: DVec2,
    /// Variances of the box's centre, and of the track in the image.
    box_variance: DVec2,
    track_variance: DVec2,
}

impl Residual {
    /// Squared distance in standard deviations.
    pub(crate) fn squared(&self) -> f64 {
        (self.off_px * self.off_px / (self.box_variance + self.track_variance)).element_sum()
    }
}

#[derive(Debug, Clone)]
pub(crate) struct Alignment<'a> {
    pub(crate) cameras: Vec<CameraModel>,
    pub(crate) flights: Vec<FlightModel<'a>>,
    up_m: f64,
    up_sd_m: f64,
    /// Covariance of the free unknowns, by their order.
    covariance: Vec<Vec<f64>>,
}

impl<'a> Alignment<'a> {
    /// `are_free`: delays and heights of the tracks are fitted as well.
    pub(crate) fn new(cameras: Vec<CameraModel>, paths: &'a [FlightPath], are_free: bool) -> Self {
        let flight = |path: &'a FlightPath| FlightModel {
            path,
            prior_sd: if are_free && !path.is_exact {
                [path.delay_sd_s, path.position_sd_m[2]]
            } else {
                [0.0; OF_FLIGHT]
            },
            values: [0.0; OF_FLIGHT],
        };
        Self {
            cameras,
            flights: paths.iter().map(flight).collect(),
            up_m: 0.0,
            up_sd_m: if are_free { UP_SD_M } else { 0.0 },
            covariance: Vec::new(),
        }
    }

    fn prior_sds(&self) -> Vec<f64> {
        let cameras = self.cameras.iter().flat_map(|camera| camera.prior_sd);
        let flights = self.flights.iter().flat_map(|flight| flight.prior_sd);
        cameras.chain(flights).chain([self.up_sd_m]).collect()
    }

    fn values_mut(&mut self) -> impl Iterator<Item = &mut f64> {
        let cameras = self
            .cameras
            .iter_mut()
            .flat_map(|camera| &mut camera.values);
        let flights = self
            .flights
            .iter_mut()
            .flat_map(|flight| &mut flight.values);
        cameras.chain(flights).chain([&mut self.up_m])
    }

    fn number_of_flight(&self, flight: usize) -> usize {
        OF_CAMERA * self.cameras.len() + OF_FLIGHT * flight
    }

    /// Number of each unknown among the free ones.
    fn free(&self) -> Vec<Option<usize>> {
        let mut next = 0..;
        let number = |sd: &f64| (*sd > 0.0).then(|| next.next()).flatten();
        self.prior_sds().iter().map(number).collect()
    }

    /// Difference of a box from an arrival; `None` if the arrival is not under way, or behind the camera.
    pub(crate) fn residual(
        &self,
        camera: usize,
        seen_through: &Camera,
        flight: usize,
        seen: &Sighting,
    ) -> Option<Residual> {
        let (of_camera, of_flight) = (&self.cameras[camera], &self.flights[flight]);
        let stamp_s = of_camera.corrected_s(seen.time_s) + of_flight.values[0];
        let point = of_flight.path.at(stamp_s)?;
        let axes = point.axes();
        let at_m = point.place_m + axes[2] * (of_flight.values[1] + self.up_m);
        let place_px = seen_through.project(at_m)?;
        let mut track_variance = DVec2::ZERO;
        let [along_m, across_m, height_m] = of_flight.path.position_sd_m;
        let height_m = if of_flight.path.is_exact {
            height_m
        } else {
            WHITE_HEIGHT_SD_M
        };
        for (axis, sd_m) in axes.into_iter().zip([along_m, across_m, height_m]) {
            let moved_px = (seen_through.project(at_m + axis)? - place_px) * sd_m;
            track_variance += moved_px * moved_px;
        }
        let box_sd_px = of_camera
            .box_sd_px
            .hypot(OF_WIDTH * seen.pixel_box.width_px);
        Some(Residual {
            off_px: seen.place_px() - place_px,
            box_variance: DVec2::splat(box_sd_px * box_sd_px),
            track_variance,
        })
    }

    /// The arrivals that a box may show, nearest first, with the squared residuals; those within a number of pixels count in any case.
    pub(crate) fn near(
        &self,
        camera: usize,
        seen_through: &Camera,
        seen: &Sighting,
        within_px: f64,
    ) -> Vec<(usize, f64)> {
        let mut near: Vec<(usize, f64)> = (0..self.flights.len())
            .filter_map(|flight| {
                let residual = self.residual(camera, seen_through, flight, seen)?;
                let is_near =
                    residual.squared() < OTHER * OTHER || residual.off_px.length() < within_px;
                is_near.then(|| (flight, residual.squared()))
            })
            .collect();
        near.sort_by(|a, b| a.1.total_cmp(&b.1));
        near
    }

    /// The boxes with the arrival that each seems to show; without a distance within which boxes count in any case, only those near one.
    pub(crate) fn assigned(&self, seen: &[Vec<Sighting>], within_px: f64) -> Vec<Assigned> {
        let mut assigned = Vec::new();
        for (camera, of_camera) in seen.iter().enumerate() {
            let seen_through = self.cameras[camera].camera();
            for seen in of_camera {
                let near = self.near(camera, &seen_through, seen, within_px);
                if let Some((flight, _)) = near.first()
                    && (within_px > 0.0 || near.len() == 1)
                {
                    assigned.push(Assigned {
                        camera,
                        flight: *flight,
                        seen: *seen,
                    });
                }
            }
        }
        assigned
    }

    /// Takes one step towards the best unknowns; returns the largest change in prior deviations. `None` if a number is not finite.
    pub(crate) fn step(&mut self, assigned: &[Assigned]) -> Option<f64> {
        let (free, prior_sds) = (self.free(), self.prior_sds());
        let unknowns = free.iter().flatten().count();
        let mut equations = NormalEquations::new(unknowns);
        let values: Vec<f64> = self.values_mut().map(|value| *value).collect();
        for ((number, sd), value) in free.iter().zip(&prior_sds).zip(&values) {
            if let Some(number) = number {
                equations.add_sparse(&[(*number, 1.0)], -value, sd.powi(-2));
            }
        }
        let bent: Vec<[Camera; 1 + UNKNOWNS]> = self.cameras.iter().map(with_steps).collect();
        let mut off: Vec<Vec<f64>> = vec![Vec::new(); self.cameras.len()];
        let mut of_track: Vec<Vec<f64>> = off.clone();
        for one in assigned {
            let Some((residual, slopes)) = self.linearised(one, &bent[one.camera]) else {
                continue;
            };
            let model = &self.cameras[one.camera];
            let lasting = |seconds: f64| (model.boxes_per_s * seconds).max(1.0);
            let of_box = residual.box_variance * lasting(BOX_ERRORS_LAST_S);
            let common = lasting(TRACK_ERRORS_LAST_S) * self.cameras.len() as f64;
            let variance = of_box + residual.track_variance * common;
            let weight = (1.0 + residual.squared() / (HALF_WEIGHT * HALF_WEIGHT)).recip();
            for axis in 0..2 {
                let row: Vec<(usize, f64)> = (slopes.iter())
                    .filter_map(|(unknown, slope)| Some((free[*unknown]?, slope[axis])))
                    .collect();
                equations.add_sparse(&row, residual.off_px[axis], weight / variance[axis]);
                off[one.camera].push(residual.off_px[axis]);
                of_track[one.camera].push(residual.track_variance[axis]);
            }
        }
        let step = equations.solve()?;
        let limits = self.time_unknowns();
        let mut largest: f64 = 0.0;
        for (unknown, value) in self.values_mut().enumerate() {
            if let Some(number) = free[unknown] {
                let most = if limits[unknown] {
                    MAX_TIME_STEP_S
                } else {
                    f64::INFINITY
                };
                let change = step[number].clamp(-most, most);
                *value += change;
                largest = largest.max(change.abs() / prior_sds[unknown]);
            }
        }
        for ((model, off), of_track) in self.cameras.iter_mut().zip(off).zip(of_track) {
            if let Some(of_track) = median_of(of_track) {
                let variance = deviation_from_zero(off.into_iter()).powi(2) - of_track;
                model.box_sd_px = variance.max(0.0).sqrt().max(MIN_BOX_SD_PX);
            }
        }
        self.covariance = equations.inverse()?;
        Some(largest)
    }

    /// True for each unknown that is a time.
    fn time_unknowns(&self) -> Vec<bool> {
        let cameras = self
            .cameras
            .iter()
            .flat_map(|_| (0..OF_CAMERA).map(|unknown| unknown == 0));
        let flights = self.flights.iter().flat_map(|_| [true, false]);
        cameras.chain(flights).chain([false]).collect()
    }

    /// A residual with its slopes by the unknowns' numbers, in rising order.
    fn linearised(
        &self,
        one: &Assigned,
        bent: &[Camera; 1 + UNKNOWNS],
    ) -> Option<(Residual, Vec<(usize, DVec2)>)> {
        let Assigned {
            camera,
            flight,
            seen,
        } = one;
        let residual = self.residual(*camera, &bent[0], *flight, seen)?;
        let (of_camera, of_flight) = (&self.cameras[*camera], &self.flights[*flight]);
        let point = of_flight
            .path
            .at(of_camera.corrected_s(seen.time_s) + of_flight.values[0])?;
        let up = point.axes()[2];
        let at_m = point.place_m + up * (of_flight.values[1] + self.up_m);
        let place_px = bent[0].project(at_m)?;
        let per_s =
            (bent[0].project(at_m + point.velocity_mps * TIME_STEP_S)? - place_px) / TIME_STEP_S;
        let per_m_up = bent[0].project(at_m + up)? - place_px;
        let first = OF_CAMERA * camera;
        let mut slopes = Vec::with_capacity(OF_CAMERA + OF_FLIGHT + 1);
        slopes.push((first, per_s));
        slopes.push((first + 1, per_s * of_camera.drifted_s(seen.time_s)));
        for (unknown, step) in CAMERA_STEPS.into_iter().enumerate() {
            if of_camera.prior_sd[2 + unknown] > 0.0 {
                let moved_px = bent[1 + unknown].project(at_m)? - place_px;
                slopes.push((first + 2 + unknown, moved_px / step));
            }
        }
        let of_flight = self.number_of_flight(*flight);
        slopes.push((of_flight, per_s));
        slopes.push((of_flight + 1, per_m_up));
        slopes.push((self.number_of_flight(self.flights.len()), per_m_up));
        Some((residual, slopes))
    }

    /// Loss of all boxes of one camera, whatever they show, and of its unknowns.
    pub(crate) fn loss(&self, camera: usize, seen: &[Sighting]) -> f64 {
        let seen_through = self.cameras[camera].camera();
        let loss = |squared: f64| HALF_WEIGHT.powi(2) * (squared / HALF_WEIGHT.powi(2)).ln_1p();
        let of_box = |seen: &Sighting| {
            let near = self.near(camera, &seen_through, seen, 0.0);
            loss(near.first().map_or(OTHER * OTHER, |(_, squared)| *squared))
        };
        let model = &self.cameras[camera];
        let prior = model
            .values
            .iter()
            .zip(model.prior_sd)
            .filter(|(_, sd)| *sd > 0.0);
        let prior: f64 = prior.map(|(value, sd)| (value / sd).powi(2)).sum();
        seen.iter().map(of_box).sum::<f64>() + prior
    }

    /// Standard deviation of a sum of unknowns with factors.
    fn sd_of(&self, sum: &[(usize, f64)]) -> f64 {
        let free = self.free();
        let known: Vec<(usize, f64)> = sum
            .iter()
            .filter_map(|(unknown, factor)| Some((free[*unknown]?, *factor)))
            .collect();
        let variance: f64 = (known.iter())
            .flat_map(|(i, a)| {
                known
                    .iter()
                    .map(move |(j, b)| a * b * self.covariance[*i][*j])
            })
            .sum();
        variance.max(0.0).sqrt()
    }

    /// Standard deviations of a camera's unknowns.
    pub(crate) fn camera_sds(&self, camera: usize) -> [f64; OF_CAMERA] {
        std::array::from_fn(|unknown| self.sd_of(&[(OF_CAMERA * camera + unknown, 1.0)]))
    }

    /// Standard deviation of an arrival's delay.
    pub(crate) fn delay_sd_s(&self, flight: usize) -> f64 {
        self.sd_of(&[(self.number_of_flight(flight), 1.0)])
    }

    /// Seconds to add to a camera's times to get the times of an arrival's track, at a time, and their standard deviation.
    pub(crate) fn offset_to_track(&self, camera: usize, flight: usize, time_s: f64) -> [f64; 2] {
        let model = &self.cameras[camera];
        let offset_s = model.corrected_s(time_s) - time_s + self.flights[flight].values[0];
        let first = OF_CAMERA * camera;
        let parts = [
            (first, 1.0),
            (first + 1, model.drifted_s(time_s)),
            (self.number_of_flight(flight), 1.0),
        ];
        [offset_s, self.sd_of(&parts)]
    }
}

/// The camera, and the camera with a step of each number of its adjustment.
fn with_steps(model: &CameraModel) -> [Camera; 1 + UNKNOWNS] {
    let numbers = model.adjustment().to_array();
    std::array::from_fn(|which| {
        let mut numbers = numbers;
        if let Some(unknown) = which.checked_sub(1) {
            numbers[unknown] += CAMERA_STEPS[unknown];
        }
        Adjustment::from_array(numbers).applied_to(&model.given)
    })
}
