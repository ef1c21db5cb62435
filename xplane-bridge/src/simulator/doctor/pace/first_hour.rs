//! Measurements that no X-Plane has had: whether the parts of the aircraft move with it in the same frame, whether the autopilot obeys, and
//! how long loading and grabbing take.

use std::time::Instant;

use dataset::geometry::approach_profile::ApproachProfile;
use dataset::geometry::pose::Controls;
use dataset::geometry::runway::Runway;

use super::{BLOCK_RATE, flight, in_blocks, size_in_blocks};
use crate::error::BridgeError;
use crate::fly::{FlightStart, FlyRequest};
use crate::pixels::PixelSource;
use crate::simulator::block::Lagging;
use crate::simulator::doctor::talk::PlaceOnGround;
use crate::simulator::doctor::{Check, DoctorOptions, lockstep};
use crate::{BlockOfTicks, Simulator};

/// Ticks in a block: enough for the lag of the scene to be measured.
const TICKS: u32 = 60;
/// The aircraft with its shadow and lights jumps by twice this from tick to tick, to the side: by more than its span.
const ASIDE_M: f64 = 25.0;
/// Lower then than in the other checks, so that its shadow is in the image, metres; and the camera above it, looking down.
const LOWERED_M: f64 = 285.0;
const CAMERA_ABOVE_M: f64 = 25.0;
/// Little, so that there is room for a probe above the aircraft.
const CAMERA_DOWN_DEG: f64 = 3.0;
/// Fewer pixels are noise, as for a probe.
const MIN_PIXELS: usize = 3;
/// The flown approach: its start, and the longest time until it has landed.
const START_DTD_M: f64 = 9_000.0;
const START_MPS: f64 = 75.0;
const LANDED_WITHIN_S: f64 = 300.0;

/// Makes the measurements, one after the other.
pub(in crate::simulator::doctor) async fn measure(
    simulator: &mut Simulator,
    place: &PlaceOnGround,
    runway: &Runway,
    options: &DoctorOptions,
    note: &mut (dyn FnMut(Check) + Send),
) {
    if let PixelSource::Screen(source) = &simulator.pixels {
        let lag = source.lag();
        let text = format!(
            "an image is on the screen {} grabs or {:.0} ms after it was drawn, at most",
            lag.grabs,
            lag.time.as_secs_f64() * 1e3
        );
        note(Check::ok("grab", text));
    }
    for scene in [Scene::ShadowAndLights, Scene::MovingParts] {
        note(late(simulator, place, options, scene).await);
    }
    if let Err(error) = simulator.go_on().await {
        tracing::warn!(%error, "the simulator does not continue");
    }
    approach(simulator, runway, note).await;
}

/// What changes in every tick of a block.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Scene {
    /// The aircraft's place.
    ShadowAndLights,
    /// Flaps and gear of an aircraft that stays, since a part at the place of the other tick would equal neither image.
    MovingParts,
}

impl Scene {
    const fn name(self) -> &'static str {
        match self {
            Self::ShadowAndLights => "shadow and lights",
            Self::MovingParts => "moving parts",
        }
    }

    /// Metres to the side, and flaps and gear.
    fn of_tick(self, tick: u32) -> (f64, Controls) {
        let is_odd = tick % 2 == 1;
        match self {
            Self::ShadowAndLights => {
                let aside_m = if is_odd { ASIDE_M } else { -ASIDE_M };
                (aside_m, Controls::default())
            }
            Self::MovingParts => {
                let ratio = f64::from(u8::from(is_odd));
                let parts = Controls {
                    flap_ratio: ratio,
                    gear_ratio: ratio,
                };
                (0.0, parts)
            }
        }
    }
}

