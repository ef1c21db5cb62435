//! Views that never show an aircraft: cameras that look elsewhere, and weathers that hide it.

use std::collections::{BTreeMap, BTreeSet};

use dataset::geometry::camera::Camera;
use dataset::geometry::pose::FlightState;
use dataset::plan::{Common, PlannedScenario};

/// Maximum number of scenarios examined per camera and weather: each has its own cameras, and there may be a million.
const MAX_APPROACHES: u32 = 200;

/// Sights by view and weather.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct InSight {
    views: BTreeMap<(String, String), ViewSight>,
}

/// View of the flights in one weather.
#[derive(Debug, Clone, Default, PartialEq)]
struct ViewSight {
    /// An aircraft is in the image.
    in_picture: bool,
    /// An aircraft is within the visibility.
    in_sight: bool,
    visibility_m: f64,
    approaches: u32,
}

impl InSight {
    /// Adds a scenario with its flight's states, or those of a similar flight.
    pub(super) fn add(
        &mut self,
        scenario: &PlannedScenario,
        common: &Common,
        states: &[FlightState],
    ) {
        if states.is_empty() {
            return;
        }
        let visibility_m = scenario.parameters.conditions.weather.visibility_m;
        for (view, entry) in scenario.parameters.cameras(common) {
            let key = (view, scenario.weather.clone());
            let seen = self.views.entry(key).or_default();
            seen.visibility_m = seen.visibility_m.max(visibility_m);
            if !seen.in_sight && seen.approaches < MAX_APPROACHES {
                seen.approaches += 1;
                let nearest_m = nearest_m(&entry.camera(), states);
                seen.in_picture |= nearest_m.is_some();
                seen.in_sight = nearest_m.is_some_and(|nearest_m| nearest_m <= visibility_m);
            }
        }
    }

    pub(super) fn warnings(&self) -> Vec<String> {
        let seen = &self.views;
        let views: BTreeSet<&String> = seen.keys().map(|(view, _)| view).collect();
        let mut lines = Vec::new();
        for view in views {
            let of_view = || seen.iter().filter(|((of, _), _)| of == view);
            if !of_view().any(|(_, seen)| seen.in_picture) {
                lines.push(format!(
                    "view {view} never has the aircraft in its image: are its direction, pitch_deg and hfov_deg as intended?"
                ));
                continue;
            }
            for ((_, weather), seen) in of_view().filter(|(_, seen)| !seen.in_sight) {
                lines.push(format!(
                    "view {view} never has the aircraft in sight in the weather {weather:?}: where its image shows it, it is beyond the \
                     visibility of at most {:.0} m",
                    seen.visibility_m
                ));
            }
        }
        lines
    }
}

/// Distance to the nearest state in a camera's image.
fn nearest_m(camera: &Camera, states: &[FlightState]) -> Option<f64> {
    let places = states.iter().map(|state| state.pose.position().to_ecef());
    places
        .filter(|place| camera.shows(*place))
        .map(|place| camera.center_ecef_m.distance(place))
        .min_by(f64::total_cmp)
}

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::sync::LazyLock;

    use crate::plan::tests::sweep_of;
    use crate::plan::{Outlook, expand};
    use crate::sweep::Sweep;
    use crate::sweep::tests::SMALL;

    /// A level flight meets the glide path at 7.8 NM.
    static FROM_9_NM: LazyLock<String> =
        LazyLock::new(|| SMALL.replace("mean = 2.0", "mean = 9.0"));

    fn outlook(sweep: &Sweep) -> Outlook {
        Outlook::new(sweep, &expand(sweep))
    }

    #[test]
    fn the_sweeps_that_ship_have_the_aircraft_in_sight() {
        for name in ["demo.toml", "scenarios.toml", "detector.toml", "paper.toml"] {
            let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(name);
            let outlook = outlook(&Sweep::read(&path).unwrap());
            assert_eq!(outlook.hidden_aircraft(), Vec::<String>::new(), "{name}");
            assert_eq!(outlook.missed_runways(), Vec::<String>::new(), "{name}");
        }
    }

    #[test]
    fn a_camera_that_looks_away_and_a_visibility_in_the_wrong_unit_are_named() {
        let said = |from: &str, to: &str| {
            let text = FROM_9_NM.replace(from, to);
            assert_ne!(text, *FROM_9_NM);
            outlook(&sweep_of(&text)).hidden_aircraft()
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

    #[test]
    fn a_wind_that_blows_flights_off_the_runway_is_named() {
        let foggy = "[weather.foggy]\n";
        assert!(FROM_9_NM.contains(foggy));
        let storm = format!("{foggy}wind_speed_mps = 50\nwind_from_true_deg = 270\n");
        let said = outlook(&sweep_of(&FROM_9_NM.replace(foggy, &storm))).missed_runways();
        assert!(said.len() == 1 && said[0].contains("foggy"), "{said:?}");
        let storm = format!("{foggy}wind_speed_mps = 60\nwind_from_true_deg = 23\n");
        let said = outlook(&sweep_of(&FROM_9_NM.replace(foggy, &storm))).missed_runways();
        assert!(
            said.len() == 1 && said[0].contains("does not land"),
            "{said:?}"
        );
    }
}
