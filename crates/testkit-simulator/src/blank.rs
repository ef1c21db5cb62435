//! An engine that costs nothing.

use dataset::geometry::pose::{Controls, Pose};
use mock_xplane::server::{Engine, Instants, OtherAircraft, SceneRenderer, SceneSetting};

/// Draws nothing and cannot fly.
#[derive(Debug)]
pub struct Blank;

impl Engine for Blank {
    fn prepare(&self, _: &SceneSetting<'_>) -> Box<dyn SceneRenderer> {
        Box::new(Self)
    }
}

impl SceneRenderer for Blank {
    fn draw(&self, _: (&Pose, &Controls), _: &[OtherAircraft], _: Instants, _: &mut [u8]) {}
}
