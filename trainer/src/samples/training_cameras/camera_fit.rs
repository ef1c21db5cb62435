//! Camera fit to most boxes in a view: robust Gauss-Newton with a redescending loss whose scale shrinks from step to step (graduated
//! non-convexity; Blake and Zisserman, *Visual Reconstruction*, 1987).
//!
//! Two starting points compete: each scenario's stated camera, and the same camera turned by the median offset of the boxes. One difference
//! from the stated cameras is fitted to all scenarios, and then an image offset for each: a camera may point elsewhere in a scenario
//! although its calibration does not say so.

use std::collections::BTreeMap;

use dataset::geometry::camera::Camera;
use dataset::numbers::least_squares::NormalEquations;
use dataset::numbers::spread::{deviation_from_zero, median};
use glam::{DVec2, DVec3};

use crate::samples::training_cameras::camera_adjustment::{Adjustment, UNKNOWNS};

/// Prior standard deviations of the difference from the stated camera, after the turn by the median offset: a mast surveyed by hand, a lens
/// by its label. In the order of [`Adjustment::to_array`].
const PRIOR_SD: [f64; UNKNOWNS] = [2.0, 2.0, 2.0, 5.0, 20.0, 20.0, 20.0];
/// Steps for numerical derivatives, in the same order.
const STEPS: [f64; UNKNOWNS] = [1e-4, 1e-4, 1e-4, 1e-3, 1e-2, 1e-2, 1e-2];
/// Box centre error, pixels, and its distance from the labelled point, metres: a gear, half a fin.
const BOX_SD_PX: f64 = 1.0;
const POINT_SD_M: f64 = 3.0;
/// Standard deviations beyond which residuals hardly count.
const GATE: f64 = 3.0;
/// Factor of the gate per step: if it shrank faster, it would close before the few near boxes have turned the camera.
const SHRINKS_BY: f64 = 0.85;
const MAX_STEPS: usize = 60;
/// Length of the last step, relative to the prior standard deviation.
const SETTLED: f64 = 1e-4;
/// Rounds of median turns, and of scenario offsets.
const TURNS: usize = 3;
const ROUNDS: usize = 2;
/// Minimum number of boxes for a scenario's offset.
const MIN_BOXES: usize = 8;
/// Candidate offsets per scenario.
const TRIED: usize = 40;
/// Minimum spread of offsets over scenarios, pixels.
const MIN_SPREAD_PX: f64 = 0.5;
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
}

/// The camera that agrees with most boxes in a view.
#[derive(Debug, Clone, Default)]
pub(super) struct CameraFit {
    /// Difference from the stated cameras, common to all scenarios.
    pub(super) adjustment: Adjustment,
    pub(super) sd: Adjustment,
    /// Additional image offset per scenario, pixels.
    offsets_px: BTreeMap<usize, DVec2>,
}

impl CameraFit {
    /// Fits the boxes in a view; the default without any.
    pub(super) fn of(seen: &[LabelledBox]) -> Self {
        let starts = [Adjustment::default(), turned_by_median(seen)];
        let fits = starts.map(|start| {
            let mut fit = Self {
                adjustment: start,
                ..Self::default()
            };
            for _ in 0..ROUNDS {
                fit.adjustment = fit.solve(seen, start);
                fit.offsets_px = fit.offsets(seen);
            }
            fit
        });
        let fits = fits.into_iter();
        let best = fits.min_by(|a, b| f64::total_cmp(&a.cost(seen), &b.cost(seen)));
        let mut best = best.unwrap_or_default();
        best.sd = best.deviations(seen).unwrap_or_default();
        best
    }

    /// Expected image position of the aircraft with a scenario's stated camera, pixels.
    pub(super) fn place_px(&self, scenario: usize, camera: &Camera, at_m: DVec3) -> Option<DVec2> {
        let expected = self.adjustment.applied_to(camera).project(at_m)?;
        Some(expected + self.offset_px(scenario))
    }

    fn offset_px(&self, scenario: usize) -> DVec2 {
        let offset = self.offsets_px.get(&scenario);
        offset.copied().unwrap_or_default()
    }

    fn residual(&self, seen: &LabelledBox, adjustment: &Adjustment) -> Option<DVec2> {
        let off_px = seen.off_px(adjustment)? - self.offset_px(seen.scenario);
        Some(off_px / seen.sd_px)
    }

    /// Robust standard deviation of the residuals, relative to the expected one.
    fn spread(&self, seen: &[LabelledBox], adjustment: &Adjustment) -> f64 {
        let residuals = seen.iter().filter_map(|s| self.residual(s, adjustment));
        deviation_from_zero(residuals.flat_map(|residual| residual.to_array()))
    }

    /// Logarithmic cost, so that a few large residuals have little weight.
    fn cost(&self, seen: &[LabelledBox]) -> f64 {
        let of_box = |s: &LabelledBox| match self.residual(s, &self.adjustment) {
            Some(residual) => residual.length_squared().ln_1p(),
            None => f64::MAX.ln(),
        };
        seen.iter().map(of_box).sum()
    }

