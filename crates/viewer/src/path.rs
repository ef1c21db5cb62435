//! The flown path around the touchdown target, in few enough points for a small map.

use dataset::geometry::runway::RunwayCoordinates;
use dataset::tables::frames::TickRow;
use serde::Serialize;

use crate::opened::Opened;
use crate::rounded::thousandths;
use crate::server::refusal::Refusal;

/// Maximum points per path.
const MAX_POINTS: usize = 200;

/// A flown path.
#[derive(Debug, Default, Serialize)]
pub(crate) struct FlownPath {
    tick: Vec<u32>,
    along_track_m: Vec<f64>,
    cross_track_m: Vec<f64>,
    height_over_target_m: Vec<f64>,
}

/// Reads some ticks, the first and the last among them.
pub(crate) fn read(opened: &Opened) -> Result<FlownPath, Refusal> {
    let frames = opened.files.frames()?;
    let every = frames.rows.len().div_ceil(MAX_POINTS).max(1);
    let last = frames.rows.len().saturating_sub(1);
    let mut path = FlownPath::default();
    for (index, row) in frames.rows.iter().enumerate() {
        if index % every == 0 || index == last {
            let at = place(opened, row);
            path.tick.push(row.tick);
            path.along_track_m.push(thousandths(at.along_track_m));
            path.cross_track_m.push(thousandths(at.cross_track_m));
            path.height_over_target_m
                .push(thousandths(at.height_over_target_m));
        }
    }
    Ok(path)
}

/// Position of the aircraft relative to the touchdown target, as in labels; needs no labels.
pub(crate) fn place(opened: &Opened, row: &TickRow) -> RunwayCoordinates {
    let record = &opened.record;
    RunwayCoordinates::of(
        row.pose.position(),
        record.touchdown,
        record.runway.course_true_deg,
    )
}
