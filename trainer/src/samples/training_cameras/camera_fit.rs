//! Camera fit to most boxes in a view: robust Gauss-Newton with a redescending loss whose scale shrinks from step to step (graduated
//! non-convexity; Blake and Zisserman, *Visual Reconstruction*, 1987).
//!
//! Two starting points compete: each scenario's stated camera, and the same camera turned by the median offset of the boxes. One difference
//! from the stated cameras is fitted to all scenarios. Where a camera points elsewhere in one of them, its background has shown that
//! ([`crate::background`]).

use dataset::geometry::camera::Camera;
use dataset::numbers::least_squares::NormalEquations;
use dataset::numbers::spread::{deviation_from_zero, median_of};
use glam::{DVec2, DVec3};
use sight::sight::CONTRADICTS_SD;

use dataset::geometry::camera::camera_adjustment::{Adjustment, UNKNOWNS};

/// Prior standard deviations of the difference from the stated camera, after the turn by the median offset: a mast surveyed by hand, a lens
/// by its label. In the order of [`Adjustment::to_array`].
const PRIOR_SD: [f64; UNKNOWNS] = [2.0, 2.0, 2.0, 5.0, 20.0, 20.0, 20.0];
/// Steps for numerical derivatives, in the same order.
const STEPS: [f64; UNKNOWNS] = [1e-4, 1e-4, 1e-4, 1e-3, 1e-2, 1e-2, 1e-2];
/// Box centre error, pixels, and its distance from the labelled point, metres: a gear, half a fin.
const BOX_SD_PX: f64 = 1.0;
const POINT_SD_M: f64 = 3.0;
/// Factor per step of the gate, beyond which residuals hardly count: if it shrank faster, it would close before the few near boxes have
/// turned the camera.
const SHRINKS_BY: f64 = 0.85;
const MAX_STEPS: usize = 60;
/// Length of the last step, relative to the prior standard deviation.
const SETTLED: f64 = 1e-4;
/// Rounds of median turns.
const TURNS: usize = 3;
/// Effective number of boxes per flight: errors at neighbouring ticks are similar.
const BOXES_OF_A_FLIGHT: f64 = 10.0;

/// A box with the true position of the aircraft.
#[derive(Debug, Clone, Copy)]
pub(super) struct LabelledBox {
    pub(super) scenario: usize,
    camera: Camera,
    /// Labelled position of the aircraft in ECEF, metres.
    at_m: DVec3,
    centre_px: DVec2,
    sd_px: f64,
}

impl LabelledBox {
    pub(super) fn new(scenario: usize, camera: Camera, at_m: DVec3, centre_px: DVec2) -> Self {
        let range_m = camera.center_ecef_m.distance(at_m);
        Self {
            scenario,
            camera,
            at_m,
            centre_px,
            sd_px: BOX_SD_PX + POINT_SD_M * camera.focal_px / range_m,
        }
    }

    /// Measured minus expected position, pixels; `None` if the aircraft would be behind the camera.
    fn off_px(&self, adjustment: &Adjustment) -> Option<DVec2> {
        let expected = adjustment.applied_to(&self.camera).project(self.at_m)?;
        Some(self.centre_px - expected)
    }

    fn residual(&self, adjustment: &Adjustment) -> Option<DVec2> {
        Some(self.off_px(adjustment)? / self.sd_px)
    }
}

/// The camera that agrees with most boxes in a view.
#[derive(Debug, Clone, Default)]
pub(super) struct CameraFit {
    /// Difference from the stated cameras, common to all scenarios.
    pub(super) adjustment: Adjustment,
    pub(super) sd: Adjustment,
}

impl CameraFit {
    /// Fits the boxes in a view; the default without any.
    pub(super) fn of(seen: &[LabelledBox]) -> Self {
        let starts = [Adjustment::default(), turned_by_median(seen)];
        let fits = starts.map(|start| solve(seen, start)).into_iter();
        let best = fits.min_by(|a, b| f64::total_cmp(&cost(seen, a), &cost(seen, b)));
        let adjustment = best.unwrap_or_default();
        Self {
            adjustment,
            sd: deviations(seen, &adjustment).unwrap_or_default(),
        }
    }

    /// Expected image position of the aircraft with a stated camera, pixels.
    pub(super) fn place_px(&self, camera: &Camera, at_m: DVec3) -> Option<DVec2> {
        self.adjustment.applied_to(camera).project(at_m)
    }
}

