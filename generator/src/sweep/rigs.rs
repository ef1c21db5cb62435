//! `[rig.NAME]`: cameras beside a runway. Some rigs are built in; a sweep may define others, or override a built-in one.

pub(crate) mod aim;
pub(crate) mod jitter;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::LazyLock;

use dataset::geometry::distortion::Distortion;
use dataset::numbers::limits;
use dataset::plan::{Picture, PlannedCamera};
use schemars::JsonSchema;
use serde::Deserialize;

use super::check::fault::{Checked, NAME_PATTERN, fault, legal_name, list};
use super::check::limits::in_schema;
use jitter::JitterTable;

/// `[rig.NAME]`
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Rig {
    /// Any number of cameras, at least one.
    #[schemars(length(min = 1))]
    pub(super) cameras: Vec<CameraTable>,
}

/// `[[rig.NAME.cameras]]`: a camera on a mast beside the runway.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Camera", extend("allOf" = [
    { "oneOf": [{ "required": ["beyond_touchdown_m"] }, { "required": ["beyond_threshold_m"] }] },
    { "oneOf": [{ "required": ["inward_deg"] }, { "required": ["heading_true_deg"] }] },
]))]
pub(super) struct CameraTable {
    /// Identifier of the view: names its video and its columns.
    #[schemars(regex(pattern = NAME_PATTERN))]
    id: String,
    /// Distance past the touchdown target along the landing course, metres. Either this or `beyond_threshold_m`.
    #[schemars(transform = in_schema(limits::MAST_DISTANCE_M))]
    beyond_touchdown_m: Option<f64>,
    /// Distance past the threshold along the landing course, metres: unaffected if the touchdown target is moved.
    #[schemars(transform = in_schema(limits::MAST_DISTANCE_M))]
    beyond_threshold_m: Option<f64>,
    /// Offset right of the landing course, metres; negative is left.
    #[schemars(transform = in_schema(limits::MAST_DISTANCE_M))]
    right_m: f64,
    /// Height above the touchdown target, metres.
    #[schemars(transform = in_schema(limits::MAST_HEIGHT_M))]
    height_m: f64,
    /// Turn of the optical axis from the reciprocal of the course towards the runway's axis, degrees. Either this or `heading_true_deg`.
    #[schemars(transform = in_schema(limits::MAST_TURN_DEG))]
    inward_deg: Option<f64>,
    /// Direction of the optical axis, degrees true.
    #[schemars(transform = in_schema(limits::MAST_TURN_DEG))]
    heading_true_deg: Option<f64>,
    /// Elevation of the optical axis, degrees, up positive.
    #[schemars(transform = in_schema(limits::MAST_PITCH_DEG))]
    pitch_deg: f64,
    /// Horizontal field of view, degrees.
    #[schemars(transform = in_schema(limits::HFOV_DEG))]
    hfov_deg: f64,
    /// Lens distortion, with OpenCV's coefficients; a pinhole by default. It must not fold the image over. Only the bundled simulator can
    /// draw it.
    distortion: Option<Distortion>,
}

#[derive(Deserialize)]
struct BuiltIn {
    rig: BTreeMap<String, Rig>,
}

static BUILT_IN: LazyLock<BTreeMap<String, Rig>> = LazyLock::new(|| {
    let parsed: BuiltIn = toml::from_str(include_str!("built_in_rigs.toml"))
        .expect("the built-in rigs are a part of the program, and a test reads them");
    parsed.rig
});

/// The cameras of the rig that a sweep uses; all rigs in `defined`, from the file, must be valid.
pub(super) fn cameras(used: &str, defined: &BTreeMap<String, Rig>) -> Checked<Vec<PlannedCamera>> {
    for (name, rig) in defined {
        rig.check(name)?;
    }
    match defined.get(used).or_else(|| BUILT_IN.get(used)) {
        Some(rig) => Ok(rig.cameras.iter().map(CameraTable::planned).collect()),
        None => {
            let names: BTreeSet<&String> = defined.keys().chain(BUILT_IN.keys()).collect();
            fault(
                "approach.rig",
                format!(
                    "rig {used:?} is not defined; defined are {}; add cameras with [[rig.{used}.cameras]]",
                    list(names)
                ),
            )
        }
    }
}

/// Rejects lenses that fold the image over at any field of view that jitter can give.
pub(super) fn check_lenses(
    defined: &BTreeMap<String, Rig>,
    picture: Picture,
    jitter: Option<&JitterTable>,
) -> Checked<()> {
    let widest = jitter.map_or(0.0, |jitter| jitter.hfov_deg.range().1.max(0.0));
    let (width, height) = (f64::from(picture.width_px), f64::from(picture.height_px));
    for (name, rig) in defined {
        for (index, camera) in rig.cameras.iter().enumerate() {
            let half_hfov = ((camera.hfov_deg + widest) / 2.0).to_radians();
            let corner = half_hfov.tan() * width.hypot(height) / width;
            if let Some(bad_lens) = camera.distortion.and_then(|lens| lens.fault(corner)) {
                return fault(
                    format!("rig.{name}.cameras.{index}.distortion"),
                    format!("camera {:?}: {bad_lens}", camera.id),
                );
            }
        }
    }
    Ok(())
}

impl Rig {
    fn check(&self, name: &str) -> Checked<()> {
        legal_name(format!("rig.{name}"), name)?;
        if self.cameras.is_empty() {
            return fault(
                format!("rig.{name}.cameras"),
                "a rig without cameras; expected at least one",
            );
        }
        let mut seen = BTreeSet::new();
        for (index, camera) in self.cameras.iter().enumerate() {
            let key = |field: &str| format!("rig.{name}.cameras.{index}.{field}");
            camera.check(key)?;
            if !seen.insert(&camera.id) {
                return fault(
                    key("id"),
                    format!(
                        "two cameras are called {:?}; expected different ones",
                        camera.id
                    ),
                );
            }
        }
        Ok(())
    }
}

impl CameraTable {
    fn planned(&self) -> PlannedCamera {
        PlannedCamera {
            id: self.id.clone(),
            beyond_touchdown_m: self.beyond_touchdown_m,
            beyond_threshold_m: self.beyond_threshold_m,
            right_m: self.right_m,
            height_m: self.height_m,
            inward_deg: self.inward_deg,
            heading_true_deg: self.heading_true_deg,
            pitch_deg: self.pitch_deg,
            hfov_deg: self.hfov_deg,
            distortion: self.distortion,
        }
    }

    fn check(&self, key: impl Fn(&str) -> String) -> Checked<()> {
        legal_name(key("id"), &self.id)?;
        for ([one, other], given) in [
            (
                ["beyond_touchdown_m", "beyond_threshold_m"],
                [self.beyond_touchdown_m, self.beyond_threshold_m],
            ),
            (
                ["inward_deg", "heading_true_deg"],
                [self.inward_deg, self.heading_true_deg],
            ),
        ] {
            let (place, has) = match given {
                [Some(_), Some(_)] => (other, "both"),
                [None, None] => ("", "neither"),
                _ => continue,
            };
            let id = &self.id;
            return fault(
                key(place),
                format!("camera {id:?} needs either {one} or {other}, and has {has}"),
            );
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_built_in_rigs_are_sound() {
        assert_eq!(
            BUILT_IN.keys().collect::<Vec<_>>(),
            ["seed", "wide-baseline"]
        );
        for (name, rig) in BUILT_IN.iter() {
            rig.check(name).unwrap();
        }
    }
}
