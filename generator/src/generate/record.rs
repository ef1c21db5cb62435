//! Records one scenario: conditions, flight, images, tables, seal.

mod blocks;
mod encoders;
pub(crate) mod image_source;
mod lockstep;
mod other_aircraft;
mod steps;
mod workplace;

use std::sync::Arc;
use std::time::Duration;

use airframe::AircraftType;
use dataset::corpus::calibration::{Calibration, Conventions};
use dataset::corpus::claim::Claim;
use dataset::corpus::effective_weather::{EffectiveWeather, WeatherDifference};
use dataset::corpus::scenario::{
    Flight, Graphics, PINHOLE_SCHEMA_VERSION, ScenarioRecord, Versions,
};
use dataset::corpus::seal::{commit_folder, seal_folder};
use dataset::corpus::{Corpus, ScenarioFolder};
use dataset::geometry::imaging::{Imaging, Stream};
use dataset::geometry::pose::FlightState;
use dataset::plan::{Common, Picture, Plan, PlannedScenario};
use dataset::tables::aircraft::AircraftRow;
use dataset::tables::frames::{Frames, TickRow, ViewStamp};
use dataset::tables::image_rows::ImageRow;
use tokio::task::spawn_blocking;
use xplane_bridge::fly::FlightStart;
use xplane_bridge::link::{FrameHeader, LINK_VERSION, PictureSize};
use xplane_bridge::pixels::PixelError;
use xplane_bridge::profile::RecordedPace;
use xplane_bridge::{BridgeError, Simulator, pictures_waiting};

use super::error::ScenarioError;
use super::event::Event;
use super::run::attempt::Attempt;
use super::session::Session;
use crate::plan::fly_request;
use crate::sweep::Sweep;
use crate::trajectory::Trajectory;
use blocks::{capture_blocks, do_without_blocks, may_use_blocks};
use encoders::Encoders;
use lockstep::capture;
use other_aircraft::{OthersFlown, aircraft_rows};
use steps::{Steps, Stopwatch};
use workplace::Workplace;

/// Waiting position and speed for replayed flights: in the air, clear of buildings and other aircraft.
const WAITING_ABOVE_RUNWAY_M: f64 = 600.0;
const WAITING_SPEED_MPS: f64 = 80.0;
/// Images that may wait for each encoder, unless they come in blocks.
const WAITING_PICTURES: usize = 2;
/// Inputs and destination of recordings.
pub(super) struct Work<'a> {
    pub(super) sweep: &'a Sweep,
    pub(super) plan: &'a Plan,
    pub(super) corpus: &'a Corpus,
}

/// A scenario that was recorded and committed.
pub(super) struct Recorded {
    pub(super) ticks: u32,
    /// Reported weather at the aircraft.
    pub(super) effective_weather: Option<EffectiveWeather>,
    /// Differences from the planned weather.
    pub(super) marks: Vec<WeatherDifference>,
}

impl Recorded {
    fn of(record: ScenarioRecord) -> Self {
        Self {
            ticks: record.ticks,
            marks: record.weather_marks(),
            effective_weather: record.effective_weather,
        }
    }
}

/// Records a scenario and commits it. A failure leaves no files behind.
pub(super) async fn record(
    work: &Work<'_>,
    scenario: &PlannedScenario,
    claim: &Claim,
    session: &mut Session,
    attempt: &Attempt<'_, '_>,
) -> Result<Recorded, ScenarioError> {
    let committed = work.corpus.scenario(&scenario.id);
    if let Some(left) = Workplace::finished(work.corpus, &scenario.id, &scenario.config_hash, claim)
    {
        let record = left.folder().open()?.record()?;
        commit_folder(left.folder().root(), committed.root())?;
        return Ok(Recorded::of(record));
    }
    let workplace = Workplace::clear(work.corpus, &scenario.id, claim)?;
    let folder = workplace.folder();
    let recorded = async {
        let mut watch = Stopwatch::start();
        let (record, mut steps, simulator) =
            record_into(folder, work, scenario, session, attempt, &mut watch).await?;
        let (partial, config_hash) = (folder.root().to_owned(), scenario.config_hash.clone());
        // Hashing and syncing videos takes seconds, which must not block other simulators.
        let sealed = spawn_blocking(move || {
            seal_folder(&partial, &config_hash)?;
            commit_folder(&partial, committed.root())
        });
        sealed
            .await
            .map_err(ScenarioError::panicked("sealing the scenario"))??;
        steps.recording = watch.lap();
        Ok((record, steps, simulator))
    };
    match recorded.await {
        Ok((record, steps, mut simulator)) => {
            tracing::info!(id = scenario.id, ticks = record.ticks, ?steps, "recorded");
            // The other scenarios do not take as long as one whose last attempt settled its images.
            if record.blocks.is_some() || !simulator.can_record_blocks() {
                session
                    .keep_pace(&mut simulator, pace(work, scenario, &record, &steps))
                    .await;
            }
            if let Err(error) = simulator.release().await {
                tracing::warn!(%error, "the scenario is complete, but the simulator did not confirm its release");
            }
            Ok(Recorded::of(record))
        }
        Err(error) => {
            workplace.abandon();
            Err(error)
        }
    }
}

