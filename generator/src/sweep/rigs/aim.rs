//! `[aim]`: turns all cameras together, overriding the rig.

use dataset::numbers::limits;
use dataset::plan::Aim;
use schemars::JsonSchema;
use serde::Deserialize;

use crate::spread::Spread;
use crate::sweep::check::fault::{Checked, fault};
use crate::sweep::check::limits::in_schema;

/// `[aim]`: where each scenario turns all its cameras: to a point of the glide path, or in a direction.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(extend("oneOf" = [
    { "required": ["dtd_nm"], "not": { "anyOf": [{ "required": ["heading_true_deg"] }, { "required": ["pitch_deg"] }] } },
    { "required": ["heading_true_deg", "pitch_deg"], "not": { "required": ["dtd_nm"] } },
]))]
pub struct AimTable {
    /// Turns the cameras to the point of the glide path over the extended centreline at this distance to the touchdown target, nautical
    /// miles. Either this or a direction.
    #[schemars(transform = in_schema(limits::AIM_DTD_NM))]
    pub dtd_nm: Option<Spread>,
    /// Direction of the optical axes, degrees true; together with `pitch_deg`.
    #[schemars(transform = in_schema(limits::DIRECTION_TRUE_DEG))]
    pub heading_true_deg: Option<Spread>,
    /// Elevation of the optical axes, degrees, up positive; together with `heading_true_deg`.
    #[schemars(transform = in_schema(limits::MAST_PITCH_DEG))]
    pub pitch_deg: Option<Spread>,
}

impl AimTable {
    /// The aim of the scenario with this seed.
    pub(crate) fn draw(&self, scenario_seed: u64) -> Option<Aim> {
        let draw =
            |name: &str, spread: &Spread| spread.value(scenario_seed, &format!("aim.{name}"));
        match (&self.dtd_nm, &self.heading_true_deg, &self.pitch_deg) {
            (Some(dtd_nm), ..) => Some(Aim::GlidePath {
                dtd_nm: draw("dtd_nm", dtd_nm),
            }),
            (None, Some(heading_true_deg), Some(pitch_deg)) => Some(Aim::Direction {
                heading_true_deg: draw("heading_true_deg", heading_true_deg),
                pitch_deg: draw("pitch_deg", pitch_deg),
            }),
            // The sweep has checked that exactly one is given.
            _ => None,
        }
    }

    pub(crate) fn check(&self) -> Checked<()> {
        let direction = (self.heading_true_deg.is_some(), self.pitch_deg.is_some());
        match (self.dtd_nm.is_some(), direction) {
            (true, (false, false)) | (false, (true, true)) => Ok(()),
            _ => fault(
                "aim",
                "expected either dtd_nm (a point of the glide path), or heading_true_deg and pitch_deg (a direction)",
            ),
        }
    }
}
