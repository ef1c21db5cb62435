//! A cloud layer on the grid of the sky, tracked while it drifts.
//!
//! Marching through layers dominates the cost. So it is done only at key instants, between which it drifts by a few pixels, and at any
//! other instant the nearest key is looked up at the cloud's position at that time: every node has the distance of its cloud, so near
//! clouds move faster than far ones. The sky at an instant does not depend on earlier images.

use std::sync::Arc;

use glam::{DVec2, Vec2, Vec3, Vec4};
use rayon::prelude::*;

use crate::render::backdrop::clouds::{Clouds, Layer};
use crate::render::backdrop::{Nodes, Surroundings};
use crate::render::instant_cache::InstantCache;
use crate::render::view::CELL_PX;

/// Drift from key to key where it is fastest, pixels. Half is the farthest look-up, where interpolation preserves 90 % of waves of four
/// cells and 99 % of waves of eight.
const DRIFT_PER_KEY_PX: f64 = 6.0;
/// Distance for measuring the drift of pixels, metres: small angles, yet far from rounding.
const YARDSTICK_M: f64 = 10_000.0;

/// A layer as seen by the camera.
pub(crate) struct DriftingLayer {
    /// Index among the scene's layers.
    index: usize,
    /// Drift at every node for an object one metre away, cells per second.
    flow: Vec<Vec2>,
    /// Drift where it is fastest, pixels per second.
    speed_px_per_s: f64,
    /// Seconds from key to key; `None` if it does not move.
    key_s: Option<f64>,
    keys: InstantCache<Key>,
}

/// A layer at the nodes at a key instant.
struct Key {
    /// Luminance, cd/m2, and opacity.
    light: Vec<Vec4>,
    nearness_per_m: Vec<f32>,
}

/// A key shortly before or after the instant.
pub(crate) struct Moved<'a> {
    layer: &'a DriftingLayer,
    key: Arc<Key>,
    after_key_s: f32,
}

impl DriftingLayer {
    /// Follows a layer over nodes.
    pub(crate) fn new(world: &Surroundings, nodes: &Nodes, index: usize) -> Self {
        let layer = &world.clouds.layers()[index];
        let flow = nodes.map(|pixel| flow(world, layer, pixel));
        let begins_m = nodes.map(|pixel| layer.begins_m(&world.view, world.view.ray(pixel)));
        let speed_px_per_s = flow
            .iter()
            .zip(begins_m)
            .filter_map(|(flow, begins_m)| Some(f64::from(flow.length()) / begins_m?))
            .fold(0.0, f64::max)
            * CELL_PX as f64;
        Self {
            index,
            flow,
            speed_px_per_s,
            key_s: (speed_px_per_s > 0.0).then(|| DRIFT_PER_KEY_PX / speed_px_per_s),
            keys: InstantCache::default(),
        }
    }

    /// Drift where it is fastest, pixels per second.
    pub(crate) fn speed_px_per_s(&self) -> f64 {
        self.speed_px_per_s
    }

    /// Seconds from key to key; `None` if the layer does not move.
    #[cfg(test)]
    pub(crate) fn key_s(&self) -> Option<f64> {
        self.key_s
    }

    /// The layer at an instant.
    pub(crate) fn at(&self, world: &Surroundings, nodes: &Nodes, time_s: f64) -> Moved<'_> {
        let key_s = self.key_s.unwrap_or(f64::INFINITY);
        let number = (time_s / key_s).round() as i64;
        let key_time_s = if number == 0 {
            0.0
        } else {
            number as f64 * key_s
        };
        let after_key_s = if self.key_s.is_some() {
            time_s - key_time_s
        } else {
            0.0
        };
        Moved {
            layer: self,
            key: self.key(world, nodes, number, key_time_s),
            after_key_s: after_key_s as f32,
        }
    }

    fn key(&self, world: &Surroundings, nodes: &Nodes, number: i64, time_s: f64) -> Arc<Key> {
        self.keys
            .get(number, || Key::compute(world, nodes, self.index, time_s))
    }
}

