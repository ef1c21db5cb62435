//! Rate of images, taken as a recording takes them, from two views.
//!
//! In blocks, if the window has margins around the images of the sweep and the trial of blocks passes; else settled, from the views in
//! turn, with several requests under way.

pub(super) mod first_hour;

use std::sync::Arc;
use std::time::Instant;

use dataset::geometry::camera::CameraPose;
use dataset::geometry::pose::{Controls, FlightState};
use dataset::numbers::frame_rate::FrameRate;

use super::eyes::{Eyes, Shot};
use super::lockstep;
use super::talk::PlaceOnGround;
use super::window::picture_size;
use super::{Check, Intent};
use crate::error::BridgeError;
use crate::link::{CaptureRequest, Deliver, PictureSize, PixelKind};
use crate::pixels::{PixelChoice, Screen};
use crate::profile::{Finding, Pace, PacedBy};
use crate::{BlockOfTicks, BlockTrial, Simulator};

/// First images, not counted: they load data for the others.
const NOT_COUNTED: usize = 6;
/// Images that are counted.
const COUNTED: usize = 24;
/// Ticks per view in the measured block: twelve seconds of a recording. Of three seconds, the start of a block takes a seventh.
const BLOCK_TICKS: u32 = 360;
const BLOCK_RATE: FrameRate = FrameRate {
    numerator: 30,
    denominator: 1,
};
/// Over which distance the aircraft moves meanwhile, to the east and back.
const BLOCK_WAY_M: f64 = 30.0;
/// Ticks from turn to turn.
const TURN_TICKS: u32 = 90;

/// Measures the pace of the images that are to be recorded, without encoding; and why they are settled although the window has margins.
pub(super) async fn measure(
    simulator: &mut Simulator,
    place: &PlaceOnGround,
    screen: &Arc<dyn Screen>,
    intent: Option<&Intent>,
) -> (Finding<Pace>, Option<String>) {
    let mut why_settled = None;
    if let Some(pictures) = intent.and_then(|intent| size_in_blocks(simulator, intent)) {
        let measure =
            async |simulator: &mut Simulator| measure_blocks(simulator, place, pictures).await;
        match in_blocks(simulator, screen, pictures, measure).await {
            Ok(pace) => return (Finding::Found(pace), None),
            Err(error) => why_settled = Some(error.to_string()),
        }
    }
    let settled = settled(Eyes::at(simulator, *place)).await;
    (settled.into(), why_settled)
}

/// The size of the images, if the window has margins around them and time need not run.
pub(super) fn size_in_blocks(simulator: &Simulator, intent: &Intent) -> Option<PictureSize> {
    let description = simulator.description();
    let has_margins = simulator.may_have_margins(simulator.pixels())
        && picture_size(description)
            .is_some_and(|window| intent.pictures.margins_in(window).is_some());
    (has_margins && !simulator.time_has_to_run()).then_some(intent.pictures)
}

/// Measures on images inside the margins, in blocks.
async fn in_blocks<T>(
    simulator: &mut Simulator,
    screen: &Arc<dyn Screen>,
    pictures: PictureSize,
    measure: impl AsyncFnOnce(&mut Simulator) -> Result<T, BridgeError>,
) -> Result<T, BridgeError> {
    let window = picture_size(simulator.description()).unwrap_or(pictures);
    register(simulator, screen, pictures).await?;
    let measured = measure(simulator).await;
    simulator.go_on().await?;
    // The other checks look at the whole window.
    register(simulator, screen, window).await?;
    measured
}

async fn register(
    simulator: &mut Simulator,
    screen: &Arc<dyn Screen>,
    size: PictureSize,
) -> Result<(), BridgeError> {
    let choice = PixelChoice::Only(PixelKind::Screen);
    let pixels = simulator.use_pixels(choice, (size.width_px, size.height_px), screen);
    pixels.await.map(|_| ())
}

