//! The table of all aircraft of a scenario with traffic: complete, in accord with the first one's ticks, and without jumps.

use dataset::corpus::ScenarioFolder;
use dataset::corpus::scenario::ScenarioRecord;
use dataset::numbers::limits;
use dataset::numbers::units::SimTime;
use dataset::tables::aircraft::AircraftRow;
use dataset::tables::frames::Frames;
use dataset::tables::image_rows::ImageRow;

use crate::faults::{Faults, LENGTH_TOLERANCE_M};

const TABLE: &str = ScenarioFolder::AIRCRAFT;

/// The rows, if the scenario has traffic and each row is in its place.
pub(super) fn read(
    folder: &ScenarioFolder,
    record: &ScenarioRecord,
    faults: &mut Faults,
) -> Option<Vec<AircraftRow>> {
    let path = folder.aircraft_path();
    if record.traffic.is_empty() {
        if path.exists() {
            faults.file(
                TABLE,
                "is there, but scenario.json lists no traffic; remove it, or record the scenario again",
            );
        }
        return None;
    }
    let count = record.aircraft_count();
    let expected = u64::from(record.ticks) * u64::from(count);
    let rows = faults.keep_table(TABLE, AircraftRow::read_with_faults(&path, expected))?;
    if let Some(fault) = AircraftRow::out_of_place(&rows, record.ticks, count) {
        faults.file(TABLE, fault);
        return None;
    }
    Some(rows)
}

/// Checks the rows against the ticks and the record.
pub(super) fn check(
    record: &ScenarioRecord,
    frames: &Frames,
    rows: &[AircraftRow],
    faults: &mut Faults,
) {
    let count = record.aircraft_count() as usize;
    if frames.rows.len() != record.ticks as usize {
        return;
    }
    for (tick, (frame, here)) in frames.rows.iter().zip(rows.chunks(count)).enumerate() {
        let (first, row) = (&here[0], tick * count);
        let (found, expected) = (
            (first.pose, first.controls, first.on_ground),
            (frame.pose, frame.controls, frame.on_ground),
        );
        if found != expected {
            faults.row(
                TABLE,
                row,
                "pose",
                "of aircraft 0 differs from the tick of frames.parquet",
            );
        }
        let is_labelled = frame.labels.is_some();
        for (number, aircraft) in here.iter().enumerate() {
            let from = aircraft.pose.position().lat_lon();
            let expected_m = (is_labelled && record.lands(number as u32))
                .then(|| record.touchdown.lat_lon().distance_m(from));
            let distances = [aircraft.dtd_m, expected_m];
            faults.compare_m(TABLE, row + number, "dtd_m", distances, LENGTH_TOLERANCE_M);
        }
    }
    check_motion(frames, rows, count, faults);
}

/// No aircraft moves faster from tick to tick than one can fly.
fn check_motion(frames: &Frames, rows: &[AircraftRow], count: usize, faults: &mut Faults) {
    let ticks: Vec<_> = rows.chunks(count).zip(&frames.rows).collect();
    for (tick, pair) in ticks.windows(2).enumerate() {
        let [(before, from), (after, to)] = pair else {
            continue;
        };
        let step_s = SimTime(to.time_ns.saturating_sub(from.time_ns)).seconds();
        let most_m = limits::TRUE_AIRSPEED_MPS.most * step_s;
        for (number, (before, after)) in before.iter().zip(*after).enumerate() {
            let [start, end] = [before, after].map(|row| row.pose.position().to_ecef());
            let way_m = start.distance(end);
            if way_m > most_m {
                let message = format!(
                    "of aircraft {number} is {way_m:.1} m from the tick before, {step_s} s earlier, expected at most {most_m:.1} m"
                );
                faults.row(TABLE, (tick + 1) * count + number, "pose", message);
            }
        }
    }
}