fn pace(
    work: &Work<'_>,
    scenario: &PlannedScenario,
    record: &ScenarioRecord,
    steps: &Steps,
) -> RecordedPace {
    let Common {
        picture, cameras, ..
    } = &work.plan.common;
    let pictures = f64::from(record.ticks) * cameras.len() as f64;
    let is_live = scenario.parameters.flight == Flight::Live;
    RecordedPace {
        size: PictureSize {
            width_px: picture.width_px,
            height_px: picture.height_px,
        },
        in_blocks: record.blocks.is_some(),
        pictures_per_s: pictures / steps.recording.as_secs_f64(),
        loading: is_live.then_some(steps.loading),
        weather: steps.weather,
    }
}

/// Fills the folder with everything but the seal.
async fn record_into(
    folder: &ScenarioFolder,
    work: &Work<'_>,
    scenario: &PlannedScenario,
    session: &mut Session,
    attempt: &Attempt<'_, '_>,
    watch: &mut Stopwatch,
) -> Result<(ScenarioRecord, Steps, Simulator), ScenarioError> {
    let (common, parameters) = (&work.plan.common, &scenario.parameters);
    let picture = common.picture;
    let mut simulator = attempt.unless_cancelled(session.connect()).await?;
    let planned = work.plan.scenarios.iter();
    simulator.check_aircraft_types(planned.map(|of| of.parameters.aircraft(common)))?;
    let others = work.plan.scenarios.iter();
    let most_others = others.map(|of| of.parameters.traffic.len()).max();
    simulator.check_traffic(most_others.unwrap_or(0))?;
    simulator.set_aircraft(parameters.aircraft(common));
    let (start, live) = start(work, scenario);
    attempt
        .unless_cancelled(simulator.prepare(&parameters.conditions, &start, live))
        .await?;
    let loading = watch.lap();
    attempt
        .unless_cancelled(simulator.set_conditions(&parameters.conditions))
        .await?;
    let weather = watch.lap();
    let views = parameters.cameras(common);
    let imaging = || views.iter().map(|(_, camera)| camera.imaging());
    let streams: Vec<Option<Stream>> = imaging()
        .map(|imaging| imaging.degradation?.stream)
        .collect();
    let imaging: Vec<Imaging> = imaging().map(Imaging::drawn).collect();
    // Before minutes are spent on a flight that cannot be drawn.
    simulator.check_imaging(&imaging)?;
    if live {
        session.live_flights += 1;
    }
    let trajectory = trajectory(work, scenario, &mut simulator, attempt).await?;
    let window = trajectory
        .approach(&common.runway, parameters.start_dtd_m)
        .map_err(|fault| {
            if live {
                ScenarioError::LiveFlight(fault)
            } else {
                ScenarioError::Flight(fault)
            }
        })?;
    // The flight counts for none of them.
    watch.lap();
    let steps = Steps {
        loading,
        weather,
        recording: Duration::ZERO,
    };
    let states = trajectory.resample(window, picture.frame_rate);
    let others = OthersFlown::beside(&trajectory, window, common, parameters, states.len())?;
    attempt.reporter.tell(Event::Flown {
        id: attempt.id,
        ticks: states.len() as u32,
    });

    if let Some(first) = states.first() {
        attempt
            .unless_cancelled(simulator.look_at_pictures(&first.pose))
            .await?;
    }
    if let Some(known) = session.news_of(&simulator) {
        let simulator = session.name();
        attempt
            .reporter
            .say(&format!("simulator {simulator} {known}"));
    }
    attempt
        .unless_cancelled(simulator.freeze_with_imaging(&common.runway, &imaging))
        .await?;
    attempt
        .unless_cancelled(simulator.show_traffic(&others.paths))
        .await?;
    let ids: Vec<String> = views.iter().map(|(id, _)| id.clone()).collect();
    let flight = (&states[..], &views[..], picture);
    let weather = &parameters.conditions.weather;
    let (drawn, blocks, encoders) = loop {
        let uses_blocks = may_use_blocks(&mut simulator, flight, attempt).await?;
        session.note_blocks(&simulator);
        let mut encoders = Encoders::start(
            folder,
            ids.iter().map(String::as_str).zip(streams.iter().copied()),
            picture,
            &common.video,
            if uses_blocks {
                pictures_waiting((picture.width_px, picture.height_px))
            } else {
                WAITING_PICTURES * views.len()
            },
        );
        let captured = if uses_blocks {
            capture_blocks(&mut simulator, flight, weather, &mut encoders, attempt).await
        } else {
            let drawn = capture(&mut simulator, flight, weather, &mut encoders, attempt).await;
            drawn.map(|drawn| (drawn, None))
        };
        match captured {
            Ok((drawn, blocks)) => break (drawn, blocks, encoders),
            Err(error) => {
                // If an encoder failed, that is the reason, and `error` only its consequence.
                if let Some(failed) = encoders.abandon().await {
                    return Err(failed);
                }
                match &error {
                    ScenarioError::Bridge(why @ BridgeError::Pixels(PixelError::NoBlocks(_))) => {
                        do_without_blocks(&mut simulator, why, attempt).await?;
                    }
                    _ => {
                        session.note_blocks(&simulator);
                        return Err(error);
                    }
                }
            }
        }
    };
    session.note_blocks(&simulator);
    let pts = encoders.finish().await?;
    // A scenario is not sealed if a simulator with other settings may have drawn it.
    attempt
        .unless_cancelled(simulator.confirm_conditions())
        .await?;

    let graphics = graphics(&mut simulator, work, scenario, session, attempt).await;
    frames(ids.clone(), &states, &drawn, &pts, picture).write(&folder.frames_path())?;
    if !parameters.traffic.is_empty() {
        let rows = aircraft_rows(&states, &others);
        AircraftRow::write(&rows, &folder.aircraft_path())?;
    }
    let calibration = Calibration {
        conventions: Conventions::default(),
        cameras: views.into_iter().collect(),
    };
    calibration.write(&folder.calibration_path())?;
    let record = scenario_record(
        work.plan,
        scenario,
        &trajectory,
        ids,
        states.len(),
        &simulator,
    );
    let record = ScenarioRecord {
        schema_version: record.required_version(calibration.schema_version()),
        blocks,
        graphics,
        ..record
    };
    record.write(&folder.record_path())?;
    Ok((record, steps, simulator))
}

