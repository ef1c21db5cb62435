//! The aircraft in the image: its mesh lit by sun, sky and ground, and its own lamps.

pub(crate) mod raster;

use airframe::{AircraftType, Configuration, LampPlaces, Mesh};
use dataset::geometry::pose::{Controls, Pose};
use glam::{DMat3, DVec2, DVec3, Vec3};

use crate::render::air::Air;
use crate::render::curves::smoothstep;
use crate::render::imaging::tone::Tone;
use crate::render::lamps::Spot;
use crate::render::lamps::site_lamps::spot;
use crate::render::light::Light;
use crate::render::view::View;
use raster::ScreenTriangle;

/// Reflectance of the ground that lights the aircraft from below.
const GROUND_REFLECTANCE: f32 = 0.12;
/// Mirror reflection of paint at a right angle.
const GLOSS: f32 = 0.04;
/// Minimum distance from the camera at which anything is drawn, metres.
const NEAREST_M: f64 = 1.0;
/// Landing lights burn below this height, metres (10 000 ft).
const LIGHTS_BELOW_MSL_M: f64 = 3_048.0;

/// An aircraft at an instant, relative to a camera.
pub(crate) struct Placed<'a> {
    pub(crate) pose: &'a Pose,
    pub(crate) controls: &'a Controls,
    /// Rotation: body axes to camera axes.
    camera_from_body: DMat3,
    /// Centre of gravity in camera axes, metres.
    center_camera_m: DVec3,
    /// Rotation: site axes (east, north, up) to body axes.
    body_from_site: DMat3,
}

impl<'a> Placed<'a> {
    pub(crate) fn new(view: &View, pose: &'a Pose, controls: &'a Controls) -> Self {
        let ecef_from_body = pose.ecef_from_body();
        Self {
            pose,
            controls,
            camera_from_body: view.camera.ecef_from_camera.transpose() * ecef_from_body,
            center_camera_m: view.to_camera(pose.position().to_ecef()),
            body_from_site: (view.site_from_ecef * ecef_from_body).transpose(),
        }
    }

    /// True if the aircraft is in front of the camera at all.
    pub(crate) fn is_ahead(&self) -> bool {
        self.center_camera_m.z > NEAREST_M
    }

    /// Position of the centre of gravity in the image, pixels; it must be in front of the camera.
    pub(crate) fn center_px(&self, view: &View) -> DVec2 {
        view.camera.pixel_of(self.center_camera_m)
    }

    /// Distance from the camera, metres.
    pub(crate) fn distance_m(&self) -> f64 {
        self.center_camera_m.length()
    }

    /// The mesh of a type in this configuration.
    pub(crate) fn mesh(&self, aircraft: &AircraftType) -> Mesh {
        aircraft.mesh(Configuration {
            flap_ratio: self.controls.flap_ratio,
            gear_ratio: self.controls.gear_ratio,
        })
    }

    /// The faces that point towards the camera. Light: the exposed light that arrives (red, green, blue), and the transmittance, the share
    /// of the air's light that is *not* in front of them.
    pub(crate) fn triangles(
        &self,
        mesh: &Mesh,
        view: &View,
        air: &Air,
        light: &Light,
        tone: &Tone,
    ) -> Vec<ScreenTriangle> {
        let camera = &view.camera;
        let in_camera: Vec<DVec3> = mesh
            .vertices
            .iter()
            .map(|&vertex| self.center_camera_m + self.camera_from_body * vertex)
            .collect();
        let shading = Shading::new(self, light, air);
        mesh.triangles
            .iter()
            .filter_map(|triangle| {
                let corners = triangle.indices.map(|i| in_camera[i as usize]);
                let [a, b, c] = corners;
                let faces_away = (b - a).cross(c - a).dot(a) >= 0.0;
                if faces_away || corners.iter().any(|corner| corner.z < NEAREST_M) {
                    return None;
                }
                let [p, q, r] = mesh.corners(triangle);
                let normal = (q - p).cross(r - p).normalize_or_zero();
                let luminance = shading.luminance(
                    normal,
                    (p + q + r) / 3.0,
                    Vec3::from(triangle.material.reflectance()),
                );
                let t = air.transmittance(((a + b + c) / 3.0).length());
                Some(ScreenTriangle {
                    pixels: corners.map(|v| camera.pixel_of(v)),
                    // 1/depth relative to the centre of gravity, so that 32 bits suffice.
                    nearness: corners.map(|v| self.center_camera_m.z / v.z - 1.0),
                    light: (tone.expose(luminance) * t).extend(t),
                })
            })
            .collect()
    }

