//! `frames.parquet`: exact times, and the evidence that every view shows its tick.

use std::collections::BTreeSet;

use crate::faults::Faults;
use dataset::corpus::ScenarioFolder;
use dataset::corpus::calibration::Calibration;
use dataset::corpus::scenario::{Blocks, ScenarioRecord};
use dataset::geometry::echo::{aircraft_mismatch, camera_mismatch};
use dataset::numbers::units::SimTime;
use dataset::tables::frames::{Frames, TickRow};

const TABLE: &str = ScenarioFolder::FRAMES;
/// Between two ticks the displacement may differ from the mean of the velocities by this part, for an aircraft that turns or brakes within
/// the tick ...
const WAY_TOLERANCE: f64 = 0.1;
/// ... and by this much, metres.
const PLACE_TOLERANCE_M: f64 = 2.0;

/// Allowed change of the displacement from one tick to the next: metres ...
const STEP_TOLERANCE_M: f64 = 0.05;
/// ... a part of the displacement, where a recording has a knot ...
const STEP_TOLERANCE: f64 = 0.25;
/// ... and the effect of three times the earth's gravity: a hard landing.
const HARDEST_MPS2: f64 = 30.0;

/// Reads the table; all numbers outside their limits are faults.
pub(super) fn read(folder: &ScenarioFolder, faults: &mut Faults) -> Option<Frames> {
    faults.keep_table(TABLE, Frames::read_with_faults(&folder.frames_path()))
}

pub(super) fn check(record: &ScenarioRecord, frames: &Frames, faults: &mut Faults) {
    if frames.views != record.views {
        faults.file(
            TABLE,
            format!(
                "has views {:?}, but scenario.json has {:?}",
                frames.views, record.views
            ),
        );
    }
    if frames.rows.len() != record.ticks as usize {
        faults.file(
            TABLE,
            format!(
                "has {} rows, but scenario.json says {} ticks",
                frames.rows.len(),
                record.ticks
            ),
        );
    }
    let mut last_sim_frame: Option<u64> = None;
    for (row, frame) in frames.rows.iter().enumerate() {
        check_time(record, row, frame, faults);
        for (view, stamp) in frames.views.iter().zip(&frame.views) {
            if let Some(mismatch) = aircraft_mismatch(&stamp.echoed_pose, &frame.pose) {
                faults.view_row(view, TABLE, row, "pose drawn is not the tick's", mismatch);
            }
            let pts = record.frame_rate.pts_of_tick(row as u32);
            if stamp.pts != pts {
                faults.view_row(
                    view,
                    TABLE,
                    row,
                    "timestamp",
                    format!("pts_{view} is {}, expected {pts}", stamp.pts),
                );
            }
            // In the order of the requests, so that no other tick's image is between a tick's views.
            let in_order = record.blocks.is_none();
            if let Some(last) = last_sim_frame.filter(|last| in_order && stamp.sim_frame <= *last) {
                let message = format!(
                    "sim_frame_{view} is {}, expected more than {last}",
                    stamp.sim_frame
                );
                faults.view_row(view, TABLE, row, "simulator frames out of order", message);
            }
            last_sim_frame = Some(stamp.sim_frame);
        }
    }
    if let Some(blocks) = &record.blocks {
        check_blocks(blocks, frames, faults);
    }
    for (row, pair) in frames.rows.windows(2).enumerate() {
        if let [before, after] = pair {
            check_continuity(row + 1, before, after, faults);
        }
    }
    for (row, three) in frames.rows.windows(3).enumerate() {
        if let [first, second, third] = three {
            check_steadiness(row + 2, [first, second, third], faults);
        }
    }
}

/// Checks that no frame has two ticks, all frames per block and view come before the frames of the next, and within a block the ticks are
/// drawn in their order, except for ticks that were lost and shown again after later ones (`scenario.json` has their number).
fn check_blocks(blocks: &Blocks, frames: &Frames, faults: &mut Faults) {
    let block_ticks = blocks.ticks.max(1) as usize;
    let mut last_of_block: Option<u64> = None;
    let mut late_ticks = 0;
    let mut first_late: Option<(&String, usize)> = None;
    for (block, rows) in frames.rows.chunks(block_ticks).enumerate() {
        for (index, view) in frames.views.iter().enumerate() {
            let mut seen = BTreeSet::new();
            let mut in_order = Vec::with_capacity(rows.len());
            for (at, frame) in rows.iter().enumerate() {
                let Some(stamp) = frame.views.get(index) else {
                    continue;
                };
                let row = block * block_ticks + at;
                let is_late = last_of_block.is_none_or(|last| stamp.sim_frame > last);
                if !seen.insert(stamp.sim_frame) || !is_late {
                    let message = format!(
                        "sim_frame_{view} is {}, expected one that no other tick has, after {last_of_block:?}, the last of the block before",
                        stamp.sim_frame
                    );
                    faults.view_row(view, TABLE, row, "simulator frames out of order", message);
                }
                if in_order.last().is_some_and(|last| stamp.sim_frame <= *last) {
                    first_late.get_or_insert((view, row));
                }
                in_order.push(stamp.sim_frame);
            }
            late_ticks += out_of_order(&in_order);
            last_of_block = seen.last().copied().or(last_of_block);
        }
    }
    let repeated = blocks.repeated_ticks as usize;
    if let Some((view, row)) = first_late.filter(|_| late_ticks > repeated) {
        let message = format!(
            "by sim_frame, {late_ticks} ticks were drawn after later ones, this one first; expected at most {repeated} (repeated_ticks of \
             scenario.json)"
        );
        faults.view_row(view, TABLE, row, "simulator frames out of order", message);
    }
}

