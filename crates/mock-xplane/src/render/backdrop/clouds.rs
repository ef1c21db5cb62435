//! Cloud layers: position, brightness, and how they hide the sky behind them.
//!
//! A layer is a slab between base and top. A tile of noise that drifts with the wind gives the horizontal position and the height
//! of the clouds; rays march through the slab. The same march with a shorter range gives the cloud in front of the aircraft, so a
//! hidden aircraft and the cloud that hides it are consistent.
//!
//! All rays of a camera are cut at the same distances. If each were cut from where it enters the slab, the cuts of neighbouring
//! rays would be at the same heights, and the clouds would show terraces.

use dataset::conditions::{CloudKind, CloudLayer, Weather};
use glam::{DVec2, DVec3, Vec3};

use crate::render::air::Air;
use crate::render::backdrop::noise::NoiseTile;
use crate::render::curves::smoothstep;
use crate::render::light::Light;
use crate::render::view::CELL_PX;
use crate::render::view::View;

/// Haze leaves less than half a percent of contrast beyond this optical depth: marching farther is pointless.
const FARTHEST_DEPTH: f64 = 5.3;
/// A ray that is this opaque stops.
const OPAQUE: f32 = 0.01;
/// Step of the march: a share of the distance, within these bounds, metres.
const STEP: (f64, f64, f64) = (0.02, 40.0, 1_500.0);
/// End of the precomputed steps; farther ones are as long as the longest. Beyond any cloud that haze lets through.
const FARTHEST_STEP_M: f64 = 400_000.0;
/// Influence of fine structure on cloud height, as a share of the layer, half to either side.
const RAGGED: f32 = 0.35;
/// Wind grows with height by this power law.
const WIND_EXPONENT: f64 = 0.14;

/// Clouds along a ray.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CloudLight {
    /// Light that the clouds send to the camera through the haze, cd/m2, already weighted with their opacity.
    pub(crate) luminance: Vec3,
    /// Share of the light from behind that passes, 0 to 1.
    pub(crate) transmittance: f32,
}

impl CloudLight {
    const NOTHING: Self = Self {
        luminance: Vec3::ZERO,
        transmittance: 1.0,
    };

    /// The clouds composited over the background.
    pub(crate) fn over(&self, behind: Vec3) -> Vec3 {
        self.luminance + behind * self.transmittance
    }
}

/// A layer along a ray.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LayerAlongRay {
    /// Light that the layer sends to the camera through the haze, cd/m2, already weighted with its opacity.
    pub(crate) luminance: Vec3,
    /// Share of the light from behind that is blocked, 0 to 1.
    pub(crate) opacity: f32,
    /// Mean of 1 / distance over the visible part, 1/m; if no part is visible, of the start of the layer.
    pub(crate) nearness_per_m: f32,
}

impl LayerAlongRay {
    const NOTHING: Self = Self {
        luminance: Vec3::ZERO,
        opacity: 0.0,
        nearness_per_m: 0.0,
    };
}

pub(crate) struct Clouds {
    /// The lowest base first: for cameras, which stand on the ground, the nearest.
    layers: Vec<Layer>,
    light: Light,
    tile: &'static NoiseTile,
    /// Distances from the camera at which march steps end, metres, nearest first.
    steps_m: Vec<f64>,
}

pub(crate) struct Layer {
    kind: CloudKind,
    cover: f32,
    base_m: f64,
    top_m: f64,
    /// Drift, metres per second east and north.
    pub(crate) drift_mps: DVec2,
    /// Side of the repeating tile, metres.
    tile_m: f64,
    /// Extinction inside, 1/m.
    extinction_per_m: f32,
    /// Luminance of the darkest and of the brightest parts, cd/m2.
    shaded: Vec3,
    sunlit: Vec3,
}

impl Clouds {
    pub(crate) fn new(weather: &Weather, light: &Light) -> Self {
        let mut layers: Vec<Layer> = weather
            .clouds
            .iter()
            .filter(|layer| layer.cover_ratio > 0.0 && layer.top_msl_m > layer.base_msl_m)
            .map(|layer| Layer::new(layer, weather, light))
            .collect();
        layers.sort_by(|a, b| a.base_m.total_cmp(&b.base_m));
        let ends = std::iter::successors(Some(STEP.1), |&end_m| {
            Some(end_m + (STEP.0 * end_m).clamp(STEP.1, STEP.2))
        });
        Self {
            layers,
            light: *light,
            tile: NoiseTile::shared(),
            steps_m: ends.take_while(|&end_m| end_m < FARTHEST_STEP_M).collect(),
        }
    }