    /// The aircraft's lamps in the image at a time.
    pub(crate) fn lamps(
        &self,
        (always, landing): &([Lamp; 7], [Lamp; 3]),
        view: &View,
        air: &Air,
        tone: &Tone,
        time_s: f64,
    ) -> Vec<Spot> {
        let to_camera = (self.camera_from_body.transpose() * -self.center_camera_m).normalize();
        let approach =
            self.controls.gear_ratio > 0.5 || self.pose.altitude_msl_m < LIGHTS_BELOW_MSL_M;
        let lamps = always
            .iter()
            .chain(if approach { landing.as_slice() } else { &[] });
        lamps
            .filter(|lamp| lamp.needs_gear <= self.controls.gear_ratio && lamp.flash.is_on(time_s))
            .filter_map(|lamp| {
                let candela = Vec3::from(lamp.candela) * lamp.beam.towards(to_camera);
                let site_m =
                    view.position_m + self.site_offset_m(view, DVec3::from(lamp.position_m));
                (candela.max_element() > 0.0)
                    .then(|| spot(view, air, tone, site_m, candela))
                    .flatten()
            })
            .collect()
    }

    /// Vector from the camera to a body point, in site axes.
    fn site_offset_m(&self, view: &View, body_m: DVec3) -> DVec3 {
        let camera_m = self.center_camera_m + self.camera_from_body * body_m;
        view.site_from_ecef * (view.camera.ecef_from_camera * camera_m)
    }
}

/// Light on the aircraft, in body axes.
struct Shading {
    to_sun: DVec3,
    up: DVec3,
    camera_m: DVec3,
    sun_lux: Vec3,
    sky_lux: Vec3,
    ground_lux: Vec3,
    horizon: Vec3,
}

impl Shading {
    fn new(placed: &Placed, light: &Light, air: &Air) -> Self {
        let horizon_ray = DVec3::new(light.to_sun.x, light.to_sun.y, 0.0)
            .cross(DVec3::Z)
            .normalize_or(DVec3::X);
        Self {
            to_sun: placed.body_from_site * light.to_sun,
            up: placed.body_from_site * DVec3::Z,
            camera_m: placed.camera_from_body.transpose() * -placed.center_camera_m,
            sun_lux: light.sun_lux,
            sky_lux: light.sky_lux,
            ground_lux: light.ground_lux() * GROUND_REFLECTANCE,
            horizon: air.airlight(horizon_ray),
        }
    }

    /// Face luminance: Lambert's law under sun, sky above and ground below, and the horizon mirrored in glossy paint.
    fn luminance(&self, normal: DVec3, place_m: DVec3, reflectance: Vec3) -> Vec3 {
        let sun = normal.dot(self.to_sun).max(0.0) as f32;
        let sky_share = ((1.0 + normal.dot(self.up)) / 2.0) as f32;
        // The sky is brightest near the horizon, which faces upright surfaces.
        let upright = (1.0 - normal.dot(self.up).powi(2)) as f32 * 0.25;
        let lux = self.sun_lux * sun
            + self.sky_lux * (sky_share + upright)
            + self.ground_lux * (1.0 - sky_share);
        let to_camera = (self.camera_m - place_m).normalize();
        let mirrored =
            GLOSS + (1.0 - GLOSS) * (1.0 - normal.dot(to_camera).clamp(0.0, 1.0) as f32).powi(5);
        let reflected_ray = normal * (2.0 * normal.dot(to_camera)) - to_camera;
        let above = smoothstep(-0.15, 0.15, reflected_ray.dot(self.up) as f32);
        let seen_in_paint = (self.ground_lux / std::f32::consts::PI).lerp(self.horizon, above);
        reflectance * lux / std::f32::consts::PI * (1.0 - mirrored) + seen_in_paint * mirrored * 0.6
    }
}