/// The smallest number of values without which the others grow.
fn out_of_order(values: &[u64]) -> usize {
    // Smallest last value among growing subsequences of each length.
    let mut lasts: Vec<u64> = Vec::new();
    for value in values {
        let at = lasts.partition_point(|last| last < value);
        match lasts.get_mut(at) {
            Some(last) => *last = *value,
            None => lasts.push(*value),
        }
    }
    values.len() - lasts.len()
}

/// Checks that the cameras used for drawing match the calibration.
pub(super) fn check_cameras(frames: &Frames, calibration: &Calibration, faults: &mut Faults) {
    for (index, view) in frames.views.iter().enumerate() {
        let Some(entry) = calibration.cameras.get(view) else {
            continue;
        };
        for (row, frame) in frames.rows.iter().enumerate() {
            let Some(stamp) = frame.views.get(index) else {
                continue;
            };
            if let Some(mismatch) = camera_mismatch(&stamp.echoed_camera, &entry.placed) {
                let message = format!("{mismatch} by calibration.json");
                faults.view_row(
                    view,
                    TABLE,
                    row,
                    "camera drawn is not the calibrated one",
                    message,
                );
            }
        }
    }
}

fn check_time(record: &ScenarioRecord, row: usize, frame: &TickRow, faults: &mut Faults) {
    if frame.tick as usize != row {
        faults.row(
            TABLE,
            row,
            "tick",
            format!("is {}, expected {row}", frame.tick),
        );
    }
    let SimTime(expected) = record.frame_rate.time_of_tick(row as u32);
    if frame.time_ns != expected {
        faults.row(
            TABLE,
            row,
            "time",
            format!("time_ns is {}, expected {expected}", frame.time_ns),
        );
    }
}

/// The motion is continuous: no jump between two ticks, none skipped, none doubled.
fn check_continuity(row: usize, before: &TickRow, after: &TickRow, faults: &mut Faults) {
    let step_s = SimTime(after.time_ns.saturating_sub(before.time_ns)).seconds();
    let way = after.pose.position().to_ecef() - before.pose.position().to_ecef();
    let velocity = |frame: &TickRow| {
        frame.pose.position().ecef_from_ned() * glam::DVec3::from(frame.velocity_ned_mps)
    };
    let expected = (velocity(before) + velocity(after)) * (step_s / 2.0);
    let off_m = way.distance(expected);
    let tolerance_m = PLACE_TOLERANCE_M + WAY_TOLERANCE * expected.length();
    if off_m > tolerance_m {
        let message = format!(
            "it moved {:.1} m since the tick before, its velocities say {:.1} m: {off_m:.1} m apart, expected at most {tolerance_m:.1}",
            way.length(),
            expected.length()
        );
        faults.row(TABLE, row, "flight is not continuous", message);
    }
}

/// Each step follows from the previous one. At high rates this finds faults that the velocities, which need not match to the millimetre,
/// hide: one pose that belongs to the next tick.
fn check_steadiness(row: usize, frames: [&TickRow; 3], faults: &mut Faults) {
    let [first, second, third] = frames.map(|frame| frame.pose.position().to_ecef());
    let (before, after) = (second - first, third - second);
    let step_s = SimTime(frames[2].time_ns.saturating_sub(frames[1].time_ns)).seconds();
    let change_m = (after - before).length();
    let tolerance_m = STEP_TOLERANCE_M
        + STEP_TOLERANCE * before.length().max(after.length())
        + HARDEST_MPS2 * step_s * step_s;
    if change_m > tolerance_m {
        let message = format!(
            "it moved {:.2} m since the tick before, and {:.2} m in the step before that: they differ by {change_m:.2} m, expected at most {tolerance_m:.2}",
            after.length(),
            before.length()
        );
        faults.row(TABLE, row, "flight is not steady", message);
    }
}
