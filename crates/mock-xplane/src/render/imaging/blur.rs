//! Gaussian blur of linear light: the effect of optics and short-time turbulence.

use glam::Vec3;
use rayon::prelude::*;

/// The kernel extends to this many standard deviations: 6e-5 of the light is beyond.
const REACH_SIGMAS: f64 = 4.0;
/// A narrower blur changes no byte.
const NARROWEST_PX: f64 = 0.05;
/// Below this the values of a Gaussian at whole pixels have a different variance from the Gaussian (by 0.1 % here).
const COARSEST_PX: f64 = 0.7;

/// A blur in both directions.
#[derive(Debug, Clone)]
pub(crate) struct Blur {
    /// Weights from the middle outwards; their sum over both sides is 1.
    weights: Vec<f32>,
}

impl Blur {
    /// A blur with this standard deviation; `None` if it is too narrow to matter. Pixels average light over their own area already, so the
    /// weights are the Gaussian at their centres, and where that is too coarse, three weights with its variance.
    pub(crate) fn new(sigma_px: f64) -> Option<Self> {
        if sigma_px < NARROWEST_PX {
            return None;
        }
        let weights: Vec<f64> = if sigma_px < COARSEST_PX {
            vec![1.0 - sigma_px * sigma_px, sigma_px * sigma_px / 2.0]
        } else {
            let reach = (REACH_SIGMAS * sigma_px).ceil() as u32;
            (0..=reach)
                .map(|step| (-0.5 * (f64::from(step) / sigma_px).powi(2)).exp())
                .collect()
        };
        let sum = weights[0] + 2.0 * weights[1..].iter().sum::<f64>();
        Some(Self {
            weights: weights.iter().map(|w| (w / sum) as f32).collect(),
        })
    }

    /// Maximum spread of light, pixels.
    pub(crate) fn reach_px(&self) -> usize {
        self.weights.len() - 1
    }

    /// Blurs rows of this width; beyond its edges the image is extended by its edge pixels.
    pub(crate) fn apply(&self, light: &mut [Vec3], width: usize) {
        if light.is_empty() {
            return;
        }
        let height = light.len() / width;
        let across: Vec<Vec3> = light
            .par_chunks(width)
            .flat_map_iter(|line| (0..width).map(move |x| self.at(x, width, |x| line[x])))
            .collect();
        light
            .par_chunks_mut(width)
            .enumerate()
            .for_each(|(y, line)| {
                for (x, value) in line.iter_mut().enumerate() {
                    *value = self.at(y, height, |y| across[y * width + x]);
                }
            });
    }

    /// Weighted mean around a position in a line, always in the same order, so that the number of threads has no effect.
    fn at(&self, place: usize, length: usize, light: impl Fn(usize) -> Vec3) -> Vec3 {
        let mut sum = light(place) * self.weights[0];
        for (step, &weight) in self.weights.iter().enumerate().skip(1) {
            let before = place.saturating_sub(step);
            let after = (place + step).min(length - 1);
            sum += (light(before) + light(after)) * weight;
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_becomes_a_bell_of_the_same_light_place_and_the_asked_width() {
        for sigma_px in [0.2, 0.5, 0.8, 2.0, 5.0] {
            const SIDE: usize = 61;
            let mut light = vec![Vec3::ZERO; SIDE * SIDE];
            light[30 * SIDE + 30] = Vec3::ONE;
            Blur::new(sigma_px).unwrap().apply(&mut light, SIDE);
            let (mut sum, mut x, mut xx) = (0.0, 0.0, 0.0);
            for (i, value) in light.iter().enumerate() {
                let (value, at) = (f64::from(value.x), (i % SIDE) as f64 - 30.0);
                sum += value;
                x += value * at;
                xx += value * at * at;
            }
            assert!((sum - 1.0).abs() < 1e-4 && x.abs() < 1e-4, "{sum} {x}");
            let width = (xx / sum).sqrt();
            assert!(
                (width / sigma_px - 1.0).abs() < 0.02,
                "{width} for {sigma_px}"
            );
        }
    }

    #[test]
    fn even_light_stays_as_it_is_up_to_the_edges() {
        let mut light = vec![Vec3::splat(0.4); 20 * 7];
        Blur::new(3.0).unwrap().apply(&mut light, 20);
        assert!(light.iter().all(|value| (value.x - 0.4).abs() < 1e-6));
    }
}