/// Robust standard deviation of the residuals, relative to the expected one.
fn spread(seen: &[LabelledBox], adjustment: &Adjustment) -> f64 {
    let residuals = seen.iter().filter_map(|s| s.residual(adjustment));
    deviation_from_zero(residuals.flat_map(|residual| residual.to_array()))
}

/// Logarithmic cost, so that a few large residuals have little weight.
fn cost(seen: &[LabelledBox], adjustment: &Adjustment) -> f64 {
    let of_box = |s: &LabelledBox| match s.residual(adjustment) {
        Some(residual) => residual.length_squared().ln_1p(),
        None => f64::MAX.ln(),
    };
    seen.iter().map(of_box).sum()
}

fn solve(seen: &[LabelledBox], start: Adjustment) -> Adjustment {
    let mut x = start;
    let mut gate = f64::INFINITY;
    for _ in 0..MAX_STEPS {
        let least = CONTRADICTS_SD * spread(seen, &x).max(1.0);
        let shrunk = (gate * SHRINKS_BY).max(least);
        gate = if gate.is_finite() {
            shrunk
        } else {
            CONTRADICTS_SD * least
        };
        let normal = normal(seen, &x, gate, 1.0, Some(&start));
        let Some(step) = normal.solve_for::<UNKNOWNS>() else {
            break;
        };
        let numbers = x.to_array();
        x = Adjustment::from_array(std::array::from_fn(|i| numbers[i] + step[i]));
        let moves = step.iter().zip(PRIOR_SD);
        let longest = moves.map(|(step, sd)| (step / sd).abs());
        if gate <= least && longest.fold(0.0, f64::max) < SETTLED {
            break;
        }
    }
    x
}

/// Normal equations for a step from `x`, with weights that vanish beyond the gate (Geman and McClure); `variance` is the residual
/// variance.
fn normal(
    seen: &[LabelledBox],
    x: &Adjustment,
    gate: f64,
    variance: f64,
    prior: Option<&Adjustment>,
) -> NormalEquations {
    let numbers = x.to_array();
    let moved: [Adjustment; UNKNOWNS] = std::array::from_fn(|unknown| {
        let mut moved = numbers;
        moved[unknown] += STEPS[unknown];
        Adjustment::from_array(moved)
    });
    let mut normal = NormalEquations::new(UNKNOWNS);
    for s in seen {
        let Some(residual) = s.residual(x) else {
            continue;
        };
        let slopes = moved.each_ref().map(|moved| s.residual(moved));
        let slope = |unknown: usize| {
            let change = slopes[unknown].map_or(DVec2::ZERO, |moved| moved - residual);
            change / STEPS[unknown]
        };
        let slopes: [DVec2; UNKNOWNS] = std::array::from_fn(slope);
        let weight = (1.0 + residual.length_squared() / gate.powi(2)).powi(-2) / variance;
        for axis in 0..2 {
            let row = slopes.map(|slope| slope[axis]);
            normal.add(&row, -residual[axis], weight);
        }
    }
    let centre = prior.unwrap_or(x).to_array();
    for (unknown, sd) in PRIOR_SD.into_iter().enumerate() {
        let mut unit = [0.0; UNKNOWNS];
        unit[unknown] = 1.0;
        normal.add(&unit, centre[unknown] - numbers[unknown], sd.powi(-2));
    }
    normal
}

fn deviations(seen: &[LabelledBox], adjustment: &Adjustment) -> Option<Adjustment> {
    let spread = spread(seen, adjustment);
    let scenarios = seen.chunk_by(|a, b| a.scenario == b.scenario).count();
    let alike = seen.len() as f64 / (BOXES_OF_A_FLIGHT * scenarios as f64);
    let variance = spread.powi(2) * alike.max(1.0);
    let gate = CONTRADICTS_SD * spread.max(1.0);
    let covariance = normal(seen, adjustment, gate, variance, None).inverse()?;
    Some(Adjustment::from_array(std::array::from_fn(|i| {
        covariance[i][i].sqrt()
    })))
}

/// Turn that removes the median offset of the boxes.
fn turned_by_median(seen: &[LabelledBox]) -> Adjustment {
    let mut turned = Adjustment::default();
    for _ in 0..TURNS {
        let off = |axis: usize| {
            let off = |s: &LabelledBox| Some((s.off_px(&turned)? / s.camera.focal_px)[axis]);
            median_of(seen.iter().filter_map(off))
        };
        let (Some(right), Some(down)) = (off(0), off(1)) else {
            break;
        };
        turned.pan_deg -= right.atan().to_degrees();
        turned.tilt_deg += down.atan().to_degrees();
    }
    turned
}
