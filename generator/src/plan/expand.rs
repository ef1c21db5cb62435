//! From a sweep to its plan.

use dataset::conditions::Conditions;
use dataset::scenario::Flight;
use dataset::units::METERS_PER_NAUTICAL_MILE;
use rand::Rng;

use super::{LiveStart, Parameters, Plan, PlannedScenario};
use crate::recording::Recording;
use crate::seed;
use crate::sweep::{RecordedFlights, Sweep};
use crate::time_of_day::TimeOfDay;

/// Mean speed over ground of a jet on its last ten miles, metres per second: enough to say how long a live flight will take.
const EXPECTED_GROUND_SPEED_MPS: f64 = 72.0;

/// Expands a sweep. Repeats vary slowest: a run that is stopped early has seen all conditions, and more repeats only add scenarios.
pub fn expand(sweep: &Sweep) -> Plan {
    let mut turns = vec![0; sweep.recorded.len()];
    let mut scenarios = Vec::with_capacity(sweep.len());
    for repeat in 1..=sweep.grid.repeats {
        for (time, text) in sweep.times.iter().zip(&sweep.grid.times) {
            for weather in &sweep.grid.weathers {
                let number = scenarios.len() + 1;
                let id = format!("{number:04}-{}-{weather}-r{repeat}", time.digits());
                let recording = recording_for(sweep, &mut turns, text, weather, repeat);
                scenarios.push(decide(sweep, id, *time, text, weather, recording));
            }
        }
    }
    Plan {
        plan_hash: plan_hash(&scenarios),
        corpus: sweep.corpus.name.clone(),
        scenarios,
    }
}

/// The recording that a scenario flies, if a rule fits it. The recordings of a rule are flown in turn.
fn recording_for<'a>(
    sweep: &'a Sweep,
    turns: &mut [usize],
    time: &str,
    weather: &str,
    repeat: u32,
) -> Option<&'a Recording> {
    let fits = |flights: &RecordedFlights| {
        let rule = &flights.rule;
        (rule.times.is_empty() || rule.times.iter().any(|t| t == time))
            && (rule.weathers.is_empty() || rule.weathers.iter().any(|w| w == weather))
            && (rule.repeats.is_empty() || rule.repeats.contains(&repeat))
    };
    let (index, flights) = sweep
        .recorded
        .iter()
        .enumerate()
        .find(|(_, flights)| fits(flights))?;
    let turn = turns[index];
    turns[index] += 1;
    flights.recordings.get(turn % flights.recordings.len())
}

fn decide(
    sweep: &Sweep,
    id: String,
    time: TimeOfDay,
    time_of_day: &str,
    weather_name: &str,
    recording: Option<&Recording>,
) -> PlannedScenario {
    let seed = seed::of_scenario(sweep.corpus.seed, &id);
    let mut rng = seed::generator(seed);
    // The order of the draws is part of the plan: new draws go last.
    let start_dtd_m = sweep.start.dtd_nm.draw(&mut rng) * METERS_PER_NAUTICAL_MILE;
    let live = draw_start(sweep, &mut rng);
    let rate = sweep.picture.frame_rate;
    let (flight, live, ticks) = match recording {
        None => {
            let duration_s = start_dtd_m / EXPECTED_GROUND_SPEED_MPS;
            (
                Flight::Live,
                Some(live),
                (duration_s / rate.period_s()) as u32 + 1,
            )
        }
        Some(recording) => {
            // The sweep has checked that every recording reaches the runway.
            let ticks = recording
                .trajectory
                .approach(&sweep.runway, start_dtd_m)
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
    let parameters = Parameters {
        aircraft: sweep.aircraft.clone(),
        runway: sweep.runway.clone(),
        rig: sweep.rig_name.clone(),
        cameras: sweep.cameras.clone(),
        picture: sweep.picture,
        video: sweep.video.clone(),
        conditions: Conditions {
            time_of_day: time_of_day.into(),
            clock: time.clock(sweep.grid.day_of_year, sweep.grid.utc_offset_h),
            weather_name: weather_name.into(),
            weather: sweep.weathers[weather_name].clone(),
        },
        start_dtd_m,
        flight,
        live,
    };
    PlannedScenario {
        time_of_day: time_of_day.into(),
        weather: weather_name.into(),
        seed,
        flight: recording.map_or("live".into(), |recording| recording.file.clone()),
        trajectory: recording.map_or_else(|| format!("live-{id}"), Recording::trajectory_id),
        ticks,
        config_hash: config_hash(&id, seed, &parameters),
        parameters,
        id,
    }
}

fn draw_start(sweep: &Sweep, rng: &mut impl Rng) -> LiveStart {
    let start = &sweep.start;
    let [
        cross_track_m,
        above_profile_m,
        heading_offset_deg,
        speed_mps,
    ] = [
        &start.cross_track_m,
        &start.above_profile_m,
        &start.heading_offset_deg,
        &start.speed_mps,
    ]
    .map(|spread| spread.draw(rng));
    let profile_name =
        start.profiles[(rng.next_u64() % start.profiles.len() as u64) as usize].clone();
    LiveStart {
        cross_track_m,
        above_profile_m,
        heading_offset_deg,
        speed_mps,
        profile: sweep.profiles[&profile_name],
        profile_name,
    }
}

/// Only what was read or drawn is hashed, nothing that trigonometry made of it: its last digits differ from machine to machine.
fn config_hash(id: &str, seed: u64, parameters: &Parameters) -> String {
    let json = serde_json::json!({ "id": id, "seed": seed, "parameters": parameters });
    blake3::hash(json.to_string().as_bytes()).to_string()
}

fn plan_hash(scenarios: &[PlannedScenario]) -> String {
    let mut hasher = blake3::Hasher::new();
    for scenario in scenarios {
        hasher.update(format!("{} {}\n", scenario.id, scenario.config_hash).as_bytes());
    }
    hasher.finalize().to_string()
}
