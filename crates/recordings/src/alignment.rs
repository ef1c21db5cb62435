//! Clocks, cameras and tracks that agree best with the boxes: one robust least squares.
//!
//! Unknowns: of each camera the offset and drift of its clock and its [`Adjustment`]; of each arrival the delay of its track, an error of
//! its heights, one in proportion to them, and the errors of its positions at times between which they are interpolated; and the height of
//! the boxes' centres above the tracks' point. Each has a prior deviation; without one it is fixed. All cameras see the same errors of a
//! track, and what is left is a box's own error, which lasts for seconds.

use dataset::geometry::camera::Camera;
use dataset::geometry::camera::camera_adjustment::{Adjustment, UNKNOWNS};
use dataset::numbers::least_squares::HALF_WEIGHT;
use dataset::numbers::spread::deviation_from_zero;
use glam::{DVec2, DVec3};

use crate::arrow::{Arrow, Solved, Terms};
use crate::flight_path::{FlightPath, PathPoint};
use crate::sightings::Sighting;

/// Unknowns of a camera: offset (s), drift (ppm), and its adjustment.
pub(crate) const OF_CAMERA: usize = 2 + UNKNOWNS;
/// Unknowns of an arrival before its knots: delay (s), error of its heights (m), and in proportion to them.
const OF_FLIGHT: usize = 3;
/// Unknowns of a knot: errors along the course, to the right, and up, metres.
const OF_KNOT: usize = 3;
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
const OF_WIDTH: f64 = 0.01;
/// Errors of boxes count as one within this time: their autocorrelation is 0.3 after 2 s, and its sum over all lags 3.3 s.
const BOX_ERRORS_LAST_S: f64 = 3.3;
/// Errors of smoothed ADS-B last for twice the time over which it is smoothed, 7 s: the time between their knots.
const KNOT_S: f64 = 14.0;
/// Prior variance of a knot in squares of the path's deviation: the mean variance between independent knots is 2/3, and ground speeds,
/// which that deviation leaves out, take a quarter of the variance.
const OF_INTERPOLATED: f64 = 1.1;
/// Error of a smoothed barometric height that lasts for seconds, metres: steps of 25 ft.
const STEPS_SD_M: f64 = 1.0;
/// Distance of an arrival from the middle of the image, in images, beyond which no box shows it.
const MAX_OUTSIDE: f64 = 1.0;
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
    prior_sd: Vec<f64>,
    values: Vec<f64>,
}

impl<'a> FlightModel<'a> {
    fn new(path: &'a FlightPath, is_free: bool) -> Self {
        if !is_free || path.is_exact {
            let mut prior_sd = vec![0.0; OF_FLIGHT];
            prior_sd[0] = if is_free { path.delay_sd_s } else { 0.0 };
            return Self {
                path,
                prior_sd,
                values: vec![0.0; OF_FLIGHT],
            };
        }
        let [along_m, across_m, rise_m] = path.position_sd_m;
        let knots = ((path.to_s - path.from_s) / KNOT_S).ceil() as usize + 1;
        let knot = [along_m, across_m, STEPS_SD_M].map(|sd_m| OF_INTERPOLATED.sqrt() * sd_m);
        let mut prior_sd = vec![path.delay_sd_s, rise_m, path.stretch_sd];
        prior_sd.extend(std::iter::repeat_n(knot, knots).flatten());
        Self {
            path,
            values: vec![0.0; prior_sd.len()],
            prior_sd,
        }
    }

    pub(crate) fn delay_s(&self) -> f64 {
        self.values[0]
    }

    /// The first unknowns of the knots around a time, with their shares.
    fn knots(&self, utc_s: f64) -> impl Iterator<Item = (usize, f64)> + use<> {
        let knots = (self.values.len() - OF_FLIGHT) / OF_KNOT;
        let at = ((utc_s - self.path.from_s) / KNOT_S).clamp(0.0, knots.saturating_sub(1) as f64);
        let before = (at as usize).min(knots.saturating_sub(2));
        let shares = [1.0 - (at - before as f64), at - before as f64];
        let knot = move |(knot, share)| (OF_FLIGHT + OF_KNOT * (before + knot), share);
        shares.into_iter().enumerate().take(knots).map(knot)
    }

