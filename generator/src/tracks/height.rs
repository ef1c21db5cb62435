//! True heights above the runway from altitudes above any datum.
//!
//! Barometric altitudes are above 1013.25 hPa, in steps of 25 ft, and stretched by temperature. On final approach the aircraft is on the
//! glide path, which ends at the touchdown target: a line through the altitudes there gives the altitude of the target and, if the angle is
//! near the glide path's, the stretch. A flight with a different angle keeps it. Deviations from the glide path that temperatures can
//! explain remain undetected. Geometric altitudes, where a track has as many, are used instead: no temperature stretches them.

use dataset::geometry::runway::Runway;
use dataset::numbers::spread::median_of;

use super::arrival::{ArrivalFix, NoArrival};
use super::formats::Fix;

/// Distances between which the line is fitted, metres: 0.7 to 4 NM.
const FINAL_M: (f64, f64) = (1_300.0, 7_400.0);
const MIN_ALTITUDES: usize = 8;
const ANGLES_DEG: std::ops::RangeInclusive<f64> = 2.0..=6.5;
/// Altitudes further from the line are left out, metres.
const OUTLIER_M: f64 = 25.0;
/// Stretches of air from 20 degrees below to 25 above standard, 0.931 to 1.087, and the error of the slope.
const STRETCH: std::ops::RangeInclusive<f64> = 0.925..=1.093;
/// Standard deviation of the stretch where the angle does not give it.
const STRETCH_SD: f64 = 0.045;
/// Standard deviation of the stretch where the published angle gives it: 14 arrivals at Paris descend at 3.0 degrees, with one of 0.1.
const ANGLE_SD: f64 = 0.03;
/// Altitudes within this distance of each other, metres, are off the line in the same way: steps and gusts last about six seconds.
const ALIKE_M: f64 = 450.0;
/// Residual of the steps after smoothing, metres (standard deviation).
const STEPS_SD_M: f64 = 1.0;
/// 95th percentile of the standard normal distribution.
pub(super) const NORMAL_90: f64 = 1.645;

/// Conversion from altitudes to heights above the touchdown target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Datum {
    target_m: f64,
    stretch: f64,
    line: Line,
    /// True if the glide path gives the stretch.
    is_tied: bool,
    pub(super) is_exact: bool,
    is_geometric: bool,
}

/// A line through altitudes by the distance to go.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Line {
    at_zero_m: f64,
    slope: f64,
    /// Mean and standard deviation of the distances, metres.
    middle_m: f64,
    spread_m: f64,
    /// Standard deviation of the altitudes from the line, metres.
    off_m: f64,
    /// Number of independent altitude errors.
    independent: f64,
}

fn too_few(altitudes: usize) -> NoArrival {
    NoArrival::Unusable(format!(
        "it has {altitudes} plausible altitudes between 0.7 and 4 NM, expected at least {MIN_ALTITUDES}"
    ))
}

impl Datum {
    pub(super) fn of(arrival: &[ArrivalFix], runway: &Runway) -> Result<Self, NoArrival> {
        let of_kind = |altitude_m: fn(&Fix) -> Option<f64>| -> Vec<(f64, f64)> {
            let near = arrival
                .iter()
                .filter(|at| (FINAL_M.0..=FINAL_M.1).contains(&at.to_go_m));
            near.filter_map(|at| Some((at.to_go_m, altitude_m(&at.fix)?)))
                .collect()
        };
        let [mut points, geometric] = [
            of_kind(|fix| fix.altitude_m),
            of_kind(|fix| fix.geometric_m),
        ];
        let is_geometric = geometric.len() >= points.len().max(MIN_ALTITUDES);
        if is_geometric {
            points = geometric;
        }
        if points.len() < MIN_ALTITUDES {
            return Err(too_few(points.len()));
        }
        if arrival.iter().all(|at| at.fix.is_simulated) {
            return Ok(Self::exact(runway));
        }
        let rough = line_through_medians(&points);
        points.retain(|(to_go_m, altitude_m)| {
            (altitude_m - rough.0 - rough.1 * to_go_m).abs() < OUTLIER_M
        });
        if points.len() < MIN_ALTITUDES {
            return Err(too_few(points.len()));
        }
        let line = Line::through(&points);
        let slope = line.slope;
        let angle_deg = slope.atan().to_degrees();
        if !ANGLES_DEG.contains(&angle_deg) {
            return Err(NoArrival::Elsewhere(format!(
                "it descends at {angle_deg:.1} degrees between 0.7 and 4 NM, expected 2 to 6.5"
            )));
        }
        let stretch = runway.glide_path_deg.to_radians().tan() / slope;
        let is_tied = !is_geometric && STRETCH.contains(&stretch);
        Ok(Self {
            target_m: line.at_zero_m,
            stretch: if is_tied { stretch } else { 1.0 },
            line,
            is_tied,
            is_exact: false,
            is_geometric,
        })
    }

