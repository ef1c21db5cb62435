//! `[start]`: who flies, and where and how flights that are not recordings begin.

pub(crate) mod profiles;
pub(crate) mod recorded;

use std::collections::BTreeSet;

use dataset::corpus::scenario::Flight;
use dataset::numbers::limits;
use schemars::JsonSchema;
use serde::Deserialize;

use super::check::fault::{Checked, NAME_PATTERN, defined, fault};
use super::check::limits::in_schema;
use crate::spread::Spread;
use profiles::LEVEL_THEN_GLIDE_PATH;

/// Pilot of flights that are not recordings.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Fly {
    /// The simulator, in real time.
    #[default]
    Live,
    /// Our own flight model, ahead of the recording: the simulator only shows the flight.
    Computed,
}

impl Fly {
    /// The source of such a flight.
    pub(crate) fn source(self) -> Flight {
        match self {
            Self::Live => Flight::Live,
            Self::Computed => Flight::Computed {
                model: flight_model::VERSION,
            },
        }
    }
}

/// `[start]`: who flies, and where and how flights that are not recordings begin. Each value is a number or a spread to draw from.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Start {
    /// Way of flying; `live` by default.
    pub fly: Fly,
    /// Distance to the touchdown target along the course, nautical miles; 10 by default. Recorded flights are trimmed to it.
    #[schemars(transform = in_schema(limits::START_DTD_NM))]
    pub dtd_nm: Spread,
    /// Offset right of the extended centreline, metres; 0 by default.
    #[schemars(transform = in_schema(limits::START_CROSS_TRACK_M))]
    pub cross_track_m: Spread,
    /// Height above the profile's beginning, metres; 0 by default.
    #[schemars(transform = in_schema(limits::START_ABOVE_PROFILE_M))]
    pub above_profile_m: Spread,
    /// Heading right of the course, degrees; 0 by default.
    #[schemars(transform = in_schema(limits::START_HEADING_OFFSET_DEG))]
    pub heading_offset_deg: Spread,
    /// True airspeed, metres per second; 82 by default.
    #[schemars(transform = in_schema(limits::START_SPEED_MPS))]
    pub speed_mps: Spread,
    /// Names of the profiles to draw from, all equally likely; not together with `grid.profiles`. The default is
    /// `level-then-glide-path`.
    #[schemars(length(min = 1), extend("uniqueItems" = true), inner(regex(pattern = NAME_PATTERN)))]
    pub profiles: Option<Vec<String>>,
}

impl Default for Start {
    fn default() -> Self {
        Self {
            fly: Fly::Live,
            dtd_nm: Spread::Fixed(10.0),
            cross_track_m: Spread::Fixed(0.0),
            above_profile_m: Spread::Fixed(0.0),
            heading_offset_deg: Spread::Fixed(0.0),
            speed_mps: Spread::Fixed(82.0),
            profiles: None,
        }
    }
}

impl Start {
    /// The profiles to draw from, if the grid does not list them.
    pub(super) fn profiles(&self) -> Vec<String> {
        self.profiles
            .clone()
            .unwrap_or_else(|| vec![LEVEL_THEN_GLIDE_PATH.into()])
    }

    pub(super) fn check(
        &self,
        profiles: &BTreeSet<&String>,
        grid_lists_profiles: bool,
    ) -> Checked<()> {
        let Some(listed) = &self.profiles else {
            return Ok(());
        };
        if grid_lists_profiles {
            return fault(
                "start.profiles",
                "the grid lists profiles too; expected either grid.profiles (each is flown) or start.profiles (one is drawn)",
            );
        }
        if listed.is_empty() {
            return fault("start.profiles", "no profile to fly; expected at least one");
        }
        for (index, name) in listed.iter().enumerate() {
            let key = format!("start.profiles.{index}");
            defined(key.clone(), "profile", name, profiles)?;
            if listed[..index].contains(name) {
                return fault(key, format!("{name} is listed twice"));
            }
        }
        Ok(())
    }
}
