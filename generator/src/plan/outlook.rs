//! Plan outlook: the parts of the approach that each camera shows, flights that miss the runway, and heights of profiles and clouds above
//! it. Recordings are flown as they are, others once in each profile and weather, in its strongest wind, by the built-in flight model.

mod sight;

use std::collections::BTreeMap;
use std::sync::Arc;

use airframe::AircraftType;
use dataset::corpus::scenario::Flight;
use dataset::geometry::approach_profile::ApproachProfile;
use dataset::geometry::geodesy::Geodetic;
use dataset::geometry::pose::FlightState;
use dataset::geometry::runway::RunwayCoordinates;
use dataset::numbers::frame_rate::FrameRate;
use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;
use dataset::plan::{Plan, PlannedScenario};
use serde::Serialize;

use sight::InSight;

use super::fly_request;
use crate::sweep::Sweep;
use crate::trajectory::Trajectory;

/// Sampling rate of flights.
const LOOKS: FrameRate = FrameRate {
    numerator: 1,
    denominator: 1,
};
/// A level segment below this height over the field is unusual: the chart of WSSS 02L has one at 450 m.
const MIN_LEVEL_M: f64 = 400.0;

/// Plan outlook.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Outlook {
    /// Views in the order of the rig.
    pub views: Vec<Sight>,
    /// Start height above the runway, by profile, metres.
    pub profiles_above_runway_m: BTreeMap<String, f64>,
    /// Lowest base and highest top of clouds above the runway, by weather, metres.
    pub clouds_above_runway_m: BTreeMap<String, [f64; 2]>,
    /// Profiles with a level segment that is unusually low, and its height above the runway, metres.
    #[serde(skip)]
    pub low_levels_m: BTreeMap<String, f64>,
    /// Distances from the touchdown target and the centreline of flights that miss the runway, by profile and weather, metres; `None` for
    /// one that never lands.
    #[serde(skip)]
    misses_m: BTreeMap<(String, String), Option<[f64; 2]>>,
    #[serde(skip)]
    in_sight: InSight,
}

/// Distances at which a view sees the aircraft's centre of gravity: along the course to go, nautical miles, over one flight per profile and
/// each recording. Clouds and haze are not considered.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Sight {
    /// The view.
    pub view: String,
    /// Nearest and farthest first sight; absent if the aircraft is never seen.
    pub enters_nm: Option<[f64; 2]>,
    /// Nearest and farthest last sight; negative past the touchdown target.
    pub leaves_nm: Option<[f64; 2]>,
}

impl Outlook {
    /// Outlook of a sweep's plan.
    pub fn new(sweep: &Sweep, plan: &Plan) -> Self {
        let runway = &plan.common.runway;
        let ground_m = runway.threshold.altitude_msl_m;
        let views = plan.common.cameras.iter().map(|camera| Sight {
            view: camera.id.clone(),
            enters_nm: None,
            leaves_nm: None,
        });
        let mut outlook = Self {
            views: views.collect(),
            profiles_above_runway_m: BTreeMap::new(),
            clouds_above_runway_m: BTreeMap::new(),
            low_levels_m: BTreeMap::new(),
            misses_m: BTreeMap::new(),
            in_sight: InSight::default(),
        };
        // Repeated flights differ by metres, and in their wind.
        let mut windiest: BTreeMap<(&str, &str), &PlannedScenario> = BTreeMap::new();
        for scenario in &plan.scenarios {
            outlook.add_heights(scenario, ground_m);
            let other = windiest.entry(flight_of(scenario)).or_insert(scenario);
            if wind_mps(scenario) > wind_mps(other) {
                *other = scenario;
            }
        }
        let mut flights: BTreeMap<(&str, &str), Flown> = BTreeMap::new();
        for (flight, scenario) in windiest {
            let flown = Flown::of(sweep, plan, scenario);
            outlook.watch(scenario, plan, &flown.states);
            outlook.land(scenario, plan, &flown);
            flights.insert(flight, flown);
        }
        for scenario in &plan.scenarios {
            let flown = &flights[&flight_of(scenario)];
            outlook.in_sight.add(scenario, &plan.common, &flown.states);
        }
        outlook
    }

    /// Warnings about views that never show the aircraft, or only beyond the visibility.
    pub fn hidden_aircraft(&self) -> Vec<String> {
        self.in_sight.warnings()
    }

    /// Warnings about flights that miss the runway: `dtd verify` rejects them.
    pub fn missed_runways(&self) -> Vec<String> {
        let misses = self.misses_m.iter();
        misses
            .map(|((profile, weather), place_m)| {
                let how = match place_m {
                    Some([off_m, beside_m]) => format!(
                        "touches down {off_m:.0} m from the target, {beside_m:.0} m beside the centreline,"
                    ),
                    None => "does not land".to_owned(),
                };
                format!(
                    "the profile {profile:?} {how} in the strongest wind of the weather {weather:?} with the built-in flight model; `dtd \
                     verify` rejects flights that miss the runway: are its start and the wind as intended?"
                )
            })
            .collect()
    }