impl Key {
    fn compute(world: &Surroundings, nodes: &Nodes, index: usize, time_s: f64) -> Self {
        let layer = &world.clouds.layers()[index];
        let range_m = Clouds::farthest_seen_m(&world.air);
        let (light, nearness_per_m) = nodes
            .map(|pixel| {
                let ray = world.view.ray(pixel);
                let seen = world
                    .clouds
                    .seen(layer, &world.view, &world.air, ray, range_m, time_s);
                (seen.luminance.extend(seen.opacity), seen.nearness_per_m)
            })
            .into_par_iter()
            .unzip();
        Self {
            light,
            nearness_per_m,
        }
    }
}

impl Moved<'_> {
    /// Luminance (cd/m2) and opacity at a node.
    pub(crate) fn at(&self, nodes: &Nodes, node: usize) -> (Vec3, f32) {
        let drift = self.layer.flow[node] * (self.key.nearness_per_m[node] * self.after_key_s);
        let found = if drift == Vec2::ZERO {
            self.key.light[node]
        } else {
            let place = Vec2::new((node % nodes.columns) as f32, (node / nodes.columns) as f32);
            interpolate(&self.key.light, nodes.columns, place - drift).max(Vec4::ZERO)
        };
        (found.truncate(), found.w.min(1.0))
    }
}

/// Drift for an object one metre away in a pixel's direction, cells per second.
fn flow(world: &Surroundings, layer: &Layer, pixel: DVec2) -> Vec2 {
    let place_m = world.view.position_m + world.view.ray(pixel) * YARDSTICK_M;
    let moved = world.view.project(place_m + layer.drift_mps.extend(0.0));
    moved.map_or(Vec2::ZERO, |moved| {
        ((moved - pixel) * (YARDSTICK_M / CELL_PX as f64)).as_vec2()
    })
}

/// Catmull-Rom interpolation through the nodes around a position; beyond its edges the grid is extended by its edge values.
fn interpolate(values: &[Vec4], columns: usize, place: Vec2) -> Vec4 {
    let rows = values.len() / columns;
    let last = Vec2::new((columns - 1) as f32, (rows - 1) as f32);
    let place = place.clamp(Vec2::ZERO, last);
    let first = place.floor();
    let (across, down) = (weights(place.x - first.x), weights(place.y - first.y));
    let within = |first: f32, step: usize, count: usize| {
        (first as usize + step).saturating_sub(1).min(count - 1)
    };
    let mut sum = Vec4::ZERO;
    for (j, down) in down.into_iter().enumerate() {
        let line = &values[within(first.y, j, rows) * columns..][..columns];
        let mut row = Vec4::ZERO;
        for (i, across) in across.into_iter().enumerate() {
            row += line[within(first.x, i, columns)] * across;
        }
        sum += row * down;
    }
    sum
}

/// Weights of the nodes before, at, after and two after a place, `t` past the second.
fn weights(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [
        0.5 * (-t + 2.0 * t2 - t3),
        0.5 * (2.0 - 5.0 * t2 + 3.0 * t3),
        0.5 * (t + 4.0 * t2 - 3.0 * t3),
        0.5 * (t3 - t2),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_is_interpolated_exactly_and_nodes_keep_their_values() {
        let columns = 9;
        let values: Vec<Vec4> = (0..columns * 7)
            .map(|i| Vec4::splat(2.0 * (i % columns) as f32 - 3.0 * (i / columns) as f32))
            .collect();
        for place in [
            Vec2::new(2.0, 3.0),
            Vec2::new(4.3, 2.8),
            Vec2::new(1.0, 4.5),
        ] {
            let found = interpolate(&values, columns, place).x;
            assert!(
                (found - (2.0 * place.x - 3.0 * place.y)).abs() < 1e-4,
                "{found} at {place}"
            );
        }
        let corner = interpolate(&values, columns, Vec2::new(-3.0, 99.0)).x;
        assert!((corner + 18.0).abs() < 1e-4, "{corner}");
    }
}
