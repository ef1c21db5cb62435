//! The server's interface to a simulator: flying an approach and drawing images. The built-in engine is this crate's own; tests use a
//! cheaper one.

use dataset::conditions::{Clock, Weather};
use dataset::geometry::camera::Camera;
use dataset::geometry::imaging::Degradation;
use dataset::geometry::pose::{Controls, FlightState, Pose};
use dataset::geometry::runway::Runway;
use flight_model::NotLanded;
use xplane_bridge::fly::FlyRequest;

use crate::render::{Instants, Scene};

/// Reason why an engine does not fly an approach.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NotFlown {
    /// The aircraft was still in the air at the end.
    #[error(transparent)]
    NotLanded(#[from] NotLanded),
    /// Another reason of an engine.
    #[error("{0}")]
    Because(&'static str),
}

/// A flight model and a renderer.
pub trait Engine: Send + Sync + 'static {
    /// Flies an approach in this weather; the states at the model's own rate.
    fn fly(&self, request: &FlyRequest, weather: &Weather) -> Result<Vec<FlightState>, NotFlown>;

    /// Prepares the images of one camera in one weather at one time, degraded or not.
    fn picture(
        &self,
        camera: &Camera,
        runway: &Runway,
        weather: &Weather,
        clock: &Clock,
        degradation: Option<&Degradation>,
    ) -> Box<dyn SceneRenderer>;
}

/// Images of one camera in one weather at one time, with the aircraft anywhere.
pub trait SceneRenderer: Send + Sync {
    /// Draws a frame into `rgb`, which has exactly its size and is overwritten completely.
    fn draw(&self, pose: &Pose, controls: &Controls, time_s: f64, rgb: &mut [u8]);

    /// The same with clouds and rain at another instant than flashing lamps. Engines whose weather does not move need not implement
    /// it.
    fn draw_in_moving_weather(
        &self,
        pose: &Pose,
        controls: &Controls,
        lamps_s: f64,
        _weather_s: f64,
        rgb: &mut [u8],
    ) {
        self.draw(pose, controls, lamps_s, rgb);
    }
}

/// The built-in flight model and the renderer of this crate.
#[derive(Debug, Clone, Copy)]
pub struct BuiltIn;

impl Engine for BuiltIn {
    fn fly(&self, request: &FlyRequest, weather: &Weather) -> Result<Vec<FlightState>, NotFlown> {
        Ok(flight_model::land(request, weather)?)
    }

    fn picture(
        &self,
        camera: &Camera,
        runway: &Runway,
        weather: &Weather,
        clock: &Clock,
        degradation: Option<&Degradation>,
    ) -> Box<dyn SceneRenderer> {
        let scene = Scene::new(camera, runway, weather, clock);
        Box::new(match degradation {
            None => scene,
            Some(degradation) => scene.degraded(degradation),
        })
    }
}

impl SceneRenderer for Scene {
    fn draw(&self, pose: &Pose, controls: &Controls, time_s: f64, rgb: &mut [u8]) {
        self.render(pose, controls, time_s, rgb);
    }

    fn draw_in_moving_weather(
        &self,
        pose: &Pose,
        controls: &Controls,
        lamps_s: f64,
        weather_s: f64,
        rgb: &mut [u8],
    ) {
        self.render_at(pose, controls, Instants { lamps_s, weather_s }, rgb);
    }
}