/// Required aircraft position before the weather is set, and true if the flight continues from there.
fn start(work: &Work<'_>, scenario: &PlannedScenario) -> (FlightStart, bool) {
    if let (Flight::Live, Some(live)) = (&scenario.parameters.flight, &scenario.parameters.live) {
        return (fly_request(&work.plan.common, scenario, live).start, true);
    }
    let runway = &work.plan.common.runway;
    let above_runway_m = runway.threshold.altitude_msl_m + WAITING_ABOVE_RUNWAY_M;
    let start = FlightStart {
        position: runway.threshold.lat_lon().at_altitude_m(above_runway_m),
        heading_true_deg: runway.course_true_deg,
        speed_mps: WAITING_SPEED_MPS,
    };
    (start, false)
}

/// Flight: read with the sweep, computed, or flown now.
async fn trajectory(
    work: &Work<'_>,
    scenario: &PlannedScenario,
    simulator: &mut Simulator,
    attempt: &Attempt<'_, '_>,
) -> Result<Arc<Trajectory>, ScenarioError> {
    let parameters = &scenario.parameters;
    match (&parameters.flight, &parameters.live) {
        (Flight::Recorded { file, blake3 }, _) => match work.sweep.recording(blake3) {
            Some(recording) => Ok(recording.trajectory.clone()),
            None => Err(ScenarioError::NoFlight(format!(
                "{file} with hash {blake3} is not among its recordings"
            ))),
        },
        (Flight::Live, Some(live)) => {
            let states = attempt
                .unless_cancelled(simulator.fly(&fly_request(&work.plan.common, scenario, live)))
                .await?;
            Trajectory::new(states)
                .map(Arc::new)
                .map_err(ScenarioError::LiveFlight)
        }
        (Flight::Computed { .. }, Some(live)) => {
            let request = fly_request(&work.plan.common, scenario, live);
            let weather = parameters.conditions.weather.clone();
            let aircraft = AircraftType::named(parameters.aircraft(&work.plan.common))
                .map_err(|unknown| ScenarioError::NoFlight(unknown.to_string()))?;
            let flown = spawn_blocking(move || flight_model::land(&request, aircraft, &weather));
            let states = flown
                .await
                .map_err(ScenarioError::panicked("computing the flight"))??;
            Trajectory::new(states)
                .map(Arc::new)
                .map_err(ScenarioError::Flight)
        }
        (Flight::Live | Flight::Computed { .. }, None) => {
            let why = "the flight is no recording, and nothing says how to fly it";
            Err(ScenarioError::NoFlight(why.into()))
        }
    }
}