    /// Corrections of the position at a time along the path, to the right, and up, metres.
    pub(crate) fn moved_m(&self, utc_s: f64, height_m: f64) -> DVec3 {
        let (rise_m, stretch) = (self.values[1], self.values[2]);
        let steady = DVec3::new(0.0, 0.0, rise_m + stretch * height_m);
        self.knots(utc_s).fold(steady, |sum, (first, share)| {
            sum + share * DVec3::from_slice(&self.values[first..first + OF_KNOT])
        })
    }

    /// The corrected position.
    fn place_m(&self, point: &PathPoint, utc_s: f64, up_m: f64) -> DVec3 {
        let axes = point.axes();
        let moved_m = self.moved_m(utc_s, point.height_m) + up_m * DVec3::Z;
        point.place_m + axes[0] * moved_m.x + axes[1] * moved_m.y + axes[2] * moved_m.z
    }
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
    /// Equations of the last step, with the free unknowns by their order.
    solved: Option<Solved>,
}

impl<'a> Alignment<'a> {
    /// `are_free`: the tracks' errors are fitted as well.
    pub(crate) fn new(cameras: Vec<CameraModel>, paths: &'a [FlightPath], are_free: bool) -> Self {
        let flight = |path| FlightModel::new(path, are_free);
        Self {
            cameras,
            flights: paths.iter().map(flight).collect(),
            up_m: 0.0,
            up_sd_m: if are_free { UP_SD_M } else { 0.0 },
            solved: None,
        }
    }

    /// Prior deviations of the shared unknowns: of the cameras, and of the height of the boxes' centres.
    fn shared_sds(&self) -> Vec<f64> {
        let cameras = self.cameras.iter().flat_map(|camera| camera.prior_sd);
        cameras.chain([self.up_sd_m]).collect()
    }

    fn shared_values_mut(&mut self) -> impl Iterator<Item = &mut f64> {
        let cameras = self.cameras.iter_mut();
        let cameras = cameras.flat_map(|camera| &mut camera.values);
        cameras.chain([&mut self.up_m])
    }

