//! The cameras of a scenario, from its plan.

use dataset::camera::CameraPose;
use dataset::imaging::Imaging;
use dataset::rig::place_in;

use crate::plan::{Common, Parameters};
use crate::sweep::Camera;

/// A camera of one scenario.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// Its identifier.
    pub id: String,
    /// Its position and direction.
    pub camera: CameraPose,
    /// Its lens and sensor, and the air in front of it.
    pub imaging: Imaging,
}

/// The cameras of a scenario, in the order of the rig.
pub fn views(common: &Common, parameters: &Parameters) -> Vec<View> {
    let view = |camera: &Camera| {
        let jitter = parameters
            .jitter
            .get(&camera.id)
            .copied()
            .unwrap_or_default();
        View {
            id: camera.id.clone(),
            camera: place_in(&camera.mast(), &common.runway, parameters.aim, &jitter),
            imaging: parameters
                .imaging
                .get(&camera.id)
                .copied()
                .unwrap_or_default(),
        }
    };
    common.cameras.iter().map(view).collect()
}
