//! Expands a sweep to its plan.

use std::collections::BTreeMap;

use dataset::conditions::Conditions;
use dataset::corpus::scenario::Flight;
use dataset::geometry::imaging::Imaging;
use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;
use dataset::plan::{Common, ConfigHasher, Jitter, LiveStart, Parameters, Plan, PlannedScenario};

use crate::recording::Recording;
use crate::seed;
use crate::sweep::{Combination, JitterTable, Sweep};
use crate::trajectory::AlongCourse;

/// Mean ground speed on a jet's last ten miles, metres per second: accurate enough to predict the duration of flights that are not
/// recorded.
const EXPECTED_GROUND_SPEED_MPS: f64 = 72.0;

/// Expands a sweep.
pub fn expand(sweep: &Sweep) -> Plan {
    let common = Common {
        aircraft: sweep.aircraft.only().map(|of| of.name.clone()),
        runway: sweep.runway.clone(),
        rig: sweep.rig_name.clone(),
        cameras: sweep.cameras.clone(),
        picture: sweep.picture,
        video: sweep.video.clone(),
    };
    let hasher = ConfigHasher::new(&common);
    let trajectories = recorded_trajectories(sweep);
    let flown: Vec<Vec<Flown<'_>>> = sweep
        .recorded
        .iter()
        .map(|flights| {
            let recordings = flights.recordings.iter();
            recordings
                .map(|recording| Flown {
                    recording,
                    trajectory: &trajectories[recording.blake3.as_str()],
                    along_course: recording.trajectory.along_course(&sweep.runway),
                })
                .collect()
        })
        .collect();
    let scenarios: Vec<PlannedScenario> = sweep
        .combinations
        .iter()
        .zip(sweep.recording_of_each())
        .enumerate()
        .map(|(index, (combination, place))| {
            let flown = place.map(|(rule, index)| &flown[rule][index]);
            decide(sweep, (index, combination), flown, &hasher)
        })
        .collect();
    Plan::new(sweep.corpus.name.clone(), &sweep.text, common, scenarios)
}

/// True if the seeds of all scenarios follow from this master seed.
pub fn is_seeded_by(plan: &Plan, master: u64) -> bool {
    let mut scenarios = plan.scenarios.iter();
    scenarios.all(|scenario| scenario.seed == seed::of_scenario(master, &scenario.id))
}

/// Names of trajectories by the hash of the recording. Copies share the name of the first one: they are one trajectory.
fn recorded_trajectories(sweep: &Sweep) -> BTreeMap<&str, String> {
    let mut names = BTreeMap::new();
    let recordings = sweep
        .recorded
        .iter()
        .flat_map(|flights| &flights.recordings);
    for recording in recordings {
        names
            .entry(recording.blake3.as_str())
            .or_insert_with(|| recording.trajectory_id());
    }
    names
}

/// A recording, relative to the runway of the sweep.
struct Flown<'a> {
    recording: &'a Recording,
    trajectory: &'a str,
    along_course: AlongCourse<'a>,
}

fn decide(
    sweep: &Sweep,
    (index, combination): (usize, &Combination),
    flown: Option<&Flown<'_>>,
    hasher: &ConfigHasher,
) -> PlannedScenario {
    let id = combination.id();
    let seed = seed::of_scenario(sweep.corpus.seed, &id);
    let start_dtd_m = sweep.start.dtd_nm.value(seed, "start.dtd_nm") * METERS_PER_NAUTICAL_MILE;
    let rate = sweep.picture.frame_rate;
    let (flight, live, ticks) = match flown {
        None => {
            let duration_s = start_dtd_m / EXPECTED_GROUND_SPEED_MPS;
            (
                sweep.start.fly.source(),
                Some(live_start(sweep, combination, seed)),
                (duration_s / rate.period_s()) as u32 + 1,
            )
        }
        Some(Flown {
            recording,
            along_course,
            ..
        }) => {
            // The sweep has checked that every recording reaches the runway.
            let ticks = along_course
                .approach(start_dtd_m)
                .map_or(0, |window| window.ticks(rate));
            (
                Flight::Recorded {
                    file: recording.file.clone(),
                    blake3: recording.blake3.clone(),
                },
                None,
                ticks,
            )
        }
    };
    let time_of_day = combination.time.to_string();
    let weather = combination.weather.clone();
    let parameters = Parameters {
        conditions: Conditions {
            time_of_day: time_of_day.clone(),
            clock: combination
                .time
                .clock(sweep.day_of_year, sweep.utc_offset_h),
            weather: sweep.weathers[&weather].draw(seed, sweep.runway.threshold.altitude_msl_m),
            weather_name: weather.clone(),
        },
        start_dtd_m,
        flight,
        live,
        aircraft: match sweep.aircraft.only() {
            Some(_) => None,
            None => Some(sweep.aircraft.drawn(seed).name.clone()),
        },
        traffic: sweep.traffic.drawn(index, seed),
        aim: sweep.aim.as_ref().and_then(|aim| aim.draw(seed)),
        jitter: jitter(sweep, seed),
        imaging: imaging(sweep, seed),
    };
    PlannedScenario {
        time_of_day,
        weather,
        seed,
        trajectory: flown.map_or_else(
            || format!("{}-{id}", parameters.flight.name()),
            |flown| flown.trajectory.to_owned(),
        ),
        flight: parameters.flight.name().to_owned(),
        ticks,
        config_hash: hasher.config_hash(&id, seed, &parameters),
        parameters,
        id,
    }
}

fn jitter(sweep: &Sweep, seed: u64) -> BTreeMap<String, Jitter> {
    let cameras = sweep.cameras.iter();
    let drawn = |table: &JitterTable| {
        cameras
            .map(|camera| (camera.id.clone(), table.draw(seed, &camera.id)))
            .collect()
    };
    sweep.jitter.as_ref().map(drawn).unwrap_or_default()
}

/// Deviations from ideal images, by camera.
fn imaging(sweep: &Sweep, seed: u64) -> BTreeMap<String, Imaging> {
    let table = sweep.imaging.clone().unwrap_or_default();
    let cameras = sweep.cameras.iter();
    cameras
        .map(|camera| (camera.id.clone(), table.draw(seed, camera)))
        .filter(|(_, imaging)| !imaging.is_ideal())
        .collect()
}

fn live_start(sweep: &Sweep, combination: &Combination, seed: u64) -> LiveStart {
    let start = &sweep.start;
    let profile_name = sweep.profile_of(combination, seed);
    LiveStart {
        cross_track_m: start.cross_track_m.value(seed, "start.cross_track_m"),
        above_profile_m: start.above_profile_m.value(seed, "start.above_profile_m"),
        heading_offset_deg: start
            .heading_offset_deg
            .value(seed, "start.heading_offset_deg"),
        speed_mps: start.speed_mps.value(seed, "start.speed_mps"),
        profile: sweep.profiles[profile_name],
        profile_name: profile_name.to_owned(),
    }
}