    /// The layers, nearest first.
    pub(crate) fn layers(&self) -> &[Layer] {
        &self.layers
    }

    pub(crate) fn farthest_seen_m(air: &Air) -> f64 {
        FARTHEST_DEPTH / air.beta_per_m
    }

    /// Share of the layers that is drawn in a direction: clouds far away overlap the silhouette of the horizon, which is drawn once and
    /// does not move.
    pub(crate) fn share(ray: DVec3) -> f32 {
        smoothstep(0.003, 0.012, ray.z as f32)
    }

    /// Follows a ray from the camera up to `range_m`.
    pub(crate) fn along(
        &self,
        view: &View,
        air: &Air,
        ray: DVec3,
        range_m: f64,
        time_s: f64,
    ) -> CloudLight {
        let share = Self::share(ray);
        let mut found = CloudLight::NOTHING;
        for layer in &self.layers {
            if found.transmittance == 0.0 {
                break;
            }
            let seen = self.seen(layer, view, air, ray, range_m, time_s);
            found.luminance += seen.luminance * (share * found.transmittance);
            found.transmittance *= 1.0 - seen.opacity * share;
        }
        found
    }

    /// A layer along a ray from the camera up to `range_m`.
    pub(crate) fn seen(
        &self,
        layer: &Layer,
        view: &View,
        air: &Air,
        ray: DVec3,
        range_m: f64,
        time_s: f64,
    ) -> LayerAlongRay {
        let Some((from_m, to_m)) = layer.span(view, ray) else {
            return LayerAlongRay::NOTHING;
        };
        let to_m = to_m.min(range_m);
        let airlight = air.airlight(ray);
        // Seen against the sun a cloud shows its shaded side.
        let facing = 0.75 - 0.25 * ray.dot(self.light.to_sun) as f32;
        let mut end = self.steps_m.partition_point(|&end_m| end_m <= from_m);
        let mut distance_m = from_m;
        let (mut luminance, mut transmittance, mut nearness) = (Vec3::ZERO, 1.0, 0.0);
        while distance_m < to_m && transmittance > OPAQUE {
            let end_m = match self.steps_m.get(end) {
                Some(end_m) => *end_m,
                None => distance_m + STEP.2,
            };
            end += 1;
            let step_m = end_m.min(to_m) - distance_m;
            let middle_m = distance_m + step_m / 2.0;
            distance_m += step_m;
            let point = view.position_m + ray * middle_m;
            let level =
                ((view.height_msl_m(point) - layer.base_m) / (layer.top_m - layer.base_m)) as f32;
            // Horizontal area covered by one cell of the sky's grid and between two samples of the ray (which need two samples a
            // wave): finer structure must not flicker from row to row.
            let footprint_m = (2.0 * (STEP.0 * middle_m).clamp(STEP.1, STEP.2))
                .max(CELL_PX as f64 / view.camera.focal_px * middle_m / ray.z.max(0.01));
            let plan_m = point.truncate() - layer.drift_mps * time_s;
            let puff = layer.puff(self.tile, plan_m, footprint_m, level);
            if puff.density > 0.0 {
                let through = (-layer.extinction_per_m * puff.density * step_m as f32).exp();
                let lit = smoothstep(-0.1, 0.6, level) * facing;
                let own = layer.shaded.lerp(layer.sunlit, lit) * puff.brightness;
                let t = air.transmittance(middle_m);
                let weight = transmittance * (1.0 - through);
                luminance += (own * t + airlight * (1.0 - t)) * weight;
                nearness += weight / middle_m as f32;
                transmittance *= through;
            }
        }
        let opacity = 1.0 - transmittance;
        if opacity <= 0.0 {
            return LayerAlongRay {
                nearness_per_m: 1.0 / from_m.max(STEP.1) as f32,
                ..LayerAlongRay::NOTHING
            };
        }
        // The residual where the march gave up counts as zero: a landing light would shine through one percent.
        let stretch = (opacity / (1.0 - OPAQUE)).min(1.0) / opacity;
        LayerAlongRay {
            luminance: luminance * stretch,
            opacity: opacity * stretch,
            nearness_per_m: nearness / opacity,
        }
    }
}