    fn solve(&self, seen: &[LabelledBox], start: Adjustment) -> Adjustment {
        let mut x = self.adjustment;
        let mut gate = f64::INFINITY;
        for _ in 0..MAX_STEPS {
            let least = GATE * self.spread(seen, &x).max(1.0);
            let shrunk = (gate * SHRINKS_BY).max(least);
            gate = if gate.is_finite() {
                shrunk
            } else {
                GATE * least
            };
            let normal = self.normal(seen, &x, gate, 1.0, Some(&start));
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
        &self,
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
            let Some(residual) = self.residual(s, x) else {
                continue;
            };
            let slopes = moved.each_ref().map(|moved| self.residual(s, moved));
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

    fn deviations(&self, seen: &[LabelledBox]) -> Option<Adjustment> {
        let spread = self.spread(seen, &self.adjustment);
        let scenarios = seen.chunk_by(|a, b| a.scenario == b.scenario).count();
        let alike = seen.len() as f64 / (BOXES_OF_A_FLIGHT * scenarios as f64);
        let variance = spread.powi(2) * alike.max(1.0);
        let gate = GATE * spread.max(1.0);
        let covariance = self
            .normal(seen, &self.adjustment, gate, variance, None)
            .inverse()?;
        let mut sd: [f64; UNKNOWNS] = std::array::from_fn(|i| covariance[i][i].sqrt());
        // The mean is less certain if cameras differ.
        let offsets = || self.offsets_px.values();
        let focal_px = seen.first()?.camera.focal_px;
        for (axis, sd) in sd.iter_mut().take(2).enumerate() {
            let spread_px = deviation_from_zero(offsets().map(|offset| offset[axis]));
            let of_mean = spread_px / focal_px / (scenarios as f64).sqrt();
            *sd = sd.hypot(of_mean.to_degrees());
        }
        Some(Adjustment::from_array(sd))
    }

    /// Offset per scenario: where most boxes agree, weighed against the spread over all scenarios. A lamp that outnumbers the aircraft in
    /// one scenario does not move a camera that stands still in all others.
    fn offsets(&self, seen: &[LabelledBox]) -> BTreeMap<usize, DVec2> {
        let of_scenario = |of_scenario: &[LabelledBox]| {
            let off = of_scenario.iter().filter_map(|s| {
                let off_px = s.off_px(&self.adjustment)?;
                Some((off_px, s.sd_px))
            });
            (of_scenario[0].scenario, off.collect::<Vec<_>>())
        };
        let scenarios: Vec<(usize, Vec<(DVec2, f64)>)> = seen
            .chunk_by(|a, b| a.scenario == b.scenario)
            .map(of_scenario)
            .filter(|(_, off)| off.len() >= MIN_BOXES)
            .collect();
        let medians: Vec<DVec2> = (scenarios.iter())
            .map(|(_, off)| median_px(off.iter().map(|(off_px, _)| *off_px)))
            .collect();
        let spread = |axis: usize| {
            let spread_px = deviation_from_zero(medians.iter().map(|median| median[axis]));
            spread_px.max(MIN_SPREAD_PX)
        };
        let spread_px = DVec2::new(spread(0), spread(1));
        let scenarios = scenarios.into_iter();
        scenarios
            .map(|(scenario, off)| (scenario, agreed_px(&off, spread_px)))
            .collect()
    }
}

/// Offset that most boxes in a scenario agree on, pixels.
fn agreed_px(off: &[(DVec2, f64)], spread_px: DVec2) -> DVec2 {
    let cost = |tried_px: &DVec2| {
        let of_box = |(off_px, sd_px): &(DVec2, f64)| {
            let residual = (*off_px - *tried_px) / (GATE * sd_px);
            residual.length_squared().min(1.0)
        };
        off.iter().map(of_box).sum::<f64>() + (*tried_px / spread_px).length_squared()
    };
    let step = off.len().div_ceil(TRIED);
    let tried = off.iter().step_by(step).map(|(off_px, _)| *off_px);
    let best = (tried.chain([DVec2::ZERO])).min_by(|a, b| f64::total_cmp(&cost(a), &cost(b)));
    let best = best.unwrap_or_default();
    let mut sum = DVec2::ZERO;
    let mut weights = spread_px.powf(-2.0);
    for (off_px, sd_px) in off {
        if (*off_px - best).length() < GATE * sd_px {
            sum += *off_px / sd_px.powi(2);
            weights += DVec2::splat(sd_px.powi(-2));
        }
    }
    sum / weights
}

/// Turn that removes the median offset of the boxes.
fn turned_by_median(seen: &[LabelledBox]) -> Adjustment {
    let mut turned = Adjustment::default();
    for _ in 0..TURNS {
        let off = seen.iter().filter_map(|s| {
            let off_px = s.off_px(&turned)?;
            Some(off_px / s.camera.focal_px)
        });
        let off: Vec<DVec2> = off.collect();
        if off.is_empty() {
            break;
        }
        let off = median_px(off.into_iter());
        turned.pan_deg -= off.x.atan().to_degrees();
        turned.tilt_deg += off.y.atan().to_degrees();
    }
    turned
}

fn median_px(off: impl Iterator<Item = DVec2>) -> DVec2 {
    let (mut x, mut y): (Vec<f64>, Vec<f64>) = off.map(|off| (off.x, off.y)).unzip();
    DVec2::new(median(&mut x), median(&mut y))
}
