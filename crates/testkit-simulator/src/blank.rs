//! An engine that costs nothing.

use dataset::conditions::{Clock, Weather};
use dataset::geometry::camera::Camera;
use dataset::geometry::imaging::Degradation;
use dataset::geometry::pose::{Controls, FlightState, Pose};
use dataset::geometry::runway::Runway;
use mock_xplane::server::{Engine, NotFlown, SceneRenderer};
use xplane_bridge::fly::FlyRequest;

/// Draws nothing and cannot fly.
#[derive(Debug)]
pub struct Blank;

impl Engine for Blank {
    fn fly(&self, _: &FlyRequest, _: &Weather) -> Result<Vec<FlightState>, NotFlown> {
        Err(NotFlown::Because("a blank simulator does not fly"))
    }

    fn picture(
        &self,
        _: &Camera,
        _: &Runway,
        _: &Weather,
        _: &Clock,
        _: Option<&Degradation>,
    ) -> Box<dyn SceneRenderer> {
        Box::new(Self)
    }
}

impl SceneRenderer for Blank {
    fn draw(&self, _: &Pose, _: &Controls, _: f64, _: &mut [u8]) {}
}