    /// Difference of a box from an arrival; `None` if the arrival is not under way, or out of the camera's sight.
    pub(crate) fn residual(
        &self,
        camera: usize,
        seen_through: &Camera,
        flight: usize,
        seen: &Sighting,
    ) -> Option<Residual> {
        let (of_camera, of_flight) = (&self.cameras[camera], &self.flights[flight]);
        let stamp_s = of_camera.corrected_s(seen.time_s) + of_flight.delay_s();
        let point = of_flight.path.at(stamp_s)?;
        let at_m = of_flight.place_m(&point, stamp_s, self.up_m);
        let place_px = seen_through.project(at_m)?;
        // Beside the camera, errors of a track reach to every box.
        let side_px = DVec2::new(seen_through.width_px.into(), seen_through.height_px.into());
        if ((place_px / side_px) - 0.5).abs().max_element() > MAX_OUTSIDE {
            return None;
        }
        let mut track_variance = DVec2::ZERO;
        let [along_m, across_m, height_m] = of_flight.path.position_sd_m;
        let height_m = height_m.min(STEPS_SD_M);
        for (axis, sd_m) in point.axes().into_iter().zip([along_m, across_m, height_m]) {
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
        let shared_sds = self.shared_sds();
        let shared = Free::of(&shared_sds);
        let own: Vec<Free> = self
            .flights
            .iter()
            .map(|flight| Free::of(&flight.prior_sd))
            .collect();
        let counts: Vec<usize> = own.iter().map(|own| own.count).collect();
        let mut equations = Arrow::new(&counts, shared.count);
        let values: Vec<f64> = self.shared_values_mut().map(|value| *value).collect();
        for (unknown, (value, sd)) in values.iter().zip(&shared_sds).enumerate() {
            equations.add_shared(&shared.terms([(unknown, 1.0)]), -value, sd.powi(-2));
        }
        for (number, (flight, own)) in self.flights.iter().zip(&own).enumerate() {
            for (unknown, (value, sd)) in flight.values.iter().zip(&flight.prior_sd).enumerate() {
                let weight = sd.powi(-2);
                equations.add(number, &own.terms([(unknown, 1.0)]), &[], -value, weight);
            }
        }
        let bent: Vec<[Camera; 1 + UNKNOWNS]> = self.cameras.iter().map(with_steps).collect();
        let mut off: Vec<Vec<f64>> = vec![Vec::new(); self.cameras.len()];
        for one in assigned {
            let Some((residual, of_flight, of_shared)) = self.linearised(one, &bent[one.camera])
            else {
                continue;
            };
            let lasting = (self.cameras[one.camera].boxes_per_s * BOX_ERRORS_LAST_S).max(1.0);
            let weight = (1.0 + residual.squared() / (HALF_WEIGHT * HALF_WEIGHT)).recip();
            for axis in 0..2 {
                let along = |slopes: &[(usize, DVec2)], free: &Free| {
                    free.terms(
                        slopes
                            .iter()
                            .map(|(unknown, slope)| (*unknown, slope[axis])),
                    )
                };
                let (of_flight, of_shared) = (
                    along(&of_flight, &own[one.flight]),
                    along(&of_shared, &shared),
                );
                let weight = weight / (residual.box_variance[axis] * lasting);
                equations.add(
                    one.flight,
                    &of_flight,
                    &of_shared,
                    residual.off_px[axis],
                    weight,
                );
                off[one.camera].push(residual.off_px[axis]);
            }
        }
        let solved = equations.solve()?;
        let mut largest: f64 = 0.0;
        let mut change = |value: &mut f64, step: f64, sd: f64, is_time: bool| {
            let most = if is_time {
                MAX_TIME_STEP_S
            } else {
                f64::INFINITY
            };
            let change = step.clamp(-most, most);
            *value += change;
            largest = largest.max(change.abs() / sd);
        };
        for (unknown, value) in self.shared_values_mut().enumerate() {
            if let Some(number) = shared.numbers[unknown] {
                let is_time = unknown % OF_CAMERA == 0 && unknown + 1 < shared_sds.len();
                change(value, solved.shared[number], shared_sds[unknown], is_time);
            }
        }
        for ((flight, own), steps) in self.flights.iter_mut().zip(&own).zip(&solved.own) {
            for (unknown, value) in flight.values.iter_mut().enumerate() {
                if let Some(number) = own.numbers[unknown] {
                    change(value, steps[number], flight.prior_sd[unknown], unknown == 0);
                }
            }
        }
        for (model, off) in self.cameras.iter_mut().zip(off) {
            if !off.is_empty() {
                model.box_sd_px = deviation_from_zero(off.into_iter()).max(MIN_BOX_SD_PX);
            }
        }
        self.solved = Some(solved);
        Some(largest)
    }

    /// A residual with its slopes by the unknowns of the arrival, and by the shared ones.
    fn linearised(
        &self,
        one: &Assigned,
        bent: &[Camera; 1 + UNKNOWNS],
    ) -> Option<(Residual, Slopes, Slopes)> {
        let Assigned {
            camera,
            flight,
            seen,
        } = one;
        let residual = self.residual(*camera, &bent[0], *flight, seen)?;
        let (of_camera, of_flight) = (&self.cameras[*camera], &self.flights[*flight]);
        let stamp_s = of_camera.corrected_s(seen.time_s) + of_flight.delay_s();
        let point = of_flight.path.at(stamp_s)?;
        let at_m = of_flight.place_m(&point, stamp_s, self.up_m);
        let place_px = bent[0].project(at_m)?;
        let slope = |moved_m: DVec3| Some(bent[0].project(at_m + moved_m)? - place_px);
        let per_s = slope(point.velocity_mps * TIME_STEP_S)? / TIME_STEP_S;
        let [along, right, up] = point.axes();
        let per_m = [slope(along)?, slope(right)?, slope(up)?];
        let first = OF_CAMERA * camera;
        let mut shared = vec![
            (first, per_s),
            (first + 1, per_s * of_camera.drifted_s(seen.time_s)),
        ];
        for (unknown, step) in CAMERA_STEPS.into_iter().enumerate() {
            if of_camera.prior_sd[2 + unknown] > 0.0 {
                let moved_px = bent[1 + unknown].project(at_m)? - place_px;
                shared.push((first + 2 + unknown, moved_px / step));
            }
        }
        shared.push((OF_CAMERA * self.cameras.len(), per_m[2]));
        let mut own = vec![(0, per_s), (1, per_m[2]), (2, per_m[2] * point.height_m)];
        for (knot, share) in of_flight.knots(stamp_s) {
            own.extend((knot..).zip(per_m.map(|per_m| per_m * share)));
        }
        Some((residual, own, shared))
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

    /// Standard deviation of a sum of an arrival's unknowns and shared ones, with factors.
    fn sd_of(&self, flight: usize, own: Terms, shared: Terms) -> f64 {
        let Some(solved) = &self.solved else {
            return f64::NAN;
        };
        let own = Free::of(&self.flights[flight].prior_sd).terms(own);
        solved.sd_of(flight, &own, &Free::of(&self.shared_sds()).terms(shared))
    }

    /// Standard deviations of a camera's unknowns.
    pub(crate) fn camera_sds(&self, camera: usize) -> [f64; OF_CAMERA] {
        let sd = |unknown| self.sd_of(0, Vec::new(), vec![(OF_CAMERA * camera + unknown, 1.0)]);
        std::array::from_fn(sd)
    }

    /// Standard deviation of an arrival's delay.
    pub(crate) fn delay_sd_s(&self, flight: usize) -> f64 {
        self.sd_of(flight, vec![(0, 1.0)], Vec::new())
    }

    /// Seconds to add to a camera's times to get the times of an arrival's track, at a time, and their standard deviation.
    pub(crate) fn offset_to_track(&self, camera: usize, flight: usize, time_s: f64) -> [f64; 2] {
        let model = &self.cameras[camera];
        let offset_s = model.corrected_s(time_s) - time_s + self.flights[flight].delay_s();
        let clock = self.clock_terms(camera, time_s, 1.0);
        [offset_s, self.sd_of(flight, vec![(0, 1.0)], clock)]
    }

    /// A camera's clock at a time, times a factor.
    fn clock_terms(&self, camera: usize, time_s: f64, factor: f64) -> Terms {
        let first = OF_CAMERA * camera;
        let drifted_s = self.cameras[camera].drifted_s(time_s);
        vec![(first, factor), (first + 1, factor * drifted_s)]
    }

    /// Standard deviation of the place along the course at which a camera's image of a time shows an arrival, metres: its clock's, its
    /// track's, and what connects them.
    pub(crate) fn along_sd_m(
        &self,
        camera: usize,
        flight: usize,
        time_s: f64,
        speed_mps: f64,
    ) -> f64 {
        let of_flight = &self.flights[flight];
        let stamp_s = self.cameras[camera].corrected_s(time_s) + of_flight.delay_s();
        let own: Terms = [(0, speed_mps)]
            .into_iter()
            .chain(of_flight.knots(stamp_s))
            .collect();
        let sd_m = self.sd_of(flight, own, self.clock_terms(camera, time_s, speed_mps));
        // The path of an exact track has no unknowns.
        let path_sd_m = if of_flight.path.is_exact {
            of_flight.path.position_sd_m[0]
        } else {
            0.0
        };
        sd_m.hypot(path_sd_m)
    }
}

/// Slopes of a place in the image by numbers of unknowns, in rising order.
type Slopes = Vec<(usize, DVec2)>;

/// The unknowns with a prior deviation.
struct Free {
    /// Number of each unknown among them.
    numbers: Vec<Option<usize>>,
    count: usize,
}

impl Free {
    fn of(prior_sds: &[f64]) -> Self {
        let mut count = 0;
        let number = |sd: &f64| {
            let number = (*sd > 0.0).then_some(count);
            count += usize::from(number.is_some());
            number
        };
        let numbers = prior_sds.iter().map(number).collect();
        Self { numbers, count }
    }

    /// Terms by the numbers of the free unknowns, without the others.
    fn terms(&self, terms: impl IntoIterator<Item = (usize, f64)>) -> Terms {
        let free = |(unknown, factor): (usize, f64)| Some((self.numbers[unknown]?, factor));
        terms.into_iter().filter_map(free).collect()
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