fn frames(
    views: Vec<String>,
    states: &[FlightState],
    drawn: &[Vec<FrameHeader>],
    pts: &[Vec<i64>],
    picture: Picture,
) -> Frames {
    let rate = picture.frame_rate;
    // Counted from the scenario's first image, so that a scenario gives the same table whenever it is recorded.
    let all = drawn.iter().flatten().map(|drawn| drawn.sim_frame);
    let first_sim_frame = all.min().unwrap_or(0);
    let row = |(tick, (state, drawn)): (usize, (&FlightState, &Vec<FrameHeader>))| TickRow {
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
        image_times_ns: Vec::new(),
        labels: None,
        dtd_sd_m: None,
    };
    Frames {
        views,
        rows: states.iter().zip(drawn).enumerate().map(row).collect(),
    }
}

/// What the images were drawn with, if the simulator says. Warns if the scenario before it, of this run or an earlier one, was drawn with
/// something else.
async fn graphics(
    simulator: &mut Simulator,
    work: &Work<'_>,
    scenario: &PlannedScenario,
    session: &mut Session,
    attempt: &Attempt<'_, '_>,
) -> Option<Graphics> {
    simulator.description().plugin.as_ref()?;
    let found = match simulator.installation().await {
        Ok(found) => found,
        Err(error) => {
            tracing::warn!(%error, "what the images were drawn with is not recorded");
            return None;
        }
    };
    let now = Graphics {
        settings: found.settings,
        exposure_ev100: found.exposure_ev100,
    };
    let earlier = session.drawn_with.take().or_else(|| {
        let mut records = (work.corpus.folders().ok()?.into_iter())
            .filter_map(|folder| ScenarioRecord::read(&folder.record_path()).ok());
        records.find_map(|record| Some((record.id, record.graphics?)))
    });
    if let Some((id, before)) = &earlier {
        for change in Graphics::changes([(id.as_str(), before), (scenario.id.as_str(), &now)]) {
            attempt.reporter.warn(&format!(
                "the graphics differ from those of earlier scenarios: {change}"
            ));
        }
    }
    session.drawn_with = Some((scenario.id.clone(), now.clone()));
    Some(now)
}

fn scenario_record(
    plan: &Plan,
    scenario: &PlannedScenario,
    trajectory: &Trajectory,
    views: Vec<String>,
    ticks: usize,
    simulator: &Simulator,
) -> ScenarioRecord {
    let (common, parameters) = (&plan.common, &scenario.parameters);
    ScenarioRecord {
        schema_version: PINHOLE_SCHEMA_VERSION,
        id: scenario.id.clone(),
        trajectory: scenario.trajectory.clone(),
        seed: Some(scenario.seed),
        plan_hash: Some(plan.plan_hash.clone()),
        config_hash: scenario.config_hash.clone(),
        aircraft: parameters.aircraft(common).to_owned(),
        traffic: parameters.traffic.clone(),
        frame_rate: common.picture.frame_rate,
        ticks: ticks as u32,
        runway: common.runway.clone(),
        touchdown: common.runway.touchdown_target(),
        flight_touchdown: trajectory.touchdown(),
        geoid: None,
        conditions: Some(parameters.conditions.clone()),
        effective_weather: simulator.effective_weather().cloned(),
        flight: parameters.flight.clone(),
        rig: common.rig.clone(),
        views,
        blocks: None,
        graphics: None,
        recorded: None,
        versions: Versions {
            dtd: env!("CARGO_PKG_VERSION").into(),
            simulator: Some(format!(
                "{} {}",
                simulator.description().name,
                simulator.description().version
            )),
            capture_link: Some(LINK_VERSION),
            pixels: Some(simulator.pixels().name().into()),
            encoder: Some(common.video.codec.encoder().to_owned()),
        },
    }
}