impl Layer {
    fn new(layer: &CloudLayer, weather: &Weather, light: &Light) -> Self {
        let aloft = (layer.base_msl_m.max(10.0) / 10.0).powf(WIND_EXPONENT);
        let (sin, cos) = weather.wind_from_true_deg.to_radians().sin_cos();
        let (tile_m, extinction_per_m, gloom) = match layer.kind {
            CloudKind::Cirrus => (60_000.0, 1.5e-4, 1.0),
            CloudKind::Stratus => (32_000.0, 0.012, 0.8),
            CloudKind::Cumulus => (20_000.0, 0.020, 1.0),
            CloudKind::Cumulonimbus => (48_000.0, 0.030, 0.55),
        };
        let rain = 1.0 - 0.4 * weather.rain_ratio as f32;
        let lambert = 0.85 / std::f32::consts::PI;
        // From below one sees the transmitted light; gaps between clouds let the sky light their undersides.
        let below = light.sky_lux * (0.75 * lambert * gloom * rain);
        let above = (light.sun_above_lux * 0.9 + light.sky_above_lux) * lambert;
        // Through a closed cover no sun reaches the visible sides.
        let open = 1.0 - smoothstep(0.6, 0.95, layer.cover_ratio as f32);
        Self {
            kind: layer.kind,
            cover: layer.cover_ratio.clamp(0.0, 1.0) as f32,
            base_m: layer.base_msl_m,
            top_m: layer.top_msl_m,
            drift_mps: DVec2::new(-sin, -cos) * (weather.wind_speed_mps * aloft),
            tile_m,
            extinction_per_m,
            shaded: below,
            sunlit: below * 1.3 + above * (open * gloom * rain),
        }
    }

    /// Distance to the layer along a ray, metres, if the ray meets it; from a camera inside it, at least a step.
    pub(crate) fn begins_m(&self, view: &View, ray: DVec3) -> Option<f64> {
        let (from_m, _) = self.span(view, ray)?;
        Some(from_m.max(STEP.1))
    }

    /// Distances between which a ray is inside the slab; a camera above the layer does not look down on it.
    fn span(&self, view: &View, ray: DVec3) -> Option<(f64, f64)> {
        let camera_m = view.height_msl_m(view.position_m);
        if camera_m >= self.top_m {
            return None;
        }
        let [_, to] = view.distances_to_height(ray, self.top_m)?;
        let from = if camera_m >= self.base_m {
            0.0
        } else {
            view.distances_to_height(ray, self.base_m)?[1]
        };
        Some((from, to))
    }

    /// The cloud at a position of the drifting tile and a level between base (0) and top (1).
    fn puff(&self, tile: &NoiseTile, plan_m: DVec2, footprint_m: f64, level: f32) -> Puff {
        let coarse = plan_m / self.tile_m;
        let excess = (tile.blurred(coarse.x, coarse.y, footprint_m / self.tile_m)
            - (1.0 - self.cover))
            / self.cover.max(0.05);
        if excess < -0.3 || !(0.0..=1.0).contains(&level) {
            return Puff {
                density: 0.0,
                brightness: 1.0,
            };
        }
        let heaps = matches!(self.kind, CloudKind::Cumulus | CloudKind::Cumulonimbus);
        let heap = excess.max(0.0).sqrt();
        // Above the highest possible cloud, fine structure included, no lookup is needed.
        if heaps && heap + 0.5 * RAGGED <= level {
            return Puff {
                density: 0.0,
                brightness: 1.0,
            };
        }
        // Fine structure slides sideways with height, which breaks the columns of two-dimensional tiles.
        let height_m = f64::from(level) * (self.top_m - self.base_m);
        let fine_m = 0.19 * self.tile_m;
        let fine = (plan_m + DVec2::new(0.6, -0.4) * height_m) / fine_m;
        let detail = tile.blurred(fine.x, fine.y, footprint_m / fine_m) - 0.5;
        let density = match self.kind {
            CloudKind::Cirrus => smoothstep(0.0, 0.8, excess + 0.4 * detail),
            CloudKind::Stratus => {
                let edges = smoothstep(0.0, 0.15, level) * (1.0 - smoothstep(0.8, 1.0, level));
                smoothstep(0.0, 0.25, excess + 0.3 * detail) * edges
            }
            CloudKind::Cumulus | CloudKind::Cumulonimbus => {
                smoothstep(0.0, 0.25, heap + RAGGED * detail - level) * smoothstep(0.0, 0.04, level)
            }
        };
        // The thicker the cloud above, the darker its underside.
        let brightness = (1.0 + 0.7 * detail) * (1.1 - 0.5 * excess.max(0.0) * (1.0 - level));
        Puff {
            density,
            brightness,
        }
    }
}

/// A small piece of cloud.
struct Puff {
    /// 0 none to 1 the densest.
    density: f32,
    /// Relative to the layer's own luminance.
    brightness: f32,
}
