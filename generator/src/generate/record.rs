//! Records one scenario: conditions, flight, pictures, tables, seal.

use std::sync::Arc;

use dataset::calibration::Calibration;
use dataset::corpus::{Corpus, ScenarioFolder};
use dataset::frames::{Frame, Frames, ViewStamp};
use dataset::pose::FlightState;
use dataset::scenario::{Flight, SCHEMA_VERSION, ScenarioRecord, Versions};
use dataset::seal::{commit_folder, seal_folder};
use dataset::units::Degrees;
use xplane_bridge::fly::{FlightStart, FlyRequest};
use xplane_bridge::{Simulator, SimulatorDescription};

use super::cancel::Cancel;
use super::encoders::Encoders;
use super::error::ScenarioError;
use super::lockstep::{Drawn, View, capture};
use super::session::Session;
use super::workplace::Workplace;
use super::{Event, OnEvent};
use crate::plan::{LiveStart, Parameters, Plan, PlannedScenario};
use crate::rig;
use crate::sweep::Sweep;
use crate::trajectory::Trajectory;

/// A live flight may take so many times as long as expected, and this many seconds more, before the simulator gives up.
const FLIGHT_TIME_MARGIN: (f64, f64) = (2.0, 120.0);

/// Makes a scenario and commits it; returns its number of ticks. On failure nothing of it is left.
pub(super) async fn record(
    sweep: &Sweep,
    plan: &Plan,
    scenario: &PlannedScenario,
    corpus: &Corpus,
    session: &mut Session,
    cancel: &Cancel,
    on_event: &mut OnEvent<'_>,
) -> Result<u32, ScenarioError> {
    let workplace = Workplace::take(corpus, &scenario.id)?;
    match record_into(
        workplace.folder(),
        sweep,
        plan,
        scenario,
        session,
        cancel,
        on_event,
    )
    .await
    {
        Ok((ticks, simulator)) => {
            commit_folder(
                workplace.folder().root(),
                corpus.scenario(&scenario.id).root(),
            )?;
            if let Err(error) = simulator.release().await {
                tracing::warn!(%error, "the scenario is whole, but the simulator did not take leave");
            }
            Ok(ticks)
        }
        Err(error) => {
            workplace.abandon();
            Err(error)
        }
    }
}

async fn record_into(
    folder: &ScenarioFolder,
    sweep: &Sweep,
    plan: &Plan,
    scenario: &PlannedScenario,
    session: &mut Session,
    cancel: &Cancel,
    on_event: &mut OnEvent<'_>,
) -> Result<(u32, Simulator), ScenarioError> {
    let parameters = &scenario.parameters;
    let picture = parameters.picture;
    let mut simulator = cancel.or(session.connect()).await?;
    cancel
        .or(simulator.set_conditions(&parameters.conditions))
        .await?;
    let trajectory = trajectory(sweep, scenario, &mut simulator, cancel).await?;
    let window = trajectory
        .approach(&parameters.runway, parameters.start_dtd_m)
        .map_err(|message| ScenarioError::Flight { message })?;
    let states = trajectory.resample(window, picture.frame_rate);
    on_event(Event::Flown {
        ticks: states.len() as u32,
    });

    cancel.or(simulator.freeze(&parameters.runway)).await?;
    let views = views(parameters);
    let ids = views.iter().map(|view| view.id.as_str());
    let mut encoders = Encoders::start(folder, ids, picture, &parameters.video);
    let drawn = match capture(
        &mut simulator,
        (&states, &views, picture),
        &mut encoders,
        cancel,
        on_event,
    )
    .await
    {
        Ok(drawn) => drawn,
        Err(error) => {
            encoders.abandon().await;
            return Err(error);
        }
    };
    let pts = encoders.finish().await?;

    frames(&views, &states, &drawn, &pts, parameters).write(&folder.frames_path())?;
    let placed = views.iter().map(|view| (view.id.as_str(), view.camera));
    Calibration::from_poses(placed, picture.width_px, picture.height_px)
        .write(&folder.calibration_path())?;
    scenario_record(
        plan,
        scenario,
        &trajectory,
        &views,
        states.len(),
        simulator.description(),
    )
    .write(&folder.record_path())?;
    seal_folder(folder.root(), &scenario.config_hash)?;
    Ok((states.len() as u32, simulator))
}

fn views(parameters: &Parameters) -> Vec<View> {
    let place = |camera: &crate::sweep::Camera| View {
        id: camera.id.clone(),
        camera: rig::place(camera, &parameters.runway),
    };
    parameters.cameras.iter().map(place).collect()
}

