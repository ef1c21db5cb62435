//! The renderer: sky, clouds, ground, runway and aircraft, drawn in software.
//!
//! Input: a camera, a runway, weather and a clock; then for every frame the aircraft's pose. Output: 8-bit sRGB images.
//! Everything behind the aircraft is computed once per [`Scene`] and copied, clouds as often as they drift; each aircraft's patch is
//! drawn with many samples per pixel and composited in linear light, the farthest first. The same inputs give the same bytes, whatever the
//! number of threads.
//!
//! Distortion and refraction belong to the camera: rays and projections include them, so no image is drawn first and warped
//! afterwards. Blur, seeing, sway and noise are a [`Degradation`], and have no cost when absent.

mod air;
mod aircraft;
mod backdrop;
mod curves;
mod imaging;
mod instant_cache;
mod lamps;
mod light;
pub(crate) mod overlay;
mod rain;
mod view;

use std::sync::{Mutex, PoisonError};

use airframe::AircraftType;
use dataset::conditions::{Clock, Weather};
use dataset::geometry::camera::Camera;
use dataset::geometry::geodesy::Geodetic;
use dataset::geometry::imaging::Degradation;
use dataset::geometry::pose::{Controls, Pose};
use dataset::geometry::runway::Runway;
use glam::{DVec2, DVec3, Vec3};

use air::Air;
use aircraft::raster::{Patch, Scratch};
use aircraft::{Placed, lamps_of};
use backdrop::clouds::{CloudLight, Clouds};
use backdrop::ground::Ground;
use backdrop::{Backdrop, Surroundings};
use imaging::blur::Blur;
use imaging::seeing::Turbulence;
use imaging::sensor::SensorNoise;
use imaging::sway::SwayingMast;
pub(crate) use imaging::sway::displace;
use imaging::tone::Tone;
use lamps::Spot;
use light::Light;
use view::View;

/// A place, its weather and time as seen by a camera; draws frames with an aircraft in it.
pub struct Scene {
    world: Surroundings,
    light: Light,
    backdrop: Backdrop,
    rain_ratio: f64,
    /// Display value of raindrops, and the seed that gives each camera different drops.
    rain_grey: [f32; 3],
    rain_seed: u32,
    aircraft: &'static AircraftType,
    scratch: Mutex<Vec<Scratch>>,
    spoiled: Spoiled,
}

/// The instants of the moving parts of the scene, seconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Instants {
    /// Flashing lamps.
    pub lamps_s: f64,
    /// Clouds, rain, air and the sensor's noise.
    pub weather_s: f64,
}

impl Instants {
    /// All parts at the same instant.
    pub fn all(time_s: f64) -> Self {
        Self {
            lamps_s: time_s,
            weather_s: time_s,
        }
    }
}

/// Degradation of the images; none by default.
#[derive(Default)]
struct Spoiled {
    blur_sigma_px: f64,
    turbulence: Option<Turbulence>,
    mast: Option<SwayingMast>,
    noise: Option<SensorNoise>,
}

impl Spoiled {
    /// Blur of something at a distance, if there is any.
    fn blur(&self, distance_m: f64) -> Option<Blur> {
        let seeing_px = self
            .turbulence
            .as_ref()
            .map_or(0.0, |air| air.blur_px(distance_m));
        Blur::new(self.blur_sigma_px.hypot(seeing_px))
    }

    /// Displacement by seeing at a distance, pixels.
    fn shift_px(&self, distance_m: f64, time_s: f64) -> Option<DVec2> {
        self.turbulence
            .as_ref()
            .map(|air| air.shift_px(distance_m, time_s))
    }
}

/// Light of a pixel patch, row by row, with its rectangle. Only pixels that differ from the backdrop have light.
struct Canvas {
    x: usize,
    y: usize,
    width: usize,
    light: Vec<Vec3>,
    /// True for pixels that differ from the backdrop.
    touched: Vec<bool>,
}

