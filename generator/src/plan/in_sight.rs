//! Views in which no approach of a plan can be seen: cameras that look elsewhere, and weathers that hide what is in front of them.

use std::cell::LazyCell;
use std::collections::{BTreeMap, BTreeSet};

use dataset::geometry::camera::Camera;
use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;
use dataset::plan::{Common, Plan, PlannedScenario};
use glam::DVec3;

/// Points of an approach at which the cameras are asked for it.
const POINTS: u32 = 400;
/// Scenarios of a weather that a camera is asked about, at most: each has an approach of its own, and there may be a million.
const MOST_APPROACHES: u32 = 200;

/// View of the approaches in one weather.
#[derive(Default)]
struct Seen {
    /// A point is in the picture.
    in_picture: bool,
    /// One of these is not beyond the visibility.
    in_sight: bool,
    visibility_m: f64,
    approaches: u32,
}

/// Warnings about views that never show the aircraft, or only beyond the visibility; by the planned approaches, not by recorded flights.
pub fn hidden_aircraft(plan: &Plan) -> Vec<String> {
    let mut seen: BTreeMap<(String, &str), Seen> = BTreeMap::new();
    let has_plan = |scenario: &&PlannedScenario| scenario.parameters.live.is_some();
    for scenario in plan.scenarios.iter().filter(has_plan) {
        let visibility_m = scenario.parameters.conditions.weather.visibility_m;
        let points = LazyCell::new(|| approach(&plan.common, scenario));
        for (view, entry) in scenario.parameters.cameras(&plan.common) {
            let seen = seen.entry((view, scenario.weather.as_str())).or_default();
            seen.visibility_m = seen.visibility_m.max(visibility_m);
            if !seen.in_sight && seen.approaches < MOST_APPROACHES {
                seen.approaches += 1;
                let nearest_m = nearest_m(&entry.camera(), &points);
                seen.in_picture |= nearest_m.is_some();
                seen.in_sight = nearest_m.is_some_and(|nearest_m| nearest_m <= visibility_m);
            }
        }
    }
    let views: BTreeSet<&String> = seen.keys().map(|(view, _)| view).collect();
    let mut lines = Vec::new();
    for view in views {
        let of_view = || seen.iter().filter(|((of, _), _)| of == view);
        if !of_view().any(|(_, seen)| seen.in_picture) {
            lines.push(format!(
                "view {view} never has the aircraft in its picture: are its direction, pitch_deg and hfov_deg as intended?"
            ));
            continue;
        }
        for ((_, weather), seen) in of_view().filter(|(_, seen)| !seen.in_sight) {
            lines.push(format!(
                "view {view} never has the aircraft in sight in the weather {weather:?}: where its picture shows it, it is beyond the \
                 visibility of at most {:.0} m",
                seen.visibility_m
            ));
        }
    }
    lines
}

/// Distance from a camera to the nearest of these points in its picture.
fn nearest_m(camera: &Camera, points: &[DVec3]) -> Option<f64> {
    let shown = points.iter().filter(|point| camera.shows(**point));
    shown
        .map(|point| camera.center_ecef_m.distance(*point))
        .min_by(f64::total_cmp)
}

/// Points of the planned approach, from its start to touchdown: on the glide path, or level below it as a flight begins.
fn approach(common: &Common, scenario: &PlannedScenario) -> Vec<DVec3> {
    let runway = &common.runway;
    let target_msl_m = runway.touchdown_target().altitude_msl_m;
    let slope = runway.glide_path_deg.to_radians().tan();
    let start_dtd_m = scenario
        .parameters
        .start_dtd_m
        .max(METERS_PER_NAUTICAL_MILE);
    let live = scenario.parameters.live.as_ref();
    let level_msl_m = live.map_or(f64::INFINITY, |live| {
        live.profile.start_altitude_msl_m() + live.above_profile_m
    });
    let point = |number: u32| {
        let dtd_m = start_dtd_m * f64::from(number) / f64::from(POINTS);
        let altitude_msl_m = (target_msl_m + dtd_m * slope).min(level_msl_m);
        runway
            .point_on_approach(dtd_m, 0.0)
            .at_altitude_m(altitude_msl_m)
            .to_ecef()
    };
    (0..=POINTS).map(point).collect()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::plan::expand;
    use crate::plan::tests::sweep_of;
    use crate::sweep::Sweep;
    use crate::sweep::tests::SMALL;

    #[test]
    fn the_sweeps_that_ship_have_the_aircraft_in_sight() {
        for name in ["demo.toml", "scenarios.toml", "detector.toml", "paper.toml"] {
            let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(name);
            let plan = expand(&Sweep::read(&path).unwrap());
            assert_eq!(hidden_aircraft(&plan), Vec::<String>::new(), "{name}");
        }
    }

    #[test]
    fn a_camera_that_looks_away_and_a_visibility_in_the_wrong_unit_are_named() {
        let said = |from: &str, to: &str| {
            let text = SMALL.replace(from, to);
            assert_ne!(text, SMALL);
            hidden_aircraft(&expand(&sweep_of(&text)))
        };
        let away = said("pitch_deg = 1.6", "pitch_deg = -60");
        assert_eq!(away.len(), 2, "{away:?}");
        assert!(away[0].starts_with("view left never has"), "{away:?}");
        let fog = said("visibility_m = 9260", "visibility_m = 80");
        assert_eq!(fog.len(), 2, "{fog:?}");
        assert!(
            fog[0].contains("foggy") && fog[0].contains("80 m"),
            "{fog:?}"
        );
    }
}