/// The flight of a scenario: read with the sweep, or flown now.
async fn trajectory(
    sweep: &Sweep,
    scenario: &PlannedScenario,
    simulator: &mut Simulator,
    cancel: &Cancel,
) -> Result<Arc<Trajectory>, ScenarioError> {
    let parameters = &scenario.parameters;
    match (&parameters.flight, &parameters.live) {
        (Flight::Recorded { file, blake3 }, _) => {
            let recordings = sweep
                .recorded
                .iter()
                .flat_map(|flights| &flights.recordings);
            let found = recordings
                .into_iter()
                .find(|recording| recording.blake3 == *blake3);
            found
                .map(|recording| recording.trajectory.clone())
                .ok_or_else(|| ScenarioError::Flight {
                    message: format!(
                        "{file} with hash {blake3} is not among the recordings of the sweep"
                    ),
                })
        }
        (Flight::Live, Some(live)) => {
            let states = cancel
                .or(simulator.fly(&fly_request(scenario, live)))
                .await?;
            Trajectory::new(states)
                .map(Arc::new)
                .map_err(|message| ScenarioError::Flight { message })
        }
        (Flight::Live, None) => Err(ScenarioError::Flight {
            message: "is live, but the plan does not say how".into(),
        }),
    }
}

fn fly_request(scenario: &PlannedScenario, live: &LiveStart) -> FlyRequest {
    let Parameters {
        runway,
        start_dtd_m,
        picture,
        ..
    } = &scenario.parameters;
    let altitude_msl_m = live.profile.start_altitude_msl_m() + live.above_profile_m;
    let (factor, more_s) = FLIGHT_TIME_MARGIN;
    FlyRequest {
        start: FlightStart {
            position: runway
                .point_on_approach(*start_dtd_m, live.cross_track_m)
                .at_altitude_m(altitude_msl_m),
            heading_true_deg: Degrees(runway.course_true_deg + live.heading_offset_deg)
                .wrapped_360()
                .0,
            speed_mps: live.speed_mps,
        },
        runway: runway.clone(),
        profile: live.profile,
        seed: scenario.seed,
        time_limit_s: f64::from(scenario.ticks) * picture.frame_rate.period_s() * factor + more_s,
    }
}

fn frames(
    views: &[View],
    states: &[FlightState],
    drawn: &[Vec<Drawn>],
    pts: &[Vec<i64>],
    parameters: &Parameters,
) -> Frames {
    let rate = parameters.picture.frame_rate;
    // Counted from the scenario's first picture, so that a scenario gives the same table whenever it is made.
    let first_sim_frame = drawn
        .first()
        .and_then(|tick| tick.first())
        .map_or(0, |first| first.sim_frame);
    let row = |(tick, (state, drawn)): (usize, (&FlightState, &Vec<Drawn>))| Frame {
        tick: tick as u32,
        time_ns: rate.time_of_tick(tick as u32).0,
        pose: state.pose,
        velocity_ned_mps: [
            state.velocity_north_mps,
            state.velocity_east_mps,
            state.velocity_down_mps,
        ],
        true_airspeed_mps: state.true_airspeed_mps,
        controls: state.controls,
        on_ground: state.on_ground,
        views: drawn
            .iter()
            .zip(pts)
            .map(|(drawn, pts)| ViewStamp {
                sim_frame: drawn.sim_frame - first_sim_frame,
                pts: pts[tick],
                echoed_pose: drawn.pose,
                echoed_camera: drawn.camera,
            })
            .collect(),
        labels: None,
    };
    Frames {
        views: views.iter().map(|view| view.id.clone()).collect(),
        rows: states.iter().zip(drawn).enumerate().map(row).collect(),
    }
}

fn scenario_record(
    plan: &Plan,
    scenario: &PlannedScenario,
    trajectory: &Trajectory,
    views: &[View],
    ticks: usize,
    simulator: &SimulatorDescription,
) -> ScenarioRecord {
    let parameters = &scenario.parameters;
    ScenarioRecord {
        schema_version: SCHEMA_VERSION,
        id: scenario.id.clone(),
        trajectory: scenario.trajectory.clone(),
        seed: scenario.seed,
        plan_hash: plan.plan_hash.clone(),
        config_hash: scenario.config_hash.clone(),
        aircraft: parameters.aircraft.clone(),
        frame_rate: parameters.picture.frame_rate,
        ticks: ticks as u32,
        runway: parameters.runway.clone(),
        touchdown: parameters.runway.touchdown_target(),
        flight_touchdown: trajectory.touchdown(),
        geoid: None,
        conditions: parameters.conditions.clone(),
        flight: parameters.flight.clone(),
        rig: parameters.rig.clone(),
        views: views.iter().map(|view| view.id.clone()).collect(),
        versions: Versions {
            dtd: env!("CARGO_PKG_VERSION").into(),
            simulator: format!("{} {}", simulator.name, simulator.version),
            capture_link: simulator.capture_link,
        },
    }
}