impl Scene {
    /// Computes and caches everything that does not depend on the aircraft (some tenths of a second for a large image). The position of the
    /// sun is computed for the year 2023, as seen from the camera.
    pub fn new(camera: &Camera, runway: &Runway, weather: &Weather, clock: &Clock) -> Self {
        let view = View::new(camera, runway);
        let beta_per_m = air::beta_per_m(weather.visibility_m);
        let light = Light::new(
            Geodetic::from_ecef(camera.center_ecef_m),
            clock,
            weather,
            beta_per_m,
        );
        let air = Air::new(beta_per_m, light);
        // All cameras at a site expose for the same part of the sky: the one that aircraft come from.
        let approach = (-view.course + DVec3::Z * 0.03).normalize();
        let tone = Tone::for_horizon(curves::luminance(air.airlight(approach)));
        let ground = Ground::new(&view, runway, &air, &light, weather.rain_ratio);
        let site_lamps = lamps::site_lamps::spots(&view, &air, &tone, &ground);
        let rain_grey = imaging::tone::encode(tone.expose(air.airlight(approach) * 1.3)).to_array();
        let rain_seed = view.position_m.to_array().iter().fold(0, |seed, c| {
            backdrop::noise::hash(seed, c.to_bits() as u32, (c.to_bits() >> 32) as u32)
        });
        let world = Surroundings {
            clouds: Clouds::new(weather, &light),
            view,
            air,
            tone,
        };
        let backdrop = Backdrop::new(&world, &ground, &site_lamps);
        Self {
            world,
            light,
            backdrop,
            rain_ratio: weather.rain_ratio,
            rain_grey,
            rain_seed,
            aircraft: AircraftType::boeing_737_800(),
            scratch: Mutex::default(),
            spoiled: Spoiled::default(),
        }
    }

    /// Draws this type; the 737-800 otherwise.
    #[must_use]
    pub fn with_aircraft(mut self, aircraft: &'static AircraftType) -> Self {
        self.aircraft = aircraft;
        self
    }

    /// Adds the effects of optics, air and sensor.
    #[must_use]
    pub fn degraded(mut self, degradation: &Degradation) -> Self {
        let focal_px = self.world.view.camera.focal_px;
        let turbulence = degradation
            .seeing
            .map(|seeing| Turbulence::new(&seeing, focal_px, degradation.seed));
        let backdrop_px = turbulence
            .as_ref()
            .map_or(0.0, Turbulence::backdrop_blur_px);
        if let Some(blur) = Blur::new(degradation.blur_sigma_px.hypot(backdrop_px)) {
            self.backdrop.blur(&blur);
        }
        self.spoiled = Spoiled {
            blur_sigma_px: degradation.blur_sigma_px,
            turbulence,
            mast: degradation
                .sway
                .map(|sway| SwayingMast::new(&sway, degradation.seed)),
            noise: degradation
                .sensor
                .map(|sensor| SensorNoise::new(&sensor, degradation.seed)),
        };
        self
    }

    /// Draws one frame. `time_s` moves clouds, rain and flashing lamps; `rgb` contains `width * height * 3` bytes, row by row.
    ///
    /// # Panics
    ///
    /// If the length of `rgb` is wrong.
    pub fn render(&self, pose: &Pose, controls: &Controls, time_s: f64, rgb: &mut [u8]) {
        self.draw_frame((pose, controls), &[], Instants::all(time_s), true, rgb);
    }