    /// Altitudes above mean sea level without errors.
    fn exact(runway: &Runway) -> Self {
        let target_m = runway.touchdown_target().altitude_msl_m;
        Self {
            target_m,
            stretch: 1.0,
            line: Line {
                at_zero_m: target_m,
                slope: runway.glide_path_deg.to_radians().tan(),
                middle_m: 0.0,
                spread_m: 1.0,
                off_m: 0.0,
                independent: 1.0,
            },
            is_tied: false,
            is_exact: true,
            is_geometric: false,
        }
    }

    /// Height by the altitude of a fix in the air.
    pub(super) fn height_m(self, fix: &Fix) -> Option<f64> {
        let altitude_m = if self.is_geometric {
            fix.geometric_m
        } else {
            fix.altitude_m
        };
        let altitude_m = altitude_m.filter(|_| !fix.on_ground)?;
        Some((altitude_m - self.target_m) * self.stretch)
    }

    /// Standard deviation of an error in proportion to the height.
    pub(super) fn stretch_sd(self) -> f64 {
        match (self.is_exact || self.is_geometric, self.is_tied) {
            (true, _) => 0.0,
            (false, true) => ANGLE_SD,
            (false, false) => STRETCH_SD,
        }
    }

    /// Half-width of the 90 % interval of height errors, for flights on the glide path.
    pub(super) fn half_width_90_m(self, height_m: f64) -> f64 {
        let line = self.line;
        let level_m = self.stretch * line.off_m / line.independent.sqrt();
        let slope_sd = line.off_m / line.independent.sqrt() / line.spread_m.max(1.0);
        // A steeper line has a lower target, and with the glide path's stretch less height at the same altitude.
        let tied_m = if self.is_tied {
            height_m / line.slope
        } else {
            0.0
        };
        let turned_m = (self.stretch * line.middle_m - tied_m) * slope_sd;
        let stretched_m = if self.is_tied || self.is_exact || self.is_geometric {
            0.0
        } else {
            STRETCH_SD * height_m
        };
        let parts = [level_m, turned_m, stretched_m, STEPS_SD_M];
        NORMAL_90
            * parts
                .iter()
                .map(|part_m| part_m * part_m)
                .sum::<f64>()
                .sqrt()
    }
}

/// Line by medians, robust against single wrong values: value at 0, and the median slope between the nearer and the further half.
pub(super) fn line_through_medians(points: &[(f64, f64)]) -> (f64, f64) {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = sorted.len() / 2;
    let (nearer, further) = (&sorted[..half], &sorted[sorted.len() - half..]);
    let pairs = nearer
        .iter()
        .zip(further)
        .filter(|(near, far)| far.0 > near.0);
    let slopes = pairs.map(|(near, far)| (far.1 - near.1) / (far.0 - near.0));
    let slope = median_of(slopes).unwrap_or_default();
    let at_zero = median_of(sorted.iter().map(|(x, y)| y - slope * x));
    (at_zero.unwrap_or_default(), slope)
}

impl Line {
    /// The line of least squares.
    fn through(points: &[(f64, f64)]) -> Self {
        let count = points.len() as f64;
        let mean = |of: &dyn Fn(&(f64, f64)) -> f64| points.iter().map(of).sum::<f64>() / count;
        let (x, y) = (mean(&|point| point.0), mean(&|point| point.1));
        let xx = mean(&|point| (point.0 - x).powi(2));
        let xy = mean(&|point| (point.0 - x) * (point.1 - y));
        let slope = if xx > 0.0 { xy / xx } else { 0.0 };
        let off_m2 = mean(&|point| (point.1 - y - slope * (point.0 - x)).powi(2));
        let distances = points.iter().map(|point| point.0);
        let (nearest_m, furthest_m) = distances.fold((f64::MAX, f64::MIN), |(low, high), x| {
            (low.min(x), high.max(x))
        });
        Self {
            at_zero_m: y - slope * x,
            slope,
            middle_m: x,
            spread_m: xx.sqrt(),
            off_m: off_m2.sqrt(),
            independent: ((furthest_m - nearest_m) / ALIKE_M).clamp(2.0, count.max(2.0)),
        }
    }
}
