//! Images taken in blocks: a view's camera rests while the aircraft moves from drawn frame to drawn frame, then the other view shows the
//! same ticks.
//!
//! In a paused world a block is the whole flight. In running time, which rain needs, clouds drift, so a tick's views must not be far apart
//! in time.

use std::fmt::Display;

use dataset::conditions::Weather;
use dataset::corpus::calibration::CameraEntry;
use dataset::corpus::scenario::Blocks;
use dataset::geometry::pose::FlightState;
use dataset::plan::Picture;
use xplane_bridge::link::FrameHeader;
use xplane_bridge::pixels::PixelError;
use xplane_bridge::{BlockOfTicks, BlockTrial, BridgeError, Simulator};

use super::encoders::Encoders;
use super::lockstep::{check, check_content, request};
use crate::generate::error::ScenarioError;
use crate::generate::event::Event;
use crate::generate::run::attempt::Attempt;

/// For a person, when blocks are given up.
const SETTLED_INSTEAD: &str = "Every image is settled from now on, which takes several times as long; the time that is left is estimated anew";
/// Maximum ticks per block where time runs: some seconds on the screen, at any tick rate. In longer blocks a tick's views are further apart
/// in time, and in much shorter ones something that covers the scene may come before the first image and go after the last.
const MAX_RUNNING_TICKS: usize = 150;

/// Captures all images into `encoders`, block by block; returns the drawn states by tick and view, and statistics.
pub(crate) async fn capture_blocks(
    simulator: &mut Simulator,
    (states, views, picture): (&[FlightState], &[(String, CameraEntry)], Picture),
    weather: &Weather,
    encoders: &mut Encoders,
    attempt: &Attempt<'_, '_>,
) -> Result<(Vec<Vec<FrameHeader>>, Option<Blocks>), ScenarioError> {
    let block_ticks = ticks_of_a_block(simulator.time_runs(), states.len());
    let mut drawn: Vec<Vec<FrameHeader>> = vec![Vec::new(); states.len()];
    let mut blocks = Blocks {
        ticks: block_ticks as u32,
        frames_behind: Vec::new(),
        count: 0,
        measured: 0,
        held_ticks: 0,
        repeated_ticks: 0,
    };
    let mut pictures = 0;
    for first in (0..states.len()).step_by(block_ticks) {
        let ticks = first..(first + block_ticks).min(states.len());
        for (view, (id, camera)) in views.iter().enumerate() {
            let block = BlockOfTicks {
                first_tick: first as u32,
                states: &states[ticks.clone()],
                frame_rate: picture.frame_rate,
                view: view as u32,
                camera: camera.placed,
                size_px: (picture.width_px, picture.height_px),
            };
            let mut recording = simulator.begin_block(block)?;
            for tick in ticks.clone() {
                let frame = attempt.answered(recording.next_picture()).await?;
                let Some(frame) = frame else {
                    break;
                };
                let deliver = xplane_bridge::Deliver::Coded;
                let asked = request(
                    (picture, deliver),
                    tick as u32,
                    &states[tick],
                    view as u32,
                    camera,
                );
                let seen = check(&asked, &frame, id, None)?;
                check_content(&frame, id, weather)?;
                drawn[tick].push(seen);
                attempt
                    .unless_cancelled(encoders.write(view, frame.rgb))
                    .await?;
                pictures += 1;
                if pictures % views.len() == 0 {
                    attempt.reporter.tell(Event::Captured {
                        id: attempt.id,
                        done: (pictures / views.len()) as u32,
                    });
                }
            }
            attempt.answered(recording.next_picture()).await?;
            let report = recording.report();
            drop(recording);
            blocks.count += 1;
            blocks.measured += u32::from(report.is_measured);
            blocks.held_ticks += report.held;
            blocks.repeated_ticks += report.repeated;
            blocks.frames_behind.extend(report.frames_behind);
        }
    }
    blocks.frames_behind.sort_unstable();
    blocks.frames_behind.dedup();
    // The screen's registration before the first image must still hold after the last.
    attempt.unless_cancelled(simulator.confirm_pixels()).await?;
    Ok((drawn, Some(blocks)))
}

/// Compares block images with settled ones, unless that was done before; true if blocks are used from now on.
pub(crate) async fn may_use_blocks(
    simulator: &mut Simulator,
    (states, views, picture): (&[FlightState], &[(String, CameraEntry)], Picture),
    attempt: &Attempt<'_, '_>,
) -> Result<bool, ScenarioError> {
    let (Some((_, camera)), true) = (views.first(), simulator.can_record_blocks()) else {
        return Ok(false);
    };
    if attempt.settles {
        attempt.reporter.say(&format!(
            "{}: every image is settled in the last attempt, which takes several times as long",
            attempt.id
        ));
        return Ok(false);
    }
    if simulator.known_blocks().trial.is_some() || states.is_empty() {
        return Ok(true);
    }
    let flight = BlockOfTicks {
        first_tick: 0,
        states,
        frame_rate: picture.frame_rate,
        view: 0,
        camera: camera.placed,
        size_px: (picture.width_px, picture.height_px),
    };
    let tried = attempt.unless_cancelled(simulator.try_blocks(flight)).await;
    if let Err(ScenarioError::Bridge(error @ BridgeError::Pixels(PixelError::NoBlocks(_)))) = &tried
    {
        do_without_blocks(simulator, error, attempt).await?;
        return Ok(false);
    }
    match tried? {
        BlockTrial::Equal => {
            tracing::info!("images from a resting camera are equal to settled ones, and are used");
            Ok(true)
        }
        BlockTrial::Different { tick, found } => {
            let why = format!(
                "images of a resting camera show tick {found} where tick {tick} was asked for"
            );
            do_without_blocks(simulator, why, attempt).await?;
            Ok(false)
        }
    }
}

/// Records settled images from now on, and says so, unless the reason is a window that has moved or is covered: an error.
pub(crate) async fn do_without_blocks(
    simulator: &mut Simulator,
    why: impl Display,
    attempt: &Attempt<'_, '_>,
) -> Result<(), ScenarioError> {
    attempt.unless_cancelled(simulator.confirm_pixels()).await?;
    simulator.refuse_blocks();
    attempt.reporter.warn(&format!("{why}. {SETTLED_INSTEAD}"));
    attempt.reporter.tell(Event::PaceChanged { id: attempt.id });
    Ok(())
}

/// Blocks of nearly the same length, so that none is short.
fn ticks_of_a_block(time_runs: bool, ticks: usize) -> usize {
    let blocks = if time_runs {
        ticks.div_ceil(MAX_RUNNING_TICKS)
    } else {
        1
    };
    ticks.div_ceil(blocks.max(1)).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flight_in_rain_is_cut_into_equal_blocks_of_which_none_is_short() {
        assert_eq!(ticks_of_a_block(false, 2_000), 2_000);
        for (ticks, expected) in [(0, 1), (13, 13), (150, 150), (160, 80), (778, 130)] {
            assert_eq!(ticks_of_a_block(true, ticks), expected, "{ticks}");
        }
        for ticks in 151..2_000 {
            let block = ticks_of_a_block(true, ticks);
            let last = (ticks - 1) % block + 1;
            assert!(block > MAX_RUNNING_TICKS / 2 && last > block / 2, "{ticks}");
        }
    }
}