/// A lamp of the aircraft.
pub(crate) struct Lamp {
    /// Body axes, metres.
    position_m: [f64; 3],
    /// Intensity on the beam's axis, per colour.
    candela: [f32; 3],
    beam: Beam,
    flash: Flash,
    /// The lamp is on when the gear is at least this far down.
    needs_gear: f64,
}

enum Beam {
    /// Ahead, a little down: a Gaussian of this standard deviation (radians) and one percent of spill to the front.
    Ahead(f32),
    /// A sector of the horizon: from dead ahead to 110 degrees to the right (1) or left (-1).
    Side(f64),
    /// 70 degrees to each side of dead astern.
    Astern,
    /// Everywhere.
    Around,
}

impl Beam {
    /// Share of the intensity in a direction of the body.
    fn towards(&self, direction: DVec3) -> f32 {
        let angle = direction.y.atan2(direction.x).to_degrees();
        match *self {
            Self::Ahead(sigma) => {
                let axis = DVec3::new(1.0, 0.0, 0.05).normalize();
                let off = direction.dot(axis).clamp(-1.0, 1.0).acos() as f32;
                let spill = if direction.x > 0.0 { 0.01 } else { 0.0 };
                (-0.5 * (off / sigma).powi(2)).exp() + spill
            }
            // Two degrees of overlap ahead, as real lamps have.
            Self::Side(side) => f32::from((-2.0..110.0).contains(&(angle * side))),
            Self::Astern => f32::from(angle.abs() > 110.0),
            Self::Around => 1.0,
        }
    }
}

enum Flash {
    Steady,
    /// Period, duration and phase of the flash, seconds.
    Every(f64, f64, f64),
}

impl Flash {
    fn is_on(&self, time_s: f64) -> bool {
        match *self {
            Self::Steady => true,
            Self::Every(period_s, flash_s, start_s) => {
                (time_s - start_s).rem_euclid(period_s) < flash_s
            }
        }
    }
}

/// A lamp that is always on.
const fn lamp(position_m: [f64; 3], candela: [f32; 3], beam: Beam) -> Lamp {
    Lamp {
        position_m,
        candela,
        beam,
        flash: Flash::Steady,
        needs_gear: 0.0,
    }
}

const fn strobe(position_m: [f64; 3]) -> Lamp {
    Lamp {
        flash: Flash::Every(1.1, 0.07, 0.0),
        ..lamp(position_m, [900.0, 920.0, 1_000.0], Beam::Around)
    }
}

const fn beacon(position_m: [f64; 3]) -> Lamp {
    Lamp {
        flash: Flash::Every(1.3, 0.10, 0.5),
        ..lamp(position_m, [180.0, 8.0, 4.0], Beam::Around)
    }
}

const fn landing_lamp(position_m: [f64; 3]) -> Lamp {
    lamp(
        position_m,
        [105_000.0, 100_000.0, 84_000.0],
        Beam::Ahead(0.16),
    )
}

/// The lamps that are always on, and those of the approach.
pub(crate) fn lamps_of(places: &LampPlaces) -> ([Lamp; 7], [Lamp; 3]) {
    let left = |[x, y, z]: [f64; 3]| [x, -y, z];
    let always = [
        lamp(left(places.wing_tip), [50.0, 2.0, 1.0], Beam::Side(-1.0)),
        lamp(places.wing_tip, [2.0, 45.0, 18.0], Beam::Side(1.0)),
        lamp(places.tail, [50.0, 48.0, 42.0], Beam::Astern),
        strobe(left(places.strobe)),
        strobe(places.strobe),
        beacon(places.upper_beacon),
        beacon(places.lower_beacon),
    ];
    let landing = [
        landing_lamp(left(places.landing)),
        landing_lamp(places.landing),
        Lamp {
            needs_gear: 0.6,
            ..lamp(
                places.nose_leg,
                [31_000.0, 30_000.0, 25_000.0],
                Beam::Ahead(0.20),
            )
        },
    ];
    (always, landing)
}
