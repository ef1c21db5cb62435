//! Pictures of a flight taken in blocks: a view's camera rests while the aircraft moves from drawn frame to drawn frame, then the other
//! view shows the same ticks.
//!
//! In a paused world a block is the whole flight. Where time runs, because rain falls only then, clouds drift meanwhile, and the views of
//! a tick must not be far apart in time.

use dataset::calibration::CameraEntry;
use dataset::conditions::Weather;
use dataset::plan::Picture;
use dataset::pose::FlightState;
use dataset::scenario::Blocks;
use xplane_bridge::{BlockOfTicks, Simulator};

use super::attempt::Attempt;
use super::encoders::Encoders;
use super::error::ScenarioError;
use super::event::Event;
use super::lockstep::{Drawn, check, check_content, request};

/// The longest block where time runs, seconds of flight.
const RUNNING_BLOCK_S: f64 = 5.0;

/// Captures all pictures into `encoders`, block by block; returns what was drawn for each tick and view, and how.
pub(super) async fn capture_blocks(
    simulator: &mut Simulator,
    (states, views, picture): (&[FlightState], &[(String, CameraEntry)], Picture),
    weather: &Weather,
    encoders: &mut Encoders,
    attempt: &Attempt<'_, '_>,
) -> Result<(Vec<Vec<Drawn>>, Blocks), ScenarioError> {
    let block_ticks = ticks_of_a_block(simulator.time_runs(), states.len(), picture);
    let mut drawn: Vec<Vec<Drawn>> = vec![Vec::new(); states.len()];
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
                let frame = attempt.answered(recording.next()).await?;
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
                while let Some(memory) = encoders.take_written() {
                    recording.recycle(memory);
                }
                pictures += 1;
                if pictures % views.len() == 0 {
                    attempt.reporter.tell(Event::Captured {
                        id: attempt.id,
                        done: (pictures / views.len()) as u32,
                    });
                }
            }
            attempt.answered(recording.next()).await?;
            let report = recording.report();
            blocks.count += 1;
            blocks.measured += u32::from(report.is_measured);
            blocks.held_ticks += report.held;
            blocks.repeated_ticks += report.repeated;
            blocks.frames_behind.extend(report.frames_behind);
        }
    }
    blocks.frames_behind.sort_unstable();
    blocks.frames_behind.dedup();
    // The screen's registration before the first picture must still hold after the last.
    attempt.unless_cancelled(simulator.confirm_pixels()).await?;
    Ok((drawn, blocks))
}

fn ticks_of_a_block(time_runs: bool, ticks: usize, picture: Picture) -> usize {
    let running = (RUNNING_BLOCK_S / picture.frame_rate.period_s()) as usize;
    let block = if time_runs { running } else { ticks };
    block.clamp(1, ticks.max(1))
}