    fn add_heights(&mut self, scenario: &PlannedScenario, ground_m: f64) {
        if let Some(live) = &scenario.parameters.live {
            let (name, profile) = (live.profile_name.clone(), &live.profile);
            let start_m = profile.start_altitude_msl_m() - ground_m;
            if let Some(level_m) = lowest_level_m(profile, ground_m, MIN_LEVEL_M) {
                self.low_levels_m.insert(name.clone(), level_m);
            }
            self.profiles_above_runway_m.insert(name, start_m);
        }
        for layer in &scenario.parameters.conditions.weather.clouds {
            let range = self
                .clouds_above_runway_m
                .entry(scenario.weather.clone())
                .or_insert([f64::INFINITY, f64::NEG_INFINITY]);
            widen(range, layer.base_msl_m - ground_m);
            widen(range, layer.top_msl_m - ground_m);
        }
    }

    /// Adds a profile's touchdown point, if it is not on the runway.
    fn land(&mut self, scenario: &PlannedScenario, plan: &Plan, flown: &Flown) {
        let Some(live) = &scenario.parameters.live else {
            return;
        };
        let runway = &plan.common.runway;
        let place = flown.touchdown.map(|touchdown| {
            RunwayCoordinates::of(touchdown, runway.touchdown_target(), runway.course_true_deg)
        });
        if place.is_none_or(|place| !place.may_be_touchdown()) {
            let flight = (live.profile_name.clone(), scenario.weather.clone());
            let place_m = place.map(|place| [place.dtd_m, place.cross_track_m.abs()]);
            self.misses_m.insert(flight, place_m);
        }
    }

    /// Adds a flight to the views' sights.
    fn watch(&mut self, scenario: &PlannedScenario, plan: &Plan, states: &[FlightState]) {
        let runway = &plan.common.runway;
        let target = runway.touchdown_target();
        let cameras = scenario.parameters.cameras(&plan.common);
        for (sight, (_, camera)) in self.views.iter_mut().zip(cameras) {
            let camera = camera.camera();
            let mut seen = states
                .iter()
                .filter(|state| camera.shows(state.pose.position().to_ecef()))
                .map(|state| {
                    let place = RunwayCoordinates::of(
                        state.pose.position(),
                        target,
                        runway.course_true_deg,
                    );
                    place.along_track_m / METERS_PER_NAUTICAL_MILE
                });
            let Some(first_nm) = seen.next() else {
                continue;
            };
            let last_nm = seen.next_back().unwrap_or(first_nm);
            widen(sight.enters_nm.get_or_insert([first_nm; 2]), first_nm);
            widen(sight.leaves_nm.get_or_insert([last_nm; 2]), last_nm);
        }
    }
}

/// Key of distinct flights: profile and weather, or recording.
fn flight_of(scenario: &PlannedScenario) -> (&str, &str) {
    match &scenario.parameters.live {
        Some(live) => (live.profile_name.as_str(), scenario.weather.as_str()),
        None => (scenario.trajectory.as_str(), ""),
    }
}

fn wind_mps(scenario: &PlannedScenario) -> f64 {
    scenario.parameters.conditions.weather.wind_speed_mps
}

#[derive(Default)]
struct Flown {
    /// States until it passes the target, once a second; none if it never comes there.
    states: Vec<FlightState>,
    touchdown: Option<Geodetic>,
}

impl Flown {
    /// Flight from the recording, else by the built-in flight model.
    fn of(sweep: &Sweep, plan: &Plan, scenario: &PlannedScenario) -> Self {
        let parameters = &scenario.parameters;
        let trajectory = match (&parameters.flight, &parameters.live) {
            (_, Some(live)) => {
                let request = fly_request(&plan.common, scenario, live);
                let aircraft = AircraftType::named(parameters.aircraft(&plan.common))
                    .unwrap_or(AircraftType::boeing_737_800());
                let weather = &parameters.conditions.weather;
                let states = flight_model::fly(&request, aircraft, weather);
                Trajectory::new(states).ok().map(Arc::new)
            }
            (Flight::Recorded { blake3, .. }, None) => sweep
                .recording(blake3)
                .map(|recording| recording.trajectory.clone()),
            (_, None) => None,
        };
        let Some(trajectory) = trajectory else {
            return Self::default();
        };
        let window = trajectory.approach(&plan.common.runway, parameters.start_dtd_m);
        Self {
            states: window.map_or_else(|_| Vec::new(), |window| trajectory.resample(window, LOOKS)),
            touchdown: trajectory.touchdown(),
        }
    }
}

/// Height of the lowest level segment above the runway, metres, if it is below `least_m`.
fn lowest_level_m(profile: &ApproachProfile, ground_m: f64, least_m: f64) -> Option<f64> {
    let level_m = match *profile {
        ApproachProfile::GlidePath {
            level_altitude_msl_m,
        } => level_altitude_msl_m,
        ApproachProfile::StepDown {
            lower_altitude_msl_m,
            ..
        } => lower_altitude_msl_m,
        ApproachProfile::ContinuousDescent { .. } => return None,
    };
    Some(level_m - ground_m).filter(|level_m| *level_m < least_m)
}

fn widen(range: &mut [f64; 2], value: f64) {
    *range = [range[0].min(value), range[1].max(value)];
}