/// Compares images of a block with settled ones.
async fn late(
    simulator: &mut Simulator,
    place: &PlaceOnGround,
    options: &DoctorOptions,
    scene: Scene,
) -> Check {
    let name = scene.name();
    let intent = options.intent.as_ref();
    let Some(pictures) = intent.and_then(|intent| size_in_blocks(simulator, intent)) else {
        let reason = "images are settled here, so that a part that follows late is in none of them";
        return Check::skipped(name, reason);
    };
    let (mut states, mut camera) = flight(place, pictures, TICKS, |tick| scene.of_tick(tick));
    if scene == Scene::ShadowAndLights {
        for state in &mut states {
            state.pose.altitude_msl_m -= LOWERED_M;
        }
        camera.pose.altitude_msl_m -= LOWERED_M - CAMERA_ABOVE_M;
        camera.pose.pitch_deg -= CAMERA_DOWN_DEG;
    }
    let block = BlockOfTicks {
        first_tick: 0,
        states: &states,
        frame_rate: BLOCK_RATE,
        view: 0,
        camera,
        size_px: (pictures.width_px, pictures.height_px),
    };
    let measured = in_blocks(simulator, &options.screen, pictures, async |simulator| {
        let runway = lockstep::runway(place);
        let settle_frames = simulator.frames_to_settle();
        simulator
            .freeze_raw(&runway, settle_frames, &[], None)
            .await?;
        simulator.lagging(block).await
    });
    let Lagging {
        changing,
        late,
        repeated,
        frames_behind,
    } = match measured.await {
        Ok(found) => found,
        Err(error) => return Check::skipped(name, error.to_string()),
    };
    let Some(behind) = frames_behind else {
        return Check::skipped(
            name,
            "no probe was seen, and every tick was held until it settled",
        );
    };
    if changing == 0 {
        return Check::skipped(name, "no pixel changes from tick to tick");
    }
    let found = format!(
        "{late} of {changing} pixels that change from tick to tick show the tick before; the scene is {behind} frames behind the numbers, \
         {repeated} of {TICKS} ticks were shown again"
    );
    if late < MIN_PIXELS {
        return Check::ok(name, found);
    }
    let hint = "A part of the aircraft follows a frame late: record with a window of exactly the images' size, in which every image settles, \
                and send us this folder";
    Check::warning(name, found, hint)
}

/// Starts a flight before the runway and lets the autopilot land.
async fn approach(
    simulator: &mut Simulator,
    runway: &Runway,
    note: &mut (dyn FnMut(Check) + Send),
) {
    let target = runway.touchdown_target();
    let climb = runway.glide_path_deg.to_radians().tan();
    // Level, below the glide path.
    let altitude_msl_m = target.altitude_msl_m + 0.75 * START_DTD_M * climb;
    let start = FlightStart {
        position: (runway.point_on_approach(START_DTD_M, 0.0)).at_altitude_m(altitude_msl_m),
        heading_true_deg: runway.course_true_deg,
        speed_mps: START_MPS,
    };
    let began = Instant::now();
    match simulator.begin_flight(&start, None).await {
        Ok(in_the_air) => simulator.begun = Some((start, in_the_air)),
        Err(error) => return note(autopilot(Err(error), runway)),
    }
    let text = format!(
        "{:.0} s until a flight before {} had begun",
        began.elapsed().as_secs_f64(),
        runway.airport
    );
    note(Check::ok("load", text));
    let request = FlyRequest {
        start,
        runway: runway.clone(),
        profile: ApproachProfile::GlidePath {
            level_altitude_msl_m: altitude_msl_m,
        },
        seed: 0,
        time_limit_s: LANDED_WITHIN_S,
        already_started: false,
    };
    let landed = simulator.fly(&request).await.map(|states| {
        let down = states.iter().find(|state| state.on_ground)?;
        let here = down.pose.position().lat_lon();
        Some((down.time_s, here.distance_m(target.lat_lon())))
    });
    note(autopilot(landed, runway));
}

/// By time and distance from the touchdown target at which the wheels touched the ground.
fn autopilot(landed: Result<Option<(f64, f64)>, BridgeError>, runway: &Runway) -> Check {
    const NAME: &str = "autopilot";
    let hint = "Live flights will fail: use recorded or computed ones, and send us this folder";
    match landed {
        Ok(Some((time_s, away_m))) => Check::ok(
            NAME,
            format!(
                "landed on {} after {time_s:.0} s, {away_m:.0} m from the touchdown target",
                runway.name
            ),
        ),
        Ok(None) => Check::warning(NAME, "its wheels never touched the ground", hint),
        Err(error) => Check::warning(NAME, error.to_string(), hint),
    }
}
