//! The server's interface to a simulator: flying an approach and drawing images. The built-in engine is this crate's own; tests use a
//! cheaper one.

use airframe::AircraftType;
use dataset::conditions::{Clock, Weather};
use dataset::geometry::camera::Camera;
use dataset::geometry::imaging::Degradation;
use dataset::geometry::pose::{Controls, FlightState, Pose};
use dataset::geometry::runway::Runway;
use flight_model::NotLanded;
use xplane_bridge::fly::FlyRequest;

pub use crate::render::Instants;
use crate::render::Scene;

/// Reason why an engine does not fly an approach.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NotFlown {
    /// The aircraft was still in the air at the end.
    #[error(transparent)]
    NotLanded(#[from] NotLanded),
    /// Any other reason.
    #[error("{0}")]
    Because(&'static str),
}

/// A flight model and a renderer.
pub trait Engine: Send + Sync + 'static {
    /// Flies an approach with a type in this weather; the states at the model's own rate. An engine that only draws need not implement it.
    fn fly(
        &self,
        _: &FlyRequest,
        _: &AircraftType,
        _: &Weather,
    ) -> Result<Vec<FlightState>, NotFlown> {
        Err(NotFlown::Because("this simulator does not fly"))
    }

    /// Prepares images for a scene.
    fn prepare(&self, scene: &SceneSetting<'_>) -> Box<dyn SceneRenderer>;
}

/// A camera, its surroundings and a type: all that an image depends on besides where the aircraft is and the instant.
#[derive(Debug, Clone, Copy)]
pub struct SceneSetting<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// The runway whose surroundings it sees.
    pub runway: &'a Runway,
    /// The weather.
    pub weather: &'a Weather,
    /// The time of day, for the light.
    pub clock: &'a Clock,
    /// The type that is drawn.
    pub aircraft: &'static AircraftType,
    /// Effects of optics, air and sensor, if any.
    pub degradation: Option<&'a Degradation>,
}

/// An aircraft that is drawn beside the first one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OtherAircraft {
    /// Its type.
    pub aircraft: &'static AircraftType,
    /// Its pose.
    pub pose: Pose,
    /// Flaps and gear.
    pub controls: Controls,
}

/// Images from a prepared camera, weather and time, with the aircraft anywhere.
pub trait SceneRenderer: Send + Sync {
    /// Draws a frame with the first aircraft and the others into `rgb`, which has exactly its size and is overwritten completely.
    fn draw(
        &self,
        first: (&Pose, &Controls),
        others: &[OtherAircraft],
        instants: Instants,
        rgb: &mut [u8],
    );
}

/// The built-in flight model and the renderer of this crate.
#[derive(Debug, Clone, Copy)]
pub struct BuiltIn;

impl Engine for BuiltIn {
    fn fly(
        &self,
        request: &FlyRequest,
        aircraft: &AircraftType,
        weather: &Weather,
    ) -> Result<Vec<FlightState>, NotFlown> {
        Ok(flight_model::land(request, aircraft, weather)?)
    }

    fn prepare(&self, setting: &SceneSetting<'_>) -> Box<dyn SceneRenderer> {
        let scene = Scene::new(
            setting.camera,
            setting.runway,
            setting.weather,
            setting.clock,
        )
        .with_aircraft(setting.aircraft);
        Box::new(match setting.degradation {
            None => scene,
            Some(degradation) => scene.degraded(degradation),
        })
    }
}

impl SceneRenderer for Scene {
    fn draw(
        &self,
        first: (&Pose, &Controls),
        others: &[OtherAircraft],
        instants: Instants,
        rgb: &mut [u8],
    ) {
        let others: Vec<_> = others
            .iter()
            .map(|of| (of.aircraft, &of.pose, &of.controls))
            .collect();
        self.draw_frame(first, &others, instants, true, rgb);
    }
}