/// The pace in blocks; an error if they are not possible, or not equal to settled images.
async fn measure_blocks(
    simulator: &mut Simulator,
    place: &PlaceOnGround,
    pictures: PictureSize,
) -> Result<Pace, BridgeError> {
    let settle_frames = simulator.frames_to_settle();
    let runway = lockstep::runway(place);
    simulator
        .freeze_raw(&runway, settle_frames, &[], None)
        .await?;
    let way = |tick: u32| {
        let since_turn = f64::from(tick % (2 * TURN_TICKS)) / f64::from(TURN_TICKS);
        let there = 1.0 - (since_turn - 1.0).abs();
        (BLOCK_WAY_M * (there - 0.5), Controls::default())
    };
    let (states, camera) = flight(place, pictures, BLOCK_TICKS, way);
    let block = |view| BlockOfTicks {
        first_tick: 0,
        states: &states,
        frame_rate: BLOCK_RATE,
        view,
        camera,
        size_px: (pictures.width_px, pictures.height_px),
    };
    if !simulator.can_record_blocks() || simulator.try_blocks(block(0)).await? != BlockTrial::Equal
    {
        let reason = "images of a resting camera do not show their own ticks";
        return Err(BridgeError::Failed(reason.into()));
    }
    let began = Instant::now();
    let mut taken = 0;
    for view in 0..2 {
        let mut recording = simulator.begin_block(block(view))?;
        while recording.next_picture().await?.is_some() {
            taken += 1;
        }
    }
    Ok(Pace {
        in_blocks: true,
        ..measured(pictures, settle_frames, taken, began)
    })
}

/// The pace of settled images that were taken since then.
fn measured(size: PictureSize, settle_frames: u32, taken: u32, since: Instant) -> Pace {
    Pace {
        measured_by: PacedBy::Doctor,
        size,
        in_blocks: false,
        settle_frames,
        pictures_per_s: f64::from(taken) / since.elapsed().as_secs_f64(),
        loading_s: None,
        weather_s: None,
    }
}

/// The aircraft that moves to the side before the camera of the other checks, with its flaps and gear.
fn flight(
    place: &PlaceOnGround,
    size: PictureSize,
    ticks: u32,
    of_tick: impl Fn(u32) -> (f64, Controls),
) -> (Vec<FlightState>, CameraPose) {
    let request = |tick, moved_m| lockstep::request(place, tick, moved_m, size, Deliver::Coded);
    let state = |tick: u32| {
        let (moved_m, controls) = of_tick(tick);
        let CaptureRequest { pose, .. } = request(tick, moved_m);
        FlightState {
            time_s: BLOCK_RATE.time_of_tick(tick).seconds(),
            pose,
            velocity_north_mps: 0.0,
            velocity_east_mps: BLOCK_WAY_M * 30.0 / f64::from(TURN_TICKS),
            velocity_down_mps: 0.0,
            true_airspeed_mps: 0.0,
            controls,
            on_ground: false,
        }
    };
    ((0..ticks).map(state).collect(), request(0, 0.0).camera)
}

async fn settled(mut eyes: Eyes<'_>) -> Result<Pace, BridgeError> {
    if let Some(reason) = eyes.blind() {
        return Err(BridgeError::Failed(reason));
    }
    let settle_frames = eyes.simulator.frames_to_settle();
    let is_paused = !eyes.simulator.time_has_to_run();
    eyes.hold(settle_frames, is_paused).await?;
    let views = |number: usize| [Shot::BEHIND, Shot::AWAY][number % 2];
    eyes.take::<NOT_COUNTED>(std::array::from_fn(views)).await?;
    let began = Instant::now();
    eyes.take::<COUNTED>(std::array::from_fn(views)).await?;
    let pace = measured(eyes.size(), settle_frames, COUNTED as u32, began);
    eyes.simulator.go_on().await?;
    Ok(pace)
}

/// For a person.
pub(super) fn check(pace: &Finding<Pace>, why_settled: Option<String>) -> Check {
    let check = Check::measured("pace", pace, |pace| {
        format!(
            "{:.1} images of {} a second from two views, {}; `dtd plan SWEEP --sim HOST:PORT` counts with it",
            pace.pictures_per_s,
            pace.size,
            pace.procedure()
        )
    });
    match why_settled {
        Some(why) => Check::warning(
            check.name,
            check.found,
            format!(
                "Nothing, if that is fast enough. One image per drawn frame is not possible here: {why}"
            ),
        ),
        None => check,
    }
}
