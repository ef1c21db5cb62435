//! True heights above the runway from altitudes of any datum.
//!
//! Barometric altitudes are above 1013.25 hPa, in steps of 25 ft, and stretched by temperature. On final approach the aircraft is on the
//! glide path, which ends at the touchdown target: a line through the altitudes there gives the altitude of the target and, if the angle is
//! near the glide path's, the stretch. A flight with another angle keeps it.

use dataset::geometry::runway::Runway;
use dataset::numbers::spread::median;

use super::arrival::{NoArrival, Seen};

/// Distances between which the line is fitted, metres: 0.7 to 4 NM.
const FINAL_M: (f64, f64) = (1_300.0, 7_400.0);
const FEWEST: usize = 20;
/// Angles of approaches, degrees.
const ANGLES_DEG: std::ops::RangeInclusive<f64> = 2.0..=6.5;
/// Altitudes further from the line are left out, metres.
const OUTLIER_M: f64 = 25.0;
/// Stretches that temperature causes.
const STRETCH: std::ops::RangeInclusive<f64> = 0.9..=1.1;

/// From altitudes to heights above the touchdown target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Datum {
    target_m: f64,
    stretch: f64,
}

impl Datum {
    /// The datum of an arrival.
    pub(super) fn of(arrival: &[Seen], runway: &Runway) -> Result<Self, NoArrival> {
        let mut points: Vec<(f64, f64)> = arrival
            .iter()
            .filter(|at| (FINAL_M.0..=FINAL_M.1).contains(&at.to_go_m))
            .filter_map(|at| Some((at.to_go_m, at.fix.altitude_m?)))
            .collect();
        if points.len() < FEWEST {
            return Err(NoArrival::NoAltitudes {
                altitudes: points.len(),
            });
        }
        let mut line = line_through(&points);
        points.retain(|(to_go_m, altitude_m)| {
            (altitude_m - line.0 - line.1 * to_go_m).abs() < OUTLIER_M
        });
        if points.len() >= FEWEST {
            line = line_through(&points);
        }
        let (target_m, slope) = line;
        let angle_deg = slope.atan().to_degrees();
        if !ANGLES_DEG.contains(&angle_deg) {
            return Err(NoArrival::NoDescent { angle_deg });
        }
        let stretch = runway.glide_path_deg.to_radians().tan() / slope;
        Ok(Self {
            target_m,
            stretch: if STRETCH.contains(&stretch) {
                stretch
            } else {
                1.0
            },
        })
    }

    pub(super) fn height_m(self, altitude_m: f64) -> f64 {
        (altitude_m - self.target_m) * self.stretch
    }
}

/// The same by medians, which single wrong altitudes do not move: the slope is the median between the nearer and the further half.
fn line_through_medians(points: &[(f64, f64)]) -> (f64, f64) {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = sorted.len() / 2;
    let (nearer, further) = (&sorted[..half], &sorted[sorted.len() - half..]);
    let pairs = nearer
        .iter()
        .zip(further)
        .filter(|(near, far)| far.0 > near.0);
    let mut slopes: Vec<f64> = pairs
        .map(|(near, far)| (far.1 - near.1) / (far.0 - near.0))
        .collect();
    if slopes.is_empty() {
        return (0.0, 0.0);
    }
    let slope = median(&mut slopes);
    let mut at_zero: Vec<f64> = sorted.iter().map(|(x, y)| y - slope * x).collect();
    (median(&mut at_zero), slope)
}

/// Value at 0 and slope of the line of least squares.
fn line_through(points: &[(f64, f64)]) -> (f64, f64) {
    let count = points.len() as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| points.iter().map(of).sum::<f64>() / count;
    let (x, y) = (mean(|point| point.0), mean(|point| point.1));
    let (mut xx, mut xy) = (0.0, 0.0);
    for (px, py) in points {
        xx += (px - x) * (px - x);
        xy += (px - x) * (py - y);
    }
    let slope = if xx > 0.0 { xy / xx } else { 0.0 };
    (y - slope * x, slope)
}
