//! `[jitter]`: placement errors of the cameras of each scenario relative to the rig. Each camera of each scenario draws its own.

use dataset::numbers::limits;
use dataset::plan::{Jitter, PlannedCamera};
use schemars::JsonSchema;
use serde::Deserialize;

use crate::spread::Spread;
use crate::sweep::check::fault::{Checked, fault};
use crate::sweep::check::limits::in_schema;

/// `[jitter]`: added to each camera's own values. Each is a number or a spread to draw from.
#[derive(Debug, Clone, PartialEq, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct JitterTable {
    /// Right of the landing course, metres.
    #[schemars(transform = in_schema(limits::JITTER_M))]
    pub right_m: Spread,
    /// Up, metres; not into the ground.
    #[schemars(transform = in_schema(limits::JITTER_M))]
    pub height_m: Spread,
    /// Direction of the optical axis, degrees clockwise.
    #[schemars(transform = in_schema(limits::JITTER_DEG))]
    pub heading_deg: Spread,
    /// Elevation of the optical axis, degrees up.
    #[schemars(transform = in_schema(limits::JITTER_DEG))]
    pub pitch_deg: Spread,
    /// Horizontal field of view, degrees; it stays within 0.1 to 150.
    #[schemars(transform = in_schema(limits::JITTER_DEG))]
    pub hfov_deg: Spread,
}

impl JitterTable {
    /// Draws a camera's placement error.
    pub(crate) fn draw(&self, scenario_seed: u64, camera: &str) -> Jitter {
        let draw = |name: &str, spread: &Spread| {
            spread.value(scenario_seed, &format!("jitter.{camera}.{name}"))
        };
        Jitter {
            right_m: draw("right_m", &self.right_m),
            height_m: draw("height_m", &self.height_m),
            heading_deg: draw("heading_deg", &self.heading_deg),
            pitch_deg: draw("pitch_deg", &self.pitch_deg),
            hfov_deg: draw("hfov_deg", &self.hfov_deg),
            // No sweep moves cameras along the course or rolls them.
            along_m: 0.0,
            roll_deg: 0.0,
        }
    }

    pub(crate) fn check(&self, cameras: &[PlannedCamera]) -> Checked<()> {
        let (narrower_deg, wider_deg) = self.hfov_deg.range();
        let (lower_m, _) = self.height_m.range();
        for camera in cameras {
            let (narrowest, widest) = (camera.hfov_deg + narrower_deg, camera.hfov_deg + wider_deg);
            if !limits::HFOV_DEG.hold(narrowest) || !limits::HFOV_DEG.hold(widest) {
                return fault(
                    "jitter.hfov_deg",
                    format!(
                        "{} can give camera {:?} a field of view of {narrowest} to {widest} degrees; expected 0.1 to 150, whatever is drawn",
                        self.hfov_deg, camera.id
                    ),
                );
            }
            if camera.height_m + lower_m < 0.0 {
                return fault(
                    "jitter.height_m",
                    format!(
                        "{} can put camera {:?} {} m under the ground; expected at most its height of {} m down",
                        self.height_m,
                        camera.id,
                        -(camera.height_m + lower_m),
                        camera.height_m
                    ),
                );
            }
        }
        Ok(())
    }
}
