//! The direction of a camera throughout a flight, in hindsight: a random walk with measurements.
//!
//! Input: the measured turn of each image, or none. Output: the turn at every image with its standard deviation, by a Kalman filter and a
//! backward pass (Rauch, Tung and Striebel, "Maximum likelihood estimates of linear dynamic systems", 1965), one axis at a time. The walk's
//! rate is the most likely one of a few: at rate 0 the turn is the mean of all measurements, and at the rate of a shake each measurement
//! itself. A measurement far from what is expected is either wild or the first one after a step, and the ones after it tell which. Between
//! measurements the walk is uncertain by its rate.

use glam::DVec2;

use crate::fit::MIN_SD_PX;
use crate::ground::Motion;
use crate::sight::CERTAIN_SD;
use crate::watched::Measured;

/// Rates of the walk apart from 0: this one, and each further one larger by the factor, up to 12; pixels per root second. A mast that turns
/// by 0.1 degrees in five minutes has 0.1 at an image every two seconds, one that shakes by two pixels has two.
const MIN_RATE: f64 = 3e-3;
const RATE_FACTOR: f64 = 2.0;
const RATES: i32 = 13;
/// Logarithm of the share of measurements that are wild or follow a step: one in a hundred.
const WILD_LN: f64 = -4.6;

/// A turn at an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Turned {
    /// The turn, without zoom and lift.
    pub turn: Motion,
    /// Standard deviation of the shift, right and down, pixels.
    pub sd_px: DVec2,
}

/// Number with its variance.
#[derive(Debug, Clone, Copy)]
struct Estimate {
    value: f64,
    variance: f64,
}

/// The turn at each of these times, in order, from the turns that were measured; `None` without any. `half_px`: half of the image's width,
/// at which a roll is as uncertain as the shift.
pub fn smoothed(
    times_s: &[f64],
    measured: &[Option<Measured>],
    half_px: f64,
) -> Option<Vec<Turned>> {
    let axis = |value: fn(&Motion) -> f64, unit_px: f64| {
        let estimates = measured.iter().map(|measured| {
            measured.map(|Measured { turn, sd_px }| Estimate {
                value: value(&turn) * unit_px,
                variance: sd_px.max(MIN_SD_PX).powi(2),
            })
        });
        let at = times_s.iter().copied().zip(estimates);
        Some(Axis::of(at.clone())?.at_all(at.map(|(time_s, _)| time_s)))
    };
    let right = axis(|turn| turn.shift_px.x, 1.0)?;
    let down = axis(|turn| turn.shift_px.y, 1.0)?;
    let rolled = axis(|turn| turn.roll_rad, half_px)?;
    let axes = right.into_iter().zip(down).zip(rolled);
    let turned = axes.map(|((right, down), rolled)| Turned {
        turn: Motion {
            shift_px: DVec2::new(right.value, down.value),
            roll_rad: rolled.value / half_px,
            ..Motion::default()
        },
        sd_px: DVec2::new(right.variance.sqrt(), down.variance.sqrt()),
    });
    Some(turned.collect())
}

/// Walk along one axis, at the times of its measurements.
struct Axis {
    times_s: Vec<f64>,
    /// Estimates by all measurements.
    estimates: Vec<Estimate>,
    /// Variance of the walk up to each measurement from the one before.
    steps: Vec<f64>,
    /// Growth of the variance per second.
    growth: f64,
}

impl Axis {
    /// Walk at the most likely rate; `None` without a measurement.
    fn of(all: impl Iterator<Item = (f64, Option<Estimate>)>) -> Option<Self> {
        let (times_s, measured): (Vec<f64>, Vec<Estimate>) = all
            .filter_map(|(time_s, measured)| Some((time_s, measured?)))
            .unzip();
        // Of equally likely ones, the last.
        let rates = (0..RATES)
            .rev()
            .map(|step| MIN_RATE * RATE_FACTOR.powi(step));
        let walks = rates
            .chain([0.0])
            .filter_map(|rate| Self::filtered(&times_s, &measured, rate * rate));
        let (mut axis, _) = walks.max_by(|(_, one), (_, other)| one.total_cmp(other))?;
        axis.look_back();
        for (estimate, measured) in axis.estimates.iter_mut().zip(&measured) {
            let off = estimate.value - measured.value;
            if off * off > CERTAIN_SD * CERTAIN_SD * measured.variance {
                // A jolt in one image, or an error: the walk does not know.
                estimate.variance += off * off;
            }
        }
        Some(axis)
    }

    /// The forward pass, with the logarithm of its likelihood.
    fn filtered(times_s: &[f64], measured: &[Estimate], growth: f64) -> Option<(Self, f64)> {
        let mut now = *measured.first()?;
        let mut likelihood_ln = 0.0;
        let (mut estimates, mut steps) = (vec![now], vec![0.0]);
        for (between_s, measured) in times_s.windows(2).zip(&measured[1..]) {
            let mut step = growth * (between_s[1] - between_s[0]);
            let mut noise = measured.variance;
            let off = measured.value - now.value;
            if off * off > CERTAIN_SD * CERTAIN_SD * (now.variance + step + noise) {
                step += off * off;
                noise += off * off;
                likelihood_ln += WILD_LN;
            }
            let before = now.variance + step;
            let expected = before + noise;
            likelihood_ln -= (expected.ln() + off * off / expected) / 2.0;
            now = Estimate {
                value: now.value + off * before / expected,
                variance: before * noise / expected,
            };
            estimates.push(now);
            steps.push(step);
        }
        let axis = Self {
            times_s: times_s.to_vec(),
            estimates,
            steps,
            growth,
        };
        Some((axis, likelihood_ln))
    }

    /// The backward pass.
    fn look_back(&mut self) {
        for index in (1..self.estimates.len()).rev() {
            let after = self.estimates[index];
            let now = &mut self.estimates[index - 1];
            let before = now.variance + self.steps[index];
            let gain = now.variance / before;
            now.value += gain * (after.value - now.value);
            now.variance += gain * gain * (after.variance - before);
        }
    }

    /// At any times, in order: between two measurements in proportion, before and after all of them at the nearest one.
    fn at_all(&self, times_s: impl Iterator<Item = f64>) -> Vec<Estimate> {
        let last = self.times_s.len() - 1;
        times_s
            .map(|time_s| {
                let next = self.times_s.partition_point(|of| *of < time_s);
                if next == 0 || next > last {
                    let nearest = next.min(last);
                    let Estimate { value, variance } = self.estimates[nearest];
                    let away_s = (self.times_s[nearest] - time_s).abs();
                    return Estimate {
                        value,
                        variance: variance + self.growth * away_s,
                    };
                }
                let [from_s, to_s] = [next - 1, next].map(|index| self.times_s[index]);
                let [from, to] = [next - 1, next].map(|index| self.estimates[index]);
                let part = (time_s - from_s) / (to_s - from_s);
                let between = |from: f64, to: f64| from + part * (to - from);
                Estimate {
                    value: between(from.value, to.value),
                    variance: between(from.variance, to.variance)
                        + self.steps[next] * part * (1.0 - part),
                }
            })
            .collect()
    }
}

#[cfg(test)]
mod tests;
