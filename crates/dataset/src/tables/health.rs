//! `health/<model>.parquet`: the condition of each camera at each tick, from its images alone.
//!
//! Input: the measurements of `dtd detect` for each image. Output: a typed row for each image, with the camera's direction relative to the
//! flight's usual one where it could be measured. The table belongs to the detections of the same model: their record names it
//! ([`crate::corpus::detections`]), and it is replaced with them.

use schemars::JsonSchema;

use crate::error::Result;
use crate::numbers::limits;
use crate::tables::columns::{Table, TableWriter};
use crate::tables::image_rows::ImageRow;
use crate::tables::row_parts::{Numbers, numbers, words};

/// A view at one tick.
#[derive(Debug, Clone, PartialEq, JsonSchema)]
pub struct ViewHealth {
    /// Number of the tick.
    pub tick: u32,
    /// Identifier of the view.
    pub view: String,
    /// Condition of the camera.
    pub state: HealthState,
    /// Its direction relative to the flight's usual one. In the table, numbers are null where it was not measured.
    pub motion: Option<CameraTurn>,
    /// Condition of the camera by the images up to this tick.
    pub state_live: HealthState,
}

impl ViewHealth {
    /// True if the direction of the camera could not be measured in this image. An image that repeats an earlier one does not count.
    pub fn hides_direction(&self) -> bool {
        let is_known = matches!(self.state, HealthState::Steady | HealthState::Frozen);
        self.motion.is_none() && !is_known
    }
}

/// A camera's direction relative to its usual one, as seen in its image.
#[derive(Debug, Clone, Copy, PartialEq, JsonSchema)]
pub struct CameraTurn {
    /// Place of what is usually at the image's centre minus the centre, pixels to the right.
    pub shift_x_px: f64,
    /// The same, pixels down.
    pub shift_y_px: f64,
    /// Rotation of the image about its centre, clockwise, degrees.
    pub roll_deg: f64,
    /// Standard deviation of the shift, pixels, the larger of both axes.
    pub shift_sd_px: f64,
}

/// Camera conditions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, JsonSchema)]
#[schemars(rename_all = "kebab-case")]
pub enum HealthState {
    /// It looks in its usual direction, and the image is a new one.
    Steady,
    /// It looks in another direction than usual.
    Moved,
    /// Its direction changes from image to image.
    Shaking,
    /// The image repeats an earlier one, although the aircraft moves.
    Frozen,
    /// The background shows too little to measure the direction.
    Unknown,
}

words!(HealthState, 5, {
    Steady: "steady",
    Moved: "moved",
    Shaking: "shaking",
    Frozen: "frozen",
    Unknown: "unknown",
});

impl HealthState {
    /// True unless boxes of such an image are off or old.
    pub fn is_well(self) -> bool {
        matches!(self, Self::Steady | Self::Unknown)
    }
}

numbers!(CameraTurn, 4, {
    shift_x_px: limits::SHIFT_PX,
    shift_y_px: limits::SHIFT_PX,
    roll_deg: limits::CAMERA_ROLL_DEG,
    shift_sd_px: limits::SHIFT_SD_PX,
});

/// The table `health/<model>.parquet`.
impl ImageRow for ViewHealth {
    const NAME: &'static str = "health";

    fn columns(rows: &[Self]) -> TableWriter {
        let rows = rows.iter();
        let turns = rows.clone().map(|row| row.motion);
        TableWriter::new()
            .u32("tick", rows.clone().map(|row| row.tick))
            .text("view", rows.clone().map(|row| &row.view))
            .text("state", rows.clone().map(|row| row.state.word()))
            .optional_numbers(
                CameraTurn::COLUMNS,
                turns.map(|turn| turn.map(CameraTurn::to_array)),
            )
            .text("state_live", rows.map(|row| row.state_live.word()))
    }

    fn of_table(table: &mut Table) -> Result<Vec<Self>> {
        let ticks = table.u32("tick")?;
        let turns = table.optional_numbers(CameraTurn::COLUMNS)?;
        let states = table.words::<HealthState>("state")?;
        let live = table.words::<HealthState>("state_live")?;
        let keys = ticks.into_iter().zip(table.text("view")?).enumerate();
        keys.map(|(row, (tick, view))| {
            Ok(Self {
                tick,
                view,
                state: states[row],
                motion: all_or_none(table, row, turns[row])?.map(CameraTurn::of_array),
                state_live: live[row],
            })
        })
        .collect()
    }
}

fn all_or_none<const N: usize>(
    table: &Table,
    row: usize,
    numbers: std::result::Result<[f64; N], usize>,
) -> Result<Option<[f64; N]>> {
    match numbers {
        Ok(numbers) => Ok(Some(numbers)),
        Err(0) => Ok(None),
        Err(some) => Err(table.fault(format!(
            "row {row} has {some} of {N} numbers, expected all or none"
        ))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows() -> Vec<ViewHealth> {
        let turn = CameraTurn {
            shift_x_px: 1.5,
            shift_y_px: -0.25,
            roll_deg: 0.01,
            shift_sd_px: 0.04,
        };
        (0..)
            .zip(HealthState::ALL)
            .map(|(tick, state)| ViewHealth {
                tick,
                view: "left".into(),
                state,
                motion: (state != HealthState::Unknown).then_some(turn),
                state_live: HealthState::Steady,
            })
            .collect()
    }

    #[test]
    fn health_is_read_back_as_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("abc.parquet");
        for rows in [rows(), Vec::new()] {
            ViewHealth::write(&rows, &path).unwrap();
            let content = std::fs::read(&path).unwrap();
            assert_eq!(ViewHealth::parse(content, &path, 6).unwrap(), rows);
        }
    }

    #[test]
    fn an_unknown_state_and_half_a_turn_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("abc.parquet");
        let read = |state: &str, numbers: [Option<f64>; 4]| {
            let table = TableWriter::new()
                .u32("tick", [0])
                .text("view", ["left"])
                .text("state", [state])
                .text("state_live", ["steady"]);
            let named = CameraTurn::COLUMNS.into_iter().zip(numbers);
            let table = named.fold(table, |table, ((name, _), number)| {
                table.optional_f64(name, [number])
            });
            table.write(&path).unwrap();
            let content = std::fs::read(&path).unwrap();
            ViewHealth::parse(content, &path, 1)
                .unwrap_err()
                .to_string()
        };
        let whole = [Some(1.0); 4];
        let half = [Some(1.0), None, None, Some(0.1)];
        for (state, numbers, words) in [
            (
                "ill",
                whole,
                "row 0: state is \"ill\", expected one of steady, moved",
            ),
            ("moved", half, "row 0 has 2 of 4 numbers"),
            ("moved", [Some(f64::NAN); 4], "row 0: shift_x_px NaN"),
        ] {
            let message = read(state, numbers);
            assert!(message.contains(words), "{message}");
        }
    }
}