    /// [`Self::render`] with other aircraft: type, pose and configuration of each.
    pub(crate) fn draw_frame(
        &self,
        (pose, controls): (&Pose, &Controls),
        others: &[(&'static AircraftType, &Pose, &Controls)],
        Instants { lamps_s, weather_s }: Instants,
        with_lamps: bool,
        rgb: &mut [u8],
    ) {
        let size = self.size();
        assert_eq!(
            rgb.len(),
            size.0 * size.1 * 3,
            "an image of {} x {} pixels has another number of bytes",
            size.0,
            size.1
        );
        let sky = self.backdrop.paint(&self.world, weather_s, rgb);
        let first = [(self.aircraft, pose, controls)];
        let mut all: Vec<_> = (first.iter().chain(others))
            .map(|(of, pose, controls)| (*of, Placed::new(&self.world.view, pose, controls)))
            .filter(|(_, placed)| placed.is_ahead())
            .collect();
        // Nearer ones hide farther ones.
        all.sort_by(|(_, a), (_, b)| b.distance_m().total_cmp(&a.distance_m()));
        let mut drawn: Vec<Canvas> = Vec::with_capacity(all.len());
        for (aircraft, placed) in &all {
            let clouds = CloudsBefore::new(&self.world, placed, weather_s);
            let distance_m = placed.distance_m();
            let shift_px = self.spoiled.shift_px(distance_m, weather_s);
            let patch = self.draw_airframe(aircraft, placed, shift_px);
            let mut lamps = if with_lamps {
                self.visible_lamps(aircraft, placed, &clouds, lamps_s)
            } else {
                vec![]
            };
            if let Some(shift_px) = shift_px {
                lamps.iter_mut().for_each(|lamp| lamp.pixel += shift_px);
            }
            let blur = self.spoiled.blur(distance_m);
            let behind = |x: usize, y: usize| {
                let farther = drawn.iter().rev().find_map(|canvas| canvas.at(x, y));
                farther.unwrap_or_else(|| self.backdrop.light(&sky, x, y))
            };
            let canvas = self.composite(patch.as_ref(), &lamps, &clouds, behind, blur.as_ref());
            if let Some(canvas) = canvas {
                canvas.write(rgb, size.0);
                drawn.push(canvas);
            }
        }
        if let Some(mast) = &self.spoiled.mast {
            mast.move_picture(rgb, size, weather_s);
        }
        if self.rain_ratio > 0.0 {
            rain::draw(
                rgb,
                size,
                self.rain_ratio,
                self.rain_grey,
                weather_s,
                self.rain_seed,
            );
        }
        if let Some(noise) = &self.spoiled.noise {
            noise.add(rgb, size.0, weather_s);
        }
    }

    /// Width and height of the image, pixels.
    fn size(&self) -> (usize, usize) {
        (
            self.world.view.camera.width_px as usize,
            self.world.view.camera.height_px as usize,
        )
    }

    fn draw_airframe(
        &self,
        aircraft: &AircraftType,
        placed: &Placed,
        shift_px: Option<DVec2>,
    ) -> Option<Patch> {
        let world = &self.world;
        let mut triangles = placed.triangles(
            &placed.mesh(aircraft),
            &world.view,
            &world.air,
            &self.light,
            &world.tone,
        );
        if let Some(shift_px) = shift_px {
            let corners = triangles
                .iter_mut()
                .flat_map(|triangle| &mut triangle.pixels);
            corners.for_each(|corner| *corner += shift_px);
        }
        let mut scratch = self
            .scratch
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .pop()
            .unwrap_or_default();
        let patch = aircraft::raster::draw(&triangles, self.size(), &mut scratch);
        self.scratch
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .push(scratch);
        patch
    }

    fn visible_lamps(
        &self,
        aircraft: &AircraftType,
        placed: &Placed,
        clouds: &CloudsBefore,
        time_s: f64,
    ) -> Vec<Spot> {
        let mut lamps = placed.lamps(
            &lamps_of(&aircraft.lamp_places()),
            &self.world.view,
            &self.world.air,
            &self.world.tone,
            time_s,
        );
        for spot in &mut lamps {
            spot.energy *= clouds.at(spot.pixel).transmittance;
        }
        lamps
    }

    /// Composites airframe and lamps over the light `behind` them, in linear light. `None` if neither is inside the image.
    fn composite(
        &self,
        patch: Option<&Patch>,
        lamps: &[Spot],
        clouds: &CloudsBefore,
        behind: impl Fn(usize, usize) -> Vec3,
        blur: Option<&Blur>,
    ) -> Option<Canvas> {
        let margin_px = blur.map_or(0, Blur::reach_px);
        let mut canvas = Canvas::around(patch, lamps, margin_px, self.size())?;
        let lamps: Vec<(&Spot, f64)> = lamps.iter().map(|spot| (spot, spot.reach_px())).collect();
        for index in 0..canvas.light.len() {
            let (x, y) = (
                canvas.x + index % canvas.width,
                canvas.y + index / canvas.width,
            );
            let covered = patch
                .and_then(|patch| patch.at(x, y))
                .filter(|(coverage, _)| *coverage > 0.0);
            let place = DVec2::new(x as f64, y as f64);
            let glow: Vec3 = lamps
                .iter()
                .filter(|(spot, reach_px)| place.distance_squared(spot.pixel) <= reach_px.powi(2))
                .map(|(spot, _)| spot.on(x as i64, y as i64))
                .sum();
            canvas.touched[index] = covered.is_some() || glow.max_element() > 0.0;
            // A blur needs all pixels. Without one, unused light is not worth its logarithms.
            if !canvas.touched[index] && blur.is_none() {
                continue;
            }
            let behind = behind(x, y);
            let mut light = behind;
            if let Some((coverage, sum)) = covered {
                let airlight = self
                    .world
                    .tone
                    .expose(self.world.air.airlight(self.world.view.ray(place)));
                let before = clouds.at(place);
                let body = sum.truncate() + airlight * (coverage - sum.w);
                light = behind * (1.0 - coverage)
                    + before.luminance * coverage
                    + body * before.transmittance;
            }
            canvas.light[index] = light + glow;
        }
        if let Some(blur) = blur {
            canvas.blur(blur, behind);
        }
        Some(canvas)
    }
}

impl Patch {
    /// Coverage and light of an image pixel, if the patch contains it.
    fn at(&self, x: usize, y: usize) -> Option<(f32, glam::Vec4)> {
        let (column, row) = (x.checked_sub(self.x)?, y.checked_sub(self.y)?);
        (column < self.width && row < self.height).then(|| {
            (
                self.coverage[row * self.width + column],
                self.light[row * self.width + column],
            )
        })
    }
}

impl Canvas {
    /// An empty canvas for a patch, the reach of all lamps, and a margin.
    fn around(
        patch: Option<&Patch>,
        lamps: &[Spot],
        margin_px: usize,
        (width, height): (usize, usize),
    ) -> Option<Self> {
        let mut min = DVec2::INFINITY;
        let mut max = DVec2::NEG_INFINITY;
        if let Some(patch) = patch {
            let corner = DVec2::new(patch.x as f64, patch.y as f64);
            min = min.min(corner);
            max = max.max(corner + DVec2::new(patch.width as f64 - 1.0, patch.height as f64 - 1.0));
        }
        for spot in lamps {
            let reach = spot.reach_px();
            if reach > 0.0 {
                min = min.min(spot.pixel - reach);
                max = max.max(spot.pixel + reach);
            }
        }
        let margin_px = margin_px as f64;
        let min = (min - margin_px).ceil().max(DVec2::ZERO);
        let max = (max + margin_px)
            .floor()
            .min(DVec2::new(width as f64 - 1.0, height as f64 - 1.0));
        (min.x <= max.x && min.y <= max.y).then(|| {
            let (columns, rows) = ((max.x - min.x) as usize + 1, (max.y - min.y) as usize + 1);
            Self {
                x: min.x as usize,
                y: min.y as usize,
                width: columns,
                light: vec![Vec3::ZERO; columns * rows],
                touched: vec![false; columns * rows],
            }
        })
    }

    /// Light of an image pixel, if it differs from the background.
    fn at(&self, x: usize, y: usize) -> Option<Vec3> {
        let (column, row) = (x.checked_sub(self.x)?, y.checked_sub(self.y)?);
        let index = row * self.width + column;
        let is_inside = column < self.width && index < self.light.len();
        (is_inside && self.touched[index]).then(|| self.light[index])
    }

    /// Blurs what aircraft and lamps change; the backdrop has been blurred before.
    fn blur(&mut self, blur: &Blur, behind: impl Fn(usize, usize) -> Vec3) {
        let behind: Vec<Vec3> = (0..self.light.len())
            .map(|i| behind(self.x + i % self.width, self.y + i / self.width))
            .collect();
        let mut changes: Vec<Vec3> = self
            .light
            .iter()
            .zip(&behind)
            .map(|(a, b)| *a - *b)
            .collect();
        blur.apply(&mut changes, self.width);
        for (index, change) in changes.into_iter().enumerate() {
            self.light[index] = (behind[index] + change).max(Vec3::ZERO);
            self.touched[index] |= change != Vec3::ZERO;
        }
    }

    /// Writes the pixels that differ from the backdrop.
    fn write(&self, rgb: &mut [u8], picture_width: usize) {
        for (index, &light) in self
            .light
            .iter()
            .enumerate()
            .filter(|(index, _)| self.touched[*index])
        {
            let (x, y) = (self.x + index % self.width, self.y + index / self.width);
            rgb[(y * picture_width + x) * 3..][..3]
                .copy_from_slice(&imaging::tone::to_bytes(imaging::tone::encode(light)));
        }
    }
}

/// The clouds between camera and aircraft, sampled around the aircraft and interpolated.
struct CloudsBefore {
    origin: DVec2,
    spacing_px: f64,
    /// Three by three samples, exposed.
    samples: [CloudLight; 9],
}

impl CloudsBefore {
    fn new(world: &Surroundings, placed: &Placed, time_s: f64) -> Self {
        let camera = &world.view.camera;
        let distance_m = placed.distance_m();
        let center = placed.center_px(&world.view);
        // Half a span and a little, as it appears.
        let spacing_px = (20.0 * camera.focal_px / distance_m).max(1.0);
        let origin = center - spacing_px;
        let samples = std::array::from_fn(|i| {
            let pixel = origin + DVec2::new((i % 3) as f64, (i / 3) as f64) * spacing_px;
            let found = world.clouds.along(
                &world.view,
                &world.air,
                world.view.ray(pixel),
                distance_m,
                time_s,
            );
            CloudLight {
                luminance: world.tone.expose(found.luminance),
                ..found
            }
        });
        Self {
            origin,
            spacing_px,
            samples,
        }
    }

    fn at(&self, pixel: DVec2) -> CloudLight {
        let place = ((pixel - self.origin) / self.spacing_px).clamp(DVec2::ZERO, DVec2::splat(2.0));
        let cell = place.floor().min(DVec2::ONE);
        let part = (place - cell).as_vec2();
        let first = cell.x as usize + 3 * cell.y as usize;
        let mix = |a: CloudLight, b: CloudLight, part: f32| CloudLight {
            luminance: a.luminance.lerp(b.luminance, part),
            transmittance: a.transmittance + (b.transmittance - a.transmittance) * part,
        };
        let s = &self.samples;
        mix(
            mix(s[first], s[first + 1], part.x),
            mix(s[first + 3], s[first + 4], part.x),
            part.y,
        )
    }
}

#[cfg(test)]
mod tests;
